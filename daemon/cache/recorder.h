/* SPDX-License-Identifier: MIT */
/**
 * recorder.h - writes what clients ask and what the cache does to a trace (formats/TRACE.md).
 *
 * One call an event, which costs a test where no trace is written.  A trace never holds the daemon
 * up: it ends with one warning when its disk is full or too slow, and the daemon serves on.
 *
 * Threads: loop thread.  Memory: bounded; four bytes for each node of each open store, and what
 * waits for the disk (TRACE_WRITER_BYTES).
 */
#ifndef DAEMON_CACHE_RECORDER_H
#define DAEMON_CACHE_RECORDER_H

#include <stdint.h>

#include "daemon/cache/served.h"
#include "formats/base/why.h"
#include "formats/trace/trace_layout.h"

struct recorder;

/**
 * Begins a trace.
 *
 * path:  of a file that is written anew.
 *
 * Returns: 0, -ENOMEM or -errno.  May block.
 */
int recorder_create(const char *path, uint64_t cache_bytes, const char *replacement,
		    struct recorder **ret, struct why *why);
/** Ends it; all stores were closed.  May block.  NULL is allowed.  Returns: NULL. */
struct recorder *recorder_destroy(struct recorder *recorder);

/** Once a while: lets what was gathered be written, and ends a trace that cannot be. */
void recorder_tick(struct recorder *recorder);

/** What has ended the trace before its time, or 0.  NULL is allowed. */
int recorder_error(const struct recorder *recorder);

/** A store is served, or no longer.  recorder: NULL: none is written. */
void recorder_open(struct recorder *recorder, struct served *served);
void recorder_close(struct served *served);

/** BEGIN, END and SET of a session.  count: wants of a SET, else 0. */
void recorder_add_session(struct recorder *recorder, enum trace_kind kind, uint32_t session,
			  uint32_t count);
/** What has an entry.  session: 0 for kinds that have none.  The store is recorded. */
void recorder_add_node(struct served *served, enum trace_kind kind, uint32_t session,
		       uint32_t index);

static inline void recorder_session(struct recorder *recorder, enum trace_kind kind,
				    uint32_t session, uint32_t count)
{
	if (recorder)
		recorder_add_session(recorder, kind, session, count);
}

static inline void recorder_want(struct served *served, enum trace_kind kind, uint32_t session,
				 uint32_t index)
{
	if (served->recorded)
		recorder_add_node(served, kind, session, index);
}

static inline void recorder_node(struct served *served, enum trace_kind kind, uint32_t index)
{
	if (served->recorded)
		recorder_add_node(served, kind, 0, index);
}

#endif /* DAEMON_CACHE_RECORDER_H */
