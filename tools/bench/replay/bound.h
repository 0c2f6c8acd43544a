/* SPDX-License-Identifier: MIT */
/**
 * bound.h - what a cache that knows the future could save: below, and what one such cache saves.
 *
 * Between two wants of a node lies a *gap*, from when nobody wants it any longer until somebody does
 * again.  A cache of C pages saves a read for each gap through which it keeps the node: the gap's pages
 * for its steps, of what wanted nodes leave of C.  So many bytes at most can be saved:
 *
 *	pfoo   the gaps that save most for a page and step, until the pages and steps of the whole
 *	       trace are used up (PFOO-L): whether they fit at each moment is not asked
 *	foo    the same, with a price for a page at each step that rises where too much would be kept and
 *	       falls where too little: any prices give a bound, these approach the best (the dual of the
 *	       fractional problem).  Never below pfoo, of which it is the case of one price for all
 *
 * Both are bounds for any cache, if what is wanted fits at all times; where it does not (a cache may
 * then do without what is wanted), wanted nodes are taken to need no room.
 *
 * belady is no bound but a cache that is hard to beat: what is wanted farthest in the future, times
 * its size, goes first.
 *
 * Threads: any; pure functions.
 * Source: Berger, Beckmann & Harchol-Balter, "Practical Bounds on Optimal Caching with Variable Object
 *	Sizes", POMACS 2(2), 2018 (FOO, PFOO-L, Belady-Size).
 */
#ifndef TOOLS_BENCH_REPLAY_BOUND_H
#define TOOLS_BENCH_REPLAY_BOUND_H

#include "tools/bench/replay/schedule.h"

/** Kept from after step `begin` until step `end`. */
struct gap {
	uint64_t begin;
	uint64_t end;
	uint32_t pages;
	uint32_t bytes; /* that it saves */
};

struct gaps {
	struct gap *gaps;
	uint64_t count;
	uint64_t *wanted_pages; /* after each step */
	uint64_t step_count;
	uint64_t wanted_pages_max;
	uint64_t compulsory_bytes; /* of the first want of each node */
	uint64_t gap_bytes;        /* of all gaps */
};

/** Returns: 0 or -ENOMEM.  Ownership: ends with gaps_done(). */
int gaps_make(const struct schedule *schedule, struct gaps *ret);
void gaps_done(struct gaps *gaps);

/**
 * Bytes that any cache must read, compulsory ones included.
 *
 * wants_need_room:  false: as if what is wanted lay elsewhere.
 *
 * Returns: 0 or -ENOMEM.
 */
int bound_pfoo(const struct gaps *gaps, uint64_t cache_pages, bool wants_need_room, double *ret);
int bound_foo(const struct gaps *gaps, uint64_t cache_pages, bool wants_need_room, double *ret);

/** Bytes that size-aware Belady reads.  Returns: 0 or -ENOMEM.  Cost: O(evictions x nodes). */
int bound_belady(const struct schedule *schedule, uint64_t cache_pages, double *ret);

#endif /* TOOLS_BENCH_REPLAY_BOUND_H */
