/* SPDX-License-Identifier: MIT */
/*
 * Goal: where orders are known to fail, they fail within bounds: how many of the covered pixels are
 * wrong at a budget of what shows.
 * Method: scenes in memory, an item picture of everything; a pixel is wrong if its node is not
 * selected.
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
#include "libclient/select/select.h"
#include "tests/helper.h"
#include "tests/helper_scene.h"

#define WIDTH  160u
#define HEIGHT 120u

static const double no_origin[3];
static struct random dice;

struct stage {
	struct scene scene;
	struct selector *selector;
	struct raster *raster;
	uint32_t *pixels; /* a node: those that show it */
	uint64_t covered;
	uint64_t triangles_shown; /* of the nodes that show */
};

static void stage_make(struct stage *stage, struct scene_model *model, uint32_t leaf_triangles)
{
	scene_make(&stage->scene, model, no_origin, leaf_triangles, STORE_LAYOUT_UNIQUE);
	assert_int_equal(
		selector_create(&stage->scene.superblock, stage->scene.nodes, &stage->selector), 0);
	assert_int_equal(raster_create(WIDTH, HEIGHT, &stage->raster), 0);
	stage->pixels = calloc(stage->scene.superblock.node_count, sizeof(*stage->pixels));
	assert_non_null(stage->pixels);
}

static void stage_done(struct stage *stage)
{
	free(stage->pixels);
	raster_destroy(stage->raster);
	selector_destroy(stage->selector);
	scene_done(&stage->scene);
}

static struct camera_view stage_look(struct stage *stage, const struct camera *camera)
{
	struct camera_view view;

	assert_int_equal(camera_view_init(&view, camera, &stage->scene.superblock,
					  (double)WIDTH / HEIGHT, 0.02),
			 0);
	scene_draw(&stage->scene, &view, NULL, stage->raster);
	memset(stage->pixels, 0, stage->scene.superblock.node_count * sizeof(*stage->pixels));
	stage->covered = 0;
	stage->triangles_shown = 0;
	for (size_t i = 0; i < WIDTH * HEIGHT; i++) {
		uint64_t item = raster_items(stage->raster)[i];

		if (item == RASTER_ITEM_NONE)
			continue;
		stage->covered++;
		if (stage->pixels[item]++ == 0)
			stage->triangles_shown += stage->scene.nodes[item].triangle_count;
	}
	return view;
}

/* Share of the covered pixels that a selection has wrong. */
static double wrong_share(struct stage *stage, const struct camera_view *view,
			  enum select_order order, double factor)
{
	struct select_options options = { order, 1 };
	struct selection selection;
	uint64_t right = 0;

	options.budget_triangles += (uint64_t)(factor * (double)stage->triangles_shown);
	select_approximate(stage->selector, view, &options, &selection);
	for (size_t i = 0; i < selection.entry_count; i++)
		right += stage->pixels[selection.entries[i].node];
	return stage->covered > 0 ? (double)(stage->covered - right) / (double)stage->covered : 0.0;
}

/* A grid of rooms with thin walls, a doorway in each, and things in them. */
static void rooms(struct scene_model *model, int count)
{
	for (int x = -count; x < count; x++)
		for (int y = -count; y < count; y++) {
			const double at[3] = { 4.0 * x, 4.0 * y, 0 };

			scene_plate(model, at, (double[]){ 4, 0, 0 }, (double[]){ 0, 4, 0 }, 4, 4);
			scene_plate(model, at, (double[]){ 1.5, 0, 0 }, (double[]){ 0, 0, 3 }, 3,
				    4);
			scene_plate(model, (double[]){ at[0] + 2.5, at[1], 0 },
				    (double[]){ 1.5, 0, 0 }, (double[]){ 0, 0, 3 }, 3, 4);
			scene_plate(model, at, (double[]){ 0, 1.5, 0 }, (double[]){ 0, 0, 3 }, 3,
				    4);
			scene_plate(model, (double[]){ at[0], at[1] + 2.5, 0 },
				    (double[]){ 0, 1.5, 0 }, (double[]){ 0, 0, 3 }, 3, 4);
			scene_plate(model, (double[]){ at[0], at[1], 3 }, (double[]){ 4, 0, 0 },
				    (double[]){ 0, 4, 0 }, 4, 4);
			scene_box(model, (double[]){ at[0] + 1, at[1] + 1, 0 },
				  (double[]){ at[0] + 1.5, at[1] + 1.5, 1 }, 3);
		}
}

static struct camera camera_inside(double reach)
{
	struct camera camera = { .up = { 0, 0, 1 }, .fov_y_degrees = 60 };

	for (int k = 0; k < 2; k++)
		camera.eye[k] = reach * (2.0 * random_unit(&dice) - 1.0);
	camera.eye[2] = 1.6;
	for (int k = 0; k < 3; k++)
		camera.at[k] = camera.eye[k] + (k < 2 ? random_unit(&dice) - 0.5 : 0.0);
	return camera;
}

/* ---- the tests ---- */

static int compare_doubles(const void *left, const void *right)
{
	double a = *(const double *)left;
	double b = *(const double *)right;

	return a < b ? -1 : a > b;
}

static void rooms_from_inside_are_right_at_twice_what_shows(void **state)
{
	struct scene_model model = { 0 };
	struct stage stage;
	double wrong[3][41];
	static const double factors[3] = { 1.0, 2.0, 4.0 };

	(void)state;
	rooms(&model, 4);
	stage_make(&stage, &model, 40);
	dice.state = 1;
	for (int i = 0; i < 41; i++) {
		struct camera camera = camera_inside(14.0);
		struct camera_view view = stage_look(&stage, &camera);

		for (int f = 0; f < 3; f++)
			wrong[f][i] = wrong_share(&stage, &view, SELECT_ORDER_AUTO, factors[f]);
	}
	for (int f = 0; f < 3; f++)
		qsort(wrong[f], 41, sizeof(double), compare_doubles);
	assert_true(wrong[0][20] <= 0.08);
	assert_true(wrong[1][20] <= 0.03);
	assert_true(wrong[2][20] <= 0.01);
	assert_true(wrong[2][40] <= 0.05);
	stage_done(&stage);
}

/* From above, where layers advance through air, and walls hide half. */
static void an_overview_needs_less_by_coverage_than_by_layers(void **state)
{
	const struct camera camera = {
		.eye = { -30, -40, 25 }, .at = { 0, 0, 0 }, .up = { 0, 0, 1 }, .fov_y_degrees = 45
	};
	struct scene_model model = { 0 };
	struct camera_view view;
	struct stage stage;
	double by_layers;
	double by_coverage;

	(void)state;
	rooms(&model, 4);
	stage_make(&stage, &model, 40);
	view = stage_look(&stage, &camera);
	by_layers = wrong_share(&stage, &view, SELECT_ORDER_LAYER, 0.9);
	by_coverage = wrong_share(&stage, &view, SELECT_ORDER_AUTO, 0.9);
	assert_true(by_coverage <= 0.1);
	assert_true(by_coverage < 0.5 * by_layers);
	stage_done(&stage);
}

/* Where all shows through all, no order helps, and none does harm. */
static void a_sparse_soup_is_as_wrong_as_what_is_left_out(void **state)
{
	const struct camera camera = { .eye = { 0, -30, 0 },
				       .up = { 0, 0, 1 },
				       .fov_y_degrees = 45 };
	struct scene_model model = { 0 };
	struct camera_view view;
	struct stage stage;

	(void)state;
	dice.state = 2;
	for (int i = 0; i < 4000; i++) {
		double at[3];

		for (int k = 0; k < 3; k++)
			at[k] = 16.0 * random_unit(&dice) - 8.0;
		scene_triangle(&model, at, (double[]){ at[0] + 0.2, at[1], at[2] },
			       (double[]){ at[0], at[1] + 0.1, at[2] + 0.2 });
	}
	stage_make(&stage, &model, 40);
	view = stage_look(&stage, &camera);
	for (unsigned order = 0; order < SELECT_ORDER_COUNT_; order++)
		assert_true(wrong_share(&stage, &view, (enum select_order)order, 0.5) <= 0.6);
	assert_true(wrong_share(&stage, &view, SELECT_ORDER_AUTO, 1.0) <= 0.05);
	stage_done(&stage);
}

/*
 * Doorways in a row, cells as large as them: a walk goes through what it takes for walls, a ray or the
 * picture of what gets through does not.
 */
static void a_corridor_of_doors_is_seen_to_its_end(void **state)
{
	const struct camera camera = { .eye = { 0, -15.5, 1.6 },
				       .at = { 0, 0, 1.6 },
				       .up = { 0, 0, 1 },
				       .fov_y_degrees = 50 };
	struct scene_model model = { 0 };
	struct camera_view view;
	struct stage stage;

	(void)state;
	for (int i = -15; i <= 15; i++)
		for (int end = -1; end <= 1; end += 2) {
			scene_plate(&model, (double[]){ 0.6 * end, i, 0 },
				    (double[]){ 7.4 * end, 0, 0 }, (double[]){ 0, 0, 3 }, 10, 4);
			scene_box(&model, (double[]){ 3.0 * end - 0.2, i + 0.3, 0 },
				  (double[]){ 3.0 * end + 0.2, i + 0.7, 1 }, 3);
		}
	scene_plate(&model, (double[]){ -8, -16, 0 }, (double[]){ 16, 0, 0 },
		    (double[]){ 0, 32, 0 }, 16, 32);
	scene_plate(&model, (double[]){ -8, 15.9, 0 }, (double[]){ 16, 0, 0 },
		    (double[]){ 0, 0, 3 }, 16, 3);
	stage_make(&stage, &model, 40);
	view = stage_look(&stage, &camera);
	assert_true(wrong_share(&stage, &view, SELECT_ORDER_TRANSMITTANCE, 2.0) <= 0.05);
	assert_true(wrong_share(&stage, &view, SELECT_ORDER_AUTO, 2.0) <= 0.03);
	stage_done(&stage);
}

/* A camera that trembles by 10^-4 rad: what goes in and out of the set a frame. */
static void a_trembling_camera_changes_few_nodes(void **state)
{
	static const enum select_order orders[] = { SELECT_ORDER_LAYER, SELECT_ORDER_TRANSMITTANCE,
						    SELECT_ORDER_AUTO };
	struct scene_model model = { 0 };
	struct stage stage;
	uint32_t *seen; /* a node: the frame that had it */

	(void)state;
	rooms(&model, 4);
	stage_make(&stage, &model, 40);
	seen = calloc(stage.scene.superblock.node_count, sizeof(*seen));
	assert_non_null(seen);
	for (size_t o = 0; o < ARRAY_LENGTH(orders); o++) {
		struct select_options options = { orders[o], 4000 };
		size_t changed = 0;
		size_t total = 0;

		dice.state = 3;
		memset(seen, 0, stage.scene.superblock.node_count * sizeof(*seen));
		for (uint32_t frame = 1; frame <= 50; frame++) {
			struct camera camera = { .eye = { 1, -13, 1.6 },
						 .up = { 0, 0, 1 },
						 .fov_y_degrees = 60 };
			struct selection selection;
			struct camera_view view;

			camera.at[0] = camera.eye[0] + 1e-4 * (random_unit(&dice) - 0.5);
			camera.at[1] = camera.eye[1] + 1.0;
			camera.at[2] = camera.eye[2] + 1e-4 * (random_unit(&dice) - 0.5);
			assert_int_equal(camera_view_init(&view, &camera, &stage.scene.superblock,
							  (double)WIDTH / HEIGHT, 0.02),
					 0);
			select_approximate(stage.selector, &view, &options, &selection);
			for (size_t i = 0; i < selection.entry_count; i++) {
				changed +=
					frame > 1 && seen[selection.entries[i].node] != frame - 1;
				seen[selection.entries[i].node] = frame;
			}
			total += selection.entry_count;
		}
		assert_true(total > 50 * 20);
		/* One node in a hundred. */
		assert_true(changed * 100 <= total);
	}
	free(seen);
	stage_done(&stage);
}

/*
 * Four times the model around the same rooms: a walk with a budget looks at as many nodes as before.
 * (Not by transmittance: its rays are as long as the view is open.)
 */
static void work_grows_with_what_is_chosen_and_not_with_the_model(void **state)
{
	static const enum select_order walks[] = { SELECT_ORDER_LAYER, SELECT_ORDER_SOLIDITY,
						   SELECT_ORDER_EXTINCTION };
	const struct camera camera = { .eye = { 1, 2.7, 1.6 },
				       .at = { 2, 3.7, 1.6 },
				       .up = { 0, 0, 1 },
				       .fov_y_degrees = 60 };
	uint64_t visited[2][ARRAY_LENGTH(walks)];
	uint64_t node_count[2];

	(void)state;
	for (int size = 0; size < 2; size++) {
		struct scene_model model = { 0 };
		struct camera_view view;
		struct stage stage;

		rooms(&model, size == 0 ? 4 : 8);
		stage_make(&stage, &model, 40);
		node_count[size] = stage.scene.superblock.node_count;
		view = stage_look(&stage, &camera);
		for (size_t o = 0; o < ARRAY_LENGTH(walks); o++) {
			const struct select_options options = { walks[o], 1000 };
			struct selection selection;

			select_approximate(stage.selector, &view, &options, &selection);
			assert_true(selection.budget_reached);
			visited[size][o] = selection.nodes_visited;
		}
		stage_done(&stage);
	}
	assert_true(node_count[1] > 3 * node_count[0]);
	for (size_t o = 0; o < ARRAY_LENGTH(walks); o++)
		assert_true(4 * visited[1][o] <= 5 * visited[0][o]);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(rooms_from_inside_are_right_at_twice_what_shows),
		cmocka_unit_test(an_overview_needs_less_by_coverage_than_by_layers),
		cmocka_unit_test(a_sparse_soup_is_as_wrong_as_what_is_left_out),
		cmocka_unit_test(a_corridor_of_doors_is_seen_to_its_end),
		cmocka_unit_test(a_trembling_camera_changes_few_nodes),
		cmocka_unit_test(work_grows_with_what_is_chosen_and_not_with_the_model),
	};

	return TEST_RUN(tests);
}
