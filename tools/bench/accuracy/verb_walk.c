/* SPDX-License-Identifier: MIT */
/*
 * oocbench walk: a walk through a store from a cold cache, as it is published that it was done and as
 * it is done here.
 *
 * *Waiting*, a frame is drawn when all that it wants is there: nodes fetched one after the other,
 * several at a time, and ahead of time as well, beside a run in which everything is resident.  The
 * pictures of all are the same.  *Live*, a frame is drawn with what is there: what it lacks of the
 * settled picture, and how long nodes take to come, without looking ahead, with it, and with rivals
 * that choose otherwise at the same budget.
 */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "formats/base/bytes.h"
#include "formats/base/log.h"
#include "tools/bench/accuracy/judge.h"
#include "tools/bench/accuracy/tour.h"
#include "tools/bench/base/arguments.h"
#include "tools/bench/base/figures.h"
#include "tools/bench/base/measure.h"
#include "tools/bench/base/plot.h"
#include "tools/bench/base/report.h"
#include "tools/bench/bench.h"

#define FRAMES_MAX 1000000u
#define SIDE_MAX   8192u
#define RUNS_MAX   16u
/* Reads at one time: what the published systems had threads for, and one. */
#define DEPTH_CONCURRENT "8"
#define DEPTH_SEQUENTIAL "1"

static const char help[] =
	"Usage: oocbench walk STORE --path P.csv -o FOLDER [OPTION]...\n"
	"Goes along a path from a cold cache, waiting for each frame's nodes and not waiting, and says\n"
	"what fetching several at a time and looking ahead are good for.\n"
	"\n"
	"  --path P.csv     cameras, a row a frame\n"
	"  -o, --output FOLDER   for tables (CSV) and plots (SVG)\n"
	"  --mode MODE      waiting, live or both (both)\n"
	"  --frames N       the first N rows alone\n"
	"  --fps N          frames a second at most, which is how fast the walker goes (30)\n"
	"  --speeds N       live, also 2, 4, ... N times as fast (1: not)\n"
	"  --rivals         live, also with other ways to choose what is asked for ahead of time\n"
	"  --budget N       triangles a frame; 0: all that is in the frustum (280000)\n"
	"  --order ORDER    of the budget's nodes: layer, solidity, extinction, transmittance,\n"
	"                   distance, auto (auto)\n"
	"  --size WxH       of the pictures (640x480)\n"
	"  --cache SIZE     of the daemon (256M)\n"
	"  --disk PROFILE   read as from another disk: ide-2002, hdd, sata-ssd, share, 40M:12.5\n"
	"  --ahead SIZE     asked for ahead of time, a frame (2M)\n"
	"  --horizon S      seconds that are looked ahead (0.7)\n"
	"  --stride N       every Nth frame is compared with the exact picture (30)\n"
	"  --json           results for programs\n"
	"\n"
	"The store is kept in memory while pictures are compared.\n"
	"\n"
	"Example:\n"
	"  oocbench walk plant.ooc --path walk.csv --disk ide-2002 -o walk\n";

enum walk_mode {
	MODE_WAITING,
	MODE_LIVE,
	MODE_BOTH
};

struct walk_options {
	const char *store;
	const char *path;
	const char *folder;
	unsigned mode; /* enum walk_mode */
	uint64_t frame_count;
	uint64_t fps;
	uint64_t speed_max;
	bool has_rivals;
	uint64_t budget_triangles;
	unsigned order; /* enum select_order */
	unsigned size[2];
	uint64_t cache_bytes;
	const char *disk;
	uint64_t ahead_bytes;
	double horizon_s;
	uint64_t stride;
	bool is_json;
};

/* One tour of the whole path, in one way. */
struct run {
	char name[32];
	const char *title;
	struct tour_options options;
	bool is_resident;
	const char *depth;
	struct tour tour;
	double *wrong; /* a frame: share of the settled picture's covered pixels that is not drawn */
};

struct walk_verb {
	const struct walk_options *options;
	struct camera *cameras;
	uint32_t camera_count;
	char scratch[PATH_MAX];
	struct judge *judge;
	struct run runs[RUNS_MAX];
	size_t run_count;
	/* Of the set that is asked for, whatever is there: compared with the exact picture. */
	double *accuracy_frames;
	double *accuracy_of_all;
	double *accuracy_of_covered;
	size_t accuracy_count;
	uint64_t differing_pictures;
};

/* ---- the runs ---- */

static struct run *run_add(struct walk_verb *verb, const char *name, const char *title, bool waits,
			   enum tour_fetching fetching, enum tour_ahead ahead)
{
	const struct walk_options *options = verb->options;
	struct run *run = &verb->runs[verb->run_count++];

	(void)snprintf(run->name, sizeof(run->name), "%s", name);
	run->title = title;
	run->depth = fetching == TOUR_SEQUENTIAL ? DEPTH_SEQUENTIAL : DEPTH_CONCURRENT;
	run->options = (struct tour_options){
		.store = options->store,
		.cameras = verb->cameras,
		.camera_count = verb->camera_count,
		.width = options->size[0],
		.height = options->size[1],
		.selection = { (enum select_order)options->order, options->budget_triangles },
		.frame_s = 1.0 / (double)options->fps,
		.waits = waits,
		.fetching = fetching,
		.ahead = ahead,
		.horizon_s = options->horizon_s,
		.ahead_bytes = options->ahead_bytes,
		.ahead_requests = 1000,
	};
	return run;
}

static void runs_make(struct walk_verb *verb)
{
	const struct walk_options *options = verb->options;

	if (options->mode != MODE_LIVE) {
		run_add(verb, "resident", "everything resident", true, TOUR_CONCURRENT,
			TOUR_AHEAD_NOTHING)
			->is_resident = true;
		run_add(verb, "sequential", "(a) one read at a time", true, TOUR_SEQUENTIAL,
			TOUR_AHEAD_NOTHING);
		run_add(verb, "concurrent", "(b) several reads at a time", true, TOUR_CONCURRENT,
			TOUR_AHEAD_NOTHING);
		run_add(verb, "ahead", "(c) and looking ahead", true, TOUR_CONCURRENT,
			TOUR_AHEAD_SELECTION);
	}
	if (options->mode == MODE_WAITING)
		return;
	run_add(verb, "live", "live", false, TOUR_CONCURRENT, TOUR_AHEAD_NOTHING);
	run_add(verb, "live_ahead", "live, looking ahead", false, TOUR_CONCURRENT,
		TOUR_AHEAD_SELECTION);
	if (options->has_rivals) {
		run_add(verb, "live_frustum", "live, the frustum ahead", false, TOUR_CONCURRENT,
			TOUR_AHEAD_FRUSTUM);
		run_add(verb, "live_radius", "live, all that is near", false, TOUR_CONCURRENT,
			TOUR_AHEAD_RADIUS);
		run_add(verb, "live_path", "live, the path known", false, TOUR_CONCURRENT,
			TOUR_AHEAD_PATH);
	}
	for (uint64_t speed = 2; speed <= options->speed_max && verb->run_count < RUNS_MAX;
	     speed *= 2) {
		char name[32];
		struct run *run;

		(void)snprintf(name, sizeof(name), "live_x%u", (unsigned)speed);
		run = run_add(verb, name, "live, looking ahead, faster", false, TOUR_CONCURRENT,
			      TOUR_AHEAD_SELECTION);
		run->options.frame_s /= (double)speed;
	}
}

static int run_daemon(const struct walk_verb *verb, const struct run *run,
		      struct measure_daemon *ret, struct why *why)
{
	const struct walk_options *options = verb->options;
	struct stat status;
	char cache[32];
	const char *arguments[8] = { "--cache-size", cache, "--queue-depth", run->depth };
	uint64_t cache_bytes = options->cache_bytes;

	if (run->is_resident) {
		/* Decoded it is larger, and a cache is not filled to the last page. */
		if (stat(options->store, &status) < 0)
			return why_errno(why, -errno, "%s", options->store);
		cache_bytes = u64_max(cache_bytes, 4 * (uint64_t)status.st_size + 64 * MIB);
	} else if (options->disk) {
		arguments[4] = "--disk";
		arguments[5] = options->disk;
	}
	(void)snprintf(cache, sizeof(cache), "%llu", (unsigned long long)cache_bytes);
	return measure_daemon_start_with(verb->scratch, arguments, ret, why);
}

static int run_tour(struct walk_verb *verb, struct run *run, struct why *why)
{
	struct measure_daemon daemon;
	int r = run_daemon(verb, run, &daemon, why);

	if (r < 0)
		return r;
	run->options.socket_path = daemon.socket_path;
	if (run->is_resident)
		r = tour_warm(&run->options, why);
	if (r == 0)
		r = tour_run(&run->options, &run->tour, why);
	measure_daemon_stop(&daemon);
	return r;
}

/* What each picture lacks of the settled one: after the tour, so that nothing waits for it. */
static int run_judge(struct walk_verb *verb, struct run *run, struct why *why)
{
	run->wrong = calloc(verb->camera_count, sizeof(*run->wrong));
	if (!run->wrong)
		return why_set(why, -ENOMEM, "out of memory");
	for (uint32_t i = 0; i < verb->camera_count; i++) {
		const struct tour_frame *frame = &run->tour.frames[i];
		struct verdict verdict;
		int r;

		if (frame->missing == 0)
			continue;
		r = judge_settled(verb->judge, &verb->cameras[i], &run->options.selection,
				  &run->tour.missing[frame->missing_first], frame->missing,
				  &verdict);
		if (r < 0)
			return why_errno(why, r, "comparing pictures");
		if (verdict.covered > 0)
			run->wrong[i] = (double)verdict.wrong / (double)verdict.covered;
		if (measure_was_cancelled())
			return why_set(why, -ECANCELED, "interrupted");
	}
	return 0;
}

static int accuracy_measure(struct walk_verb *verb, struct why *why)
{
	const struct select_options selection = { (enum select_order)verb->options->order,
						  verb->options->budget_triangles };

	verb->accuracy_frames = calloc(verb->camera_count, sizeof(double));
	verb->accuracy_of_all = calloc(verb->camera_count, sizeof(double));
	verb->accuracy_of_covered = calloc(verb->camera_count, sizeof(double));
	if (!verb->accuracy_frames || !verb->accuracy_of_all || !verb->accuracy_of_covered)
		return why_set(why, -ENOMEM, "out of memory");
	for (uint32_t i = 0; i < verb->camera_count; i += (uint32_t)verb->options->stride) {
		struct verdict verdict;
		size_t at = verb->accuracy_count++;
		int r = judge_exact(verb->judge, &verb->cameras[i], &selection, NULL, 0, &verdict);

		if (r < 0)
			return why_errno(why, r, "comparing with the exact picture");
		if (measure_was_cancelled())
			return why_set(why, -ECANCELED, "interrupted");
		verb->accuracy_frames[at] = i;
		verb->accuracy_of_all[at] = 1.0 - (double)verdict.wrong / (double)verdict.all;
		verb->accuracy_of_covered[at] =
			verdict.covered > 0 ? 1.0 - (double)verdict.wrong / (double)verdict.covered
					    : 1.0;
	}
	return 0;
}

/* Frames whose pictures are not the same in all waiting runs. */
static void pictures_compare(struct walk_verb *verb)
{
	const struct tour_frame *first = NULL;

	for (size_t k = 0; k < verb->run_count; k++) {
		const struct run *run = &verb->runs[k];

		if (!run->options.waits)
			continue;
		if (!first)
			first = run->tour.frames;
		for (uint32_t i = 0; i < verb->camera_count; i++)
			verb->differing_pictures += run->tour.frames[i].picture != first[i].picture;
	}
}

/* ---- figures ---- */

/* A value of each frame, by what it is. */
enum column {
	COLUMN_MS,
	COLUMN_FETCHED,
	COLUMN_AHEAD,
	COLUMN_WRONG,
};

static double column_of(const struct run *run, uint32_t frame, enum column column)
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

static void report_frames(struct report *report, const struct run *run, double *values)
{
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

static double percent(uint64_t part, uint64_t whole)
{
	return whole > 0 ? 100.0 * (double)part / (double)whole : 0.0;
}

static void report_nodes(struct report *report, struct run *run)
{
	struct tour_firsts *firsts = &run->tour.firsts;
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

static void report_accuracy(struct report *report, const struct walk_verb *verb)
{
	double *values = calloc(verb->accuracy_count + 1, sizeof(*values));

	if (!values)
		return;
	report_group_begin(report, "accuracy", "the chosen sets against the exact pictures");
	for (size_t i = 0; i < verb->accuracy_count; i++)
		values[i] = 100.0 * (1.0 - verb->accuracy_of_all[i]);
	report_distribution(report, "wrong_of_all", "wrong of all pixels",
			    distribution_of(values, verb->accuracy_count), "%");
	for (size_t i = 0; i < verb->accuracy_count; i++)
		values[i] = 100.0 * (1.0 - verb->accuracy_of_covered[i]);
	report_distribution(report, "wrong_of_covered", "wrong of covered pixels",
			    distribution_of(values, verb->accuracy_count), "%");
	report_group_end(report);
	free(values);
}

static int walk_report(struct walk_verb *verb)
{
	double *values = calloc(verb->camera_count, sizeof(*values));
	uint64_t set_bytes_max = 0;
	struct report report;

	if (!values)
		return -ENOMEM;
	for (uint32_t i = 0; i < verb->camera_count; i++)
		set_bytes_max = u64_max(set_bytes_max, verb->runs[0].tour.frames[i].set_bytes);
	report_begin(&report, verb->options->is_json);
	report_number(&report, "frames", "frames", verb->camera_count, "");
	report_number(&report, "largest_set_mb", "largest set of a frame",
		      (double)set_bytes_max * 1e-6, "MB");
	report_accuracy(&report, verb);
	for (size_t i = 0; i < verb->run_count; i++) {
		struct run *run = &verb->runs[i];

		report_group_begin(&report, run->name, run->title);
		report_number(&report, "seconds", "took", run->tour.seconds, "s");
		report_frames(&report, run, values);
		if (!run->is_resident)
			report_nodes(&report, run);
		report_group_end(&report);
	}
	if (verb->options->mode != MODE_LIVE)
		report_number(&report, "differing_pictures",
			      "pictures that differ between waiting runs",
			      (double)verb->differing_pictures, "");
	report_end(&report);
	free(values);
	return 0;
}

/* ---- files ---- */

static int run_write(const struct walk_verb *verb, const struct run *run, struct why *why)
{
	char path[PATH_MAX];
	FILE *file;
	bool failed;

	(void)snprintf(path, sizeof(path), "%s/%s.csv", verb->options->folder, run->name);
	file = fopen(path, "we");
	if (!file)
		return why_errno(why, -errno, "%s", path);
	fputs("frame,ms,wait_ms,wanted,missing,triangles,set_bytes,fetched_bytes,ahead_bytes,"
	      "unsettled_percent\n",
	      file);
	for (uint32_t i = 0; i < verb->camera_count; i++) {
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
static int plot_runs(const struct walk_verb *verb, bool waits, enum column column, const char *file,
		     const char *title, const char *label, struct why *why)
{
	double *values = calloc((size_t)RUNS_MAX * verb->camera_count, sizeof(*values));
	struct plot_series series[RUNS_MAX];
	struct plot plot = { title, "frame", label, false, column == COLUMN_MS, series, 0 };
	char path[PATH_MAX];
	int r;

	if (!values)
		return why_set(why, -ENOMEM, "out of memory");
	for (size_t k = 0; k < verb->run_count; k++) {
		const struct run *run = &verb->runs[k];
		double *of_run = values + k * verb->camera_count;

		if (run->options.waits != waits)
			continue;
		for (uint32_t i = 0; i < verb->camera_count; i++)
			of_run[i] =
				column_of(run, i, column) +
				(column == COLUMN_FETCHED ? column_of(run, i, COLUMN_AHEAD) : 0.0);
		series[plot.series_count++] =
			(struct plot_series){ run->title, NULL, of_run, verb->camera_count,
					      PLOT_LINES };
	}
	(void)snprintf(path, sizeof(path), "%s/%s.svg", verb->options->folder, file);
	r = plot.series_count > 0 ? plot_write(path, &plot, why) : 0;
	free(values);
	return r;
}

static int plot_accuracy(const struct walk_verb *verb, struct why *why)
{
	const struct plot_series series[] = {
		{ "of all pixels", verb->accuracy_frames, verb->accuracy_of_all,
		  verb->accuracy_count, PLOT_BOTH },
		{ "of covered pixels", verb->accuracy_frames, verb->accuracy_of_covered,
		  verb->accuracy_count, PLOT_BOTH },
	};
	const struct plot plot = { "Right pixels of the chosen sets",
				   "frame",
				   "share",
				   false,
				   false,
				   series,
				   ARRAY_LENGTH(series) };
	char path[PATH_MAX];

	(void)snprintf(path, sizeof(path), "%s/accuracy.svg", verb->options->folder);
	return plot_write(path, &plot, why);
}

static int walk_write(const struct walk_verb *verb, struct why *why)
{
	int r = 0;

	for (size_t i = 0; r == 0 && i < verb->run_count; i++)
		r = run_write(verb, &verb->runs[i], why);
	if (r < 0)
		return r;
	r = plot_runs(verb, true, COLUMN_MS, "frame_times", "Frame times, waiting", "ms", why);
	if (r == 0)
		r = plot_runs(verb, true, COLUMN_FETCHED, "bytes", "Read a frame, waiting", "bytes",
			      why);
	if (r == 0)
		r = plot_runs(verb, false, COLUMN_WRONG, "unsettled",
			      "What live pictures lack of settled ones", "% of covered pixels",
			      why);
	if (r == 0)
		r = plot_accuracy(verb, why);
	if (r == -ENOENT) {
		log_warning("walk: %s", why->text);
		r = 0;
	}
	return r;
}

/* ---- the verb ---- */

static int walk_prepare(struct walk_verb *verb, struct why *why)
{
	const struct walk_options *options = verb->options;
	int r = camera_path_read(options->path, &verb->cameras, &verb->camera_count, why);

	if (r < 0)
		return r;
	if (verb->camera_count > options->frame_count)
		verb->camera_count = (uint32_t)options->frame_count;
	if (verb->camera_count == 0)
		return why_set(why, -EINVAL, "%s: no camera in it", options->path);
	if (mkdir(options->folder, 0777) < 0 && errno != EEXIST)
		return why_errno(why, -errno, "%s", options->folder);
	r = measure_scratch_make(NULL, verb->scratch, why);
	if (r < 0)
		return r;
	return judge_create(options->store, options->size[0], options->size[1], &verb->judge, why);
}

static void walk_done(struct walk_verb *verb)
{
	for (size_t i = 0; i < verb->run_count; i++) {
		tour_done(&verb->runs[i].tour);
		free(verb->runs[i].wrong);
	}
	judge_destroy(verb->judge);
	if (verb->scratch[0] != '\0')
		measure_scratch_remove(verb->scratch);
	free(verb->cameras);
	free(verb->accuracy_frames);
	free(verb->accuracy_of_all);
	free(verb->accuracy_of_covered);
}

static int walk_run(struct walk_verb *verb, struct why *why)
{
	int r = walk_prepare(verb, why);

	if (r < 0)
		return r;
	runs_make(verb);
	for (size_t i = 0; r == 0 && i < verb->run_count; i++) {
		r = run_tour(verb, &verb->runs[i], why);
		if (r == 0 && !verb->runs[i].options.waits)
			r = run_judge(verb, &verb->runs[i], why);
	}
	if (r == 0)
		r = accuracy_measure(verb, why);
	if (r < 0)
		return r;
	pictures_compare(verb);
	r = walk_write(verb, why);
	return r < 0 ? r : walk_report(verb);
}

int verb_walk(int argc, char **argv)
{
	static const char *const modes[] = { "waiting", "live", "both", NULL };
	struct walk_options options = {
		.mode = MODE_BOTH,
		.frame_count = FRAMES_MAX,
		.fps = 30,
		.speed_max = 1,
		.budget_triangles = 280000,
		.order = SELECT_ORDER_AUTO,
		.size = { 640, 480 },
		.cache_bytes = 256 * MIB,
		.ahead_bytes = 2 * MIB,
		.horizon_s = 0.7,
		.stride = 30,
	};
	const char *orders[SELECT_ORDER_COUNT_ + 1] = { NULL };
	struct walk_verb verb = { .options = &options };
	const struct argument table[] = {
		{ "path", ARGUMENT_TEXT, &options.path },
		{ "output", ARGUMENT_TEXT, &options.folder, .letter = 'o' },
		{ "mode", ARGUMENT_CHOICE, &options.mode, .choices = modes },
		{ "frames", ARGUMENT_NUMBER, &options.frame_count, 1, FRAMES_MAX },
		{ "fps", ARGUMENT_NUMBER, &options.fps, 1, 1000 },
		{ "speeds", ARGUMENT_NUMBER, &options.speed_max, 1, 64 },
		{ "rivals", ARGUMENT_FLAG, &options.has_rivals },
		{ "budget", ARGUMENT_NUMBER, &options.budget_triangles },
		{ "order", ARGUMENT_CHOICE, &options.order, .choices = orders },
		{ "size", ARGUMENT_PICTURE, options.size, 1, SIDE_MAX },
		{ "cache", ARGUMENT_SIZE, &options.cache_bytes, MIB },
		{ "disk", ARGUMENT_TEXT, &options.disk },
		{ "ahead", ARGUMENT_SIZE, &options.ahead_bytes },
		{ "horizon", ARGUMENT_REAL, &options.horizon_s, 0.01, 10 },
		{ "stride", ARGUMENT_NUMBER, &options.stride, 1, FRAMES_MAX },
		{ "json", ARGUMENT_FLAG, &options.is_json },
		{ NULL },
	};
	const struct arguments arguments = { "walk", help, table, 1, 1, "name one store" };
	char **operands;
	struct why why = { "" };
	int r;

	for (unsigned i = 0; i < SELECT_ORDER_COUNT_; i++)
		orders[i] = select_order_name((enum select_order)i);
	r = arguments_parse(&arguments, argc, argv, &operands);
	if (r != ARGUMENTS_OK)
		return r;
	options.store = operands[0];
	if (!options.path || !options.folder)
		return verb_usage_error("walk", "it needs --path P.csv and -o FOLDER");
	r = walk_run(&verb, &why);
	walk_done(&verb);
	if (r < 0)
		log_error("walk: %s", why.text);
	return r == 0 && verb.differing_pictures == 0 ? 0 : 1;
}
