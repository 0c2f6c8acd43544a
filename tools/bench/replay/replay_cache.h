/* SPDX-License-Identifier: MIT */
/**
 * replay_cache.h - a schedule done again by the daemon's own cache, without daemon, disk and memory.
 *
 * daemon/cache/cache.c runs as it is, with its windows, segments and policies; only nothing is read, and
 * segments have no memory behind them.  A read is there at once.  What finds no room is read all the
 * same, as a viewer that cannot do without would, and is not kept.
 *
 * Threads: the main thread.
 */
#ifndef TOOLS_BENCH_REPLAY_REPLAY_CACHE_H
#define TOOLS_BENCH_REPLAY_REPLAY_CACHE_H

#include "daemon/cache/replacement.h"
#include "tools/bench/replay/schedule.h"

struct replay_result {
	uint64_t read_bytes;
	uint64_t hit_count;
	uint64_t miss_count;
	uint64_t refused_count; /* of the misses, those that found no room */
	uint64_t eviction_count;
};

/**
 * Does a schedule again.
 *
 * Returns: 0, -ENOBUFS (the cache cannot hold the largest payload) or -ENOMEM.
 */
int replay_cache(const struct schedule *schedule, enum replacement_policy policy,
		 uint64_t cache_bytes, struct replay_result *ret, struct why *why);

#endif /* TOOLS_BENCH_REPLAY_REPLAY_CACHE_H */
