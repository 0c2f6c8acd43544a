/* SPDX-License-Identifier: MIT */
/*
 * A slower disk around any back end: reads are done at once and told when the disk would have ended
 * them.
 */
#include <errno.h>
#include <stdbool.h>
#include <stdlib.h>
#include <sys/epoll.h>
#include <sys/timerfd.h>
#include <unistd.h>

#include "daemon/fetch/fetch_backend.h"
#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/base/clock.h"
#include "formats/base/file.h"

/* A piece that has not been told. */
struct delayed {
	struct fetch_event event;
	uint64_t end_ns;
	bool is_read;
};

struct slow {
	struct fetch_backend backend;
	struct fetch_backend *inner;
	struct disk disk;
	int timer_fd;
	int epoll_fd; /* of the timer and of what is inside */
	uint32_t depth;
	uint32_t count;
	struct delayed delayed[];
};

static struct slow *slow_of(struct fetch_backend *backend)
{
	return (struct slow *)(void *)backend;
}

static void slow_destroy(struct fetch_backend *backend)
{
	struct slow *slow = slow_of(backend);

	slow->inner->calls->destroy(slow->inner);
	(void)fd_close(slow->timer_fd);
	(void)fd_close(slow->epoll_fd);
	free(slow);
}

static int slow_set_file(struct fetch_backend *backend, uint32_t file, int fd)
{
	struct fetch_backend *inner = slow_of(backend)->inner;

	return inner->calls->set_file(inner, file, fd);
}

static int slow_set_buffer(struct fetch_backend *backend, uint32_t buffer, void *base,
			   uint64_t bytes)
{
	struct fetch_backend *inner = slow_of(backend)->inner;

	return inner->calls->set_buffer ? inner->calls->set_buffer(inner, buffer, base, bytes)
					: -EOPNOTSUPP;
}

static uint64_t piece_bytes(const struct fetch_piece *piece)
{
	uint64_t bytes = 0;

	for (uint32_t i = 0; i < piece->vector_count; i++)
		bytes += piece->vector[i].iov_len;
	return bytes;
}

static void slow_submit(struct fetch_backend *backend, const struct fetch_piece *piece)
{
	struct slow *slow = slow_of(backend);

	CHECK(slow->count < slow->depth);
	slow->delayed[slow->count++] = (struct delayed){
		.event.tag = piece->tag,
		.end_ns = disk_read(&slow->disk, clock_now_ns(), piece->file, piece->file_offset,
				    piece_bytes(piece)),
	};
	slow->inner->calls->submit(slow->inner, piece);
}

static void slow_flush(struct fetch_backend *backend)
{
	struct fetch_backend *inner = slow_of(backend)->inner;

	inner->calls->flush(inner);
}

/* What has been read inside is noted with its piece. */
static void note_reads(struct slow *slow)
{
	struct fetch_event events[FETCH_REAP_COUNT_MAX];
	size_t count;

	do {
		count = slow->inner->calls->reap(slow->inner, events, FETCH_REAP_COUNT_MAX);
		for (size_t i = 0; i < count; i++) {
			uint32_t at = 0;

			while (at < slow->count && slow->delayed[at].event.tag != events[i].tag)
				at++;
			CHECK(at < slow->count);
			slow->delayed[at].event = events[i];
			slow->delayed[at].is_read = true;
		}
	} while (count == FETCH_REAP_COUNT_MAX);
}

static void set_timer(const struct slow *slow)
{
	uint64_t next_ns = UINT64_MAX;
	struct itimerspec when = { { 0 }, { 0 } };

	for (uint32_t i = 0; i < slow->count; i++)
		if (slow->delayed[i].is_read)
			next_ns = u64_min(next_ns, slow->delayed[i].end_ns);
	if (next_ns != UINT64_MAX)
		when.it_value = (struct timespec){ .tv_sec = (time_t)(next_ns / NS_PER_S),
						   .tv_nsec = (long)(next_ns % NS_PER_S) };
	(void)timerfd_settime(slow->timer_fd, TFD_TIMER_ABSTIME, &when, NULL);
}

static size_t slow_reap(struct fetch_backend *backend, struct fetch_event *events, size_t count_max)
{
	struct slow *slow = slow_of(backend);
	uint64_t now_ns = clock_now_ns();
	uint32_t kept = 0;
	size_t count = 0;

	note_reads(slow);
	for (uint32_t i = 0; i < slow->count; i++) {
		const struct delayed *delayed = &slow->delayed[i];

		if (count < count_max && delayed->is_read && delayed->end_ns <= now_ns)
			events[count++] = delayed->event;
		else
			slow->delayed[kept++] = *delayed;
	}
	slow->count = kept;
	set_timer(slow);
	return count;
}

static int slow_fd(const struct fetch_backend *backend)
{
	return ((const struct slow *)(const void *)backend)->epoll_fd;
}

static const struct fetch_backend_calls slow_calls = {
	.destroy = slow_destroy,
	.set_file = slow_set_file,
	.set_buffer = slow_set_buffer,
	.submit = slow_submit,
	.flush = slow_flush,
	.reap = slow_reap,
	.fd = slow_fd,
};

int fetch_disk_create(uint32_t depth, const struct disk_profile *profile,
		      struct fetch_backend *inner, struct fetch_backend **ret, struct why *why)
{
	struct slow *slow = calloc(1, sizeof(*slow) + depth * sizeof(struct delayed));
	struct epoll_event readable = { .events = EPOLLIN };

	if (!slow) {
		inner->calls->destroy(inner);
		return why_errno(why, -ENOMEM, "the simulated disk");
	}
	slow->backend = (struct fetch_backend){ inner->name, &slow_calls };
	slow->inner = inner;
	slow->depth = depth;
	disk_init(&slow->disk, profile);
	slow->timer_fd = timerfd_create(CLOCK_MONOTONIC, TFD_CLOEXEC | TFD_NONBLOCK);
	slow->epoll_fd = epoll_create1(EPOLL_CLOEXEC);
	if (slow->timer_fd < 0 || slow->epoll_fd < 0 ||
	    epoll_ctl(slow->epoll_fd, EPOLL_CTL_ADD, slow->timer_fd, &readable) < 0 ||
	    epoll_ctl(slow->epoll_fd, EPOLL_CTL_ADD, inner->calls->fd(inner), &readable) < 0) {
		int r = why_errno(why, -errno, "the simulated disk");

		slow_destroy(&slow->backend);
		return r;
	}
	*ret = &slow->backend;
	return 0;
}
