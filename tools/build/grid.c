/* SPDX-License-Identifier: MIT */
#include "tools/build/grid.h"

#include <errno.h>
#include <math.h>

/** Distance between a point and its nearest lattice point, in steps: half the cube's diagonal. */
#define HALF_DIAGONAL 0.86602540378443865
/** A root cell need not be smaller. */
#define ROOT_BITS_MIN 4u

/* Largest power of two whose half diagonal is within the error. */
static int step_exponent_of(double error)
{
	int exponent;

	(void)frexp(error / HALF_DIAGONAL, &exponent);
	return exponent - 1;
}

static int choose_lattice(struct grid *grid, const double box_min[3], const double box_max[3],
			  struct why *why)
{
	double reach = 0;

	grid->form = GRID_LATTICE;
	grid->step_exponent = step_exponent_of(grid->error);
	grid->step = ldexp(1.0, grid->step_exponent);
	grid->step_inverse = ldexp(1.0, -grid->step_exponent);
	for (unsigned i = 0; i < 3; i++) {
		double middle = box_min[i] + (box_max[i] - box_min[i]) / 2;

		grid->origin[i] = rint(middle * grid->step_inverse) * grid->step;
		reach = fmax(reach, ceil((box_max[i] - grid->origin[i]) * grid->step_inverse));
		reach = fmax(reach, ceil((grid->origin[i] - box_min[i]) * grid->step_inverse));
	}
	for (grid->root_bits = ROOT_BITS_MIN;
	     ldexp(1.0, (int)grid->root_bits - 1) < reach + 2 && grid->root_bits <= GRID_BITS_MAX;)
		grid->root_bits++;
	if (grid->root_bits > GRID_BITS_MAX ||
	    fabs(grid->origin[0]) * grid->step_inverse > 0x1p52 ||
	    fabs(grid->origin[1]) * grid->step_inverse > 0x1p52 ||
	    fabs(grid->origin[2]) * grid->step_inverse > 0x1p52)
		return why_set(
			why, -EINVAL,
			"--error %g is too small for a model that reaches %g from its middle: "
			"use --error %.2g or more, or 0 for exact positions",
			grid->error, reach * grid->step,
			reach * grid->step / ldexp(1.0, GRID_BITS_MAX - 2));
	grid->root_size = ldexp(grid->step, (int)grid->root_bits);
	for (unsigned i = 0; i < 3; i++)
		grid->root_min[i] = -grid->root_size / 2;
	grid->cell_inverse = ldexp(1.0, (int)STORE_LEVEL_MAX - (int)grid->root_bits);
	grid->level_max = grid->root_bits < GRID_LEVEL_MAX ? grid->root_bits : GRID_LEVEL_MAX;
	return 0;
}

/* The least cube that holds the box and whose corner is a multiple of an eighth of its edge. */
static void choose_exact(struct grid *grid, const double box_min[3], const double box_max[3],
			 bool doubles)
{
	double extent = 0;
	int exponent;
	bool holds = false;

	grid->form = doubles ? GRID_DOUBLE : GRID_FLOAT;
	grid->step_exponent = STORE_STEP_NONE;
	grid->level_max = GRID_LEVEL_MAX;
	for (unsigned i = 0; i < 3; i++)
		extent = fmax(extent, box_max[i] - box_min[i]);
	(void)frexp(fmax(extent, 0x1p-100), &exponent);
	for (; !holds; exponent++) {
		double eighth = ldexp(1.0, exponent - 3);

		holds = true;
		for (unsigned i = 0; i < 3; i++) {
			grid->root_min[i] = floor(box_min[i] / eighth) * eighth;
			holds = holds && box_max[i] < grid->root_min[i] + eighth * 8;
		}
		grid->root_size = eighth * 8;
	}
	grid->cell_inverse = ldexp(1.0, (int)STORE_LEVEL_MAX) / grid->root_size;
}

int grid_choose(struct grid *grid, const double box_min[3], const double box_max[3], double error,
		bool doubles, struct why *why)
{
	static const double nothing[3] = { 0, 0, 0 };
	double diagonal;

	*grid = (struct grid){ .error = error };
	if (!(box_min[0] <= box_max[0])) {
		box_min = nothing;
		box_max = nothing;
	}
	diagonal = sqrt((box_max[0] - box_min[0]) * (box_max[0] - box_min[0]) +
			(box_max[1] - box_min[1]) * (box_max[1] - box_min[1]) +
			(box_max[2] - box_min[2]) * (box_max[2] - box_min[2]));
	if (!isfinite(diagonal))
		return why_set(why, -EINVAL, "positions up to %g are too far apart to be one model",
			       fmax(fabs(box_min[0]), fabs(box_max[0])));
	if (error == 0) {
		choose_exact(grid, box_min, box_max, doubles);
		return 0;
	}
	if (error < 0)
		grid->error = diagonal > 0 ? diagonal / GRID_ERROR_DIVISOR : 1.0;
	return choose_lattice(grid, box_min, box_max, why);
}

uint64_t grid_morton(const uint32_t cell[3])
{
	uint64_t code = 0;

	for (unsigned i = 0; i < 3; i++) {
		uint64_t bits = cell[i];

		/* 21 bits, each moved to every third place. */
		bits = (bits | bits << 32) & UINT64_C(0x001f00000000ffff);
		bits = (bits | bits << 16) & UINT64_C(0x001f0000ff0000ff);
		bits = (bits | bits << 8) & UINT64_C(0x100f00f00f00f00f);
		bits = (bits | bits << 4) & UINT64_C(0x10c30c30c30c30c3);
		bits = (bits | bits << 2) & UINT64_C(0x1249249249249249);
		code |= bits << i;
	}
	return code;
}

/*
 * The cross product of two edges, of which only "is it zero" is asked.  Lattice differences have 25
 * bits, so that their products are exact in a double.  Of floats, the differences may need more;
 * what comes out near zero is computed again with 113 bits, which hold any product of differences of
 * floats that are less than 2^30 apart in size.
 */
bool grid_is_degenerate(const struct grid *grid, const double corners[9])
{
	double a[3];
	double b[3];
	double size = 0;
	double area = 0;

	for (unsigned i = 0; i < 3; i++) {
		a[i] = corners[3 + i] - corners[i];
		b[i] = corners[6 + i] - corners[i];
	}
	for (unsigned i = 0; i < 3; i++) {
		unsigned j = (i + 1) % 3;

		size += fabs(a[i] * b[j]) + fabs(a[j] * b[i]);
		area += fabs(a[i] * b[j] - a[j] * b[i]);
	}
	if (grid->form == GRID_LATTICE)
		return area == 0;
	if (area > size * 0x1p-48)
		return false;
	for (unsigned i = 0; i < 3; i++) {
		unsigned j = (i + 1) % 3;
		__float128 ai = (__float128)corners[3 + i] - corners[i];
		__float128 aj = (__float128)corners[3 + j] - corners[j];
		__float128 bi = (__float128)corners[6 + i] - corners[i];
		__float128 bj = (__float128)corners[6 + j] - corners[j];

		if (ai * bj != aj * bi)
			return false;
	}
	return true;
}
