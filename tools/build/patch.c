/* SPDX-License-Identifier: MIT */
#include "tools/build/patch.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"

/** A vertex is looked for among so many at its point, then it is taken as new. */
#define VERTICES_COMPARED_MAX 64u

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
	free(patch->slots);
	*patch = (struct patch){ .grid = patch->grid, .shape = patch->shape };
}

uint64_t patch_triangle_bytes(const struct record_shape *shape)
{
	return shape->words * sizeof(uint32_t) + sizeof(uint64_t) + sizeof(bool) +
	       sizeof(struct face_normal) + 7 * 3 * sizeof(uint32_t) + 8 * sizeof(uint32_t);
}

static uint32_t slots_for(uint32_t triangle_count)
{
	uint32_t slot_count = 1024;

	/* Most models have one point for two triangles; at worst three for one, and half full. */
	while (slot_count < triangle_count * UINT64_C(6))
		slot_count *= 2;
	return slot_count;
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
	patch->slots = malloc(slots_for(triangle_count) * sizeof(uint32_t));
	if (!patch->records || !patch->codes || !patch->primary || !patch->faces ||
	    !patch->points || !patch->point_corner || !patch->point_first || !patch->point_list ||
	    !patch->normals || !patch->vertices || !patch->vertex_corner || !patch->slots) {
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

void patch_find_points(struct patch *patch)
{
	uint32_t corner_count = patch->triangle_count * 3;
	uint32_t *counts = patch->point_first;

	patch->slot_count = slots_for(patch->triangle_count);
	patch->point_count = 0;
	memset(patch->slots, 0, patch->slot_count * sizeof(uint32_t));
	for (uint32_t corner = 0; corner < corner_count; corner++) {
		uint32_t point = patch_point_at(patch, patch_position(patch, corner));

		if (point == PATCH_NONE) {
			uint32_t key[6];
			uint32_t slot;

			record_position_key(patch->grid, patch_position(patch, corner), key);
			slot = record_key_hash(key) & (patch->slot_count - 1);
			while (patch->slots[slot] != 0)
				slot = (slot + 1) & (patch->slot_count - 1);
			point = patch->point_count++;
			patch->slots[slot] = point + 1;
			patch->point_corner[point] = corner;
			counts[point] = 0;
		}
		patch->points[corner] = point;
		counts[point]++;
	}
	/* Counts become ends; filling from the back turns ends into begins. */
	for (uint32_t i = 1; i < patch->point_count; i++)
		counts[i] += counts[i - 1];
	patch->point_first[patch->point_count] = corner_count;
	for (uint32_t corner = corner_count; corner-- > 0;)
		patch->point_list[--counts[patch->points[corner]]] = corner;
}

uint32_t patch_point_at(const struct patch *patch, const uint32_t *position)
{
	uint32_t key[6];
	uint32_t slot;

	record_position_key(patch->grid, position, key);
	slot = record_key_hash(key) & (patch->slot_count - 1);
	while (patch->slots[slot] != 0) {
		uint32_t point = patch->slots[slot] - 1;
		uint32_t other[6];

		record_position_key(patch->grid, patch_position(patch, patch->point_corner[point]),
				    other);
		if (record_keys_equal(key, other))
			return point;
		slot = (slot + 1) & (patch->slot_count - 1);
	}
	return PATCH_NONE;
}

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
