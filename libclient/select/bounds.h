/* SPDX-License-Identifier: MIT */
/**
 * bounds.h - tight boxes against a view.
 *
 * Threads: any; pure functions.
 */
#ifndef LIBCLIENT_SELECT_BOUNDS_H
#define LIBCLIENT_SELECT_BOUNDS_H

#include <stdbool.h>
#include <stdint.h>

#include "formats/store/layout.h"
#include "libclient/select/camera.h"
#include "libclient/select/places.h"

/** A tight box as half sums and half differences, which is what a plane test needs. */
struct bounds {
	float centre[3];
	float half[3]; /* negative: nothing to draw below */
};

#define VIEW_PLANES 5

/** Planes and eye in the precision of the boxes. */
struct view_planes {
	double plane[VIEW_PLANES][4];
	double abs_sum[VIEW_PLANES]; /* |a| + |b| + |c|: reach of a cube of half size 1 */
	double eye[3];
};

enum side {
	SIDE_OUTSIDE,
	SIDE_CROSSING,
	SIDE_INSIDE
};

static inline bool node_is_leaf(const struct store_node *node)
{
	return node->first_child == STORE_NODE_NONE;
}

/** Does selecting it draw something?  A leaf without payload is air. */
static inline bool node_is_drawn(const struct store_node *node)
{
	return node_is_leaf(node) && node->payload_id != 0;
}

static inline bool bounds_are_empty(const struct bounds *bounds)
{
	return bounds->half[0] < 0.0f;
}

/** Fills bounds[node_count]: of a leaf its tight box, of an inner node that of all leaves below. */
void bounds_of_nodes(const struct store_node *nodes, uint32_t node_count, struct bounds *bounds);

void view_planes_set(struct view_planes *planes, const struct camera_view *view);

enum side bounds_side(const struct view_planes *planes, const struct bounds *bounds);

/** The walk ignores the near plane: what it cuts off may still lead to what is seen. */
bool cube_in_view(const struct view_planes *planes, const struct cube *cube);

/** Squared distance of the eye; 0 inside. */
double bounds_distance2(const struct view_planes *planes, const struct bounds *bounds);
double cube_distance2(const struct view_planes *planes, const struct cube *cube);

#endif /* LIBCLIENT_SELECT_BOUNDS_H */
