/* SPDX-License-Identifier: MIT */
/*
 * Goal: a path at another speed is the same path, and the same frames every time.
 * Method: a path of rows that differ in everything, against itself.
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
#include "tests/helper.h"
#include "viewer/camera_path.h"

#define ROW_COUNT 33u

static struct camera rows[ROW_COUNT];

static int make_rows(void **state)
{
	(void)state;
	for (uint32_t i = 0; i < ROW_COUNT; i++) {
		double turn = 0.1 * i;

		rows[i] = (struct camera){
			.time_s = 5.0 + 0.04 * i + 0.001 * (i % 3),
			.eye = { 10.0 + i, 0.3 * i * i, -2.0 },
			.up = { 0.01 * i, 0.0, 1.0 },
			.fov_y_degrees = 40.0 + 0.1 * i,
		};
		rows[i].at[0] = rows[i].eye[0] + 3.0 * cos(turn);
		rows[i].at[1] = rows[i].eye[1] + 3.0 * sin(turn);
		rows[i].at[2] = rows[i].eye[2];
	}
	return 0;
}

static void whole_speeds_take_rows_as_they_are(void **state)
{
	const uint32_t speeds[] = { 1, 2, 4, 8, 16 };

	(void)state;
	for (size_t i = 0; i < ARRAY_LENGTH(speeds); i++) {
		struct camera *path;
		uint32_t count;

		assert_int_equal(camera_path_at_speed(rows, ROW_COUNT, speeds[i], &path, &count),
				 0);
		assert_int_equal(count, (ROW_COUNT - 1) / speeds[i] + 1);
		for (uint32_t frame = 0; frame < count; frame++) {
			struct camera row = rows[frame * speeds[i]];

			row.time_s = 5.0 + (row.time_s - 5.0) / speeds[i];
			assert_memory_equal(&path[frame], &row, sizeof(row));
		}
		free(path);
	}
}

static void slow_frames_lie_between_rows_and_meet_them(void **state)
{
	struct camera *path;
	uint32_t count;

	(void)state;
	assert_int_equal(camera_path_at_speed(rows, ROW_COUNT, 0.25, &path, &count), 0);
	assert_int_equal(count, 4 * (ROW_COUNT - 1) + 1);
	for (uint32_t frame = 0; frame < count; frame++) {
		const struct camera *a = &rows[frame / 4];

		if (frame % 4 == 0) {
			assert_memory_equal(path[frame].eye, a->eye, sizeof(a->eye));
			assert_memory_equal(path[frame].at, a->at, sizeof(a->at));
		} else {
			assert_float_equal(path[frame].eye[0], a->eye[0] + 0.25 * (frame % 4),
					   1e-12);
		}
		assert_true(frame == 0 || path[frame].time_s > path[frame - 1].time_s);
	}
	assert_float_equal(path[count - 1].time_s - 5.0, 4.0 * (rows[ROW_COUNT - 1].time_s - 5.0),
			   1e-9);
	free(path);
}

static void the_frames_are_the_same_every_time(void **state)
{
	(void)state;
	for (double speed = 0.25; speed < 17.0; speed *= 1.3) {
		struct camera *path;
		struct camera *again;
		uint32_t count;
		uint32_t again_count;

		assert_int_equal(camera_path_at_speed(rows, ROW_COUNT, speed, &path, &count), 0);
		assert_int_equal(camera_path_at_speed(rows, ROW_COUNT, speed, &again, &again_count),
				 0);
		assert_int_equal(count, again_count);
		assert_memory_equal(path, again, count * sizeof(*path));
		free(path);
		free(again);
	}
}

/* A path that turns about within a row looks somewhere in every frame. */
static void a_frame_between_opposite_views_looks_somewhere(void **state)
{
	struct camera turn[2] = { rows[0], rows[0] };
	const struct store_superblock superblock = { .step_exponent = -10 };
	struct camera *path;
	uint32_t count;

	(void)state;
	for (int k = 0; k < 3; k++)
		turn[1].at[k] = 2.0 * turn[0].eye[k] - turn[0].at[k];
	assert_int_equal(camera_path_at_speed(turn, 2, 0.125, &path, &count), 0);
	assert_int_equal(count, 9);
	for (uint32_t frame = 0; frame < count; frame++) {
		struct camera_view view;

		assert_int_equal(camera_view_init(&view, &path[frame], &superblock, 1.0, 0.1), 0);
	}
	free(path);
}

static void a_path_of_one_row_stays_one(void **state)
{
	struct camera *path;
	uint32_t count;

	(void)state;
	assert_int_equal(camera_path_at_speed(rows, 1, 0.1, &path, &count), 0);
	assert_int_equal(count, 1);
	assert_memory_equal(path, rows, sizeof(*path));
	free(path);
	assert_int_equal(camera_path_at_speed(rows, UINT32_MAX, 1.0 / 1024.0, &path, &count),
			 -E2BIG);
}

static void speeds_are_numbers_or_fractions(void **state)
{
	const char *const wrong[] = {
		"", "x4", "1/", "/4", "0", "-1", "1/0", "1/2/3", "2000", "nan"
	};
	double speed;

	(void)state;
	assert_int_equal(camera_path_speed("16", &speed), 0);
	assert_true(speed == 16.0);
	assert_int_equal(camera_path_speed("1/4", &speed), 0);
	assert_true(speed == 0.25);
	assert_int_equal(camera_path_speed("0.5", &speed), 0);
	assert_true(speed == 0.5);
	for (size_t i = 0; i < ARRAY_LENGTH(wrong); i++)
		assert_true(camera_path_speed(wrong[i], &speed) < 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup(whole_speeds_take_rows_as_they_are, make_rows),
		cmocka_unit_test_setup(slow_frames_lie_between_rows_and_meet_them, make_rows),
		cmocka_unit_test_setup(the_frames_are_the_same_every_time, make_rows),
		cmocka_unit_test_setup(a_frame_between_opposite_views_looks_somewhere, make_rows),
		cmocka_unit_test_setup(a_path_of_one_row_stays_one, make_rows),
		cmocka_unit_test(speeds_are_numbers_or_fractions),
	};

	return TEST_RUN(tests);
}
