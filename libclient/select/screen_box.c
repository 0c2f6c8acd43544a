/* SPDX-License-Identifier: MIT */
#include "libclient/select/screen_box.h"

#include <math.h>

/** What depths of triangles and of planes are off by, relative to the nearest depth of the box. */
#define DEPTH_SLACK 1e-5
/** A few of a float's last bits. */
#define FLOAT_SLACK 0x1p-21

/*
 * The corners' rectangle, with a pixel more on each side, and the depth of the nearest corner.
 * Returns: false when it is beside the screen.
 */
static bool rectangle_set(struct screen_box *ret, const struct camera_view *view,
			  const uint32_t side[2], const float box_min[3], const float box_max[3],
			  double *ret_nearest)
{
	double low[2] = { INFINITY, INFINITY };
	double high[2] = { -INFINITY, -INFINITY };
	double nearest = INFINITY;

	for (unsigned corner = 0; corner < 8; corner++) {
		double at[2] = { 0.0, 0.0 };
		double w = 0.0;

		for (unsigned k = 0; k < 3; k++) {
			double from_eye =
				(corner >> k & 1 ? box_max[k] : box_min[k]) - view->eye[k];

			at[0] += view->right[k] * from_eye;
			at[1] -= view->up[k] * from_eye;
			w += view->forward[k] * from_eye;
		}
		nearest = fmin(nearest, w);
		at[0] *= 0.5 / (w * view->tan_half_x);
		at[1] *= 0.5 / (w * view->tan_half_y);
		for (unsigned axis = 0; axis < 2; axis++) {
			low[axis] = fmin(low[axis], at[axis]);
			high[axis] = fmax(high[axis], at[axis]);
		}
	}
	for (unsigned axis = 0; axis < 2; axis++) {
		low[axis] = (0.5 + low[axis]) * side[axis] - 1.5;
		high[axis] = (0.5 + high[axis]) * side[axis] + 0.5;
		if (high[axis] < 0.0 || low[axis] > side[axis] - 1.0)
			return false;
		low[axis] = fmax(low[axis], 0.0);
		high[axis] = fmin(high[axis], side[axis] - 1.0);
	}
	ret->rectangle =
		(struct screen_rectangle){ (uint32_t)low[0], (uint32_t)low[1],
					   (uint32_t)ceil(high[0]), (uint32_t)ceil(high[1]) };
	*ret_nearest = view->near / nearest;
	return true;
}

/*
 * The plane across axis k at a distance from the eye that is not 0.
 *
 * slack:  is added to its depth, and in the same direction what sums of floats are off by: close to
 *	the eye they are differences of large ones.
 */
static struct screen_plane plane_at(const struct camera_view *view, const uint32_t side[2],
				    unsigned k, double distance, double slack)
{
	/* A ray goes to forward + r * right + u * up; r and u are linear in pixels. */
	double factor = view->near / distance;
	double per_x = 2.0 * view->tan_half_x / side[0] * view->right[k];
	double per_y = -2.0 * view->tan_half_y / side[1] * view->up[k];
	double at_zero = view->forward[k] - view->tan_half_x * view->right[k] +
			 view->tan_half_y * view->up[k] + 0.5 * (per_x + per_y);
	double sums = fabs(at_zero) + fabs(per_x) * side[0] + fabs(per_y) * side[1];

	slack += copysign(FLOAT_SLACK * fabs(factor) * sums, slack);

	return (struct screen_plane){ (float)(at_zero * factor + slack), (float)(per_x * factor),
				      (float)(per_y * factor) };
}

bool screen_box_set(struct screen_box *ret, const struct camera_view *view, const uint32_t side[2],
		    const float box_min[3], const float box_max[3])
{
	double nearest;
	double slack;

	ret->front_count = 0;
	ret->back_count = 0;
	if (!rectangle_set(ret, view, side, box_min, box_max, &nearest))
		return false;
	slack = DEPTH_SLACK * nearest;
	for (unsigned k = 0; k < 3; k++) {
		double to_min = box_min[k] - view->eye[k];
		double to_max = box_max[k] - view->eye[k];

		if (to_min > 0.0)
			ret->front[ret->front_count++] = plane_at(view, side, k, to_min, slack);
		else if (to_min < 0.0)
			ret->back[ret->back_count++] = plane_at(view, side, k, to_min, -slack);
		if (to_max < 0.0)
			ret->front[ret->front_count++] = plane_at(view, side, k, to_max, slack);
		else if (to_max > 0.0)
			ret->back[ret->back_count++] = plane_at(view, side, k, to_max, -slack);
	}
	return true;
}
