/* SPDX-License-Identifier: MIT */
/**
 * region.h - memory that can be put back to what it was.
 *
 * While it is on, all that the code under test allocates, memory files included, lies in one piece of
 * memory: a state of all of it is a copy of that piece, kept as what differs from a first copy.  The
 * linker sends the calls here (--wrap, see daemon.cmake).  Freed memory is not used again: it ends
 * with the state.
 *
 * Threads: one.
 */
#ifndef TESTS_MODEL_REGION_H
#define TESTS_MODEL_REGION_H

#include <stddef.h>

struct region_state;

/** Empties it. */
void region_reset(void);
/** Do allocations come from it?  Off at first. */
void region_use(int on);
/** Zeroed memory of it, whether it is on or not. */
void *region_take(size_t size_bytes);

/** What it is now is what states are told against.  Before any region_save(). */
void region_note_base(void);

/** Ownership: free(). */
struct region_state *region_save(void);
void region_load(const struct region_state *state);

#endif /* TESTS_MODEL_REGION_H */
