/* SPDX-License-Identifier: MIT */
/*
 * oocbench chart: accuracy against speed, for every dial there is, on a store's own views.
 */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "formats/base/bytes.h"
#include "formats/base/log.h"
#include "formats/store/store_file.h"
#include "libclient/charted.h"
#include "libclient/select/select.h"
#include "tools/bench/accuracy/chart.h"
#include "tools/bench/accuracy/chart_report.h"
#include "tools/bench/accuracy/delivery.h"
#include "tools/bench/accuracy/tour.h"
#include "tools/bench/base/arguments.h"
#include "tools/bench/base/measure.h"
#include "tools/bench/base/report.h"
#include "tools/bench/base/verb.h"
#include "tools/bench/bench.h"
#include "tools/bench/path/path.h"

#define SIDE_MAX    4096u
#define VIEWS_MAX   1000u
#define SCENES_MAX  8u
#define BURST       4u
#define PATH_FRAMES 600u

static const char help[] =
	"Usage: oocbench chart STORE -o FOLDER [OPTION]...\n"
	"Charts accuracy against speed: turns every dial of drawing and of fetching, measures what each\n"
	"setting costs and how wrong its pictures are, and finds the cheapest that is right enough.\n"
	"The folder gets report.html, which stands alone, tables (CSV) and plots (SVG).\n"
	"\n"
	"  -o, --output FOLDER   where to\n"
	"  --path P.csv     views from a path, instead of a walk inside and an orbit outside\n"
	"  --views N        of each path, in pieces of four frames (16)\n"
	"  --repeats N      of each time; 2 where another setting was quicker both times and no more\n"
	"                   wrong (5)\n"
	"  --error PERCENT  of covered pixels that may be wrong, for the knee (1)\n"
	"  --size WxH       of the pictures (512x384)\n"
	"  --disk PROFILE   that the fetching is charted with: ide-2002, hdd, sata-ssd, share, or\n"
	"                   bytes a second and milliseconds a read, as 40M:12.5 (hdd)\n"
	"  --quick          few settings, few views, one repeat: to see that it works\n"
	"  --json           a summary for programs\n"
	"\n"
	"Example:\n"
	"  oocbench chart plant.ooc -o chart && xdg-open chart/report.html\n";

struct chart_verb_options {
	const char *store;
	const char *folder;
	const char *path;
	uint64_t view_count;
	uint64_t repeat_count;
	double error_percent;
	unsigned size[2];
	const char *disk;
	bool is_quick;
	bool is_json;
};

struct scene {
	const char *name;
	struct chart_scene views;
	struct path path; /* that they are of; its frames follow each other */
	struct chart chart;
	bool is_measured;
};

struct chart_verb {
	const struct chart_verb_options *options;
	char scratch[PATH_MAX];
	struct measure_daemon daemon;
	struct chart_options chart_options;
	struct scene scenes[SCENES_MAX];
	size_t scene_count;
	struct delivery delivery;
};

/* ---- views ---- */

/* Pieces of a path, evenly spread over it. */
static int views_take(struct chart_verb *verb, struct scene *scene, struct why *why)
{
	const struct path *path = &scene->path;
	size_t count = verb->options->view_count;
	size_t burst_count;

	if (count > path->camera_count)
		count = path->camera_count;
	scene->views.burst = count < BURST ? count : BURST;
	burst_count = count / scene->views.burst;
	count = burst_count * scene->views.burst;
	scene->views.cameras = calloc(count, sizeof(*scene->views.cameras));
	if (!scene->views.cameras)
		return why_set(why, -ENOMEM, "out of memory");
	for (size_t i = 0; i < count; i++) {
		size_t piece = i / scene->views.burst;
		size_t begin = piece * (path->camera_count - scene->views.burst) / burst_count;

		scene->views.cameras[i] = path->cameras[begin + i % scene->views.burst];
		scene->views.cameras[i].time_s = (double)i;
	}
	scene->views.camera_count = count;
	return 0;
}

static int scene_add(struct chart_verb *verb, const char *name, const char *title,
		     enum path_kind kind, struct why *why)
{
	struct scene *scene = &verb->scenes[verb->scene_count];
	int r;

	scene->name = name;
	scene->views.title = title;
	if (verb->options->path) {
		uint32_t count;

		r = camera_path_read(verb->options->path, &scene->path.cameras, &count, why);
		scene->path.camera_count = r < 0 ? 0 : count;
		if (r == 0 && count == 0)
			r = why_set(why, -EINVAL, "%s: no camera in it", verb->options->path);
	} else {
		r = path_make(verb->options->store, kind, PATH_FRAMES, 1, &scene->path, why);
	}
	if (r < 0)
		return r;
	verb->scene_count++;
	return views_take(verb, scene, why);
}

static int scenes_make(struct chart_verb *verb, struct why *why)
{
	int r;

	if (verb->options->path)
		return scene_add(verb, "path", "Along the path", PATH_WALK, why);
	r = scene_add(verb, "inside", "Inside: a walk", PATH_WALK, why);
	if (r == -ENODATA) {
		/* Nothing to stand on: it is looked at from outside alone. */
		log_warning("chart: %s; there is no view from inside", why->text);
		r = 0;
	}
	return r < 0 ? r : scene_add(verb, "outside", "Outside: an orbit", PATH_ORBIT, why);
}

/* ---- settings ---- */

static void approximate_add(struct chart *chart, enum select_order order, double percent,
			    double scale)
{
	const char *method = select_order_name(order);
	char budget[24];
	char name[48];
	const char *const options[] = { "--mode",   "approximate", "--order", method,
					"--budget", budget,        NULL };
	double triangles = chart->full_triangles * percent / 100.0;

	(void)snprintf(budget, sizeof(budget), "%.0f", triangles < 1.0 ? 1.0 : triangles);
	(void)snprintf(name, sizeof(name), "%s %g %%", method, percent);
	if (scale < 1.0)
		(void)snprintf(name, sizeof(name), "%s %g %% size / %g", method, percent,
			       1.0 / scale);
	chart_add(chart, scale < 1.0 ? "smaller, approximate" : method, name, scale, options);
}

static void settings_add(const struct chart_verb *verb, struct chart *chart)
{
	static const char *const full[] = { "--mode", "full", NULL };
	static const char *const testers[] = { "items", "queries", "software" };
	static const double percents[] = { 1, 2, 5, 10, 20, 50 };
	bool is_quick = verb->options->is_quick;

	chart_add(chart, "full", "full", 1.0, full);
	for (size_t i = 0; i < ARRAY_LENGTH(testers) && (!is_quick || i < 1); i++) {
		const char *const options[] = { "--mode", "conservative", "--visibility",
						testers[i], NULL };
		char name[48];

		(void)snprintf(name, sizeof(name), "conservative %s", testers[i]);
		chart_add(chart, "conservative", name, 1.0, options);
	}
	/* Auto is one of the others: quickly that, otherwise each of them. */
	for (unsigned order = 0; order < SELECT_ORDER_COUNT_; order++)
		for (size_t i = 0; i < ARRAY_LENGTH(percents); i++)
			if (is_quick ? order == SELECT_ORDER_AUTO && i % 3 == 1
				     : order != SELECT_ORDER_AUTO)
				approximate_add(chart, (enum select_order)order, percents[i], 1.0);
	for (double scale = 0.5; scale >= (is_quick ? 0.5 : 0.25); scale *= 0.5) {
		char name[48];

		(void)snprintf(name, sizeof(name), "full size / %g", 1.0 / scale);
		chart_add(chart, "smaller, full", name, scale, full);
	}
	approximate_add(chart, SELECT_ORDER_AUTO, 20, 0.5);
}

/* ---- the run ---- */

static int prepare(struct chart_verb *verb, struct why *why)
{
	const struct chart_verb_options *options = verb->options;
	struct tour_options warm = { .store = options->store, .width = 1, .height = 1 };
	char cache[32];
	const char *arguments[] = { "--cache-size", cache, NULL };
	struct stat status;
	int r;

	if (stat(options->store, &status) < 0)
		return why_errno(why, -errno, "%s", options->store);
	if (mkdir(options->folder, 0777) < 0 && errno != EEXIST)
		return why_errno(why, -errno, "%s", options->folder);
	r = measure_scratch_make(NULL, verb->scratch, why);
	if (r < 0)
		return r;
	/* Decoded it is larger, and a cache is not filled to the last page. */
	(void)snprintf(cache, sizeof(cache), "%llu",
		       (unsigned long long)(4 * (uint64_t)status.st_size + 64 * MIB));
	r = measure_daemon_start_with(verb->scratch, arguments, &verb->daemon, why);
	if (r < 0)
		return r;
	warm.socket_path = verb->daemon.socket_path;
	verb->chart_options = (struct chart_options){
		.store = options->store,
		.width = options->size[0],
		.height = options->size[1],
		.repeat_count = (unsigned)options->repeat_count,
		.scratch = verb->scratch,
		.socket_path = verb->daemon.socket_path,
	};
	return tour_warm(&warm, why);
}

static int scenes_measure(struct chart_verb *verb, struct why *why)
{
	int r = 0;

	for (size_t i = 0; r == 0 && i < verb->scene_count; i++) {
		struct scene *scene = &verb->scenes[i];

		r = chart_init(&scene->chart, &verb->chart_options, &scene->views, why);
		if (r < 0)
			break;
		scene->is_measured = true;
		settings_add(verb, &scene->chart);
		r = chart_measure(&scene->chart, why);
	}
	return r;
}

static int page_write(struct chart_verb *verb, struct why *why)
{
	const struct chart_verb_options *options = verb->options;
	char path[PATH_MAX];
	struct page *page;
	int r;

	if (snprintf(path, sizeof(path), "%s/report.html", options->folder) >= (int)sizeof(path))
		return why_set(why, -ENAMETOOLONG, "%s: too long a name", options->folder);
	r = page_create(path, "Accuracy against speed", &page, why);
	if (r < 0)
		return r;
	page_paragraph(page, "%s", options->store);
	for (size_t i = 0; r == 0 && i < verb->scene_count; i++)
		r = chart_report(&verb->scenes[i].chart, page, options->folder,
				 verb->scenes[i].name, options->error_percent / 100.0, why);
	if (r == 0)
		r = delivery_report(&verb->delivery, page, options->folder, why);
	if (r < 0) {
		page_abandon(page);
		return r;
	}
	return page_finish(page, why);
}

/* What a setting is called that is the same in all scenes, but for the budget's number. */
static void charted_combine(const struct chart_verb *verb, size_t index, struct charted *ret)
{
	double triangles = -1.0;

	*ret = (struct charted){ .error = 0.0 };
	for (size_t i = 0; i < verb->scene_count; i++) {
		const struct chart *chart = &verb->scenes[i].chart;
		const struct chart_setting *setting = &chart->settings[index];

		ret->error = fmax(ret->error, setting->wrong_of_covered_mean);
		ret->ms = fmax(ret->ms, setting->ms.median);
		/* Of the scene that needs most, so that it is enough in all. */
		if (chart->full_triangles > triangles)
			(void)chart_options_text(setting, ret->options, sizeof(ret->options));
		triangles = fmax(triangles, chart->full_triangles);
	}
}

/* For `oocview --error`: settings of pictures of the full size. */
static int knees_keep(const struct chart_verb *verb, struct why *why)
{
	struct charted charted[CHARTED_COUNT_MAX];
	const struct chart *chart = &verb->scenes[0].chart;
	struct store_file *store;
	size_t count = 0;
	int r;

	for (size_t i = 0; i < chart->setting_count && count < CHARTED_COUNT_MAX; i++)
		if (chart->settings[i].scale == 1.0)
			charted_combine(verb, i, &charted[count++]);
	r = store_open_path(verb->options->store, &store, why);
	if (r < 0)
		return r;
	r = charted_write(store_superblock(store)->uuid, charted, count, why);
	store_close(store);
	return r;
}

static void summary_print(const struct chart_verb *verb)
{
	struct report report;

	report_begin(&report, verb->options->is_json);
	for (size_t i = 0; i < verb->scene_count; i++) {
		const struct chart *chart = &verb->scenes[i].chart;
		size_t knee = chart_knee(chart, verb->options->error_percent / 100.0);

		report_group_begin(&report, verb->scenes[i].name, verb->scenes[i].views.title);
		report_number(&report, "settings", "settings", (double)chart->setting_count, "");
		report_number(&report, "full_ms", "full mode, p95", chart->settings[0].ms.median,
			      "ms");
		if (knee < chart->setting_count) {
			const struct chart_setting *setting = &chart->settings[knee];

			report_text(&report, "knee", "cheapest that is right enough",
				    setting->name);
			report_number(&report, "knee_ms", "its p95", setting->ms.median, "ms");
			report_number(&report, "knee_wrong", "wrong of covered pixels",
				      100.0 * setting->wrong_of_covered_mean, "%");
		}
		report_group_end(&report);
	}
	report_text(&report, "folder", "report.html is in", verb->options->folder);
	report_end(&report);
}

static int chart_run(struct chart_verb *verb, struct why *why)
{
	const struct chart_verb_options *options = verb->options;
	int r = scenes_make(verb, why);

	if (r == 0)
		r = prepare(verb, why);
	if (r == 0)
		r = scenes_measure(verb, why);
	if (r == 0) {
		const struct delivery_options delivery = {
			.store = options->store,
			.disk = options->disk,
			.path = &verb->scenes[0].path,
			.width = options->size[0],
			.height = options->size[1],
			.is_quick = options->is_quick,
		};

		r = delivery_measure(&verb->delivery, &delivery, why);
	}
	if (r == 0)
		r = page_write(verb, why);
	if (r == 0 && knees_keep(verb, why) < 0)
		log_warning("chart: not kept for oocview --error: %s", why->text);
	if (r == 0)
		summary_print(verb);
	return r;
}

static void chart_verb_done(struct chart_verb *verb)
{
	for (size_t i = 0; i < SCENES_MAX; i++) {
		struct scene *scene = &verb->scenes[i];

		if (scene->is_measured)
			chart_done(&scene->chart);
		path_done(&scene->path);
		free(scene->views.cameras);
	}
	if (verb->daemon.child.pid > 0)
		measure_daemon_stop(&verb->daemon);
	if (verb->scratch[0] != '\0')
		measure_scratch_remove(verb->scratch);
}

int verb_chart(int argc, char **argv)
{
	struct chart_verb_options options = {
		.view_count = 16,
		.repeat_count = 5,
		.error_percent = 1.0,
		.size = { 512, 384 },
		.disk = "hdd",
	};
	struct chart_verb verb = { .options = &options };
	const struct argument table[] = {
		{ "output", ARGUMENT_TEXT, &options.folder, .letter = 'o' },
		{ "path", ARGUMENT_TEXT, &options.path },
		{ "views", ARGUMENT_NUMBER, &options.view_count, 1, VIEWS_MAX },
		{ "repeats", ARGUMENT_NUMBER, &options.repeat_count, 1, CHART_REPEAT_COUNT_MAX },
		{ "error", ARGUMENT_REAL, &options.error_percent, 0, 100 },
		{ "size", ARGUMENT_PICTURE, options.size, 16, SIDE_MAX },
		{ "disk", ARGUMENT_TEXT, &options.disk },
		{ "quick", ARGUMENT_FLAG, &options.is_quick },
		{ "json", ARGUMENT_FLAG, &options.is_json },
		{ NULL },
	};
	const struct arguments arguments = { "chart", help, table, 1, 1, "name one store" };
	char **operands;
	struct why why = { "" };
	int r;

	r = arguments_parse(&arguments, argc, argv, &operands);
	if (r != ARGUMENTS_OK)
		return r;
	options.store = operands[0];
	if (!options.folder)
		return verb_usage_error("chart", "it needs -o FOLDER");
	if (options.is_quick) {
		options.view_count = 4;
		options.repeat_count = 1;
	}
	r = chart_run(&verb, &why);
	chart_verb_done(&verb);
	return verb_status("chart", r, &why);
}
