/* SPDX-License-Identifier: MIT */
/**
 * screen_box.h - a box as it lies on the screen: what part of a rectangle of pixels it may touch, and
 * how near it may be there.
 *
 * 1 / distance is linear in x and y on each of the six planes of a box.  A ray enters the box at the
 * farthest of the planes that face the eye, and leaves it at the nearest of the others.
 *
 * The depth of the nearest corner is no bound: vertices are snapped to subpixels, so a steep triangle
 * is drawn a little beyond its edge, and has a nearer depth there.  Planes are taken with a margin.
 *
 * Threads: any; pure functions.
 */
#ifndef LIBCLIENT_SELECT_SCREEN_BOX_H
#define LIBCLIENT_SELECT_SCREEN_BOX_H

#include <float.h>
#include <stdbool.h>
#include <stdint.h>

#include "libclient/select/camera.h"

/**
 * Pixels by which a box is taken larger on each side.  Snapping moves the corners of what is in it by
 * 1/256, and a triangle is drawn up to so much beyond its edges: this is plenty.
 */
#define SCREEN_BOX_MARGIN 0.25f

/** Pixels x0 .. x1, y0 .. y1, inclusive, rows from the top. */
struct screen_rectangle {
	uint32_t x0, y0, x1, y1;
};

/** depth = at_zero + x * per_x + y * per_y, of pixel centres. */
struct screen_plane {
	float at_zero, per_x, per_y;
};

struct screen_box {
	struct screen_rectangle rectangle; /* all pixels that it may touch */
	struct screen_plane front[3];
	struct screen_plane back[6];
	unsigned front_count;
	unsigned back_count;
};

/**
 * Puts a box on a screen, or what of it lies before the near plane.
 *
 * side:              width and height, pixels.
 * box_min, box_max:  from the store's origin.
 *
 * Returns: false when no sample can be touched: it is beside the screen, behind the near plane, or
 *	between pixel centres.
 */
bool screen_box_set(struct screen_box *ret, const struct camera_view *view, const uint32_t side[2],
		    const float box_min[3], const float box_max[3]);

/**
 * The nearest depth that a triangle inside the box may have in the pixels of a rectangle, with a
 * margin on each side; negative where it cannot touch them.
 */
static inline float screen_box_depth(const struct screen_box *box,
				     const struct screen_rectangle *rectangle)
{
	const float x[2] = { (float)rectangle->x0 - SCREEN_BOX_MARGIN,
			     (float)rectangle->x1 + SCREEN_BOX_MARGIN };
	const float y[2] = { (float)rectangle->y0 - SCREEN_BOX_MARGIN,
			     (float)rectangle->y1 + SCREEN_BOX_MARGIN };
	float enters = FLT_MAX;
	float leaves = 0.0f;

	for (unsigned i = 0; i < box->front_count; i++) {
		const struct screen_plane *plane = &box->front[i];
		float depth = plane->at_zero + plane->per_x * x[plane->per_x > 0.0f] +
			      plane->per_y * y[plane->per_y > 0.0f];

		enters = depth < enters ? depth : enters;
	}
	for (unsigned i = 0; i < box->back_count; i++) {
		const struct screen_plane *plane = &box->back[i];
		float depth = plane->at_zero + plane->per_x * x[plane->per_x < 0.0f] +
			      plane->per_y * y[plane->per_y < 0.0f];

		leaves = depth > leaves ? depth : leaves;
	}
	return enters < leaves ? -1.0f : enters;
}

#endif /* LIBCLIENT_SELECT_SCREEN_BOX_H */
