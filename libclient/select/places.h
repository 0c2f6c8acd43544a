/* SPDX-License-Identifier: MIT */
/**
 * places.h - the octree of an HS as cubes that fill space, and which of them touch.
 *
 * A *place* is a cube of the octree: that of a node's record (a place has the number of its record),
 * or one without a record: an empty octant, or a cube between a node and a child that is more than
 * a level below it.  Places that are not divided are *cells*.  Cells fill the root cube without gap
 * or overlap; leaves are cells, and so is the air between them.
 *
 * Threads: any number may read.  Memory: O(places), about eight for each inner node.
 */
#ifndef LIBCLIENT_SELECT_PLACES_H
#define LIBCLIENT_SELECT_PLACES_H

#include <stdbool.h>
#include <stdint.h>

#include "formats/store/layout.h"

#define PLACE_NONE UINT32_MAX

struct cube {
	float centre[3];
	float half; /* rounded up by what the centre may be off */
};

/** The octants of a place that is no cell. */
struct division {
	uint32_t children[8]; /* places */
	uint32_t coordinates[3];
	uint32_t level;
};

struct places {
	const struct store_superblock *superblock;
	uint32_t place_count; /* 0 for a store without nodes; else place 0 is the root */
	uint32_t division_count;
	struct cube *cubes;
	uint32_t *division_of; /* PLACE_NONE of a cell */
	struct division *divisions;
	uint32_t *first_adjacent; /* place_count + 1: where a place's neighbours begin */
	uint32_t *adjacent;       /* cells that share a part of a face */
};

/**
 * Makes the places of a valid HS.
 *
 * Returns: 0, or -ENOMEM (also when there are too many to number).
 * Ownership: ends with places_done(), which copes with half-made ones.
 */
int places_init(struct places *places, const struct store_superblock *superblock,
		const struct store_node *nodes);
void places_done(struct places *places);

static inline bool place_is_cell(const struct places *places, uint32_t place)
{
	return places->division_of[place] == PLACE_NONE;
}

/** The place in an octant (bit 0: x, 1: y, 2: z) of a place that is no cell. */
static inline uint32_t place_child(const struct places *places, uint32_t place, unsigned octant)
{
	return places->divisions[places->division_of[place]].children[octant];
}

/** The cell that holds a point (from the store's origin), or PLACE_NONE outside of the root. */
uint32_t places_find_cell(const struct places *places, const double point[3]);

#endif /* LIBCLIENT_SELECT_PLACES_H */
