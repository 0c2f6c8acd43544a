/* SPDX-License-Identifier: MIT */
/**
 * record.h - one triangle on its way through the build: a row of 32-bit words.
 *
 *	9 or 18 words   its corners, in the grid's form
 *	1 word          part, as the names block counts them
 *	3 words         normals, octahedral 16 bit; if any file has normals that are wanted
 *	3 words         colours; if any file has vertex colours
 *	2 words         ordinal in the model; with --keep-ids
 *
 * Threads: any.
 */
#ifndef TOOLS_BUILD_RECORD_H
#define TOOLS_BUILD_RECORD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "tools/build/grid.h"

/** Most words of a record. */
#define RECORD_WORDS_MAX (18u + 1u + 3u + 3u + 2u)

/** Where the fields of all records of a build are, in words.  0: they have none. */
struct record_shape {
	uint32_t position_words; /* of one corner */
	uint32_t part_at;
	uint32_t normals_at;
	uint32_t colours_at;
	uint32_t ordinal_at;
	uint32_t words;
};

static inline struct record_shape record_shape(const struct grid *grid, bool normals, bool colours,
					       bool ordinals)
{
	struct record_shape shape = { .position_words = grid_position_words(grid) };

	shape.part_at = shape.position_words * 3;
	shape.words = shape.part_at + 1;
	if (normals) {
		shape.normals_at = shape.words;
		shape.words += 3;
	}
	if (colours) {
		shape.colours_at = shape.words;
		shape.words += 3;
	}
	if (ordinals) {
		shape.ordinal_at = shape.words;
		shape.words += 2;
	}
	return shape;
}

/** All three corners, as grid_load() gives them. */
static inline void record_corners(const struct grid *grid, const struct record_shape *shape,
				  const uint32_t *record, double ret[9])
{
	for (unsigned i = 0; i < 3; i++)
		grid_load(grid, record + i * shape->position_words, &ret[3 * i]);
}

static inline uint64_t record_ordinal(const struct record_shape *shape, const uint32_t *record)
{
	uint64_t ordinal;

	memcpy(&ordinal, record + shape->ordinal_at, sizeof(ordinal));
	return ordinal;
}

/**
 * A position as a key: two positions are the same point if their keys are equal.  Only -0 and +0
 * differ in their bits and not as points.
 */
static inline void record_position_key(const struct grid *grid, const uint32_t *position,
				       uint32_t ret[6])
{
	ret[3] = 0;
	ret[4] = 0;
	ret[5] = 0;
	memcpy(ret, position, grid_position_words(grid) * sizeof(uint32_t));
	if (grid->form == GRID_FLOAT) {
		for (unsigned i = 0; i < 3; i++)
			ret[i] = ret[i] == UINT32_C(0x80000000) ? 0 : ret[i];
	} else if (grid->form == GRID_DOUBLE) {
		for (unsigned i = 0; i < 6; i += 2)
			if (ret[i] == 0 && ret[i + 1] == UINT32_C(0x80000000))
				ret[i + 1] = 0;
	}
}

static inline bool record_keys_equal(const uint32_t a[6], const uint32_t b[6])
{
	return ((a[0] ^ b[0]) | (a[1] ^ b[1]) | (a[2] ^ b[2]) | (a[3] ^ b[3]) | (a[4] ^ b[4]) |
		(a[5] ^ b[5])) == 0;
}

static inline uint32_t record_key_hash(const uint32_t key[6])
{
	uint64_t hash = ((uint64_t)key[0] << 32 | key[1]) * UINT64_C(0x9e3779b97f4a7c15);

	hash ^= ((uint64_t)key[2] << 32 | key[3]) * UINT64_C(0xc2b2ae3d27d4eb4f);
	hash ^= ((uint64_t)key[4] << 32 | key[5]) * UINT64_C(0x165667b19e3779f9);
	hash ^= hash >> 29;
	hash *= UINT64_C(0xbf58476d1ce4e5b9);
	return (uint32_t)(hash >> 32);
}

#endif /* TOOLS_BUILD_RECORD_H */
