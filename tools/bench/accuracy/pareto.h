/* SPDX-License-Identifier: MIT */
/**
 * pareto.h - which ways of working nobody needs, because another is as right and no dearer.
 *
 * Threads: any; pure functions.
 */
#ifndef TOOLS_BENCH_ACCURACY_PARETO_H
#define TOOLS_BENCH_ACCURACY_PARETO_H

#include <stdbool.h>
#include <stddef.h>

/** A way of working: what it costs, and how wrong it is.  Both >= 0, less is better. */
struct pareto_point {
	double cost;
	double error;
	bool is_on_front; /* no other costs no more and is no more wrong, and less in one of the two */
};

/** Sets is_on_front of each. */
void pareto_mark(struct pareto_point *points, size_t count);

/**
 * The knee: the cheapest point whose error is at most error_max; of equally cheap ones the least
 * wrong.
 *
 * Returns: its index, or count where none is so right.
 */
size_t pareto_knee(const struct pareto_point *points, size_t count, double error_max);

/**
 * Area that the front rules out, of the rectangle from nothing to a reference point: 0 when nothing
 * is better than the reference in both, 1 when something is free and right.
 */
double pareto_hypervolume(const struct pareto_point *points, size_t count, double cost_reference,
			  double error_reference);

#endif /* TOOLS_BENCH_ACCURACY_PARETO_H */
