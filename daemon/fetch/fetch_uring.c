/* SPDX-License-Identifier: MIT */
/*
 * The io_uring back end.  The ring can read registered files and nothing else: it is restricted
 * before it is enabled, so that even a daemon that was taken over cannot use it to write, open or
 * connect.  Tables of files and buffers are sparse, and their updates allowed, so that later stores
 * and segments need no new ring.
 *
 * Without DEFER_TASKRUN: a ring with it stays readable in epoll unless events are fetched by an
 * extra system call.  Without SQPOLL: its thread would take a core from the viewers.
 */
#include <errno.h>
#include <liburing.h>
#include <stdlib.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "daemon/fetch/fetch_backend.h"
#include "formats/base/check.h"

struct uring {
	struct fetch_backend backend;
	struct io_uring ring;
	uint32_t in_flight;
	uint32_t unsubmitted;
};

static struct uring *uring_of(struct fetch_backend *backend)
{
	return (struct uring *)(void *)backend;
}

/* The library of Debian 12 declares the functions for these two and does not export them. */
static int ring_register(const struct io_uring *ring, unsigned opcode, const void *arg,
			 unsigned count)
{
	return syscall(SYS_io_uring_register, ring->ring_fd, opcode, arg, count) < 0 ? -errno : 0;
}

static int ring_restrict(struct io_uring *ring)
{
	struct io_uring_restriction restrictions[] = {
		{ .opcode = IORING_RESTRICTION_SQE_OP, .sqe_op = IORING_OP_READ },
		{ .opcode = IORING_RESTRICTION_SQE_OP, .sqe_op = IORING_OP_READ_FIXED },
		{ .opcode = IORING_RESTRICTION_SQE_OP, .sqe_op = IORING_OP_READV },
		{ .opcode = IORING_RESTRICTION_SQE_FLAGS_REQUIRED, .sqe_flags = IOSQE_FIXED_FILE },
		{ .opcode = IORING_RESTRICTION_REGISTER_OP,
		  .register_op = IORING_REGISTER_FILES_UPDATE2 },
		{ .opcode = IORING_RESTRICTION_REGISTER_OP,
		  .register_op = IORING_REGISTER_BUFFERS_UPDATE },
	};
	int r;

	r = ring_register(ring, IORING_REGISTER_RESTRICTIONS, restrictions,
			  sizeof(restrictions) / sizeof(restrictions[0]));
	return r < 0 ? r : ring_register(ring, IORING_REGISTER_ENABLE_RINGS, NULL, 0);
}

/* Reads go on inside the kernel although the process lets go, so every one is waited for. */
static void uring_destroy(struct fetch_backend *backend)
{
	struct uring *uring = uring_of(backend);

	while (uring->in_flight > 0) {
		struct io_uring_cqe *cqe;
		int r = io_uring_submit_and_wait(&uring->ring, 1);

		if (r < 0 && r != -EINTR && r != -EAGAIN && r != -EBUSY)
			break;
		while (io_uring_peek_cqe(&uring->ring, &cqe) == 0) {
			io_uring_cqe_seen(&uring->ring, cqe);
			uring->in_flight--;
		}
	}
	io_uring_queue_exit(&uring->ring);
	free(uring);
}

static int uring_set_file(struct fetch_backend *backend, uint32_t file, int fd)
{
	__u64 tag = 0;
	int r = io_uring_register_files_update_tag(&uring_of(backend)->ring, file, &fd, &tag, 1);

	return r < 0 ? r : 0;
}

static int uring_set_buffer(struct fetch_backend *backend, uint32_t buffer, void *base,
			    uint64_t bytes)
{
	struct iovec part = { .iov_base = base, .iov_len = base ? bytes : 0 };
	__u64 tag = 0;
	int r = io_uring_register_buffers_update_tag(&uring_of(backend)->ring, buffer, &part, &tag,
						     1);

	return r < 0 ? r : 0;
}

static void uring_flush(struct fetch_backend *backend)
{
	struct uring *uring = uring_of(backend);

	/* EAGAIN and EBUSY: the kernel is short of something for now; the next round tries again. */
	if (uring->unsubmitted > 0) {
		int r = io_uring_submit(&uring->ring);

		if (r > 0)
			uring->unsubmitted -= (uint32_t)r;
		else
			CHECK(r == 0 || r == -EAGAIN || r == -EBUSY || r == -EINTR || r == -ENOMEM);
	}
}

static void uring_submit(struct fetch_backend *backend, const struct fetch_piece *piece)
{
	struct uring *uring = uring_of(backend);
	struct io_uring_sqe *sqe = io_uring_get_sqe(&uring->ring);

	/* The submission ring has an entry for every piece that may be in flight. */
	CHECK(sqe != NULL);
	if (piece->vector_count > 1)
		io_uring_prep_readv(sqe, (int)piece->file, piece->vector, piece->vector_count,
				    piece->file_offset);
	else if (piece->buffer == FETCH_BUFFER_NONE)
		io_uring_prep_read(sqe, (int)piece->file, piece->vector->iov_base,
				   (unsigned)piece->vector->iov_len, piece->file_offset);
	else
		io_uring_prep_read_fixed(sqe, (int)piece->file, piece->vector->iov_base,
					 (unsigned)piece->vector->iov_len, piece->file_offset,
					 (int)piece->buffer);
	sqe->flags |= IOSQE_FIXED_FILE;
	io_uring_sqe_set_data64(sqe, piece->tag);
	uring->in_flight++;
	uring->unsubmitted++;
}

static size_t uring_reap(struct fetch_backend *backend, struct fetch_event *events,
			 size_t count_max)
{
	struct uring *uring = uring_of(backend);
	struct io_uring_cqe *cqe;
	unsigned count = 0;
	unsigned head;

	/*
	 * Copied out first, then given back, handled by the caller last: after the advance the
	 * kernel may write over an entry, and a handler that begins new reads must find room.
	 */
	io_uring_for_each_cqe (&uring->ring, head, cqe) {
		if (count == count_max)
			break;
		events[count].tag = cqe->user_data;
		events[count].result = cqe->res;
		count++;
	}
	io_uring_cq_advance(&uring->ring, count);
	CHECK(uring->in_flight >= count);
	uring->in_flight -= count;
	return count;
}

static int uring_fd(const struct fetch_backend *backend)
{
	return ((const struct uring *)(const void *)backend)->ring.ring_fd;
}

static const struct fetch_backend_calls uring_calls = {
	.destroy = uring_destroy,
	.set_file = uring_set_file,
	.set_buffer = uring_set_buffer,
	.submit = uring_submit,
	.flush = uring_flush,
	.reap = uring_reap,
	.fd = uring_fd,
};

static int uring_why(struct why *why, int error)
{
	switch (error) {
	case -EPERM:
	case -EACCES:
		return why_set(
			why, error,
			"io_uring is denied: set sysctl kernel.io_uring_disabled=0, or allow "
			"io_uring_setup, io_uring_enter and io_uring_register in the seccomp "
			"filter");
	case -ENOSYS:
		return why_set(why, error, "this kernel has no io_uring, or seccomp hides it");
	case -ENOMEM:
		return why_set(
			why, error,
			"io_uring: no memory, or the limit of locked memory is too low: raise "
			"LimitMEMLOCK or `ulimit -l`");
	default:
		return why_errno(why, error, "io_uring");
	}
}

int fetch_uring_create(uint32_t depth, struct fetch_backend **ret, struct why *why)
{
	struct io_uring_params params = { .flags = IORING_SETUP_R_DISABLED | IORING_SETUP_CLAMP };
	struct uring *uring = calloc(1, sizeof(*uring));
	int r;

	if (!uring)
		return why_errno(why, -ENOMEM, "io_uring");
	uring->backend = (struct fetch_backend){ "uring", &uring_calls };
	r = io_uring_queue_init_params(depth, &uring->ring, &params);
	if (r < 0) {
		free(uring);
		return uring_why(why, r);
	}
	r = io_uring_register_files_sparse(&uring->ring, FETCH_FILE_COUNT_MAX);
	if (r == 0)
		r = io_uring_register_buffers_sparse(&uring->ring, FETCH_BUFFER_COUNT_MAX);
	if (r == 0)
		r = ring_restrict(&uring->ring);
	if (r < 0) {
		io_uring_queue_exit(&uring->ring);
		free(uring);
		return uring_why(why, r);
	}
	*ret = &uring->backend;
	return 0;
}
