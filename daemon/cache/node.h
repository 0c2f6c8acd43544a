/* SPDX-License-Identifier: MIT */
/**
 * node.h - the life of one payload in the arena.
 *
 *	             fetch/prefetch             read, verified, decoded
 *	DAMAGED    ABSENT ---------> BUSY ------------------> HELD (hold_count > 0) <-- hold --+
 *	   ^         ^ ^              | |                      | last release                  |
 *	   |         | | device failed| | read, nobody         v                               |
 *	   |         | +--------------+ | waits               FREE (on the LRU list) ----------+
 *	   |         |                | +--------------------> |
 *	   |         +----------------|------- evict ----------+
 *	   +--------------------------+ checksum or structure wrong
 *
 *	from     to       function          condition
 *	ABSENT   BUSY     node_begin_fill   a place is taken, a read will be submitted
 *	BUSY     HELD     node_end_fill     hold_count > 0
 *	BUSY     FREE     node_end_fill     hold_count = 0
 *	BUSY     ABSENT   node_fail_fill    the bytes could not be read; every holder was told
 *	BUSY     DAMAGED  node_fail_fill    the bytes are wrong; every holder was told
 *	FREE     HELD     node_hold
 *	HELD     FREE     node_release      the last hold
 *	FREE     ABSENT   node_evict
 *
 * Every change goes through one function, which checks the edge and writes the node's word in the
 * shared directory, so that a client never sees a state that the daemon is not in.
 *
 * Threads: loop thread; the directory's words are read by clients at any time.
 */
#ifndef DAEMON_CACHE_NODE_H
#define DAEMON_CACHE_NODE_H

#include <assert.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "daemon/arena/arena.h"
#include "formats/base/list.h"

/* One X(name) for each state; node_state_name() is made from it. */
#define NODE_STATES(X) X(ABSENT) X(BUSY) X(HELD) X(FREE) X(DAMAGED)

/**
 * State of a node, and what holds in it.  node_check() asserts the lines marked with *.
 */
enum node_state {
	/*
	 * Nowhere in memory.  On no list; it has no place.
	 * * hold_count is 0, fill is NODE_NO_FILL.
	 */
	NODE_ABSENT = 0,

	/*
	 * It has a place, and kernel or workers write there.  One fill brings it in, however many
	 * sessions wait; each of them has a hold.  Without holds it is a prefetch, or nobody wants
	 * it any longer: it comes all the same, a submitted read cannot be called back.  On no list.
	 * * fill is the fill's index, or NODE_TAKEOVER.
	 */
	NODE_BUSY,

	/*
	 * The bytes are verified and stay where they are.  On no list.
	 * * hold_count is at least 1, fill is NODE_NO_FILL.
	 */
	NODE_HELD,

	/*
	 * As HELD, but nobody counts on it: it may go when room is needed.  On its store's LRU list.
	 * * hold_count is 0, fill is NODE_NO_FILL.
	 */
	NODE_FREE,

	/*
	 * Its bytes in the store are wrong.  Until the store is closed; it is not read again.
	 * On no list; it has no place.
	 * * hold_count is 0, fill is NODE_NO_FILL.
	 */
	NODE_DAMAGED,

	NODE_STATE_COUNT_
};

#define NODE_NO_FILL UINT16_MAX
/** In place of a fill's index: a predecessor's bytes lie there and are being verified (takeover.h). */
#define NODE_TAKEOVER (UINT16_MAX - 1)

/** Does an administrator want the node to stay in the cache?  See residents.h. */
enum residence {
	RESIDENCE_NONE,
	RESIDENCE_WANTED, /* it comes when there is time */
	RESIDENCE_HELD,   /* one of its holds is for that */
};

/**
 * One node, a cache line.  Read freely on the loop thread, written only by node.c, but for link,
 * last_use, want_count and plan (sets) and what is said of its past.
 */
struct node {
	struct list link; /* served.lru, while FREE */
	uint64_t last_use;
	uint64_t fill_count : 34; /* +1 at each fill: two equal READY words mean the same bytes */
	uint64_t page_count : 30; /* of its payload, in the arena; 0: it has none.  Never changes */
	struct place place;       /* while BUSY, HELD, FREE */
	uint32_t hold_count;
	uint32_t want_count; /* sets that want it, or whose clients may still draw it */
	uint32_t plan;       /* number of the newest division of the cache that has room for it */
	uint32_t since_ds;   /* clock_now_ds() when it came in, or when it was evicted */
	uint32_t payer;      /* session for which it was read; 0: none */
	uint16_t fill;       /* while BUSY */
	enum node_state state : 8;
	uint8_t residence : 2;    /* enum residence */
	bool was_evicted : 1;     /* ABSENT, and it was there once */
	bool unused_prefetch : 1; /* a prefetch brings it, and nobody has held it */
};

static_assert(sizeof(struct node) <= 64, "millions of them are walked");

/** payload_bytes: 0: nothing will ever lie in the arena. */
void node_init(struct node *node, uint32_t payload_bytes);

/** word: the node's in the directory, here and below. */
void node_begin_fill(struct node *node, _Atomic uint64_t *word, struct place place, uint32_t fill);
/** Another fill goes on with a BUSY node, into the same place. */
void node_change_fill(struct node *node, uint32_t fill);
void node_end_fill(struct node *node, _Atomic uint64_t *word);
void node_fail_fill(struct node *node, _Atomic uint64_t *word, bool damaged);

/** Adds a hold to a BUSY, HELD or FREE node. */
void node_hold(struct node *node, _Atomic uint64_t *word);
/** Takes one from a BUSY or HELD node. */
void node_release(struct node *node, _Atomic uint64_t *word);
/** Nothing may be written to its place before this has returned. */
void node_evict(struct node *node, _Atomic uint64_t *word);

/** Says whether the table above has the edge.  For node.c and its test. */
bool node_edge_allowed(enum node_state from, enum node_state to);

/** Asserts the invariants of the node's state.  O(1). */
void node_check(const struct node *node);

/** Name of a state, for logs: "BUSY".  Never NULL. */
const char *node_state_name(enum node_state state);

/** Is it in memory for clients to read? */
static inline bool node_is_ready(const struct node *node)
{
	return node->state == NODE_HELD || node->state == NODE_FREE;
}

#endif /* DAEMON_CACHE_NODE_H */
