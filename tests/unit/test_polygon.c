/* SPDX-License-Identifier: MIT */
/* Goal: n corners become n - 2 triangles that cover the polygon once and keep its orientation. */
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
#include "formats/import/polygon.h"
#include "tests/helper.h"

static const double pi = 3.14159265358979323846;

/* Twice the area of a triangle of the plane z = 0, by its corners. */
static double area_of(const struct polygon *polygon, const uint32_t *corners)
{
	const double *a = polygon->positions + 3 * (size_t)corners[0];
	const double *b = polygon->positions + 3 * (size_t)corners[1];
	const double *c = polygon->positions + 3 * (size_t)corners[2];

	return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

static void set_flat(struct polygon *polygon, const double (*corners)[2], uint32_t count)
{
	assert_int_equal(polygon_reserve(polygon, count), 0);
	for (uint32_t i = 0; i < count; i++) {
		polygon->positions[3 * (size_t)i] = corners[i][0];
		polygon->positions[3 * (size_t)i + 1] = corners[i][1];
		polygon->positions[3 * (size_t)i + 2] = 0.0;
	}
}

/*
 * A polygon that is cut well has no triangle that is turned round, and their areas add up to its
 * own.
 */
static void assert_covered(struct polygon *polygon, uint32_t count)
{
	const uint32_t *triangles = polygon_cut(polygon, count);
	double expected = 0.0, sum = 0.0, sum_absolute = 0.0;

	for (uint32_t i = 1; i + 1 < count; i++)
		expected += area_of(polygon, (uint32_t[3]){ 0, i, i + 1 });
	for (uint32_t i = 0; i < count - 2; i++) {
		double area = area_of(polygon, triangles + 3 * (size_t)i);

		for (int k = 0; k < 3; k++)
			assert_true(triangles[3 * (size_t)i + (size_t)k] < count);
		sum += area;
		sum_absolute += fabs(area);
	}
	assert_true(fabs(sum - expected) <= 1e-9 * fabs(expected));
	assert_true(fabs(sum_absolute - fabs(expected)) <= 1e-9 * fabs(expected));
}

static void convex_and_concave_polygons_are_covered_once(void **state)
{
	static const double arrow[][2] = { { 0, 0 }, { 4, 1 }, { 0, 2 }, { 1, 1 } };
	static const double letter[][2] = { { 0, 0 }, { 3, 0 }, { 3, 1 }, { 1, 1 },
					    { 1, 2 }, { 3, 2 }, { 3, 3 }, { 0, 3 } };
	static const double comb[][2] = { { 0, 0 }, { 7, 0 }, { 7, 5 }, { 6, 5 },
					  { 6, 1 }, { 5, 1 }, { 5, 5 }, { 4, 5 },
					  { 4, 1 }, { 3, 1 }, { 3, 5 }, { 2, 5 },
					  { 2, 1 }, { 1, 1 }, { 1, 5 }, { 0, 5 } };
	/* A square with a square hole, cut open along a bridge that is walked twice. */
	static const double hole[][2] = { { 0, 0 }, { 4, 0 }, { 4, 4 }, { 0, 4 }, { 0, 0 },
					  { 1, 1 }, { 1, 3 }, { 3, 3 }, { 3, 1 }, { 1, 1 } };
	/* Corners in the middle of straight edges. */
	static const double straight[][2] = { { 0, 0 }, { 1, 0 }, { 2, 0 }, { 2, 1 },
					      { 2, 2 }, { 1, 2 }, { 0, 2 }, { 0, 1 } };
	static const double repeated[][2] = { { 0, 0 }, { 0, 0 }, { 2, 0 }, { 2, 2 },
					      { 2, 2 }, { 2, 2 }, { 0, 2 } };
	static const struct {
		const double (*corners)[2];
		uint32_t count;
	} cases[] = {
		{ arrow, ARRAY_LENGTH(arrow) },       { letter, ARRAY_LENGTH(letter) },
		{ comb, ARRAY_LENGTH(comb) },         { hole, ARRAY_LENGTH(hole) },
		{ straight, ARRAY_LENGTH(straight) }, { repeated, ARRAY_LENGTH(repeated) },
	};
	struct polygon polygon = { 0 };

	(void)state;
	for (size_t i = 0; i < ARRAY_LENGTH(cases); i++) {
		/* From each corner on, and both ways round. */
		for (uint32_t first = 0; first < cases[i].count; first++) {
			for (int turn = -1; turn <= 1; turn += 2) {
				double corners[16][2];
				uint32_t count = cases[i].count;

				for (uint32_t k = 0; k < count; k++) {
					uint32_t from =
						(uint32_t)((int)(first + count) + turn * (int)k) %
						count;

					memcpy(corners[k], cases[i].corners[from],
					       sizeof(corners[k]));
				}
				set_flat(&polygon, (const double(*)[2])corners, count);
				assert_covered(&polygon, count);
			}
		}
	}
	polygon_done(&polygon);
}

static void a_straight_corner_makes_no_degenerate_triangle(void **state)
{
	static const double straight[][2] = { { 0, 0 }, { 1, 0 }, { 2, 0 }, { 2, 2 }, { 0, 2 } };
	struct polygon polygon = { 0 };
	const uint32_t *triangles;

	(void)state;
	set_flat(&polygon, straight, ARRAY_LENGTH(straight));
	triangles = polygon_cut(&polygon, ARRAY_LENGTH(straight));
	for (size_t i = 0; i < ARRAY_LENGTH(straight) - 2; i++)
		assert_true(area_of(&polygon, triangles + 3 * i) > 0.0);
	polygon_done(&polygon);
}

static void a_star_of_many_corners_is_covered_once(void **state)
{
	struct polygon polygon = { 0 };

	(void)state;
	for (uint32_t count = 8; count <= 1024; count *= 2) {
		assert_int_equal(polygon_reserve(&polygon, count), 0);
		for (uint32_t i = 0; i < count; i++) {
			double radius = i % 2 ? 1.0 : 3.0 + i % 7;
			double angle = 2.0 * pi * i / count;

			polygon.positions[3 * (size_t)i] = radius * cos(angle);
			polygon.positions[3 * (size_t)i + 1] = radius * sin(angle);
			polygon.positions[3 * (size_t)i + 2] = 0.0;
		}
		assert_covered(&polygon, count);
	}
	polygon_done(&polygon);
}

static void polygons_in_any_plane_far_from_the_origin_keep_their_normal(void **state)
{
	static const double arrow[][2] = { { 0, 0 }, { 4, 1 }, { 0, 2 }, { 1, 1 } };
	static const double axes[][2][3] = {
		{ { 1, 0, 0 }, { 0, 1, 0 } },  { { 0, 1, 0 }, { 1, 0, 0 } },
		{ { 0, 1, 0 }, { 0, 0, 1 } },  { { 0, 0, 1 }, { 1, 0, 0 } },
		{ { 1, 1, 0 }, { 0, -1, 1 } }, { { -1, 0, 1 }, { 0, 2, -1 } },
	};
	struct polygon polygon = { 0 };

	(void)state;
	assert_int_equal(polygon_reserve(&polygon, 4), 0);
	for (size_t i = 0; i < ARRAY_LENGTH(axes); i++) {
		const uint32_t *triangles;

		for (size_t corner = 0; corner < 4; corner++)
			for (size_t k = 0; k < 3; k++)
				polygon.positions[3 * corner + k] =
					1e7 + arrow[corner][0] * axes[i][0][k] +
					arrow[corner][1] * axes[i][1][k];
		triangles = polygon_cut(&polygon, 4);
		/* The only way to cut an arrow is from its notch, corner 3, to its tip, corner 1. */
		for (size_t t = 0; t < 2; t++) {
			uint32_t seen = 0;

			for (size_t k = 0; k < 3; k++)
				seen |= 1u << triangles[3 * t + k];
			assert_true((seen & 10u) == 10u);
			for (size_t k = 0; k < 3; k++)
				assert_true((triangles[3 * t + k] + 1) % 4 ==
						    triangles[3 * t + (k + 1) % 3] ||
					    ((1u << triangles[3 * t + k]) & 10u));
		}
	}
	polygon_done(&polygon);
}

static void polygons_without_sense_end_soon_and_give_all_triangles(void **state)
{
	const uint32_t count = POLYGON_CORNERS_MAX;
	struct polygon polygon = { 0 };
	uint64_t seed = 12345;

	(void)state;
	assert_int_equal(polygon_reserve(&polygon, count), 0);
	for (int kind = 0; kind < 4; kind++) {
		const uint32_t *triangles;

		for (size_t i = 0; i < 3 * (size_t)count; i++) {
			seed = seed * UINT64_C(6364136223846793005) + 1;
			/* All the same, on a line, at random, and no numbers. */
			polygon.positions[i] = kind == 0   ? 1.0
					       : kind == 1 ? (double)(i / 3)
					       : kind == 2 ? (double)(seed >> 40)
							   : NAN;
		}
		triangles = polygon_cut(&polygon, count);
		for (size_t i = 0; i < 3 * (size_t)(count - 2); i++)
			assert_true(triangles[i] < count);
	}
	polygon_done(&polygon);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(convex_and_concave_polygons_are_covered_once),
		cmocka_unit_test(a_straight_corner_makes_no_degenerate_triangle),
		cmocka_unit_test(a_star_of_many_corners_is_covered_once),
		cmocka_unit_test(polygons_in_any_plane_far_from_the_origin_keep_their_normal),
		cmocka_unit_test(polygons_without_sense_end_soon_and_give_all_triangles),
	};

	return TEST_RUN(tests);
}
