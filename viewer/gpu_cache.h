/* SPDX-License-Identifier: MIT */
/**
 * gpu_cache.h - payloads copied into OpenGL buffers, at most so many bytes of them.
 *
 * For drivers that cannot draw from the daemon's memory.  What was drawn longest ago goes first.
 * A copy stays right as long as its store is open: a node's payload never changes.
 *
 * Threads: the GL thread.
 */
#ifndef VIEWER_GPU_CACHE_H
#define VIEWER_GPU_CACHE_H

#include <stdbool.h>
#include <stdint.h>

#include "viewer/gpu_payload.h"

struct gpu_cache;

/** Returns: 0 or -ENOMEM. */
int gpu_cache_create(uint64_t bytes_max, struct gpu_cache **ret);
struct gpu_cache *gpu_cache_destroy(struct gpu_cache *cache);

/** A new frame: what earlier ones drew may go. */
void gpu_cache_begin(struct gpu_cache *cache);

/** A copy that is there; it is now drawn in this frame.  Returns: false when there is none. */
bool gpu_cache_find(struct gpu_cache *cache, uint32_t store_index, uint32_t node,
		    struct gpu_payload *ret);

/**
 * Copies a payload.
 *
 * may_replace:  copies that this frame has drawn may go for it; GL keeps them until they are drawn.
 *
 * Returns: 0, -ENOBUFS when there is no room in this frame, or -ENOMEM.
 */
int gpu_cache_add(struct gpu_cache *cache, uint32_t store_index, uint32_t node, const void *payload,
		  uint32_t payload_bytes, bool may_replace);

/** Forgets a copy, if there is one. */
void gpu_cache_remove(struct gpu_cache *cache, uint32_t store_index, uint32_t node);

uint64_t gpu_cache_bytes(const struct gpu_cache *cache);

#endif /* VIEWER_GPU_CACHE_H */
