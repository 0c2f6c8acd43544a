/* SPDX-License-Identifier: MIT */
/**
 * trace_code.h - one event, to and from the bytes of a trace.
 *
 * Times and sessions are said only when they change, and nodes by their distance from the one
 * before: both sides keep what was last said in a struct trace_code, which starts as zeros.
 *
 * Threads: any; a struct trace_code belongs to one caller.  Memory: none.
 */
#ifndef FORMATS_TRACE_TRACE_CODE_H
#define FORMATS_TRACE_TRACE_CODE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "formats/trace/trace_layout.h"

struct trace_event {
	enum trace_kind kind; /* neither TIME nor SESSION: these are the next two */
	uint64_t ticks;       /* since the trace began */
	uint32_t session;     /* of BEGIN, END, SET, HIT, MISS, DROP, REFUSE */
	uint32_t entry;       /* of those with ENTRY; of NODE once it was read: its own */
	uint32_t store; /* of OPEN once it was read, CLOSE and NODE: in order of opening, from 0 */
	uint32_t node;  /* NODE: its index in the store */
	uint32_t pages; /* NODE: in memory */
	uint32_t bytes; /* NODE: on disk */
	uint32_t count; /* SET: wants; OPEN: nodes of the store */
	uint8_t uuid[TRACE_UUID_BYTES]; /* OPEN */
	uint32_t path_bytes;            /* OPEN */
	const char *path; /* OPEN: for people; not terminated, inside the bytes that were read */
};

struct trace_code {
	uint64_t ticks;
	uint32_t session;
	uint32_t entries[TRACE_KIND_COUNT_]; /* of the last event of each kind */
};

#define TRACE_NUMBER_BYTES_MAX 10u
/** No event takes more, with the time and the session that it needs said. */
#define TRACE_EVENT_BYTES_MAX                                                                      \
	(6u * TRACE_NUMBER_BYTES_MAX + TRACE_UUID_BYTES + TRACE_PATH_BYTES_MAX)

/** Is the event about a node of the table? */
bool trace_kind_has_entry(enum trace_kind kind);
/** And about one session? */
bool trace_kind_has_session(enum trace_kind kind);
/** "EVICT".  Never NULL. */
const char *trace_kind_name(enum trace_kind kind);

/**
 * Appends an event.
 *
 * event:  its ticks are not below those of the event before.
 * ret:    has TRACE_EVENT_BYTES_MAX bytes.
 *
 * Returns: bytes written.
 */
size_t trace_encode(struct trace_code *code, const struct trace_event *event, uint8_t *ret);

/**
 * Takes the next event out of bytes that may be anything.
 *
 * ret:       all of it is set, but for OPEN's store and NODE's entry, which the reader counts.
 * ret_used:  bytes that it took.
 *
 * Returns: 0, -ENODATA (the bytes end within it, or hold only a time or a session: then these are
 *	kept) or -EUCLEAN (it cannot be).  On failure *ret is undefined.
 */
int trace_decode(struct trace_code *code, const uint8_t *bytes, size_t byte_count,
		 struct trace_event *ret, size_t *ret_used);

#endif /* FORMATS_TRACE_TRACE_CODE_H */
