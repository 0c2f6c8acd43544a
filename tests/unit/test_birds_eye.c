/* SPDX-License-Identifier: MIT */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <string.h>

#include "libclient/select/birds_eye.h"
#include "tests/helper.h"

#define SIDE 100u

/* Two leaves side by side on the ground, and a third above the first. */
static struct store_superblock superblock = { .node_count = 4,
					      .origin = { 1000.0, 0.0, 0.0 },
					      .box_max = { 2.0, 1.0, 2.0 } };
static struct store_node records[4] = {
	{ .payload_id = 0 },
	{ .payload_id = 1, .level = 1, .box_max = { 1.0f, 1.0f, 1.0f } },
	{ .payload_id = 2,
	  .level = 1,
	  .box_min = { 1.0f, 0.0f, 0.0f },
	  .box_max = { 2.0f, 1.0f, 1.0f } },
	{ .payload_id = 3,
	  .level = 8,
	  .box_min = { 0.0f, 0.0f, 1.0f },
	  .box_max = { 1.0f, 1.0f, 2.0f } },
};
static struct birds_eye_node nodes[4];
static uint8_t rgb[SIDE * SIDE * 3];

static struct birds_eye scene(void)
{
	memset(nodes, 0, sizeof(nodes));
	nodes[1].state = BIRDS_EYE_HELD;
	nodes[2].state = BIRDS_EYE_READY;
	nodes[3].state = BIRDS_EYE_ABSENT;
	return (struct birds_eye){
		.superblock = &superblock, .records = records, .nodes = nodes, .aspect = 1.0
	};
}

static void paint(const struct birds_eye *birds_eye)
{
	uint32_t scratch[4];

	birds_eye_paint(birds_eye, SIDE, SIDE, scratch, rgb);
}

static void assert_state_at(uint32_t x, uint32_t y, enum birds_eye_state state)
{
	uint8_t colour[3];

	birds_eye_state_colour(state, colour);
	assert_memory_equal(&rgb[3 * (y * SIDE + x)], colour, 3);
}

static void birds_eye_shows_what_lies_on_top(void **state)
{
	const struct birds_eye birds_eye = scene();

	(void)state;
	paint(&birds_eye);
	assert_state_at(25, 50, BIRDS_EYE_ABSENT);
	assert_state_at(75, 50, BIRDS_EYE_READY);
	assert_state_at(50, 5, BIRDS_EYE_NOTHING);
}

static void birds_eye_takes_the_roof_off_for_a_camera_inside(void **state)
{
	struct camera camera = { .eye = { 1001.5, 0.5, 0.5 },
				 .at = { 1002.5, 0.5, 0.5 },
				 .up = { 0.0, 0.0, 1.0 },
				 .fov_y_degrees = 60.0 };
	struct birds_eye birds_eye = scene();
	uint8_t colour[3];

	(void)state;
	birds_eye.camera = &camera;
	paint(&birds_eye);
	assert_state_at(25, 50, BIRDS_EYE_HELD);
	/* The eye is painted over its cell. */
	birds_eye_state_colour(BIRDS_EYE_READY, colour);
	assert_memory_not_equal(&rgb[3 * (50 * SIDE + 73)], colour, 3);
	/* From above the roof stays on. */
	camera.eye[2] = 10.0;
	paint(&birds_eye);
	assert_state_at(25, 50, BIRDS_EYE_ABSENT);
}

static void birds_eye_borders_what_is_wanted_and_what_is_expected(void **state)
{
	struct birds_eye birds_eye = scene();
	static const uint8_t white[3] = { 255, 255, 255 };
	uint8_t expected[3];

	(void)state;
	nodes[2].is_wanted = true;
	paint(&birds_eye);
	assert_memory_equal(&rgb[3 * (50 * SIDE + 96)], white, 3);
	assert_state_at(75, 50, BIRDS_EYE_READY);
	nodes[2].is_wanted = false;
	nodes[2].is_expected = true;
	paint(&birds_eye);
	memcpy(expected, &rgb[3 * (50 * SIDE + 96)], 3);
	assert_memory_not_equal(expected, white, 3);
	birds_eye_state_colour(BIRDS_EYE_READY, rgb);
	assert_memory_not_equal(expected, rgb, 3);
}

static void birds_eye_colours_by_priority_and_by_level(void **state)
{
	struct birds_eye birds_eye = scene();
	uint8_t first[3];

	(void)state;
	nodes[3].is_wanted = true;
	nodes[2].is_wanted = true;
	nodes[2].set_place = 1;
	birds_eye.want_count = 2;
	birds_eye.colouring = BIRDS_EYE_BY_PRIORITY;
	paint(&birds_eye);
	memcpy(first, &rgb[3 * (50 * SIDE + 25)], 3);
	/* Red is first, blue is last. */
	assert_true(first[0] > first[2]);
	assert_true(rgb[3 * (50 * SIDE + 75)] < rgb[3 * (50 * SIDE + 75) + 2]);
	birds_eye.colouring = BIRDS_EYE_BY_LEVEL;
	paint(&birds_eye);
	assert_memory_not_equal(&rgb[3 * (50 * SIDE + 25)], &rgb[3 * (50 * SIDE + 75)], 3);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(birds_eye_shows_what_lies_on_top),
		cmocka_unit_test(birds_eye_takes_the_roof_off_for_a_camera_inside),
		cmocka_unit_test(birds_eye_borders_what_is_wanted_and_what_is_expected),
		cmocka_unit_test(birds_eye_colours_by_priority_and_by_level),
	};

	return TEST_RUN(tests);
}
