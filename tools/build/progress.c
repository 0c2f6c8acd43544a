/* SPDX-License-Identifier: MIT */
#include "tools/build/progress.h"

#include <errno.h>
#include <stdio.h>
#include <time.h>
#include <unistd.h>

#include "formats/base/clock.h"
#include "formats/base/text.h"

#define SHOW_INTERVAL_NS (250 * NS_PER_MS)
#define WIPE_LINE        "\r\033[K"

const char *build_phase_name(enum build_phase phase)
{
	static const char *const names[PHASE_COUNT_] = { "import",  "count", "deal",
							 "borders", "cut",   "finish" };

	return names[phase];
}

uint64_t progress_resident_bytes(void)
{
	FILE *file = fopen("/proc/self/statm", "re");
	unsigned long long pages = 0;

	if (!file)
		return 0;
	if (fscanf(file, "%*u %llu", &pages) != 1)
		pages = 0;
	(void)fclose(file);
	return pages * (uint64_t)sysconf(_SC_PAGESIZE);
}

static void show(const struct progress *progress)
{
	enum build_phase phase = (enum build_phase)atomic_load(&progress->phase);
	uint64_t done = atomic_load(&progress->done);
	uint64_t total = atomic_load(&progress->total);
	double seconds = (double)(clock_now_ns() - progress->phase_started_ns) / 1e9;
	double rate = (double)atomic_load(&progress->triangles) / seconds / 1e6;
	char resident[TEXT_SIZE_BYTES];

	(void)fprintf(stderr, WIPE_LINE "%s: %d/%d %-7s", "oocbuild", (int)phase + 1, PHASE_COUNT_,
		      build_phase_name(phase));
	if (total > 0 && done <= total)
		(void)fprintf(stderr, " %3d %%", (int)(100.0 * (double)done / (double)total));
	(void)fprintf(stderr, "  %.2f Mtriangles/s  %s", rate,
		      text_from_size(progress_resident_bytes(), resident));
	if (done > 0 && done < total)
		(void)fprintf(stderr, "  %.0f s left",
			      seconds * (double)(total - done) / (double)done);
	(void)fflush(stderr);
}

static void *show_all_along(void *arg)
{
	struct progress *progress = arg;

	(void)pthread_mutex_lock(&progress->lock);
	while (!progress->end) {
		uint64_t until_ns = clock_now_ns() + SHOW_INTERVAL_NS;
		struct timespec until = { .tv_sec = (time_t)(until_ns / NS_PER_S),
					  .tv_nsec = (long)(until_ns % NS_PER_S) };

		if (pthread_cond_timedwait(&progress->ended, &progress->lock, &until) == ETIMEDOUT)
			show(progress);
	}
	(void)pthread_mutex_unlock(&progress->lock);
	return NULL;
}

void progress_init(struct progress *progress, bool shown)
{
	pthread_condattr_t attributes;

	*progress = (struct progress){ .phase = PHASE_IMPORT };
	progress->phase_started_ns = clock_now_ns();
	(void)pthread_mutex_init(&progress->lock, NULL);
	(void)pthread_condattr_init(&attributes);
	(void)pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
	(void)pthread_cond_init(&progress->ended, &attributes);
	(void)pthread_condattr_destroy(&attributes);
	progress->shown = shown && isatty(STDERR_FILENO) &&
			  pthread_create(&progress->thread, NULL, show_all_along, progress) == 0;
}

static void phase_end(struct progress *progress)
{
	int phase = atomic_load(&progress->phase);
	uint64_t now_ns = clock_now_ns();

	progress->phase_ns[phase] += now_ns - progress->phase_started_ns;
	progress->phase_started_ns = now_ns;
}

void progress_phase(struct progress *progress, enum build_phase phase, uint64_t total)
{
	(void)pthread_mutex_lock(&progress->lock);
	phase_end(progress);
	atomic_store(&progress->phase, (int)phase);
	atomic_store(&progress->done, 0);
	atomic_store(&progress->triangles, 0);
	atomic_store(&progress->total, total);
	(void)pthread_mutex_unlock(&progress->lock);
}

void progress_done(struct progress *progress)
{
	(void)pthread_mutex_lock(&progress->lock);
	phase_end(progress);
	progress->end = true;
	(void)pthread_cond_signal(&progress->ended);
	(void)pthread_mutex_unlock(&progress->lock);
	if (progress->shown) {
		(void)pthread_join(progress->thread, NULL);
		(void)fputs(WIPE_LINE, stderr);
	}
	progress->shown = false;
	(void)pthread_cond_destroy(&progress->ended);
	(void)pthread_mutex_destroy(&progress->lock);
}
