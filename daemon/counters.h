/* SPDX-License-Identifier: MIT */
/**
 * counters.h - what has happened to a store's payloads since the daemon began, in one list.
 *
 * The list makes the struct, its sums, the status and the metrics, so that none of them forgets one.
 * daemon/README.md says how they add up; tests/integration/test_counters.c holds the daemon to it.
 *
 * Threads: loop thread.
 */
#ifndef DAEMON_COUNTERS_H
#define DAEMON_COUNTERS_H

#include <stdint.h>

#include "libclient/wire.h"

/** X(name, what one more of it means) */
#define STORE_COUNTERS(X)                                                                          \
	X(hits, "Nodes that sets began to want and that were there")                               \
	X(misses, "Nodes that sets began to want and that were not there")                         \
	X(retries, "Nodes refused for room that were asked for again by themselves")               \
	X(joined, "Misses and retries that a read already begun for another served")               \
	X(refused, "Misses and retries that were refused")                                         \
	X(dropped, "Misses and retries that were given up before a read was begun")                \
	X(fetches, "Reads begun for a miss or a retry")                                            \
	X(prefetches, "Reads begun because a node may be wanted soon")                             \
	X(upgrades, "Prefetches that a set wanted while they were being read")                     \
	X(filled, "Reads that ended with a verified payload in the cache")                         \
	X(errors, "Reads that failed, or whose payload was damaged")                               \
	X(fragmented, "Reads that found no place though enough was free in smaller pieces")        \
	X(shared_hits, "Hits on nodes that had been read for another client")                      \
	X(prefetch_hits, "Hits on nodes that a prefetch brought and nobody had used")              \
	X(prefetch_used, "Prefetched nodes that somebody came to hold")                            \
	X(prefetch_wasted, "Prefetched nodes that were evicted before anybody held them")          \
	X(evictions, "Payloads that left the cache")                                               \
	X(regrets, "Fetches of nodes that were evicted within the ten seconds before")             \
	X(holds, "Holds taken")                                                                    \
	X(releases, "Holds given back")                                                            \
	X(revocations, "Holds withdrawn for something more important")                             \
	X(read_bytes, "Bytes of payloads as stored, read whole")

struct store_counters {
#define COUNTER_FIELD(name, help) uint64_t name;
	STORE_COUNTERS(COUNTER_FIELD)
#undef COUNTER_FIELD
	uint64_t refusals[WIRE_REASON_COUNT_]; /* nodes refused, by reason; each time */
};

static inline void store_counters_add(struct store_counters *sum,
				      const struct store_counters *counters)
{
#define COUNTER_ADD(name, help) sum->name += counters->name;
	STORE_COUNTERS(COUNTER_ADD)
#undef COUNTER_ADD
	for (uint32_t i = 0; i < WIRE_REASON_COUNT_; i++)
		sum->refusals[i] += counters->refusals[i];
}

#endif /* DAEMON_COUNTERS_H */
