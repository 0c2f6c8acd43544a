/* SPDX-License-Identifier: MIT */
#include "daemon/cache/recorder.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "formats/base/check.h"
#include "formats/base/clock.h"
#include "formats/base/file.h"
#include "formats/base/log.h"
#include "formats/trace/trace_writer.h"

struct recorder {
	struct trace_writer *writer; /* NULL: the trace has ended */
	char *path;
	uint64_t start_ns;
	uint64_t ticks;
	uint32_t store_count; /* that were ever opened */
	uint32_t entry_count; /* that were introduced */
	int error;            /* that has ended it before its time, or 0 */
};

/* A store in the trace. */
struct recorded {
	struct recorder *recorder;
	uint32_t number;
	uint32_t entries[]; /* a node: 0, or 1 + its entry */
};

static uint64_t wall_clock_ns(void)
{
	struct timespec now;

	(void)clock_gettime(CLOCK_REALTIME, &now);
	return (uint64_t)now.tv_sec * NS_PER_S + (uint64_t)now.tv_nsec;
}

int recorder_create(const char *path, uint64_t cache_bytes, const char *replacement,
		    struct recorder **ret, struct why *why)
{
	struct trace_header header = { .cache_bytes = cache_bytes, .start_ns = wall_clock_ns() };
	struct recorder *recorder;
	int fd;
	int r;

	(void)snprintf(header.replacement, sizeof(header.replacement), "%s", replacement);
	/* What clients look at is nobody else's business. */
	fd = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOCTTY | O_NONBLOCK, 0600);
	if (fd < 0)
		return why_errno(why, -errno, "the trace %s", path);
	recorder = calloc(1, sizeof(*recorder));
	if (!recorder || !(recorder->path = strdup(path))) {
		(void)fd_close(fd);
		free(recorder);
		return why_errno(why, -ENOMEM, "the trace %s", path);
	}
	recorder->start_ns = clock_now_ns();
	r = trace_writer_create(fd, &header, &recorder->writer, why);
	if (r < 0) {
		why_prefix(why, "%s", path);
		recorder_destroy(recorder);
		return r;
	}
	*ret = recorder;
	return 0;
}

struct recorder *recorder_destroy(struct recorder *recorder)
{
	if (!recorder)
		return NULL;
	trace_writer_destroy(recorder->writer);
	free(recorder->path);
	free(recorder);
	return NULL;
}

static void end(struct recorder *recorder, int error)
{
	recorder->error = error;
	log_warning("the trace %s ends here: %s; oocd serves on", recorder->path,
		    error == -EAGAIN ? "its disk cannot keep up" : strerror(-error));
	recorder->writer = trace_writer_destroy(recorder->writer);
}

void recorder_tick(struct recorder *recorder)
{
	int error;

	if (!recorder || !recorder->writer)
		return;
	trace_writer_flush(recorder->writer);
	error = trace_writer_error(recorder->writer);
	if (error < 0)
		end(recorder, error);
}

/*
 * The clock is looked at where something comes from outside: a message, a read.  What follows from
 * it in the cache, a thousand events perhaps, has its time.
 */
static void note_time(struct recorder *recorder)
{
	recorder->ticks = (clock_now_ns() - recorder->start_ns) / (NS_PER_S / TRACE_TICKS_PER_S);
}

int recorder_error(const struct recorder *recorder)
{
	return recorder ? recorder->error : 0;
}

void recorder_open(struct recorder *recorder, struct served *served)
{
	struct trace_event event = {
		.kind = TRACE_OPEN,
		.count = served->node_count,
		.path_bytes = (uint32_t)strnlen(served->path, TRACE_PATH_BYTES_MAX),
		.path = served->path,
	};
	struct recorded *recorded;

	if (!recorder || !recorder->writer)
		return;
	recorded = calloc(1, sizeof(*recorded) + served->node_count * sizeof(uint32_t));
	if (!recorded) {
		end(recorder, -ENOMEM);
		return;
	}
	note_time(recorder);
	memcpy(event.uuid, served->superblock->uuid, sizeof(event.uuid));
	event.ticks = recorder->ticks;
	trace_writer_add(recorder->writer, &event);
	recorded->recorder = recorder;
	recorded->number = recorder->store_count++;
	served->recorded = recorded;
}

void recorder_close(struct served *served)
{
	struct recorded *recorded = served->recorded;

	if (!recorded)
		return;
	if (recorded->recorder->writer) {
		note_time(recorded->recorder);
		trace_writer_add(recorded->recorder->writer,
				 &(struct trace_event){ .kind = TRACE_CLOSE,
							.store = recorded->number,
							.ticks = recorded->recorder->ticks });
	}
	free(recorded);
	served->recorded = NULL;
}

void recorder_add_session(struct recorder *recorder, enum trace_kind kind, uint32_t session,
			  uint32_t count)
{
	if (!recorder->writer)
		return;
	note_time(recorder);
	trace_writer_add(recorder->writer, &(struct trace_event){ .kind = kind,
								  .session = session,
								  .count = count,
								  .ticks = recorder->ticks });
}

/* Introduces a node to the trace. */
static uint32_t introduce(struct recorder *recorder, const struct served *served, uint32_t index)
{
	trace_writer_add(recorder->writer,
			 &(struct trace_event){ .kind = TRACE_NODE,
						.ticks = recorder->ticks,
						.store = served->recorded->number,
						.node = index,
						.pages = served_pages(served, index),
						.bytes = served->records[index].stored_bytes });
	return recorder->entry_count++;
}

void recorder_add_node(struct served *served, enum trace_kind kind, uint32_t session,
		       uint32_t index)
{
	struct recorder *recorder = served->recorded->recorder;
	uint32_t *entry = &served->recorded->entries[index];

	if (!recorder->writer)
		return;
	if (kind == TRACE_FETCH || kind == TRACE_PREFETCH || kind == TRACE_READY ||
	    kind == TRACE_FAIL || kind == TRACE_ADOPT)
		note_time(recorder);
	if (*entry == 0)
		*entry = introduce(recorder, served, index) + 1;
	trace_writer_add(recorder->writer, &(struct trace_event){ .kind = kind,
								  .session = session,
								  .entry = *entry - 1,
								  .ticks = recorder->ticks });
}
