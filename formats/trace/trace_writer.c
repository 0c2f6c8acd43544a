/* SPDX-License-Identifier: MIT */
#include "formats/trace/trace_writer.h"

#include <errno.h>
#include <pthread.h>
#include <signal.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "formats/base/check.h"
#include "formats/base/file.h"
#include "formats/store/store_checksum.h"

/* A block as it lies in the file. */
struct block {
	struct trace_block head;
	uint8_t events[TRACE_BLOCK_BYTES_MAX];
};

struct trace_writer {
	int fd;
	struct trace_code code;
	pthread_t thread;
	uint64_t file_offset;  /* the thread's */
	uint64_t block_number; /* the thread's */

	pthread_mutex_t mutex; /* all below */
	pthread_cond_t wake;
	bool stop;
	int error;
	/*
	 * A circle: the caller fills blocks[begun % TRACE_WRITER_BLOCKS], the thread writes from
	 * blocks[written % TRACE_WRITER_BLOCKS] on.  begun - written < TRACE_WRITER_BLOCKS.
	 */
	uint64_t begun;
	uint64_t written;
	struct block blocks[TRACE_WRITER_BLOCKS];
};

static struct block *block_of(struct trace_writer *writer, uint64_t number)
{
	return &writer->blocks[number % TRACE_WRITER_BLOCKS];
}

/* On failure what was written of the block is cut off again, where that can be done. */
static int block_write(struct trace_writer *writer, struct block *block)
{
	size_t bytes = sizeof(block->head) + block->head.bytes;
	int r;

	block->head.checksum =
		store_checksum(block->events, block->head.bytes, writer->block_number++);
	r = file_write_at(writer->fd, block, bytes, writer->file_offset);
	if (r < 0)
		(void)!ftruncate(writer->fd, (off_t)writer->file_offset);
	writer->file_offset += bytes;
	return r;
}

static void *writer_thread(void *arg)
{
	struct trace_writer *writer = arg;

	(void)pthread_mutex_lock(&writer->mutex);
	for (;;) {
		struct block *block;
		int r;

		while (writer->written == writer->begun && !writer->stop)
			(void)pthread_cond_wait(&writer->wake, &writer->mutex);
		if (writer->written == writer->begun || writer->error < 0)
			break;
		block = block_of(writer, writer->written);
		(void)pthread_mutex_unlock(&writer->mutex);
		r = block_write(writer, block);
		(void)pthread_mutex_lock(&writer->mutex);
		if (r < 0)
			writer->error = r;
		block->head.bytes = 0;
		writer->written++;
	}
	(void)pthread_mutex_unlock(&writer->mutex);
	return NULL;
}

static int write_header(struct trace_writer *writer, const struct trace_header *given)
{
	struct trace_header header = *given;

	memcpy(header.magic, TRACE_MAGIC, TRACE_MAGIC_BYTES);
	header.version = TRACE_VERSION;
	header.page_bytes = TRACE_PAGE_BYTES;
	header.reserved = 0;
	header.checksum = store_checksum(&header, offsetof(struct trace_header, checksum), 0);
	writer->file_offset = sizeof(header);
	return file_write_at(writer->fd, &header, sizeof(header), 0);
}

/* Signals are the caller's threads' business. */
static int start_thread(struct trace_writer *writer)
{
	sigset_t all;
	sigset_t before;
	int r;

	(void)sigfillset(&all);
	(void)pthread_sigmask(SIG_SETMASK, &all, &before);
	r = pthread_create(&writer->thread, NULL, writer_thread, writer);
	(void)pthread_sigmask(SIG_SETMASK, &before, NULL);
	return -r;
}

int trace_writer_create(int fd, const struct trace_header *header, struct trace_writer **ret,
			struct why *why)
{
	struct trace_writer *writer = calloc(1, sizeof(*writer));
	int r;

	if (!writer) {
		(void)fd_close(fd);
		return why_errno(why, -ENOMEM, "a trace");
	}
	writer->fd = fd;
	(void)pthread_mutex_init(&writer->mutex, NULL);
	(void)pthread_cond_init(&writer->wake, NULL);
	r = write_header(writer, header);
	if (r == 0)
		r = start_thread(writer);
	if (r < 0) {
		(void)fd_close(fd);
		(void)pthread_cond_destroy(&writer->wake);
		(void)pthread_mutex_destroy(&writer->mutex);
		free(writer);
		return why_errno(why, r, "a trace");
	}
	*ret = writer;
	return 0;
}

void trace_writer_flush(struct trace_writer *writer)
{
	if (block_of(writer, writer->begun)->head.bytes == 0)
		return;
	(void)pthread_mutex_lock(&writer->mutex);
	if (writer->begun + 1 - writer->written < TRACE_WRITER_BLOCKS) {
		writer->begun++;
		(void)pthread_cond_signal(&writer->wake);
	} else if (writer->error == 0) {
		writer->error = -EAGAIN;
	}
	(void)pthread_mutex_unlock(&writer->mutex);
}

void trace_writer_add(struct trace_writer *writer, const struct trace_event *event)
{
	/* Only this thread changes `begun`, and the block belongs to it. */
	struct block *block = block_of(writer, writer->begun);

	if (block->head.bytes + TRACE_EVENT_BYTES_MAX > TRACE_BLOCK_BYTES_MAX) {
		trace_writer_flush(writer);
		block = block_of(writer, writer->begun);
		/* It could not be handed over: the trace has ended. */
		if (block->head.bytes > 0)
			return;
	}
	block->head.bytes +=
		(uint32_t)trace_encode(&writer->code, event, block->events + block->head.bytes);
}

int trace_writer_error(struct trace_writer *writer)
{
	int error;

	(void)pthread_mutex_lock(&writer->mutex);
	error = writer->error;
	(void)pthread_mutex_unlock(&writer->mutex);
	return error;
}

struct trace_writer *trace_writer_destroy(struct trace_writer *writer)
{
	if (!writer)
		return NULL;
	trace_writer_flush(writer);
	(void)pthread_mutex_lock(&writer->mutex);
	writer->stop = true;
	(void)pthread_cond_signal(&writer->wake);
	(void)pthread_mutex_unlock(&writer->mutex);
	(void)pthread_join(writer->thread, NULL);
	(void)pthread_cond_destroy(&writer->wake);
	(void)pthread_mutex_destroy(&writer->mutex);
	(void)fd_close(writer->fd);
	free(writer);
	return NULL;
}
