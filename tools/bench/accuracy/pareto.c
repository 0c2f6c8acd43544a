/* SPDX-License-Identifier: MIT */
#include "tools/bench/accuracy/pareto.h"

#include <math.h>

static bool dominates(const struct pareto_point *a, const struct pareto_point *b)
{
	return a->cost <= b->cost && a->error <= b->error &&
	       (a->cost < b->cost || a->error < b->error);
}

void pareto_mark(struct pareto_point *points, size_t count)
{
	for (size_t i = 0; i < count; i++) {
		points[i].is_on_front = true;
		for (size_t k = 0; k < count && points[i].is_on_front; k++)
			points[i].is_on_front = !dominates(&points[k], &points[i]);
	}
}

size_t pareto_knee(const struct pareto_point *points, size_t count, double error_max)
{
	size_t knee = count;

	for (size_t i = 0; i < count; i++) {
		if (!(points[i].error <= error_max))
			continue;
		if (knee == count || points[i].cost < points[knee].cost ||
		    (points[i].cost == points[knee].cost && points[i].error < points[knee].error))
			knee = i;
	}
	return knee;
}

/* The least cost above `cost` at which the error gets less, and that error. */
static bool next_step(const struct pareto_point *points, size_t count, double cost,
		      double *ret_cost, double *ret_error)
{
	bool found = false;

	for (size_t i = 0; i < count; i++) {
		if (!(points[i].cost > cost) || (found && points[i].cost > *ret_cost))
			continue;
		*ret_error = found && points[i].cost == *ret_cost
				     ? fmin(*ret_error, points[i].error)
				     : points[i].error;
		*ret_cost = points[i].cost;
		found = true;
	}
	return found;
}

double pareto_hypervolume(const struct pareto_point *points, size_t count, double cost_reference,
			  double error_reference)
{
	double volume = 0.0;
	double least_error = error_reference;
	double cost = -INFINITY;
	double error = 0.0;

	if (!(cost_reference > 0.0) || !(error_reference > 0.0))
		return 0.0;
	/* From the cheapest on: each point adds the strip between its error and the least so far. */
	while (next_step(points, count, cost, &cost, &error) && cost < cost_reference) {
		if (error >= least_error)
			continue;
		volume += (cost_reference - cost) * (least_error - error);
		least_error = error;
	}
	return volume / (cost_reference * error_reference);
}
