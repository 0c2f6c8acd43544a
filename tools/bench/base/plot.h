/* SPDX-License-Identifier: MIT */
/**
 * plot.h - curves as SVG or PNG, drawn by gnuplot.
 *
 * Threads: the main thread.
 */
#ifndef TOOLS_BENCH_BASE_PLOT_H
#define TOOLS_BENCH_BASE_PLOT_H

#include <stdbool.h>
#include <stddef.h>

#include "formats/base/why.h"

enum plot_style {
	PLOT_LINES,
	PLOT_POINTS,
	PLOT_BOTH,
	PLOT_STEPS,
	PLOT_FRONT, /* a broad grey line in steps, for what the others are seen against */
};

/** One curve: count points, in order. */
struct plot_series {
	const char *title;
	const double *x; /* NULL: 0, 1, 2, ... */
	const double *y;
	size_t count;
	enum plot_style style;
};

struct plot {
	const char *title;
	const char *x_label;
	const char *y_label;
	bool x_is_log; /* what is not positive is left out there */
	bool y_is_log;
	const struct plot_series *series;
	size_t series_count;
	double y_zero; /* on a logarithmic axis 0 is drawn at this height, and called so; 0: left out */
};

/**
 * Draws a plot; the end of the name, ".svg" or ".png", says as what.
 *
 * Returns: 0, -ENOENT (gnuplot is not installed: say so and go on), -EIO, -ENOMEM or -errno.
 */
int plot_write(const char *path, const struct plot *plot, struct why *why);

#endif /* TOOLS_BENCH_BASE_PLOT_H */
