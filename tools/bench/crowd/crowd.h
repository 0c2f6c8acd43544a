/* SPDX-License-Identifier: MIT */
/**
 * crowd.h - many clients of one daemon that come, look, and are killed.
 *
 * Each client is a process that says random sets again and again, waits until each is settled, and
 * sums payloads that it may draw: a sum that is not the payload's is a wrong byte.  Meanwhile one
 * client after the other is killed and replaced, and the daemon too where that is asked for.  One
 * more client, the prober, is never killed and takes the time of sets that lie in the cache whole.
 * In the end all clients are killed, and what the daemon has then must be what it had before.
 *
 * What a client was refused for room is counted and no failure: more is wanted than fits.
 *
 * Threads: the main thread.
 */
#ifndef TOOLS_BENCH_CROWD_CROWD_H
#define TOOLS_BENCH_CROWD_CROWD_H

#include <stdbool.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "tools/bench/base/figures.h"

struct crowd_config {
	const char *store;
	uint64_t cache_bytes; /* 0: three quarters of what the clients want of the store */
	uint64_t client_count;
	uint64_t set_count;       /* nodes of a set */
	uint64_t sets_per_second; /* of one client, at most */
	uint64_t seconds;
	uint64_t seed;
	uint64_t kill_ms;        /* between two kills of a client; 0: none is killed */
	uint64_t restart_s;      /* between two kills of the daemon; 0: it is not killed */
	uint64_t error_permille; /* of reads fail */
	bool hostile;            /* others do what they may not, all the while */
};

struct crowd_result {
	uint64_t sets;
	uint64_t reads; /* payloads summed */
	uint64_t wrong;
	uint64_t stale;  /* taken away from a client that had been thrown out: it could tell */
	uint64_t failed; /* requests of the living */
	uint64_t refused_full;
	uint64_t refused_unreadable;
	uint64_t lost; /* times that a client found the daemon away */
	uint64_t kills;
	uint64_t restarts;
	uint64_t probes;
	struct distribution probe_ms;
	/* In turn with them, a message as long to a process that only sends it back: the machine's part. */
	struct distribution ping_ms;
	/* The end against the beginning, nobody connected: what was not given back. */
	int64_t leaked_descriptors; /* segments' not counted */
	uint64_t leaked_holds_bytes;
	uint64_t leaked_sessions;
	/* The daemon's own memory, without what is shared: early and late in its longest life. */
	uint64_t memory_early_bytes;
	uint64_t memory_late_bytes;
	uint64_t descriptors_early;
	uint64_t descriptors_late;
	char first_failure[256]; /* of a client; "": none */
};

/**
 * Runs a crowd against a daemon of its own.
 *
 * Returns: 0, whatever the crowd has found; -ECANCELED when interrupted; or -errno (a daemon that ends
 *	although nobody killed it: -ECHILD).
 */
int crowd_run(const struct crowd_config *config, struct crowd_result *ret, struct why *why);

#endif /* TOOLS_BENCH_CROWD_CROWD_H */
