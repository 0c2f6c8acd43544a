/* SPDX-License-Identifier: MIT */
/**
 * buckets.h - the upper part of the octree, and which part of it is worked on at a time.
 *
 * A bucket is a run of cells, next to each other on the Morton curve, that together have at most
 * bucket_triangles triangles.  Each cell is one that the octree cuts out for certain: its parent has
 * more triangles than any leaf may have.  So buckets are cut into leaves one by one, in any order,
 * and what comes out is the octree that cutting the whole model would have given.  The choice
 * depends on the triangles alone, not on memory or threads.
 *
 * Triangles are counted cell by cell in rounds over the soup: the first goes six levels deep (three
 * where triangles are replicated), the next three deeper into cells that still have too many.
 *
 * Threads: filled by one; counting from any; read by any afterwards.
 */
#ifndef TOOLS_BUILD_BUCKETS_H
#define TOOLS_BUILD_BUCKETS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "formats/store/layout.h"
#include "tools/build/grid.h"

/**
 * With --layout replicate, a cell is cut only while the triangles of its leaves will be at most this
 * many times its own: the bound of the replication factor, whatever the model.
 */
#define BUCKETS_SPREAD_MAX 4.0

/** A cell of the upper octree. */
struct bucket_cell {
	uint64_t triangle_count;
	uint32_t first_child; /* of eight side by side; 0: it has none */
	uint32_t bucket;      /* of a cell without children */
	uint32_t ordinal;     /* of such a cell with triangles, in its bucket */
	uint32_t counters;    /* in the round that counts below it; else COUNTERS_NONE */
	uint32_t cell[3];
	double spread; /* product, from the root down, of triangles of children a triangle */
	uint8_t level;
	bool whole; /* has too many triangles, and cutting it does not help */
};

struct bucket {
	uint64_t triangle_count; /* replicas in its cells count each */
	uint32_t first;          /* of its cells in buckets.leaf_cells */
	uint32_t cell_count;
	bool whole; /* is one cell that has too many triangles and cannot be cut */
};

struct buckets {
	const struct grid *grid;
	enum store_layout layout;
	uint64_t bucket_triangles;
	struct bucket_cell *cells; /* 0 is the root */
	uint32_t cell_count;
	uint32_t cell_max;
	struct bucket *buckets;
	uint32_t bucket_count;
	uint32_t *leaf_cells; /* those without children that have triangles, in Morton order */
	uint32_t leaf_cell_count;
	uint32_t *table; /* the cell of the upper octree for each cell six levels down */

	/* One round of counting. */
	uint64_t *counters;
	uint32_t counters_levels;
	uint32_t counters_words; /* of one cell that is counted below */
};

/** Returns: 0 or -ENOMEM.  Ownership: ends with buckets_done(), which takes a zeroed one too. */
int buckets_init(struct buckets *buckets, const struct grid *grid, enum store_layout layout,
		 uint64_t bucket_triangles);
void buckets_done(struct buckets *buckets);

/** Begins a round.  Returns: 1 if the soup has to be counted (again), 0 if all is known, -ENOMEM. */
int buckets_round_begin(struct buckets *buckets);
/** What one worker has counted and not yet added: neighbours in a file are neighbours in space. */
struct buckets_tally {
	uint64_t *counter;
	uint64_t count;
	uint64_t total;
};

/** Counts one triangle that is not degenerate; corners as grid_load() gives them. */
void buckets_count(struct buckets *buckets, struct buckets_tally *tally, const double corners[9]);
/** Adds what is left.  Each worker calls it before it ends. */
void buckets_count_end(struct buckets *buckets, struct buckets_tally *tally);
/** Takes the counts into account.  Returns: 0 or -ENOMEM. */
int buckets_round_end(struct buckets *buckets);

/** After the last round: makes the buckets.  Returns: 0 or -ENOMEM. */
int buckets_choose(struct buckets *buckets);

/** The bucket that a cell of STORE_LEVEL_MAX belongs to. */
static inline uint32_t buckets_find(const struct buckets *buckets, const uint32_t cell[3])
{
	const struct bucket_cell *at;
	uint32_t index;

	index = buckets->table[(cell[2] >> 15) << 12 | (cell[1] >> 15) << 6 | cell[0] >> 15];
	for (at = &buckets->cells[index]; at->first_child != 0; at = &buckets->cells[index]) {
		uint32_t shift = STORE_LEVEL_MAX - 1 - at->level;

		index = at->first_child + ((cell[0] >> shift & 1) | (cell[1] >> shift & 1) << 1 |
					   (cell[2] >> shift & 1) << 2);
	}
	return at->bucket;
}

/** The bucket of a point; as grid_load() gives it. */
static inline uint32_t buckets_find_point(const struct buckets *buckets, const double point[3])
{
	uint32_t cell[3];

	grid_cell(buckets->grid, point, cell);
	return buckets_find(buckets, cell);
}

/**
 * The buckets that a triangle touches, ascending, each once.
 *
 * ret:  room for bucket_count numbers
 *
 * Returns: how many.
 */
uint32_t buckets_touched(const struct buckets *buckets, const double corners[9], uint32_t *ret);

/**
 * The cells of one bucket that a triangle touches, as ordinals.
 *
 * ret:  room for the bucket's cell_count numbers
 *
 * Returns: how many.
 */
uint32_t buckets_touched_cells(const struct buckets *buckets, uint32_t bucket,
			       const double corners[9], uint32_t *ret);

/** Bytes of the tables, for the budget. */
uint64_t buckets_table_bytes(const struct buckets *buckets);

#endif /* TOOLS_BUILD_BUCKETS_H */
