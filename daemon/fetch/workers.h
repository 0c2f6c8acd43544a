/* SPDX-License-Identifier: MIT */
/**
 * workers.h - threads for what would keep the loop from turning: verifying, decoding, opening
 * stores, populating memory.
 *
 * Workers run at a lower priority than the viewers.  They own nothing: a job has its source and its
 * destination, and comes back by queue.  The queue is bounded by the jobs that there are: each lies
 * in the object that it works for.
 *
 * Waking a thread costs more than a short job does.  So short jobs are gathered until
 * workers_flush(), and a worker takes several of them at one time.
 *
 * Threads: loop thread, but for a job's run().
 */
#ifndef DAEMON_FETCH_WORKERS_H
#define DAEMON_FETCH_WORKERS_H

#include <stdbool.h>
#include <stdint.h>

#include "formats/base/list.h"
#include "formats/base/why.h"
#include "formats/codec/codec.h"

struct workers;

struct worker_job {
	struct list link;
	bool is_short; /* some microseconds: it may wait for others like it */
	/** On a worker: may block, and touches nothing but what belongs to the job. */
	void (*run)(struct worker_job *job, struct codec_scratch *scratch);
	/** Then, on the loop thread. */
	void (*done)(struct worker_job *job);
};

/** count: 1 .. WORKER_COUNT_MAX.  Returns: 0, -ENOMEM, -EAGAIN or -errno. */
int workers_create(uint32_t count, struct workers **ret, struct why *why);

/** Lets the running jobs end; nobody is told.  NULL is allowed.  Returns: NULL. */
struct workers *workers_destroy(struct workers *workers);

/** Queues a job; run and done are set, link is not on a list.  A short one begins with the flush. */
void workers_add(struct workers *workers, struct worker_job *job);
/** Queues it before all others: many wait for what it makes. */
void workers_add_first(struct workers *workers, struct worker_job *job);

/** Lets the workers begin with short jobs that were added: once for all that came at one time. */
void workers_flush(struct workers *workers);

/** Threads that there are. */
uint32_t workers_count(const struct workers *workers);

/** Jobs that were added and have not come back. */
uint32_t workers_job_count(const struct workers *workers);

/** Jobs that have come back, ever. */
uint64_t workers_ended_count(const struct workers *workers);

/** Readable when workers_dispatch() has something to do. */
int workers_fd(const struct workers *workers);
/** Calls done() of what has come back. */
void workers_dispatch(struct workers *workers);

#endif /* DAEMON_FETCH_WORKERS_H */
