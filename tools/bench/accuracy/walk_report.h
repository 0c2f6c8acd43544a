/* SPDX-License-Identifier: MIT */
/**
 * walk_report.h - what tours of one path, each done in another way, say together: figures, tables and
 * plots.
 *
 * Threads: the main thread.
 */
#ifndef TOOLS_BENCH_ACCURACY_WALK_REPORT_H
#define TOOLS_BENCH_ACCURACY_WALK_REPORT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "tools/bench/accuracy/tour.h"

#define WALK_RUN_COUNT_MAX 16u

/** One tour of the whole path, in one way. */
struct walk_run {
	char name[32];
	const char *title;
	struct tour_options options;
	bool is_resident;  /* everything was there before */
	const char *depth; /* reads at one time */
	struct tour tour;
	double *wrong; /* a frame: share of the settled picture's covered pixels that is not drawn */
};

struct walk_results {
	uint32_t frame_count;
	struct walk_run runs[WALK_RUN_COUNT_MAX];
	size_t run_count;
	/* Of the set that is asked for, whatever is there: compared with the exact picture. */
	double *accuracy_frames; /* numbers of the frames that were compared, accuracy_count */
	double *accuracy_of_all; /* share of pixels that are right */
	double *accuracy_of_covered;
	size_t accuracy_count;
	uint64_t differing_pictures; /* between runs that wait */
};

/** Frees what the runs have left. */
void walk_results_done(struct walk_results *results);

/** Prints the figures.  Returns: 0 or -ENOMEM. */
int walk_report(const struct walk_results *results, bool is_json);

/** Writes a table (CSV) of each run and plots (SVG) into a folder; warns when there is no gnuplot. */
int walk_write(const struct walk_results *results, const char *folder, struct why *why);

#endif /* TOOLS_BENCH_ACCURACY_WALK_REPORT_H */
