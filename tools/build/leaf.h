/* SPDX-License-Identifier: MIT */
/**
 * leaf.h - a leaf's payload and HS record, made of its triangles.
 *
 * Triangles are sorted into runs by part, vertices that look the same are one, both are in an order
 * that suits a GPU's caches, and positions take 16 bits where that is exact.
 *
 * Threads: one a leaf maker.
 */
#ifndef TOOLS_BUILD_LEAF_H
#define TOOLS_BUILD_LEAF_H

#include <stdint.h>

#include "formats/base/why.h"
#include "formats/store/layout.h"
#include "formats/store/payload.h"
#include "tools/build/labels.h"
#include "tools/build/normals.h"
#include "tools/build/octree.h"
#include "tools/build/patch.h"

/** Directions of a record's solidity: unit vectors, in the order of its fields. */
extern const double leaf_directions[STORE_SOLIDITY_DIRECTIONS][3];

/** What is known of a leaf beside its record, for the nodes above it. */
struct leaf {
	struct store_node record;                    /* without links, ids and extent */
	double normal_sum[3];                        /* of normal x area */
	double projected[STORE_SOLIDITY_DIRECTIONS]; /* area seen along each direction */
	double area;
	uint64_t duplicate_count;
	uint64_t primary_count; /* triangles that are no replicas: their centre is in the cell */
	double moved_max;       /* by rounding to floats, model units */
	bool small;             /* positions take 16 bits */
};

struct leaf_maker {
	const struct grid *grid;
	const struct record_shape *shape;
	const struct patch *patch;
	struct labels *labels; /* its counts go up */
	enum normals_mode mode;
	enum store_layout layout;
	uint32_t triangle_max; /* room in the arrays */

	/* Of the leaf in hand: centres in its cell have codes from `begin`, so many. */
	uint64_t cell_begin;
	uint64_t cell_length;

	uint64_t *keys; /* part and number, for sorting */
	uint64_t *keys_sorted;
	uint32_t *triangles; /* of the patch, in the payload's order */
	uint32_t *order;
	uint32_t *indices;
	uint32_t *indices_ordered;
	uint32_t *corners; /* per vertex: the patch's corner that it is */
	uint32_t *runs_of; /* per vertex */
	double *places;    /* per vertex: three, as grid_load() gives them */
	uint32_t *local;   /* per vertex of the patch: its number here, while it is made */
	uint32_t local_max;
	uint32_t *scratch;
	struct payload_run *runs;
	uint8_t *positions;
	uint8_t *normals;
	uint32_t *colours;
	uint64_t *ordinals;
};

void leaf_maker_done(struct leaf_maker *maker);
/** Memory that a maker takes for leaves of so many triangles. */
uint64_t leaf_maker_bytes(uint32_t leaf_triangles, uint32_t patch_triangles);

/**
 * Makes a leaf's content; it is valid until the next.
 *
 * Returns: 0, -ENOMEM, or -EOVERFLOW when the payload would be above the format's limit.
 */
int leaf_make(struct leaf_maker *maker, const struct octree_leaf *from,
	      struct payload_content *ret_content, struct leaf *ret, struct why *why);

#endif /* TOOLS_BUILD_LEAF_H */
