/* SPDX-License-Identifier: MIT */
/**
 * crew.h - worker threads that do one phase of the build together.
 *
 * The first failure of a worker stops the others, and so does a signal; the phase then ends with
 * that failure.  Workers look at crew_stopped() at least once a block of triangles.
 */
#ifndef TOOLS_BUILD_CREW_H
#define TOOLS_BUILD_CREW_H

#include <pthread.h>
#include <stdbool.h>
#include <stdint.h>

#include "formats/base/why.h"

struct crew {
	uint32_t worker_count;
	/* Set by a signal handler or by the first failure; importers look at it as well. */
	volatile bool stop;
	pthread_mutex_t lock; /* of the first failure */
	int error;
	struct why why;
};

/** What one worker does.  Returns: 0, or a negative errno with its reason. */
typedef int (*crew_fn)(void *arg, uint32_t worker, struct why *why);

void crew_init(struct crew *crew, uint32_t worker_count);
void crew_done(struct crew *crew);

/**
 * Runs fn once for each worker 0 .. worker_count - 1, side by side, and waits for all.
 *
 * Returns: 0, the first failure with its reason, or -ECANCELED when a signal stopped it.
 */
int crew_run(struct crew *crew, uint32_t worker_count, crew_fn fn, void *arg, struct why *why);

/** Asks all workers to end.  Safe in a signal handler. */
static inline void crew_stop(struct crew *crew)
{
	__atomic_store_n(&crew->stop, true, __ATOMIC_RELAXED);
}

static inline bool crew_stopped(const struct crew *crew)
{
	return __atomic_load_n(&crew->stop, __ATOMIC_RELAXED);
}

/**
 * Lets workers pass one after the other in the order of their tickets: 0, 1, 2, ...
 *
 * It bounds what waits for its turn: a worker that is ahead sleeps until it is due.
 */
struct turnstile {
	pthread_mutex_t lock;
	pthread_cond_t moved;
	uint64_t next;
};

void turnstile_init(struct turnstile *turnstile);
void turnstile_done(struct turnstile *turnstile);

/** Waits until it is ticket's turn.  Returns: 0, or -ECANCELED when the crew stopped. */
int turnstile_enter(struct turnstile *turnstile, uint64_t ticket, const struct crew *crew);
/** Ends the turn, also of who failed: everyone behind then finds the crew stopped. */
void turnstile_leave(struct turnstile *turnstile);

#endif /* TOOLS_BUILD_CREW_H */
