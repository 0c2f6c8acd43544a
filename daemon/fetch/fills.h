/* SPDX-License-Identifier: MIT */
/**
 * fills.h - brings one payload in: a place, a read, verification, decoding.
 *
 *	            fetch                      worker
 *	(unused) ----------> READING ------------------> VERIFYING ---------> (unused)
 *	                       |  codec none: into the arena   | into the arena
 *	                       |  else: into staging           |
 *	                       +------------ failed -----------+
 *
 * Every payload is verified at every read: checksum with the payload's identity, decoding, and the
 * structure as a whole, so that clients draw it without a check.  Nothing else is ever published.
 *
 * A few payloads are verified at once, for handing them to another thread and being woken for the
 * answer costs as much time again; what is more, or has to be decoded, the workers do.
 *
 * Threads: loop thread; on a worker the verification touches only its fill.
 */
#ifndef DAEMON_FETCH_FILLS_H
#define DAEMON_FETCH_FILLS_H

#include <stdbool.h>
#include <stdint.h>

#include "daemon/cache/cache.h"
#include "daemon/fetch/fetch.h"
#include "daemon/fetch/workers.h"
#include "formats/base/histogram.h"

struct fills;

/** A fill that has ended. */
struct fill_result {
	struct served *served;
	uint32_t index;
	uint32_t session; /* who caused it */
	bool prefetch;
	uint64_t read_bytes;
	enum wire_reason reason; /* WIRE_REASON_NONE: the node is there */
};

/**
 * Tells that a fill has ended: after the node has become HELD or FREE; but before a BUSY node whose
 * fill has failed changes its state, so that its holders can let go.
 */
typedef void (*fills_ended_fn)(void *arg, const struct fill_result *result);

/** Cache, fetch and workers outlive the fills.  Returns: 0 or -ENOMEM. */
int fills_create(struct cache *cache, struct workers *workers, fills_ended_fn ended,
		 void *ended_arg, struct fills **ret, struct why *why);
/** Nothing may be in flight.  NULL is allowed.  Returns: NULL. */
struct fills *fills_destroy(struct fills *fills);

/** Of the cache: grows whenever room may have appeared. */
uint64_t fills_released_bytes(const struct fills *fills);

/** The fetch layer, whose done function is fills_read_done() with the fills as argument. */
void fills_set_fetch(struct fills *fills, struct fetch *fetch);
void fills_read_done(void *fills, uint64_t tag, int error);
/** Verifies what was read, or has the workers do it: after the fetch layer was dispatched. */
void fills_verify(struct fills *fills);

/** Room for the coded payloads of a store, before its nodes are filled.  Returns: 0 or -ENOMEM. */
int fills_prepare(struct fills *fills, const struct served *served, struct why *why);

/**
 * Begins to bring an ABSENT node in; it is BUSY then, and held by nobody.
 *
 * Returns: 0, -ENOBUFS (everything is held: not now), -EBUSY (so it is, but holds are about to be given
 *	up), or -EAGAIN (something else that it needs will be there soon: a place in a queue, a segment,
 *	staging).
 */
int fills_start(struct fills *fills, struct served *served, uint32_t index, uint32_t session,
		bool prefetch);

/**
 * Reads a BUSY node whose fill is NODE_TAKEOVER anew, into its place.
 *
 * Returns: 0 or -EAGAIN.
 */
int fills_again(struct fills *fills, struct served *served, uint32_t index);

/** Told when a session waits for a node whose fill is NODE_TAKEOVER. */
typedef void (*fills_wanted_fn)(void *arg, const struct served *served, uint32_t index);
void fills_set_takeover(struct fills *fills, fills_wanted_fn wanted, void *wanted_arg);

/** A BUSY node that was a prefetch is wanted now. */
void fills_upgrade(struct fills *fills, const struct served *served, uint32_t index);

/** Would the next read begin at once? */
bool fills_has_room(const struct fills *fills);
/**
 * And one of this session's?
 *
 * shared:  others read as well: some of the queue is theirs.
 */
bool fills_has_room_for(const struct fills *fills, uint32_t session, bool shared);
/** And may it be a prefetch? */
bool fills_has_prefetch_room(const struct fills *fills);

/** How long fills took, from their begin to the verified payload, by what they were begun as. */
struct fill_times {
	struct histogram fetch;
	struct histogram prefetch;
	/* Before that: from being wanted to being begun; and as long as prefetches were read meanwhile. */
	struct histogram wait;
	struct histogram wait_behind_prefetch;
};

/** A fetch has been begun that was wanted since then. */
void fills_note_wait(struct fills *fills, uint64_t wanted_ns);

const struct fill_times *fills_times(const struct fills *fills);

/** Fills under way. */
uint32_t fills_count(const struct fills *fills);

#endif /* DAEMON_FETCH_FILLS_H */
