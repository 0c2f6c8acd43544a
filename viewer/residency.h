/* SPDX-License-Identifier: MIT */
/**
 * residency.h - how a drawable node gets to OpenGL: in place, or copied.
 *
 * In place (arena_buffers.h) where a probe at the start shows that the driver can; copied into a
 * bounded cache (gpu_cache.h) elsewhere, or when it is asked for.
 *
 * Threads: the GL thread, which is also the client's.
 */
#ifndef VIEWER_RESIDENCY_H
#define VIEWER_RESIDENCY_H

#include <stdbool.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "libclient/ooc/client.h"
#include "viewer/gpu_payload.h"
#include "viewer/renderer.h"

/** What `--gpu-cache` is where it is needed and was not given. */
#define RESIDENCY_CACHE_BYTES_DEFAULT (UINT64_C(256) << 20)

struct residency;

/**
 * Chooses the way.
 *
 * gpu_cache_bytes:  0: in place where it works; else copy, into at most so many bytes.
 *
 * Returns: 0 or -ENOMEM.
 */
int residency_create(struct renderer *renderer, uint64_t gpu_cache_bytes, struct residency **ret,
		     struct why *why);
struct residency *residency_destroy(struct residency *residency);

/** Is nothing copied? */
bool residency_is_in_place(const struct residency *residency);

/**
 * A new frame.
 *
 * is_live:  the picture is wanted now: copy only so much in a frame, and nothing twice.
 */
void residency_begin(struct residency *residency, bool is_live);

/** A node that GL can draw now. */
struct resident {
	struct gpu_payload payload;
	bool is_in_place;
	struct ooc_place
		place; /* if it is in place: for ooc_still_valid() when it has been drawn */
};

/**
 * Finds a node, copying it if need be.
 *
 * Returns: 0, -EAGAIN while it is not drawable, -ENOBUFS when it is but not in this frame, or
 *	-ENOMEM when OpenGL has no memory for it.
 */
int residency_find(struct residency *residency, uint32_t store_index, const struct ooc_store *store,
		   uint32_t node, struct resident *ret);

/** Would residency_find() find the node, or could copy it? */
bool residency_has(struct residency *residency, uint32_t store_index, const struct ooc_store *store,
		   uint32_t node);

/** Has anything been copied in this frame?  Else another frame would show no more than this one. */
bool residency_has_copied(const struct residency *residency);

#endif /* VIEWER_RESIDENCY_H */
