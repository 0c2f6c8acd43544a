/* SPDX-License-Identifier: MIT */
#include <errno.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "formats/base/file.h"
#include "formats/base/random.h"
#include "libclient/select/camera.h"
#include "libclient/select/vector.h"
#include "tests/helper.h"

static struct random dice = { 1 };

static double random_sign(void)
{
	return random_between(&dice, -1.0, 1.0);
}

static const struct store_superblock box_of_2 = {
	.triangle_count = 1,
	.step_exponent = -10,
	.box_min = { -1, -1, -1 },
	.box_max = { 1, 1, 1 },
};

/* Reads a path file with these bytes. */
static int path_read(const char *text, size_t length, struct camera **ret, uint32_t *ret_count,
		     struct why *why)
{
	AUTO_FD fd = memfd_create("path", MFD_CLOEXEC);
	char name[64];

	assert_true(fd >= 0);
	assert_int_equal(file_write_at(fd, text, length, 0), 0);
	(void)snprintf(name, sizeof(name), "/proc/self/fd/%d", fd);
	return camera_path_read(name, ret, ret_count, why);
}

static void a_row_brings_every_double_back_exactly(void **state)
{
	(void)state;
	for (int i = 0; i < 10000; i++) {
		struct camera camera = { .time_s = random_sign() * 1e9,
					 .fov_y_degrees = 85.5 + 84.5 * random_sign() };
		struct camera back;
		char row[CAMERA_ROW_BYTES];

		for (int k = 0; k < 3; k++) {
			camera.eye[k] = ldexp(random_sign(), (int)(random_next(&dice) % 200) - 100);
			camera.at[k] = ldexp(random_sign(), (int)(random_next(&dice) % 200) - 100);
			camera.up[k] = random_sign();
		}
		assert_int_equal(camera_from_row(&back, camera_to_row(&camera, row), NULL), 0);
		assert_memory_equal(&camera, &back, sizeof(camera));
	}
}

static void a_row_may_have_blanks_and_a_line_end(void **state)
{
	struct camera camera;

	(void)state;
	assert_int_equal(camera_from_row(&camera, " 1 , 2,3,4,\t5,6,7,0,0,1, 60\r\n", NULL), 0);
	assert_true(camera.time_s == 1.0);
	assert_true(camera.eye[2] == 4.0);
	assert_true(camera.at[0] == 5.0);
	assert_true(camera.up[2] == 1.0);
	assert_true(camera.fov_y_degrees == 60.0);
}

static void a_row_that_is_no_camera_is_refused_with_a_reason(void **state)
{
	static const struct {
		const char *row, *reason;
	} cases[] = {
		{ "", "column 1" },
		{ "1,2,3,4,5,6,7,0,0,1", "10 numbers instead of 11" },
		{ "1,2,3,4,5,6,7,0,0,1,60,9", "more than 11" },
		{ "1,2,x,4,5,6,7,0,0,1,60", "column 3, \"x\"" },
		{ "1,2,,4,5,6,7,0,0,1,60", "column 3" },
		{ "1,2,nan,4,5,6,7,0,0,1,60", "column 3" },
		{ "1,2,inf,4,5,6,7,0,0,1,60", "column 3" },
		{ "1,2,3,4,5,6,7,0,0,1,0.5", "fov_y" },
		{ "1,2,3,4,5,6,7,0,0,1,171", "fov_y" },
		{ "1,2,3,4,2,3,4,0,0,1,60", "same point" },
	};

	(void)state;
	for (size_t i = 0; i < ARRAY_LENGTH(cases); i++) {
		struct camera camera;
		struct why why;

		assert_int_equal(camera_from_row(&camera, cases[i].row, &why), -EINVAL);
		assert_non_null(strstr(why.text, cases[i].reason));
	}
}

static void a_path_file_comes_back_as_it_was_written(void **state)
{
	enum {
		ROWS = 300
	};
	char *text = malloc((size_t)(ROWS + 1) * CAMERA_ROW_BYTES);
	struct camera cameras[ROWS];
	struct camera *back;
	size_t length;
	uint32_t count;

	(void)state;
	assert_non_null(text);
	memset(cameras, 0, sizeof(cameras));
	length = (size_t)sprintf(text, "%s\n", camera_path_header);
	for (int i = 0; i < ROWS; i++) {
		char row[CAMERA_ROW_BYTES];

		cameras[i].time_s = i / 30.0;
		cameras[i].eye[0] = random_sign();
		cameras[i].at[1] = 5.0;
		cameras[i].up[2] = 1.0;
		cameras[i].fov_y_degrees = 60.0;
		length += (size_t)sprintf(text + length, "%s\n%s", camera_to_row(&cameras[i], row),
					  i % 100 == 99 ? "\n" : "");
	}
	assert_int_equal(path_read(text, length, &back, &count, NULL), 0);
	assert_int_equal(count, ROWS);
	assert_memory_equal(back, cameras, sizeof(cameras));
	free(back);
	free(text);
}

static void a_bad_path_file_is_refused_with_its_line(void **state)
{
#define HEADER "t,eye_x,eye_y,eye_z,at_x,at_y,at_z,up_x,up_y,up_z,fov_y\n"
#define ROW    "0,0,0,0,1,0,0,0,0,1,60\n"
	static const struct {
		const char *text;
		size_t length;
		const char *reason;
	} cases[] = {
		{ "", 0, "no camera" },
		{ HEADER, sizeof(HEADER) - 1, "no camera" },
		{ ROW, sizeof(ROW) - 1, "line 1: not a camera path" },
		{ HEADER ROW "1,2\n", sizeof(HEADER ROW) + 3, "line 3: 2 numbers" },
		{ HEADER "\0" ROW, sizeof(HEADER ROW), "line 2: " },
	};
	struct camera *cameras = NULL;
	struct why why;
	uint32_t count;
	char *longest;

	(void)state;
	for (size_t i = 0; i < ARRAY_LENGTH(cases); i++) {
		assert_int_equal(path_read(cases[i].text, cases[i].length, &cameras, &count, &why),
				 -EUCLEAN);
		assert_non_null(strstr(why.text, cases[i].reason));
		assert_null(cameras);
	}

	longest = malloc(100000);
	assert_non_null(longest);
	memset(longest, ' ', 100000);
	memcpy(longest, HEADER, sizeof(HEADER) - 1);
	assert_int_equal(path_read(longest, 100000, &cameras, &count, &why), -EUCLEAN);
	assert_non_null(strstr(why.text, "line 2: the line is longer"));
	free(longest);

	assert_int_equal(camera_path_read("/nowhere/path.csv", &cameras, &count, &why), -ENOENT);
	assert_non_null(strstr(why.text, "/nowhere/path.csv: "));
}

static void a_camera_without_direction_has_no_view(void **state)
{
	struct camera camera = { .at = { 0, 1, 0 }, .up = { 0, 0, 1 }, .fov_y_degrees = 60 };
	struct camera_view view;

	(void)state;
	assert_int_equal(camera_view_init(&view, &camera, &box_of_2, 1.0, 0.1), 0);
	assert_int_equal(camera_view_init(&view, &camera, &box_of_2, 0.0, 0.1), -EINVAL);
	assert_int_equal(camera_view_init(&view, &camera, &box_of_2, NAN, 0.1), -EINVAL);
	assert_int_equal(camera_view_init(&view, &camera, &box_of_2, 1.0, 0.0), -EINVAL);
	camera.eye[2] = INFINITY;
	assert_int_equal(camera_view_init(&view, &camera, &box_of_2, 1.0, 0.1), -EINVAL);
	camera.eye[2] = 0.0;
	camera.at[1] = 0.0;
	assert_int_equal(camera_view_init(&view, &camera, &box_of_2, 1.0, 0.1), -EINVAL);
}

static void axes_are_orthonormal_even_when_up_lies_along_the_view(void **state)
{
	(void)state;
	for (int i = 0; i < 1000; i++) {
		struct camera camera = { .fov_y_degrees = 60 };
		struct camera_view view;

		for (int k = 0; k < 3; k++) {
			camera.eye[k] = random_sign();
			camera.at[k] = camera.eye[k] + (i % 7 == k ? 1.0 : random_sign());
			/* Sometimes along the view, sometimes nothing at all. */
			camera.up[k] = i % 3 == 0   ? camera.at[k] - camera.eye[k]
				       : i % 3 == 1 ? 0.0
						    : random_sign();
		}
		assert_int_equal(camera_view_init(&view, &camera, &box_of_2, 1.5, 0.1), 0);
		assert_true(fabs(vector_dot(view.right, view.up)) < 1e-12);
		assert_true(fabs(vector_dot(view.right, view.forward)) < 1e-12);
		assert_true(fabs(vector_dot(view.up, view.forward)) < 1e-12);
		assert_true(fabs(vector_dot(view.up, view.up) - 1.0) < 1e-12);
		assert_true(fabs(vector_dot(view.right, view.right) - 1.0) < 1e-12);
	}
}

static void planes_and_projection_agree_on_what_is_in_view(void **state)
{
	unsigned inside_count = 0;

	(void)state;
	for (int i = 0; i < 20000; i++) {
		struct camera camera = { .up = { 0, 0, 1 },
					 .fov_y_degrees = 85 + 80 * random_sign() };
		struct camera_view view;
		double point[3];
		double clip[4];
		double margin = INFINITY;
		double outside = -INFINITY;
		bool inside;

		for (int k = 0; k < 3; k++) {
			camera.eye[k] = random_sign();
			camera.at[k] = camera.eye[k] + random_sign();
			point[k] = camera.eye[k] + 2.0 * random_sign();
		}
		assert_int_equal(camera_view_init(&view, &camera, &box_of_2, 1.5, 0.1), 0);
		for (int k = 0; k < 5; k++)
			margin =
				fmin(margin, vector_dot(view.planes[k], point) + view.planes[k][3]);
		for (int k = 0; k < 4; k++) {
			clip[k] = view.view_projection[k][3];
			for (int j = 0; j < 3; j++)
				clip[k] += view.view_projection[k][j] * (point[j] - view.anchor[j]);
		}
		outside = fmax(fabs(clip[0]), fmax(fabs(clip[1]), clip[2])) - clip[3];
		inside = outside <= 0.0;
		/* Both are in doubt within a rounding error of the border. */
		if (fabs(margin) < 1e-5 || fabs(outside) < 1e-5)
			continue;
		assert_int_equal(margin > 0.0, inside);
		inside_count += inside;
	}
	assert_true(inside_count > 1000);
}

static void the_anchor_is_the_grid_point_nearest_to_the_eye(void **state)
{
	static const double origins[] = { 0.0, 1e3, -1e5, 1e7 };
	static const double node_origin[3] = { 2.5, -3.25, 0.0078125 };

	(void)state;
	for (size_t i = 0; i < ARRAY_LENGTH(origins); i++) {
		struct store_superblock superblock = { .step_exponent = -10 };
		struct camera camera = { .up = { 0, 0, 1 }, .fov_y_degrees = 60 };
		struct camera_view view;
		float offset[3];

		for (int k = 0; k < 3; k++) {
			superblock.origin[k] = origins[i];
			camera.eye[k] = origins[i] + 0.3 * (k + 1);
			camera.at[k] = camera.eye[k] + k;
		}
		assert_int_equal(camera_view_init(&view, &camera, &superblock, 1.0, 0.1), 0);
		camera_node_offset(&view, node_origin, offset);
		for (int k = 0; k < 3; k++) {
			double steps = view.anchor[k] * 1024.0;

			assert_true(steps == floor(steps));
			assert_true(fabs(view.anchor[k] - view.eye[k]) <= 0x1p-11);
			/* No bit of the offset is lost. */
			assert_true((double)offset[k] == node_origin[k] - view.anchor[k]);
		}
	}
}

/* gcc 12 with -O3 loses the rounding where it turns such a loop into vectors. */
static void the_anchor_of_a_store_of_floats_is_a_float(void **state)
{
	static const struct store_superblock floats = { .step_exponent = STORE_STEP_NONE };

	(void)state;
	for (int i = 0; i < 1000; i++) {
		struct camera camera = { .up = { 0, 0, 1 }, .fov_y_degrees = 60 };
		struct camera_view view;

		for (int k = 0; k < 3; k++) {
			camera.eye[k] = 50.0 * random_sign();
			camera.at[k] = camera.eye[k] + random_sign();
		}
		assert_int_equal(camera_view_init(&view, &camera, &floats, 1.0, 0.1), 0);
		for (int k = 0; k < 3; k++) {
			volatile float rounded = (float)view.anchor[k];

			assert_true((double)rounded == view.anchor[k]);
			assert_true(fabs(view.anchor[k] - view.eye[k]) <= 50.0 * 0x1p-24);
		}
	}
}

static void a_framed_model_is_in_view_and_fills_the_picture(void **state)
{
	(void)state;
	for (uint32_t up_axis = STORE_AXIS_UNKNOWN; up_axis < STORE_AXIS_COUNT_; up_axis++) {
		for (int i = 0; i < 200; i++) {
			struct store_superblock superblock = { .triangle_count = 1,
							       .step_exponent = -10,
							       .up_axis = up_axis };
			const struct store_superblock *superblocks[] = { &superblock };
			double aspect = exp(random_sign());
			struct camera camera;
			struct camera_view view;
			double largest = 0.0;

			for (int k = 0; k < 3; k++) {
				superblock.origin[k] = 1e6 * random_sign();
				superblock.box_min[k] = random_sign();
				superblock.box_max[k] =
					superblock.box_min[k] + exp(3.0 * random_sign());
			}
			camera_frame_all(&camera, superblocks, 1, aspect, 45.0);
			assert_int_equal(camera_view_init(&view, &camera, &superblock, aspect,
							  camera_near(&camera, &superblock)),
					 0);
			assert_true(camera.up[up_axis == STORE_AXIS_UNKNOWN ? 2 : up_axis - 1] ==
				    1.0);
			for (unsigned corner = 0; corner < 8; corner++) {
				double from_eye[3];
				double depth;

				for (unsigned k = 0; k < 3; k++)
					from_eye[k] = (corner >> k & 1 ? superblock.box_max[k]
								       : superblock.box_min[k]) -
						      view.eye[k];
				depth = vector_dot(view.forward, from_eye);
				assert_true(depth > view.near);
				largest = fmax(largest, fabs(vector_dot(view.right, from_eye)) /
								depth / view.tan_half_x);
				largest = fmax(largest, fabs(vector_dot(view.up, from_eye)) /
								depth / view.tan_half_y);
			}
			assert_true(largest < 1.0 && largest > 0.8);
		}
	}
}

static void a_model_of_nothing_or_one_point_can_be_framed(void **state)
{
	struct store_superblock superblock = { .step_exponent = STORE_STEP_NONE };
	const struct store_superblock *superblocks[] = { &superblock, &box_of_2 };
	struct camera_view view;
	struct camera camera;

	(void)state;
	for (uint32_t count = 1; count <= 2; count++) {
		camera_frame_all(&camera, superblocks, count, 1.5, 45.0);
		assert_int_equal(camera_view_init(&view, &camera, &superblock, 1.5,
						  camera_near(&camera, &superblock)),
				 0);
	}
	memcpy(camera.eye, superblock.origin, sizeof(camera.eye));
	assert_true(camera_near(&camera, &superblock) > 0.0);
}

int main(void)
{
	static const struct CMUnitTest tests[] = {
		cmocka_unit_test(a_row_brings_every_double_back_exactly),
		cmocka_unit_test(a_row_may_have_blanks_and_a_line_end),
		cmocka_unit_test(a_row_that_is_no_camera_is_refused_with_a_reason),
		cmocka_unit_test(a_path_file_comes_back_as_it_was_written),
		cmocka_unit_test(a_bad_path_file_is_refused_with_its_line),
		cmocka_unit_test(a_camera_without_direction_has_no_view),
		cmocka_unit_test(axes_are_orthonormal_even_when_up_lies_along_the_view),
		cmocka_unit_test(planes_and_projection_agree_on_what_is_in_view),
		cmocka_unit_test(the_anchor_is_the_grid_point_nearest_to_the_eye),
		cmocka_unit_test(the_anchor_of_a_store_of_floats_is_a_float),
		cmocka_unit_test(a_framed_model_is_in_view_and_fills_the_picture),
		cmocka_unit_test(a_model_of_nothing_or_one_point_can_be_framed),
	};

	return TEST_RUN(tests);
}
