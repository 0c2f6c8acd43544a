/* SPDX-License-Identifier: MIT */
/**
 * figures.h - what many measurements say together.  Pure.
 */
#ifndef TOOLS_BENCH_BASE_FIGURES_H
#define TOOLS_BENCH_BASE_FIGURES_H

#include <stddef.h>

/** Of a few repeats. */
struct spread {
	double low, median, high;
};

/** Of many: the middle, the slow ones, the slowest. */
struct distribution {
	double mean, median, p99, highest;
};

/** Sorts the values. count > 0. */
struct spread spread_of(double *values, size_t count);

/** Sorts the values.  Of none everything is 0. */
struct distribution distribution_of(double *values, size_t count);

/** The least value that at least this share, (0, 1], of all does not exceed.  Sorts.  count > 0. */
double percentile_of(double *values, size_t count, double share);

/** Share of the values that are greater than a bound, in [0, 1]; of none 0. */
double share_above(const double *values, size_t count, double bound);

#endif /* TOOLS_BENCH_BASE_FIGURES_H */
