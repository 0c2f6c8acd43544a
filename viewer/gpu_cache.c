/* SPDX-License-Identifier: MIT */
#include "viewer/gpu_cache.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include <epoxy/gl.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/base/list.h"
#include "viewer/world.h"

struct gpu_copy {
	struct list lru; /* of gpu_cache.lru: drawn longest ago first */
	uint32_t store_index;
	uint32_t node;
	GLuint buffer;
	uint32_t payload_bytes;
	uint64_t frame; /* that drew it last */
	struct payload_header header;
};

/* The copies of a store by node, grown to the highest node copied so far. */
struct gpu_store {
	struct gpu_copy **copies;
	uint32_t room;
};

struct gpu_cache {
	uint64_t bytes_max;
	uint64_t bytes;
	uint64_t frame;
	struct list lru;
	struct gpu_store stores[WORLD_STORE_COUNT_MAX];
};

int gpu_cache_create(uint64_t bytes_max, struct gpu_cache **ret)
{
	struct gpu_cache *cache = calloc(1, sizeof(*cache));

	if (!cache)
		return -ENOMEM;
	cache->bytes_max = bytes_max;
	list_init(&cache->lru);
	*ret = cache;
	return 0;
}

static void drop(struct gpu_cache *cache, struct gpu_copy *copy)
{
	cache->stores[copy->store_index].copies[copy->node] = NULL;
	cache->bytes -= copy->payload_bytes;
	list_remove(&copy->lru);
	glDeleteBuffers(1, &copy->buffer);
	free(copy);
}

struct gpu_cache *gpu_cache_destroy(struct gpu_cache *cache)
{
	if (!cache)
		return NULL;
	LIST_FOR_EACH (link, &cache->lru)
		drop(cache, LIST_ENTRY(link, struct gpu_copy, lru));
	for (size_t i = 0; i < WORLD_STORE_COUNT_MAX; i++)
		free(cache->stores[i].copies);
	free(cache);
	return NULL;
}

void gpu_cache_begin(struct gpu_cache *cache)
{
	cache->frame++;
}

static struct gpu_copy *find(struct gpu_cache *cache, uint32_t store_index, uint32_t node)
{
	const struct gpu_store *store = &cache->stores[store_index];

	return node < store->room ? store->copies[node] : NULL;
}

bool gpu_cache_find(struct gpu_cache *cache, uint32_t store_index, uint32_t node,
		    struct gpu_payload *ret)
{
	struct gpu_copy *copy = find(cache, store_index, node);

	if (!copy)
		return false;
	copy->frame = cache->frame;
	list_remove(&copy->lru);
	list_push_back(&cache->lru, &copy->lru);
	*ret = (struct gpu_payload){ .buffer = copy->buffer, .header = &copy->header };
	return true;
}

/* Gives up copies until so many bytes more fit. */
static int make_room(struct gpu_cache *cache, uint32_t bytes, bool may_replace)
{
	LIST_FOR_EACH (link, &cache->lru) {
		struct gpu_copy *copy = LIST_ENTRY(link, struct gpu_copy, lru);

		if (cache->bytes + bytes <= cache->bytes_max)
			return 0;
		if (copy->frame == cache->frame && !may_replace)
			return -ENOBUFS;
		drop(cache, copy);
	}
	/* A payload that is larger than the whole cache is alone in it. */
	return 0;
}

static int reserve_slot(struct gpu_store *store, uint32_t node)
{
	uint32_t room;
	struct gpu_copy **copies;

	if (node < store->room)
		return 0;
	room = node + node / 2 + 64;
	copies = realloc(store->copies, room * sizeof(struct gpu_copy *));
	if (!copies)
		return -ENOMEM;
	memset(copies + store->room, 0, (room - store->room) * sizeof(struct gpu_copy *));
	store->copies = copies;
	store->room = room;
	return 0;
}

int gpu_cache_add(struct gpu_cache *cache, uint32_t store_index, uint32_t node, const void *payload,
		  uint32_t payload_bytes, bool may_replace)
{
	struct gpu_copy *copy;
	int r;

	CHECK(!find(cache, store_index, node));
	r = reserve_slot(&cache->stores[store_index], node);
	if (r < 0)
		return r;
	r = make_room(cache, payload_bytes, may_replace);
	if (r < 0)
		return r;
	copy = calloc(1, sizeof(*copy));
	if (!copy)
		return -ENOMEM;
	copy->store_index = store_index;
	copy->node = node;
	copy->payload_bytes = payload_bytes;
	copy->frame = cache->frame;
	memcpy(&copy->header, payload, sizeof(copy->header));
	while (glGetError() != GL_NO_ERROR)
		;
	glCreateBuffers(1, &copy->buffer);
	glNamedBufferStorage(copy->buffer, payload_bytes, payload, 0);
	if (glGetError() != GL_NO_ERROR) {
		glDeleteBuffers(1, &copy->buffer);
		free(copy);
		return -ENOMEM;
	}
	list_push_back(&cache->lru, &copy->lru);
	cache->stores[store_index].copies[node] = copy;
	cache->bytes += payload_bytes;
	return 0;
}

void gpu_cache_remove(struct gpu_cache *cache, uint32_t store_index, uint32_t node)
{
	struct gpu_copy *copy = find(cache, store_index, node);

	if (copy)
		drop(cache, copy);
}

uint64_t gpu_cache_bytes(const struct gpu_cache *cache)
{
	return cache->bytes;
}
