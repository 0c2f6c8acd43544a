/* SPDX-License-Identifier: MIT */
/**
 * coverage.h - how many pixels of a picture a node probably shows, by the HS alone.
 *
 * A coarse picture keeps the share of the light that gets through what was put into it, nearest
 * first.  A node is seen as a box with its triangles spread in it evenly: it catches
 * 1 - exp(-c * area / section) of the light that falls on its tight box.
 *
 * Threads: a struct coverage belongs to one thread.
 */
#ifndef LIBCLIENT_SELECT_COVERAGE_H
#define LIBCLIENT_SELECT_COVERAGE_H

#include "libclient/select/bounds.h"
#include "libclient/select/camera.h"
#include "libclient/select/hiding.h"

/** Squares of the picture.  A node that is smaller than a square dims it by its part of it. */
#define COVERAGE_WIDTH  64
#define COVERAGE_HEIGHT 48
/** Squares along a side of a part of the picture in which all is seen along the same direction. */
#define COVERAGE_PART 8

struct coverage {
	const struct camera_view *view;
	float scale[2]; /* squares a unit of tangent */
	float through[COVERAGE_HEIGHT][COVERAGE_WIDTH];
	struct hiding_direction along[COVERAGE_HEIGHT / COVERAGE_PART]
				     [COVERAGE_WIDTH / COVERAGE_PART];
};

/** Begins with an empty picture.  The view outlives it. */
void coverage_begin(struct coverage *coverage, const struct camera_view *view);

/**
 * Puts a leaf into the picture, behind what is in it.
 *
 * Returns: how many squares it probably shows.
 */
float coverage_add(struct coverage *coverage, const struct hiding *hiding,
		   const struct bounds *bounds, uint32_t leaf);

#endif /* LIBCLIENT_SELECT_COVERAGE_H */
