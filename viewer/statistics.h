/* SPDX-License-Identifier: MIT */
/**
 * statistics.h - what the frames of a run were: a CSV row each, and a summary.
 *
 * Threads: one.
 */
#ifndef VIEWER_STATISTICS_H
#define VIEWER_STATISTICS_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#include "formats/base/why.h"
#include "viewer/frame.h"

struct statistics {
	FILE *csv; /* NULL: none wanted */
	char *csv_path;
	double *frame_ms;
	size_t frame_count;
	size_t frame_room;
	size_t way_frames[FRAME_WAY_COUNT_]; /* how many went each way */
	size_t incomplete_frames;
	struct frame_report sum;
	uint64_t triangles_max;
	uint64_t nodes_missing_last;
	uint64_t begin_ns;
};

/** csv_path: NULL: keep only what the summary needs.  Returns: 0, -ENOMEM or -errno. */
int statistics_init(struct statistics *ret, const char *csv_path, struct why *why);
void statistics_done(struct statistics *statistics);

/** Adds a frame; time_s: of its camera.  Returns: 0, -ENOMEM or -errno. */
int statistics_add(struct statistics *statistics, double time_s, const struct frame_report *report,
		   struct why *why);

/** All rows are on disk.  Returns: 0 or -errno. */
int statistics_finish(struct statistics *statistics, struct why *why);

/** What the run was, for the summary. */
struct statistics_run {
	const char *renderer;
	bool is_in_place;
	uint32_t width;
	uint32_t height;
	uint64_t reconnects;
};

/** One JSON object and a newline. */
void statistics_write_json(const struct statistics *statistics, const struct statistics_run *run,
			   FILE *out);

#endif /* VIEWER_STATISTICS_H */
