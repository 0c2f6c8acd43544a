/* SPDX-License-Identifier: MIT */
#include "tools/bench/accuracy/chart_report.h"

#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/log.h"
#include "tools/bench/accuracy/pareto.h"
#include "tools/bench/base/plot.h"

/* On logarithmic axes no error is drawn so far below the least. */
#define ZERO_SHARE 0.3
#define CELL_BYTES 64u
/* Thumbnails are no wider. */
#define THUMBNAIL_WIDTH 280u

/* What a plot has along its axes. */
typedef double (*chart_value_fn)(const struct chart_setting *setting);

static double cost_ms(const struct chart_setting *setting)
{
	return setting->ms.median;
}

static double cost_triangles(const struct chart_setting *setting)
{
	return setting->triangles;
}

static double error_items(const struct chart_setting *setting)
{
	return setting->wrong_of_covered_mean;
}

static double error_flip(const struct chart_setting *setting)
{
	return setting->flip_mean;
}

static void points_of(const struct chart *chart, struct pareto_point *ret)
{
	for (size_t i = 0; i < chart->setting_count; i++)
		ret[i] = (struct pareto_point){
			.cost = chart->settings[i].ms.median,
			.error = chart->settings[i].wrong_of_covered_mean,
		};
	pareto_mark(ret, chart->setting_count);
}

size_t chart_knee(const struct chart *chart, double error_max)
{
	struct pareto_point points[CHART_SETTING_COUNT_MAX];

	points_of(chart, points);
	return pareto_knee(points, chart->setting_count, error_max);
}

/* ---- tables ---- */

static int csv_write(const struct chart *chart, const struct pareto_point *points,
		     const char *folder, const char *name, struct why *why)
{
	char path[PATH_MAX];
	FILE *file;
	bool failed;

	if (snprintf(path, sizeof(path), "%s/%s.csv", folder, name) >= (int)sizeof(path))
		return why_set(why, -ENAMETOOLONG, "%s: too long a name", folder);
	file = fopen(path, "we");
	if (!file)
		return why_errno(why, -errno, "%s", path);
	fputs("setting,options,scale,p95_ms,p95_ms_low,p95_ms_high,repeats,p95_of_control,triangles,"
	      "wrong_of_covered,wrong_of_covered_worst,wrong_of_all,wrong_of_all_worst,"
	      "colour_of_covered,flip,pop,front\n",
	      file);
	for (size_t i = 0; i < chart->setting_count; i++) {
		const struct chart_setting *at = &chart->settings[i];
		char options[256];

		fprintf(file,
			"%s,%s,%g,%.4f,%.4f,%.4f,%zu,%.4f,%.0f,%.6f,%.6f,%.6f,%.6f,%.6f,%.6f,%.4f,%d\n",
			at->name, chart_options_text(at, options, sizeof(options)), at->scale,
			at->ms.median, at->ms.low, at->ms.high, at->repeat_count,
			at->of_control.median, at->triangles, at->wrong_of_covered_mean,
			at->wrong_of_covered_worst, at->wrong_of_all_mean, at->wrong_of_all_worst,
			at->colour_mean, at->flip_mean, at->pop, points[i].is_on_front);
	}
	failed = ferror(file) != 0;
	if (fclose(file) != 0 || failed)
		return why_set(why, -EIO, "%s: cannot be written", path);
	return 0;
}

static void cell(char ret[CELL_BYTES], const char *format, ...)
	__attribute__((format(printf, 2, 3)));

static void cell(char ret[CELL_BYTES], const char *format, ...)
{
	va_list args;

	va_start(args, format);
	(void)vsnprintf(ret, CELL_BYTES, format, args);
	va_end(args);
}

static void table_write(const struct chart *chart, const struct pareto_point *points,
			struct page *page)
{
	static const char *const heads[] = { "setting",
					     "p95 ms (spread; repeats)",
					     "of control",
					     "k triangles",
					     "wrong / covered %",
					     "worst %",
					     "wrong / all %",
					     "colour > 8 %",
					     "FLIP",
					     "pop",
					     NULL };
	enum {
		COLUMNS = 10
	};

	page_table_begin(page, heads);
	for (size_t i = 0; i < chart->setting_count; i++) {
		const struct chart_setting *at = &chart->settings[i];
		char texts[COLUMNS][CELL_BYTES];
		const char *cells[COLUMNS + 1] = { NULL };

		cell(texts[0], "%s", at->name);
		cell(texts[1], "%.1f (%.1f to %.1f; %zu)", at->ms.median, at->ms.low, at->ms.high,
		     at->repeat_count);
		cell(texts[2], "%.2f", at->of_control.median);
		cell(texts[3], "%.0f", at->triangles * 1e-3);
		cell(texts[4], "%.3f", 100.0 * at->wrong_of_covered_mean);
		cell(texts[5], "%.3f", 100.0 * at->wrong_of_covered_worst);
		cell(texts[6], "%.3f", 100.0 * at->wrong_of_all_mean);
		cell(texts[7], "%.3f", 100.0 * at->colour_mean);
		cell(texts[8], "%.4f", at->flip_mean);
		cell(texts[9], "%.2f", at->pop);
		for (unsigned k = 0; k < COLUMNS; k++)
			cells[k] = texts[k];
		page_row(page, cells, points[i].is_on_front);
	}
	page_table_end(page);
}

/* ---- plots ---- */

/* What a plot shows, by setting. */
struct plane {
	const char *file, *title, *x_label, *y_label;
	chart_value_fn x, y;
};

static int compare_cost(const void *left, const void *right)
{
	const struct pareto_point *a = left;
	const struct pareto_point *b = right;

	return a->cost < b->cost ? -1 : a->cost > b->cost;
}

/* What nothing beats in this plane, from cheap to dear.  Returns: how many. */
static size_t front_of(const struct chart *chart, const struct plane *plane, double *ret_x,
		       double *ret_y)
{
	struct pareto_point points[CHART_SETTING_COUNT_MAX];
	size_t count = 0;

	for (size_t i = 0; i < chart->setting_count; i++)
		points[i] = (struct pareto_point){ .cost = plane->x(&chart->settings[i]),
						   .error = plane->y(&chart->settings[i]) };
	pareto_mark(points, chart->setting_count);
	qsort(points, chart->setting_count, sizeof(points[0]), compare_cost);
	for (size_t i = 0; i < chart->setting_count; i++) {
		if (!points[i].is_on_front)
			continue;
		ret_x[count] = points[i].cost;
		ret_y[count++] = points[i].error;
	}
	return count;
}

/* Where no error is drawn: a little below the least there is. */
static double zero_of(const struct chart *chart, const struct plane *plane)
{
	double least = 1.0;

	for (size_t i = 0; i < chart->setting_count; i++) {
		double error = plane->y(&chart->settings[i]);

		least = error > 0.0 ? fmin(least, error) : least;
	}
	return ZERO_SHARE * least;
}

/* A curve for each method, from cheap to dear, and behind them what nothing beats. */
static int plane_plot(const struct chart *chart, const struct plane *plane, const char *path,
		      struct why *why)
{
	struct plot_series series[CHART_SETTING_COUNT_MAX + 1];
	double values[2][CHART_SETTING_COUNT_MAX];
	double front[2][CHART_SETTING_COUNT_MAX];
	struct plot plot = { .title = plane->title,
			     .x_label = plane->x_label,
			     .y_label = plane->y_label,
			     .x_is_log = true,
			     .y_is_log = true,
			     .series = series,
			     .y_zero = zero_of(chart, plane) };
	size_t used = 0;

	series[plot.series_count++] =
		(struct plot_series){ "nothing is better", front[0], front[1],
				      front_of(chart, plane, front[0], front[1]), PLOT_FRONT };
	for (size_t i = 0; i < chart->setting_count; i++) {
		const char *method = chart->settings[i].method;
		size_t begin = used;

		/* Settings of a method stand together. */
		if (i > 0 && strcmp(method, chart->settings[i - 1].method) == 0)
			continue;
		for (size_t k = i; k < chart->setting_count; k++) {
			if (strcmp(method, chart->settings[k].method) != 0)
				break;
			values[0][used] = plane->x(&chart->settings[k]);
			values[1][used++] = plane->y(&chart->settings[k]);
		}
		series[plot.series_count++] =
			(struct plot_series){ method, values[0] + begin, values[1] + begin,
					      used - begin, PLOT_BOTH };
	}
	return plot_write(path, &plot, why);
}

static int plots_write(const struct chart *chart, struct page *page, const char *folder,
		       const char *name, struct why *why)
{
	static const struct plane planes[] = {
		{ "ms", "Accuracy against time", "milliseconds a frame (95th percentile)",
		  "wrong pixels, share of the covered ones", cost_ms, error_items },
		{ "triangles", "Accuracy against work", "triangles a frame",
		  "wrong pixels, share of the covered ones", cost_triangles, error_items },
		{ "flip", "Looks against time", "milliseconds a frame (95th percentile)",
		  "mean FLIP", cost_ms, error_flip },
	};

	for (size_t i = 0; i < ARRAY_LENGTH(planes); i++) {
		char path[PATH_MAX];
		int r;

		if (snprintf(path, sizeof(path), "%s/%s_%s.svg", folder, name, planes[i].file) >=
		    (int)sizeof(path))
			return why_set(why, -ENAMETOOLONG, "%s: too long a name", folder);
		r = plane_plot(chart, &planes[i], path, why);
		if (r == -ENOENT) {
			page_paragraph(page, "%s.", why->text);
			log_warning("chart: %s", why->text);
			return 0;
		}
		if (r == 0)
			r = page_svg(page, path, why);
		if (r < 0)
			return r;
	}
	return 0;
}

/* ---- pictures ---- */

static int thumbnail(struct page *page, const struct rgb_image *image, const char *caption)
{
	uint32_t width = image->width < THUMBNAIL_WIDTH ? image->width : THUMBNAIL_WIDTH;
	uint32_t height = (uint32_t)((uint64_t)image->height * width / image->width);
	struct rgb_image small;
	int r = rgb_image_scale(image, width, height > 0 ? height : 1, &small);

	if (r < 0)
		return r;
	r = page_image(page, &small, caption);
	rgb_image_done(&small);
	return r;
}

static int picture_write(const struct chart *chart, const struct chart_setting *setting,
			 size_t view, const char *which, struct page *page, struct why *why)
{
	struct rgb_image picture;
	struct rgb_image errors;
	char caption[160];
	int r = chart_picture(chart, setting, view, &picture, &errors, why);

	if (r < 0)
		return r;
	(void)snprintf(caption, sizeof(caption), "%s frame of %s: view %zu, %.2f %% wrong", which,
		       setting->name, view, 100.0 * setting->views[view].wrong_of_covered);
	r = thumbnail(page, &picture, caption);
	if (r == 0)
		r = thumbnail(page, &chart->colours[view], "as it is");
	if (r == 0)
		r = thumbnail(page, &errors, "FLIP, from black to white");
	rgb_image_done(&picture);
	rgb_image_done(&errors);
	page_paragraph(page, "%s", "");
	return r < 0 ? why_set(why, r, "out of memory") : 0;
}

struct ranked {
	double error;
	size_t view;
};

static int compare_ranked(const void *left, const void *right)
{
	const struct ranked *a = left;
	const struct ranked *b = right;

	if (a->error != b->error)
		return a->error < b->error ? -1 : 1;
	return a->view < b->view ? -1 : a->view > b->view;
}

/* The best, the median and the worst frame of a setting. */
static int pictures_write(const struct chart *chart, const struct chart_setting *setting,
			  struct page *page, struct why *why)
{
	size_t count = chart->scene->camera_count;
	struct ranked *ranked = calloc(count, sizeof(*ranked));
	int r;

	if (!ranked)
		return why_set(why, -ENOMEM, "out of memory");
	for (size_t i = 0; i < count; i++)
		ranked[i] = (struct ranked){ setting->views[i].wrong_of_covered, i };
	qsort(ranked, count, sizeof(*ranked), compare_ranked);
	r = picture_write(chart, setting, ranked[0].view, "Best", page, why);
	if (r == 0)
		r = picture_write(chart, setting, ranked[count / 2].view, "Median", page, why);
	if (r == 0)
		r = picture_write(chart, setting, ranked[count - 1].view, "Worst", page, why);
	free(ranked);
	return r;
}

/* ---- a scene ---- */

static void knee_write(const struct chart *chart, size_t knee, double error_max, struct page *page)
{
	const struct chart_setting *setting;
	char options[256];

	if (knee == chart->setting_count) {
		page_paragraph(page,
			       "No setting has an error of at most %.3g %% of covered pixels.",
			       100.0 * error_max);
		return;
	}
	setting = &chart->settings[knee];
	page_paragraph(
		page,
		"The knee: with at most %.3g %% of covered pixels wrong on the average, %s is "
		"the cheapest (%.1f ms; oocview %s). It leaves out %.0f %% of the triangles of "
		"the full mode; %.3f %% of covered pixels are wrong, %.3f %% in the worst view.",
		100.0 * error_max, setting->name, setting->ms.median,
		chart_options_text(setting, options, sizeof(options)),
		100.0 * (1.0 - setting->triangles / fmax(chart->full_triangles, 1.0)),
		100.0 * setting->wrong_of_covered_mean, 100.0 * setting->wrong_of_covered_worst);
}

int chart_report(const struct chart *chart, struct page *page, const char *folder, const char *name,
		 double error_max, struct why *why)
{
	struct pareto_point points[CHART_SETTING_COUNT_MAX];
	size_t knee = chart_knee(chart, error_max);
	int r;

	points_of(chart, points);
	page_heading(page, chart->scene->title);
	page_paragraph(
		page,
		"%zu views of %u x %u in pieces of %zu frames; %.0f triangles a frame in the "
		"full mode, which the others are compared with. Times are of the piece with most "
		"to draw: medians of %u repeats, taken in turn with a control that always draws "
		"the same, or of fewer (in the table, how many) where another setting was quicker "
		"every time and no more wrong. Bold: nothing is both "
		"quicker and less wrong. The front rules out %.3f of the plane up to the full "
		"mode's time and an error of everything.",
		chart->scene->camera_count, chart->options->width, chart->options->height,
		chart->scene->burst, chart->full_triangles, chart->options->repeat_count,
		pareto_hypervolume(points, chart->setting_count, chart->settings[0].ms.median,
				   1.0));
	knee_write(chart, knee, error_max, page);
	r = plots_write(chart, page, folder, name, why);
	if (r < 0)
		return r;
	table_write(chart, points, page);
	r = csv_write(chart, points, folder, name, why);
	if (r == 0 && knee < chart->setting_count)
		r = pictures_write(chart, &chart->settings[knee], page, why);
	return r;
}
