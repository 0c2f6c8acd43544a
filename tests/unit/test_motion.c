/* SPDX-License-Identifier: MIT */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <math.h>

#include "libclient/select/motion.h"
#include "tests/helper.h"

#define FRAME_S (1.0 / 30.0)

/* On a circle around (1, 2, 3), looking where it goes. */
static struct camera on_circle(double t, double radius, double rate)
{
	struct camera camera = { .time_s = t, .up = { 0.0, 0.0, 1.0 }, .fov_y_degrees = 60.0 };
	double angle = rate * t;

	camera.eye[0] = 1.0 + radius * cos(angle);
	camera.eye[1] = 2.0 + radius * sin(angle);
	camera.eye[2] = 3.0;
	camera.at[0] = camera.eye[0] - sin(angle);
	camera.at[1] = camera.eye[1] + cos(angle);
	camera.at[2] = camera.eye[2];
	return camera;
}

static struct camera straight(double t)
{
	return (struct camera){ .time_s = t,
				.eye = { 2.0 * t, -t, 0.5 * t },
				.at = { 2.0 * t, 1.0 - t, 0.5 * t },
				.up = { 0.0, 0.0, 1.0 },
				.fov_y_degrees = 60.0 };
}

static double distance(const double a[3], const double b[3])
{
	return sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) +
		    (a[2] - b[2]) * (a[2] - b[2]));
}

static void motion_without_a_camera_predicts_nothing_and_with_one_that_it_stays(void **state)
{
	struct camera camera = straight(1.0);
	struct camera predicted;
	struct motion motion;

	(void)state;
	motion_init(&motion);
	assert_int_equal(motion_predict(&motion, 1.0, &predicted), -ENODATA);
	motion_note(&motion, &camera);
	assert_int_equal(motion_predict(&motion, 1.0, &predicted), 0);
	assert_true(distance(predicted.eye, camera.eye) == 0.0);
	assert_true(predicted.time_s == 2.0);
}

static void motion_that_is_straight_is_predicted_exactly(void **state)
{
	struct camera predicted;
	struct motion motion;

	(void)state;
	motion_init(&motion);
	for (int i = 0; i < 10; i++) {
		struct camera camera = straight(i * FRAME_S);

		motion_note(&motion, &camera);
		if (i < 1)
			continue;
		assert_int_equal(motion_predict(&motion, 1.0, &predicted), 0);
		camera = straight(i * FRAME_S + 1.0);
		assert_true(distance(predicted.eye, camera.eye) < 1e-9);
		assert_true(distance(predicted.at, camera.at) < 1e-9);
	}
}

static void motion_on_a_circle_is_predicted_round_the_bend(void **state)
{
	const double late = 0.8 * 1.6 * FRAME_S;
	struct camera predicted;
	struct motion motion;

	(void)state;
	motion_init(&motion);
	for (int i = 0; i < 10; i++) {
		struct camera camera = on_circle(i * FRAME_S, 10.0, 0.8);

		motion_note(&motion, &camera);
	}
	for (int i = 0; i <= 30; i++) {
		struct camera camera = on_circle((9 + i) * FRAME_S, 10.0, 0.8);

		assert_int_equal(motion_predict(&motion, i * FRAME_S, &predicted), 0);
		/* A chord is half a frame old, and the median of three another frame. */
		assert_true(distance(predicted.eye, camera.eye) <= 8.0 * i * FRAME_S * late);
		assert_true(distance(predicted.at, camera.at) <= 8.0 * i * FRAME_S * late + 1e-9);
		assert_true(predicted.up[2] > 1.0 - 1e-9);
	}
}

static void motion_does_not_follow_a_single_jump(void **state)
{
	struct camera predicted;
	struct motion motion;

	(void)state;
	motion_init(&motion);
	for (int i = 0; i < 10; i++) {
		struct camera camera = straight(i * FRAME_S);

		camera.eye[0] += i >= 8 ? 1000.0 : 0.0;
		camera.at[0] += i >= 8 ? 1000.0 : 0.0;
		motion_note(&motion, &camera);
		if (i < 8)
			continue;
		/* From where it has landed it goes on as before. */
		assert_int_equal(motion_predict(&motion, 0.5, &predicted), 0);
		assert_true(fabs(predicted.eye[0] - camera.eye[0] - 1.0) < 1e-9);
	}
}

static void motion_stops_turning_after_a_quarter(void **state)
{
	struct camera predicted;
	struct motion motion;

	(void)state;
	motion_init(&motion);
	for (int i = 0; i < 5; i++) {
		struct camera camera = on_circle(i * FRAME_S, 1.0, 3.0);

		motion_note(&motion, &camera);
	}
	assert_int_equal(motion_predict(&motion, 10.0, &predicted), 0);
	{
		struct camera newest = on_circle(4 * FRAME_S, 1.0, 3.0);
		double turned = 0.0;

		for (int k = 0; k < 3; k++)
			turned += (predicted.at[k] - predicted.eye[k]) *
				  (newest.at[k] - newest.eye[k]);
		assert_true(fabs(turned) < 1e-6);
	}
}

static void motion_begins_anew_after_a_pause(void **state)
{
	struct camera first = straight(0.0);
	struct camera second = straight(FRAME_S);
	struct camera late = straight(5.0);
	struct camera predicted;
	struct motion motion;

	(void)state;
	motion_init(&motion);
	motion_note(&motion, &first);
	motion_note(&motion, &second);
	motion_note(&motion, &late);
	assert_int_equal(motion_predict(&motion, 1.0, &predicted), 0);
	assert_true(distance(predicted.eye, late.eye) == 0.0);
	/* A camera of the same time takes its place. */
	late.eye[0] += 1.0;
	motion_note(&motion, &late);
	assert_int_equal(motion_predict(&motion, 1.0, &predicted), 0);
	assert_true(distance(predicted.eye, late.eye) == 0.0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(
			motion_without_a_camera_predicts_nothing_and_with_one_that_it_stays),
		cmocka_unit_test(motion_that_is_straight_is_predicted_exactly),
		cmocka_unit_test(motion_on_a_circle_is_predicted_round_the_bend),
		cmocka_unit_test(motion_does_not_follow_a_single_jump),
		cmocka_unit_test(motion_stops_turning_after_a_quarter),
		cmocka_unit_test(motion_begins_anew_after_a_pause),
	};

	return TEST_RUN(tests);
}
