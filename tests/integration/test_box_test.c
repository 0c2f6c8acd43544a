/* SPDX-License-Identifier: MIT */
/*
 * Goal: boxes are told apart, however many there are; OpenGL and the software rasteriser agree.
 * Method: a depth buffer that is near in its left half, and rows of small boxes behind and before it.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <epoxy/gl.h>

#include "formats/base/bytes.h"
#include "viewer/box_test.h"
#include "viewer/raster_check.h"
#include "viewer/surface.h"
#include "viewer/target.h"

#define WIDTH     640u
#define HEIGHT    480u
#define BOX_COUNT 70000u /* more than 16 bits tell apart */

/* GL drivers leak, and are gone when LeakSanitizer looks, so that it cannot name them. */
int __lsan_is_turned_off(void);
int __lsan_is_turned_off(void)
{
	return 1;
}

static struct surface *surface;
static struct target target;
static struct box_test *boxes_test;
static struct camera_view view;
static struct conservative_box boxes[BOX_COUNT];
static bool shows[BOX_COUNT];
static bool expected[BOX_COUNT];

static int gl_setup(void **state)
{
	const struct store_superblock superblock = { .step_exponent = -10 };
	/* Looks along +y. */
	const struct camera camera = { .eye = { 0.0, 0.0, 0.0 },
				       .at = { 0.0, 1.0, 0.0 },
				       .up = { 0.0, 0.0, 1.0 },
				       .fov_y_degrees = 90.0 };
	struct why why = { "" };

	(void)state;
	assert_int_equal(surface_open_headless(&surface, &why), 0);
	assert_int_equal(target_init(&target, WIDTH, HEIGHT, CHANNEL_COLOUR, &why), 0);
	assert_int_equal(box_test_create(&boxes_test, &why), 0);
	assert_int_equal(camera_view_init(&view, &camera, &superblock, (double)WIDTH / HEIGHT, 0.1),
			 0);
	return 0;
}

static int gl_teardown(void **state)
{
	(void)state;
	box_test_destroy(boxes_test);
	target_done(&target);
	surface_close(surface);
	return 0;
}

/* The left half of the picture has a wall at a distance, the right half has nothing. */
static void draw_wall(double distance)
{
	const uint8_t background[3] = { 0, 0, 0 };
	const GLfloat depth = (GLfloat)(0.1 / distance);

	target_begin(&target, background);
	glEnable(GL_SCISSOR_TEST);
	glScissor(0, 0, WIDTH / 2, HEIGHT);
	glClearBufferfv(GL_DEPTH, 0, &depth);
	glDisable(GL_SCISSOR_TEST);
}

/* Small boxes at a distance: left and right in turn, some before the wall and some behind it. */
static void make_boxes(void)
{
	for (uint32_t i = 0; i < BOX_COUNT; i++) {
		double side = i % 2 == 0 ? -1.0 : 1.0;
		bool is_behind = i % 3 == 0;
		double distance = is_behind ? 20.0 : 5.0;
		double across = side * (0.1 + 0.8 * (double)(i % 317) / 317.0) * distance;
		double up = (-0.9 + 1.8 * (double)(i % 229) / 229.0) * distance;
		/* A pixel is 1/240 of the distance. */
		double half = distance / 100.0;

		boxes[i] = (struct conservative_box){
			.node = i,
			.box_min = { (float)(across - half), (float)(distance - half),
				     (float)(up - half) },
			.box_max = { (float)(across + half), (float)(distance + half),
				     (float)(up + half) },
		};
		expected[i] = side > 0.0 || !is_behind;
	}
}

static struct box_test_view test_view(void)
{
	return (struct box_test_view){ &view, &render_tile_whole, WIDTH, HEIGHT };
}

static void check(size_t count)
{
	for (size_t i = 0; i < count; i++) {
		if (shows[i] != expected[i])
			fail_msg("box %zu is said to %s", i, shows[i] ? "show" : "be hidden");
	}
}

static void seventy_thousand_boxes_flag_themselves(void **state)
{
	const struct box_test_view against = test_view();

	(void)state;
	make_boxes();
	draw_wall(10.0);
	assert_int_equal(box_test_flags(boxes_test, &against, boxes, BOX_COUNT, shows), 0);
	check(BOX_COUNT);
}

static void queries_say_the_same(void **state)
{
	const struct box_test_view against = test_view();

	(void)state;
	make_boxes();
	draw_wall(10.0);
	assert_int_equal(box_test_queries(boxes_test, &against, boxes, 3000, 0, shows), 0);
	check(3000);
}

/* A surface that lies in the side of its box is as near as the box. */
static void a_box_at_the_depth_of_a_surface_shows(void **state)
{
	const struct box_test_view against = test_view();

	(void)state;
	boxes[0] = (struct conservative_box){ .box_min = { -3.0f, 10.0f, -1.0f },
					      .box_max = { -1.0f, 12.0f, 1.0f } };
	boxes[1] = (struct conservative_box){ .box_min = { -3.0f, 10.5f, -1.0f },
					      .box_max = { -1.0f, 12.0f, 1.0f } };
	expected[0] = true;
	expected[1] = false;
	draw_wall(10.0);
	assert_int_equal(box_test_flags(boxes_test, &against, boxes, 2, shows), 0);
	check(2);
	assert_int_equal(box_test_queries(boxes_test, &against, boxes, 2, 0, shows), 0);
	check(2);
}

/* Boxes through the near plane and behind the eye are tested by what of them is in view. */
static void a_box_that_reaches_behind_the_eye_shows_where_it_is_in_view(void **state)
{
	const struct box_test_view against = test_view();
	const struct conservative_box cases[] = {
		/* Beside the eye on the left, as long as the wall is far; on the right; around it. */
		{ .box_min = { -30.0f, -5.0f, -1.0f }, .box_max = { -20.0f, 25.0f, 1.0f } },
		{ .box_min = { 20.0f, -5.0f, -1.0f }, .box_max = { 30.0f, 25.0f, 1.0f } },
		{ .box_min = { -1.0f, -1.0f, -1.0f }, .box_max = { 1.0f, 1.0f, 1.0f } },
		/* On the left, before the wall; beside the frustum; behind the eye. */
		{ .box_min = { -3.0f, 0.05f, -1.0f }, .box_max = { -1.0f, 12.0f, 1.0f } },
		{ .box_min = { -30.0f, -5.0f, -1.0f }, .box_max = { -20.0f, 2.0f, 1.0f } },
		{ .box_min = { -3.0f, -9.0f, -1.0f }, .box_max = { 3.0f, -1.0f, 1.0f } },
	};
	const bool answers[] = { false, true, true, true, false, false };

	(void)state;
	memcpy(boxes, cases, sizeof(cases));
	memcpy(expected, answers, sizeof(answers));
	draw_wall(10.0);
	assert_int_equal(box_test_flags(boxes_test, &against, boxes, ARRAY_LENGTH(cases), shows),
			 0);
	check(ARRAY_LENGTH(cases));
	assert_int_equal(
		box_test_queries(boxes_test, &against, boxes, ARRAY_LENGTH(cases), 0, shows), 0);
	check(ARRAY_LENGTH(cases));
}

/* Thinner than a pixel, and between the samples: it may hide nothing, and is not to be hidden. */
static void a_box_thinner_than_a_pixel_is_seen_where_it_may_have_a_sample(void **state)
{
	const struct box_test_view against = test_view();

	(void)state;
	for (uint32_t i = 0; i < 400; i++) {
		float x = 1.0f + 0.0005f * (float)i;

		boxes[i] = (struct conservative_box){ .box_min = { x, 10.0f, -4.0f },
						      .box_max = { x + 0.025f, 10.1f, 4.0f } };
		expected[i] = true;
	}
	draw_wall(5.0);
	assert_int_equal(box_test_flags(boxes_test, &against, boxes, 400, shows), 0);
	check(400);
}

static void the_rasterisers_agree(void **state)
{
	struct renderer *renderer;
	struct why why = { "" };
	uint32_t wrong = 0;

	(void)state;
	assert_int_equal(renderer_create(&renderer, &why), 0);
	assert_int_equal(raster_check(renderer, &wrong, &why), 0);
	renderer_destroy(renderer);
	print_message("%u pixels differ on %s\n", wrong, surface_renderer(surface));
	if (strstr(surface_renderer(surface), "llvmpipe"))
		assert_int_equal(wrong, 0);
}

int main(void)
{
	static const struct CMUnitTest tests[] = {
		cmocka_unit_test(seventy_thousand_boxes_flag_themselves),
		cmocka_unit_test(queries_say_the_same),
		cmocka_unit_test(a_box_at_the_depth_of_a_surface_shows),
		cmocka_unit_test(a_box_that_reaches_behind_the_eye_shows_where_it_is_in_view),
		cmocka_unit_test(a_box_thinner_than_a_pixel_is_seen_where_it_may_have_a_sample),
		cmocka_unit_test(the_rasterisers_agree),
	};

	return cmocka_run_group_tests_name("box_test", tests, gl_setup, gl_teardown);
}
