/* SPDX-License-Identifier: MIT */
/**
 * memory_box.h - a control group that holds processes, and the page cache they fill, to a size.
 *
 * Needs the right to make control groups (root, as a rule), of version 2 or 1.
 *
 * Threads: the main thread.
 */
#ifndef TOOLS_BENCH_CONTEST_MEMORY_BOX_H
#define TOOLS_BENCH_CONTEST_MEMORY_BOX_H

#include <limits.h>
#include <stdint.h>

#include "formats/base/why.h"

struct memory_box {
	char folder[PATH_MAX]; /* "": none */
};

/** Returns: 0, or -ENOTSUP with what is missing.  Ownership: ends with memory_box_done(). */
int memory_box_make(uint64_t bytes, struct memory_box *ret, struct why *why);

/** Puts this process, and what it will start, into it.  Returns: 0 or -errno. */
int memory_box_enter(const struct memory_box *box, struct why *why);

/** All that were in it have ended. */
void memory_box_done(struct memory_box *box);

#endif /* TOOLS_BENCH_CONTEST_MEMORY_BOX_H */
