/* SPDX-License-Identifier: MIT */
#include "tools/build/overlap.h"

#include <math.h>

void overlap_cell_box(const struct grid *grid, uint32_t level, const uint32_t cell[3],
		      double ret_min[3], double *ret_size)
{
	if (grid->form == GRID_LATTICE) {
		double half = ldexp(1.0, (int)grid->root_bits - 1);

		*ret_size = ldexp(1.0, (int)grid->root_bits - (int)level);
		for (unsigned i = 0; i < 3; i++)
			ret_min[i] = (double)cell[i] * *ret_size - half;
	} else {
		*ret_size = ldexp(grid->root_size, -(int)level);
		for (unsigned i = 0; i < 3; i++)
			ret_min[i] = grid->root_min[i] + (double)cell[i] * *ret_size;
	}
}

/* The nine axes that are cross products of the triangle's edges and the box's. */
static bool edges_separate(const double v[3][3], const double edges[3][3], double half)
{
	for (unsigned e = 0; e < 3; e++) {
		for (unsigned axis = 0; axis < 3; axis++) {
			unsigned j = (axis + 1) % 3;
			unsigned k = (axis + 2) % 3;
			double low = INFINITY;
			double high = -INFINITY;
			double reach = half * (fabs(edges[e][j]) + fabs(edges[e][k]));

			for (unsigned i = 0; i < 3; i++) {
				double at = edges[e][j] * v[i][k] - edges[e][k] * v[i][j];

				low = fmin(low, at);
				high = fmax(high, at);
			}
			if (low > reach || high < -reach)
				return true;
		}
	}
	return false;
}

/* The triangle's plane.  On the lattice its terms have up to 80 bits. */
static bool plane_separates(const struct grid *grid, const double v[3][3], const double edges[3][3],
			    double half)
{
	double normal[3];
	double at = 0;
	double reach = 0;

	for (unsigned i = 0; i < 3; i++) {
		unsigned j = (i + 1) % 3;
		unsigned k = (i + 2) % 3;

		normal[i] = edges[0][j] * edges[1][k] - edges[0][k] * edges[1][j];
		at += normal[i] * v[0][i];
		reach += half * fabs(normal[i]);
	}
	if (grid->form != GRID_LATTICE)
		return fabs(at) > reach * (1 + 0x1p-40);
	if (fabs(at) > reach * (1 + 0x1p-40) || fabs(at) < reach * (1 - 0x1p-40))
		return fabs(at) > reach;
	/* Too near for 53 bits.  Doubled, for the middle of a cell may lie between lattice points. */
	__int128 exact_at = 0;
	__int128 exact_reach = 0;

	for (unsigned i = 0; i < 3; i++) {
		exact_at += (__int128)(int64_t)normal[i] * (int64_t)(2 * v[0][i]);
		exact_reach += (__int128)(int64_t)fabs(normal[i]) * (int64_t)(2 * half);
	}
	return exact_at > exact_reach || -exact_at > exact_reach;
}

bool overlap_touches(const struct grid *grid, const double corners[9], const double cell_min[3],
		     double cell_size)
{
	/* Off the lattice a touch may be lost to rounding: a little too large loses none. */
	double half = cell_size / 2 * (grid->form == GRID_LATTICE ? 1 : 1 + 0x1p-30);
	double v[3][3];
	double edges[3][3];

	for (unsigned axis = 0; axis < 3; axis++) {
		double middle = cell_min[axis] + cell_size / 2;

		for (unsigned i = 0; i < 3; i++)
			v[i][axis] = corners[3 * i + axis] - middle;
		if (fmin(fmin(v[0][axis], v[1][axis]), v[2][axis]) > half ||
		    fmax(fmax(v[0][axis], v[1][axis]), v[2][axis]) < -half)
			return false;
		for (unsigned i = 0; i < 3; i++)
			edges[i][axis] = corners[3 * ((i + 1) % 3) + axis] - corners[3 * i + axis];
	}
	return !edges_separate(v, edges, half) && !plane_separates(grid, v, edges, half);
}
