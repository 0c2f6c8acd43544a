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
#include "tools/bench/accuracy/judge.h"
#include "tools/bench/accuracy/tour.h"
#include "tools/bench/accuracy/walk_report.h"
#include "tools/bench/base/arguments.h"
#include "tools/bench/base/measure.h"
#include "tools/bench/base/verb.h"
#include "tools/bench/bench.h"

#define FRAMES_MAX 1000000u
#define SIDE_MAX   8192u
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
	"  --brief          only with everything resident, and looking ahead: for long paths\n"
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
	bool is_brief;
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

struct walk_verb {
	const struct walk_options *options;
	struct camera *cameras;
	char scratch[PATH_MAX];
	struct judge *judge;
	struct walk_results results;
};

/* ---- the runs ---- */

static struct walk_run *run_add(struct walk_verb *verb, const char *name, const char *title,
				bool waits, enum tour_fetching fetching, enum tour_ahead ahead)
{
	const struct walk_options *options = verb->options;
	struct walk_run *run = &verb->results.runs[verb->results.run_count++];

	(void)snprintf(run->name, sizeof(run->name), "%s", name);
	run->title = title;
	run->depth = fetching == TOUR_SEQUENTIAL ? DEPTH_SEQUENTIAL : DEPTH_CONCURRENT;
	run->options = (struct tour_options){
		.store = options->store,
		.cameras = verb->cameras,
		.camera_count = verb->results.frame_count,
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
		if (!options->is_brief) {
			run_add(verb, "sequential", "(a) one read at a time", true, TOUR_SEQUENTIAL,
				TOUR_AHEAD_NOTHING);
			run_add(verb, "concurrent", "(b) several reads at a time", true,
				TOUR_CONCURRENT, TOUR_AHEAD_NOTHING);
		}
		run_add(verb, "ahead", "(c) and looking ahead", true, TOUR_CONCURRENT,
			TOUR_AHEAD_SELECTION);
	}
	if (options->mode == MODE_WAITING)
		return;
	if (!options->is_brief)
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
	for (uint64_t speed = 2;
	     speed <= options->speed_max && verb->results.run_count < WALK_RUN_COUNT_MAX;
	     speed *= 2) {
		char name[32];
		struct walk_run *run;

		(void)snprintf(name, sizeof(name), "live_x%u", (unsigned)speed);
		run = run_add(verb, name, "live, looking ahead, faster", false, TOUR_CONCURRENT,
			      TOUR_AHEAD_SELECTION);
		run->options.frame_s /= (double)speed;
	}
}

static int run_daemon(const struct walk_verb *verb, const struct walk_run *run,
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

static int run_tour(struct walk_verb *verb, struct walk_run *run, struct why *why)
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
static int run_judge(struct walk_verb *verb, struct walk_run *run, struct why *why)
{
	run->wrong = calloc(verb->results.frame_count, sizeof(*run->wrong));
	if (!run->wrong)
		return why_set(why, -ENOMEM, "out of memory");
	for (uint32_t i = 0; i < verb->results.frame_count; i++) {
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

	verb->results.accuracy_frames = calloc(verb->results.frame_count, sizeof(double));
	verb->results.accuracy_of_all = calloc(verb->results.frame_count, sizeof(double));
	verb->results.accuracy_of_covered = calloc(verb->results.frame_count, sizeof(double));
	if (!verb->results.accuracy_frames || !verb->results.accuracy_of_all ||
	    !verb->results.accuracy_of_covered)
		return why_set(why, -ENOMEM, "out of memory");
	for (uint32_t i = 0; i < verb->results.frame_count; i += (uint32_t)verb->options->stride) {
		struct verdict verdict;
		size_t at = verb->results.accuracy_count++;
		int r = judge_exact(verb->judge, &verb->cameras[i], &selection, NULL, 0, &verdict);

		if (r < 0)
			return why_errno(why, r, "comparing with the exact picture");
		if (measure_was_cancelled())
			return why_set(why, -ECANCELED, "interrupted");
		verb->results.accuracy_frames[at] = i;
		verb->results.accuracy_of_all[at] =
			1.0 - (double)verdict.wrong / (double)verdict.all;
		verb->results.accuracy_of_covered[at] =
			verdict.covered > 0 ? 1.0 - (double)verdict.wrong / (double)verdict.covered
					    : 1.0;
	}
	return 0;
}

/* Frames whose pictures are not the same in all waiting runs. */
static void pictures_compare(struct walk_verb *verb)
{
	const struct tour_frame *first = NULL;

	for (size_t k = 0; k < verb->results.run_count; k++) {
		const struct walk_run *run = &verb->results.runs[k];

		if (!run->options.waits)
			continue;
		if (!first)
			first = run->tour.frames;
		for (uint32_t i = 0; i < verb->results.frame_count; i++)
			verb->results.differing_pictures +=
				run->tour.frames[i].picture != first[i].picture;
	}
}

/* ---- the verb ---- */

static int walk_prepare(struct walk_verb *verb, struct why *why)
{
	const struct walk_options *options = verb->options;
	int r = camera_path_read(options->path, &verb->cameras, &verb->results.frame_count, why);

	if (r < 0)
		return r;
	if (verb->results.frame_count > options->frame_count)
		verb->results.frame_count = (uint32_t)options->frame_count;
	if (verb->results.frame_count == 0)
		return why_set(why, -EINVAL, "%s: no camera in it", options->path);
	if (mkdir(options->folder, 0777) < 0 && errno != EEXIST)
		return why_errno(why, -errno, "%s", options->folder);
	r = measure_scratch_make(NULL, verb->scratch, why);
	if (r < 0)
		return r;
	return judge_create(options->store, options->size[0], options->size[1], &verb->judge, why);
}

static void walk_verb_done(struct walk_verb *verb)
{
	judge_destroy(verb->judge);
	if (verb->scratch[0] != '\0')
		measure_scratch_remove(verb->scratch);
	free(verb->cameras);
	walk_results_done(&verb->results);
}

static int walk_run(struct walk_verb *verb, struct why *why)
{
	int r = walk_prepare(verb, why);

	if (r < 0)
		return r;
	runs_make(verb);
	for (size_t i = 0; r == 0 && i < verb->results.run_count; i++) {
		r = run_tour(verb, &verb->results.runs[i], why);
		if (r == 0 && !verb->results.runs[i].options.waits)
			r = run_judge(verb, &verb->results.runs[i], why);
	}
	if (r == 0)
		r = accuracy_measure(verb, why);
	if (r < 0)
		return r;
	pictures_compare(verb);
	r = walk_write(&verb->results, verb->options->folder, why);
	return r < 0 ? r : walk_report(&verb->results, verb->options->is_json);
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
		{ "brief", ARGUMENT_FLAG, &options.is_brief },
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
	walk_verb_done(&verb);
	return verb_status("walk", r, &why) || verb.results.differing_pictures > 0;
}
