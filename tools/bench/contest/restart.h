/* SPDX-License-Identifier: MIT */
/**
 * restart.h - how long a daemon that is killed under load is missed: until a program has its first
 * complete frame again, and until all that was kept is verified.
 *
 * Threads: the main thread.
 */
#ifndef TOOLS_BENCH_CONTEST_RESTART_H
#define TOOLS_BENCH_CONTEST_RESTART_H

#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "tools/bench/base/report.h"

#define RESTART_REPEATS_MAX 100u
#define RESTART_CLIENTS_MAX 64u

struct restart_config {
	const char *store;
	const char *scratch; /* a folder */
	uint64_t
		keep_bytes; /* of payloads; the store is copied as often as that takes.  0: all of it */
	size_t held_count;     /* nodes of a frame */
	unsigned client_count; /* that draw all the while */
	size_t repeat_count;
};

struct restart_result {
	uint32_t store_count;
	uint64_t kept_count; /* payloads */
	uint64_t kept_bytes;
	uint64_t reread_count; /* of all rounds: payloads that were not right and were read again */
	/* One a round, in seconds since the kill. */
	double gone_s
		[RESTART_REPEATS_MAX]; /* the kernel has given back what the killed daemon had */
	double ready_s[RESTART_REPEATS_MAX];       /* the daemon says that it is */
	double first_frame_s[RESTART_REPEATS_MAX]; /* of a program that starts then */
	double verified_s[RESTART_REPEATS_MAX];
	size_t round_count;
	double checksum_s; /* what the checksums of kept_bytes take one thread that does nothing else */
	/* Of those that drew on: between kill and verified. */
	uint64_t frame_count;
	uint64_t incomplete_count; /* frames that lacked a node */
};

/**
 * Returns: 0, -ECANCELED, -ETIMEDOUT (not all that was kept was verified), -ENOSPC or another -errno.
 */
int restart_measure(const struct restart_config *config, struct restart_result *ret,
		    struct why *why);
void restart_report(struct restart_result *result, struct report *report);

#endif /* TOOLS_BENCH_CONTEST_RESTART_H */
