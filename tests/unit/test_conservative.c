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
#include "formats/base/random.h"
#include "libclient/select/conservative.h"
#include "libclient/select/occlusion.h"
#include "tests/helper.h"
#include "tests/helper_scene.h"

#define WIDTH  96u
#define HEIGHT 64u

static const double no_origin[3];
static struct random dice;

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
	struct camera camera = { .up = { 0, 0, 1 },
				 .fov_y_degrees = 20.0 + 80.0 * random_unit(&dice) };

	for (int k = 0; k < 3; k++) {
		camera.eye[k] =
			scene->superblock.origin[k] + reach * (2.0 * random_unit(&dice) - 1.0);
		camera.at[k] = camera.eye[k] + random_unit(&dice) - 0.5;
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
		dice.state = 1;
		stage_make(&stage, &model, no_origin, 40, (enum store_layout)layout);
		for (int i = 0; i < 150; i++) {
			struct camera camera = random_camera(&stage.scene, i % 2 ? 15.0 : 40.0);
			struct camera_view view;
			struct conservative_result result;

			if (i % 2)
				camera.eye[2] = 1.0 + 2.0 * random_unit(&dice);
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
	dice.state = 2;
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
			stage.is_away[n] = random_unit(&dice) < 0.3;
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

/* ---- where it fails ---- */

/* Looks at a model from many places, some of them in it, in both layouts. */
static void look_around(void (*make)(struct scene_model *model), uint32_t leaf_triangles,
			double reach)
{
	for (int layout = STORE_LAYOUT_UNIQUE; layout <= STORE_LAYOUT_REPLICATE; layout++) {
		struct scene_model model = { 0 };
		struct stage stage;

		dice.state = 3;
		make(&model);
		stage_make(&stage, &model, no_origin, leaf_triangles, (enum store_layout)layout);
		for (int i = 0; i < 40; i++) {
			struct camera camera = random_camera(&stage.scene, reach);
			struct camera_view view;

			if (i % 2)
				memset(camera.at, 0, sizeof(camera.at));
			/* Each is a frame without one before: nothing is spared a test. */
			if (i % 3 == 0)
				conservative_forget(stage.conservative);
			/* Near planes that cut boxes, too. */
			view = view_of(&stage.scene, &camera, i % 5 == 0 ? 1.0 : 0.01);
			(void)stage_frame(&stage, &view);
		}
		stage_done(&stage);
	}
}

/* Slats less than a pixel wide, and behind them small things all over. */
static void picket_fence(struct scene_model *model)
{
	for (int i = -60; i < 60; i++) {
		const double box_min[3] = { 0.2 * i, 0, -4 };
		const double box_max[3] = { 0.2 * i + 0.15, 0.05, 4 };

		scene_box(model, box_min, box_max, 1);
	}
	for (int i = 0; i < 300; i++) {
		double at[3];

		for (int k = 0; k < 3; k++)
			at[k] = 8.0 * random_unit(&dice) - 4.0 + (k == 1 ? 5.0 : 0.0);
		scene_triangle(model, at, (double[]){ at[0] + 0.3, at[1], at[2] },
			       (double[]){ at[0], at[1] + 0.2, at[2] + 0.3 });
	}
}

/* A wall with one hole of 1/16 unit. */
static void pinhole(struct scene_model *model)
{
	const double hole = 0.0625;

	scene_plate(model, (double[]){ -8, 0, -8 }, (double[]){ 8, 0, 0 }, (double[]){ 0, 0, 16 },
		    6, 6);
	scene_plate(model, (double[]){ hole, 0, -8 }, (double[]){ 8, 0, 0 }, (double[]){ 0, 0, 16 },
		    6, 6);
	scene_plate(model, (double[]){ 0, 0, -8 }, (double[]){ hole, 0, 0 }, (double[]){ 0, 0, 8 },
		    1, 6);
	scene_plate(model, (double[]){ 0, 0, hole }, (double[]){ hole, 0, 0 },
		    (double[]){ 0, 0, 8 }, 1, 6);
	for (int i = 0; i < 40; i++) {
		const double box_min[3] = { 12 * random_unit(&dice) - 6, 1 + 6 * random_unit(&dice),
					    12 * random_unit(&dice) - 6 };
		const double box_max[3] = { box_min[0] + 0.5, box_min[1] + 0.5, box_min[2] + 0.5 };

		scene_box(model, box_min, box_max, 1);
	}
}

/* One triangle through all of a room of crumbs. */
static void triangle_through_many_leaves(struct scene_model *model)
{
	for (int i = 0; i < 800; i++) {
		double at[3];

		for (int k = 0; k < 3; k++)
			at[k] = 12.0 * random_unit(&dice) - 6.0;
		scene_triangle(model, at, (double[]){ at[0] + 0.2, at[1], at[2] },
			       (double[]){ at[0], at[1] + 0.2, at[2] + 0.2 });
	}
	scene_triangle(model, (double[]){ -7, -7, -7 }, (double[]){ 7, 7, -6 },
		       (double[]){ 0, 1, 7 });
}

/* Faces that lie in the walls of cells, and twice the same face. */
static void coplanar_faces(struct scene_model *model)
{
	for (int i = -2; i <= 2; i++) {
		scene_plate(model, (double[]){ 2.0 * i, -4, -4 }, (double[]){ 0, 8, 0 },
			    (double[]){ 0, 0, 8 }, 8, 8);
		scene_plate(model, (double[]){ -4, 2.0 * i, -4 }, (double[]){ 8, 0, 0 },
			    (double[]){ 0, 0, 8 }, 4, 4);
		scene_plate(model, (double[]){ 2.0 * i, -2, -2 }, (double[]){ 0, 4, 0 },
			    (double[]){ 0, 0, 4 }, 4, 4);
	}
}

static void a_fence_and_a_pinhole_hide_nothing_that_shows(void **state)
{
	(void)state;
	look_around(picket_fence, 20, 9.0);
	look_around(pinhole, 12, 9.0);
}

static void a_triangle_through_many_leaves_shows_wherever_it_is_seen(void **state)
{
	(void)state;
	look_around(triangle_through_many_leaves, 10, 8.0);
}

static void faces_in_the_walls_of_cells_and_on_each_other_show(void **state)
{
	(void)state;
	look_around(coplanar_faces, 20, 7.0);
}

static void a_model_far_from_the_origin_shows_the_same(void **state)
{
	const double far_origin[3] = { 1e7, -1e7, 1e7 };
	struct scene_model models[2] = { { 0 } };
	struct stage stages[2];

	(void)state;
	for (int i = 0; i < 2; i++) {
		rooms(&models[i]);
		stage_make(&stages[i], &models[i], i == 0 ? no_origin : far_origin, 40,
			   STORE_LAYOUT_UNIQUE);
	}
	dice.state = 4;
	for (int i = 0; i < 30; i++) {
		struct camera near_camera = random_camera(&stages[0].scene, 14.0);
		struct camera far_camera;
		struct camera_view view;

		/* Doubles at 10^7 have steps of 2^-29: the camera is on them in both. */
		for (int k = 0; k < 3; k++) {
			near_camera.eye[k] = rint(near_camera.eye[k] * 0x1p20) * 0x1p-20;
			near_camera.at[k] = rint(near_camera.at[k] * 0x1p20) * 0x1p-20;
		}
		far_camera = near_camera;
		for (int k = 0; k < 3; k++) {
			far_camera.eye[k] += far_origin[k];
			far_camera.at[k] += far_origin[k];
		}
		view = view_of(&stages[0].scene, &near_camera, 0.05);
		(void)stage_frame(&stages[0], &view);
		view = view_of(&stages[1].scene, &far_camera, 0.05);
		(void)stage_frame(&stages[1], &view);
		assert_memory_equal(raster_depths(stages[0].shown), raster_depths(stages[1].shown),
				    WIDTH * HEIGHT * sizeof(float));
	}
	for (int i = 0; i < 2; i++)
		stage_done(&stages[i]);
}

static void a_jump_is_no_worse_than_a_beginning(void **state)
{
	struct scene_model model = { 0 };
	struct stage stage;

	(void)state;
	rooms(&model);
	dice.state = 5;
	stage_make(&stage, &model, no_origin, 40, STORE_LAYOUT_UNIQUE);
	for (int i = 0; i < 20; i++) {
		struct camera camera = random_camera(&stage.scene, 14.0);
		struct camera_view view = view_of(&stage.scene, &camera, 0.05);
		struct conservative_result fresh;
		struct conservative_result jump;
		struct conservative_result again;

		conservative_forget(stage.conservative);
		fresh = stage_frame(&stage, &view);
		again = stage_frame(&stage, &view);
		if (!again.is_untested)
			/* What showed is drawn first, and nothing of what it hides. */
			assert_true(again.nodes_drawn <= fresh.nodes_drawn);
		camera = random_camera(&stage.scene, 14.0);
		view = view_of(&stage.scene, &camera, 0.05);
		conservative_forget(stage.conservative);
		(void)stage_frame(&stage, &view);
		camera = random_camera(&stage.scene, 14.0);
		view = view_of(&stage.scene, &camera, 0.05);
		jump = stage_frame(&stage, &view);
		conservative_forget(stage.conservative);
		fresh = stage_frame(&stage, &view);
		assert_int_equal(jump.is_complete, true);
		if (!jump.is_untested)
			assert_int_equal(jump.shown_count, fresh.shown_count);
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

static void one_triangle_and_one_leaf_show(void **state)
{
	const struct camera camera = { .eye = { 0, -5, 0 },
				       .up = { 0, 0, 1 },
				       .fov_y_degrees = 60 };

	(void)state;
	for (int i = 0; i < 2; i++) {
		struct scene_model model = { 0 };
		struct conservative_result result;
		struct camera_view view;
		struct stage stage;

		if (i == 0)
			scene_triangle(&model, (double[]){ -1, 0, -1 }, (double[]){ 1, 0, -1 },
				       (double[]){ 0, 0, 1 });
		else
			scene_box(&model, (double[]){ -1, -1, -1 }, (double[]){ 1, 1, 1 }, 2);
		stage_make(&stage, &model, no_origin, 1000, STORE_LAYOUT_UNIQUE);
		view = view_of(&stage.scene, &camera, 0.05);
		result = stage_frame(&stage, &view);
		assert_int_equal(result.shown_count, 1);
		assert_int_equal(stage.scene.superblock.leaf_count, 1);
		stage_done(&stage);
	}
}

/* ---- a tester that answers from a list ---- */

struct answers {
	size_t largest_test;
	size_t tested_count;
	int error;
	uint8_t *times_drawn; /* a node */
};

static int answers_draw(void *context, const uint32_t *nodes, size_t node_count, bool *ret_drawn)
{
	struct answers *answers = context;

	for (size_t i = 0; i < node_count; i++) {
		answers->times_drawn[nodes[i]]++;
		ret_drawn[i] = true;
	}
	return 0;
}

/* Every third node shows. */
static int answers_test(void *context, const struct conservative_box *boxes, size_t box_count,
			bool *ret_shows)
{
	struct answers *answers = context;

	if (answers->error < 0)
		return answers->error;
	answers->tested_count += box_count;
	answers->largest_test =
		box_count > answers->largest_test ? box_count : answers->largest_test;
	for (size_t i = 0; i < box_count; i++)
		ret_shows[i] = boxes[i].node % 3 == 0;
	return 0;
}

/* As many crumbs as boxes: more than 16 bits can number. */
static void tests_of_more_than_65535_boxes_are_answered_box_by_box(void **state)
{
	const struct camera camera = { .eye = { 0, -40, 0 },
				       .up = { 0, 0, 1 },
				       .fov_y_degrees = 70 };
	struct answers answers = { 0 };
	struct conservative_tester tester = { .draw = answers_draw,
					      .test = answers_test,
					      .context = &answers,
					      .round_max = 1u << 20 };
	struct scene_model model = { 0 };
	struct conservative_result result;
	struct camera_view view;
	struct stage stage;
	size_t drawn_count = 0;

	(void)state;
	for (int x = -132; x < 132; x++)
		for (int z = -132; z < 132; z++) {
			const double at[3] = { x / 8.0, 0, z / 8.0 };

			scene_triangle(&model, at, (double[]){ at[0] + 0.05, 0, at[2] },
				       (double[]){ at[0], 0, at[2] + 0.05 });
		}
	stage_make(&stage, &model, no_origin, 1, STORE_LAYOUT_UNIQUE);
	answers.times_drawn = calloc(stage.scene.superblock.node_count, 1);
	assert_non_null(answers.times_drawn);
	view = view_of(&stage.scene, &camera, 0.05);
	assert_int_equal(conservative_begin(stage.conservative, &view, NULL, &tester, &result), 0);
	assert_int_equal(result.candidate_count, 264 * 264);
	/* Rounds of 16, 32, ... and the rest at once, the second time: what showed first, then all. */
	assert_int_equal(answers.tested_count, result.candidate_count);
	for (uint32_t i = 0; i < stage.scene.superblock.node_count; i++) {
		assert_int_equal(answers.times_drawn[i],
				 stage.scene.nodes[i].payload_id != 0 && i % 3 == 0);
		drawn_count += answers.times_drawn[i];
	}
	assert_int_equal(result.shown_count, drawn_count);
	assert_int_equal(result.nodes_drawn, drawn_count);
	memset(answers.times_drawn, 0, stage.scene.superblock.node_count);
	answers.tested_count = 0;
	assert_int_equal(conservative_begin(stage.conservative, &view, NULL, &tester, &result), 0);
	assert_int_equal(answers.tested_count, result.candidate_count - drawn_count);
	assert_int_equal(result.shown_count, drawn_count);
	/* In the software tester too, all of it: a picture of crumbs. */
	conservative_forget(stage.conservative);
	result = stage_frame(&stage, &view);
	assert_true(result.candidate_count > 65535);
	/* What the tester refuses is handed through. */
	conservative_forget(stage.conservative);
	answers.error = -EIO;
	assert_int_equal(conservative_begin(stage.conservative, &view, NULL, &tester, &result),
			 -EIO);
	free(answers.times_drawn);
	stage_done(&stage);
}

/* A front of 300 boxes in one row, all of which show: none is lost to a number of 8 bits. */
static void a_row_of_300_boxes_shows_all_of_them(void **state)
{
	const struct camera camera = { .eye = { 0, -40, 0 },
				       .up = { 0, 0, 1 },
				       .fov_y_degrees = 50 };
	struct scene_model model = { 0 };
	struct conservative_result result;
	struct camera_view view;
	struct stage stage;

	(void)state;
	for (int x = -10; x < 10; x++)
		for (int z = -8; z < 8; z++) {
			const double corner[3] = { 1.5 * x, 0, 1.5 * z };

			scene_plate(&model, corner, (double[]){ 1.25, 0, 0 },
				    (double[]){ 0, 0, 1.25 }, 1, 1);
		}
	stage_make(&stage, &model, no_origin, 2, STORE_LAYOUT_UNIQUE);
	view = view_of(&stage.scene, &camera, 0.05);
	result = stage_frame(&stage, &view);
	assert_true(result.shown_count >= 300);
	stage_done(&stage);
}

/* Where nothing is hidden testing is given up, for longer each time, and taken up again. */
static void testing_that_does_not_pay_is_left_for_a_while(void **state)
{
	const struct camera camera = { .eye = { 0, -40, 0 },
				       .up = { 0, 0, 1 },
				       .fov_y_degrees = 50 };
	struct scene_model model = { 0 };
	struct camera_view view;
	struct stage stage;
	unsigned untested_count = 0;

	(void)state;
	scene_plate(&model, (double[]){ -8, 0, -8 }, (double[]){ 16, 0, 0 }, (double[]){ 0, 0, 16 },
		    16, 16);
	stage_make(&stage, &model, no_origin, 16, STORE_LAYOUT_UNIQUE);
	view = view_of(&stage.scene, &camera, 0.05);
	for (int i = 0; i < 100; i++) {
		struct conservative_result result = stage_frame(&stage, &view);

		untested_count += result.is_untested;
		assert_int_equal(result.boxes_tested == 0 && result.nodes_drawn == 0,
				 result.is_untested);
	}
	/* 1, 2, 4, 8, 16, 32 and 31 of the last ones. */
	assert_int_equal(untested_count, 1 + 2 + 4 + 8 + 16 + 32 + 30);
	stage_done(&stage);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(what_is_said_to_show_makes_the_same_picture),
		cmocka_unit_test(what_is_not_there_is_said_to_be_missing_until_it_comes),
		cmocka_unit_test(a_fence_and_a_pinhole_hide_nothing_that_shows),
		cmocka_unit_test(a_triangle_through_many_leaves_shows_wherever_it_is_seen),
		cmocka_unit_test(faces_in_the_walls_of_cells_and_on_each_other_show),
		cmocka_unit_test(a_model_far_from_the_origin_shows_the_same),
		cmocka_unit_test(a_jump_is_no_worse_than_a_beginning),
		cmocka_unit_test(an_empty_model_shows_nothing),
		cmocka_unit_test(one_triangle_and_one_leaf_show),
		cmocka_unit_test(tests_of_more_than_65535_boxes_are_answered_box_by_box),
		cmocka_unit_test(a_row_of_300_boxes_shows_all_of_them),
		cmocka_unit_test(testing_that_does_not_pay_is_left_for_a_while),
	};

	return TEST_RUN(tests);
}
