/* SPDX-License-Identifier: MIT */
/* Goal: images on a surface become the colours of its corners, whatever the images are. */
#include <endian.h>
#include <errno.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include <cmocka.h>
#include <jpeglib.h>
#include <png.h>
#include <zlib.h>

#include "formats/base/bytes.h"
#include "tests/helper.h"
#include "tests/unit/import_kit.h"

#define RED   0xff0000ffu
#define GREEN 0xff00ff00u
#define BLUE  0xffff0000u
#define WHITE 0xffffffffu

/* Three corners, and texture coordinates in the middle of the four quarters of an image. */
#define TRIANGLE "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
#define QUARTERS "vt .25 .75\nvt .75 .75\nvt .25 .25\nvt .75 .25\n"
#define MODEL    "mtllib a.mtl\n" TRIANGLE QUARTERS "usemtl m\n"

/* ---- images ---- */

/* An image in memory, red, green, blue. */
struct image {
	uint32_t width;
	uint32_t height;
	uint8_t *rgb;
};

static struct image image_make(uint32_t width, uint32_t height)
{
	struct image image = { width, height, calloc((size_t)width * height, 3) };

	assert_non_null(image.rgb);
	return image;
}

static void image_fill(struct image *image, uint32_t x0, uint32_t x1, uint32_t y0, uint32_t y1,
		       uint32_t colour)
{
	for (uint32_t y = y0; y < y1; y++)
		for (uint32_t x = x0; x < x1; x++)
			for (int k = 0; k < 3; k++)
				image->rgb[3 * (y * image->width + x) + (uint32_t)k] =
					(uint8_t)(colour >> 8 * k);
}

/* Red, green / blue, white. */
static struct image image_quarters(uint32_t side)
{
	struct image image = image_make(side, side);

	image_fill(&image, 0, side / 2, 0, side / 2, RED);
	image_fill(&image, side / 2, side, 0, side / 2, GREEN);
	image_fill(&image, 0, side / 2, side / 2, side, BLUE);
	image_fill(&image, side / 2, side, side / 2, side, WHITE);
	return image;
}

static void write_png(const char *path, const struct image *image, bool interlaced)
{
	png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
	png_infop info = png_create_info_struct(png);
	uint8_t **rows = calloc(image->height, sizeof(*rows));
	FILE *file = fopen(path, "wbe");

	assert_non_null(file);
	assert_non_null(rows);
	for (size_t y = 0; y < image->height; y++)
		rows[y] = image->rgb + 3 * y * image->width;
	png_init_io(png, file);
	png_set_IHDR(png, info, image->width, image->height, 8, PNG_COLOR_TYPE_RGB,
		     interlaced ? PNG_INTERLACE_ADAM7 : PNG_INTERLACE_NONE,
		     PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
	png_write_info(png, info);
	png_write_image(png, rows);
	png_write_end(png, info);
	png_destroy_write_struct(&png, &info);
	free(rows);
	assert_int_equal(fclose(file), 0);
}

/* With a palette, grey, 16 bits, or transparent: what the simplified interface can make. */
static void write_png_format(const char *path, uint32_t format, const void *pixels,
			     const void *colour_map)
{
	png_image image = { .version = PNG_IMAGE_VERSION, .width = 2, .height = 2 };

	image.format = format;
	image.colormap_entries = colour_map ? 4 : 0;
	assert_true(png_image_write_to_file(&image, path, 0, pixels, 0, colour_map));
}

static void write_jpeg(const char *path, const struct image *image, bool progressive)
{
	struct jpeg_compress_struct jpeg;
	struct jpeg_error_mgr errors;
	FILE *file = fopen(path, "wbe");

	assert_non_null(file);
	jpeg.err = jpeg_std_error(&errors);
	jpeg_create_compress(&jpeg);
	jpeg_stdio_dest(&jpeg, file);
	jpeg.image_width = image->width;
	jpeg.image_height = image->height;
	jpeg.input_components = 3;
	jpeg.in_color_space = JCS_RGB;
	jpeg_set_defaults(&jpeg);
	jpeg_set_quality(&jpeg, 95, TRUE);
	if (progressive)
		jpeg_simple_progression(&jpeg);
	jpeg_start_compress(&jpeg, TRUE);
	for (uint32_t y = 0; y < image->height; y++) {
		JSAMPROW row = image->rgb + (size_t)3 * y * image->width;

		assert_int_equal(jpeg_write_scanlines(&jpeg, &row, 1), 1);
	}
	jpeg_finish_compress(&jpeg);
	jpeg_destroy_compress(&jpeg);
	assert_int_equal(fclose(file), 0);
}

/* ---- models ---- */

/* Imports MODEL and what follows it, with a material whose lines these are. */
static struct kit_model *import_with(const char *folder, const char *material, const char *rest)
{
	char text[1024];

	(void)snprintf(text, sizeof(text), "newmtl m\nKd 0 0 1\n%s\n", material);
	test_file_write(test_path(folder, "a.mtl"), text, strlen(text));
	(void)snprintf(text, sizeof(text), MODEL "%s\n", rest);
	return kit_import_text(folder, "a.obj", text);
}

static void assert_colour(uint32_t colour, uint32_t expected, int tolerance)
{
	for (int k = 0; k < 32; k += 8)
		if (abs((int)(colour >> k & 255) - (int)(expected >> k & 255)) > tolerance)
			fail_msg("the colour is %08x, not %08x", colour, expected);
}

/* What the quarters of the material's image look like to triangles that are points in it. */
static void assert_quarters(const char *folder, const char *material, int tolerance)
{
	static const uint32_t expected[] = { RED, GREEN, BLUE, WHITE };
	struct kit_model *model = import_with(
		folder, material, "f 1/1 2/1 3/1\nf 1/2 2/2 3/2\nf 1/3 2/3 3/3\nf 1/4 2/4 3/4\n");

	kit_assert_ok(model);
	assert_int_equal(model->info.missing_texture_count, 0);
	assert_int_equal(model->triangle_count, 4);
	for (size_t i = 0; i < 12; i++)
		assert_colour(model->colours[i], expected[i / 3], tolerance);
	kit_model_free(model);
}

static void every_kind_of_png_and_jpeg_is_read(void **state)
{
	static const uint8_t opaque[] = { 255, 0, 0,   255, 0,   255, 0,   255,
					  0,   0, 255, 255, 255, 255, 255, 255 };
	static const uint8_t clear[] = {
		255, 0, 0, 0, 0, 255, 0, 9, 0, 0, 255, 0, 255, 255, 255, 0
	};
	static const uint16_t wide[] = {
		65535, 0, 0, 0, 65535, 0, 0, 0, 65535, 65535, 65535, 65535
	};
	static const uint8_t map[] = { 255, 0, 0, 0, 255, 0, 0, 0, 255, 255, 255, 255 };
	static const uint8_t numbers[] = { 0, 1, 2, 3 };
	struct image image = image_quarters(64);

	write_png(test_path(*state, "a.png"), &image, false);
	assert_quarters(*state, "map_Kd a.png", 0);
	write_png(test_path(*state, "a.png"), &image, true);
	assert_quarters(*state, "map_Kd a.png", 0);
	write_jpeg(test_path(*state, "a.jpg"), &image, false);
	assert_quarters(*state, "map_Kd a.jpg", 4);
	write_jpeg(test_path(*state, "a.jpg"), &image, true);
	assert_quarters(*state, "map_Kd a.jpg", 4);
	/* Two texels a side: the middle of a quarter is that of a texel. */
	write_png_format(test_path(*state, "a.png"), PNG_FORMAT_RGBA, opaque, NULL);
	assert_quarters(*state, "map_Kd a.png", 0);
	write_png_format(test_path(*state, "a.png"), PNG_FORMAT_RGBA, clear, NULL);
	assert_quarters(*state, "map_Kd a.png", 0);
	write_png_format(test_path(*state, "a.png"), PNG_FORMAT_LINEAR_RGB, wide, NULL);
	assert_quarters(*state, "map_Kd a.png", 0);
	write_png_format(test_path(*state, "a.png"), PNG_FORMAT_RGB_COLORMAP, numbers, map);
	assert_quarters(*state, "map_Kd a.png", 0);
	free(image.rgb);
}

static void a_name_is_found_with_blanks_folders_and_options(void **state)
{
	struct image image = image_quarters(16);

	assert_int_equal(mkdir(test_path(*state, "images"), 0700), 0);
	write_png(test_path(*state, "images/wood grain.png"), &image, false);
	write_png(test_path(*state, "3d.png"), &image, false);
	assert_quarters(*state, "map_Kd images/wood grain.png", 0);
	assert_quarters(*state, "\tmap_Kd   images\\wood grain.png \r", 0);
	assert_quarters(*state, "map_Kd -blendu on -s 1 1 1 -mm 0 1 images/wood grain.png", 0);
	assert_quarters(*state, "map_Kd C:\\somebody\\3d.png", 0);
	assert_quarters(*state, "map_Kd /nowhere/at/all/3d.png", 0);
	assert_quarters(*state, "map_Kd -o 1 -2 -s 1 1 3d.png", 0);
	assert_quarters(*state, "map_Kd none.png\nmap_Kd 3d.png", 0);
	free(image.rgb);
}

static void coordinates_repeat_or_are_clamped_and_are_scaled(void **state)
{
	struct image image = image_quarters(16);
	struct kit_model *model;

	write_png(test_path(*state, "a.png"), &image, false);
	model = import_with(*state, "map_Kd a.png",
			    "vt -0.75 1.75\nvt 1e9 nan\nf 1/5 2/5 3/5\nf 1/6 2/6 3/6\n");
	kit_assert_ok(model);
	assert_int_equal(model->colours[0], RED);
	kit_model_free(model);
	model = import_with(*state, "map_Kd -clamp on a.png", "vt 7.25 7.75\nf 1/5 2/5 3/5\n");
	kit_assert_ok(model);
	assert_int_equal(model->colours[0], GREEN);
	kit_model_free(model);
	model = import_with(*state, "map_Kd -s 3 1 -o 0.5 0 a.png",
			    "vt 0.25 0.75\nf 1/5 2/5 3/5\n");
	kit_assert_ok(model);
	assert_int_equal(model->colours[0], RED);
	kit_model_free(model);
	free(image.rgb);
}

static void a_corner_stands_for_as_much_as_its_triangle_covers(void **state)
{
	struct image image = image_make(3000, 1500);
	struct kit_model *model;

	/* Stripes of black and white, and one pixel in four of a half: 188 and 137 are the means. */
	for (uint32_t x = 0; x < 3000; x += 2)
		image_fill(&image, x, x + 1, 0, 1500, WHITE);
	write_png(test_path(*state, "a.png"), &image, false);
	model = import_with(*state, "map_Kd a.png", "vt 0 0\nvt 1 0\nvt 0 1\nf 1/5 2/6 3/7\n");
	kit_assert_ok(model);
	for (size_t i = 0; i < 3; i++)
		assert_colour(model->colours[i], 0xffbcbcbc, 0);
	kit_model_free(model);
	/* Half of an image, on a small triangle and on a large one. */
	free(image.rgb);
	image = image_quarters(512);
	write_png(test_path(*state, "a.png"), &image, false);
	model = import_with(*state, "map_Kd a.png",
			    "vt .26 .75\nvt .25 .76\nf 1/1 2/5 3/6\n"
			    "vt 40 0\nvt 0 40\nvt 0 0\nf 1/7 2/8 3/9\n");
	kit_assert_ok(model);
	for (size_t i = 0; i < 3; i++)
		assert_int_equal(model->colours[i], RED);
	for (size_t i = 3; i < 6; i++)
		assert_colour(model->colours[i], 0xffbcbcbc, 0);
	kit_model_free(model);
	free(image.rgb);
}

static void the_colour_option_goes_from_texture_to_grey(void **state)
{
	const char *text = "mtllib a.mtl\nv 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 1 1 0 1 0 0\n" QUARTERS
			   "usemtl m\nf 1/2 2/2 3/2\nf 1 2 3\nf 1/2 2/2 3/99\n";
	const char *library = "newmtl m\nKd 0 0 1\nd 0.5\nmap_Kd a.png\n";
	static const uint32_t expected[] = { 0x8000ff00, RED, 0, 0 };
	struct import_options options = { .memory_bytes = 64 * MIB, .scratch_directory = *state };
	struct image image = image_quarters(16);

	write_png(test_path(*state, "a.png"), &image, false);
	test_file_write(test_path(*state, "a.mtl"), library, strlen(library));
	test_file_write(test_path(*state, "a.obj"), text, strlen(text));
	for (int colour = IMPORT_COLOUR_TEXTURE; colour <= IMPORT_COLOUR_NONE; colour++) {
		struct kit_model *model;

		options.colour = (enum import_colour)colour;
		model = kit_import(test_path(*state, "a.obj"), &options);
		kit_assert_ok(model);
		assert_int_equal(model->triangle_count, 3);
		assert_int_equal(model->colours[0], expected[colour]);
		/* Those without a texture of their own. */
		assert_int_equal(model->colours[3], colour <= IMPORT_COLOUR_VERTEX ? RED : 0);
		assert_int_equal(model->colours[6], colour <= IMPORT_COLOUR_VERTEX ? RED : 0);
		assert_int_equal(model->parts[0].colour,
				 colour == IMPORT_COLOUR_NONE ? IMPORT_COLOUR_DEFAULT : 0x80ff0000);
		kit_model_free(model);
	}
	free(image.rgb);
}

/* ---- what is wrong ---- */

static void assert_left_out(const char *folder, const char *name)
{
	char material[128];
	struct kit_model *model;

	(void)snprintf(material, sizeof(material), "map_Kd %s", name);
	model = import_with(folder, material, "f 1/1 2/2 3/3\nusemtl none\nf 1/1 2/2 3/3\n");
	kit_assert_ok(model);
	assert_int_equal(model->info.missing_texture_count, 1);
	assert_false(model->has_colours);
	assert_int_equal(model->parts[0].colour, BLUE);
	kit_model_free(model);
}

/* Changes bytes of a file and cuts it. */
static void rewrite(const char *path, size_t offset, const void *data, size_t size_bytes,
		    size_t length)
{
	size_t bytes;
	uint8_t *content = test_file_read(path, &bytes);

	assert_true(offset + size_bytes <= bytes);
	memcpy(content + offset, data, size_bytes);
	test_file_write(path, content, length < bytes ? length : bytes);
	free(content);
}

static void images_that_cannot_be_read_leave_the_material(void **state)
{
	static const uint8_t giant[8] = { 0, 0, 0xff, 0xff, 0, 0, 0xff, 0xff };
	static const uint8_t tall[2] = { 0xf0, 0 };
	const char *png = test_path(*state, "a.png");
	const char *jpeg = test_path(*state, "a.jpg");
	struct image image = image_quarters(64);

	assert_left_out(*state, "none.png");
	assert_left_out(*state, ".");
	assert_left_out(*state, "a.mtl");
	test_file_write(png, "", 0);
	assert_left_out(*state, "a.png");
	for (size_t length = 1; length < 150; length += 7) {
		write_png(png, &image, length % 2);
		rewrite(png, 0, "", 0, length);
		assert_left_out(*state, "a.png");
		write_jpeg(jpeg, &image, length % 2);
		rewrite(jpeg, 0, "", 0, 4 * length);
		assert_left_out(*state, "a.jpg");
	}
	/* The header's checksum is wrong then; and one that is right says too much. */
	write_png(png, &image, false);
	rewrite(png, 16, giant, 8, SIZE_MAX);
	assert_left_out(*state, "a.png");
	free(image.rgb);
	image = image_make(60000, 1);
	write_jpeg(jpeg, &image, false);
	/* Start of frame: its marker, length, precision, then height and width. */
	for (size_t i = 0, bytes = 0; i == 0 || i + 9 < bytes; i++) {
		uint8_t *content = test_file_read(jpeg, &bytes);
		bool found = content[i] == 0xff && content[i + 1] == 0xc0;

		free(content);
		if (!found)
			continue;
		rewrite(jpeg, i + 5, tall, 2, SIZE_MAX);
		break;
	}
	assert_left_out(*state, "a.jpg");
	free(image.rgb);
	assert_int_equal(mkfifo(test_path(*state, "pipe.png"), 0600), 0);
	assert_left_out(*state, "pipe.png");
}

static void an_image_of_giant_sides_is_left_out_before_anything_is_made(void **state)
{
	static const uint8_t height[4] = { 0, 0, 8000 >> 8, 8000 & 255 };
	const char *png = test_path(*state, "a.png");
	struct image image = image_make(66000, 1);
	uint8_t *content;
	size_t bytes;
	uint32_t sum;

	write_png(png, &image, false);
	assert_left_out(*state, "a.png");
	free(image.rgb);
	/* 9000 x 8000, whose header is in order. */
	image = image_make(9000, 1);
	write_png(png, &image, false);
	rewrite(png, 20, height, sizeof(height), SIZE_MAX);
	content = test_file_read(png, &bytes);
	sum = htobe32((uint32_t)crc32(0, content + 12, 17));
	free(content);
	rewrite(png, 29, &sum, sizeof(sum), SIZE_MAX);
	assert_left_out(*state, "a.png");
	free(image.rgb);
}

static void an_image_that_does_not_fit_in_memory_is_refused(void **state)
{
	struct import_options options = { .memory_bytes = 2 * MIB, .scratch_directory = *state };
	struct image image = image_make(1024, 1024);
	struct kit_model *model;

	write_png(test_path(*state, "a.png"), &image, false);
	kit_model_free(import_with(*state, "map_Kd a.png", "f 1/1 2/1 3/1\n"));
	model = kit_import(test_path(*state, "a.obj"), &options);
	kit_assert_refused(model, -ENOMEM, "for textures");
	kit_model_free(model);
	/* The least that an importer is given has room for any, but for those that are held whole. */
	options.memory_bytes = 16 * MIB;
	model = kit_import(test_path(*state, "a.obj"), &options);
	kit_assert_ok(model);
	kit_model_free(model);
	free(image.rgb);
}

/* ---- what exceeds memory ---- */

static void more_textures_and_corners_than_memory_look_the_same(void **state)
{
	struct kit_bytes model_text = { 0 }, library = { 0 };
	struct kit_model *expected;

	for (uint32_t i = 0; i < 40; i++) {
		struct image image = image_make(32 + i, 40 - i / 2);
		char name[32];

		for (size_t k = 0; k < (size_t)3 * image.width * image.height; k++)
			image.rgb[k] = (uint8_t)(k * k * (i + 3) >> 4);
		(void)snprintf(name, sizeof(name), "%u.png", i);
		write_png(test_path(*state, name), &image, i % 2);
		kit_print(&library, "newmtl m%u\nmap_Kd %s\n", i, name);
		free(image.rgb);
	}
	test_file_write(test_path(*state, "a.mtl"), library.data, library.size_bytes);
	kit_print(&model_text, "mtllib a.mtl\n" TRIANGLE QUARTERS);
	for (int i = 0; i < 3000; i++) {
		kit_print(&model_text, "v %d %d 1\nvt 0.%d %d\nvn 0 0 1\n", i, i % 7, i, i % 5);
		kit_print(&model_text, "usemtl m%d\nf -1/-1 -2/-2 -3/-4 1/2\n", i / 8 % 41);
		kit_print(&model_text, "f -1/-1/-1 1/2/-1 3/1/1\nf 1 2 3\n");
	}
	expected = kit_import_bytes(*state, "a.obj", model_text.data, model_text.size_bytes);
	assert_true(expected->has_colours);
	for (uint64_t memory_bytes = 400000; memory_bytes < 8 * MIB; memory_bytes *= 4) {
		struct import_options options = { .memory_bytes = memory_bytes,
						  .scratch_directory = *state };
		struct kit_model *model = kit_import(test_path(*state, "a.obj"), &options);

		kit_assert_same(expected, model);
		kit_model_free(model);
	}
	kit_model_free(expected);
	free(model_text.data);
	free(library.data);
}

int main(void)
{
#define TEXTURE_TEST(name)                                                                         \
	cmocka_unit_test_setup_teardown(name, test_folder_setup, test_folder_teardown)
	const struct CMUnitTest tests[] = {
		TEXTURE_TEST(every_kind_of_png_and_jpeg_is_read),
		TEXTURE_TEST(a_name_is_found_with_blanks_folders_and_options),
		TEXTURE_TEST(coordinates_repeat_or_are_clamped_and_are_scaled),
		TEXTURE_TEST(a_corner_stands_for_as_much_as_its_triangle_covers),
		TEXTURE_TEST(the_colour_option_goes_from_texture_to_grey),
		TEXTURE_TEST(images_that_cannot_be_read_leave_the_material),
		TEXTURE_TEST(an_image_of_giant_sides_is_left_out_before_anything_is_made),
		TEXTURE_TEST(an_image_that_does_not_fit_in_memory_is_refused),
		TEXTURE_TEST(more_textures_and_corners_than_memory_look_the_same),
	};

	return TEST_RUN(tests);
}
