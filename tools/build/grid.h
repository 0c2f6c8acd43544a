/* SPDX-License-Identifier: MIT */
/**
 * grid.h - where positions may be, and which cell of the octree a point is in.
 *
 * A store has one of three forms of position, and a build works in it throughout:
 *
 *	LATTICE  three int32_t: multiples of the step from the origin, both powers-of-two things, so
 *	         that all that is decided from them (cells, equality, zero area) is exact
 *	FLOAT    three floats as the file has them, for --error 0: bit for bit
 *	DOUBLE   three doubles, for --error 0 where a file has doubles or a placement made them
 *
 * The cube of the root has an edge of a power of two.  Cells are named at STORE_LEVEL_MAX: three
 * coordinates of STORE_LEVEL_MAX bits, of which a cell of a lesser level has the upper ones.
 *
 * Threads: any; a grid does not change once it is chosen.
 */
#ifndef TOOLS_BUILD_GRID_H
#define TOOLS_BUILD_GRID_H

#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "formats/base/why.h"
#include "formats/store/layout.h"

enum grid_form {
	GRID_LATTICE,
	GRID_FLOAT,
	GRID_DOUBLE,
};

/** Default of --error: the box's diagonal by this much (README.md, "The step"). */
#define GRID_ERROR_DIVISOR 524288.0
/**
 * Lattice coordinates are at most this far from the origin: any difference of two of them, and any
 * node's positions from the node's middle, is then exact in a float's or a double's 24 and 53 bits.
 */
#define GRID_BITS_MAX 24u
/**
 * Cells are cut down to this level.  The levels below it name the pieces of a cell that has too many
 * triangles even there (octree.h): 8^5 of them.
 */
#define GRID_PIECE_LEVELS 5u
#define GRID_LEVEL_MAX    (STORE_LEVEL_MAX - GRID_PIECE_LEVELS)

struct grid {
	enum grid_form form;
	double error;          /* as asked for, or chosen */
	int32_t step_exponent; /* STORE_STEP_NONE where there is no lattice */
	double step;
	double step_inverse;
	double origin[3];    /* of the store, model units */
	double root_min[3];  /* from the origin, model units */
	double root_size;    /* model units */
	double cell_inverse; /* cells of STORE_LEVEL_MAX a model unit */
	uint32_t root_bits;  /* LATTICE: the root's edge is 2^root_bits steps */
	uint32_t level_max;  /* cells are not cut below it */
};

/** Words of 32 bits that a position takes: 3, or 6 for doubles. */
static inline uint32_t grid_position_words(const struct grid *grid)
{
	return grid->form == GRID_DOUBLE ? 6 : 3;
}

/**
 * Chooses the grid for a model's box.
 *
 * box:     least and largest corner of all finite positions; inside out when there is none
 * error:   model units; 0: exact; negative: the default
 * doubles: do some positions come as doubles, or placed?
 *
 * Returns: 0, or -EINVAL when the error is too small for the size of the model.
 */
int grid_choose(struct grid *grid, const double box_min[3], const double box_max[3], double error,
		bool doubles, struct why *why);

/** Nearest whole number of a double below 2^31, ties to even. */
static inline int32_t grid_round(double value)
{
	/* Adding 1.5 * 2^52 leaves the integer in the low bits: one addition, and it vectorises. */
	double shifted = value + 6755399441055744.0;
	int64_t bits;

	memcpy(&bits, &shifted, sizeof(bits));
	return (int32_t)bits;
}

/** A position of any form as doubles: steps (LATTICE) or model units (else) from the origin. */
static inline void grid_load(const struct grid *grid, const uint32_t *position, double ret[3])
{
	if (grid->form == GRID_LATTICE) {
		for (unsigned i = 0; i < 3; i++)
			ret[i] = (double)(int32_t)position[i];
	} else if (grid->form == GRID_FLOAT) {
		float values[3];

		memcpy(values, position, sizeof(values));
		for (unsigned i = 0; i < 3; i++)
			ret[i] = (double)values[i];
	} else {
		memcpy(ret, position, 3 * sizeof(double));
	}
}

static inline uint32_t grid_clamp_cell(double cell)
{
	const double last = (double)((UINT32_C(1) << STORE_LEVEL_MAX) - 1);

	return (uint32_t)(cell < 0 ? 0 : cell > last ? last : cell);
}

/** The cell of a point that is given as grid_load() gives it. */
static inline void grid_cell(const struct grid *grid, const double point[3], uint32_t ret[3])
{
	for (unsigned i = 0; i < 3; i++) {
		if (grid->form == GRID_LATTICE) {
			/* Exact: the root's corner is a whole number of steps, the factor a power of two. */
			double steps = point[i] + (double)(INT32_C(1) << (grid->root_bits - 1));

			ret[i] = grid_clamp_cell(steps * grid->cell_inverse);
		} else {
			ret[i] = grid_clamp_cell((point[i] - grid->root_min[i]) *
						 grid->cell_inverse);
		}
	}
}

/** The cell of a triangle's centre; corners as grid_load() gives them. */
static inline void grid_centre_cell(const struct grid *grid, const double corners[9],
				    uint32_t ret[3])
{
	double centre[3];

	if (grid->form == GRID_LATTICE) {
		/* In whole steps from the root's corner; a cell that can be cut is no smaller. */
		for (unsigned i = 0; i < 3; i++) {
			uint32_t sum =
				(uint32_t)(int32_t)(corners[i] + corners[3 + i] + corners[6 + i]) +
				(UINT32_C(3) << (grid->root_bits - 1));

			ret[i] = grid->root_bits > STORE_LEVEL_MAX
					 ? sum / 3 >> (grid->root_bits - STORE_LEVEL_MAX)
					 : sum / 3 << (STORE_LEVEL_MAX - grid->root_bits);
		}
		return;
	}
	for (unsigned i = 0; i < 3; i++)
		centre[i] = (corners[i] + corners[3 + i] + corners[6 + i]) / 3.0;
	grid_cell(grid, centre, ret);
}

/** Morton code of a cell of STORE_LEVEL_MAX. */
uint64_t grid_morton(const uint32_t cell[3]);

/** Has a triangle no area?  Exact on the lattice and for floats; corners as grid_load() gives them. */
bool grid_is_degenerate(const struct grid *grid, const double corners[9]);

/** A distance in grid_load()'s unit as model units. */
static inline double grid_to_model(const struct grid *grid, double value)
{
	return grid->form == GRID_LATTICE ? value * grid->step : value;
}

#endif /* TOOLS_BUILD_GRID_H */
