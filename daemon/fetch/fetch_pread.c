/* SPDX-License-Identifier: MIT */
/*
 * The back end of threads with preadv(2), for where io_uring is denied.  Pieces go to the threads by
 * a ring under a mutex, and come back the same way; an eventfd wakes the loop.
 */
#include <errno.h>
#include <pthread.h>
#include <signal.h>
#include <stdbool.h>
#include <stdlib.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "daemon/fetch/fetch_backend.h"
#include "formats/base/check.h"
#include "formats/base/file.h"

#define PREAD_THREADS_MAX 16u

struct pread_piece {
	struct fetch_piece piece;
	int fd;
};

struct pread {
	struct fetch_backend backend;
	int event_fd;
	int files[FETCH_FILE_COUNT_MAX];
	uint32_t depth;
	uint32_t thread_count;
	pthread_t threads[PREAD_THREADS_MAX];

	pthread_mutex_t mutex; /* all below */
	pthread_cond_t wake;
	bool stop;
	uint32_t todo_first, todo_count;
	uint32_t done_count;
	struct pread_piece *todo; /* depth */
	struct fetch_event *done; /* depth */
};

static struct pread *pread_of(struct fetch_backend *backend)
{
	return (struct pread *)(void *)backend;
}

static void *pread_thread(void *arg)
{
	struct pread *self = arg;

	(void)pthread_mutex_lock(&self->mutex);
	for (;;) {
		struct pread_piece todo;
		ssize_t n;

		while (self->todo_count == 0 && !self->stop)
			(void)pthread_cond_wait(&self->wake, &self->mutex);
		if (self->todo_count == 0)
			break;
		todo = self->todo[self->todo_first];
		self->todo_first = (self->todo_first + 1) % self->depth;
		self->todo_count--;
		(void)pthread_mutex_unlock(&self->mutex);

		n = preadv(todo.fd, todo.piece.vector, (int)todo.piece.vector_count,
			   (off_t)todo.piece.file_offset);
		if (n < 0)
			n = -errno;

		(void)pthread_mutex_lock(&self->mutex);
		CHECK(self->done_count < self->depth);
		self->done[self->done_count++] = (struct fetch_event){ todo.piece.tag, (int32_t)n };
		if (self->done_count == 1)
			(void)eventfd_write(self->event_fd, 1);
	}
	(void)pthread_mutex_unlock(&self->mutex);
	return NULL;
}

static void pread_destroy(struct fetch_backend *backend)
{
	struct pread *self = pread_of(backend);

	(void)pthread_mutex_lock(&self->mutex);
	self->stop = true;
	(void)pthread_cond_broadcast(&self->wake);
	(void)pthread_mutex_unlock(&self->mutex);
	for (uint32_t i = 0; i < self->thread_count; i++)
		(void)pthread_join(self->threads[i], NULL);
	(void)pthread_cond_destroy(&self->wake);
	(void)pthread_mutex_destroy(&self->mutex);
	(void)fd_close(self->event_fd);
	free(self->todo);
	free(self->done);
	free(self);
}

static int pread_set_file(struct fetch_backend *backend, uint32_t file, int fd)
{
	pread_of(backend)->files[file] = fd;
	return 0;
}

static void pread_submit(struct fetch_backend *backend, const struct fetch_piece *piece)
{
	struct pread *self = pread_of(backend);

	(void)pthread_mutex_lock(&self->mutex);
	CHECK(self->todo_count < self->depth);
	self->todo[(self->todo_first + self->todo_count++) % self->depth] =
		(struct pread_piece){ *piece, self->files[piece->file] };
	(void)pthread_cond_signal(&self->wake);
	(void)pthread_mutex_unlock(&self->mutex);
}

static void pread_flush(struct fetch_backend *backend)
{
	(void)backend;
}

static size_t pread_reap(struct fetch_backend *backend, struct fetch_event *events,
			 size_t count_max)
{
	struct pread *self = pread_of(backend);
	eventfd_t ignored;
	size_t count;

	(void)pthread_mutex_lock(&self->mutex);
	count = self->done_count < count_max ? self->done_count : count_max;
	self->done_count -= (uint32_t)count;
	for (size_t i = 0; i < count; i++)
		events[i] = self->done[self->done_count + i];
	/* What is left keeps the descriptor readable. */
	if (self->done_count == 0)
		(void)eventfd_read(self->event_fd, &ignored);
	(void)pthread_mutex_unlock(&self->mutex);
	return count;
}

static int pread_fd(const struct fetch_backend *backend)
{
	return ((const struct pread *)(const void *)backend)->event_fd;
}

static const struct fetch_backend_calls pread_calls = {
	.destroy = pread_destroy,
	.set_file = pread_set_file,
	.submit = pread_submit,
	.flush = pread_flush,
	.reap = pread_reap,
	.fd = pread_fd,
};

static int threads_create(struct pread *self, uint32_t count)
{
	sigset_t all;
	sigset_t before;
	int r = 0;

	/* Signals are the loop's. */
	(void)sigfillset(&all);
	(void)pthread_sigmask(SIG_SETMASK, &all, &before);
	while (r == 0 && self->thread_count < count) {
		r = -pthread_create(&self->threads[self->thread_count], NULL, pread_thread, self);
		if (r == 0)
			self->thread_count++;
	}
	(void)pthread_sigmask(SIG_SETMASK, &before, NULL);
	return r;
}

int fetch_pread_create(uint32_t depth, struct fetch_backend **ret, struct why *why)
{
	struct pread *self = calloc(1, sizeof(*self));
	int r = -ENOMEM;

	if (!self)
		return why_errno(why, -ENOMEM, "reading threads");
	self->backend = (struct fetch_backend){ "pread", &pread_calls };
	self->depth = depth;
	(void)pthread_mutex_init(&self->mutex, NULL);
	(void)pthread_cond_init(&self->wake, NULL);
	self->event_fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
	self->todo = calloc(depth, sizeof(*self->todo));
	self->done = calloc(depth, sizeof(*self->done));
	if (self->event_fd < 0)
		r = -errno;
	else if (self->todo && self->done)
		r = threads_create(self, depth < PREAD_THREADS_MAX ? depth : PREAD_THREADS_MAX);
	if (r < 0) {
		pread_destroy(&self->backend);
		return why_errno(why, r, "reading threads");
	}
	*ret = &self->backend;
	return 0;
}
