/* SPDX-License-Identifier: MIT */
/**
 * reuse.h - what it is worth to keep a payload that nobody holds, learned from when such were wanted again.
 *
 * A *case* begins when a node is let go and ends when it is wanted again, evicted in between or not: a
 * store's nodes are known and few, so the past of each is kept.  Cases are learned together by kind: of
 * a kind are those of which, by their own past, the same gap is to be expected, namely the one that
 * came after the last gap that was like the latest.  The worth of a node is the best bet on it: of all
 * horizons the best chance that it is wanted before, for the time that it would have to stay.
 *
 * Time is counted by whoever calls.  It does no I/O, reads no clock, and does the same after the same calls.
 *
 * Source: hit density, Beckmann, Chen & Cidon, "LHD: Improving Cache Hit Rate by Maximizing Hit
 *	Density", NSDI 2018; with the best horizon of Gittins (1979) in place of the mean lifetime, and
 *	with the whole history in place of that of residents.
 *
 * Threads: loop thread.  Memory: 11 bytes a node and 44 KB, at creation.
 */
#ifndef DAEMON_CACHE_REUSE_H
#define DAEMON_CACHE_REUSE_H

#include <stdbool.h>
#include <stdint.h>

struct reuse;

/**
 * Begins with nothing learned.
 *
 * Returns: 0 or -ENOMEM.  Ownership: ends with reuse_destroy().
 */
int reuse_create(uint32_t node_count, struct reuse **ret);
/** NULL is allowed.  Returns: NULL. */
struct reuse *reuse_destroy(struct reuse *reuse);

/**
 * A case begins.  One that is open is given up.
 *
 * was_used:  somebody had held the node.  Else it was prefetched; that is a kind of its own, so that
 *            what prefetches are worth is learned, too.
 */
void reuse_begin(struct reuse *reuse, uint32_t index, bool was_used);
/** The node is wanted, and age has passed since it was let go.  Without an open case nothing happens. */
void reuse_end(struct reuse *reuse, uint32_t index, uint64_t age);

/**
 * What nobody asks the value of costs next to nothing: what was learned is gone through here, again
 * after 256 cases.
 *
 * Returns: wants a unit of time, >= 0, of a node that was let go `age` ago.  0: not known to be worth
 *	anything.
 */
double reuse_value(struct reuse *reuse, uint32_t index, uint64_t age);

#endif /* DAEMON_CACHE_REUSE_H */
