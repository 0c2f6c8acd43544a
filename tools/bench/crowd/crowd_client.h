/* SPDX-License-Identifier: MIT */
/**
 * crowd_client.h - one client of a crowd, in a process of its own.  See crowd.h.
 *
 * What clients find goes to memory that all share, so that nothing of it is lost with a client.
 */
#ifndef TOOLS_BENCH_CROWD_CROWD_CLIENT_H
#define TOOLS_BENCH_CROWD_CROWD_CLIENT_H

#include <stdatomic.h>
#include <stdint.h>
#include <sys/types.h>

#include "tools/bench/crowd/crowd.h"

#define CROWD_PROBES_MAX (1u << 18)
/* Of a store, what clients want. */
#define CROWD_NODES_MAX 4096u

struct crowd_shared {
	_Atomic uint64_t connected; /* clients that have opened the store, ever */
	_Atomic uint64_t sets;
	_Atomic uint64_t reads;
	_Atomic uint64_t wrong;
	_Atomic uint64_t stale;
	_Atomic uint64_t failed;
	_Atomic uint64_t refused_full;
	_Atomic uint64_t refused_unreadable;
	_Atomic uint64_t lost;
	_Atomic uint32_t probe_count;
	double probe_ms[CROWD_PROBES_MAX];
	_Atomic uint32_t ping_count;
	double ping_ms[CROWD_PROBES_MAX]; /* a message as long to a process that sends it back */
	char first_failure[256];

	uint32_t node_count;
	uint32_t nodes[CROWD_NODES_MAX]; /* with payload */
	uint64_t sums[CROWD_NODES_MAX];  /* of the decoded payloads, read from the store itself */
};

/** Starts one.  It runs until it is killed, or its parent dies.  Returns: its pid or -errno. */
pid_t crowd_client_start(const struct crowd_config *config, const char *socket_path,
			 struct crowd_shared *shared, uint64_t seed);

/** Starts the one that takes the time of resident sets. */
pid_t crowd_prober_start(const struct crowd_config *config, const char *socket_path,
			 struct crowd_shared *shared, uint64_t seed);

#endif /* TOOLS_BENCH_CROWD_CROWD_CLIENT_H */
