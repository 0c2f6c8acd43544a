/* SPDX-License-Identifier: MIT */
/*
 * Goal: gestures do what a hand expects, at the origin and 10^7 units from it.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "libclient/select/vector.h"
#include "tests/helper.h"
#include "viewer/camera_control.h"
#include "viewer/gesture.h"

#define ASPECT 1.6

static const double z_up[3] = { 0.0, 0.0, 1.0 };

static const struct camera start = {
	.eye = { 10.0, -30.0, 12.0 },
	.at = { 1.0, 2.0, 3.0 },
	.up = { 0.0, 0.0, 1.0 },
	.fov_y_degrees = 45.0,
};

static double between(const double a[3], const double b[3])
{
	return sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) +
		    (a[2] - b[2]) * (a[2] - b[2]));
}

static void assert_near(double a, double b, double tolerance)
{
	if (!(fabs(a - b) <= tolerance))
		fail_msg("%.17g is not %.17g to %g", a, b, tolerance);
}

/* Where a point shows: x and y from -1 to 1, and its distance along the view. */
static void project(const struct camera *camera, const double point[3], double ret[3])
{
	double tan_half = tan(camera->fov_y_degrees * (M_PI / 360.0));
	struct camera_axes axes;
	double from_eye[3];

	camera_control_axes(camera, &axes);
	for (int k = 0; k < 3; k++)
		from_eye[k] = point[k] - camera->eye[k];
	ret[2] = vector_dot(from_eye, axes.forward);
	ret[0] = vector_dot(from_eye, axes.right) / (ret[2] * tan_half * ASPECT);
	ret[1] = vector_dot(from_eye, axes.up) / (ret[2] * tan_half);
}

static struct camera moved_by(struct camera camera, double offset)
{
	for (int k = 0; k < 3; k++) {
		camera.eye[k] += offset;
		camera.at[k] += offset;
	}
	return camera;
}

static void axes_are_orthonormal_and_right_handed_also_along_up(void **state)
{
	struct camera cameras[2] = { start, start };
	struct camera_axes axes;

	(void)state;
	memcpy(cameras[1].at, cameras[1].eye, sizeof(cameras[1].at));
	cameras[1].at[2] -= 5.0;
	for (int i = 0; i < 2; i++) {
		double cross;

		camera_control_axes(&cameras[i], &axes);
		assert_near(vector_dot(axes.right, axes.right), 1.0, 1e-12);
		assert_near(vector_dot(axes.up, axes.up), 1.0, 1e-12);
		assert_near(vector_dot(axes.forward, axes.forward), 1.0, 1e-12);
		assert_near(vector_dot(axes.right, axes.up), 0.0, 1e-12);
		assert_near(vector_dot(axes.right, axes.forward), 0.0, 1e-12);
		cross = axes.right[1] * axes.forward[2] - axes.right[2] * axes.forward[1];
		assert_near(cross, axes.up[0], 1e-12);
	}
}

static void a_point_of_the_picture_projects_back_to_its_place(void **state)
{
	double point[3];
	double place[3];

	(void)state;
	camera_control_point(&start, ASPECT, 0.3, -0.7, 17.0, point);
	project(&start, point, place);
	assert_near(place[0], 0.3, 1e-12);
	assert_near(place[1], -0.7, 1e-12);
	assert_near(place[2], 17.0, 1e-12);
}

static void orbit_keeps_distances_and_the_pivots_place_on_the_screen(void **state)
{
	const double offsets[] = { 0.0, 1e7 };

	(void)state;
	for (size_t i = 0; i < 2; i++) {
		struct camera camera = moved_by(start, offsets[i]);
		const struct camera before = camera;
		double pivot[3];
		double old_place[3];
		double new_place[3];

		camera_control_point(&camera, ASPECT, 0.4, 0.2, 20.0, pivot);
		project(&camera, pivot, old_place);
		camera_control_orbit(&camera, z_up, pivot, 0.8, -0.3);
		assert_near(between(camera.eye, pivot), between(before.eye, pivot), 1e-6);
		assert_near(camera_control_distance(&camera), camera_control_distance(&before),
			    1e-6);
		project(&camera, pivot, new_place);
		for (int k = 0; k < 3; k++)
			assert_near(new_place[k], old_place[k], 1e-6);
		assert_true(between(camera.eye, before.eye) > 1.0);
	}
}

static void a_level_camera_orbits_up_to_the_poles_and_no_further(void **state)
{
	const double pitches[] = { 10.0, -10.0, 20.0 };
	struct camera camera = start;
	struct camera_axes axes;

	(void)state;
	for (size_t i = 0; i < 3; i++) {
		camera_control_orbit(&camera, z_up, camera.at, 0.1, pitches[i]);
		camera_control_axes(&camera, &axes);
		assert_true(fabs(axes.forward[2]) < 1.0);
		assert_true(fabs(axes.forward[2]) > 0.99);
		assert_near(axes.right[2], 0.0, 1e-9);
		assert_true(axes.up[2] > 0.0);
	}
}

static void a_rolled_camera_keeps_its_roll_and_level_takes_it_away(void **state)
{
	struct camera camera = start;
	struct camera_axes axes;

	(void)state;
	camera_control_turn(&camera, z_up, 0.0, 0.0, 0.5);
	camera_control_axes(&camera, &axes);
	assert_true(fabs(axes.right[2]) > 0.1);
	camera_control_orbit(&camera, z_up, camera.at, 0.4, 0.0);
	camera_control_axes(&camera, &axes);
	assert_true(fabs(axes.right[2]) > 0.1);
	camera_control_level(&camera, z_up);
	camera_control_axes(&camera, &axes);
	assert_near(axes.right[2], 0.0, 1e-12);
}

static void turning_right_looks_to_the_right(void **state)
{
	struct camera camera = start;
	struct camera_axes before;
	struct camera_axes after;

	(void)state;
	camera_control_axes(&camera, &before);
	camera_control_turn(&camera, z_up, -0.2, 0.0, 0.0);
	camera_control_axes(&camera, &after);
	assert_true(vector_dot(after.forward, before.right) > 0.1);
	assert_memory_equal(camera.eye, start.eye, sizeof(camera.eye));
	camera_control_turn(&camera, z_up, 0.0, 0.2, 0.0);
	camera_control_axes(&camera, &after);
	assert_true(vector_dot(after.forward, before.up) > 0.1);
}

static void zoom_keeps_the_point_under_the_cursor(void **state)
{
	struct camera camera = start;
	double point[3];
	double place[3];

	(void)state;
	camera_control_point(&camera, ASPECT, -0.5, 0.6, 40.0, point);
	gesture_wheel(&camera, point, 3.0);
	project(&camera, point, place);
	assert_near(place[0], -0.5, 1e-9);
	assert_near(place[1], 0.6, 1e-9);
	assert_true(place[2] < 30.0);
	gesture_wheel(&camera, point, -3.0);
	assert_near(between(camera.eye, start.eye), 0.0, 1e-9);
}

static void a_walker_stays_at_a_height_whatever_the_view(void **state)
{
	struct camera camera = start;

	(void)state;
	camera_control_walk(&camera, z_up, 0.0, 0.0, 7.0);
	assert_near(camera.eye[2], start.eye[2], 1e-12);
	assert_near(between(camera.eye, start.eye), 7.0, 1e-12);
	camera_control_walk(&camera, z_up, 2.0, 3.0, 0.0);
	assert_near(camera.eye[2], start.eye[2] + 3.0, 1e-12);
	camera = start;
	camera_control_move(&camera, 0.0, 0.0, 7.0);
	assert_true(camera.eye[2] < start.eye[2] - 0.5);
}

static void each_side_shows_the_whole_box_from_where_it_says(void **state)
{
	const double box_min[3] = { 1e6, -3.0, 5.0 };
	const double box_max[3] = { 1e6 + 40.0, 9.0, 8.0 };
	const double ups[3][3] = { { 1.0, 0.0, 0.0 }, { 0.0, 1.0, 0.0 }, { 0.0, 0.0, 1.0 } };

	(void)state;
	for (int u = 0; u < 3; u++) {
		for (enum camera_control_side s = 0; s < CAMERA_CONTROL_SIDE_COUNT_; s++) {
			struct camera camera = start;
			struct camera_axes axes;
			double largest = 0.0;

			camera_control_view_side(&camera, s, ups[u], box_min, box_max, ASPECT);
			for (unsigned corner = 0; corner < 8; corner++) {
				double point[3];
				double place[3];

				for (unsigned k = 0; k < 3; k++)
					point[k] = corner >> k & 1 ? box_max[k] : box_min[k];
				project(&camera, point, place);
				assert_true(place[2] > 0.0);
				assert_true(fabs(place[0]) < 1.0 && fabs(place[1]) < 1.0);
				largest = fmax(largest, fmax(fabs(place[0]), fabs(place[1])));
			}
			/* And not from much further away than need be. */
			assert_true(largest > 0.8);
			camera_control_axes(&camera, &axes);
			if (s == CAMERA_CONTROL_TOP)
				assert_near(vector_dot(axes.forward, ups[u]), -1.0, 1e-12);
			else if (s == CAMERA_CONTROL_BOTTOM)
				assert_near(vector_dot(axes.forward, ups[u]), 1.0, 1e-12);
			else
				assert_near(vector_dot(axes.up, ups[u]), 1.0, 1e-12);
		}
	}
}

static void a_top_view_orbits_like_a_level_camera(void **state)
{
	const double box_min[3] = { 0.0, 0.0, 0.0 };
	const double box_max[3] = { 1.0, 1.0, 1.0 };
	struct camera camera = start;
	struct camera_axes axes;

	(void)state;
	camera_control_view_side(&camera, CAMERA_CONTROL_TOP, z_up, box_min, box_max, ASPECT);
	camera_control_orbit(&camera, z_up, camera.at, 0.3, 0.7);
	camera_control_axes(&camera, &axes);
	assert_near(axes.right[2], 0.0, 1e-9);
	assert_true(axes.up[2] > 0.0);
}

static void speed_suits_the_distance_within_bounds(void **state)
{
	(void)state;
	assert_true(camera_control_speed(10.0, 100.0) > camera_control_speed(1.0, 100.0));
	assert_true(camera_control_speed(0.0, 100.0) > 0.0);
	assert_near(camera_control_speed(1e9, 100.0), camera_control_speed(100.0, 100.0), 1e-12);
}

static void a_short_press_is_a_click_and_a_long_one_a_drag(void **state)
{
	struct gesture gesture = { .up = { 0.0, 0.0, 1.0 }, .scene_size = 10.0 };
	struct camera camera = start;

	(void)state;
	gesture_press(&gesture, GESTURE_ORBIT, 100.0, 100.0, start.at);
	assert_false(gesture_move(&gesture, &camera, 102.0, 101.0, 720.0));
	assert_true(gesture_release(&gesture));
	gesture_press(&gesture, GESTURE_ORBIT, 100.0, 100.0, start.at);
	assert_true(gesture_move(&gesture, &camera, 150.0, 100.0, 720.0));
	assert_false(gesture_release(&gesture));
	assert_false(gesture_move(&gesture, &camera, 300.0, 100.0, 720.0));
	assert_true(between(camera.eye, start.eye) > 0.1);
}

static void a_pan_keeps_its_point_under_the_cursor(void **state)
{
	const double height = 720.0;
	struct gesture gesture = { .up = { 0.0, 0.0, 1.0 } };
	struct camera camera = start;
	double point[3];
	double place[3];

	(void)state;
	camera_control_point(&camera, ASPECT, 0.0, 0.0, 25.0, point);
	gesture_press(&gesture, GESTURE_PAN, 576.0, 360.0, point);
	assert_true(gesture_move(&gesture, &camera, 576.0 + 144.0, 360.0 - 90.0, height));
	project(&camera, point, place);
	assert_near(place[0], 144.0 / 576.0, 1e-9);
	assert_near(place[1], 90.0 / 360.0, 1e-9);
}

static void held_keys_move_in_proportion_to_time(void **state)
{
	struct gesture gesture = { .up = { 0.0, 0.0, 1.0 }, .scene_size = 100.0 };
	struct camera once = start;
	struct camera twice = start;

	(void)state;
	assert_false(gesture_step(&gesture, &once, 1.0, 10.0));
	gesture.held[GESTURE_FORWARD] = true;
	assert_true(gesture_step(&gesture, &once, 0.2, 10.0));
	assert_true(gesture_step(&gesture, &twice, 0.1, 10.0));
	assert_true(gesture_step(&gesture, &twice, 0.1, 10.0));
	assert_near(between(once.eye, twice.eye), 0.0, 1e-9);
	assert_near(between(once.eye, start.eye), 0.2 * camera_control_speed(10.0, 100.0), 1e-9);
	gesture.held[GESTURE_BACKWARD] = true;
	twice = once;
	assert_true(gesture_step(&gesture, &twice, 0.2, 10.0));
	assert_near(between(once.eye, twice.eye), 0.0, 1e-9);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(axes_are_orthonormal_and_right_handed_also_along_up),
		cmocka_unit_test(a_point_of_the_picture_projects_back_to_its_place),
		cmocka_unit_test(orbit_keeps_distances_and_the_pivots_place_on_the_screen),
		cmocka_unit_test(a_level_camera_orbits_up_to_the_poles_and_no_further),
		cmocka_unit_test(a_rolled_camera_keeps_its_roll_and_level_takes_it_away),
		cmocka_unit_test(turning_right_looks_to_the_right),
		cmocka_unit_test(zoom_keeps_the_point_under_the_cursor),
		cmocka_unit_test(a_walker_stays_at_a_height_whatever_the_view),
		cmocka_unit_test(each_side_shows_the_whole_box_from_where_it_says),
		cmocka_unit_test(a_top_view_orbits_like_a_level_camera),
		cmocka_unit_test(speed_suits_the_distance_within_bounds),
		cmocka_unit_test(a_short_press_is_a_click_and_a_long_one_a_drag),
		cmocka_unit_test(a_pan_keeps_its_point_under_the_cursor),
		cmocka_unit_test(held_keys_move_in_proportion_to_time),
	};

	return TEST_RUN(tests);
}
