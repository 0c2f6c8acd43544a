/* SPDX-License-Identifier: MIT */
/**
 * arena_buffers.h - OpenGL buffers that are the daemon's memory: nothing is copied.
 *
 * GL_AMD_pinned_memory makes a buffer of a mapping.  One buffer covers one segment of a store's
 * arena and lives as long as the segment.  A payload may be drawn while it is held, and the hold must
 * outlive the draws: whoever draws finishes them before the next set goes out (frame.h).
 *
 * Threads: the GL thread, which is also the client's.
 */
#ifndef VIEWER_ARENA_BUFFERS_H
#define VIEWER_ARENA_BUFFERS_H

#include <stdbool.h>
#include <stdint.h>

#include "libclient/ooc/client.h"
#include "viewer/gpu_payload.h"
#include "viewer/renderer.h"

struct arena_buffers;

/**
 * Draws a payload from a read-only mapping, changes it through another one, and draws again: a
 * driver that copies, refuses read-only pages or caches what it read does not pass.
 */
bool arena_buffers_work(struct renderer *renderer);

/** Returns: 0 or -ENOMEM. */
int arena_buffers_create(struct arena_buffers **ret);
struct arena_buffers *arena_buffers_destroy(struct arena_buffers *buffers);

/** Gives up the buffers of segments that are gone.  Once a frame. */
void arena_buffers_sweep(struct arena_buffers *buffers);

/**
 * Finds a drawable node.
 *
 * store_index:  which of the world's stores; the same for the same store, always.
 *
 * Returns: 0, -EAGAIN while it is not drawable, -ENOMEM when GL made no buffer of its segment.
 */
int arena_buffers_find(struct arena_buffers *buffers, uint32_t store_index,
		       const struct ooc_store *store, uint32_t node, struct gpu_payload *ret,
		       struct ooc_place *ret_place);

#endif /* VIEWER_ARENA_BUFFERS_H */
