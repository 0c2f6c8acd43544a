/* SPDX-License-Identifier: MIT */
#include "tools/bench/replay/replay_cache.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/cache/cache.h"
#include "daemon/cache/served.h"
#include "formats/base/bytes.h"
#include "formats/base/check.h"

/* An entry's holds in the replay; what was refused is wanted and not held. */
struct replay_entry {
	uint32_t index; /* of its node in its store here */
	uint32_t held_count;
	uint32_t refused_count;
};

struct replay {
	const struct schedule *schedule;
	struct cache cache;
	struct served *stores;
	struct store_superblock *superblocks;
	struct replay_entry *entries;
	struct served *waiting; /* for a segment */
	struct replay_result result;
};

/* ---- stores without files ---- */

static void on_make(void *arg, struct served *served)
{
	struct replay *replay = arg;

	replay->waiting = served;
}

static void on_gone(void *arg, struct served *served, struct segment *segment)
{
	(void)arg;
	(void)served;
	(void)segment;
}

/* Nodes are the trace's entries of the store, in their order. */
static void count_entries(struct replay *replay)
{
	const struct schedule *schedule = replay->schedule;

	for (uint32_t i = 0; i < schedule->entry_count; i++) {
		const struct trace_entry *entry = &schedule->entries[i];
		struct store_superblock *superblock = &replay->superblocks[entry->store];
		uint32_t bytes = entry->pages * WIRE_PAGE_BYTES;

		replay->entries[i].index = (uint32_t)superblock->node_count++;
		superblock->payload_raw_bytes += bytes;
		if (bytes > superblock->payload_bytes_max)
			superblock->payload_bytes_max = bytes;
	}
}

static int make_store(struct replay *replay, uint32_t number, enum replacement_policy policy,
		      uint64_t cache_bytes, struct why *why)
{
	struct store_superblock *superblock = &replay->superblocks[number];
	struct served *served = &replay->stores[number];
	uint32_t count = (uint32_t)superblock->node_count;
	uint64_t segment_bytes;
	int r = served_segment_bytes(superblock, cache_bytes, &segment_bytes, why);

	if (r < 0)
		return r;
	served->superblock = superblock;
	served->node_count = count;
	arena_init(&served->arena, segment_bytes);
	served->records = calloc((size_t)count + 1, sizeof(*served->records));
	served->nodes = calloc((size_t)count + 1, sizeof(*served->nodes));
	served->directory =
		calloc(1, sizeof(*served->directory) + count * sizeof(served->directory->words[0]));
	served->ledger.held = calloc((size_t)count + 1, sizeof(*served->ledger.held));
	if (!served->records || !served->nodes || !served->directory || !served->ledger.held ||
	    replacement_create(policy, count, &served->replacement) < 0)
		return why_errno(why, -ENOMEM, "a replay");
	cache_add_store(&replay->cache, served);
	return 0;
}

static void fill_records(struct replay *replay)
{
	const struct schedule *schedule = replay->schedule;

	for (uint32_t i = 0; i < schedule->entry_count; i++) {
		const struct trace_entry *entry = &schedule->entries[i];
		/* Ours until here: the daemon has them in a sealed file. */
		const struct served *served = &replay->stores[entry->store];
		struct store_node *record =
			(struct store_node *)(uintptr_t)&served->records[replay->entries[i].index];

		record->payload_id = i + UINT64_C(1);
		record->payload_bytes = entry->pages * WIRE_PAGE_BYTES;
		record->stored_bytes = entry->bytes;
		node_init(&served->nodes[replay->entries[i].index], record->payload_bytes);
	}
}

static int replay_make(struct replay *replay, enum replacement_policy policy, uint64_t cache_bytes,
		       struct why *why)
{
	static const struct cache_calls calls = { .make = on_make, .gone = on_gone };
	const struct schedule *schedule = replay->schedule;
	size_t store_count = schedule->store_count;
	int r = 0;

	cache_init(&replay->cache, cache_bytes, &calls, replay);
	replay->stores = calloc(store_count + 1, sizeof(*replay->stores));
	replay->superblocks = calloc(store_count + 1, sizeof(*replay->superblocks));
	replay->entries = calloc((size_t)schedule->entry_count + 1, sizeof(*replay->entries));
	if (!replay->stores || !replay->superblocks || !replay->entries)
		return why_errno(why, -ENOMEM, "a replay");
	for (uint32_t i = 0; i < store_count; i++) {
		list_init(&replay->stores[i].link);
		list_init(&replay->stores[i].lru);
		list_init(&replay->stores[i].arena.in_order);
	}
	count_entries(replay);
	for (uint32_t i = 0; r == 0 && i < store_count; i++)
		r = make_store(replay, i, policy, cache_bytes, why);
	if (r == 0)
		fill_records(replay);
	return r;
}

static void replay_done(struct replay *replay)
{
	for (uint32_t i = 0; replay->stores && i < replay->schedule->store_count; i++) {
		struct served *served = &replay->stores[i];

		arena_done(&served->arena);
		served->replacement = replacement_destroy(served->replacement);
		free(served->directory);
		free(served->ledger.held);
		free(served->nodes);
		free((void *)(uintptr_t)served->records);
	}
	free(replay->stores);
	free(replay->superblocks);
	free(replay->entries);
}

/* ---- steps ---- */

static int add_segment(struct replay *replay)
{
	struct served *served = replay->waiting;
	struct memfile memfile = MEMFILE_NONE;
	struct segment *segment;

	replay->waiting = NULL;
	memfile.bytes = served->arena.segment_bytes;
	return cache_add_segment(&replay->cache, served, &memfile, &segment);
}

/* Returns: 0 (it is there), -ENOBUFS (it found no room) or -ENOMEM. */
static int read_node(struct replay *replay, struct served *served, uint32_t index)
{
	int r;

	while ((r = cache_begin_fill(&replay->cache, served, index, 0, false)) == -EAGAIN) {
		/* It would wait for others to let go. */
		if (!replay->waiting)
			return -ENOBUFS;
		if (add_segment(replay) < 0)
			return -ENOMEM;
	}
	/* Nobody else lets go meanwhile. */
	return r == -EBUSY ? -ENOBUFS : r;
}

static int miss(struct replay *replay, uint32_t number)
{
	const struct trace_entry *size = &replay->schedule->entries[number];
	struct served *served = &replay->stores[size->store];
	struct replay_entry *entry = &replay->entries[number];
	int r = read_node(replay, served, entry->index);

	replay->result.miss_count++;
	replay->result.read_bytes += size->bytes;
	if (r == -ENOBUFS) {
		replay->result.refused_count++;
		entry->refused_count++;
		return 0;
	}
	if (r < 0)
		return r;
	cache_hold(&replay->cache, served, entry->index);
	cache_end_fill(&replay->cache, served, entry->index);
	entry->held_count++;
	return 0;
}

/* Returns: false when it is not there. */
static bool hit(struct replay *replay, uint32_t number)
{
	struct replay_entry *entry = &replay->entries[number];
	struct served *served = &replay->stores[replay->schedule->entries[number].store];

	if (!node_is_ready(&served->nodes[entry->index]))
		return false;
	cache_hold(&replay->cache, served, entry->index);
	entry->held_count++;
	replay->result.hit_count++;
	return true;
}

static void drop(struct replay *replay, uint32_t number)
{
	struct replay_entry *entry = &replay->entries[number];

	if (entry->refused_count > 0) {
		entry->refused_count--;
		return;
	}
	entry->held_count--;
	cache_release(&replay->cache, &replay->stores[replay->schedule->entries[number].store],
		      entry->index);
}

/* Whoever is there is held first, as the daemon does, so that no read throws it out. */
static int replay_step(struct replay *replay, const uint64_t *ops, uint64_t *at, uint8_t *is_hit)
{
	uint64_t begin = *at;
	uint64_t end = begin;
	int r = 0;

	for (; schedule_op_of(ops[end]) != SCHEDULE_STEP; end++) {
		is_hit[end] = 1;
		if (schedule_op_of(ops[end]) == SCHEDULE_DROP)
			drop(replay, schedule_entry_of(ops[end]));
		else
			is_hit[end] = hit(replay, schedule_entry_of(ops[end]));
	}
	for (uint64_t i = begin; r == 0 && i < end; i++)
		if (!is_hit[i])
			r = miss(replay, schedule_entry_of(ops[i]));
	*at = end + 1;
	return r;
}

int replay_cache(const struct schedule *schedule, enum replacement_policy policy,
		 uint64_t cache_bytes, struct replay_result *ret, struct why *why)
{
	struct replay replay = { .schedule = schedule };
	uint8_t *is_hit = malloc(schedule->op_count + 1);
	int r = is_hit ? replay_make(&replay, policy, cache_bytes, why)
		       : why_errno(why, -ENOMEM, "a replay");

	for (uint64_t at = 0; r == 0 && at < schedule->op_count;) {
		r = replay_step(&replay, schedule->ops, &at, is_hit);
		if (r < 0)
			(void)why_errno(why, r, "a replay");
	}
	if (r == 0) {
		for (uint32_t i = 0; i < schedule->store_count; i++)
			replay.result.eviction_count += replay.stores[i].counters.evictions;
		*ret = replay.result;
	}
	replay_done(&replay);
	free(is_hit);
	return r;
}
