/* SPDX-License-Identifier: MIT */
/**
 * pages.h - which runs of pages of a range are taken, and by whom.
 *
 * It has no memory to give out, only page numbers: an arena's segment and the staging area put the
 * same allocator over different memory.  It never moves a run and never evicts: cache.h does.
 *
 * Runs are kept in address order by a record at their first and last page, and free runs also in
 * lists by size (sixteen classes a power of two), so that taking and giving are O(1) but for the
 * walk through one class.  The best-fitting class is used first, which keeps large runs whole.
 * Source: boundary tags, Knuth (1973) vol. 1, sec. 2.5; two-level segregated fit, Masmano et al.
 * (2004).
 *
 * Threads: loop thread.
 */
#ifndef DAEMON_ARENA_PAGES_H
#define DAEMON_ARENA_PAGES_H

#include <stdbool.h>
#include <stdint.h>

struct pages;

/** Owner of a run that nobody has. */
#define PAGES_FREE UINT32_MAX

/** A run of pages, all free or all of one owner. */
struct pages_run {
	uint32_t first;
	uint32_t count;
	uint32_t owner; /* PAGES_FREE: nobody */
};

/** page_count: 1 .. 2^24.  Returns: 0, -EINVAL or -ENOMEM. */
int pages_create(uint32_t page_count, struct pages **ret);
struct pages *pages_destroy(struct pages *pages);

/**
 * Takes `count` neighbouring pages.
 *
 * count:  >= 1.  owner: not PAGES_FREE.
 *
 * Returns: 0, or -ENOBUFS when no free run is long enough.
 */
int pages_take(struct pages *pages, uint32_t count, uint32_t owner, uint32_t *ret_first);

/**
 * Takes `count` pages from `first` on, behind all that are taken: for filling the range anew in
 * ascending order.
 *
 * Returns: 0, or -ENOBUFS when some of them lie before the end of the last taken run, or behind the
 *	range.
 */
int pages_take_at(struct pages *pages, uint32_t first, uint32_t count, uint32_t owner);

/** Gives back the taken run that begins at `first`, and joins it with free neighbours. */
void pages_give(struct pages *pages, uint32_t first);

uint32_t pages_count(const struct pages *pages);
uint32_t pages_free_count(const struct pages *pages);
/** Longest free run.  O(length of one class). */
uint32_t pages_largest_free(const struct pages *pages);

/** The run that begins at `first`, which must begin one (0 always does). */
struct pages_run pages_run_at(const struct pages *pages, uint32_t first);
/** The run before the one that begins at `first`; first > 0. */
struct pages_run pages_run_before(const struct pages *pages, uint32_t first);

/** Asserts that runs follow each other, free ones are joined and listed, counts add up.  O(runs). */
void pages_check(const struct pages *pages);

#endif /* DAEMON_ARENA_PAGES_H */
