/* SPDX-License-Identifier: MIT */
/**
 * cache.h - which payloads are in memory, and which go when room is needed.
 *
 * One budget for all stores.  The cache finds places, counts holds and evicts what nobody holds, the
 * one unused for the longest first.  It does no I/O: cache_begin_fill() gives a place, somebody
 * reads into it, and cache_end_fill() or cache_fail_fill() ends that.
 *
 * Access rules (the long form, with the reasons, is daemon/README.md):
 *
 *   1. A BUSY or HELD node is never evicted or moved.
 *   2. Holds may last.  Nothing in the daemon waits for one to go away: where everything is held,
 *      cache_begin_fill() fails with -ENOBUFS.  It does not fail while what nobody holds could make
 *      room.
 *   3. A BUSY node's place belongs to kernel and workers until its fill has ended.
 *
 * Segments are made by somebody else on a worker (cache.calls.make), because populating memory takes
 * up to a second a GiB.
 *
 * Threads: loop thread.  Memory: no call allocates but cache_add_segment().
 * Source: getblk and brelse, Bach (1986), sec. 3.3.
 */
#ifndef DAEMON_CACHE_CACHE_H
#define DAEMON_CACHE_CACHE_H

#include <stdbool.h>
#include <stdint.h>

#include "daemon/cache/served.h"
#include "formats/base/bytes.h"

/** Control that goes up. */
struct cache_calls {
	/* Start to make a segment; ends in cache_add_segment() or cache_segment_failed(). */
	void (*make)(void *arg, struct served *served);
	/* A segment is about to go: unregister its buffer, tell the clients. */
	void (*gone)(void *arg, struct served *served, struct segment *segment);
};

struct cache {
	uint64_t budget_bytes;
	/* More than budget_bytes while memory is short; less while a smaller one waits for holds to go. */
	uint64_t budget_wanted_bytes;
	uint64_t short_since_ns; /* 0: it is not */
	uint64_t segment_bytes;  /* of all stores, those being made included; <= budget_bytes */
	uint32_t segment_count;
	uint64_t pinned_bytes;   /* of BUSY and HELD nodes */
	uint64_t released_bytes; /* ever: grows whenever room may have appeared */
	uint64_t clock;          /* of uses: +1 each */
	uint64_t steal_clock;    /* when other stores were last looked at */
	bool room_is_coming; /* holds are about to be given up: fetches wait for them (room.h) */
	uint32_t draining_count; /* segments */
	uint64_t drain_count;    /* segments ever drained: +1 when holders are to be told */
	struct list stores;
	uint32_t store_count;
	struct cache_calls calls;
	void *calls_arg;
	struct recorder *recorder; /* NULL: no trace is written */
};

void cache_init(struct cache *cache, uint64_t budget_bytes, const struct cache_calls *calls,
		void *calls_arg);

/**
 * Changes the budget.  A larger one counts at once.  For a smaller one, segments that nobody has
 * holds in go at once; as many others as it takes are filled no more and go with their last hold.
 */
void cache_set_budget(struct cache *cache, uint64_t budget_bytes);

/** What all sessions together may hold. */
static inline uint64_t cache_room_bytes(const struct cache *cache)
{
	return u64_min(cache->budget_bytes, cache->budget_wanted_bytes);
}

void cache_add_store(struct cache *cache, struct served *served);
/** Evicts all of it; nothing of it may be BUSY or HELD, no segment being made. */
void cache_remove_store(struct cache *cache, struct served *served);

/**
 * Gives an ABSENT node a place.
 *
 * Where what is held lies so scattered that there is none, although a segment has enough pages that
 * nobody holds, that segment is *drained*: it takes nothing in, its holders are to let go
 * (cache_is_leaving()) and fetch what they had anew, into one piece.
 *
 * fill:      index of who reads it.
 * prefetch:  it is not worth draining anything for.
 *
 * Returns: 0, -ENOBUFS (everything is held), -EBUSY (so it is, but holds are about to be given up: try
 *	again then), or -EAGAIN (a segment is being made: try again then).
 */
int cache_begin_fill(struct cache *cache, struct served *served, uint32_t index, uint32_t fill,
		     bool prefetch);
void cache_end_fill(struct cache *cache, struct served *served, uint32_t index);
/** damaged: the bytes are wrong; else they could not be had.  Nobody may hold it. */
void cache_fail_fill(struct cache *cache, struct served *served, uint32_t index, bool damaged);

/**
 * A predecessor's segment, under its number.
 *
 * Returns: 0, -ENOBUFS (the budget has no room for it), -EEXIST or -ENOMEM; the memory is then still
 *	the caller's.
 */
int cache_adopt_segment(struct cache *cache, struct served *served, struct memfile *memfile,
			uint32_t number, struct segment **ret);
/**
 * An ABSENT node becomes BUSY where a predecessor had it; see arena_take_at().
 *
 * Returns: 0 or -ENOBUFS.
 */
int cache_adopt_node(struct cache *cache, struct served *served, uint32_t index,
		     struct place place);

/** Holds of a BUSY, HELD or FREE node. */
void cache_hold(struct cache *cache, struct served *served, uint32_t index);
void cache_release(struct cache *cache, struct served *served, uint32_t index);

/** Evicts a node that is FREE.  Returns: was it? */
bool cache_evict(struct served *served, uint32_t index);

/** Does a BUSY or HELD node lie in a segment that is drained, so that its holders have to let go? */
static inline bool cache_is_leaving(const struct cache *cache, const struct served *served,
				    uint32_t index)
{
	const struct node *node = &served->nodes[index];

	return cache->draining_count > 0 &&
	       (node->state == NODE_BUSY || node->state == NODE_HELD) &&
	       served->arena.by_number[node->place.segment]->draining;
}

/** Makes the first segment of a store before anybody waits for it. */
void cache_warm_up(struct cache *cache, struct served *served);

/** The memory that calls.make asked for.  Returns: 0, or -errno, after which it has failed. */
int cache_add_segment(struct cache *cache, struct served *served, struct memfile *memfile,
		      struct segment **ret);
/**
 * It cannot be had: for some seconds the budget shrinks to what is there, so that nobody asks all
 * the time.
 */
void cache_segment_failed(struct cache *cache, struct served *served);

/** Once a while: gives back segments that have been empty for idle_ns. */
void cache_trim(struct cache *cache, uint64_t now_ns, uint64_t idle_ns);

/** Bytes of BUSY, HELD and FREE nodes of all stores. */
uint64_t cache_used_bytes(const struct cache *cache);

/** Asserts that arena bytes are those of BUSY + HELD + FREE nodes and free space.  O(nodes). */
void cache_check(const struct cache *cache);

#endif /* DAEMON_CACHE_CACHE_H */
