/* SPDX-License-Identifier: MIT */
/**
 * raster.h - a software rasteriser of items: depth and an id for each pixel, without GL.
 *
 * It samples pixel centres as GL does: positions snapped to 1/256 pixel, top-left rule, near-plane
 * clipping, reversed-Z with the larger depth kept, ties to the lower id.  Both sides of a triangle
 * are drawn.  It shades nothing.
 *
 * Threads: a struct raster belongs to one thread.
 */
#ifndef LIBCLIENT_SELECT_RASTER_H
#define LIBCLIENT_SELECT_RASTER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "libclient/select/camera.h"
#include "libclient/select/screen_box.h"

#define RASTER_ITEM_NONE UINT64_MAX

/**
 * Depth is pushed back by so many pixels of its steepest slope: glPolygonOffset()'s factor.
 *
 * Depth is a plane through the vertices, but the pixels are those of the vertices as they are snapped,
 * up to half a subpixel away on each axis.  There the plane of a triangle seen edge-on reaches beyond
 * its own depths without a bound, so that it would show before the box that holds it.  A subpixel of
 * the steepest slope takes that back: no pixel is nearer than the nearest vertex.  A second one is for
 * the rounding of the plane.
 */
#define RASTER_DEPTH_OFFSET (-0x1p-7f)

struct raster;

/** Returns: 0, -EINVAL (a side is 0 or above 16384) or -ENOMEM. */
int raster_create(uint32_t width, uint32_t height, struct raster **ret);
struct raster *raster_destroy(struct raster *raster);
void raster_clear(struct raster *raster);

/**
 * Draws triangles of positions as a payload has them.
 *
 * positions:   vertex_count x 3 floats, before scale and offset (camera.h).
 * indices:     triangle_count x 3, each < vertex_count.
 * items:       triangle_count ids, or NULL: item_first + number of the triangle.
 */
struct raster_draw {
	const float *positions;
	uint32_t vertex_count;
	const uint32_t *indices;
	uint32_t triangle_count;
	const uint64_t *items;
	uint64_t item_first;
	float scale;
	float offset[3];
};

/** Returns: 0 or -ENOMEM. */
int raster_triangles(struct raster *raster, const struct camera_view *view,
		     const struct raster_draw *draw);

/**
 * Draws a payload that payload_validate() has passed, as it lies in memory.  Triangle t of it is
 * item_first + t * item_step: with a step of 0 the payload is one item.
 *
 * Returns: 0 or -ENOMEM.
 */
int raster_draw_payload(struct raster *raster, const struct camera_view *view, const void *payload,
			uint64_t item_first, uint64_t item_step);

/**
 * Lets the rasteriser keep the farthest depth of each square of pixels, for raster_shows().
 *
 * Returns: 0 or -ENOMEM.
 */
int raster_keep_farthest(struct raster *raster);

/**
 * Says whether something in a box may show: whether a pixel that the box touches has the box's depth
 * there, or a farther one.  raster_keep_farthest() came before; the box is on a screen of this size.
 *
 * Cost: a look at each square of 64 x 64 pixels that the box touches, where that does not decide it
 * at those of 8 x 8 in it, and then at pixels.
 */
bool raster_shows(struct raster *raster, const struct screen_box *box);

/** width x height, top row first; RASTER_ITEM_NONE and depth 0 where nothing was drawn. */
const uint64_t *raster_items(const struct raster *raster);
const float *raster_depths(const struct raster *raster);

#endif /* LIBCLIENT_SELECT_RASTER_H */
