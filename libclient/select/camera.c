/* SPDX-License-Identifier: MIT */
#include "libclient/select/camera.h"

#include <errno.h>
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/check.h"
#include "formats/base/text.h"
#include "libclient/select/vector.h"

#define CAMERA_NUMBERS         11
#define CAMERA_FOV_MIN_DEGREES 1.0
#define CAMERA_FOV_MAX_DEGREES 170.0
/** Rows of path files are shorter than this, with room for blanks. */
#define CAMERA_LINE_BYTES 1024

const char camera_path_header[] = "t,eye_x,eye_y,eye_z,at_x,at_y,at_z,up_x,up_y,up_z,fov_y";

/* ---- vectors ---- */

/* False, and v unchanged, when it has no direction. */
static bool normalise3(double v[3])
{
	/* Scaled first: the square of a tiny or a huge component is 0 or infinite. */
	double largest = fmax(fabs(v[0]), fmax(fabs(v[1]), fabs(v[2])));
	double scaled[3];
	double length;

	if (!(largest > 0.0) || !isfinite(largest))
		return false;
	for (int i = 0; i < 3; i++)
		scaled[i] = v[i] / largest;
	length = sqrt(vector_dot(scaled, scaled));
	for (int i = 0; i < 3; i++)
		v[i] = scaled[i] / length;
	return true;
}

bool camera_axes(const struct camera *camera, double right[3], double up[3], double forward[3])
{
	double wanted_up[3] = { camera->up[0], camera->up[1], camera->up[2] };
	int least = 0;

	for (int i = 0; i < 3; i++)
		forward[i] = camera->at[i] - camera->eye[i];
	if (!normalise3(forward))
		return false;
	if (normalise3(wanted_up)) {
		vector_cross(forward, wanted_up, right);
		if (vector_dot(right, right) > 1e-20 && normalise3(right)) {
			vector_cross(right, forward, up);
			return normalise3(up);
		}
	}
	for (int i = 1; i < 3; i++)
		if (fabs(forward[i]) < fabs(forward[least]))
			least = i;
	for (int i = 0; i < 3; i++)
		wanted_up[i] = i == least ? 1.0 : 0.0;
	vector_cross(forward, wanted_up, right);
	(void)normalise3(right);
	vector_cross(right, forward, up);
	return normalise3(up);
}

/* What is wrong with a camera, or NULL. */
static const char *camera_fault(const struct camera *camera)
{
	double right[3];
	double up[3];
	double forward[3];

	for (int i = 0; i < 3; i++)
		if (!isfinite(camera->eye[i]) || !isfinite(camera->at[i]) ||
		    !isfinite(camera->up[i]))
			return "it has a number that is not finite";
	if (!isfinite(camera->time_s))
		return "its time is not finite";
	if (!(camera->fov_y_degrees >= CAMERA_FOV_MIN_DEGREES &&
	      camera->fov_y_degrees <= CAMERA_FOV_MAX_DEGREES))
		return "fov_y is not within 1 to 170 degrees";
	if (!camera_axes(camera, right, up, forward))
		return "eye and at are the same point, so it looks nowhere";
	return NULL;
}

/* ---- the transform ---- */

/* The nearest point of the store's grid; of the floats where positions are raw floats. */
static double grid_round(const struct store_superblock *superblock, double value)
{
	double step;

	if (superblock->step_exponent == STORE_STEP_NONE)
		return (double)(float)value;
	step = ldexp(1.0, superblock->step_exponent);
	/* Beyond 2^53 steps a double has no finer point than the value itself. */
	return fabs(value) / step < 0x1p53 ? nearbyint(value / step) * step : value;
}

static void plane_set(double plane[4], const double eye[3], const double axis[3],
		      const double forward[3], double axis_sign, double tan_half)
{
	for (int i = 0; i < 3; i++)
		plane[i] = axis_sign * axis[i] + tan_half * forward[i];
	/* axis and forward are orthonormal, so there is always a direction. */
	(void)normalise3(plane);
	plane[3] = -vector_dot(plane, eye);
}

int camera_view_init(struct camera_view *ret, const struct camera *camera,
		     const struct store_superblock *superblock, double aspect, double near)
{
	struct camera_view view = { .near = near };
	double from_eye[3];

	if (camera_fault(camera) || !(aspect > 0.0) || !isfinite(aspect) || !(near > 0.0) ||
	    !isfinite(near))
		return -EINVAL;

	(void)camera_axes(camera, view.right, view.up, view.forward);
	view.tan_half_y = tan(camera->fov_y_degrees * (M_PI / 360.0));
	view.tan_half_x = view.tan_half_y * aspect;
	for (int i = 0; i < 3; i++) {
		view.eye[i] = camera->eye[i] - superblock->origin[i];
		view.anchor[i] = grid_round(superblock, view.eye[i]);
		from_eye[i] = view.anchor[i] - view.eye[i];
	}

	for (int i = 0; i < 3; i++) {
		view.view_projection[0][i] = (float)(view.right[i] / view.tan_half_x);
		view.view_projection[1][i] = (float)(view.up[i] / view.tan_half_y);
		view.view_projection[3][i] = (float)view.forward[i];
	}
	view.view_projection[0][3] = (float)(vector_dot(view.right, from_eye) / view.tan_half_x);
	view.view_projection[1][3] = (float)(vector_dot(view.up, from_eye) / view.tan_half_y);
	/* Infinite reversed-Z: the depth is near / w. */
	view.view_projection[2][3] = (float)near;
	view.view_projection[3][3] = (float)vector_dot(view.forward, from_eye);

	plane_set(view.planes[0], view.eye, view.right, view.forward, 1.0, view.tan_half_x);
	plane_set(view.planes[1], view.eye, view.right, view.forward, -1.0, view.tan_half_x);
	plane_set(view.planes[2], view.eye, view.up, view.forward, 1.0, view.tan_half_y);
	plane_set(view.planes[3], view.eye, view.up, view.forward, -1.0, view.tan_half_y);
	memcpy(view.planes[4], view.forward, sizeof(view.forward));
	view.planes[4][3] = -vector_dot(view.forward, view.eye) - near;
	*ret = view;
	return 0;
}

void camera_node_offset(const struct camera_view *view, const double payload_origin[3],
			float ret[3])
{
	for (int i = 0; i < 3; i++)
		ret[i] = (float)(payload_origin[i] - view->anchor[i]);
}

/* ---- cameras that suit a model ---- */

/* The box of a store in the world.  A store without triangles has a box of no size. */
static void world_box(const struct store_superblock *superblock, double ret_min[3],
		      double ret_max[3])
{
	for (int i = 0; i < 3; i++) {
		bool is_empty = superblock->triangle_count == 0;

		ret_min[i] = superblock->origin[i] + (is_empty ? 0.0 : superblock->box_min[i]);
		ret_max[i] = superblock->origin[i] + (is_empty ? 0.0 : superblock->box_max[i]);
	}
}

double camera_near(const struct camera *camera, const struct store_superblock *superblock)
{
	double box_min[3];
	double box_max[3];
	double distance2 = 0.0;
	double diagonal2 = 0.0;
	double near;

	world_box(superblock, box_min, box_max);
	for (int i = 0; i < 3; i++) {
		double outside = fmax(box_min[i] - camera->eye[i], camera->eye[i] - box_max[i]);

		if (outside > 0.0)
			distance2 += outside * outside;
		diagonal2 += (box_max[i] - box_min[i]) * (box_max[i] - box_min[i]);
	}
	/*
	 * Reversed-Z has the same relative precision at any depth, so a small one costs nothing;
	 * 1/100 of the distance keeps the corners of the widest view in front of the plane.
	 */
	near = fmax(1e-5 * sqrt(diagonal2), 0.01 * sqrt(distance2));
	return near > 0.0 && isfinite(near) ? near : 1.0;
}

/*
 * Where the eye must be, from the box's centre along right, up and forward, so that the box just fits:
 * of all corners c, c.right - eye.right <= tan_half_x * (c.forward - eye.forward) and so on for each
 * side.  Opposite sides added say how far back the eye has to go, subtracted where the middle is.
 */
static void framing_eye(const double half[3], const double *const axes[3], const double tan_half[2],
			double ret[3])
{
	ret[2] = INFINITY;
	for (unsigned side = 0; side < 2; side++) {
		double least = -INFINITY;
		double most = -INFINITY;

		for (unsigned corner = 0; corner < 8; corner++) {
			double at[3];
			double reach;
			double place;

			for (unsigned i = 0; i < 3; i++)
				at[i] = corner >> i & 1 ? half[i] : -half[i];
			reach = tan_half[side] * vector_dot(axes[2], at);
			place = vector_dot(axes[side], at);
			most = fmax(most, place - reach);
			least = fmax(least, -place - reach);
		}
		ret[side] = 0.5 * (most - least);
		ret[2] = fmin(ret[2], -0.5 * (most + least) / tan_half[side]);
	}
}

void camera_frame_all(struct camera *ret, const struct store_superblock *const *superblocks,
		      uint32_t superblock_count, double aspect, double fov_y_degrees)
{
	/* To the model's right, towards its back, and down: three sides are seen, the front best. */
	static const double view_direction[3] = { -0.5, 0.8, -0.45 };
	struct camera camera = { .fov_y_degrees = fov_y_degrees };
	double box_min[3] = { INFINITY, INFINITY, INFINITY };
	double box_max[3] = { -INFINITY, -INFINITY, -INFINITY };
	double half[3];
	double right[3];
	double up[3];
	double forward[3];
	/* A little is left free on each side. */
	double tan_half_y = tan(fov_y_degrees * (M_PI / 360.0)) / 1.05;
	const double tan_half[2] = { tan_half_y * aspect, tan_half_y };
	const double *const axes[3] = { right, up, forward };
	double eye[3];
	int up_axis = 2;

	CHECK(superblock_count > 0);
	for (uint32_t i = superblock_count; i-- > 0;) {
		double store_min[3];
		double store_max[3];

		world_box(superblocks[i], store_min, store_max);
		for (int k = 0; k < 3; k++) {
			box_min[k] = fmin(box_min[k], store_min[k]);
			box_max[k] = fmax(box_max[k], store_max[k]);
		}
		/* The first store that knows which way is up decides. */
		if (superblocks[i]->up_axis != STORE_AXIS_UNKNOWN)
			up_axis = (int)superblocks[i]->up_axis - STORE_AXIS_X;
	}

	/* Cyclic, so that the axes stay right-handed whichever of them points up. */
	for (int i = 0; i < 3; i++)
		camera.at[(up_axis + 1 + i) % 3] = view_direction[i];
	camera.up[up_axis] = 1.0;
	(void)camera_axes(&camera, right, up, forward);
	for (int i = 0; i < 3; i++)
		half[i] = 0.5 * (box_max[i] - box_min[i]);
	framing_eye(half, axes, tan_half, eye);
	if (!(eye[2] < 0.0))
		eye[2] = -1.0;
	for (int i = 0; i < 3; i++) {
		double centre = 0.5 * (box_min[i] + box_max[i]);

		camera.at[i] = centre + eye[0] * right[i] + eye[1] * up[i];
		camera.eye[i] = camera.at[i] + eye[2] * forward[i];
	}
	*ret = camera;
}

/* ---- text ---- */

/* The numbers of a camera in the order of a row. */
static double *camera_number(struct camera *camera, unsigned column)
{
	if (column == 0)
		return &camera->time_s;
	if (column < 4)
		return &camera->eye[column - 1];
	if (column < 7)
		return &camera->at[column - 4];
	if (column < 10)
		return &camera->up[column - 7];
	return &camera->fov_y_degrees;
}

int camera_from_row(struct camera *ret, const char *row, struct why *why)
{
	char line[CAMERA_LINE_BYTES];
	struct camera camera = { 0 };
	unsigned column = 0;
	const char *fault;
	char *rest = line;

	if (strlen(row) >= sizeof(line))
		return why_set(why, -EINVAL, "the row is longer than %zu bytes", sizeof(line) - 1);
	strcpy(line, row);
	while (rest) {
		char *field = strsep(&rest, ",");

		if (column == CAMERA_NUMBERS)
			return why_set(why, -EINVAL, "more than %d numbers; the columns are %s",
				       CAMERA_NUMBERS, camera_path_header);
		field = text_trim(field);
		if (text_to_double(field, camera_number(&camera, column)) < 0)
			return why_set(why, -EINVAL, "column %u, \"%.40s\", is no finite number",
				       column + 1, field);
		column++;
	}
	if (column < CAMERA_NUMBERS)
		return why_set(why, -EINVAL, "%u numbers instead of %d; the columns are %s", column,
			       CAMERA_NUMBERS, camera_path_header);
	fault = camera_fault(&camera);
	if (fault)
		return why_set(why, -EINVAL, "%s", fault);
	*ret = camera;
	return 0;
}

const char *camera_to_row(const struct camera *camera, char *buffer)
{
	struct camera copy = *camera;
	size_t length = 0;

	for (unsigned column = 0; column < CAMERA_NUMBERS; column++)
		length += (size_t)snprintf(buffer + length, CAMERA_ROW_BYTES - length, "%s%.17g",
					   column == 0 ? "" : ",", *camera_number(&copy, column));
	CHECK(length < CAMERA_ROW_BYTES);
	return buffer;
}

/* The next line, trimmed.  Returns: 1, 0 at the end, or a negative errno. */
static int path_line(FILE *file, char line[CAMERA_LINE_BYTES], char **ret, struct why *why)
{
	size_t length;

	if (!fgets(line, CAMERA_LINE_BYTES, file))
		return ferror(file) ? why_errno(why, -errno, "cannot be read") : 0;
	length = strlen(line);
	if ((length == 0 || line[length - 1] != '\n') && !feof(file))
		return why_set(why, -EUCLEAN, "the line is longer than %d bytes, or is no text",
			       CAMERA_LINE_BYTES - 2);
	*ret = text_trim(line);
	return 1;
}

static int path_append(struct camera **cameras, uint32_t *count, const struct camera *camera)
{
	/* Grows whenever the count is a power of two. */
	if ((*count & (*count - 1)) == 0) {
		size_t room = *count == 0 ? 1 : 2 * (size_t)*count;
		struct camera *grown;

		if (*count > UINT32_MAX / 2)
			return -ENOMEM;
		grown = reallocarray(*cameras, room, sizeof(**cameras));
		if (!grown)
			return -ENOMEM;
		*cameras = grown;
	}
	(*cameras)[(*count)++] = *camera;
	return 0;
}

static int path_parse(FILE *file, struct camera **cameras, uint32_t *count, struct why *why)
{
	char line[CAMERA_LINE_BYTES];
	struct camera camera;
	char *text = line;
	int r;

	for (unsigned long number = 1;; number++) {
		r = path_line(file, line, &text, why);
		if (r == 0)
			break;
		if (r > 0 && number == 1 && strcmp(text, camera_path_header) != 0)
			r = why_set(why, -EUCLEAN, "not a camera path: the header must be \"%s\"",
				    camera_path_header);
		else if (r > 0 && number > 1 && *text != '\0') {
			if (camera_from_row(&camera, text, why) < 0)
				r = -EUCLEAN;
			else if (path_append(cameras, count, &camera) < 0)
				r = why_set(why, -ENOMEM, "out of memory");
		}
		if (r < 0) {
			why_prefix(why, "line %lu", number);
			return r;
		}
	}
	if (*count == 0)
		return why_set(why, -EUCLEAN, "there is no camera in it");
	return 0;
}

int camera_path_read(const char *path, struct camera **ret, uint32_t *ret_count, struct why *why)
{
	struct camera *cameras = NULL;
	uint32_t count = 0;
	FILE *file = fopen(path, "re");
	int r;

	if (!file)
		return why_errno(why, -errno, "%s", path);
	r = path_parse(file, &cameras, &count, why);
	(void)fclose(file);
	if (r < 0) {
		why_prefix(why, "%s", path);
		free(cameras);
		return r;
	}
	*ret = cameras;
	*ret_count = count;
	return 0;
}
