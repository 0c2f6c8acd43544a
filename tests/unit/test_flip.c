/* SPDX-License-Identifier: MIT */
/*
 * The expected values are those of the authors' own Python program (NVlabs/flip, flip_api.py,
 * compute_ldrflip) for the same pictures, which are made here of whole numbers.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "tests/helper.h"
#include "tools/bench/accuracy/flip.h"

#define WIDTH  64
#define HEIGHT 48
#define PIXELS (WIDTH * HEIGHT)

enum picture {
	RAMP,
	CHECKS,
	GREY,
	WHITE,
	BLACK,
	GREEN,
	BLUE,
	NOISE,
	LINES,
};

static uint8_t value_of(enum picture picture, uint32_t x, uint32_t y, uint32_t k)
{
	static const uint8_t checks[3] = { 230, 60, 120 };
	const uint32_t ramp[3] = { x * 255 / (WIDTH - 1), y * 255 / (HEIGHT - 1),
				   (x * 7 + y * 13) % 256 };

	switch (picture) {
	case RAMP:
		return (uint8_t)ramp[k];
	case CHECKS:
		return (x / 5 + y / 7) % 2 ? checks[k] : 0;
	case GREY:
		return 128;
	case WHITE:
		return 255;
	case BLACK:
		return 0;
	case GREEN:
		return k == 1 ? 255 : 0;
	case BLUE:
		return k == 2 ? 255 : 0;
	case NOISE:
		return (uint8_t)((x * UINT64_C(1103515245) + y * 12345 * (k + 1) + k * 977) >> 7);
	case LINES:
		return (uint8_t)(x % 16 == 0 ? 255 : x * y % 97 + k * 20);
	}
	return 0;
}

static struct flip *prepare(enum picture picture, double pixels_a_degree)
{
	static uint8_t rgb[PIXELS * 3];
	struct flip *flip;

	for (uint32_t i = 0; i < PIXELS * 3; i++)
		rgb[i] = value_of(picture, i / 3 % WIDTH, i / 3 / WIDTH, i % 3);
	assert_int_equal(flip_prepare(rgb, WIDTH, HEIGHT, pixels_a_degree, &flip), 0);
	return flip;
}

static void flip_gives_the_values_of_its_authors(void **state)
{
	static const struct {
		enum picture reference, test;
		double pixels_a_degree;
		double mean, inside, corner; /* of pixels (20, 10) and (0, 0) */
	} cases[] = {
		{ RAMP, CHECKS, FLIP_PIXELS_A_DEGREE, 0.844053, 0.846947, 0.133380 },
		{ RAMP, CHECKS, 20.0, 0.908190, 0.970567, 0.016799 },
		{ GREY, NOISE, FLIP_PIXELS_A_DEGREE, 0.387460, 0.394503, 0.409684 },
		{ GREY, NOISE, 20.0, 0.749089, 0.966784, 0.922226 },
		{ WHITE, BLACK, FLIP_PIXELS_A_DEGREE, 0.967380, 0.967380, 0.967380 },
		{ GREEN, BLUE, FLIP_PIXELS_A_DEGREE, 1.0, 1.0, 1.0 },
		{ LINES, RAMP, FLIP_PIXELS_A_DEGREE, 0.842064, 0.538605, 0.993597 },
		{ LINES, RAMP, 20.0, 0.870986, 0.487691, 0.994613 },
		{ CHECKS, NOISE, FLIP_PIXELS_A_DEGREE, 0.877193, 0.890430, 0.944102 },
	};

	(void)state;
	for (size_t i = 0; i < ARRAY_LENGTH(cases); i++) {
		struct flip *reference = prepare(cases[i].reference, cases[i].pixels_a_degree);
		struct flip *test = prepare(cases[i].test, cases[i].pixels_a_degree);
		float map[PIXELS];

		assert_float_equal(flip_compare(reference, test, map), cases[i].mean, 5e-5);
		assert_float_equal(map[10 * WIDTH + 20], cases[i].inside, 2e-4);
		assert_float_equal(map[0], cases[i].corner, 2e-4);
		flip_done(reference);
		flip_done(test);
	}
}

static void flip_of_a_picture_with_itself_is_nothing(void **state)
{
	struct flip *flip = prepare(NOISE, FLIP_PIXELS_A_DEGREE);

	(void)state;
	assert_true(flip_compare(flip, flip, NULL) == 0.0);
	flip_done(flip);
}

static void flip_takes_pictures_smaller_than_its_filters(void **state)
{
	static const uint8_t one[3] = { 255, 255, 255 };
	static const uint8_t other[3] = { 0, 0, 0 };
	struct flip *a;
	struct flip *b;

	(void)state;
	assert_int_equal(flip_prepare(one, 1, 1, FLIP_PIXELS_A_DEGREE, &a), 0);
	assert_int_equal(flip_prepare(other, 1, 1, FLIP_PIXELS_A_DEGREE, &b), 0);
	assert_float_equal(flip_compare(a, b, NULL), 0.967380, 5e-5);
	flip_done(a);
	flip_done(b);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(flip_gives_the_values_of_its_authors),
		cmocka_unit_test(flip_of_a_picture_with_itself_is_nothing),
		cmocka_unit_test(flip_takes_pictures_smaller_than_its_filters),
	};

	return TEST_RUN(tests);
}
