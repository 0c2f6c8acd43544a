/* SPDX-License-Identifier: MIT */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "tests/helper.h"
#include "tools/bench/base/rgb_image.h"

static uint8_t four[4 * 2 * 3];

static struct rgb_image four_by_two(void)
{
	for (size_t i = 0; i < sizeof(four); i++)
		four[i] = (uint8_t)(i * 10);
	return (struct rgb_image){ 4, 2, four };
}

static void rgb_image_is_read_as_it_was_encoded(void **state)
{
	const struct rgb_image image = four_by_two();
	const char *path = test_path(*state, "i.png");
	struct rgb_image read;
	struct why why;
	uint8_t *bytes;
	size_t size;

	assert_int_equal(rgb_image_encode(&image, &bytes, &size), 0);
	test_file_write(path, bytes, size);
	assert_int_equal(rgb_image_read(path, &read, &why), 0);
	assert_int_equal(read.width, 4);
	assert_int_equal(read.height, 2);
	assert_memory_equal(read.pixels, four, sizeof(four));
	rgb_image_done(&read);
	/* Half of it is none. */
	test_file_write(path, bytes, size / 2);
	assert_int_equal(rgb_image_read(path, &read, &why), -EUCLEAN);
	assert_int_equal(rgb_image_read(test_path(*state, "none.png"), &read, &why), -ENOENT);
	free(bytes);
}

static void rgb_image_scales_by_means_and_by_the_nearest(void **state)
{
	const struct rgb_image image = four_by_two();
	struct rgb_image small;
	struct rgb_image large;

	(void)state;
	assert_int_equal(rgb_image_scale(&image, 2, 1, &small), 0);
	/* Pixels 0, 1, 4, 5: red is 0, 30, 120, 150. */
	assert_int_equal(small.pixels[0], 75);
	assert_int_equal(rgb_image_scale(&image, 8, 4, &large), 0);
	for (uint32_t y = 0; y < 4; y++)
		for (uint32_t x = 0; x < 8; x++)
			assert_memory_equal(&large.pixels[3 * (y * 8 + x)],
					    &four[3 * (y / 2 * 4 + x / 2)], 3);
	rgb_image_done(&small);
	rgb_image_done(&large);
}

static void rgb_image_counts_pixels_that_differ_by_more_than_a_threshold(void **state)
{
	const struct rgb_image image = four_by_two();
	uint8_t other[sizeof(four)];
	const struct rgb_image changed = { 4, 2, other };

	(void)state;
	memcpy(other, four, sizeof(four));
	other[4] = (uint8_t)(other[4] + 8);
	other[9] = (uint8_t)(other[9] - 20);
	other[11] = (uint8_t)(other[11] + 1);
	assert_int_equal(rgb_image_differing(&image, &changed, 0), 2);
	assert_int_equal(rgb_image_differing(&image, &changed, 8), 1);
	assert_int_equal(rgb_image_differing(&image, &changed, 20), 0);
}

static void rgb_image_of_errors_grows_brighter_with_them(void **state)
{
	static const float errors[] = { 0.0f, 1.0f / 3.0f, 2.0f / 3.0f, 1.0f };
	static const uint8_t expected[] = { 0, 0, 0, 255, 0, 0, 255, 255, 0, 255, 255, 255 };
	struct rgb_image image;

	(void)state;
	assert_int_equal(rgb_image_of_errors(errors, 4, 1, &image), 0);
	assert_memory_equal(image.pixels, expected, sizeof(expected));
	rgb_image_done(&image);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(rgb_image_is_read_as_it_was_encoded,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test(rgb_image_scales_by_means_and_by_the_nearest),
		cmocka_unit_test(rgb_image_counts_pixels_that_differ_by_more_than_a_threshold),
		cmocka_unit_test(rgb_image_of_errors_grows_brighter_with_them),
	};

	return TEST_RUN(tests);
}
