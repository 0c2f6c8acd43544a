/* SPDX-License-Identifier: MIT */
/*
 * Goal: a box that has a sample in front is never said to be hidden, and one behind a wall is; depths
 * of cells and the picture of what gets through say what their headers say.
 * Method: random points of random boxes against the depth image, in double precision.
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
#include "formats/base/random.h"
#include "libclient/select/coverage.h"
#include "libclient/select/hiding.h"
#include "libclient/select/raster.h"
#include "libclient/select/screen_box.h"
#include "tests/helper.h"

static const uint32_t side[2] = { 150, 100 };
static const struct store_superblock plain = { .step_exponent = -10 };
static struct random dice;

static struct camera_view random_view(void)
{
	struct camera camera = { .up = { 0, 0, 1 },
				 .fov_y_degrees = 20.0 + 90.0 * random_unit(&dice) };
	struct camera_view view;

	for (int k = 0; k < 3; k++) {
		camera.eye[k] = 8.0 * random_unit(&dice) - 4.0;
		camera.at[k] = camera.eye[k] + random_unit(&dice) - 0.5;
	}
	assert_int_equal(camera_view_init(&view, &camera, &plain, 1.5, 0.01), 0);
	return view;
}

/*
 * The sample that a point is at, rows from the top, up to a fifth of a pixel beside it.
 *
 * Returns: the point's depth; negative: it is at none.
 */
static double project(const struct camera_view *view, const double point[3], uint32_t ret[2])
{
	double x = 0.0;
	double y = 0.0;
	double w = 0.0;

	for (int k = 0; k < 3; k++) {
		double from_eye = point[k] - view->eye[k];

		x += view->right[k] * from_eye;
		y += view->up[k] * from_eye;
		w += view->forward[k] * from_eye;
	}
	if (w < view->near)
		return -1.0;
	x = (0.5 + 0.5 * x / (w * view->tan_half_x)) * side[0];
	y = (0.5 - 0.5 * y / (w * view->tan_half_y)) * side[1];
	if (x < 0.0 || y < 0.0 || x >= side[0] || y >= side[1])
		return -1.0;
	ret[0] = (uint32_t)x;
	ret[1] = (uint32_t)y;
	if (fmax(fabs(x - ret[0] - 0.5), fabs(y - ret[1] - 0.5)) > 0.2)
		return -1.0;
	return view->near / w;
}

static void draw_random_triangles(struct raster *raster, const struct camera_view *view)
{
	float positions[40][3][3];
	uint32_t indices[120];
	struct raster_draw draw = { .positions = positions[0][0],
				    .vertex_count = 120,
				    .indices = indices,
				    .triangle_count = 40,
				    .scale = 1.0f };

	for (uint32_t i = 0; i < 40; i++)
		for (uint32_t c = 0; c < 3; c++)
			for (uint32_t k = 0; k < 3; k++)
				positions[i][c][k] =
					(float)rint(1024 * (12.0 * random_unit(&dice) - 6.0)) /
					1024.0f;
	for (uint32_t i = 0; i < 120; i++)
		indices[i] = i;
	camera_node_offset(view, (const double[]){ 0, 0, 0 }, draw.offset);
	raster_clear(raster);
	assert_int_equal(raster_triangles(raster, view, &draw), 0);
}

static void random_box(float box_min[3], float box_max[3])
{
	for (int k = 0; k < 3; k++) {
		double middle = 12.0 * random_unit(&dice) - 6.0;
		/* Often flat, sometimes a point. */
		double half = fmax(0.0, 3.0 * random_unit(&dice) * random_unit(&dice) - 0.3);

		box_min[k] = (float)(middle - half);
		box_max[k] = (float)(middle + half);
	}
}

static void a_box_with_a_sample_in_front_is_never_hidden(void **state)
{
	struct raster *raster;
	unsigned shown = 0;
	unsigned hidden = 0;

	(void)state;
	dice.state = 1;
	assert_int_equal(raster_create(side[0], side[1], &raster), 0);
	assert_int_equal(raster_keep_farthest(raster), 0);
	for (int frame = 0; frame < 60; frame++) {
		struct camera_view view = random_view();

		draw_random_triangles(raster, &view);
		for (int i = 0; i < 150; i++) {
			struct screen_box box;
			float box_min[3];
			float box_max[3];
			bool shows;

			random_box(box_min, box_max);
			shows = screen_box_set(&box, &view, side, box_min, box_max) &&
				raster_shows(raster, &box);
			shown += shows;
			hidden += !shows;
			for (int sample = 0; sample < 300; sample++) {
				double point[3];
				uint32_t at[2] = { 0, 0 };
				double depth;

				for (int k = 0; k < 3; k++)
					point[k] = box_min[k] +
						   random_unit(&dice) *
							   ((double)box_max[k] - box_min[k]);
				depth = project(&view, point, at);
				if (depth >= (double)raster_depths(raster)[at[1] * side[0] + at[0]])
					assert_true(shows || depth < 0.0);
			}
		}
	}
	assert_true(shown > 150 && hidden > 150);
	raster_destroy(raster);
}

static void a_box_behind_a_wall_is_hidden_and_one_at_its_depth_shows(void **state)
{
	const struct camera camera = { .at = { 0, 1, 0 }, .up = { 0, 0, 1 }, .fov_y_degrees = 60 };
	const float corners[4][3] = {
		{ -99, 4, -99 }, { 99, 4, -99 }, { 99, 4, 99 }, { -99, 4, 99 }
	};
	const uint32_t indices[6] = { 0, 1, 2, 0, 2, 3 };
	struct raster_draw draw = { .positions = corners[0],
				    .vertex_count = 4,
				    .indices = indices,
				    .triangle_count = 2,
				    .scale = 1.0f };
	struct camera_view view;
	struct screen_box box;
	struct raster *raster;

	(void)state;
	assert_int_equal(camera_view_init(&view, &camera, &plain, 1.5, 0.01), 0);
	assert_int_equal(raster_create(side[0], side[1], &raster), 0);
	assert_int_equal(raster_keep_farthest(raster), 0);
	assert_int_equal(raster_triangles(raster, &view, &draw), 0);
	assert_true(screen_box_set(&box, &view, side, (const float[]){ -1, 4.001f, -1 },
				   (const float[]){ 1, 6, 1 }));
	assert_false(raster_shows(raster, &box));
	/* A leaf whose wall lies in the face of another. */
	assert_true(screen_box_set(&box, &view, side, (const float[]){ -1, 4, -1 },
				   (const float[]){ 1, 4, 1 }));
	assert_true(raster_shows(raster, &box));
	assert_true(screen_box_set(&box, &view, side, (const float[]){ -1, 3, -1 },
				   (const float[]){ 1, 6, 1 }));
	assert_true(raster_shows(raster, &box));
	/* Cleared, everything shows; beside the screen nothing does. */
	raster_clear(raster);
	assert_true(screen_box_set(&box, &view, side, (const float[]){ -9, 900, -9 },
				   (const float[]){ 9, 901, 9 }));
	assert_true(raster_shows(raster, &box));
	assert_false(screen_box_set(&box, &view, side, (const float[]){ 99, 5, 0 },
				    (const float[]){ 100, 6, 1 }));
	raster_destroy(raster);
}

/* ---- what cells hide ---- */

static void a_direction_weighs_the_nearest_axes_and_their_weights_add_up(void **state)
{
	const double g = STORE_GOLDEN_RATIO;
	const double axis[3] = { -1, g, 0 };
	struct hiding_direction direction;

	(void)state;
	dice.state = 2;
	hiding_direction_set(&direction, axis);
	assert_int_equal(direction.axis[0], 3);
	assert_true(fabsf(direction.weight[0] - 1.0f) < 1e-5f);
	for (int i = 0; i < 1000; i++) {
		const double v[3] = { random_unit(&dice) - 0.5, random_unit(&dice) - 0.5,
				      random_unit(&dice) - 0.5 };
		const double opposite[3] = { -v[0], -v[1], -v[2] };
		struct hiding_direction other;
		float sum = 0.0f;

		hiding_direction_set(&direction, v);
		hiding_direction_set(&other, opposite);
		assert_memory_equal(direction.axis, other.axis, sizeof(other.axis));
		for (int k = 0; k < 3; k++)
			sum += direction.weight[k];
		assert_true(fabsf(sum - 1.0f) < 1e-4f);
	}
}

/* A row of cells along x: a root of 8 units, eight leaves of one unit at y = z = 0. */
static void row_of_cells(struct store_superblock *superblock, struct store_node *nodes)
{
	*superblock = (struct store_superblock){ .node_count = 15, .root_size = 8.0 };
	/* Breadth first: 1, 2, 4, 8 nodes; each divides the row in two. */
	for (uint32_t i = 0; i < 15; i++) {
		uint8_t level = (uint8_t)(i >= 7 ? 3 : i >= 3 ? 2 : i >= 1 ? 1 : 0);

		nodes[i] = (struct store_node){ .parent = i == 0 ? STORE_NODE_NONE : (i - 1) / 2,
						.first_child =
							level == 3 ? STORE_NODE_NONE : 2 * i + 1,
						.child_count = level == 3 ? 0 : 2,
						.level = level };
		nodes[i].cell[0] = i + 1 - (1u << level);
		if (level == 3) {
			nodes[i].payload_id = i;
			memset(nodes[i].solidity, 161, sizeof(nodes[i].solidity));
		}
	}
}

static void a_ray_adds_up_the_cells_before_the_one_it_goes_to(void **state)
{
	const double eye[3] = { -1.0, 0.5, 0.5 };
	const double inside[3] = { 1.5, 0.5, 0.5 };
	const double above[3] = { 6.5, 0.5, 5.0 };
	struct store_superblock superblock;
	struct store_node nodes[15];
	struct places places;
	struct hiding hiding;
	uint64_t steps = 0;

	(void)state;
	row_of_cells(&superblock, nodes);
	assert_int_equal(places_init(&places, &superblock, nodes), 0);
	hiding_init(&hiding, &places, nodes, 15);
	/* A solidity of 161 is a depth of nearly 1. */
	assert_true(fabsf(hiding_mean_depth(&hiding, 7) - 1.0f) < 3e-3f);
	for (uint32_t i = 0; i < 8; i++)
		assert_true(fabsf(hiding_along_ray(&hiding, eye, 7 + i, &steps) - (float)i) <
			    0.02f);
	assert_int_equal(steps, 36);
	/* Half of the eye's own cell, then two. */
	assert_true(fabsf(hiding_along_ray(&hiding, inside, 11, &steps) - 2.5f) < 0.02f);
	/* Through air. */
	assert_true(hiding_along_ray(&hiding, above, 13, &steps) < 1e-6f);
	/* Backwards. */
	assert_true(fabsf(hiding_along_ray(&hiding, (const double[]){ 9.0, 0.5, 0.5 }, 12, &steps) -
			  2.0f) < 0.02f);
	places_done(&places);
}

static void a_node_behind_a_wall_shows_little_and_beside_it_all(void **state)
{
	const struct camera camera = {
		.eye = { 4, -20, 4 }, .at = { 4, 0, 4 }, .up = { 0, 0, 1 }, .fov_y_degrees = 40
	};
	const struct bounds wall = { { 2, 0, 4 }, { 2, 0.1f, 4 } };
	const struct bounds hidden = { { 2, 4, 4 }, { 1, 1, 1 } };
	const struct bounds free_one = { { 7, 4, 4 }, { 1, 1, 1 } };
	const struct bounds around = { { 4, -20, 4 }, { 3, 3, 3 } };
	struct store_superblock superblock;
	static struct coverage coverage;
	struct store_node nodes[15];
	struct places places;
	struct hiding hiding;
	struct camera_view view;
	float first;

	(void)state;
	row_of_cells(&superblock, nodes);
	/* As if its cell were the root: as much area as a wall of 8 units squared has. */
	memset(nodes[7].solidity, 255, sizeof(nodes[7].solidity));
	assert_int_equal(places_init(&places, &superblock, nodes), 0);
	nodes[7].level = 0;
	hiding_init(&hiding, &places, nodes, 15);
	assert_int_equal(camera_view_init(&view, &camera, &superblock, 4.0 / 3.0, 0.1), 0);
	coverage_begin(&coverage, &view);
	first = coverage_add(&coverage, &hiding, &hidden, 8);
	assert_true(first > 1.0f);
	coverage_begin(&coverage, &view);
	assert_true(coverage_add(&coverage, &hiding, &wall, 7) > first);
	assert_true(coverage_add(&coverage, &hiding, &hidden, 8) < 0.2f * first);
	assert_true(coverage_add(&coverage, &hiding, &free_one, 9) > 0.8f * first);
	/* The eye in a box is no trouble: its triangles are seen all around. */
	coverage_begin(&coverage, &view);
	assert_true(coverage_add(&coverage, &hiding, &around, 7) >
		    0.3f * COVERAGE_WIDTH * COVERAGE_HEIGHT);
	places_done(&places);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(a_box_with_a_sample_in_front_is_never_hidden),
		cmocka_unit_test(a_box_behind_a_wall_is_hidden_and_one_at_its_depth_shows),
		cmocka_unit_test(a_direction_weighs_the_nearest_axes_and_their_weights_add_up),
		cmocka_unit_test(a_ray_adds_up_the_cells_before_the_one_it_goes_to),
		cmocka_unit_test(a_node_behind_a_wall_shows_little_and_beside_it_all),
	};

	return TEST_RUN(tests);
}
