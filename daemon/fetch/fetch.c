/* SPDX-License-Identifier: MIT */
#include "daemon/fetch/fetch.h"

#include <errno.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/fetch/fetch_backend.h"
#include "daemon/limits.h"
#include "formats/base/check.h"
#include "formats/base/list.h"

#define NO_INDEX UINT32_MAX

/* A request that is not finished. */
struct fetch_job {
	struct fetch_request request;
	struct list link; /* fetch.waiting while pieces are left to be read, else fetch.free_jobs */
	uint32_t next_bytes; /* where the next piece begins */
	uint32_t pieces_in_flight;
	int error;  /* the first one */
	bool alone; /* the piece that it shared has failed: its next one is not shared */
	bool in_use;
};

/* What a piece reads for one request. */
struct fetch_part {
	uint32_t job;
	uint32_t offset_bytes; /* in the request */
	uint32_t at_bytes;     /* in the piece */
	uint32_t bytes;        /* less than whole blocks at the end of the extent */
};

/* A piece that is being put together (fetch.open_op), or with the back end. */
struct fetch_op {
	uint32_t generation; /* +1 at each use: a late event cannot be taken for a new one */
	uint32_t next_free;
	uint32_t file;
	uint64_t file_offset;
	uint32_t bytes; /* a multiple of blocks */
	uint32_t done_bytes;
	uint32_t retry_count;
	bool in_flight;
	uint32_t part_count;
	struct fetch_part parts[FETCH_PART_COUNT_MAX];
	struct iovec vector[FETCH_PART_COUNT_MAX]; /* the kernel may read it until it has ended */
};

struct fetch {
	struct fetch_backend *backend;
	fetch_done_fn done;
	void *done_arg;
	struct why degraded;
	uint32_t depth;
	uint64_t read_bytes;
	uint32_t in_flight;  /* ops in use, the open one included */
	bool draining;       /* was full: nothing begins until a part of it is free */
	uint32_t first_free; /* op */
	uint32_t open_op;    /* that the next request may join; NO_INDEX: none */
	struct list waiting;
	uint32_t waiting_count;
	struct list free_jobs;
	int files[FETCH_FILE_COUNT_MAX]; /* -1: none */
	bool buffers[FETCH_BUFFER_COUNT_MAX];
	struct fetch_job jobs[FILL_COUNT_MAX];
	struct fetch_op ops[];
};

static int backend_create(const struct fetch_config *config, struct why *degraded,
			  struct fetch_backend **ret, struct why *why)
{
	int r;

	switch (config->kind) {
	case FETCH_AUTO:
		r = fetch_uring_create(config->depth, ret, degraded);
		return r < 0 ? fetch_pread_create(config->depth, ret, why) : r;
	case FETCH_URING:
		return fetch_uring_create(config->depth, ret, why);
	case FETCH_PREAD:
		return fetch_pread_create(config->depth, ret, why);
	case FETCH_SIM:
		return fetch_sim_create(config->depth, &config->sim, ret, why);
	}
	return why_set(why, -EINVAL, "no such back end");
}

int fetch_create(const struct fetch_config *config, struct fetch **ret, struct why *why)
{
	struct fetch *fetch;
	int r;

	CHECK(config->depth >= 1 && config->depth <= FETCH_DEPTH_MAX);
	fetch = calloc(1, sizeof(*fetch) + config->depth * sizeof(struct fetch_op));
	if (!fetch)
		return why_errno(why, -ENOMEM, "fetch queue");
	r = backend_create(config, &fetch->degraded, &fetch->backend, why);
	if (r >= 0 && config->disk)
		r = fetch_disk_create(config->depth, config->disk, fetch->backend, &fetch->backend,
				      why);
	if (r < 0) {
		free(fetch);
		return r;
	}
	if (config->kind != FETCH_AUTO || strcmp(fetch->backend->name, "uring") == 0)
		fetch->degraded.text[0] = '\0';
	fetch->done = config->done;
	fetch->done_arg = config->done_arg;
	fetch->depth = config->depth;
	fetch->open_op = NO_INDEX;
	list_init(&fetch->waiting);
	list_init(&fetch->free_jobs);
	for (uint32_t i = 0; i < FILL_COUNT_MAX; i++)
		list_push_back(&fetch->free_jobs, &fetch->jobs[i].link);
	for (uint32_t i = 0; i < config->depth; i++)
		fetch->ops[i].next_free = i + 1 < config->depth ? i + 1 : NO_INDEX;
	for (uint32_t i = 0; i < FETCH_FILE_COUNT_MAX; i++)
		fetch->files[i] = -1;
	*ret = fetch;
	return 0;
}

struct fetch *fetch_destroy(struct fetch *fetch)
{
	if (!fetch)
		return NULL;
	fetch->backend->calls->destroy(fetch->backend);
	free(fetch);
	return NULL;
}

const char *fetch_name(const struct fetch *fetch)
{
	return fetch->backend->name;
}

const char *fetch_degraded(const struct fetch *fetch)
{
	return fetch->degraded.text;
}

int fetch_add_file(struct fetch *fetch, int fd, uint32_t *ret_file)
{
	CHECK(fd >= 0);
	for (uint32_t i = 0; i < FETCH_FILE_COUNT_MAX; i++) {
		int r;

		if (fetch->files[i] >= 0)
			continue;
		r = fetch->backend->calls->set_file(fetch->backend, i, fd);
		if (r < 0)
			return r;
		fetch->files[i] = fd;
		*ret_file = i;
		return 0;
	}
	return -EMFILE;
}

void fetch_remove_file(struct fetch *fetch, uint32_t file)
{
	CHECK(file < FETCH_FILE_COUNT_MAX && fetch->files[file] >= 0);
	(void)fetch->backend->calls->set_file(fetch->backend, file, -1);
	fetch->files[file] = -1;
}

int fetch_add_buffer(struct fetch *fetch, void *base, uint64_t bytes, uint32_t *ret_buffer)
{
	if (!fetch->backend->calls->set_buffer)
		return -EOPNOTSUPP;
	for (uint32_t i = 0; i < FETCH_BUFFER_COUNT_MAX; i++) {
		int r;

		if (fetch->buffers[i])
			continue;
		r = fetch->backend->calls->set_buffer(fetch->backend, i, base, bytes);
		if (r < 0)
			return r;
		fetch->buffers[i] = true;
		*ret_buffer = i;
		return 0;
	}
	return -EMFILE;
}

void fetch_remove_buffer(struct fetch *fetch, uint32_t buffer)
{
	if (buffer == FETCH_BUFFER_NONE)
		return;
	CHECK(buffer < FETCH_BUFFER_COUNT_MAX && fetch->buffers[buffer]);
	(void)fetch->backend->calls->set_buffer(fetch->backend, buffer, NULL, 0);
	fetch->buffers[buffer] = false;
}

/* Not a pointer: an index with a generation can be checked before it is followed. */
static uint64_t op_tag(const struct fetch *fetch, const struct fetch_op *op)
{
	return (uint64_t)op->generation << 32 | (uint64_t)(op - fetch->ops);
}

static struct fetch_op *op_of_tag(struct fetch *fetch, uint64_t tag)
{
	uint32_t index = (uint32_t)tag;
	struct fetch_op *op;

	CHECK(index < fetch->depth);
	op = &fetch->ops[index];
	CHECK(op->in_flight);
	CHECK(op->generation == (uint32_t)(tag >> 32));
	return op;
}

static uint32_t whole_blocks(uint32_t bytes)
{
	return (uint32_t)bytes_round_up(bytes, STORE_BLOCK_BYTES);
}

/*
 * Where what is left of a piece goes.  Neighbours in the file are often neighbours in memory too, and
 * then in a registered buffer, which is the cheapest way to read.
 */
static uint32_t op_aim(struct fetch *fetch, struct fetch_op *op, uint32_t *ret_buffer)
{
	struct iovec *last = NULL;
	uint32_t count = 0;

	for (uint32_t i = 0; i < op->part_count; i++) {
		const struct fetch_part *part = &op->parts[i];
		const struct fetch_request *request = &fetch->jobs[part->job].request;
		uint32_t end_bytes = part->at_bytes + whole_blocks(part->bytes);
		uint32_t at_bytes = (uint32_t)u64_max(part->at_bytes, op->done_bytes);
		uint8_t *to = (uint8_t *)request->destination + part->offset_bytes +
			      (at_bytes - part->at_bytes);

		if (end_bytes <= op->done_bytes)
			continue;
		if (last && (uint8_t *)last->iov_base + last->iov_len == to &&
		    *ret_buffer == request->buffer) {
			last->iov_len += end_bytes - at_bytes;
			continue;
		}
		last = &op->vector[count++];
		*last = (struct iovec){ to, end_bytes - at_bytes };
		*ret_buffer = request->buffer;
	}
	return count;
}

/* Gives what is left of a piece to the back end. */
static void op_submit(struct fetch *fetch, struct fetch_op *op)
{
	struct fetch_piece piece = {
		.tag = op_tag(fetch, op),
		.file = op->file,
		.buffer = FETCH_BUFFER_NONE,
		.file_offset = op->file_offset + op->done_bytes,
		.vector = op->vector,
	};

	piece.vector_count = op_aim(fetch, op, &piece.buffer);
	if (piece.vector_count > 1)
		piece.buffer = FETCH_BUFFER_NONE;
	op->in_flight = true;
	fetch->backend->calls->submit(fetch->backend, &piece);
}

/* The piece is as long as it gets. */
static void op_close(struct fetch *fetch)
{
	if (fetch->open_op != NO_INDEX)
		op_submit(fetch, &fetch->ops[fetch->open_op]);
	fetch->open_op = NO_INDEX;
}

/*
 * A queue that was full is not filled up piece by piece, but when half of it is free.  Pieces that go out
 * together cost one system call, neighbours in the file one request to the disk; they come back with
 * fewer wake-ups, and are verified and told of together.  The disk has the other half meanwhile.
 */
static void note_depth(struct fetch *fetch)
{
	if (fetch->in_flight == fetch->depth)
		fetch->draining = true;
	else if (fetch->in_flight <= fetch->depth - fetch->depth / FETCH_REFILL_SHARE)
		fetch->draining = false;
}

static struct fetch_op *op_open(struct fetch *fetch, const struct fetch_job *job)
{
	struct fetch_op *op = &fetch->ops[fetch->first_free];

	CHECK(fetch->first_free != NO_INDEX && !op->in_flight);
	fetch->open_op = fetch->first_free;
	fetch->first_free = op->next_free;
	fetch->in_flight++;
	note_depth(fetch);
	op->generation++;
	op->file = job->request.file;
	op->file_offset = job->request.file_offset + job->next_bytes;
	op->bytes = 0;
	op->done_bytes = 0;
	op->retry_count = 0;
	op->part_count = 0;
	return op;
}

static bool op_can_grow(const struct fetch_op *op)
{
	return op->bytes < FETCH_PIECE_BYTES && op->part_count < FETCH_PART_COUNT_MAX;
}

/* A request joins with its end only: it can be taken back by going back to where the part begins. */
static bool op_can_take(const struct fetch *fetch, const struct fetch_op *op,
			const struct fetch_job *job)
{
	const struct fetch_request *request = &job->request;

	return op_can_grow(op) && !job->alone && !fetch->jobs[op->parts[0].job].alone &&
	       request->file == op->file &&
	       request->file_offset + job->next_bytes == op->file_offset + op->bytes &&
	       request->bytes - job->next_bytes <= FETCH_PIECE_BYTES - op->bytes;
}

static void op_add(struct fetch *fetch, struct fetch_op *op, struct fetch_job *job)
{
	uint32_t left_bytes = job->request.bytes - job->next_bytes;
	struct fetch_part part = {
		.job = (uint32_t)(job - fetch->jobs),
		.offset_bytes = job->next_bytes,
		.at_bytes = op->bytes,
		.bytes = (uint32_t)u64_min(left_bytes, FETCH_PIECE_BYTES),
	};

	op->parts[op->part_count++] = part;
	op->bytes += whole_blocks(part.bytes);
	job->next_bytes += part.bytes;
	job->pieces_in_flight++;
}

static void waiting_add(struct fetch *fetch, struct fetch_job *job)
{
	list_push_back(&fetch->waiting, &job->link);
	fetch->waiting_count++;
}

static void waiting_remove(struct fetch *fetch, struct fetch_job *job)
{
	list_remove(&job->link);
	fetch->waiting_count--;
}

/* Keeps the queue full: requests in their order, long ones a piece at a turn. */
static void pieces_begin(struct fetch *fetch)
{
	while (!list_is_empty(&fetch->waiting)) {
		struct fetch_job *job = LIST_ENTRY(fetch->waiting.next, struct fetch_job, link);

		if (fetch->open_op == NO_INDEX ||
		    !op_can_take(fetch, &fetch->ops[fetch->open_op], job)) {
			if (fetch->draining)
				return;
			op_close(fetch);
			(void)op_open(fetch, job);
		}
		op_add(fetch, &fetch->ops[fetch->open_op], job);
		waiting_remove(fetch, job);
		/* Long ones take turns, with those that come meanwhile as well. */
		if (job->next_bytes < job->request.bytes)
			waiting_add(fetch, job);
	}
}

int fetch_start(struct fetch *fetch, const struct fetch_request *request)
{
	struct fetch_job *job;

	CHECK(request->bytes > 0);
	CHECK(request->file < FETCH_FILE_COUNT_MAX && fetch->files[request->file] >= 0);
	CHECK(bytes_is_aligned(request->file_offset, STORE_BLOCK_BYTES));
	CHECK(bytes_is_aligned((uintptr_t)request->destination, STORE_BLOCK_BYTES));
	if (list_is_empty(&fetch->free_jobs))
		return -EAGAIN;
	job = LIST_ENTRY(fetch->free_jobs.next, struct fetch_job, link);
	list_remove(&job->link);
	CHECK(!job->in_use);
	job->request = *request;
	job->next_bytes = 0;
	job->pieces_in_flight = 0;
	job->error = 0;
	job->alone = false;
	job->in_use = true;
	waiting_add(fetch, job);
	pieces_begin(fetch);
	return 0;
}

void fetch_flush(struct fetch *fetch)
{
	op_close(fetch);
	fetch->backend->calls->flush(fetch->backend);
}

bool fetch_has_room(const struct fetch *fetch)
{
	if (list_is_empty(&fetch->free_jobs) || fetch->waiting_count == FETCH_WAITING_MAX)
		return false;
	/* One that has not begun waits for its first piece: no other is put behind it. */
	LIST_FOR_EACH (link, &fetch->waiting)
		if (LIST_ENTRY(link, struct fetch_job, link)->next_bytes == 0)
			return false;
	return fetch->waiting_count > 0 || !fetch->draining ||
	       (fetch->open_op != NO_INDEX && op_can_grow(&fetch->ops[fetch->open_op]));
}

bool fetch_has_room_for(const struct fetch *fetch, uint32_t owner, uint32_t pieces_max)
{
	uint32_t piece_count = 0;

	LIST_FOR_EACH (link, &fetch->waiting)
		if (LIST_ENTRY(link, struct fetch_job, link)->request.owner == owner)
			return false;
	for (uint32_t i = 0; i < fetch->depth; i++) {
		const struct fetch_op *op = &fetch->ops[i];

		piece_count += (op->in_flight || i == fetch->open_op) &&
			       fetch->jobs[op->parts[0].job].request.owner == owner;
	}
	return piece_count < pieces_max && fetch_has_room(fetch);
}

uint32_t fetch_depth(const struct fetch *fetch)
{
	return fetch->depth;
}

uint32_t fetch_in_flight(const struct fetch *fetch)
{
	return fetch->in_flight;
}

uint64_t fetch_read_bytes(const struct fetch *fetch)
{
	return fetch->read_bytes;
}

int fetch_fd(const struct fetch *fetch)
{
	return fetch->backend->calls->fd(fetch->backend);
}

/* What a piece read for a request is over.  The job is free before the caller is told. */
static void part_end(struct fetch *fetch, struct fetch_job *job, int error)
{
	uint64_t tag = job->request.tag;

	CHECK(job->pieces_in_flight > 0);
	job->pieces_in_flight--;
	if (error < 0 && job->error == 0) {
		/* What was not begun need not be read. */
		job->error = error;
		if (job->next_bytes < job->request.bytes)
			waiting_remove(fetch, job);
		job->next_bytes = job->request.bytes;
	}
	if (job->pieces_in_flight > 0 || job->next_bytes < job->request.bytes)
		return;
	error = job->error;
	job->in_use = false;
	list_push_back(&fetch->free_jobs, &job->link);
	fetch->done(fetch->done_arg, tag, error);
}

/* The end of a request, that failed together with others, is read again by itself. */
static void part_again(struct fetch *fetch, struct fetch_job *job, const struct fetch_part *part)
{
	CHECK(job->pieces_in_flight > 0 && job->next_bytes == job->request.bytes);
	job->pieces_in_flight--;
	job->next_bytes = part->offset_bytes;
	job->alone = true;
	list_push_front(&fetch->waiting, &job->link);
	fetch->waiting_count++;
}

/* The piece is over.  The op is free before callers are told, who may start the next. */
static void op_end(struct fetch *fetch, struct fetch_op *op, int error)
{
	struct fetch_part parts[FETCH_PART_COUNT_MAX];
	uint32_t part_count = op->part_count;
	uint32_t done_bytes = op->done_bytes;

	memcpy(parts, op->parts, part_count * sizeof(parts[0]));
	op->in_flight = false;
	op->next_free = fetch->first_free;
	fetch->first_free = (uint32_t)(op - fetch->ops);
	CHECK(fetch->in_flight > 0);
	fetch->in_flight--;
	note_depth(fetch);
	for (uint32_t i = 0; i < part_count; i++) {
		struct fetch_job *job = &fetch->jobs[parts[i].job];
		bool is_read = error == 0 || parts[i].at_bytes + parts[i].bytes <= done_bytes;

		if (is_read)
			part_end(fetch, job, 0);
		else if (part_count == 1 || job->error < 0)
			part_end(fetch, job, error);
		else
			part_again(fetch, job, &parts[i]);
	}
}

/* Less than op.bytes where an extent ends within a block, which may be where the file ends. */
static uint32_t op_wanted_bytes(const struct fetch_op *op)
{
	const struct fetch_part *last = &op->parts[op->part_count - 1];

	return last->at_bytes + last->bytes;
}

/*
 * Three things are not errors, and make the rest of the piece be read again: EINTR and EAGAIN, which
 * say that nothing was read, and a short read, which the kernel may give at any time.  Direct reads
 * begin on blocks, so a short read counts only up to its last whole block.  Retries without progress
 * are counted: a device that never gets anywhere ends in an error, not in a loop.  A read of 0 bytes
 * is the end of the file: the store promised more.
 */
static void on_event(struct fetch *fetch, struct fetch_event event)
{
	struct fetch_op *op = op_of_tag(fetch, event.tag);
	uint32_t done_bytes;

	if (event.result > 0)
		fetch->read_bytes += (uint32_t)event.result;
	if (event.result < 0 && event.result != -EINTR && event.result != -EAGAIN) {
		op_end(fetch, op, event.result);
		return;
	}
	if (event.result == 0) {
		op_end(fetch, op, -ENODATA);
		return;
	}
	done_bytes = op->done_bytes + (event.result > 0 ? (uint32_t)event.result : 0);
	CHECK(done_bytes <= op->bytes);
	if (done_bytes >= op_wanted_bytes(op)) {
		op_end(fetch, op, 0);
		return;
	}
	done_bytes &= ~(STORE_BLOCK_BYTES - 1);
	op->retry_count = done_bytes > op->done_bytes ? 0 : op->retry_count + 1;
	op->done_bytes = done_bytes;
	/* Always the same part of a block: the file ends inside it. */
	if (op->retry_count > FETCH_RETRY_MAX)
		op_end(fetch, op, event.result > 0 ? -ENODATA : -EIO);
	else
		op_submit(fetch, op);
}

void fetch_dispatch(struct fetch *fetch)
{
	struct fetch_event events[FETCH_REAP_COUNT_MAX];
	size_t count = fetch->backend->calls->reap(fetch->backend, events, FETCH_REAP_COUNT_MAX);

	for (size_t i = 0; i < count; i++)
		on_event(fetch, events[i]);
	pieces_begin(fetch);
}
