/* SPDX-License-Identifier: MIT */
#include "tools/bench/accuracy/walk_report.h"

#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>

#include "formats/base/bytes.h"
#include "formats/base/log.h"
#include "tools/bench/base/figures.h"
#include "tools/bench/base/plot.h"
#include "tools/bench/base/report.h"

void walk_results_done(struct walk_results *results)
{
	for (size_t i = 0; i < results->run_count; i++) {
		tour_done(&results->runs[i].tour);
		free(results->runs[i].wrong);
	}
	free(results->accuracy_frames);
	free(results->accuracy_of_all);
	free(results->accuracy_of_covered);
}

/* ---- figures ---- */

/* A value of each frame, by what it is. */
enum column {
	COLUMN_MS,
	COLUMN_FETCHED,
	COLUMN_AHEAD,
	COLUMN_WRONG,
};

static double column_of(const struct walk_run *run, uint32_t frame, enum column column)
{
	const struct tour_frame *at = &run->tour.frames[frame];

	switch (column) {
	case COLUMN_MS:
		return at->ms;
	case COLUMN_FETCHED:
		return (double)at->fetched_bytes;
	case COLUMN_AHEAD:
		return (double)at->ahead_bytes;
	case COLUMN_WRONG:
		return run->wrong ? 100.0 * run->wrong[frame] : 0.0;
	}
	return 0.0;
}

static double percent(uint64_t part, uint64_t whole)
{
	return whole > 0 ? 100.0 * (double)part / (double)whole : 0.0;
}

/* Frames that took twice as long as the same frame did with everything there. */
static double spikes_of(const struct walk_run *run, const struct walk_run *resident)
{
	size_t count = 0;

	for (size_t i = 0; i < run->tour.frame_count; i++)
		count += run->tour.frames[i].ms > 2.0 * resident->tour.frames[i].ms;
	return percent(count, run->tour.frame_count);
}

static void report_frames(struct report *report, const struct walk_results *results,
			  const struct walk_run *run, double *values)
{
	const struct walk_run *resident = &results->runs[0];
	size_t count = run->tour.frame_count;
	struct distribution frame_ms;

	for (uint32_t i = 0; i < count; i++)
		values[i] = column_of(run, i, COLUMN_MS);
	frame_ms = distribution_of(values, count);
	report_distribution(report, "frame_ms", "frame", frame_ms, "ms");
	report_number(report, "below_1_fps", "frames below 1 fps",
		      100.0 * share_above(values, count, 1000.0), "%");
	report_number(report, "above_twice_median", "frames above twice the median",
		      100.0 * share_above(values, count, 2.0 * frame_ms.median), "%");
	if (run->options.waits && resident->is_resident && run != resident)
		report_number(report, "above_twice_resident",
			      "frames above twice the same frame resident",
			      spikes_of(run, resident), "%");
	if (run->options.waits)
		return;
	count = 0;
	for (size_t i = run->tour.begun; i < run->tour.frame_count; i++)
		values[count++] = column_of(run, (uint32_t)i, COLUMN_WRONG);
	report_number(report, "first_complete", "first frame that lacked nothing",
		      (double)run->tour.begun, "");
	report_distribution(report, "unsettled", "covered pixels that differ from settled",
			    distribution_of(values, count), "%");
}

static void report_nodes(struct report *report, const struct walk_run *run)
{
	const struct tour_firsts *firsts = &run->tour.firsts;
	const struct tour_prefetches *prefetches = &run->tour.prefetches;

	report_number(report, "nodes", "nodes wanted", (double)firsts->count, "");
	report_number(report, "ready_before", "of these there before they were wanted",
		      percent(firsts->ready_count, firsts->count), "%");
	report_distribution(report, "wait_frames", "from first wanted to drawn",
			    distribution_of(firsts->waits_frames, firsts->drawn_count), "frames");
	report_distribution(report, "wait_ms", "the same",
			    distribution_of(firsts->waits_ms, firsts->drawn_count), "ms");
	report_number(report, "never_drawn", "wanted and never drawn",
		      percent(firsts->count - firsts->drawn_count, firsts->count), "%");
	report_number(report, "fetched_mb", "read for sets", (double)run->tour.fetched_bytes * 1e-6,
		      "MB");
	report_number(report, "ahead_mb", "read ahead of time",
		      (double)run->tour.ahead_bytes * 1e-6, "MB");
	if (run->options.ahead == TOUR_AHEAD_NOTHING)
		return;
	report_number(report, "used", "read ahead and wanted within 60 frames",
		      percent(prefetches->used_bytes, prefetches->came_bytes), "% of bytes");
	report_distribution(report, "lead_frames", "how long before",
			    distribution_of(firsts->leads_frames, firsts->lead_count), "frames");
}

static void report_accuracy(struct report *report, const struct walk_results *results)
{
	double *values = calloc(results->accuracy_count + 1, sizeof(*values));

	if (!values)
		return;
	report_group_begin(report, "accuracy", "the chosen sets against the exact pictures");
	for (size_t i = 0; i < results->accuracy_count; i++)
		values[i] = 100.0 * (1.0 - results->accuracy_of_all[i]);
	report_distribution(report, "wrong_of_all", "wrong of all pixels",
			    distribution_of(values, results->accuracy_count), "%");
	for (size_t i = 0; i < results->accuracy_count; i++)
		values[i] = 100.0 * (1.0 - results->accuracy_of_covered[i]);
	report_distribution(report, "wrong_of_covered", "wrong of covered pixels",
			    distribution_of(values, results->accuracy_count), "%");
	report_group_end(report);
	free(values);
}

int walk_report(const struct walk_results *results, bool is_json)
{
	double *values = calloc(results->frame_count, sizeof(*values));
	uint64_t set_bytes_max = 0;
	struct report report;

	if (!values)
		return -ENOMEM;
	for (uint32_t i = 0; i < results->frame_count; i++)
		set_bytes_max = u64_max(set_bytes_max, results->runs[0].tour.frames[i].set_bytes);
	report_begin(&report, is_json);
	report_number(&report, "frames", "frames", results->frame_count, "");
	report_number(&report, "largest_set_mb", "largest set of a frame",
		      (double)set_bytes_max * 1e-6, "MB");
	report_accuracy(&report, results);
	for (size_t i = 0; i < results->run_count; i++) {
		const struct walk_run *run = &results->runs[i];

		report_group_begin(&report, run->name, run->title);
		report_number(&report, "seconds", "took", run->tour.seconds, "s");
		report_frames(&report, results, run, values);
		if (!run->is_resident)
			report_nodes(&report, run);
		report_group_end(&report);
	}
	if (results->runs[0].options.waits)
		report_number(&report, "differing_pictures",
			      "pictures that differ between waiting runs",
			      (double)results->differing_pictures, "");
	report_end(&report);
	free(values);
	return 0;
}

/* ---- files ---- */

static int run_write(const struct walk_results *results, const struct walk_run *run,
		     const char *folder, struct why *why)
{
	char path[PATH_MAX];
	FILE *file;
	bool failed;

	(void)snprintf(path, sizeof(path), "%s/%s.csv", folder, run->name);
	file = fopen(path, "we");
	if (!file)
		return why_errno(why, -errno, "%s", path);
	fputs("frame,ms,wait_ms,wanted,missing,triangles,set_bytes,fetched_bytes,ahead_bytes,"
	      "unsettled_percent\n",
	      file);
	for (uint32_t i = 0; i < results->frame_count; i++) {
		const struct tour_frame *frame = &run->tour.frames[i];

		fprintf(file, "%u,%.3f,%.3f,%u,%u,%llu,%llu,%llu,%llu,%.4f\n", i, frame->ms,
			frame->wait_ms, frame->wanted, frame->missing,
			(unsigned long long)frame->triangles, (unsigned long long)frame->set_bytes,
			(unsigned long long)frame->fetched_bytes,
			(unsigned long long)frame->ahead_bytes, column_of(run, i, COLUMN_WRONG));
	}
	failed = ferror(file) != 0;
	if (fclose(file) != 0 || failed)
		return why_set(why, -EIO, "%s: cannot be written", path);
	return 0;
}

/* One curve a run of those that wait, or of those that do not. */
static int plot_runs(const struct walk_results *results, const char *folder, bool waits,
		     enum column column, const char *file, const char *title, const char *label,
		     struct why *why)
{
	double *values = calloc((size_t)WALK_RUN_COUNT_MAX * results->frame_count, sizeof(*values));
	struct plot_series series[WALK_RUN_COUNT_MAX];
	struct plot plot = { title, "frame", label, false, column == COLUMN_MS, series, 0 };
	char path[PATH_MAX];
	int r;

	if (!values)
		return why_set(why, -ENOMEM, "out of memory");
	for (size_t k = 0; k < results->run_count; k++) {
		const struct walk_run *run = &results->runs[k];
		double *of_run = values + k * results->frame_count;

		if (run->options.waits != waits)
			continue;
		for (uint32_t i = 0; i < results->frame_count; i++)
			of_run[i] =
				column_of(run, i, column) +
				(column == COLUMN_FETCHED ? column_of(run, i, COLUMN_AHEAD) : 0.0);
		series[plot.series_count++] =
			(struct plot_series){ run->title, NULL, of_run, results->frame_count,
					      PLOT_LINES };
	}
	(void)snprintf(path, sizeof(path), "%s/%s.svg", folder, file);
	r = plot.series_count > 0 ? plot_write(path, &plot, why) : 0;
	free(values);
	return r;
}

static int plot_accuracy(const struct walk_results *results, const char *folder, struct why *why)
{
	const struct plot_series series[] = {
		{ "of all pixels", results->accuracy_frames, results->accuracy_of_all,
		  results->accuracy_count, PLOT_BOTH },
		{ "of covered pixels", results->accuracy_frames, results->accuracy_of_covered,
		  results->accuracy_count, PLOT_BOTH },
	};
	const struct plot plot = { "Right pixels of the chosen sets",
				   "frame",
				   "share",
				   false,
				   false,
				   series,
				   ARRAY_LENGTH(series) };
	char path[PATH_MAX];

	(void)snprintf(path, sizeof(path), "%s/accuracy.svg", folder);
	return plot_write(path, &plot, why);
}

int walk_write(const struct walk_results *results, const char *folder, struct why *why)
{
	int r = 0;

	for (size_t i = 0; r == 0 && i < results->run_count; i++)
		r = run_write(results, &results->runs[i], folder, why);
	if (r < 0)
		return r;
	r = plot_runs(results, folder, true, COLUMN_MS, "frame_times", "Frame times, waiting", "ms",
		      why);
	if (r == 0)
		r = plot_runs(results, folder, true, COLUMN_FETCHED, "bytes",
			      "Read a frame, waiting", "bytes", why);
	if (r == 0)
		r = plot_runs(results, folder, false, COLUMN_WRONG, "unsettled",
			      "What live pictures lack of settled ones", "% of covered pixels",
			      why);
	if (r == 0)
		r = plot_accuracy(results, folder, why);
	if (r == -ENOENT) {
		log_warning("walk: %s", why->text);
		r = 0;
	}
	return r;
}
