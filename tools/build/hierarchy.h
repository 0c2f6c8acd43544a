/* SPDX-License-Identifier: MIT */
/**
 * hierarchy.h - the HS: leaves, and all cells above them that have more than one child.
 *
 * Leaves come in Morton order; the nodes above them follow from their cells.  A cell with a single
 * child is left out: its child stands in its place, except for the root.
 *
 * Threads: none of its own.
 */
#ifndef TOOLS_BUILD_HIERARCHY_H
#define TOOLS_BUILD_HIERARCHY_H

#include <stdint.h>

#include "formats/base/why.h"
#include "formats/store/layout.h"
#include "tools/build/grid.h"
#include "tools/build/leaf.h"

struct hierarchy {
	struct store_node *nodes;
	uint32_t node_count;
	uint32_t level_max;
};

/**
 * Makes the HS, records breadth first.
 *
 * leaves:  in Morton order, their extents filled; none gives an empty root
 *
 * Returns: 0, -ENOMEM, or -EOVERFLOW above STORE_NODE_COUNT_MAX.
 * Ownership: ends with hierarchy_done().
 */
int hierarchy_make(const struct grid *grid, const struct leaf *leaves, uint64_t leaf_count,
		   struct hierarchy *ret, struct why *why);
void hierarchy_done(struct hierarchy *hierarchy);

#endif /* TOOLS_BUILD_HIERARCHY_H */
