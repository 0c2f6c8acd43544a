/* SPDX-License-Identifier: MIT */
/**
 * arena.h - the shared memory that holds a store's decoded payloads: segments, and places in them.
 *
 * An arena belongs to one store for ever: whoever has its descriptor may read all of it.  Segments
 * of one size are added when they are needed and removed when they are empty.  The arena knows who
 * owns a place (a node's index), not whether the owner may be thrown out: cache.h does, and asks
 * for the windows worth emptying.
 *
 * Segment numbers are handed out in a circle of WIRE_SEGMENT_COUNT_MAX, so that a client that has
 * not yet read SEGMENT_GONE does not take a new segment for the old one of the same number.
 *
 * Threads: loop thread.
 */
#ifndef DAEMON_ARENA_ARENA_H
#define DAEMON_ARENA_ARENA_H

#include <stdbool.h>
#include <stdint.h>

#include "daemon/arena/memfile.h"
#include "daemon/arena/pages.h"
#include "formats/base/bytes.h"
#include "formats/base/list.h"
#include "libclient/wire.h"

/** Where a payload lies. */
struct place {
	uint32_t segment;
	uint32_t page;
};

struct segment {
	struct list link; /* arena.in_order */
	struct memfile memfile;
	struct pages *pages;
	uint32_t number;
	uint32_t buffer;         /* of the fetch layer; FETCH_BUFFER_NONE: not registered */
	uint32_t pinned_pages;   /* of BUSY and HELD nodes; cache.c counts */
	uint32_t window_max;     /* no window is longer, as far as is known: arena_window_best() */
	bool inherited;          /* and not registered yet: see server_stores.c */
	bool draining;           /* nothing new comes in until nothing is held in it; cache.c */
	bool draining_for_good;  /* it is wanted by another store */
	uint64_t empty_since_ns; /* 0: not empty */
};

struct arena {
	uint64_t segment_bytes;
	uint32_t segment_count;
	uint32_t next_number;
	uint64_t used_pages;
	struct list in_order; /* of being added */
	struct segment *by_number[WIRE_SEGMENT_COUNT_MAX];
};

/** segment_bytes: a power of two, 1 .. WIRE_SEGMENT_PAGES_MAX pages. */
void arena_init(struct arena *arena, uint64_t segment_bytes);
/** Ends it with all its segments, whose bytes clients keep; nothing may be in flight into them. */
void arena_done(struct arena *arena);

/**
 * Adds a segment over published memory.
 *
 * memfile:  segment_bytes long; taken over on success, and emptied.
 *
 * Returns: 0, -EMFILE (every number is in use) or -ENOMEM.
 */
int arena_add(struct arena *arena, struct memfile *memfile, struct segment **ret);

/**
 * The same with a number of its own: a predecessor's segment.
 *
 * Returns: 0, -EEXIST (the number is in use) or -ENOMEM.
 */
int arena_adopt(struct arena *arena, struct memfile *memfile, uint32_t number,
		struct segment **ret);

/** Removes an empty segment and gives its memory back, whoever maps it. */
void arena_remove(struct arena *arena, uint32_t number);

#define ARENA_SEGMENT(ring) LIST_ENTRY(ring, struct segment, link)

/** Takes a place in the oldest segment that has one and is not draining.  Returns: 0 or -ENOBUFS. */
int arena_take(struct arena *arena, uint32_t page_count, uint32_t owner, struct place *ret);
/**
 * Takes a place that a predecessor used; those of a segment in ascending order, before any other.
 *
 * Returns: 0, or -ENOBUFS when it is not free, or not there.
 */
int arena_take_at(struct arena *arena, struct place place, uint32_t page_count, uint32_t owner);
void arena_give(struct arena *arena, struct place place);

uint8_t *arena_address(const struct arena *arena, struct place place);
uint64_t arena_bytes(const struct arena *arena);
/** Bytes of it that lie in huge pages. */
uint64_t arena_huge_bytes(const struct arena *arena);
/** Bytes that the kernel counts for its memory files. */
uint64_t arena_memory_bytes(const struct arena *arena);
uint64_t arena_free_pages(const struct arena *arena);
/** 0: all free space is in one run (a segment's size counts as whole) .. 1: in dust. */
double arena_fragmentation(const struct arena *arena);

/**
 * What is lost when an owner is thrown out.
 *
 * Returns: so little that all owners of a segment cost less than ARENA_NEVER together, or ARENA_NEVER
 * when it may not be.
 */
typedef uint64_t (*arena_cost_fn)(void *arg, uint32_t owner);
#define ARENA_NEVER UINT64_MAX

/** Neighbouring runs, each free or evictable. */
struct window {
	uint32_t segment;
	uint32_t first;
	uint32_t page_count;
	uint64_t cost; /* of all its owners together */
};

/**
 * Widens the run at `place` to a window of at least page_count pages, always over the cheaper of its
 * two neighbours.
 *
 * Returns: 0, or -ENOBUFS when what may not be thrown out stands too near.  Cost: O(runs in it).
 */
int arena_window_around(const struct arena *arena, struct place place, uint32_t page_count,
			arena_cost_fn cost, void *arg, struct window *ret);

/**
 * A node of so many pages may be thrown out from now on.  It joins what lies on both sides of it, so that
 * a window may be twice as long as the longest, and itself.
 */
static inline void arena_note_let_go(struct segment *segment, uint32_t page_count)
{
	segment->window_max = (uint32_t)u64_min(2 * (uint64_t)segment->window_max + page_count,
						WIRE_SEGMENT_PAGES_MAX);
}

/**
 * The cheapest window of at least page_count pages of all there are: the arena is full for page_count
 * exactly when there is none.
 *
 * Segments that were found to have none are not searched again before arena_note_let_go() says that they
 * may have.
 *
 * Returns: 0 or -ENOBUFS.  Cost: O(runs of the arena) as a rule, times the runs of a window at worst.
 */
int arena_window_best(struct arena *arena, uint32_t page_count, arena_cost_fn cost, void *arg,
		      struct window *ret);

/** Asserts counts and each segment's runs.  O(runs). */
void arena_check(const struct arena *arena);

#endif /* DAEMON_ARENA_ARENA_H */
