/* SPDX-License-Identifier: MIT */
/**
 * progress.h - how far the build is, as one line that is written over and over on a terminal.
 *
 * Workers add to counters; a thread of its own shows them a few times a second: phase, share done,
 * triangles a second, memory, time left of the phase.  Where standard error is no terminal, or the
 * user wants quiet, nothing is shown and no thread is started.
 *
 * Threads: progress_add_*() from any; the others from the one that created it.
 */
#ifndef TOOLS_BUILD_PROGRESS_H
#define TOOLS_BUILD_PROGRESS_H

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

enum build_phase {
	PHASE_IMPORT,  /* files into the soup */
	PHASE_COUNT,   /* triangles a cell */
	PHASE_DEAL,    /* triangles to their buckets */
	PHASE_BORDERS, /* normals at the borders of buckets */
	PHASE_CUT,     /* buckets into leaves, and to disk */
	PHASE_FINISH,  /* hierarchy, names, commit */
	PHASE_COUNT_
};

/** "import", "count", ... */
const char *build_phase_name(enum build_phase phase);

struct progress {
	_Atomic uint64_t done;      /* of the phase, in its own unit */
	_Atomic uint64_t total;     /* 0: unknown */
	_Atomic uint64_t triangles; /* that went through the phase */
	_Atomic int phase;
	uint64_t phase_started_ns;
	uint64_t phase_ns[PHASE_COUNT_];
	bool shown;
	pthread_t thread;
	pthread_mutex_t lock;
	pthread_cond_t ended;
	bool end;
};

/** Starts; shown is ignored where standard error is no terminal. */
void progress_init(struct progress *progress, bool shown);
/** Ends the last phase, and wipes the line. */
void progress_done(struct progress *progress);
/** Ends the phase before and begins another. */
void progress_phase(struct progress *progress, enum build_phase phase, uint64_t total);

static inline void progress_add_done(struct progress *progress, uint64_t done)
{
	atomic_fetch_add_explicit(&progress->done, done, memory_order_relaxed);
}

static inline void progress_add_triangles(struct progress *progress, uint64_t triangles)
{
	atomic_fetch_add_explicit(&progress->triangles, triangles, memory_order_relaxed);
}

/** Resident memory of this process now; 0: unknown. */
uint64_t progress_resident_bytes(void);

#endif /* TOOLS_BUILD_PROGRESS_H */
