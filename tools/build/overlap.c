/* SPDX-License-Identifier: MIT */
#include "tools/build/overlap.h"

#include <math.h>

/* Not fmin() and fmax(): those are calls, for the sake of what is no number. */
static double least(const double v[3])
{
	double low = v[0] < v[1] ? v[0] : v[1];

	return low < v[2] ? low : v[2];
}

static double most(const double v[3])
{
	double high = v[0] > v[1] ? v[0] : v[1];

	return high > v[2] ? high : v[2];
}

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
			double at[3];
			double reach = half * (fabs(edges[e][j]) + fabs(edges[e][k]));

			for (unsigned i = 0; i < 3; i++)
				at[i] = edges[e][j] * v[i][k] - edges[e][k] * v[i][j];
			if (least(at) > reach || most(at) < -reach)
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

/* What rounding may take away: off the lattice a cell is taken as larger by it, so no touch is lost. */
static double margin_of(const struct grid *grid, const double corners[9], double cell_size)
{
	double largest = cell_size;

	if (grid->form == GRID_LATTICE)
		return 0;
	for (unsigned i = 0; i < 9; i++)
		largest = fabs(corners[i]) > largest ? fabs(corners[i]) : largest;
	return largest * 0x1p-48;
}

bool overlap_touches(const struct grid *grid, const double corners[9], const double cell_min[3],
		     double cell_size)
{
	double half = cell_size / 2 + margin_of(grid, corners, cell_size);
	double v[3][3];
	double edges[3][3];

	for (unsigned axis = 0; axis < 3; axis++) {
		double middle = cell_min[axis] + cell_size / 2;

		double at[3];

		for (unsigned i = 0; i < 3; i++) {
			at[i] = corners[3 * i + axis] - middle;
			v[i][axis] = at[i];
		}
		if (least(at) > half || most(at) < -half)
			return false;
		for (unsigned i = 0; i < 3; i++)
			edges[i][axis] = corners[3 * ((i + 1) % 3) + axis] - corners[3 * i + axis];
	}
	return !edges_separate(v, edges, half) && !plane_separates(grid, v, edges, half);
}

uint32_t overlap_octants(const struct grid *grid, const double corners[9], uint32_t level,
			 const uint32_t cell[3])
{
	static const uint32_t low_sides[3] = { 0x55, 0x33, 0x0f };
	uint32_t octants = 0xff;
	double cell_min[3];
	double size;
	double margin;

	overlap_cell_box(grid, level, cell, cell_min, &size);
	margin = margin_of(grid, corners, size);
	for (unsigned axis = 0; axis < 3; axis++) {
		const double at[3] = { corners[axis], corners[3 + axis], corners[6 + axis] };
		double middle = cell_min[axis] + size / 2;

		if (least(at) > middle + margin)
			octants &= ~low_sides[axis];
		if (most(at) < middle - margin)
			octants &= low_sides[axis];
	}
	if ((octants & (octants - 1)) == 0)
		return octants;
	for (uint32_t octant = 0; octant < 8; octant++) {
		double child_min[3];

		if (!(octants >> octant & 1))
			continue;
		for (unsigned axis = 0; axis < 3; axis++)
			child_min[axis] = cell_min[axis] + (octant >> axis & 1) * (size / 2);
		if (!overlap_touches(grid, corners, child_min, size / 2))
			octants &= ~(UINT32_C(1) << octant);
	}
	return octants;
}
