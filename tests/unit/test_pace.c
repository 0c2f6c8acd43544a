/* SPDX-License-Identifier: MIT */
/*
 * Goal: the budget follows what frames cost, and does not ring; what was measured is kept for the
 * driver that it was measured with.
 * Method: a renderer of formulas in place of one of clocks.
 */
#include <errno.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "formats/base/random.h"
#include "tests/helper.h"
#include "viewer/pace.h"

#define FPS    10.0
#define PIXELS 786432.0

static const struct cost_model model = {
	.frame_ms = 0.3, .triangle_ns = 180.0, .pixel_ns = 3.0, .query_ns = 40000.0
};

/* A renderer, and a scene in front of it. */
struct plant {
	double slowness; /* of the renderer, against the model */
	double weight;   /* of the scene's triangles */
	double noise;    /* +- this share of a frame's time */
	double triangles_max;
	struct random random;
};

/* Draws a frame, tells it, and says how long it took. */
static double draw(struct plant *plant, struct pace *pace)
{
	double triangles = fmin((double)pace->budget_triangles, plant->triangles_max);
	double ms = plant->slowness *
		    cost_model_frame_ms(&model, triangles * plant->weight, PIXELS) *
		    (1.0 + plant->noise * (2.0 * random_unit(&plant->random) - 1.0));

	pace_add(pace, ms, triangles);
	return ms;
}

static struct plant plant_make(void)
{
	return (struct plant){
		.slowness = 1.0, .weight = 1.0, .triangles_max = 1e12, .random = { 1 }
	};
}

/* The frame after which all are within a share of the aim, of so many frames. */
static unsigned frames_to_settle(struct plant *plant, struct pace *pace, double share)
{
	unsigned settled = 0;

	for (unsigned frame = 1; frame <= 200; frame++) {
		double ms = draw(plant, pace);

		if (fabs(ms - pace->aim_ms) > share * pace->aim_ms)
			settled = frame;
	}
	return settled;
}

static void pace_begins_with_what_the_model_says(void **state)
{
	struct plant plant = plant_make();
	struct pace pace;

	(void)state;
	pace_init(&pace, &model, FPS, PIXELS);
	assert_float_equal(pace_predict_ms(&pace, (double)pace.budget_triangles), 90.0, 0.01);
	assert_int_equal(frames_to_settle(&plant, &pace, 0.001), 0);
}

static void pace_follows_a_step_in_the_scenes_cost(void **state)
{
	const double weights[] = { 3.0, 1.0, 0.2, 8.0, 1.3, 0.5 };
	struct plant plant = plant_make();
	struct pace pace;

	(void)state;
	pace_init(&pace, &model, FPS, PIXELS);
	for (size_t i = 0; i < ARRAY_LENGTH(weights); i++) {
		plant.weight = weights[i];
		assert_in_range(frames_to_settle(&plant, &pace, 0.15), 1, 8);
	}
}

static void pace_follows_a_step_in_the_renderers_speed(void **state)
{
	const double slownesses[] = { 4.0, 1.0, 0.25, 2.0 };
	struct plant plant = plant_make();
	struct pace pace;

	(void)state;
	pace_init(&pace, &model, FPS, PIXELS);
	for (size_t i = 0; i < ARRAY_LENGTH(slownesses); i++) {
		plant.slowness = slownesses[i];
		assert_in_range(frames_to_settle(&plant, &pace, 0.15), 1, 8);
	}
}

static void pace_finds_the_budget_from_a_model_that_is_wrong(void **state)
{
	const double factors[] = { 0.01, 0.1, 10.0, 100.0 };

	(void)state;
	for (size_t i = 0; i < ARRAY_LENGTH(factors); i++) {
		struct cost_model wrong = model;
		struct plant plant = plant_make();
		struct pace pace;

		wrong.triangle_ns *= factors[i];
		pace_init(&pace, &wrong, FPS, PIXELS);
		assert_in_range(frames_to_settle(&plant, &pace, 0.15), 1, 16);
	}
}

static void pace_comes_to_rest(void **state)
{
	struct plant plant = plant_make();
	struct pace pace;
	uint64_t budget;

	(void)state;
	pace_init(&pace, &model, FPS, PIXELS);
	plant.weight = 2.7;
	(void)frames_to_settle(&plant, &pace, 0.15);
	budget = pace.budget_triangles;
	for (unsigned frame = 0; frame < 1000; frame++) {
		(void)draw(&plant, &pace);
		assert_int_equal(pace.budget_triangles, budget);
	}
}

static void pace_never_shoots_over_when_frames_become_cheaper(void **state)
{
	struct plant plant = plant_make();
	struct pace pace;

	(void)state;
	pace_init(&pace, &model, FPS, PIXELS);
	plant.slowness = 4.0;
	(void)frames_to_settle(&plant, &pace, 0.15);
	plant.slowness = 1.0;
	for (unsigned frame = 0; frame < 200; frame++)
		assert_true(draw(&plant, &pace) < 1.15 * pace.aim_ms);
}

static void pace_is_late_for_three_frames_when_they_become_dearer(void **state)
{
	struct plant plant = plant_make();
	struct pace pace;

	(void)state;
	pace_init(&pace, &model, FPS, PIXELS);
	plant.slowness = 4.0;
	for (unsigned frame = 0; frame < 200; frame++)
		assert_true(draw(&plant, &pace) < 1.15 * pace.aim_ms || frame < 3);
}

/* Noise of 20 % moves the budget seldom, by little, and not to and fro. */
static void pace_is_not_moved_by_noise(void **state)
{
	const unsigned frame_count = 5000;

	(void)state;
	for (uint64_t seed = 1; seed <= 8; seed++) {
		struct plant plant = plant_make();
		struct pace pace;
		unsigned changes = 0;
		double ideal;

		plant.noise = 0.2;
		plant.random.state = seed;
		pace_init(&pace, &model, FPS, PIXELS);
		ideal = (double)pace.budget_triangles;
		for (unsigned frame = 0; frame < frame_count; frame++) {
			uint64_t budget = pace.budget_triangles;

			(void)draw(&plant, &pace);
			changes += pace.budget_triangles != budget;
			assert_true(fabs((double)pace.budget_triangles - ideal) < 0.25 * ideal);
		}
		assert_true(changes < frame_count / 50);
	}
}

static void pace_settles_in_noise(void **state)
{
	(void)state;
	for (uint64_t seed = 1; seed <= 8; seed++) {
		struct plant plant = plant_make();
		struct pace pace;
		double ideal;

		plant.noise = 0.2;
		plant.random.state = seed;
		pace_init(&pace, &model, FPS, PIXELS);
		ideal = (double)pace.budget_triangles / 3.0;
		plant.weight = 3.0;
		for (unsigned frame = 0; frame < 200; frame++) {
			(void)draw(&plant, &pace);
			assert_true(frame < 12 ||
				    fabs((double)pace.budget_triangles - ideal) < 0.35 * ideal);
		}
	}
}

static void pace_forgets_a_hiccup(void **state)
{
	struct plant plant = plant_make();
	struct pace pace;
	uint64_t budget;

	(void)state;
	pace_init(&pace, &model, FPS, PIXELS);
	budget = pace.budget_triangles;
	for (unsigned i = 0; i < 20; i++) {
		plant.slowness = i % 10 == 5 ? 10.0 : 1.0;
		(void)draw(&plant, &pace);
		assert_int_equal(pace.budget_triangles, budget);
	}
}

/* Whoever looks at the sky for a while comes back to the budget that was left. */
static void pace_learns_nothing_of_triangles_from_none(void **state)
{
	struct plant plant = plant_make();
	struct pace pace;
	double triangle_ns;

	(void)state;
	pace_init(&pace, &model, FPS, PIXELS);
	triangle_ns = pace.triangle_ns;
	plant.triangles_max = 0.0;
	plant.slowness = 3.0;
	for (unsigned frame = 0; frame < 100; frame++)
		(void)draw(&plant, &pace);
	assert_float_equal(pace.triangle_ns, triangle_ns, 1e-9);
}

static void pace_keeps_its_bounds(void **state)
{
	struct plant plant = plant_make();
	struct pace pace;

	(void)state;
	pace_init(&pace, &model, FPS, PIXELS);
	plant.slowness = 1e6;
	for (unsigned frame = 0; frame < 100; frame++)
		(void)draw(&plant, &pace);
	assert_int_equal(pace.budget_triangles, PACE_BUDGET_MIN);
	plant.slowness = 0.0;
	for (unsigned frame = 0; frame < 1000; frame++)
		(void)draw(&plant, &pace);
	assert_true(pace.budget_triangles <= PACE_BUDGET_MAX);
}

static void pace_allows_for_a_larger_picture(void **state)
{
	struct pace pace;
	uint64_t budget;

	(void)state;
	pace_init(&pace, &model, FPS, PIXELS);
	budget = pace.budget_triangles;
	pace_resize(&pace, &model, 4.0 * PIXELS);
	assert_true(pace.budget_triangles < budget);
	assert_float_equal(pace_predict_ms(&pace, (double)pace.budget_triangles), 90.0, 0.01);
}

/* ---- the file ---- */

static const struct cost_identity identity = { "llvmpipe (256 bits)", "4.5 Mesa 22.3.6" };

static void costs_are_kept_for_the_driver_that_they_were_measured_with(void **state)
{
	const struct cost_identity other = { identity.renderer, "4.5 Mesa 23.0.0" };
	const char *path = test_path(*state, "m.cost");
	struct cost_model read = { 0 };
	struct why why = { "" };

	assert_int_equal(cost_model_read(path, &identity, &read, &why), -ENOENT);
	assert_int_equal(cost_model_write(path, &identity, &model, &why), 0);
	assert_string_equal(test_folder_list(*state), "m.cost ");
	assert_int_equal(cost_model_read(path, &identity, &read, &why), 0);
	assert_float_equal(read.frame_ms, model.frame_ms, 1e-9);
	assert_float_equal(read.triangle_ns, model.triangle_ns, 1e-9);
	assert_float_equal(read.pixel_ns, model.pixel_ns, 1e-9);
	assert_float_equal(read.query_ns, model.query_ns, 1e-9);
	assert_int_equal(cost_model_read(path, &other, &read, &why), -ESTALE);
}

static void costs_that_were_not_measured_are_not_believed(void **state)
{
	const char *path = test_path(*state, "m.cost");
	struct cost_model read = { 0 };
	struct why why = { "" };
	char *text;
	size_t bytes;

	assert_int_equal(cost_model_write(path, &identity, &model, &why), 0);
	text = test_file_read(path, &bytes);
	for (size_t cut = 0; cut < bytes; cut++) {
		test_file_write(path, text, cut);
		assert_true(cost_model_read(path, &identity, &read, &why) < 0);
	}
	/* Another version of the file, a figure that is negative. */
	text[strlen("oocview cost ")] = '2';
	test_file_write(path, text, bytes);
	assert_int_equal(cost_model_read(path, &identity, &read, &why), -ESTALE);
	text[strlen("oocview cost ")] = '1';
	*(char *)(strstr(text, "pixel_ns ") + strlen("pixel_ns ")) = '-';
	test_file_write(path, text, bytes);
	assert_int_equal(cost_model_read(path, &identity, &read, &why), -EUCLEAN);
	free(text);
}

#define IN_A_FOLDER(test)                                                                          \
	cmocka_unit_test_setup_teardown(test, test_folder_setup, test_folder_teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(pace_begins_with_what_the_model_says),
		cmocka_unit_test(pace_follows_a_step_in_the_scenes_cost),
		cmocka_unit_test(pace_follows_a_step_in_the_renderers_speed),
		cmocka_unit_test(pace_finds_the_budget_from_a_model_that_is_wrong),
		cmocka_unit_test(pace_comes_to_rest),
		cmocka_unit_test(pace_never_shoots_over_when_frames_become_cheaper),
		cmocka_unit_test(pace_is_late_for_three_frames_when_they_become_dearer),
		cmocka_unit_test(pace_is_not_moved_by_noise),
		cmocka_unit_test(pace_settles_in_noise),
		cmocka_unit_test(pace_forgets_a_hiccup),
		cmocka_unit_test(pace_learns_nothing_of_triangles_from_none),
		cmocka_unit_test(pace_keeps_its_bounds),
		cmocka_unit_test(pace_allows_for_a_larger_picture),
		IN_A_FOLDER(costs_are_kept_for_the_driver_that_they_were_measured_with),
		IN_A_FOLDER(costs_that_were_not_measured_are_not_believed),
	};

	return TEST_RUN(tests);
}
