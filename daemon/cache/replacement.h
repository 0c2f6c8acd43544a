/* SPDX-License-Identifier: MIT */
/**
 * replacement.h - in which order the payloads that nobody holds go when room is needed.
 *
 * One object a store, or none for LRU, for which the cache's list is enough.  It knows nodes by index,
 * their pages, when each was let go and when it was wanted again.  It does no I/O, reads no clock, and
 * does the same after the same calls: the daemon and `oocbench replay` use it alike.  It says who should go first, not who goes: the cache makes room
 * in windows of neighbours (arena.h), compares them by replacement_rank(), and holds come first.
 *
 * Time is counted in pages let go, so that nothing ages while nothing happens.
 *
 *	lru    the one unused for the longest goes first
 *	reuse  the one goes first for which keeping it pays least: the chance that it is wanted again,
 *	       for the time that it would have to stay until then.  What the chance is at which age is
 *	       learned, for nodes of a kind together: of a kind are those of which, by their own past,
 *	       the same gap is to be expected.  Nodes that were evicted teach as well: a store's nodes
 *	       are known and few, so the past of each is kept.
 *
 * Source: LRU, Bach (1986), sec. 3.2.  reuse: hit density, Beckmann, Chen & Cidon, "LHD: Improving Cache
 *	Hit Rate by Maximizing Hit Density", NSDI 2018; with the best horizon of Gittins (1979) in
 *	place of the mean lifetime, and with the whole history in place of that of residents.
 *
 * Threads: loop thread.  Memory: 28 bytes a node, at creation.
 */
#ifndef DAEMON_CACHE_REPLACEMENT_H
#define DAEMON_CACHE_REPLACEMENT_H

#include <stdbool.h>
#include <stdint.h>

/* One X(name) for each policy, the usual one first. */
#define REPLACEMENTS(X) X(lru) X(reuse)

enum replacement_policy {
#define REPLACEMENT_VALUE(name) REPLACEMENT_##name,
	REPLACEMENTS(REPLACEMENT_VALUE)
#undef REPLACEMENT_VALUE
	REPLACEMENT_COUNT_
};

/** "lru".  Never NULL. */
const char *replacement_name(enum replacement_policy policy);
/** Returns: 0, or -EINVAL when there is no policy of that name. */
int replacement_find(const char *name, enum replacement_policy *ret);

struct replacement;

/**
 * Begins with nothing learned.
 *
 * ret:  NULL for REPLACEMENT_lru.
 *
 * Returns: 0 or -ENOMEM.  Ownership: ends with replacement_destroy().
 */
int replacement_create(enum replacement_policy policy, uint32_t node_count,
		       struct replacement **ret);
/** NULL is allowed.  Returns: NULL. */
struct replacement *replacement_destroy(struct replacement *replacement);

/**
 * Nobody holds the node any longer, or it came and nobody waited: it may go.
 *
 * was_used:  somebody had held it.  Else it was prefetched; that is a kind of its own, so that what
 *            prefetches are worth is learned, too.
 */
void replacement_let_go(struct replacement *replacement, uint32_t index, uint32_t pages,
			bool was_used);
/** Somebody holds it who did not, whether it may have gone (then it may not now), came, or had gone. */
void replacement_use(struct replacement *replacement, uint32_t index);
/** It has gone. */
void replacement_evict(struct replacement *replacement, uint32_t index);

/**
 * Nodes that should go first, the first of them first.  Some of those that may go, not all.
 *
 * Returns: how many there are in ret, up to count_max.
 */
uint32_t replacement_candidates(struct replacement *replacement, uint32_t *ret, uint32_t count_max);

/** Of a node that may go, as of now: smaller goes first.  1 .. UINT64_MAX - 1. */
uint64_t replacement_rank(const struct replacement *replacement, uint32_t index);

/** How many may go. */
uint32_t replacement_count(const struct replacement *replacement);
/** May it go? */
bool replacement_has(const struct replacement *replacement, uint32_t index);

/** Asserts that lists and counts agree.  O(nodes). */
void replacement_check(const struct replacement *replacement);

#endif /* DAEMON_CACHE_REPLACEMENT_H */
