/* SPDX-License-Identifier: MIT */
#include "libclient/select/bounds.h"

#include <math.h>
#include <string.h>

#define SIDE_PLANES 4
/*
 * The near plane is tested a little closer: a vertex that the float transform rounds to this side of
 * it is drawn.  (The side planes need no margin, for pixel centres lie half a pixel inside.)
 */
#define NEAR_SLACK 1e-3

static void bounds_set(struct bounds *bounds, const float box_min[3], const float box_max[3])
{
	for (int i = 0; i < 3; i++) {
		double centre = 0.5 * ((double)box_min[i] + box_max[i]);
		double half = 0.5 * ((double)box_max[i] - box_min[i]);

		bounds->centre[i] = (float)centre;
		/* Again rounded up by what the centre lost. */
		bounds->half[i] = (float)(half * (1.0 + 0x1p-22) + fabs(centre) * 0x1p-23);
	}
}

static void bounds_join(struct bounds *bounds, const struct bounds *other)
{
	float box_min[3];
	float box_max[3];

	for (int i = 0; i < 3; i++) {
		box_min[i] = fminf(bounds->centre[i] - bounds->half[i],
				   other->centre[i] - other->half[i]);
		box_max[i] = fmaxf(bounds->centre[i] + bounds->half[i],
				   other->centre[i] + other->half[i]);
	}
	bounds_set(bounds, box_min, box_max);
}

/* Children have higher numbers than their parent, so from behind every child is done first. */
void bounds_of_nodes(const struct store_node *nodes, uint32_t node_count, struct bounds *bounds)
{
	for (uint32_t i = 0; i < node_count; i++)
		bounds[i].half[0] = -1.0f;
	for (uint32_t i = node_count; i-- > 0;) {
		struct bounds *above;

		if (node_is_drawn(&nodes[i]))
			bounds_set(&bounds[i], nodes[i].box_min, nodes[i].box_max);
		if (i == 0 || bounds_are_empty(&bounds[i]))
			continue;
		above = &bounds[nodes[i].parent];
		if (bounds_are_empty(above))
			*above = bounds[i];
		else
			bounds_join(above, &bounds[i]);
	}
}

void view_planes_set(struct view_planes *planes, const struct camera_view *view)
{
	memcpy(planes->plane, view->planes, sizeof(planes->plane));
	memcpy(planes->eye, view->eye, sizeof(planes->eye));
	planes->plane[VIEW_PLANES - 1][3] += NEAR_SLACK * view->near;
	for (int i = 0; i < VIEW_PLANES; i++)
		planes->abs_sum[i] = fabs(view->planes[i][0]) + fabs(view->planes[i][1]) +
				     fabs(view->planes[i][2]);
}

enum side bounds_side(const struct view_planes *planes, const struct bounds *bounds)
{
	enum side side = SIDE_INSIDE;

	for (int i = 0; i < VIEW_PLANES; i++) {
		const double *p = planes->plane[i];
		double distance = p[0] * bounds->centre[0] + p[1] * bounds->centre[1] +
				  p[2] * bounds->centre[2] + p[3];
		double reach = fabs(p[0]) * bounds->half[0] + fabs(p[1]) * bounds->half[1] +
			       fabs(p[2]) * bounds->half[2];

		if (distance < -reach)
			return SIDE_OUTSIDE;
		if (distance < reach)
			side = SIDE_CROSSING;
	}
	return side;
}

bool cube_in_view(const struct view_planes *planes, const struct cube *cube)
{
	for (int i = 0; i < SIDE_PLANES; i++) {
		const double *p = planes->plane[i];

		if (p[0] * cube->centre[0] + p[1] * cube->centre[1] + p[2] * cube->centre[2] +
			    p[3] <
		    -cube->half * planes->abs_sum[i])
			return false;
	}
	return true;
}

double bounds_distance2(const struct view_planes *planes, const struct bounds *bounds)
{
	double sum = 0.0;

	for (int i = 0; i < 3; i++) {
		double outside = fabs(planes->eye[i] - bounds->centre[i]) - bounds->half[i];

		if (outside > 0.0)
			sum += outside * outside;
	}
	return sum;
}

double cube_distance2(const struct view_planes *planes, const struct cube *cube)
{
	struct bounds bounds = { { cube->centre[0], cube->centre[1], cube->centre[2] },
				 { cube->half, cube->half, cube->half } };

	return bounds_distance2(planes, &bounds);
}
