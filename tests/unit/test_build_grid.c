/* SPDX-License-Identifier: MIT */
/*
 * Goal: the grid keeps the bound it was asked for, the root holds the model, what has no area is
 * told exactly, and a cell's triangles are those that touch it.
 */
#include <errno.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "tests/helper.h"
#include "tools/build/grid.h"
#include "tools/build/overlap.h"

/* A number in 0 .. 1, the same row each time. */
static double next_number(void)
{
	static uint64_t random = 1;

	random = random * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
	return (double)(random >> 11) * 0x1p-53;
}

static void no_point_moves_further_than_the_error(void **state)
{
	static const double offsets[] = { 0, 1e7, -3.3e5 };
	static const double errors[] = { 0.5, 0.001, 1e-5 };

	(void)state;
	for (size_t i = 0; i < ARRAY_LENGTH(offsets) * ARRAY_LENGTH(errors); i++) {
		double offset = offsets[i % 3];
		double error = errors[i / 3];
		const double low[3] = { offset, offset - 5, offset + 1 };
		const double high[3] = { offset + 17, offset + 4, offset + 30 };
		struct grid grid;

		assert_int_equal(grid_choose(&grid, low, high, error, false, NULL), 0);
		assert_true(grid.step * sqrt(3) / 2 <= error);
		assert_true(grid.step * sqrt(3) > error);
		for (unsigned n = 0; n < 1000; n++) {
			double moved = 0;

			for (unsigned k = 0; k < 3; k++) {
				double at = low[k] + next_number() * (high[k] - low[k]);
				int32_t steps =
					grid_round((at - grid.origin[k]) * grid.step_inverse);
				double snapped = grid.origin[k] + steps * grid.step;

				assert_true(steps >= -(1 << (grid.root_bits - 1)));
				assert_true(steps < 1 << (grid.root_bits - 1));
				moved += (snapped - at) * (snapped - at);
			}
			assert_true(sqrt(moved) <= error);
		}
	}
}

static void the_default_error_is_a_share_of_the_diagonal(void **state)
{
	const double low[3] = { 0, 0, 0 };
	const double high[3] = { 30, 40, 0 };
	struct grid grid;

	(void)state;
	assert_int_equal(grid_choose(&grid, low, high, -1, false, NULL), 0);
	assert_true(grid.error == 50 / GRID_ERROR_DIVISOR);
}

static void an_error_too_small_for_the_model_is_refused_with_one_that_is_not(void **state)
{
	const double low[3] = { 0, 0, 0 };
	const double high[3] = { 1000, 1, 1 };
	struct why why = { 0 };
	struct grid grid;
	double wanted;

	(void)state;
	assert_int_equal(grid_choose(&grid, low, high, 1e-9, false, &why), -EINVAL);
	assert_non_null(strstr(why.text, "use --error "));
	wanted = strtod(strstr(why.text, "use --error ") + strlen("use --error "), NULL);
	assert_int_equal(grid_choose(&grid, low, high, wanted, false, NULL), 0);
}

static void an_exact_root_holds_its_box_wherever_it_is(void **state)
{
	(void)state;
	for (unsigned n = 0; n < 200; n++) {
		double scale = pow(10, next_number() * 14 - 7);
		double low[3];
		double high[3];
		struct grid grid;

		for (unsigned k = 0; k < 3; k++) {
			low[k] = (next_number() - 0.5) * scale;
			high[k] = low[k] + next_number() * pow(10, next_number() * 6 - 3);
		}
		assert_int_equal(grid_choose(&grid, low, high, 0, true, NULL), 0);
		for (unsigned k = 0; k < 3; k++) {
			int exponent;

			assert_true(grid.root_min[k] <= low[k]);
			assert_true(high[k] < grid.root_min[k] + grid.root_size);
			assert_true(frexp(grid.root_size, &exponent) == 0.5);
		}
	}
}

static void what_has_no_area_is_told_exactly(void **state)
{
	const double low[3] = { -1, -1, -1 };
	const double high[3] = { 1, 1, 1 };
	struct grid lattice;
	struct grid floats;

	(void)state;
	assert_int_equal(grid_choose(&lattice, low, high, 1e-6, false, NULL), 0);
	assert_int_equal(grid_choose(&floats, low, high, 0, false, NULL), 0);
	/* Three points of a line that no double arithmetic on thirds would find on it. */
	const double on_lattice[9] = { -8388600, 3, 1, 0, 8, 4, 8388600, 13, 7 };
	const double off_lattice[9] = { -8388600, 3, 1, 0, 8, 4, 8388600, 13, 8 };

	assert_true(grid_is_degenerate(&lattice, on_lattice));
	assert_false(grid_is_degenerate(&lattice, off_lattice));
	for (unsigned n = 0; n < 1000; n++) {
		double corners[9];

		for (unsigned k = 0; k < 3; k++) {
			float a = (float)(next_number() - 0.5);
			float step = (float)ldexp(1 + (double)(uint32_t)(next_number() * 7), -20);

			/* Twice a step from a float is a float again here. */
			a = (float)ldexp(rint(ldexp((double)a, 20)), -20);
			corners[k] = (double)a;
			corners[3 + k] = (double)a + (double)step;
			corners[6 + k] = (double)a + 2 * (double)step;
		}
		assert_true(grid_is_degenerate(&floats, corners));
		corners[8] = nextafter(corners[8], INFINITY);
		assert_false(grid_is_degenerate(&floats, corners));
	}
	const double twice[9] = { 1, 2, 3, 1, 2, 3, 4, 5, 6 };

	assert_true(grid_is_degenerate(&lattice, twice));
	assert_true(grid_is_degenerate(&floats, twice));
}

/* ---- cells and triangles ---- */

/* Is some point of a fine sampling of the triangle in the closed cell? */
static bool samples_touch(const double corners[9], const double cell_min[3], double size)
{
	const unsigned fine = 60;

	for (unsigned a = 0; a <= fine; a++) {
		for (unsigned b = 0; a + b <= fine; b++) {
			bool inside = true;

			for (unsigned k = 0; k < 3; k++) {
				double at = (corners[k] * a + corners[3 + k] * b +
					     corners[6 + k] * (fine - a - b)) /
					    fine;

				inside = inside && at >= cell_min[k] && at <= cell_min[k] + size;
			}
			if (inside)
				return true;
		}
	}
	return false;
}

static void a_cell_has_what_touches_it_and_nothing_else(void **state)
{
	const double low[3] = { -100, -100, -100 };
	const double high[3] = { 100, 100, 100 };
	struct grid grid;
	unsigned touching = 0;
	unsigned missed = 0;

	(void)state;
	assert_int_equal(grid_choose(&grid, low, high, 0.7, false, NULL), 0);
	for (unsigned n = 0; n < 3000; n++) {
		uint32_t cell[3];
		double corners[9];
		double cell_min[3];
		double size;
		bool told;
		bool seen;

		for (unsigned k = 0; k < 9; k++)
			corners[k] = rint((next_number() - 0.5) * 120);
		for (unsigned k = 0; k < 3; k++)
			cell[k] = 6 + (uint32_t)(next_number() * 4);
		overlap_cell_box(&grid, 4, cell, cell_min, &size);
		told = overlap_touches(&grid, corners, cell_min, size);
		seen = samples_touch(corners, cell_min, size);
		/* Samples see a touch only where there is one, and nearly always then. */
		assert_true(told || !seen);
		touching += told;
		missed += told && !seen;
	}
	assert_in_range(touching, 300, 2700);
	assert_true(missed * 20 < touching);
}

static void octants_are_the_children_that_are_touched(void **state)
{
	const double low[3] = { -100, -100, -100 };
	const double high[3] = { 100, 100, 100 };

	(void)state;
	for (unsigned exact = 0; exact < 2; exact++) {
		struct grid grid;

		assert_int_equal(grid_choose(&grid, low, high, exact ? 0 : 0.7, false, NULL), 0);
		for (unsigned n = 0; n < 3000; n++) {
			uint32_t cell[3] = { 1, 2, 1 };
			double corners[9];
			double scale = n % 2 ? 30 : 150;
			uint32_t octants;
			double cell_min[3];
			double size;

			for (unsigned k = 0; k < 9; k++)
				corners[k] = rint((next_number() - 0.5) * scale);
			overlap_cell_box(&grid, 2, cell, cell_min, &size);
			if (!overlap_touches(&grid, corners, cell_min, size))
				continue;
			octants = overlap_octants(&grid, corners, 2, cell);
			assert_int_not_equal(octants, 0);
			for (uint32_t octant = 0; octant < 8; octant++) {
				uint32_t child[3];

				for (unsigned k = 0; k < 3; k++)
					child[k] = cell[k] * 2 + (octant >> k & 1);
				overlap_cell_box(&grid, 3, child, cell_min, &size);
				assert_int_equal(octants >> octant & 1,
						 overlap_touches(&grid, corners, cell_min, size));
			}
		}
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(no_point_moves_further_than_the_error),
		cmocka_unit_test(the_default_error_is_a_share_of_the_diagonal),
		cmocka_unit_test(an_error_too_small_for_the_model_is_refused_with_one_that_is_not),
		cmocka_unit_test(an_exact_root_holds_its_box_wherever_it_is),
		cmocka_unit_test(what_has_no_area_is_told_exactly),
		cmocka_unit_test(a_cell_has_what_touches_it_and_nothing_else),
		cmocka_unit_test(octants_are_the_children_that_are_touched),
	};

	return TEST_RUN(tests);
}
