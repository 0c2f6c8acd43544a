/* SPDX-License-Identifier: MIT */
/*
 * Goal: pictures on disk say what the pixels said, and appear whole or not at all; the small parts
 * of the viewer that need no OpenGL do what their headers say.
 */
#include <errno.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include <cmocka.h>
#include <png.h>

#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "tests/helper.h"
#include "viewer/font.h"
#include "viewer/image.h"
#include "viewer/statistics.h"
#include "viewer/window_text.h"

/* Reads a PNG as 8-bit r, g, b (or 16-bit grey).  Ownership: free(). */
static uint8_t *read_png(const char *path, uint32_t format, uint32_t *ret_width)
{
	png_image image = { .version = PNG_IMAGE_VERSION };
	uint8_t *pixels;

	assert_true(png_image_begin_read_from_file(&image, path));
	image.format = format;
	pixels = malloc(PNG_IMAGE_SIZE(image));
	assert_non_null(pixels);
	assert_true(png_image_finish_read(&image, NULL, pixels, 0, NULL));
	*ret_width = image.width;
	return pixels;
}

static void write_image(const char *path, const struct image_form *form, const void *pixels)
{
	struct image_writer *writer;
	struct why why = { "" };

	assert_int_equal(image_create(path, form, &writer, &why), 0);
	assert_int_equal(image_write_rows(writer, pixels, form->height, &why), 0);
	assert_int_equal(image_commit(writer, &why), 0);
}

static void a_colour_picture_is_what_was_written(void **state)
{
	const uint8_t pixels[2][3][4] = {
		{ { 255, 0, 0, 255 }, { 0, 255, 0, 255 }, { 0, 0, 255, 255 } },
		{ { 1, 2, 3, 255 }, { 0, 0, 0, 255 }, { 255, 255, 255, 255 } },
	};
	const struct image_form form = { .width = 3, .height = 2, .channel = CHANNEL_COLOUR };
	const char *path = test_path(*state, "a.png");
	uint32_t width;
	uint8_t *back;

	write_image(path, &form, pixels);
	back = read_png(path, PNG_FORMAT_RGB, &width);
	assert_int_equal(width, 3);
	for (int i = 0; i < 6; i++)
		assert_memory_equal(back + 3 * i, pixels[i / 3][i % 3], 3);
	free(back);
	assert_string_equal(test_folder_list(*state), "a.png ");
}

static void a_raw_picture_has_a_header_and_the_values(void **state)
{
	const uint64_t items[4] = { 7, CHANNEL_ITEM_NONE, UINT64_C(1) << 40, 0 };
	const struct image_form form = { 2, 2, CHANNEL_TRIANGLE, 0.25, { 0.0, 0.0 } };
	const char *path = test_path(*state, "a.raw");
	struct image_raw_header header;
	size_t bytes;
	uint8_t *file;

	write_image(path, &form, items);
	file = test_file_read(path, &bytes);
	assert_int_equal(bytes, sizeof(header) + sizeof(items));
	memcpy(&header, file, sizeof(header));
	assert_memory_equal(header.magic, "OOCIMAGE", 8);
	assert_int_equal(header.version, 1);
	assert_int_equal(header.channel, CHANNEL_TRIANGLE);
	assert_int_equal(header.width, 2);
	assert_int_equal(header.height, 2);
	assert_int_equal(header.pixel_bytes, 8);
	assert_true(header.near == 0.25);
	assert_memory_equal(file + sizeof(header), items, sizeof(items));
	free(file);
}

static void items_get_colours_and_nothing_is_black(void **state)
{
	const uint64_t items[3] = { 1, 2, CHANNEL_ITEM_NONE };
	const struct image_form form = { .width = 3, .height = 1, .channel = CHANNEL_PART };
	const char *path = test_path(*state, "a.png");
	uint32_t width;
	uint8_t *back;

	write_image(path, &form, items);
	back = read_png(path, PNG_FORMAT_RGB, &width);
	assert_memory_not_equal(back, back + 3, 3);
	assert_true(bytes_are_zero(back + 6, 3));
	free(back);
}

static void depth_is_linear_in_sixteen_bits_of_grey(void **state)
{
	/* near 1: distances 2, 6, 10, nothing. */
	const float depths[4] = { 1.0f / 2.0f, 1.0f / 6.0f, 1.0f / 10.0f, 0.0f };
	const struct image_form form = { 4, 1, CHANNEL_DEPTH, 1.0, { 2.0, 10.0 } };
	const char *path = test_path(*state, "a.png");
	png_image image = { .version = PNG_IMAGE_VERSION };
	uint32_t width;
	uint8_t *back;
	FILE *file;
	uint8_t head[33];

	write_image(path, &form, depths);
	/* Bit depth and colour type stand in the header chunk. */
	file = fopen(path, "re");
	assert_non_null(file);
	assert_int_equal(fread(head, sizeof(head), 1, file), 1);
	(void)fclose(file);
	assert_int_equal(head[24], 16);
	assert_int_equal(head[25], PNG_COLOR_TYPE_GRAY);
	back = read_png(path, PNG_FORMAT_GRAY, &width);
	assert_int_equal(back[0], 255);
	assert_true(back[1] > back[2] && back[2] >= back[3]);
	assert_int_equal(back[3], 0);
	free(back);
	png_image_free(&image);
}

static void a_picture_that_is_given_up_leaves_nothing(void **state)
{
	const struct image_form form = { .width = 4, .height = 4, .channel = CHANNEL_COLOUR };
	const char *names[] = { "a.png", "a.raw" };
	const uint8_t row[16] = { 0 };

	for (int i = 0; i < 2; i++) {
		struct image_writer *writer;

		assert_int_equal(image_create(test_path(*state, names[i]), &form, &writer, NULL),
				 0);
		assert_int_equal(image_write_rows(writer, row, 1, NULL), 0);
		assert_null(image_abandon(writer));
	}
	assert_string_equal(test_folder_list(*state), "");
}

static void a_picture_that_cannot_be_written_says_why(void **state)
{
	const struct image_form form = { .width = 1, .height = 1, .channel = CHANNEL_COLOUR };
	struct image_writer *writer;
	struct why why = { "" };

	assert_int_equal(image_create(test_path(*state, "no/a.png"), &form, &writer, &why),
			 -ENOENT);
	assert_non_null(strstr(why.text, "no/a.png: No such file"));
	assert_int_equal(image_create(test_path(*state, "a.jpg"), &form, &writer, &why), -EINVAL);
	assert_non_null(strstr(why.text, ".png or .raw"));
}

/* Writes a picture of noise to a disk that takes so many bytes. */
static void check_full_disk(const char *path, uint32_t side, rlim_t limit_bytes)
{
	const struct image_form form = { .width = side, .height = side, .channel = CHANNEL_NORMAL };
	float *pixels = calloc((size_t)side * side, 3 * sizeof(*pixels));
	struct image_writer *writer;
	struct rlimit usual;
	struct rlimit small;
	struct why why = { "" };

	assert_non_null(pixels);
	/* Which no compression makes small: Marsaglia's xorshift. */
	for (uint32_t i = 0, noise = 1; i < side * side * 3; i++) {
		noise ^= noise << 13;
		noise ^= noise >> 17;
		noise ^= noise << 5;
		pixels[i] = (float)(noise >> 8) / (float)(1 << 24);
	}
	assert_int_equal(getrlimit(RLIMIT_FSIZE, &usual), 0);
	small = usual;
	small.rlim_cur = limit_bytes;
	assert_int_equal(setrlimit(RLIMIT_FSIZE, &small), 0);
	assert_int_equal(image_create(path, &form, &writer, &why), 0);
	if (image_write_rows(writer, pixels, side, &why) < 0)
		image_abandon(writer);
	else
		assert_true(image_commit(writer, &why) < 0);
	assert_int_equal(setrlimit(RLIMIT_FSIZE, &usual), 0);
	assert_non_null(strstr(why.text, path));
	assert_non_null(strstr(why.text, strerror(EFBIG)));
	free(pixels);
}

static void a_disk_that_takes_no_more_is_told_and_leaves_no_picture(void **state)
{
	static const char *const names[] = { "a.png", "a.raw" };

	/* Without the signal, a write beyond the limit fails. */
	(void)signal(SIGXFSZ, SIG_IGN);
	for (size_t i = 0; i < ARRAY_LENGTH(names); i++) {
		check_full_disk(test_path(*state, names[i]), 64, 4096);
		/* So small that it is written when the file is closed. */
		check_full_disk(test_path(*state, names[i]), 4, 16);
	}
	assert_string_equal(test_folder_list(*state), "");
}

static void channels_have_names_and_sizes(void **state)
{
	(void)state;
	for (enum channel c = 0; c < CHANNEL_COUNT_; c++) {
		assert_int_equal(channel_from_name(channel_name(c)), c);
		assert_true(channel_pixel_bytes(c) >= 4);
	}
	assert_int_equal(channel_from_name("red"), -EINVAL);
}

static void every_character_has_a_glyph_of_its_own(void **state)
{
	uint8_t rows[FONT_LAST + 1][FONT_HEIGHT];

	(void)state;
	for (int c = FONT_FIRST; c <= FONT_LAST; c++) {
		font_glyph((unsigned char)c, rows[c]);
		assert_int_equal(bytes_are_zero(rows[c], FONT_HEIGHT), c == ' ');
		for (int other = FONT_FIRST; other < c; other++)
			assert_memory_not_equal(rows[c], rows[other], FONT_HEIGHT);
	}
	font_glyph(200, rows[FONT_FIRST]);
	assert_memory_equal(rows[FONT_FIRST], rows['?'], FONT_HEIGHT);
}

static void the_rate_forgets_what_is_older_than_a_second(void **state)
{
	struct window_rate rate = { 0 };
	uint64_t now = 100 * NS_PER_S;

	(void)state;
	window_rate_add(&rate, now, 1000);
	window_rate_add(&rate, now + NS_PER_S / 2, 500);
	assert_true(window_rate_get(&rate, now + NS_PER_S / 2) == 1500.0);
	assert_true(window_rate_get(&rate, now + 5 * NS_PER_S / 4) == 500.0);
	assert_true(window_rate_get(&rate, now + 9 * NS_PER_S) == 0.0);
}

static void statistics_are_rows_and_a_summary(void **state)
{
	const char *path = test_path(*state, "s.csv");
	const struct statistics_run run = { "a \"GL\"", true, 640, 480, 2 };
	struct frame_report report = { .ms = 3.0,
				       .nodes_wanted = 5,
				       .nodes_drawn = 4,
				       .nodes_missing = 1,
				       .triangles = 77,
				       .bytes_fetched = 10,
				       .bytes_prefetched = 20 };
	struct statistics statistics;
	char *csv;
	char *json = NULL;
	size_t bytes;
	FILE *out;

	assert_int_equal(statistics_init(&statistics, path, NULL), 0);
	for (int i = 0; i < 3; i++) {
		assert_int_equal(statistics_add(&statistics, 0.5 * i, &report, NULL), 0);
		report.ms -= 1.0;
	}
	assert_int_equal(statistics_finish(&statistics, NULL), 0);
	csv = test_file_read(path, &bytes);
	assert_true(bytes > 0);
	assert_memory_equal(csv,
			    "frame,t,ms,nodes_wanted,nodes_drawn,nodes_missing,triangles,"
			    "bytes_fetched,bytes_prefetched,way,budget,selection_ms,nodes_visited,"
			    "waited_ms,order,nodes_shown,rounds,boxes_tested,queries,incomplete\n"
			    "0,0,3.000,5,4,1,77,10,20,full,0,0.000,0,0.000,,0,0,0,0,0\n"
			    "1,0.5,2.000,5,4,1,77,10,20,full,0,0.000,0,0.000,,0,0,0,0,0\n"
			    "2,1,1.000,5,4,1,77,10,20,full,0,0.000,0,0.000,,0,0,0,0,0\n",
			    bytes);
	free(csv);
	out = open_memstream(&json, &bytes);
	assert_non_null(out);
	statistics_write_json(&statistics, &run, out);
	(void)fclose(out);
	assert_non_null(strstr(json, "{\"renderer\":\"a \\\"GL\\\"\",\"in_place\":true"));
	assert_non_null(strstr(json, "\"frames\":3"));
	assert_non_null(strstr(json, "\"median\":2.000"));
	assert_non_null(strstr(json, "\"nodes_missing\":3,\"nodes_missing_last\":1"));
	free(json);
	statistics_done(&statistics);
}

#define IN_A_FOLDER(test)                                                                          \
	cmocka_unit_test_setup_teardown(test, test_folder_setup, test_folder_teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		IN_A_FOLDER(a_colour_picture_is_what_was_written),
		IN_A_FOLDER(a_raw_picture_has_a_header_and_the_values),
		IN_A_FOLDER(items_get_colours_and_nothing_is_black),
		IN_A_FOLDER(depth_is_linear_in_sixteen_bits_of_grey),
		IN_A_FOLDER(a_picture_that_is_given_up_leaves_nothing),
		IN_A_FOLDER(a_picture_that_cannot_be_written_says_why),
		IN_A_FOLDER(a_disk_that_takes_no_more_is_told_and_leaves_no_picture),
		cmocka_unit_test(channels_have_names_and_sizes),
		cmocka_unit_test(every_character_has_a_glyph_of_its_own),
		cmocka_unit_test(the_rate_forgets_what_is_older_than_a_second),
		IN_A_FOLDER(statistics_are_rows_and_a_summary),
	};

	return TEST_RUN(tests);
}
