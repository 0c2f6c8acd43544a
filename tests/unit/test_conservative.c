/* SPDX-License-Identifier: MIT */
/*
 * Goal: what conservative.h says shows is what a picture of everything shows, to the last pixel.
 * Method: scenes in memory, the software tester, and pictures of all nodes against those of the nodes
 * that are said to show; a tester that answers from a list, for the order of things.
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
#include "libclient/select/conservative.h"
#include "libclient/select/occlusion.h"
#include "tests/helper.h"
#include "tests/helper_scene.h"

#define WIDTH  96u
#define HEIGHT 64u

static const double no_origin[3];
static uint64_t random_state;

static double random_unit(void)
{
	/* SplitMix64 */
	uint64_t z = random_state += UINT64_C(0x9e3779b97f4a7c15);

	z = (z ^ z >> 30) * UINT64_C(0xbf58476d1ce4e5b9);
	z = (z ^ z >> 27) * UINT64_C(0x94d049bb133111eb);
	return (double)((z ^ z >> 31) >> 11) * 0x1p-53;
}

static struct camera_view view_of(const struct scene *scene, const struct camera *camera,
				  double near)
{
	struct camera_view view;

	assert_int_equal(
		camera_view_init(&view, camera, &scene->superblock, (double)WIDTH / HEIGHT, near),
		0);
	return view;
}

static struct camera random_camera(const struct scene *scene, double reach)
{
	struct camera camera = { .up = { 0, 0, 1 }, .fov_y_degrees = 20.0 + 80.0 * random_unit() };

	for (int k = 0; k < 3; k++) {
		camera.eye[k] = scene->superblock.origin[k] + reach * (2.0 * random_unit() - 1.0);
		camera.at[k] = camera.eye[k] + random_unit() - 0.5;
	}
	return camera;
}

/* ---- a scene with all that a frame needs ---- */

struct stage {
	struct scene scene;
	struct selector *selector;
	struct conservative *conservative;
	struct occlusion *occlusion;
	struct raster *full;
	struct raster *shown;
	bool *is_away; /* a node: its payload is not there */
	bool *marks;
};

static void stage_make(struct stage *stage, struct scene_model *model, const double origin[3],
		       uint32_t leaf_triangles, enum store_layout layout)
{
	memset(stage, 0, sizeof(*stage));
	scene_make(&stage->scene, model, origin, leaf_triangles, layout);
	assert_int_equal(
		selector_create(&stage->scene.superblock, stage->scene.nodes, &stage->selector), 0);
	assert_int_equal(conservative_create(stage->selector, &stage->conservative), 0);
	assert_int_equal(occlusion_create(WIDTH, HEIGHT, &stage->occlusion), 0);
	assert_int_equal(raster_create(WIDTH, HEIGHT, &stage->full), 0);
	assert_int_equal(raster_create(WIDTH, HEIGHT, &stage->shown), 0);
	stage->is_away = calloc(stage->scene.superblock.node_count, sizeof(bool));
	stage->marks = calloc(stage->scene.superblock.node_count, sizeof(bool));
	assert_true(stage->is_away && stage->marks);
}

static void stage_done(struct stage *stage)
{
	free(stage->is_away);
	free(stage->marks);
	raster_destroy(stage->full);
	raster_destroy(stage->shown);
	occlusion_destroy(stage->occlusion);
	conservative_destroy(stage->conservative);
	selector_destroy(stage->selector);
	scene_done(&stage->scene);
}

static const void *stage_payload(void *context, uint32_t node)
{
	const struct stage *stage = context;

	return stage->is_away[node] ? NULL : stage->scene.payloads[node];
}

static struct occlusion_store stage_store(struct stage *stage, const struct camera_view *view)
{
	return (struct occlusion_store){ .occlusion = stage->occlusion,
					 .view = view,
					 .payload_of = stage_payload,
					 .context = stage };
}

static void stage_mark(struct stage *stage, const struct conservative_result *result,
		       enum conservative_state state)
{
	memset(stage->marks, 0, stage->scene.superblock.node_count * sizeof(bool));
	for (size_t i = 0; i < result->entry_count; i++)
		if (result->entries[i].state == state)
			stage->marks[result->entries[i].node] = true;
}

/* Works a frame out and compares pictures.  Returns: the result. */
static struct conservative_result stage_frame(struct stage *stage, const struct camera_view *view)
{
	struct occlusion_store store = stage_store(stage, view);
	struct conservative_tester tester = occlusion_tester(&store);
	struct conservative_result result;

	/* However little there is. */
	tester.overhead_triangles = 0;
	occlusion_clear(stage->occlusion);
	assert_int_equal(conservative_begin(stage->conservative, view, NULL, &tester, &result), 0);
	assert_true(result.is_complete);
	stage_mark(stage, &result, CONSERVATIVE_SHOWS);
	scene_draw(&stage->scene, view, NULL, stage->full);
	scene_draw(&stage->scene, view, stage->marks, stage->shown);
	assert_memory_equal(raster_depths(stage->full), raster_depths(stage->shown),
			    WIDTH * HEIGHT * sizeof(float));
	/* A triangle that is in several nodes is seen as any one of them. */
	if (stage->scene.superblock.layout == STORE_LAYOUT_UNIQUE)
		assert_memory_equal(raster_items(stage->full), raster_items(stage->shown),
				    WIDTH * HEIGHT * sizeof(uint64_t));
	return result;
}

/* How many nodes a picture shows. */
static size_t nodes_in_picture(struct stage *stage)
{
	size_t count = 0;

	memset(stage->marks, 0, stage->scene.superblock.node_count * sizeof(bool));
	for (size_t i = 0; i < WIDTH * HEIGHT; i++) {
		uint64_t item = raster_items(stage->full)[i];

		if (item == RASTER_ITEM_NONE || stage->marks[item])
			continue;
		stage->marks[item] = true;
		count++;
	}
	return count;
}

/* Rooms of 8 x 8 x 4 units, their walls with a doorway, and boxes in them. */
static void rooms(struct scene_model *model)
{
	for (int x = -2; x < 2; x++)
		for (int y = -2; y < 2; y++) {
			const double floor[3] = { 8.0 * x, 8.0 * y, 0 };
			const double box_min[3] = { 8.0 * x + 2, 8.0 * y + 3, 0 };
			const double box_max[3] = { 8.0 * x + 4, 8.0 * y + 4, 2 };

			scene_plate(model, floor, (double[]){ 8, 0, 0 }, (double[]){ 0, 8, 0 }, 6,
				    6);
			scene_plate(model, floor, (double[]){ 3, 0, 0 }, (double[]){ 0, 0, 4 }, 4,
				    4);
			scene_plate(model, (double[]){ 8.0 * x + 4, 8.0 * y, 0 },
				    (double[]){ 4, 0, 0 }, (double[]){ 0, 0, 4 }, 4, 4);
			scene_plate(model, floor, (double[]){ 0, 8, 0 }, (double[]){ 0, 0, 4 }, 8,
				    4);
			scene_box(model, box_min, box_max, 4);
		}
}

/* ---- the tests ---- */

static void what_is_said_to_show_makes_the_same_picture(void **state)
{
	(void)state;
	for (int layout = STORE_LAYOUT_UNIQUE; layout <= STORE_LAYOUT_REPLICATE; layout++) {
		struct scene_model model = { 0 };
		struct stage stage;

		rooms(&model);
		random_state = 1;
		stage_make(&stage, &model, no_origin, 40, (enum store_layout)layout);
		for (int i = 0; i < 150; i++) {
			struct camera camera = random_camera(&stage.scene, i % 2 ? 15.0 : 40.0);
			struct camera_view view;
			struct conservative_result result;

			if (i % 2)
				camera.eye[2] = 1.0 + 2.0 * random_unit();
			view = view_of(&stage.scene, &camera, 0.05);
			result = stage_frame(&stage, &view);
			/* Whoever was drawn and does not show is told apart. */
			if (!result.is_untested && layout == STORE_LAYOUT_UNIQUE)
				assert_int_equal(result.shown_count, nodes_in_picture(&stage));
		}
		stage_done(&stage);
	}
}

static void what_is_not_there_is_said_to_be_missing_until_it_comes(void **state)
{
	struct scene_model model = { 0 };
	struct stage stage;

	(void)state;
	rooms(&model);
	random_state = 2;
	stage_make(&stage, &model, no_origin, 40, STORE_LAYOUT_UNIQUE);
	for (int i = 0; i < 40; i++) {
		struct camera camera = random_camera(&stage.scene, 12.0);
		struct camera_view view = view_of(&stage.scene, &camera, 0.05);
		struct occlusion_store store = stage_store(&stage, &view);
		struct conservative_tester tester = occlusion_tester(&store);
		struct conservative_result result;
		size_t missing_count;

		tester.overhead_triangles = 0;

		for (uint32_t n = 0; n < stage.scene.superblock.node_count; n++)
			stage.is_away[n] = random_unit() < 0.3;
		conservative_forget(stage.conservative);
		occlusion_clear(stage.occlusion);
		assert_int_equal(
			conservative_begin(stage.conservative, &view, NULL, &tester, &result), 0);
		assert_int_equal(result.is_complete, result.missing_count == 0);
		for (size_t k = 0; k < result.entry_count; k++)
			if (stage.is_away[result.entries[k].node])
				assert_int_equal(result.entries[k].state, CONSERVATIVE_MISSING);
		missing_count = result.missing_count;
		/* Half of it comes, then all. */
		for (uint32_t n = 0; n < stage.scene.superblock.node_count; n += 2)
			stage.is_away[n] = false;
		assert_int_equal(conservative_resume(stage.conservative, &tester, &result), 0);
		assert_true(result.missing_count <= missing_count);
		memset(stage.is_away, 0, stage.scene.superblock.node_count * sizeof(bool));
		assert_int_equal(conservative_resume(stage.conservative, &tester, &result), 0);
		assert_true(result.is_complete);
		stage_mark(&stage, &result, CONSERVATIVE_SHOWS);
		scene_draw(&stage.scene, &view, NULL, stage.full);
		scene_draw(&stage.scene, &view, stage.marks, stage.shown);
		assert_memory_equal(raster_items(stage.full), raster_items(stage.shown),
				    WIDTH * HEIGHT * sizeof(uint64_t));
	}
	stage_done(&stage);
}

static void an_empty_model_shows_nothing(void **state)
{
	struct scene_model model = { 0 };
	struct camera camera = { .at = { 0, 1, 0 }, .up = { 0, 0, 1 }, .fov_y_degrees = 60 };
	struct stage stage;
	struct camera_view view;
	struct conservative_result result;

	(void)state;
	stage_make(&stage, &model, no_origin, 40, STORE_LAYOUT_UNIQUE);
	view = view_of(&stage.scene, &camera, 0.05);
	result = stage_frame(&stage, &view);
	assert_int_equal(result.entry_count, 0);
	assert_true(result.is_complete);
	stage_done(&stage);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(what_is_said_to_show_makes_the_same_picture),
		cmocka_unit_test(what_is_not_there_is_said_to_be_missing_until_it_comes),
		cmocka_unit_test(an_empty_model_shows_nothing),
	};

	return TEST_RUN(tests);
}
