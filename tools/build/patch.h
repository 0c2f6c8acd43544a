/* SPDX-License-Identifier: MIT */
/**
 * patch.h - the triangles of one bucket in memory, and which of their corners are the same.
 *
 * Corner c of triangle t has the number 3 t + c.  Corners at the same point are one *point*; corners
 * that look the same as well (normal, colour, part, and the sign of zero) are one *vertex*.  Both
 * are found once for the bucket, so that cutting it into leaves needs no more searching.
 *
 * Threads: one a patch.
 * Memory: arrays grow to the largest bucket and are kept for the next.
 */
#ifndef TOOLS_BUILD_PATCH_H
#define TOOLS_BUILD_PATCH_H

#include <stdbool.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "tools/build/grid.h"
#include "tools/build/normals.h"
#include "tools/build/record.h"

#define PATCH_NONE UINT32_MAX

struct patch {
	const struct grid *grid;
	const struct record_shape *shape;
	uint32_t triangle_count;
	uint32_t triangle_max; /* room in the arrays */

	uint32_t *records;
	uint64_t *codes; /* Morton code of the centre's cell, per triangle */
	bool *primary;   /* is the centre in this bucket?  Others are replicas. */
	struct face_normal *faces;

	uint32_t *points;       /* per corner */
	uint32_t *point_corner; /* per point: its first corner */
	uint32_t *point_first;  /* per point, and one more: begin of its corners in ... */
	uint32_t *point_list;   /* ... this list */
	uint32_t point_count;

	uint32_t *normals;       /* per corner: its code; only if normals are stored */
	uint32_t *vertices;      /* per corner */
	uint32_t *vertex_corner; /* per vertex: its first corner */
	uint32_t vertex_count;

	uint32_t *point_keys; /* per point: record_position_key() */
	uint64_t *slots;      /* of a hash table: hash of the key above, point + 1 below; 0: none */
	uint32_t slot_count;
	uint32_t slot_max;
};

void patch_init(struct patch *patch, const struct grid *grid, const struct record_shape *shape);
void patch_done(struct patch *patch);

/** Makes room.  Returns: 0 or -ENOMEM. */
int patch_reserve(struct patch *patch, uint32_t triangle_count, struct why *why);
/** What patch_reserve() takes for each triangle at most. */
uint64_t patch_triangle_bytes(const struct record_shape *shape);

static inline const uint32_t *patch_record(const struct patch *patch, uint32_t triangle)
{
	return patch->records + (size_t)triangle * patch->shape->words;
}

static inline const uint32_t *patch_position(const struct patch *patch, uint32_t corner)
{
	return patch_record(patch, corner / 3) + corner % 3 * patch->shape->position_words;
}

static inline uint32_t patch_part(const struct patch *patch, uint32_t triangle)
{
	return patch_record(patch, triangle)[patch->shape->part_at];
}

static inline void patch_corners(const struct patch *patch, uint32_t triangle, double ret[9])
{
	record_corners(patch->grid, patch->shape, patch_record(patch, triangle), ret);
}

/** Finds the points of all triangles.  Returns: 0 or -ENOMEM. */
int patch_find_points(struct patch *patch, struct why *why);
/** The point at a position; PATCH_NONE: no corner is there. */
uint32_t patch_point_at(const struct patch *patch, const uint32_t *position);
/** Finds the vertices, when points and normals are known. */
void patch_find_vertices(struct patch *patch);
/** Computes centre codes, and face normals if they are wanted. */
void patch_measure(struct patch *patch, bool faces);

#endif /* TOOLS_BUILD_PATCH_H */
