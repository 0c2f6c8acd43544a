/* SPDX-License-Identifier: MIT */
/**
 * trace_writer.h - appends events to a trace's file without ever waiting for the disk.
 *
 * Events are gathered in blocks; a thread of the writer's own writes them.  What waits for the disk is
 * bounded (TRACE_WRITER_BYTES): a disk that cannot keep up, is full or fails ends the trace, whose
 * file then holds whole blocks up to there.  trace_writer_error() says so; events after that are
 * dropped.
 *
 * Threads: one caller.  Memory: all at creation.
 */
#ifndef FORMATS_TRACE_TRACE_WRITER_H
#define FORMATS_TRACE_TRACE_WRITER_H

#include "formats/base/why.h"
#include "formats/trace/trace_code.h"

#define TRACE_WRITER_BLOCKS 64u
#define TRACE_WRITER_BYTES  (TRACE_WRITER_BLOCKS * TRACE_BLOCK_BYTES_MAX)

struct trace_writer;

/**
 * Writes the header and starts the thread.
 *
 * fd:      of an empty file that can be written; taken over, whatever happens.
 * header:  what tells of the run (cache_bytes, start_ns, replacement); the rest is filled in.
 *
 * Returns: 0, -ENOMEM or what writing or starting a thread said.  May block.
 */
int trace_writer_create(int fd, const struct trace_header *header, struct trace_writer **ret,
			struct why *why);

/** Adds an event.  Never blocks. */
void trace_writer_add(struct trace_writer *writer, const struct trace_event *event);

/** Hands over what was gathered, so that it is in the file soon.  Never blocks. */
void trace_writer_flush(struct trace_writer *writer);

/** 0, or why the trace has ended: -EAGAIN (the disk cannot keep up), -ENOSPC or another -errno. */
int trace_writer_error(struct trace_writer *writer);

/** Writes all that was added and closes the file; blocks for it.  NULL is allowed.  Returns: NULL. */
struct trace_writer *trace_writer_destroy(struct trace_writer *writer);

#endif /* FORMATS_TRACE_TRACE_WRITER_H */
