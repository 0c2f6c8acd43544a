/* SPDX-License-Identifier: MIT */
/**
 * schedule.h - what a trace asks of a cache, whatever that cache is: who begins and ceases to want
 * what, in steps.
 *
 * A step is what one message did.  In it, what is no longer wanted comes before what is wanted anew,
 * as the daemon does it.  Prefetches are left out: what they are worth is not the cache's doing.
 *
 * Threads: the main thread.
 */
#ifndef TOOLS_BENCH_REPLAY_SCHEDULE_H
#define TOOLS_BENCH_REPLAY_SCHEDULE_H

#include <stdbool.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "formats/trace/trace_reader.h"

enum schedule_op {
	SCHEDULE_DROP,
	SCHEDULE_WANT,
	SCHEDULE_STEP, /* the step ends */
};

struct schedule {
	struct trace_header header;
	struct trace_entry *entries;
	uint32_t entry_count;
	uint32_t store_count;
	uint64_t *ops; /* entry << 2 | enum schedule_op */
	uint64_t op_count;
	uint64_t op_room;
	uint64_t step_count;
	uint64_t want_count;
	uint64_t set_count;
	uint32_t viewer_count;
	double seconds;
	bool was_cut;
};

static inline enum schedule_op schedule_op_of(uint64_t op)
{
	return (enum schedule_op)(op & 3);
}

static inline uint32_t schedule_entry_of(uint64_t op)
{
	return (uint32_t)(op >> 2);
}

/**
 * Reads a trace.
 *
 * Returns: 0, -ENOMEM, or what trace_reader.h says.  Ownership: ends with schedule_done().
 */
int schedule_read(const char *path, struct schedule *ret, struct why *why);
void schedule_done(struct schedule *schedule);

#endif /* TOOLS_BENCH_REPLAY_SCHEDULE_H */
