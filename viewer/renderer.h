/* SPDX-License-Identifier: MIT */
/**
 * renderer.h - draws payloads as they lie, into the target that is bound.
 *
 * The transform is the one of camera.h, to the bit.  It fetches nothing and knows nothing of stores
 * but their views: a payload's attributes are read where they are, its runs' colours through a
 * storage block, and colours, normals and triangle ids that a payload has not are made up for.
 *
 * Threads: the GL thread.
 */
#ifndef VIEWER_RENDERER_H
#define VIEWER_RENDERER_H

#include <stdbool.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "libclient/select/camera.h"
#include "viewer/channel.h"
#include "viewer/gpu_payload.h"

struct renderer;

/** Returns: 0, -EUCLEAN with what the driver says, or -ENOMEM. */
int renderer_create(struct renderer **ret, struct why *why);
struct renderer *renderer_destroy(struct renderer *renderer);

/** The part of a picture that a target shows; the whole is { 1, 1, 0, 0 }. */
struct render_tile {
	float scale_x, scale_y; /* picture's size / tile's size */
	float shift_x, shift_y;
};

extern const struct render_tile render_tile_whole;

struct render_style {
	enum channel channel;
	bool unlit;
	double up[3]; /* of the world, unit */
	struct render_tile tile;
};

/** Begins to draw in a style.  To be called again when anyone else has used GL since. */
void renderer_begin(struct renderer *renderer, const struct render_style *style);

/**
 * What follows belongs to this store.
 *
 * first_seen:  with a second colour attachment, of one unsigned number a pixel, node i of the store
 *              writes first_seen + i there, whatever the channel is.
 */
void renderer_set_view(struct renderer *renderer, const struct camera_view *view,
		       uint32_t store_index, uint32_t first_seen);

/** Draws a payload of triangles. */
void renderer_draw(struct renderer *renderer, const struct gpu_payload *payload,
		   uint32_t node_index);

#endif /* VIEWER_RENDERER_H */
