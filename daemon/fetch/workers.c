/* SPDX-License-Identifier: MIT */
#include "daemon/fetch/workers.h"

#include <errno.h>
#include <pthread.h>
#include <signal.h>
#include <stdbool.h>
#include <stdlib.h>
#include <sys/eventfd.h>
#include <sys/resource.h>
#include <unistd.h>

#include "daemon/limits.h"
#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/base/file.h"

/** Short jobs that a worker takes at one time. */
#define BATCH_COUNT_MAX 8u

struct worker {
	pthread_t thread;
	struct workers *workers;
	struct codec_scratch *scratch;
};

struct workers {
	int event_fd;
	uint32_t job_count; /* loop thread, as the next three */
	uint64_t ended_count;
	struct list gathered;
	uint32_t gathered_count;
	uint32_t worker_count;
	struct worker worker[WORKER_COUNT_MAX];

	pthread_mutex_t mutex; /* all below */
	pthread_cond_t wake;
	bool stop;
	uint32_t idle_count; /* workers that wait */
	struct list todo;
	struct list done;
};

static struct worker_job *job_of(struct list *link)
{
	return LIST_ENTRY(link, struct worker_job, link);
}

/* Moves one job, or some short ones, that come next. */
static void batch_take(struct list *todo, struct list *ret_batch)
{
	uint32_t count = 0;

	list_init(ret_batch);
	do {
		struct list *link = todo->next;

		list_remove(link);
		list_push_back(ret_batch, link);
		count++;
	} while (count < BATCH_COUNT_MAX && job_of(ret_batch->next)->is_short &&
		 !list_is_empty(todo) && job_of(todo->next)->is_short);
}

static void batch_move(struct list *from, struct list *to)
{
	LIST_FOR_EACH (link, from) {
		list_remove(link);
		list_push_back(to, link);
	}
}

static void *worker_thread(void *arg)
{
	struct worker *worker = arg;
	struct workers *workers = worker->workers;

	/* On Linux this is the thread's own.  Refused or not, the work is done. */
	(void)setpriority(PRIO_PROCESS, (id_t)gettid(), WORKER_NICE);
	(void)pthread_mutex_lock(&workers->mutex);
	for (;;) {
		struct list batch;
		bool first;

		workers->idle_count++;
		while (list_is_empty(&workers->todo) && !workers->stop)
			(void)pthread_cond_wait(&workers->wake, &workers->mutex);
		workers->idle_count--;
		if (workers->stop)
			break;
		batch_take(&workers->todo, &batch);
		(void)pthread_mutex_unlock(&workers->mutex);
		LIST_FOR_EACH (link, &batch)
			job_of(link)->run(job_of(link), worker->scratch);
		(void)pthread_mutex_lock(&workers->mutex);
		first = list_is_empty(&workers->done);
		batch_move(&batch, &workers->done);
		if (first)
			(void)eventfd_write(workers->event_fd, 1);
	}
	(void)pthread_mutex_unlock(&workers->mutex);
	return NULL;
}

struct workers *workers_destroy(struct workers *workers)
{
	if (!workers)
		return NULL;
	(void)pthread_mutex_lock(&workers->mutex);
	workers->stop = true;
	(void)pthread_cond_broadcast(&workers->wake);
	(void)pthread_mutex_unlock(&workers->mutex);
	for (uint32_t i = 0; i < workers->worker_count; i++) {
		(void)pthread_join(workers->worker[i].thread, NULL);
		codec_scratch_destroy(workers->worker[i].scratch);
	}
	(void)pthread_cond_destroy(&workers->wake);
	(void)pthread_mutex_destroy(&workers->mutex);
	(void)fd_close(workers->event_fd);
	free(workers);
	return NULL;
}

static int worker_start(struct workers *workers)
{
	struct worker *worker = &workers->worker[workers->worker_count];
	sigset_t all;
	sigset_t before;
	int r;

	worker->workers = workers;
	r = codec_scratch_create(&worker->scratch);
	if (r < 0)
		return r;
	/* Signals are the loop's. */
	(void)sigfillset(&all);
	(void)pthread_sigmask(SIG_SETMASK, &all, &before);
	r = -pthread_create(&worker->thread, NULL, worker_thread, worker);
	(void)pthread_sigmask(SIG_SETMASK, &before, NULL);
	if (r < 0) {
		worker->scratch = codec_scratch_destroy(worker->scratch);
		return r;
	}
	workers->worker_count++;
	return 0;
}

int workers_create(uint32_t count, struct workers **ret, struct why *why)
{
	struct workers *workers = calloc(1, sizeof(*workers));
	int r = 0;

	CHECK(count >= 1 && count <= WORKER_COUNT_MAX);
	if (!workers)
		return why_errno(why, -ENOMEM, "workers");
	(void)pthread_mutex_init(&workers->mutex, NULL);
	(void)pthread_cond_init(&workers->wake, NULL);
	list_init(&workers->gathered);
	list_init(&workers->todo);
	list_init(&workers->done);
	workers->event_fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
	if (workers->event_fd < 0)
		r = -errno;
	while (r == 0 && workers->worker_count < count)
		r = worker_start(workers);
	if (r < 0) {
		workers_destroy(workers);
		return why_errno(why, r, "workers");
	}
	*ret = workers;
	return 0;
}

/* Has so many workers begin.  Outside of the mutex, which they take first. */
static void wake(struct workers *workers, uint32_t count)
{
	while (count-- > 0)
		(void)pthread_cond_signal(&workers->wake);
}

static void add(struct workers *workers, struct worker_job *job, bool first)
{
	workers->job_count++;
	(void)pthread_mutex_lock(&workers->mutex);
	if (first)
		list_push_front(&workers->todo, &job->link);
	else
		list_push_back(&workers->todo, &job->link);
	(void)pthread_mutex_unlock(&workers->mutex);
	wake(workers, 1);
}

void workers_add(struct workers *workers, struct worker_job *job)
{
	if (!job->is_short) {
		add(workers, job, false);
		return;
	}
	workers->job_count++;
	workers->gathered_count++;
	list_push_back(&workers->gathered, &job->link);
}

void workers_add_first(struct workers *workers, struct worker_job *job)
{
	add(workers, job, true);
}

void workers_flush(struct workers *workers)
{
	uint32_t batch_count = (workers->gathered_count + BATCH_COUNT_MAX - 1) / BATCH_COUNT_MAX;

	if (batch_count == 0)
		return;
	workers->gathered_count = 0;
	(void)pthread_mutex_lock(&workers->mutex);
	batch_move(&workers->gathered, &workers->todo);
	/* Who works looks for more before it waits. */
	batch_count = (uint32_t)u64_min(batch_count, workers->idle_count);
	(void)pthread_mutex_unlock(&workers->mutex);
	wake(workers, batch_count);
}

uint32_t workers_count(const struct workers *workers)
{
	return workers->worker_count;
}

uint64_t workers_ended_count(const struct workers *workers)
{
	return workers->ended_count;
}

uint32_t workers_job_count(const struct workers *workers)
{
	return workers->job_count;
}

int workers_fd(const struct workers *workers)
{
	return workers->event_fd;
}

void workers_dispatch(struct workers *workers)
{
	struct list done;
	eventfd_t ignored;

	list_init(&done);
	(void)pthread_mutex_lock(&workers->mutex);
	(void)eventfd_read(workers->event_fd, &ignored);
	batch_move(&workers->done, &done);
	(void)pthread_mutex_unlock(&workers->mutex);

	LIST_FOR_EACH (link, &done) {
		struct worker_job *job = LIST_ENTRY(link, struct worker_job, link);

		list_remove(link);
		workers->job_count--;
		workers->ended_count++;
		job->done(job);
	}
}
