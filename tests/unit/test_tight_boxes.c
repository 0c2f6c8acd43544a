/* SPDX-License-Identifier: MIT */
/*
 * Goal: tight boxes leave no part of a triangle out, and are tighter than the whole.
 * Method: a payload of random triangles, and points all over each of them.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "formats/base/random.h"
#include "formats/store/payload.h"
#include "libclient/select/tight_boxes.h"
#include "tests/helper.h"

#define TRIANGLE_COUNT 60u
#define VERTEX_COUNT   (3u * TRIANGLE_COUNT)
#define STEP           0x1p-6

static uint16_t positions[VERTEX_COUNT][4];
static uint32_t indices[VERTEX_COUNT];
static const double origin[3] = { -100.25, 7.5, 1e4 };

/* The positions as a payload. */
static void *make_payload(void)
{
	const struct payload_run run = { .colour = UINT32_MAX };
	const struct payload_content content = {
		.payload_id = 1,
		.kind = STORE_KIND_TRIANGLES,
		.vertex_count = VERTEX_COUNT,
		.triangle_count = TRIANGLE_COUNT,
		.run_count = 1,
		.position_format = PAYLOAD_U16X3_RUN,
		.origin = { origin[0], origin[1], origin[2] },
		.scale = STEP,
		.runs = &run,
		.indices = indices,
		.positions = positions,
	};
	uint32_t bytes;
	void *payload;

	for (uint32_t v = 0; v < VERTEX_COUNT; v++)
		indices[v] = v;
	assert_int_equal(payload_size(&content, &bytes), 0);
	payload = aligned_alloc(16, bytes);
	assert_non_null(payload);
	payload_write(&content, payload);
	return payload;
}

/* Triangles near the faces of a box, as of a room: its middle is air, but for a few. */
static void make_room(uint64_t seed)
{
	struct random random = { seed };

	for (uint32_t v = 0; v < VERTEX_COUNT; v++) {
		uint32_t triangle = v / 3;

		for (uint32_t k = 0; k < 3; k++)
			positions[v][k] = (uint16_t)random_below(&random, 4000);
		if (triangle % 10 != 0)
			positions[v][triangle % 3] =
				(uint16_t)(triangle % 2 * 3900 + random_below(&random, 100));
	}
}

static struct conservative_box whole_box(uint32_t node)
{
	struct conservative_box box = { .node = node };

	for (int k = 0; k < 3; k++) {
		box.box_min[k] = (float)origin[k];
		box.box_max[k] = (float)(origin[k] + STEP * 4000);
	}
	return box;
}

static bool is_in_one(const struct conservative_box *boxes, uint32_t count, const double point[3])
{
	for (uint32_t i = 0; i < count; i++) {
		bool is_in = true;

		for (int k = 0; k < 3; k++)
			is_in = is_in && point[k] >= boxes[i].box_min[k] &&
				point[k] <= boxes[i].box_max[k];
		if (is_in)
			return true;
	}
	return false;
}

static void check_triangle(const struct conservative_box *boxes, uint32_t count, uint32_t triangle)
{
	for (uint32_t i = 0; i <= 8; i++) {
		for (uint32_t j = 0; j <= 8 - i; j++) {
			double point[3];

			for (int k = 0; k < 3; k++)
				point[k] = origin[k] +
					   STEP *
						   (i * positions[3 * triangle][k] +
						    j * positions[3 * triangle + 1][k] +
						    (8 - i - j) * positions[3 * triangle + 2][k]) /
						   8.0;
			assert_true(is_in_one(boxes, count, point));
		}
	}
}

static void every_point_of_every_triangle_is_in_a_box(void **state)
{
	const struct conservative_box whole = whole_box(2);

	(void)state;
	for (uint64_t seed = 1; seed <= 20; seed++) {
		const struct conservative_box *boxes;
		struct tight_boxes *tight;
		void *payload;
		uint32_t count;

		make_room(seed);
		payload = make_payload();
		assert_int_equal(tight_boxes_create(3, &tight), 0);
		assert_int_equal(tight_boxes_find(tight, 2, &boxes), 0);
		assert_int_equal(tight_boxes_find(tight, 1, &boxes), 0);
		for (uint32_t side = TIGHT_BOXES_SIDE_MIN; side <= TIGHT_BOXES_SIDE_MAX;
		     side *= 2) {
			assert_int_equal(tight_boxes_learn(tight, &whole, payload), 0);
			count = tight_boxes_find(tight, 2, &boxes);
			assert_in_range(count, 1, side * side);
			for (uint32_t triangle = 0; triangle < TRIANGLE_COUNT; triangle++)
				check_triangle(boxes, count, triangle);
			tight_boxes_were_wrong(tight, 2);
		}
		tight_boxes_destroy(tight);
		free(payload);
	}
}

/* A pole in a corner of a large box leaves the rest of it alone. */
static void a_node_that_is_mostly_air_has_small_boxes(void **state)
{
	const struct conservative_box whole = whole_box(0);
	const struct conservative_box *boxes;
	struct tight_boxes *tight;
	void *payload;

	(void)state;
	for (uint32_t v = 0; v < VERTEX_COUNT; v++) {
		positions[v][0] = (uint16_t)(v % 50);
		positions[v][1] = (uint16_t)(v % 70);
		positions[v][2] = (uint16_t)(v * 22 % 4000);
	}
	payload = make_payload();
	assert_int_equal(tight_boxes_create(1, &tight), 0);
	assert_int_equal(tight_boxes_learn(tight, &whole, payload), 0);
	assert_in_range(tight_boxes_find(tight, 0, &boxes), 1, TIGHT_BOXES_SIDE_MIN);
	assert_true(boxes[0].box_max[0] - boxes[0].box_min[0] < 2.0f);
	tight_boxes_destroy(tight);
	free(payload);
}

/* What the tester below is asked, and what it answers. */
struct answers {
	const void *payload;
	bool shows;
	size_t tested_count;
};

static int answer(void *context, const struct conservative_box *boxes, size_t box_count,
		  bool *ret_shows)
{
	struct answers *answers = context;

	(void)boxes;
	answers->tested_count += box_count;
	for (size_t i = 0; i < box_count; i++)
		ret_shows[i] = answers->shows;
	return 0;
}

static const void *payload_there(void *context, uint32_t node)
{
	const struct answers *answers = context;

	(void)node;
	return answers->payload;
}

/* Boxes are halved only after they were wrong, and not for ever; what is hidden costs no test. */
static void only_a_node_that_deceived_is_known_better(void **state)
{
	const struct conservative_box whole = whole_box(0);
	struct answers answers = { .shows = true };
	const struct conservative_tester tester = { .test = answer,
						    .payload = payload_there,
						    .context = &answers };
	const size_t counts_most[] = { 16, 16, 64, 256, 256 };
	struct tight_boxes *tight;
	size_t count_was = 0;
	size_t count;
	bool shows = true;
	void *payload;

	(void)state;
	make_room(1);
	payload = make_payload();
	assert_int_equal(tight_boxes_create(1, &tight), 0);
	/* Nothing is known, and the payload is not there. */
	assert_int_equal(tight_boxes_test(tight, &tester, &whole, 1, &shows, &count), 0);
	assert_true(shows && count == 0);
	answers.payload = payload;
	for (int i = 0; i < 5; i++) {
		assert_int_equal(tight_boxes_test(tight, &tester, &whole, 1, &shows, &count), 0);
		assert_true(shows);
		assert_in_range(count, 1, counts_most[i]);
		assert_true(i == 0 || (counts_most[i] == counts_most[i - 1] ? count == count_was
									    : count > count_was));
		count_was = count;
		if (i > 0)
			tight_boxes_were_wrong(tight, 0);
	}
	answers.shows = false;
	assert_int_equal(tight_boxes_test(tight, &tester, &whole, 1, &shows, &count), 0);
	assert_false(shows);
	answers.tested_count = 0;
	assert_int_equal(tight_boxes_test(tight, &tester, &whole, 1, &shows, &count), 0);
	assert_int_equal(answers.tested_count, 0);
	tight_boxes_destroy(tight);
	free(payload);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(every_point_of_every_triangle_is_in_a_box),
		cmocka_unit_test(a_node_that_is_mostly_air_has_small_boxes),
		cmocka_unit_test(only_a_node_that_deceived_is_known_better),
	};

	return TEST_RUN(tests);
}
