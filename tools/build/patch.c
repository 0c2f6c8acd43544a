/* SPDX-License-Identifier: MIT */
#include "tools/build/patch.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"

/** A vertex is looked for among so many at its point, then it is taken as new. */
#define VERTICES_COMPARED_MAX 64u
/** Slots are asked for so many corners before they are needed: the table is larger than caches. */
#define PREFETCH_AHEAD 24u

void patch_init(struct patch *patch, const struct grid *grid, const struct record_shape *shape)
{
	*patch = (struct patch){ .grid = grid, .shape = shape };
}

void patch_done(struct patch *patch)
{
	free(patch->records);
	free(patch->codes);
	free(patch->primary);
	free(patch->faces);
	free(patch->points);
	free(patch->point_corner);
	free(patch->point_first);
	free(patch->point_list);
	free(patch->normals);
	free(patch->vertices);
	free(patch->vertex_corner);
	free(patch->point_keys);
	free(patch->slots);
	*patch = (struct patch){ .grid = patch->grid, .shape = patch->shape };
}

uint64_t patch_triangle_bytes(const struct record_shape *shape)
{
	return shape->words * sizeof(uint32_t) + sizeof(uint64_t) + sizeof(bool) +
	       sizeof(struct face_normal) + 7 * 3 * sizeof(uint32_t) +
	       3 * shape->position_words * sizeof(uint32_t) + 8 * sizeof(uint64_t);
}

int patch_reserve(struct patch *patch, uint32_t triangle_count, struct why *why)
{
	size_t max = triangle_count;
	size_t corner_max = max * 3;

	if (triangle_count <= patch->triangle_max)
		return 0;
	patch_done(patch);
	patch->records = malloc(max * patch->shape->words * sizeof(uint32_t));
	patch->codes = malloc(max * sizeof(*patch->codes));
	patch->primary = malloc(max * sizeof(*patch->primary));
	patch->faces = malloc(max * sizeof(*patch->faces));
	patch->points = malloc(corner_max * sizeof(uint32_t));
	patch->point_corner = malloc(corner_max * sizeof(uint32_t));
	patch->point_first = malloc((corner_max + 1) * sizeof(uint32_t));
	patch->point_list = malloc(corner_max * sizeof(uint32_t));
	patch->normals = malloc(corner_max * sizeof(uint32_t));
	patch->vertices = malloc(corner_max * sizeof(uint32_t));
	patch->vertex_corner = malloc(corner_max * sizeof(uint32_t));
	patch->point_keys = malloc(corner_max * patch->shape->position_words * sizeof(uint32_t));
	if (!patch->records || !patch->codes || !patch->primary || !patch->faces ||
	    !patch->points || !patch->point_corner || !patch->point_first || !patch->point_list ||
	    !patch->normals || !patch->vertices || !patch->vertex_corner || !patch->point_keys) {
		patch_done(patch);
		return why_set(why, -ENOMEM, "no memory for %u triangles", triangle_count);
	}
	patch->triangle_max = triangle_count;
	return 0;
}

void patch_measure(struct patch *patch, bool faces)
{
	for (uint32_t i = 0; i < patch->triangle_count; i++) {
		double corners[9];
		uint32_t cell[3];

		patch_corners(patch, i, corners);
		grid_centre_cell(patch->grid, corners, cell);
		patch->codes[i] = grid_morton(cell);
		if (faces)
			face_normal_of(corners, &patch->faces[i]);
	}
}

/* ---- points ---- */

static bool is_point_at(const struct patch *patch, uint32_t point, const uint32_t key[6])
{
	uint32_t words = patch->shape->position_words;
	const uint32_t *other = patch->point_keys + (size_t)point * words;
	uint32_t differ = (other[0] ^ key[0]) | (other[1] ^ key[1]) | (other[2] ^ key[2]);

	if (words == 6)
		differ |= (other[3] ^ key[3]) | (other[4] ^ key[4]) | (other[5] ^ key[5]);
	return differ == 0;
}

/* The slot that has a point, or the empty one where it belongs. */
static uint32_t find_slot(const struct patch *patch, const uint32_t key[6], uint32_t hash)
{
	uint32_t mask = patch->slot_count - 1;
	uint32_t slot = hash & mask;

	while (patch->slots[slot] != 0) {
		if ((uint32_t)(patch->slots[slot] >> 32) == hash &&
		    is_point_at(patch, (uint32_t)patch->slots[slot] - 1, key))
			return slot;
		slot = (slot + 1) & mask;
	}
	return slot;
}

/* An empty table, or one twice as large with the same points. */
static int slots_resize(struct patch *patch, uint32_t slot_count, bool keep)
{
	uint64_t *old = patch->slots;
	uint32_t old_count = patch->slot_count;

	if (!keep && slot_count <= patch->slot_max) {
		memset(old, 0, slot_count * sizeof(*old));
		patch->slot_count = slot_count;
		return 0;
	}
	patch->slots = calloc(slot_count, sizeof(*patch->slots));
	if (!patch->slots) {
		patch->slots = old;
		return -ENOMEM;
	}
	patch->slot_count = slot_count;
	patch->slot_max = slot_count;
	for (uint32_t i = 0; keep && i < old_count; i++) {
		uint32_t slot = (uint32_t)(old[i] >> 32) & (slot_count - 1);

		if (old[i] == 0)
			continue;
		while (patch->slots[slot] != 0)
			slot = (slot + 1) & (slot_count - 1);
		patch->slots[slot] = old[i];
	}
	free(old);
	return 0;
}

static uint32_t add_point(struct patch *patch, uint32_t corner, const uint32_t key[6],
			  uint32_t hash, uint32_t slot)
{
	uint32_t words = patch->shape->position_words;
	uint32_t point = patch->point_count++;

	patch->slots[slot] = (uint64_t)hash << 32 | (point + 1);
	memcpy(patch->point_keys + (size_t)point * words, key, words * sizeof(uint32_t));
	patch->point_corner[point] = corner;
	patch->point_first[point] = 0;
	return point;
}

/* Numbers the points in the order of their first corners, and counts the corners of each. */
static int number_points(struct patch *patch)
{
	uint32_t corner_count = patch->triangle_count * 3;
	uint32_t *hashes = patch->vertices; /* not used before the points are known */

	for (uint32_t corner = 0; corner < corner_count; corner++) {
		uint32_t key[6];

		record_position_key(patch->grid, patch_position(patch, corner), key);
		hashes[corner] = record_key_hash(key);
	}
	for (uint32_t corner = 0; corner < corner_count; corner++) {
		uint32_t hash = hashes[corner];
		uint32_t key[6];
		uint32_t slot;
		uint32_t point;

		if (corner + PREFETCH_AHEAD < corner_count)
			__builtin_prefetch(&patch->slots[hashes[corner + PREFETCH_AHEAD] &
							 (patch->slot_count - 1)]);
		record_position_key(patch->grid, patch_position(patch, corner), key);
		slot = find_slot(patch, key, hash);
		if (patch->slots[slot] == 0)
			point = add_point(patch, corner, key, hash, slot);
		else
			point = (uint32_t)patch->slots[slot] - 1;
		patch->points[corner] = point;
		patch->point_first[point]++;
		if (patch->point_count * UINT64_C(2) > patch->slot_count &&
		    slots_resize(patch, patch->slot_count * 2, true) < 0)
			return -ENOMEM;
	}
	return 0;
}

int patch_find_points(struct patch *patch, struct why *why)
{
	uint32_t corner_count = patch->triangle_count * 3;
	uint32_t *firsts = patch->point_first;
	uint32_t slot_count = 1024;

	/* Most models have fewer points than triangles; the table grows where there are more. */
	while (slot_count < patch->triangle_count * UINT64_C(2))
		slot_count *= 2;
	patch->point_count = 0;
	if (slots_resize(patch, slot_count, false) < 0 || number_points(patch) < 0)
		return why_set(why, -ENOMEM, "no memory for the points of %u triangles",
			       patch->triangle_count);
	/* Counts become ends; filling from the back turns ends into begins. */
	for (uint32_t i = 1; i < patch->point_count; i++)
		firsts[i] += firsts[i - 1];
	firsts[patch->point_count] = corner_count;
	for (uint32_t corner = corner_count; corner-- > 0;)
		patch->point_list[--firsts[patch->points[corner]]] = corner;
	return 0;
}

uint32_t patch_point_at(const struct patch *patch, const uint32_t *position)
{
	uint32_t key[6];
	uint32_t slot;

	record_position_key(patch->grid, position, key);
	slot = find_slot(patch, key, record_key_hash(key));
	return patch->slots[slot] == 0 ? PATCH_NONE : (uint32_t)patch->slots[slot] - 1;
}

/* ---- vertices ---- */

/* Do two corners of one point look the same? */
static bool look_same(const struct patch *patch, uint32_t a, uint32_t b)
{
	const struct record_shape *shape = patch->shape;

	if (patch_part(patch, a / 3) != patch_part(patch, b / 3) ||
	    patch->normals[a] != patch->normals[b])
		return false;
	if (shape->colours_at != 0 && patch_record(patch, a / 3)[shape->colours_at + a % 3] !=
					      patch_record(patch, b / 3)[shape->colours_at + b % 3])
		return false;
	return patch->grid->form == GRID_LATTICE ||
	       memcmp(patch_position(patch, a), patch_position(patch, b),
		      shape->position_words * sizeof(uint32_t)) == 0;
}

void patch_find_vertices(struct patch *patch)
{
	patch->vertex_count = 0;
	for (uint32_t point = 0; point < patch->point_count; point++) {
		uint32_t first = patch->vertex_count;

		for (uint32_t i = patch->point_first[point]; i < patch->point_first[point + 1];
		     i++) {
			uint32_t corner = patch->point_list[i];
			uint32_t vertex = first;

			if (patch->vertex_count - first > VERTICES_COMPARED_MAX)
				vertex = patch->vertex_count - VERTICES_COMPARED_MAX;
			while (vertex < patch->vertex_count &&
			       !look_same(patch, corner, patch->vertex_corner[vertex]))
				vertex++;
			if (vertex == patch->vertex_count)
				patch->vertex_corner[patch->vertex_count++] = corner;
			patch->vertices[corner] = vertex;
		}
	}
}
