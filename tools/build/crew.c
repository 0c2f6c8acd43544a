/* SPDX-License-Identifier: MIT */
#include "tools/build/crew.h"

#include <errno.h>
#include <stdlib.h>
#include <time.h>

#include "formats/base/clock.h"

/** How long a sleeping worker takes to see that the crew stopped. */
#define TURN_WAIT_NS (50 * NS_PER_MS)

struct worker {
	struct crew *crew;
	crew_fn fn;
	void *arg;
	uint32_t number;
	pthread_t thread;
};

void crew_init(struct crew *crew, uint32_t worker_count)
{
	*crew = (struct crew){ .worker_count = worker_count };
	(void)pthread_mutex_init(&crew->lock, NULL);
}

void crew_done(struct crew *crew)
{
	(void)pthread_mutex_destroy(&crew->lock);
}

static void *work(void *arg)
{
	struct worker *worker = arg;
	struct crew *crew = worker->crew;
	struct why why = { 0 };
	int r = worker->fn(worker->arg, worker->number, &why);

	if (r < 0) {
		(void)pthread_mutex_lock(&crew->lock);
		/* Who was merely stopped has nothing to say. */
		if (crew->error == 0 && r != -ECANCELED) {
			crew->error = r;
			crew->why = why;
		}
		(void)pthread_mutex_unlock(&crew->lock);
		crew_stop(crew);
	}
	return NULL;
}

int crew_run(struct crew *crew, uint32_t worker_count, crew_fn fn, void *arg, struct why *why)
{
	struct worker *workers = calloc(worker_count, sizeof(*workers));
	uint32_t started = 1;

	if (!workers)
		return why_set(why, -ENOMEM, "no memory for %u workers", worker_count);
	for (uint32_t i = 0; i < worker_count; i++)
		workers[i] = (struct worker){ .crew = crew, .fn = fn, .arg = arg, .number = i };
	/* This thread is worker 0.  A thread that cannot be started only makes it slower. */
	while (started < worker_count &&
	       pthread_create(&workers[started].thread, NULL, work, &workers[started]) == 0)
		started++;
	(void)work(&workers[0]);
	for (uint32_t i = 1; i < started; i++)
		(void)pthread_join(workers[i].thread, NULL);
	free(workers);
	if (crew->error < 0) {
		if (why)
			*why = crew->why;
		return crew->error;
	}
	return crew_stopped(crew) ? why_set(why, -ECANCELED, "interrupted") : 0;
}

void turnstile_init(struct turnstile *turnstile)
{
	pthread_condattr_t attributes;

	(void)pthread_mutex_init(&turnstile->lock, NULL);
	(void)pthread_condattr_init(&attributes);
	(void)pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
	(void)pthread_cond_init(&turnstile->moved, &attributes);
	(void)pthread_condattr_destroy(&attributes);
	turnstile->next = 0;
}

void turnstile_done(struct turnstile *turnstile)
{
	(void)pthread_cond_destroy(&turnstile->moved);
	(void)pthread_mutex_destroy(&turnstile->lock);
}

int turnstile_enter(struct turnstile *turnstile, uint64_t ticket, const struct crew *crew)
{
	bool stopped = false;

	(void)pthread_mutex_lock(&turnstile->lock);
	while (turnstile->next != ticket && !stopped) {
		uint64_t until_ns = clock_now_ns() + TURN_WAIT_NS;
		struct timespec until = { .tv_sec = (time_t)(until_ns / NS_PER_S),
					  .tv_nsec = (long)(until_ns % NS_PER_S) };

		/* Not for ever: a signal handler stops the crew and can wake nobody. */
		(void)pthread_cond_timedwait(&turnstile->moved, &turnstile->lock, &until);
		stopped = turnstile->next != ticket && crew_stopped(crew);
	}
	(void)pthread_mutex_unlock(&turnstile->lock);
	return stopped ? -ECANCELED : 0;
}

void turnstile_leave(struct turnstile *turnstile)
{
	(void)pthread_mutex_lock(&turnstile->lock);
	turnstile->next++;
	(void)pthread_cond_broadcast(&turnstile->moved);
	(void)pthread_mutex_unlock(&turnstile->lock);
}
