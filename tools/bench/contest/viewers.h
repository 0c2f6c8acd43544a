/* SPDX-License-Identifier: MIT */
/**
 * viewers.h - the memory that many viewers of one store have of their own, and share.
 *
 * Threads: the main thread.
 */
#ifndef TOOLS_BENCH_CONTEST_VIEWERS_H
#define TOOLS_BENCH_CONTEST_VIEWERS_H

#include <stdbool.h>

#include "formats/base/why.h"

#define VIEWERS_COUNT_MAX 64u

struct viewers_config {
	const char *socket_path; /* of the daemon */
	const char *store;
	const char *path; /* that they go along, again and again */
	unsigned viewer_count;
	unsigned seconds; /* after which they are looked at */
	bool is_control; /* they draw one node each: what is left is the window's and the driver's */
	bool is_single;  /* llvmpipe without threads of its own (LP_NUM_THREADS=0) */
};

/** Bytes. */
struct viewers_memory {
	double private_bytes[VIEWERS_COUNT_MAX]; /* of each: given back when it ends */
	double all_bytes; /* of all: what they share counts once (the sum of their PSS) */
};

/** Returns: 0, -ECHILD (one has ended), -ECANCELED or -errno. */
int viewers_measure(const struct viewers_config *config, struct viewers_memory *ret,
		    struct why *why);

#endif /* TOOLS_BENCH_CONTEST_VIEWERS_H */
