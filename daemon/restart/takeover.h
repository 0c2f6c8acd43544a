/* SPDX-License-Identifier: MIT */
/**
 * takeover.h - makes what a predecessor of the daemon left (handover.h) this daemon's cache.
 *
 * Nothing is trusted that can be looked at: a store is taken over when its file is still the one it
 * was (device, inode, uuid, generation), a segment when it is sealed and has no holes, and a payload
 * when its checksum, taken anew, is the one in the ledger.
 *
 *	its word was     first        then
 *	ABSENT, DAMAGED  ABSENT
 *	READY, BUSY      BUSY         checksum right: HELD or FREE, and published
 *	                              else: read again, by an ordinary fill into the same place
 *
 * A payload that was being read is one whose checksum is wrong, most likely.  It keeps its place,
 * because the kernel may still be writing there for the predecessor: the same bytes that are read
 * again.
 *
 * Payloads are verified by the workers in the order of demand: what a session waits for, then what
 * was held, then the rest.
 *
 * Survivors.  Clients go on to draw what they held when the predecessor ended.  So what was held is
 * held, by nobody in particular, for a grace; all that time the directories that they look at stay
 * as they are.  When it is over, the epoch in those becomes 0 and after that the holds go: a client
 * that has not looked at anything since sees that what it drew is no longer its own.
 *
 * Threads: loop thread.
 */
#ifndef DAEMON_RESTART_TAKEOVER_H
#define DAEMON_RESTART_TAKEOVER_H

#include <stdbool.h>
#include <stdint.h>

#include "daemon/cache/cache.h"
#include "daemon/fetch/fills.h"
#include "daemon/fetch/workers.h"
#include "daemon/restart/handover.h"

struct takeover;

struct takeover_calls {
	/** A node has become HELD or FREE without a read. */
	void (*ended)(void *arg, const struct fill_result *result);
	/** Something can go on: takeover_pump() is to be called. */
	void (*active)(void *arg);
};

struct takeover_counts {
	uint32_t left;     /* payloads to be verified or read again */
	uint64_t verified; /* payloads, ever */
	uint64_t reread;   /* whose bytes were not right */
	uint64_t bytes;    /* verified */
	uint32_t graces;   /* stores whose survivors are still protected */
};

/** Cache, fills and workers outlive it.  Returns: 0 or -ENOMEM. */
int takeover_create(struct cache *cache, struct fills *fills, struct workers *workers,
		    const struct takeover_calls *calls, void *calls_arg, struct takeover **ret,
		    struct why *why);
/** Nothing may be with the workers.  NULL is allowed.  Returns: NULL. */
struct takeover *takeover_destroy(struct takeover *takeover);

/**
 * Fills a store's empty arena with what is kept of it, as far as the budget allows.
 *
 * served:    known to the cache; it has inherited the ledger (served_inherit).
 * kept:      what is taken leaves it.  Segments are marked as inherited: nothing is registered.
 *
 * Returns: 0 or -ENOMEM, after which nothing of it is BUSY.
 */
int takeover_begin(struct takeover *takeover, struct served *served, struct kept_store *kept,
		   uint64_t grace_end_ns);

/** A session waits for a node whose fill is NODE_TAKEOVER.  See fills_set_takeover(). */
void takeover_want(void *takeover, const struct served *served, uint32_t index);

/** Gives the workers more.  Once a round. */
void takeover_pump(struct takeover *takeover);

/** A node's fill has ended: was it one that was read again? */
void takeover_fill_ended(struct takeover *takeover, const struct fill_result *result);

/** Ends the graces that are over. */
void takeover_tick(struct takeover *takeover, uint64_t now_ns);

/** Frees what a store that is closed has inherited. */
void takeover_forget(struct served *served);

void takeover_count(const struct takeover *takeover, struct takeover_counts *ret);

#endif /* DAEMON_RESTART_TAKEOVER_H */
