/* SPDX-License-Identifier: MIT */
#include "viewer/residency.h"

#include <errno.h>
#include <stdlib.h>

#include "viewer/arena_buffers.h"
#include "viewer/gpu_cache.h"

/* What a live frame may copy: about 10 ms of it. */
#define LIVE_COPY_BYTES_MAX (UINT64_C(32) << 20)

struct residency {
	struct arena_buffers *arena; /* NULL: copy */
	struct gpu_cache *cache;     /* NULL: in place */
	bool is_live;
	uint64_t frame_copied_bytes;
};

static int start_copying(struct residency *residency, uint64_t bytes)
{
	residency->arena = arena_buffers_destroy(residency->arena);
	return gpu_cache_create(bytes ? bytes : RESIDENCY_CACHE_BYTES_DEFAULT, &residency->cache);
}

int residency_create(struct renderer *renderer, uint64_t gpu_cache_bytes, struct residency **ret,
		     struct why *why)
{
	struct residency *residency = calloc(1, sizeof(*residency));
	int r;

	if (!residency)
		return why_errno(why, -ENOMEM, "the cache of nodes");
	if (gpu_cache_bytes == 0 && arena_buffers_work(renderer))
		r = arena_buffers_create(&residency->arena);
	else
		r = start_copying(residency, gpu_cache_bytes);
	if (r < 0) {
		residency_destroy(residency);
		return why_errno(why, r, "the cache of nodes");
	}
	*ret = residency;
	return 0;
}

struct residency *residency_destroy(struct residency *residency)
{
	if (!residency)
		return NULL;
	arena_buffers_destroy(residency->arena);
	gpu_cache_destroy(residency->cache);
	free(residency);
	return NULL;
}

bool residency_is_in_place(const struct residency *residency)
{
	return residency->arena != NULL;
}

void residency_begin(struct residency *residency, bool is_live)
{
	residency->is_live = is_live;
	residency->frame_copied_bytes = 0;
	if (residency->arena)
		arena_buffers_sweep(residency->arena);
	else
		gpu_cache_begin(residency->cache);
}

static int find_copy(struct residency *residency, uint32_t store_index,
		     const struct ooc_store *store, uint32_t node, struct resident *ret)
{
	uint32_t bytes = ooc_nodes(store)[node].payload_bytes;
	struct ooc_place place;
	const void *payload;
	int r;

	ret->is_in_place = false;
	if (gpu_cache_find(residency->cache, store_index, node, &ret->payload))
		return 0;
	/* In this order, so that ooc_still_valid() speaks of what was mapped, or of what came before. */
	if (ooc_locate(store, node, &place) < 0)
		return -EAGAIN;
	payload = ooc_map(store, node);
	if (!payload)
		return -EAGAIN;
	if (residency->is_live && residency->frame_copied_bytes > 0 &&
	    residency->frame_copied_bytes + bytes > LIVE_COPY_BYTES_MAX)
		return -ENOBUFS;
	r = gpu_cache_add(residency->cache, store_index, node, payload, bytes, !residency->is_live);
	if (r < 0)
		return r;
	residency->frame_copied_bytes += bytes;
	/* A daemon that was restarted may have filled the place anew while it was copied. */
	if (!ooc_still_valid(store, node, &place)) {
		gpu_cache_remove(residency->cache, store_index, node);
		return -EAGAIN;
	}
	return gpu_cache_find(residency->cache, store_index, node, &ret->payload) ? 0 : -EAGAIN;
}

int residency_find(struct residency *residency, uint32_t store_index, const struct ooc_store *store,
		   uint32_t node, struct resident *ret)
{
	int r;

	if (residency->cache)
		return find_copy(residency, store_index, store, node, ret);
	ret->is_in_place = true;
	r = arena_buffers_find(residency->arena, store_index, store, node, &ret->payload,
			       &ret->place);
	if (r != -ENOMEM)
		return r;
	/* The probe was let through and a whole segment is not (a limit on locked memory, say). */
	glFinish();
	r = start_copying(residency, 0);
	return r < 0 ? r : find_copy(residency, store_index, store, node, ret);
}

bool residency_has(struct residency *residency, uint32_t store_index, const struct ooc_store *store,
		   uint32_t node)
{
	struct gpu_payload payload;
	struct ooc_place place;

	return (residency->cache &&
		gpu_cache_find(residency->cache, store_index, node, &payload)) ||
	       ooc_locate(store, node, &place) == 0;
}

bool residency_has_copied(const struct residency *residency)
{
	return residency->frame_copied_bytes > 0;
}
