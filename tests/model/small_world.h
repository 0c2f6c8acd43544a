/* SPDX-License-Identifier: MIT */
/**
 * small_world.h - two clients, two nodes and what the daemon does with them, one small step at a time.
 *
 * The daemon's part is its own code: node.c, cache.c, visible.c and what they stand on.  The rest is
 * made here: readers that keep the rule of drawing (PROTOCOL.md, section 6), one message on its way
 * from each to the daemon, fills that end when a step says so, and for each page of the arena what
 * lies there.
 *
 * A step is what may happen between two others: whatever order steps are taken in is an order in
 * which clients, daemon and disk may be scheduled.
 *
 * world_observe() looks with the eyes of both readers at once, and also runs in the middle of steps,
 * wherever the daemon gives up a hold or a place.
 *
 * Threads: one.  Memory: all in the region.
 */
#ifndef TESTS_MODEL_SMALL_WORLD_H
#define TESTS_MODEL_SMALL_WORLD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define WORLD_READERS 2u
#define WORLD_NODES   2u
/* Behind those, one that nobody wants: it is prefetched, and takes room. */
#define WORLD_PRESSURE WORLD_NODES

enum step_kind {
	/* Of a reader. */
	STEP_SEND,   /* argument: which set, and how (small_world.c) */
	STEP_RETIRE, /* all sets before the newest */
	STEP_LOOK,   /* argument: node; the next of the looks that make it drawable */
	STEP_END,    /* argument: node; it is drawn no longer */
	/* Of the daemon for a reader. */
	STEP_READ,
	STEP_BEGIN,
	STEP_THROW_OUT,
	/* Of the daemon; argument: node. */
	STEP_GIVE_UP, /* of waiting for revoked holds */
	STEP_PREFETCH,
	STEP_FILLED,
	STEP_FAILED,
	STEP_DAMAGED,
	STEP_KIND_COUNT_
};

struct step {
	uint8_t kind;
	uint8_t reader;
	uint8_t argument;
};

struct world;

/**
 * Empties the region.
 *
 * room_pages:  1 or 2; each node has one page.
 * whole:       readers send every set there is, else enough of them.
 */
struct world *world_create(uint32_t room_pages, bool whole);

#define WORLD_STEPS_MAX 64u
/** The steps that may be taken now.  Returns: how many. */
uint32_t world_steps(const struct world *world, struct step ret[WORLD_STEPS_MAX]);
void world_take(struct world *world, struct step step);

/** Asserts the invariants of daemon/README.md, and that nothing waits for a step that never comes. */
void world_check(const struct world *world);
/** Asserts that what readers may draw, and what they draw, is there. */
void world_observe(const struct world *world);

#define WORLD_KEY_BYTES 96u
/** All that later steps depend on; the same key, the same future.  Returns: its length. */
size_t world_key(const struct world *world, uint8_t ret[WORLD_KEY_BYTES]);

/** "reader 0 sends {0 1}, retires". */
const char *step_text(struct step step);

#endif /* TESTS_MODEL_SMALL_WORLD_H */
