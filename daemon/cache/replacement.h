/* SPDX-License-Identifier: MIT */
/**
 * replacement.h - in which order the payloads that nobody holds go when room is needed.
 *
 * One object a store, or none for LRU, for which the cache's list is enough.  It knows nodes by index,
 * their pages, when each was let go and when it was wanted again.  It does no I/O, reads no clock, and
 * does the same after the same calls: the daemon and `oocbench replay` use it alike.  It says what each
 * is worth, not who goes: the cache makes room in windows of neighbours (arena.h), and holds come first.
 *
 * Time is counted in pages let go, so that nothing ages while nothing happens.
 *
 *	reuse  two caches are imagined beside the real one, as large as it: one evicts as LRU does, the
 *	       other what reuse.h says is worth least.  Only who would be in them is kept, and what they
 *	       would have read of late.  The one that leads says who really goes: LRU, until the other
 *	       would have read 3 % less, and the other until LRU would have.
 *	lru    what was not used for the longest goes first
 *
 * Source: LRU, Bach (1986), sec. 3.2.  Imagined caches: Gramacy, Warmuth, Brandt & Ari, "Adaptive
 *	Caching by Refetching", NIPS 2002; here of two policies, with a margin in place of weights.
 *
 * Threads: loop thread.  Memory: 66 bytes a node, at creation.
 */
#ifndef DAEMON_CACHE_REPLACEMENT_H
#define DAEMON_CACHE_REPLACEMENT_H

#include <stdbool.h>
#include <stdint.h>

/* One X(name) for each policy, the usual one first. */
#define REPLACEMENTS(X) X(reuse) X(lru)

enum replacement_policy {
#define REPLACEMENT_VALUE(name) REPLACEMENT_##name,
	REPLACEMENTS(REPLACEMENT_VALUE)
#undef REPLACEMENT_VALUE
	REPLACEMENT_COUNT_
};

/** "reuse".  Never NULL. */
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
 * was_used:  somebody had held it; else it was prefetched
 */
void replacement_let_go(struct replacement *replacement, uint32_t index, uint32_t pages,
			bool was_used);
/**
 * Somebody holds the node who did not, whether it may have gone (then it may not now), came, or had gone.
 *
 * pages:       of it, always the same
 * room_pages:  of the cache, as of now
 */
void replacement_use(struct replacement *replacement, uint32_t index, uint32_t pages,
		     uint64_t room_pages);
/** It has gone. */
void replacement_evict(struct replacement *replacement, uint32_t index);
/** It could not be had. */
void replacement_fail(struct replacement *replacement, uint32_t index);

/**
 * Some of the nodes that may go, at random (with a seed that is always the same), perhaps one twice.
 *
 * Returns: how many there are in ret, up to count_max.
 */
uint32_t replacement_sample(struct replacement *replacement, uint32_t *ret, uint32_t count_max);

/** Does LRU say who goes, by the cache's list?  NULL, which is LRU, is allowed. */
bool replacement_is_lru(const struct replacement *replacement);

/** What reuse.h says a page of a node that may go is worth, as of now.  1 .. 2^34. */
uint64_t replacement_worth(struct replacement *replacement, uint32_t index);
/** What LRU takes a page to be worth: a use in as much time as it has been without one.  1 .. 2^33. */
uint64_t replacement_lru_worth(uint64_t age);

/** How many may go. */
uint32_t replacement_count(const struct replacement *replacement);
/** May it go? */
bool replacement_has(const struct replacement *replacement, uint32_t index);

/** Asserts that lists and counts agree.  O(nodes). */
void replacement_check(const struct replacement *replacement);

#endif /* DAEMON_CACHE_REPLACEMENT_H */
