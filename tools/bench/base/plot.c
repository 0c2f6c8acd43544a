/* SPDX-License-Identifier: MIT */
#include "tools/bench/base/plot.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/wait.h>

#include "formats/base/bytes.h"
#include "tools/bench/base/measure.h"

/*
 * Told apart by who sees red and green alike.
 * Source: Okabe & Ito, "Color Universal Design", 2008; their yellow, too pale for lines, left out.
 */
static const char *const colours[] = { "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00",
				       "#56b4e9", "#000000", "#8c564b", "#7f7f7f", "#a0a000" };

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

	fprintf(out, "set terminal %s size 860,560 font 'sans,13' background 'white'\n",
		is_png ? "pngcairo" : "svg");
	for (size_t i = 0; i < ARRAY_LENGTH(colours); i++)
		fprintf(out, "set linetype %zu linecolor rgb '%s'\n", i + 1, colours[i]);
	write_setting(out, "output", path);
	write_setting(out, "title", plot->title);
	write_setting(out, "xlabel", plot->x_label);
	write_setting(out, "ylabel", plot->y_label);
	fputs("set termoption noenhanced\nset grid linecolor rgb '#e0e0e0'\nset border 3\n"
	      "set tics nomirror\nset key outside below\n",
	      out);
	if (plot->x_is_log)
		fputs("set logscale x\n", out);
	if (plot->y_is_log)
		fputs("set logscale y\n", out);
	if (plot->y_is_log && plot->y_zero > 0.0)
		fprintf(out, "set ytics add ('0' %g)\nset yrange [%g:*]\n", plot->y_zero,
			0.7 * plot->y_zero);
	if (!plot->y_is_log)
		fputs("set yrange [0:*]\n", out);
}

static void write_series(FILE *out, const struct plot *plot, size_t index)
{
	static const char *const styles[] = {
		[PLOT_LINES] = "lines",
		[PLOT_POINTS] = "points pointtype 7 pointsize 0.6",
		[PLOT_BOTH] = "linespoints linewidth 1.5 pointtype 7 pointsize 0.6",
		[PLOT_STEPS] = "steps",
		[PLOT_FRONT] = "steps linewidth 7",
	};
	const struct plot_series *series = &plot->series[index];

	fprintf(out, "%s$data%zu using 1:2 with %s ", index == 0 ? "plot " : ", ", index,
		styles[series->style]);
	if (series->style == PLOT_FRONT)
		fputs("linecolor rgb '#d0d0d0' title ", out);
	else
		fprintf(out, "linecolor %zu title ", index + 1);
	write_text(out, series->title ? series->title : "");
}

/* Where a value is drawn along the second axis. */
static double height_of(const struct plot *plot, double y)
{
	return y == 0.0 && plot->y_is_log ? plot->y_zero : y;
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
			double y = height_of(plot, series->y[k]);

			if (!is_shown(plot, x, y))
				continue;
			fprintf(out, "%.9g %.9g\n", x, y);
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
