/* SPDX-License-Identifier: MIT */
/**
 * occupancy.h - where in a store, or in a part of it, there is something: a grid of voxels.
 *
 * Axis 2 of the grid points up, whatever the store's up axis is.  A voxel is full when a triangle
 * has a point in it (sampled finely enough that nothing can pass between).
 *
 * Memory: a byte a voxel and four a column; at most OCCUPANCY_VOXELS_MAX voxels.  Geometry is
 * streamed, node by node.
 */
#ifndef TOOLS_BENCH_PATH_OCCUPANCY_H
#define TOOLS_BENCH_PATH_OCCUPANCY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "formats/store/store_file.h"

#define OCCUPANCY_VOXELS_MAX (UINT64_C(1) << 27)

struct occupancy {
	uint32_t size[3];
	double voxel;      /* edge, model units */
	double corner[3];  /* of voxel 0, 0, 0 in the grid's axes, from the store's origin */
	unsigned world[3]; /* which of the model's axes each of the grid's is */
	uint8_t *full;     /* index: occupancy_index() */
	uint32_t *detail;  /* triangles of each column (y * size[0] + x), by their first corner */
};

/** Columns lie together, so that looking up and down is quick. */
static inline size_t occupancy_index(const struct occupancy *occupancy, uint32_t x, uint32_t y,
				     uint32_t z)
{
	return ((size_t)y * occupancy->size[0] + x) * occupancy->size[2] + z;
}

/** What a grid is to hold: a box in the grid's axes, from the store's origin, in model units. */
struct occupancy_region {
	double low[3], high[3];
	double voxel; /* edge; 0: as fine as the memory allows.  Made larger where it is too fine. */
};

/**
 * Reads the leaves of a store that are in a region.
 *
 * region:  NULL: the whole store.
 *
 * Returns: 0, -ENODATA (a store without triangles), -ENOMEM, -ECANCELED, or what reading said.
 * Ownership: ends with occupancy_done().
 */
int occupancy_make(const struct store_file *store, const struct store_node *nodes,
		   const struct occupancy_region *region, struct occupancy *ret, struct why *why);
void occupancy_done(struct occupancy *occupancy);

/** A point of the grid, in voxels, as a point of the world in model units. */
void occupancy_to_world(const struct occupancy *occupancy,
			const struct store_superblock *superblock, const double point[3],
			double ret[3]);

#endif /* TOOLS_BENCH_PATH_OCCUPANCY_H */
