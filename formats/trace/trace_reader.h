/* SPDX-License-Identifier: MIT */
/**
 * trace_reader.h - a trace's events, judged.
 *
 * A trace comes from outside: nothing in it is believed.  What trace_reader_next() gives is sound:
 * entries and stores are there, each with its sizes; a session wants a node once and drops only what
 * it wants; times do not go back.  Memory grows with what the file holds, never with what it claims.
 *
 * Threads: one caller.
 */
#ifndef FORMATS_TRACE_TRACE_READER_H
#define FORMATS_TRACE_TRACE_READER_H

#include <stdbool.h>

#include "formats/base/why.h"
#include "formats/trace/trace_code.h"

struct trace_reader;

/** An entry of the trace's table: a node that something happened to. */
struct trace_entry {
	uint32_t store;
	uint32_t node;
	uint32_t pages;
	uint32_t bytes; /* on disk */
};

struct trace_store {
	uint8_t uuid[TRACE_UUID_BYTES];
	char *path;
	uint32_t node_count;
	bool closed;
};

/**
 * Opens a trace.
 *
 * fd:  taken over, whatever happens.
 *
 * Returns: 0, -ENODATA (too short), -EUCLEAN (no trace), -EBADMSG (its header is damaged),
 *	-EPROTONOSUPPORT (of another version), -ENOMEM or -errno.
 */
int trace_reader_open(int fd, struct trace_reader **ret, struct why *why);
int trace_reader_open_path(const char *path, struct trace_reader **ret, struct why *why);
/** NULL is allowed.  Returns: NULL. */
struct trace_reader *trace_reader_close(struct trace_reader *reader);

const struct trace_header *trace_reader_header(const struct trace_reader *reader);

/**
 * Reads the next event.
 *
 * Returns: 1, 0 (the trace ends here), -EBADMSG (a block is damaged), -EUCLEAN (an event cannot be),
 *	-ENOMEM or -errno; what came before is good.
 */
int trace_reader_next(struct trace_reader *reader, struct trace_event *ret, struct why *why);

/** Did it end within a block, as when the daemon was killed? */
bool trace_reader_was_cut(const struct trace_reader *reader);

/** What was read so far: entries and stores are counted from 0 as they come. */
uint32_t trace_reader_entry_count(const struct trace_reader *reader);
const struct trace_entry *trace_reader_entry(const struct trace_reader *reader, uint32_t entry);
uint32_t trace_reader_store_count(const struct trace_reader *reader);
const struct trace_store *trace_reader_store(const struct trace_reader *reader, uint32_t store);
/** Bytes of events so far. */
uint64_t trace_reader_event_bytes(const struct trace_reader *reader);

#endif /* FORMATS_TRACE_TRACE_READER_H */
