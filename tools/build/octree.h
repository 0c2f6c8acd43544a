/* SPDX-License-Identifier: MIT */
/**
 * octree.h - a bucket's triangles cut into leaves.
 *
 * A cell is cut as long as it has more triangles or vertices than a leaf may have.  Each triangle
 * goes to the child that holds its centre (unique), or to every child that it touches (replicate).
 * Two things end it earlier, and both are counted:
 *
 *	- GRID_LEVEL_MAX.  The cell is *chopped*: its triangles are shared out among leaves whose cells
 *	  lie GRID_PIECE_LEVELS below it, one after the other on the Morton curve.  Those cells say
 *	  nothing of where the triangles are; the tight boxes do.
 *	- Where triangles are replicated, children that would multiply them (BUCKETS_SPREAD_MAX): they
 *	  are too large for cutting to separate them.  The cell is then one leaf, above the limit.
 *
 * Threads: one an octree.
 * Source: Correa, Klosowski & Silva 2002, "iWalk", sec. 3; there leaves have a limit of vertices
 *	only, and triangles are replicated.
 */
#ifndef TOOLS_BUILD_OCTREE_H
#define TOOLS_BUILD_OCTREE_H

#include <stdint.h>

#include "formats/base/why.h"
#include "tools/build/buckets.h"
#include "tools/build/patch.h"

/** One leaf's triangles. */
struct octree_leaf {
	uint32_t level;
	uint32_t cell[3];
	uint32_t piece_levels; /* so far above is the cell that was chopped; else 0 */
	const uint32_t *triangles;
	uint32_t triangle_count;
};

/** Told of each leaf, in Morton order. */
typedef int (*octree_leaf_fn)(void *arg, const struct octree_leaf *leaf, struct why *why);

struct octree {
	const struct buckets *buckets;
	const struct patch *patch;
	uint32_t leaf_triangles;
	uint32_t leaf_vertices; /* UINT32_MAX: no limit */
	octree_leaf_fn leaf;
	void *arg;
	uint64_t limited_count; /* leaves of cells that could not be cut */

	uint32_t *lists; /* triangle numbers: a stack of lists, one for each level */
	size_t list_max;
	uint32_t *seen; /* per vertex: the last cell that counted it */
	uint32_t seen_max;
	uint32_t cell_number;
	uint8_t *octants; /* per triangle of the cell in hand */
	uint32_t octant_max;
	uint32_t *starts; /* per cell of a bucket */
	uint32_t *touched;
	uint64_t *begins;
	uint32_t start_max;
};

void octree_done(struct octree *octree);

/** Cuts a bucket that is in the patch.  Returns: 0, -ENOMEM, or what the leaf function said. */
int octree_cut(struct octree *octree, uint32_t bucket, struct why *why);

/**
 * Chops triangles of one whole bucket that are in the patch.
 *
 * ret_pieces:  pieces made so far of the bucket; counted on
 */
int octree_chop(struct octree *octree, uint32_t bucket, uint32_t *ret_pieces, struct why *why);

#endif /* TOOLS_BUILD_OCTREE_H */
