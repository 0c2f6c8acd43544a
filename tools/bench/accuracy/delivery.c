/* SPDX-License-Identifier: MIT */
#include "tools/bench/accuracy/delivery.h"

#include <errno.h>
#include <limits.h>
#include <stdio.h>

#include "formats/base/bytes.h"
#include "tools/bench/accuracy/judge.h"
#include "tools/bench/accuracy/tour.h"
#include "tools/bench/base/measure.h"

#define FRAMES       90u
#define QUICK_FRAMES 20u
#define FRAME_S      (1.0 / 30.0)
#define HORIZON_S    0.7
#define BUDGET       280000u
#define CELL_BYTES   32u

static double share(uint64_t part, uint64_t whole)
{
	return whole > 0 ? (double)part / (double)whole : 0.0;
}

/* What live pictures lack, from the first complete one on. */
static int unsettled_of(struct judge *judge, const struct tour_options *options,
			const struct tour *tour, double *ret, struct why *why)
{
	double sum = 0.0;
	size_t count = 0;

	for (size_t i = tour->begun; i < tour->frame_count; i++, count++) {
		const struct tour_frame *frame = &tour->frames[i];
		struct verdict verdict;

		if (frame->missing == 0)
			continue;
		if (judge_settled(judge, &options->cameras[i], &options->selection,
				  &tour->missing[frame->missing_first], frame->missing,
				  &verdict) < 0)
			return why_set(why, -ENOMEM, "out of memory");
		sum += share(verdict.wrong, verdict.covered);
	}
	/* Not one picture was whole: all of them lack what they lack. */
	*ret = count > 0 ? sum / (double)count : 1.0;
	return 0;
}

static int point_measure(const struct delivery_options *options, const char *scratch,
			 struct judge *judge, struct delivery_point *point, struct why *why)
{
	size_t frames = options->is_quick ? QUICK_FRAMES : FRAMES;
	struct tour_options tour_options = {
		.store = options->store,
		.cameras = options->path->cameras,
		.camera_count =
			options->path->camera_count < frames ? options->path->camera_count : frames,
		.width = options->width,
		.height = options->height,
		.selection = { SELECT_ORDER_AUTO, BUDGET },
		.frame_s = FRAME_S,
		.fetching = TOUR_CONCURRENT,
		.ahead = point->ahead_bytes > 0 ? TOUR_AHEAD_SELECTION : TOUR_AHEAD_NOTHING,
		.horizon_s = HORIZON_S,
		.ahead_bytes = point->ahead_bytes,
		.ahead_requests = 1000,
	};
	char cache[32];
	const char *arguments[] = { "--cache-size", cache, "--disk", options->disk, NULL };
	struct measure_daemon daemon;
	struct tour tour;
	int r;

	(void)snprintf(cache, sizeof(cache), "%llu", (unsigned long long)point->cache_bytes);
	r = measure_daemon_start_with(scratch, arguments, &daemon, why);
	if (r < 0)
		return r;
	tour_options.socket_path = daemon.socket_path;
	r = tour_run(&tour_options, &tour, why);
	measure_daemon_stop(&daemon);
	if (r < 0)
		return r;
	r = unsettled_of(judge, &tour_options, &tour, &point->unsettled, why);
	point->ready = share(tour.firsts.ready_count, tour.firsts.count);
	point->used = share(tour.prefetches.used_bytes, tour.prefetches.came_bytes);
	point->read_mb = (double)(tour.fetched_bytes + tour.ahead_bytes) * 1e-6;
	tour_done(&tour);
	return r;
}

int delivery_measure(struct delivery *delivery, const struct delivery_options *options,
		     struct why *why)
{
	static const uint64_t caches[] = { 16 * MIB, 64 * MIB, 256 * MIB };
	static const uint64_t aheads[] = { 0, MIB, 2 * MIB, 8 * MIB };
	struct judge *judge = NULL;
	char scratch[PATH_MAX];
	int r = measure_scratch_make(NULL, scratch, why);

	if (r < 0)
		return r;

	(void)snprintf(delivery->disk, sizeof(delivery->disk), "%s", options->disk);
	r = judge_create(options->store, options->width, options->height, &judge, why);
	for (size_t i = 0; r == 0 && i < ARRAY_LENGTH(caches); i++)
		for (size_t k = 0; r == 0 && k < ARRAY_LENGTH(aheads); k++) {
			struct delivery_point *point = &delivery->points[delivery->point_count];

			if (options->is_quick && (i != 1 || k % 2 != 0))
				continue;
			point->cache_bytes = caches[i];
			point->ahead_bytes = aheads[k];
			r = point_measure(options, scratch, judge, point, why);
			delivery->point_count++;
		}
	judge_destroy(judge);
	measure_scratch_remove(scratch);
	return r;
}

int delivery_report(const struct delivery *delivery, struct page *page, const char *folder,
		    struct why *why)
{
	static const char *const heads[] = { "cache MiB",
					     "ahead MiB a frame",
					     "unsettled %",
					     "there before wanted %",
					     "used of what was read ahead %",
					     "read MB",
					     NULL };
	char path[PATH_MAX];
	FILE *file;
	bool failed;

	if (snprintf(path, sizeof(path), "%s/delivery.csv", folder) >= (int)sizeof(path))
		return why_set(why, -ENAMETOOLONG, "%s: too long a name", folder);
	file = fopen(path, "we");
	if (!file)
		return why_errno(why, -errno, "%s", path);
	fputs("disk,cache_bytes,ahead_bytes,unsettled,ready,used,read_mb\n", file);
	page_heading(page, "Fetching: cache and look-ahead");
	page_paragraph(
		page,
		"A live walk of %u frames at 30 a second and %u triangles a frame, from a cold "
		"cache, read as from %s. Unsettled: covered pixels that differ from the settled "
		"picture, mean from the first whole picture on.",
		FRAMES, BUDGET, delivery->disk);
	page_table_begin(page, heads);
	for (size_t i = 0; i < delivery->point_count; i++) {
		const struct delivery_point *point = &delivery->points[i];
		char texts[6][CELL_BYTES];
		const char *cells[] = { texts[0], texts[1], texts[2], texts[3],
					texts[4], texts[5], NULL };

		fprintf(file, "%s,%llu,%llu,%.6f,%.6f,%.6f,%.3f\n", delivery->disk,
			(unsigned long long)point->cache_bytes,
			(unsigned long long)point->ahead_bytes, point->unsettled, point->ready,
			point->used, point->read_mb);
		(void)snprintf(texts[0], CELL_BYTES, "%llu",
			       (unsigned long long)(point->cache_bytes / MIB));
		(void)snprintf(texts[1], CELL_BYTES, "%llu",
			       (unsigned long long)(point->ahead_bytes / MIB));
		(void)snprintf(texts[2], CELL_BYTES, "%.3f", 100.0 * point->unsettled);
		(void)snprintf(texts[3], CELL_BYTES, "%.1f", 100.0 * point->ready);
		(void)snprintf(texts[4], CELL_BYTES, "%.1f", 100.0 * point->used);
		(void)snprintf(texts[5], CELL_BYTES, "%.1f", point->read_mb);
		page_row(page, cells, false);
	}
	page_table_end(page);
	failed = ferror(file) != 0;
	if (fclose(file) != 0 || failed)
		return why_set(why, -EIO, "%s: cannot be written", path);
	return 0;
}
