/* SPDX-License-Identifier: MIT */
/*
 * Goal: a corner's normal depends on the faces around it and not on their order, number or winding;
 * and triangles in a new order are the same triangles.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "formats/store/payload.h"
#include "tests/helper.h"
#include "tools/build/normals.h"
#include "tools/build/vertex_order.h"

#define PI 3.14159265358979323846

static uint64_t random_state = 1;

static double next_number(void)
{
	random_state = random_state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
	return (double)(random_state >> 11) * 0x1p-53;
}

static struct normal_share share_of(double x, double y, double z, uint16_t weight, uint32_t section)
{
	double length = sqrt(x * x + y * y + z * z);

	return (struct normal_share){
		.normal = { (int16_t)rint(x / length * 32767), (int16_t)rint(y / length * 32767),
			    (int16_t)rint(z / length * 32767) },
		.weight = weight,
		.section = section,
	};
}

static void decode(uint32_t code, float ret[3])
{
	int16_t words[2];

	memcpy(words, &code, sizeof(words));
	payload_decode_oct16(words, ret);
}

static double degrees_between(const float a[3], double x, double y, double z)
{
	double length = sqrt(x * x + y * y + z * z);
	double cosine = ((double)a[0] * x + (double)a[1] * y + (double)a[2] * z) / length;

	return acos(fmin(fmax(cosine, -1), 1)) * 180 / PI;
}

static void weights_are_the_angles_of_the_corners(void **state)
{
	const double right[9] = { 0, 0, 0, 3, 0, 0, 0, 4, 0 };
	struct face_normal face;

	(void)state;
	face_normal_of(right, &face);
	assert_int_equal(face.normal[0], 0);
	assert_int_equal(face.normal[1], 0);
	assert_int_equal(face.normal[2], 32767);
	assert_in_range(face.weights[0], 32767 - 5, 32767 + 5);
	assert_true(fabs(face.weights[1] / 65535.0 * 180 - atan2(4, 3) * 180 / PI) < 0.01);
	for (unsigned n = 0; n < 1000; n++) {
		double corners[9];

		for (unsigned k = 0; k < 9; k++)
			corners[k] = next_number() * (k % 3 == 2 ? 0.01 : 10);
		face_normal_of(corners, &face);
		/* The angles of a triangle. */
		assert_in_range(face.weights[0] + face.weights[1] + face.weights[2], 65535 - 10,
				65535 + 10);
	}
}

static void faces_within_the_crease_are_one_surface_and_others_are_not(void **state)
{
	const struct normal_share shares[] = {
		share_of(0, 0, 1, 100, 7),
		share_of(sin(PI / 6), 0, cos(PI / 6), 100, 7),
		share_of(1, 0, 0, 100, 7),
		share_of(sin(PI / 6), 0, cos(PI / 6), 100, 8),
	};
	uint32_t codes[4];
	float normal[3];

	(void)state;
	assert_int_equal(normals_solve(NORMALS_OCT16, normals_threshold(40), shares, 4, codes), 0);
	/* The first two meet halfway; the third stands alone, and so does the other section. */
	assert_int_equal(codes[0], codes[1]);
	decode(codes[0], normal);
	assert_true(degrees_between(normal, sin(PI / 12), 0, cos(PI / 12)) < 0.01);
	decode(codes[2], normal);
	assert_true(degrees_between(normal, 1, 0, 0) < 0.01);
	decode(codes[3], normal);
	assert_true(degrees_between(normal, sin(PI / 6), 0, cos(PI / 6)) < 0.01);
}

static void a_face_that_is_turned_over_is_no_crease(void **state)
{
	const struct normal_share shares[] = {
		share_of(0, 0, 1, 100, 0),
		share_of(-sin(PI / 6), 0, -cos(PI / 6), 100, 0),
	};
	uint32_t codes[2];
	float normal[3];

	(void)state;
	assert_int_equal(normals_solve(NORMALS_OCT16, normals_threshold(40), shares, 2, codes), 0);
	decode(codes[0], normal);
	assert_true(degrees_between(normal, sin(PI / 12), 0, cos(PI / 12)) < 0.01);
	decode(codes[1], normal);
	assert_true(degrees_between(normal, -sin(PI / 12), 0, -cos(PI / 12)) < 0.01);
}

static void one_that_only_asks_changes_nothing(void **state)
{
	const struct normal_share shares[] = {
		share_of(0, 0, 1, 100, 0),
		share_of(0.3, 0, 1, 50, 0),
		share_of(0.1, 0.1, 1, 0, 0),
	};
	uint32_t without[2];
	uint32_t with[3];

	(void)state;
	assert_int_equal(normals_solve(NORMALS_OCT16, normals_threshold(40), shares, 2, without),
			 0);
	assert_int_equal(normals_solve(NORMALS_OCT16, normals_threshold(40), shares, 3, with), 0);
	assert_int_equal(with[0], without[0]);
	assert_int_equal(with[1], without[1]);
	assert_int_equal(with[2], without[0]);
}

/* The same faces in any order, few or very many, give each face the same normal. */
static void the_order_of_the_faces_does_not_matter(void **state)
{
	static const uint32_t counts[] = { 5, 64, 65, 3000 };

	(void)state;
	for (size_t c = 0; c < ARRAY_LENGTH(counts); c++) {
		uint32_t count = counts[c];
		struct normal_share *shares = malloc(count * sizeof(*shares));
		struct normal_share *shuffled = malloc(count * sizeof(*shuffled));
		uint32_t *places = malloc(count * sizeof(*places));
		uint32_t *codes = malloc(count * sizeof(*codes));
		uint32_t *codes_shuffled = malloc(count * sizeof(*codes_shuffled));

		assert_true(shares && shuffled && places && codes && codes_shuffled);
		for (uint32_t i = 0; i < count; i++) {
			shares[i] = share_of(next_number() - 0.5, next_number() - 0.5,
					     next_number() + 0.1,
					     (uint16_t)(1 + next_number() * 60000), i % 3);
			places[i] = i;
		}
		for (uint32_t i = count - 1; i > 0; i--) {
			uint32_t other = (uint32_t)(next_number() * (i + 1));
			uint32_t swapped = places[i];

			places[i] = places[other];
			places[other] = swapped;
		}
		for (uint32_t i = 0; i < count; i++)
			shuffled[i] = shares[places[i]];
		assert_int_equal(
			normals_solve(NORMALS_OCT16, normals_threshold(30), shares, count, codes),
			0);
		assert_int_equal(normals_solve(NORMALS_OCT16, normals_threshold(30), shuffled,
					       count, codes_shuffled),
				 0);
		for (uint32_t i = 0; i < count; i++)
			assert_int_equal(codes_shuffled[i], codes[places[i]]);
		free(shares);
		free(shuffled);
		free(places);
		free(codes);
		free(codes_shuffled);
	}
}

/* Vertices that are not among the last 16 seen. */
static uint32_t cache_misses(const uint32_t *indices, uint32_t count)
{
	uint32_t cache[16];
	uint32_t misses = 0;

	memset(cache, 0xff, sizeof(cache));
	for (uint32_t i = 0; i < count; i++) {
		bool found = false;

		for (unsigned k = 0; k < 16; k++)
			found = found || cache[k] == indices[i];
		if (!found)
			cache[misses++ % 16] = indices[i];
	}
	return misses;
}

static void a_new_order_has_each_triangle_once_and_fewer_cache_misses(void **state)
{
	enum {
		SIDE = 60,
		TRIANGLES = SIDE * SIDE * 2,
		VERTICES = (SIDE + 1) * (SIDE + 1)
	};
	static uint32_t indices[TRIANGLES * 3];
	static uint32_t ordered[TRIANGLES * 3];
	static uint32_t order[TRIANGLES];
	static bool seen[TRIANGLES];
	uint32_t *scratch = malloc(vertex_order_scratch(TRIANGLES, VERTICES) * sizeof(*scratch));
	uint32_t count = 0;

	(void)state;
	assert_non_null(scratch);
	for (uint32_t y = 0; y < SIDE; y++) {
		for (uint32_t x = 0; x < SIDE; x++) {
			uint32_t corner = y * (SIDE + 1) + x;
			const uint32_t quad[6] = {
				corner,     corner + 1,        corner + SIDE + 1,
				corner + 1, corner + SIDE + 2, corner + SIDE + 1
			};

			memcpy(indices + count, quad, sizeof(quad));
			count += 6;
		}
	}
	vertex_order(indices, TRIANGLES, VERTICES, scratch, order);
	for (uint32_t i = 0; i < TRIANGLES; i++) {
		assert_true(order[i] < TRIANGLES);
		assert_false(seen[order[i]]);
		seen[order[i]] = true;
		memcpy(ordered + (size_t)3 * i, indices + (size_t)3 * order[i], 12);
	}
	/* Rows of 60 squares find one vertex of three again; a good order nearly two. */
	assert_true(cache_misses(indices, TRIANGLES * 3) > TRIANGLES * 9 / 10);
	assert_true(cache_misses(ordered, TRIANGLES * 3) < TRIANGLES * 8 / 10);
	free(scratch);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(weights_are_the_angles_of_the_corners),
		cmocka_unit_test(faces_within_the_crease_are_one_surface_and_others_are_not),
		cmocka_unit_test(a_face_that_is_turned_over_is_no_crease),
		cmocka_unit_test(one_that_only_asks_changes_nothing),
		cmocka_unit_test(the_order_of_the_faces_does_not_matter),
		cmocka_unit_test(a_new_order_has_each_triangle_once_and_fewer_cache_misses),
	};

	return TEST_RUN(tests);
}
