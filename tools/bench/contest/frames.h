/* SPDX-License-Identifier: MIT */
/**
 * frames.h - what a frame costs a program that holds nodes: the calls of the library that it makes
 * each frame, while nobody waits for the answer.
 *
 * Threads: the main thread.
 */
#ifndef TOOLS_BENCH_CONTEST_FRAMES_H
#define TOOLS_BENCH_CONTEST_FRAMES_H

#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"

/** Shares of the set that are others than in the frame before, in percent. */
#define FRAMES_SHARE_COUNT 3u
extern const unsigned frames_shares[FRAMES_SHARE_COUNT];

#define FRAMES_CLIENT_COUNT_MAX 64u

struct frames_config {
	const char *socket_path;
	const char *store;
	size_t held_count;  /* nodes of a set; fewer where the store has not twice as many */
	size_t frame_count; /* of each share */
	double rate;        /* frames a second */
};

/** Microseconds, one a frame. */
struct frames_cost {
	double *set_us; /* ooc_dispatch() and ooc_visible_set() */
	double *map_us; /* ooc_map() of every node */
	/*
	 * What it cannot go below: where nothing changed, a compare of as many bytes as a set has; else
	 * a message as long to a process that takes it and does nothing.  NULL: not measured.
	 */
	double *floor_us;
	size_t count;
	double system_calls; /* a frame, in the first of the two; NaN: they cannot be counted here */
};

struct frames_one {
	struct frames_cost costs[FRAMES_SHARE_COUNT];
	size_t held_count; /* as it was */
};

/**
 * One client, the shares in turn.
 *
 * Returns: 0, -ECANCELED, -ENOMEM or what the daemon said.
 * Ownership: ends with frames_one_done().
 */
int frames_measure_one(const struct frames_config *config, struct frames_one *ret, struct why *why);
void frames_one_done(struct frames_one *one);

struct frames_crowd {
	struct frames_cost cost; /* of all clients; no system calls */
	double answered_low; /* sets that the daemon answered a second, of the client with fewest */
	double answered_high;
};

/** Many clients at one time, each in its own process, with share_percent of each set new. */
int frames_measure_crowd(const struct frames_config *config, unsigned client_count,
			 unsigned share_percent, struct frames_crowd *ret, struct why *why);
void frames_crowd_done(struct frames_crowd *crowd);

#endif /* TOOLS_BENCH_CONTEST_FRAMES_H */
