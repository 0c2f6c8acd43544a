/* SPDX-License-Identifier: MIT */
#include "tools/bench/base/plot.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/wait.h>

#include "tools/bench/base/measure.h"

/* A text in gnuplot's single quotes, where a quote is written twice. */
static void write_text(FILE *out, const char *text)
{
	fputc('\'', out);
	for (; *text; text++) {
		if (*text == '\'')
			fputc('\'', out);
		if (*text >= ' ' || *text < 0)
			fputc(*text, out);
	}
	fputc('\'', out);
}

static void write_setting(FILE *out, const char *setting, const char *text)
{
	fprintf(out, "set %s ", setting);
	write_text(out, text ? text : "");
	fputc('\n', out);
}

static void write_head(FILE *out, const char *path, const struct plot *plot)
{
	const char *end = strrchr(path, '.');
	bool is_png = end && strcmp(end, ".png") == 0;

	fprintf(out, "set terminal %s size 800,500 background 'white'\n",
		is_png ? "pngcairo" : "svg");
	write_setting(out, "output", path);
	write_setting(out, "title", plot->title);
	write_setting(out, "xlabel", plot->x_label);
	write_setting(out, "ylabel", plot->y_label);
	fputs("set termoption noenhanced\nset grid\nset key outside below\n", out);
	if (plot->x_is_log)
		fputs("set logscale x\n", out);
	if (plot->y_is_log)
		fputs("set logscale y\n", out);
	if (!plot->y_is_log)
		fputs("set yrange [0:*]\n", out);
}

static void write_series(FILE *out, const struct plot *plot, size_t index)
{
	static const char *const styles[] = {
		[PLOT_LINES] = "lines",
		[PLOT_POINTS] = "points pointtype 7 pointsize 0.5",
		[PLOT_BOTH] = "linespoints pointtype 7 pointsize 0.5",
		[PLOT_STEPS] = "steps",
	};
	const struct plot_series *series = &plot->series[index];

	fprintf(out, "%s$data%zu using 1:2 with %s linecolor %zu title ",
		index == 0 ? "plot " : ", ", index, styles[series->style], index + 1);
	write_text(out, series->title ? series->title : "");
}

static bool is_shown(const struct plot *plot, double x, double y)
{
	return isfinite(x) && isfinite(y) && (!plot->x_is_log || x > 0.0) &&
	       (!plot->y_is_log || y > 0.0);
}

/* Returns: how many points there are to show. */
static size_t write_data(FILE *out, const struct plot *plot)
{
	size_t shown_count = 0;

	for (size_t i = 0; i < plot->series_count; i++) {
		const struct plot_series *series = &plot->series[i];

		fprintf(out, "$data%zu << END\n", i);
		for (size_t k = 0; k < series->count; k++) {
			double x = series->x ? series->x[k] : (double)k;

			if (!is_shown(plot, x, series->y[k]))
				continue;
			fprintf(out, "%.9g %.9g\n", x, series->y[k]);
			shown_count++;
		}
		fputs("END\n", out);
	}
	return shown_count;
}

int plot_write(const char *path, const struct plot *plot, struct why *why)
{
	FILE *out;
	int status;

	if (!measure_has_program("gnuplot"))
		return why_set(why, -ENOENT, "gnuplot is not installed: there are no pictures");
	out = popen("gnuplot", "we");
	if (!out)
		return why_errno(why, -errno, "gnuplot");
	write_head(out, path, plot);
	if (write_data(out, plot) > 0) {
		for (size_t i = 0; i < plot->series_count; i++)
			write_series(out, plot, i);
	} else {
		/* Without a point gnuplot has no range, and draws nothing at all. */
		fputs("set xrange [0:1]\nset yrange [0:1]\nplot 2 notitle", out);
	}
	fputc('\n', out);
	status = pclose(out);
	if (status < 0)
		return why_errno(why, -errno, "gnuplot");
	if (!WIFEXITED(status) || WEXITSTATUS(status) != 0)
		return why_set(why, -EIO, "%s: gnuplot cannot draw it", path);
	return 0;
}
