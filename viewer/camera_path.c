/* SPDX-License-Identifier: MIT */
#include "viewer/camera_path.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/text.h"

#define FRAME_COUNT_MAX (1u << 24)
/* Where directions cancel out, what is left of them must be this share of their size to be one. */
#define DIRECTION_SHARE_MIN 1e-6

int camera_path_speed(const char *text, double *ret)
{
	const char *slash = strchr(text, '/');
	double above = 0.0;
	double below = 1.0;
	char head[32];
	int r;

	(void)snprintf(head, sizeof(head), "%.*s", (int)(slash ? slash - text : 31), text);
	r = text_to_double(head, &above);
	if (r == 0 && slash)
		r = text_to_double(slash + 1, &below);
	if (r < 0)
		return r;
	if (!(above / below >= CAMERA_PATH_SPEED_MIN && above / below <= CAMERA_PATH_SPEED_MAX))
		return -ERANGE;
	*ret = above / below;
	return 0;
}

static double between(double a, double b, double share)
{
	return a + share * (b - a);
}

/* Directions between two; where these are opposite there is none, and the first stays. */
static void direction_between(const double a[3], const double b[3], double share, double ret[3])
{
	double size = 0.0;
	double left = 0.0;

	for (int k = 0; k < 3; k++) {
		ret[k] = between(a[k], b[k], share);
		size = fmax(size, fabs(a[k]));
		left = fmax(left, fabs(ret[k]));
	}
	if (left < DIRECTION_SHARE_MIN * size)
		memcpy(ret, a, 3 * sizeof(*ret));
}

static void camera_between(const struct camera *a, const struct camera *b, double share,
			   struct camera *ret)
{
	double view[2][3];
	double direction[3];

	*ret = *a;
	if (share == 0.0)
		return;
	for (int k = 0; k < 3; k++) {
		ret->eye[k] = between(a->eye[k], b->eye[k], share);
		view[0][k] = a->at[k] - a->eye[k];
		view[1][k] = b->at[k] - b->eye[k];
	}
	direction_between(view[0], view[1], share, direction);
	direction_between(a->up, b->up, share, ret->up);
	for (int k = 0; k < 3; k++)
		ret->at[k] = ret->eye[k] + direction[k];
	ret->time_s = between(a->time_s, b->time_s, share);
	ret->fov_y_degrees = between(a->fov_y_degrees, b->fov_y_degrees, share);
}

int camera_path_at_speed(const struct camera *rows, uint32_t count, double speed,
			 struct camera **ret, uint32_t *ret_count)
{
	double frames = floor((double)(count - 1) / speed) + 1.0;
	struct camera *path;

	if (frames > (double)FRAME_COUNT_MAX)
		return -E2BIG;
	path = calloc((size_t)frames, sizeof(*path));
	if (!path)
		return -ENOMEM;
	for (uint32_t frame = 0; frame < (uint32_t)frames; frame++) {
		double place = fmin(frame * speed, (double)(count - 1));
		uint32_t row = (uint32_t)place;
		uint32_t next = row + 1 < count ? row + 1 : row;
		struct camera *camera = &path[frame];

		camera_between(&rows[row], &rows[next], place - row, camera);
		camera->time_s = rows[0].time_s + (camera->time_s - rows[0].time_s) / speed;
	}
	*ret = path;
	*ret_count = (uint32_t)frames;
	return 0;
}
