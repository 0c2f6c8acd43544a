/* SPDX-License-Identifier: MIT */
/**
 * overlap.h - does a triangle touch a cell?
 *
 * Threads: any; pure functions.
 * Source: Akenine-Moeller 2001, "Fast 3D Triangle-Box Overlap Testing"; exact on the lattice.
 */
#ifndef TOOLS_BUILD_OVERLAP_H
#define TOOLS_BUILD_OVERLAP_H

#include <stdbool.h>
#include <stdint.h>

#include "tools/build/grid.h"

/** Least corner and edge of a cell, in grid_load()'s unit. */
void overlap_cell_box(const struct grid *grid, uint32_t level, const uint32_t cell[3],
		      double ret_min[3], double *ret_size);

/** Do they have a point in common?  The cell is closed: what lies in its walls touches it. */
bool overlap_touches(const struct grid *grid, const double corners[9], const double cell_min[3],
		     double cell_size);

/**
 * Which of a cell's eight children does a triangle touch that touches the cell?
 *
 * Returns: bit i for octant i (bit 0 of i is x, 1 y, 2 z).  Most triangles are in one child, and cost
 * nothing but that finding.
 */
uint32_t overlap_octants(const struct grid *grid, const double corners[9], uint32_t level,
			 const uint32_t cell[3]);

#endif /* TOOLS_BUILD_OVERLAP_H */
