/* SPDX-License-Identifier: MIT */
#include "daemon/cache/replacement.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/cache/reuse.h"
#include "formats/base/bytes.h"
#include "formats/base/check.h"

#define SLOT_NONE UINT32_MAX
/* Nodes that an imagined cache looks at, at random, for one to go. */
#define SAMPLE_COUNT 64u
/* The other leads when it would have read so much less than the leader. */
#define LEAD_SHARE 0.97
/* What was read counts half when more than so many times the cache was. */
#define MEMORY_ROOMS 4.0
/* Wants a page and page of time of 1, as an integer. */
#define WORTH_ONE 4294967296.0
/* What nothing is known of goes by its age. */
#define TIE_SHARE (1.0 / 65536)

/* Indices of nodes, in no order. */
struct pool {
	uint32_t count;
	uint32_t *nodes;
	uint32_t *slots; /* of each node, in `nodes`; SLOT_NONE: it is not there */
};

/* How an imagined cache evicts. */
enum way {
	WAY_LRU,
	WAY_REUSE,
	WAY_COUNT_
};

struct imagined {
	struct pool free; /* what is in it and not held */
	bool *is_in;      /* of each node */
	uint64_t used_pages;
	double read_pages; /* of late */
};

struct member {
	uint64_t let_go; /* when, last; 0: never */
	uint32_t pages;
};

struct replacement {
	uint32_t node_count;
	uint64_t clock; /* pages let go */
	uint64_t random;
	uint64_t room_pages;
	struct pool free; /* what may really go */
	struct imagined imagined[WAY_COUNT_];
	enum way leader;
	struct reuse *reuse;
	struct member members[]; /* node_count */
};

static const char *const names[REPLACEMENT_COUNT_] = {
#define REPLACEMENT_NAME(name) [REPLACEMENT_##name] = #name,
	REPLACEMENTS(REPLACEMENT_NAME)
#undef REPLACEMENT_NAME
};

const char *replacement_name(enum replacement_policy policy)
{
	CHECK(policy < REPLACEMENT_COUNT_);
	return names[policy];
}

int replacement_find(const char *name, enum replacement_policy *ret)
{
	for (unsigned i = 0; i < REPLACEMENT_COUNT_; i++) {
		if (strcmp(name, names[i]) != 0)
			continue;
		*ret = (enum replacement_policy)i;
		return 0;
	}
	return -EINVAL;
}

/* ---- pools ---- */

static int pool_init(struct pool *pool, uint32_t node_count)
{
	pool->nodes = calloc((size_t)node_count + 1, sizeof(*pool->nodes));
	pool->slots = malloc(((size_t)node_count + 1) * sizeof(*pool->slots));
	if (!pool->nodes || !pool->slots)
		return -ENOMEM;
	memset(pool->slots, 0xff, (size_t)node_count * sizeof(*pool->slots));
	return 0;
}

static void pool_done(struct pool *pool)
{
	free(pool->nodes);
	free(pool->slots);
}

static bool pool_has(const struct pool *pool, uint32_t index)
{
	return pool->slots[index] != SLOT_NONE;
}

static void pool_add(struct pool *pool, uint32_t index)
{
	CHECK(!pool_has(pool, index));
	pool->slots[index] = pool->count;
	pool->nodes[pool->count++] = index;
}

static void pool_remove(struct pool *pool, uint32_t index)
{
	uint32_t last;

	CHECK(pool_has(pool, index));
	last = pool->nodes[--pool->count];
	pool->nodes[pool->slots[index]] = last;
	pool->slots[last] = pool->slots[index];
	pool->slots[index] = SLOT_NONE;
}

static void pool_check(const struct pool *pool, uint32_t node_count)
{
	CHECK(pool->count <= node_count);
	for (uint32_t i = 0; i < pool->count; i++)
		CHECK(pool->slots[pool->nodes[i]] == i);
}

static uint64_t next_random(struct replacement *replacement)
{
	replacement->random ^= replacement->random << 13;
	replacement->random ^= replacement->random >> 7;
	replacement->random ^= replacement->random << 17;
	return replacement->random;
}

/* All of a pool if that is few, else some. */
static uint32_t pool_sample(struct replacement *replacement, const struct pool *pool, uint32_t *ret,
			    uint32_t count_max)
{
	if (pool->count <= count_max) {
		memcpy(ret, pool->nodes, pool->count * sizeof(*ret));
		return pool->count;
	}
	for (uint32_t i = 0; i < count_max; i++)
		ret[i] = pool->nodes[next_random(replacement) % pool->count];
	return count_max;
}

/* ---- what a page is worth ---- */

static double lru_value(uint64_t age)
{
	return 1.0 / ((double)age + 1.0);
}

static double value_of(struct replacement *replacement, enum way way, uint32_t index)
{
	uint64_t age = replacement->clock - replacement->members[index].let_go;

	if (way == WAY_LRU)
		return lru_value(age);
	return reuse_value(replacement->reuse, index, age) + TIE_SHARE * lru_value(age);
}

static uint64_t worth_of(double value)
{
	return (uint64_t)(value * WORTH_ONE) + 1;
}

uint64_t replacement_lru_worth(uint64_t age)
{
	return worth_of(lru_value(age));
}

uint64_t replacement_worth(struct replacement *replacement, uint32_t index)
{
	return worth_of(value_of(replacement, WAY_REUSE, index));
}

bool replacement_is_lru(const struct replacement *replacement)
{
	return !replacement || replacement->leader == WAY_LRU;
}

/* ---- imagined caches ---- */

static void imagine_eviction(struct replacement *replacement, enum way way)
{
	struct imagined *imagined = &replacement->imagined[way];
	uint32_t sample[SAMPLE_COUNT];
	uint32_t count = pool_sample(replacement, &imagined->free, sample, SAMPLE_COUNT);
	uint32_t worst = sample[0];
	double least = value_of(replacement, way, worst);

	for (uint32_t i = 1; i < count; i++) {
		double value = value_of(replacement, way, sample[i]);

		if (value >= least)
			continue;
		least = value;
		worst = sample[i];
	}
	pool_remove(&imagined->free, worst);
	imagined->is_in[worst] = false;
	imagined->used_pages -= replacement->members[worst].pages;
}

static void imagine_fill(struct replacement *replacement, enum way way, uint32_t index)
{
	struct imagined *imagined = &replacement->imagined[way];

	imagined->is_in[index] = true;
	imagined->used_pages += replacement->members[index].pages;
	while (imagined->used_pages > replacement->room_pages && imagined->free.count > 0)
		imagine_eviction(replacement, way);
}

static void imagine_use(struct replacement *replacement, enum way way, uint32_t index)
{
	struct imagined *imagined = &replacement->imagined[way];

	if (pool_has(&imagined->free, index))
		pool_remove(&imagined->free, index);
	if (imagined->is_in[index])
		return;
	imagined->read_pages += replacement->members[index].pages;
	imagine_fill(replacement, way, index);
}

/* What was prefetched may have to come first. */
static void imagine_let_go(struct replacement *replacement, enum way way, uint32_t index)
{
	struct imagined *imagined = &replacement->imagined[way];

	if (!imagined->is_in[index])
		imagine_fill(replacement, way, index);
	if (!pool_has(&imagined->free, index))
		pool_add(&imagined->free, index);
}

static void choose_leader(struct replacement *replacement)
{
	struct imagined *leader = &replacement->imagined[replacement->leader];
	enum way other_way = replacement->leader == WAY_LRU ? WAY_REUSE : WAY_LRU;
	struct imagined *other = &replacement->imagined[other_way];

	if (leader->read_pages + other->read_pages >
	    2 * MEMORY_ROOMS * (double)replacement->room_pages) {
		leader->read_pages *= 0.5;
		other->read_pages *= 0.5;
	}
	if (other->read_pages < LEAD_SHARE * leader->read_pages)
		replacement->leader = other_way;
}

/* ---- the interface ---- */

static int init_parts(struct replacement *replacement)
{
	uint32_t count = replacement->node_count;
	int r = reuse_create(count, &replacement->reuse);

	if (r == 0)
		r = pool_init(&replacement->free, count);
	for (unsigned way = 0; r == 0 && way < WAY_COUNT_; way++) {
		replacement->imagined[way].is_in = calloc((size_t)count + 1, sizeof(bool));
		r = replacement->imagined[way].is_in
			    ? pool_init(&replacement->imagined[way].free, count)
			    : -ENOMEM;
	}
	return r;
}

int replacement_create(enum replacement_policy policy, uint32_t node_count,
		       struct replacement **ret)
{
	struct replacement *replacement;
	int r;

	*ret = NULL;
	if (policy == REPLACEMENT_lru)
		return 0;
	replacement = calloc(1, sizeof(*replacement) +
					(size_t)node_count * sizeof(replacement->members[0]));
	if (!replacement)
		return -ENOMEM;
	replacement->node_count = node_count;
	replacement->random = UINT64_C(0x9e3779b97f4a7c15);
	r = init_parts(replacement);
	if (r < 0)
		replacement = replacement_destroy(replacement);
	*ret = replacement;
	return r;
}

struct replacement *replacement_destroy(struct replacement *replacement)
{
	if (!replacement)
		return NULL;
	for (unsigned way = 0; way < WAY_COUNT_; way++) {
		pool_done(&replacement->imagined[way].free);
		free(replacement->imagined[way].is_in);
	}
	pool_done(&replacement->free);
	replacement->reuse = reuse_destroy(replacement->reuse);
	free(replacement);
	return NULL;
}

void replacement_use(struct replacement *replacement, uint32_t index, uint32_t pages,
		     uint64_t room_pages)
{
	struct member *member = &replacement->members[index];

	CHECK(index < replacement->node_count);
	member->pages = pages;
	replacement->room_pages = room_pages;
	if (pool_has(&replacement->free, index))
		pool_remove(&replacement->free, index);
	reuse_end(replacement->reuse, index, replacement->clock - member->let_go);
	for (unsigned way = 0; way < WAY_COUNT_; way++)
		imagine_use(replacement, (enum way)way, index);
	choose_leader(replacement);
}

void replacement_let_go(struct replacement *replacement, uint32_t index, uint32_t pages,
			bool was_used)
{
	struct member *member = &replacement->members[index];

	CHECK(index < replacement->node_count);
	member->pages = pages;
	replacement->clock += pages;
	member->let_go = replacement->clock;
	pool_add(&replacement->free, index);
	reuse_begin(replacement->reuse, index, was_used);
	for (unsigned way = 0; way < WAY_COUNT_; way++)
		imagine_let_go(replacement, (enum way)way, index);
}

void replacement_evict(struct replacement *replacement, uint32_t index)
{
	CHECK(index < replacement->node_count);
	pool_remove(&replacement->free, index);
}

void replacement_fail(struct replacement *replacement, uint32_t index)
{
	CHECK(index < replacement->node_count);
	for (unsigned way = 0; way < WAY_COUNT_; way++) {
		struct imagined *imagined = &replacement->imagined[way];

		if (!imagined->is_in[index] || pool_has(&imagined->free, index))
			continue;
		imagined->is_in[index] = false;
		imagined->used_pages -= replacement->members[index].pages;
	}
}

uint32_t replacement_sample(struct replacement *replacement, uint32_t *ret, uint32_t count_max)
{
	return pool_sample(replacement, &replacement->free, ret, count_max);
}

uint32_t replacement_count(const struct replacement *replacement)
{
	return replacement->free.count;
}

bool replacement_has(const struct replacement *replacement, uint32_t index)
{
	return pool_has(&replacement->free, index);
}

void replacement_check(const struct replacement *replacement)
{
	pool_check(&replacement->free, replacement->node_count);
	for (unsigned way = 0; way < WAY_COUNT_; way++) {
		const struct imagined *imagined = &replacement->imagined[way];
		uint64_t used_pages = 0;

		pool_check(&imagined->free, replacement->node_count);
		for (uint32_t i = 0; i < replacement->node_count; i++) {
			CHECK(imagined->is_in[i] || !pool_has(&imagined->free, i));
			used_pages += imagined->is_in[i] ? replacement->members[i].pages : 0;
		}
		CHECK(used_pages == imagined->used_pages);
	}
}
