/* SPDX-License-Identifier: MIT */
#include "tools/bench/base/figures.h"

#include <math.h>
#include <stdlib.h>

static int double_compare(const void *a, const void *b)
{
	double x = *(const double *)a;
	double y = *(const double *)b;

	return x < y ? -1 : x > y;
}

static double middle_of(const double *sorted, size_t count)
{
	return 0.5 * (sorted[(count - 1) / 2] + sorted[count / 2]);
}

struct spread spread_of(double *values, size_t count)
{
	qsort(values, count, sizeof(*values), double_compare);
	return (struct spread){
		.low = values[0],
		.median = middle_of(values, count),
		.high = values[count - 1],
	};
}

double percentile_of(double *values, size_t count, double share)
{
	/* Rounding must not take 0.99 of 100 for the hundredth. */
	double rank = ceil(share * (double)count - 1e-9);

	qsort(values, count, sizeof(*values), double_compare);
	return values[rank < 1.0 ? 0 : (size_t)rank - 1];
}

struct distribution distribution_of(double *values, size_t count)
{
	struct distribution ret = { 0 };

	if (count == 0)
		return ret;
	qsort(values, count, sizeof(*values), double_compare);
	for (size_t i = 0; i < count; i++)
		ret.mean += values[i] / (double)count;
	ret.median = middle_of(values, count);
	ret.p99 = percentile_of(values, count, 0.99);
	ret.highest = values[count - 1];
	return ret;
}

double share_above(const double *values, size_t count, double bound)
{
	size_t above = 0;

	for (size_t i = 0; i < count; i++)
		above += values[i] > bound;
	return count > 0 ? (double)above / (double)count : 0.0;
}
