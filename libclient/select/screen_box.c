/* SPDX-License-Identifier: MIT */
#include "libclient/select/screen_box.h"

#include <math.h>

/** What depths of triangles and of planes are off by, relative to the nearest depth of the box. */
#define DEPTH_SLACK 1e-5
/** A few of a float's last bits. */
#define FLOAT_SLACK 0x1p-21
/**
 * What the corners are off by where the near plane cuts a triangle, relative to its distance: a sum of
 * floats as large as the triangle's own corners.
 */
#define CUT_SLACK 0x1p-22
/** Closer to the near plane than this, rounding may let it cut a box. */
#define NEAR_MARGIN 1.01

/* fmin() and fmax() are calls, for the sake of values that are not numbers; there are none here. */
static inline double lesser(double a, double b)
{
	return a < b ? a : b;
}

static inline double greater(double a, double b)
{
	return a > b ? a : b;
}

/* The range of what was projected so far, in shares of the screen from its middle. */
struct range {
	double low[2];
	double high[2];
};

static void range_add(struct range *range, const struct camera_view *view, const double at[3])
{
	const double tan_half[2] = { view->tan_half_x, -view->tan_half_y };

	for (unsigned axis = 0; axis < 2; axis++) {
		double share = 0.5 * at[axis] / (at[2] * tan_half[axis]);

		range->low[axis] = lesser(range->low[axis], share);
		range->high[axis] = greater(range->high[axis], share);
	}
}

/* Where the edges of a box meet the near plane, between corners behind it and others. */
static void range_add_cut(struct range *range, const struct camera_view *view,
			  const double corners[8][3])
{
	for (unsigned from = 0; from < 8; from++)
		for (unsigned axis = 0; axis < 3; axis++) {
			const double *behind = corners[from];
			const double *before = corners[from ^ 1u << axis];
			double at[3] = { 0.0, 0.0, view->near };
			double t;

			if (behind[2] >= view->near || before[2] < view->near)
				continue;
			t = (view->near - behind[2]) / (before[2] - behind[2]);
			for (unsigned k = 0; k < 2; k++)
				at[k] = behind[k] + t * (before[k] - behind[k]);
			range_add(range, view, at);
		}
}

/* The corners of a box along right, up and forward, from the eye.  Returns: the farthest's reach. */
static double corners_set(const struct camera_view *view, const float box_min[3],
			  const float box_max[3], double ret[8][3])
{
	const double *const axes[3] = { view->right, view->up, view->forward };
	double reach = 0.0;

	for (unsigned corner = 0; corner < 8; corner++)
		for (unsigned axis = 0; axis < 3; axis++) {
			ret[corner][axis] = 0.0;
			for (unsigned k = 0; k < 3; k++)
				ret[corner][axis] += axes[axis][k] *
						     ((corner >> k & 1 ? box_max[k] : box_min[k]) -
						      view->eye[k]);
			reach = greater(reach, fabs(ret[corner][axis]));
		}
	return reach;
}

/*
 * The samples that the box before the near plane may touch.
 *
 * ret_slack:  what depths of triangles in it may be off by.
 *
 * Returns: false when there are none.
 */
static bool rectangle_set(struct screen_box *ret, const struct camera_view *view,
			  const uint32_t side[2], const float box_min[3], const float box_max[3],
			  double *ret_slack)
{
	struct range range = { { INFINITY, INFINITY }, { -INFINITY, -INFINITY } };
	double corners[8][3];
	double reach = corners_set(view, box_min, box_max, corners);
	double nearest = INFINITY;
	double cut = 0.0;

	for (unsigned corner = 0; corner < 8; corner++) {
		nearest = lesser(nearest, corners[corner][2]);
		if (corners[corner][2] >= view->near)
			range_add(&range, view, corners[corner]);
	}
	if (nearest < view->near * NEAR_MARGIN) {
		range_add_cut(&range, view, (const double(*)[3])corners);
		cut = CUT_SLACK * reach / view->near;
		nearest = view->near;
	}
	for (unsigned axis = 0; axis < 2; axis++) {
		double margin = SCREEN_BOX_MARGIN + 0.5 + cut * side[axis];
		double low = ceil((0.5 + range.low[axis]) * side[axis] - margin);
		double high = floor((0.5 + range.high[axis]) * side[axis] + margin - 1.0);

		range.low[axis] = greater(low, 0.0);
		range.high[axis] = lesser(high, side[axis] - 1.0);
		if (!(range.low[axis] <= range.high[axis]))
			return false;
	}
	ret->rectangle =
		(struct screen_rectangle){ (uint32_t)range.low[0], (uint32_t)range.low[1],
					   (uint32_t)range.high[0], (uint32_t)range.high[1] };
	*ret_slack = DEPTH_SLACK * view->near / nearest + cut;
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
	double slack;

	ret->front_count = 0;
	ret->back_count = 0;
	if (!rectangle_set(ret, view, side, box_min, box_max, &slack))
		return false;
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
