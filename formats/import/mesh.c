/* SPDX-License-Identifier: MIT */
#include "formats/import/mesh.h"

#include <errno.h>
#include <stdlib.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"

#define NORMAL_BYTES 12u

int mesh_create(struct import_job *job, const struct mesh_layout *layout, struct mesh **ret,
		struct why *why)
{
	struct mesh *mesh = calloc(1, sizeof(*mesh));
	uint32_t record_bytes = layout->positions_double ? 24 : 12;
	int r;

	if (!mesh)
		return why_set(why, -ENOMEM, "no memory to read it");
	mesh->job = job;
	mesh->layout = *layout;
	mesh->normal_offset = record_bytes;
	record_bytes += layout->normals ? NORMAL_BYTES : 0;
	mesh->colour_offset = record_bytes;
	record_bytes += layout->colours ? sizeof(uint32_t) : 0;
	mesh->vertices.record_bytes = record_bytes;
	mesh->normals.record_bytes = NORMAL_BYTES;
	mesh->triangles_plain = record_bytes == 12;
	r = batcher_init(&mesh->batcher, layout->positions_double, job->options, job->sink,
			 job->info, why);
	if (r < 0) {
		mesh_destroy(mesh);
		return r;
	}
	*ret = mesh;
	return 0;
}

struct mesh *mesh_destroy(struct mesh *mesh)
{
	if (!mesh)
		return NULL;
	batcher_done(&mesh->batcher);
	polygon_done(&mesh->polygon);
	free(mesh->vertices.records);
	free(mesh->normals.records);
	free(mesh->part_colours);
	free(mesh->corners);
	free(mesh->corner_normals);
	free(mesh);
	return NULL;
}

static uint64_t table_bytes(const struct mesh_table *table)
{
	return table->capacity * table->record_bytes;
}

/* Makes room for capacity records.  -ENOMEM when that is more than the mesh may have. */
static int table_reserve(struct mesh *mesh, struct mesh_table *table, uint64_t capacity)
{
	uint64_t others_bytes =
		table_bytes(&mesh->vertices) + table_bytes(&mesh->normals) - table_bytes(table);
	uint64_t size_bytes;
	uint8_t *records;

	if (__builtin_mul_overflow(capacity, table->record_bytes, &size_bytes) ||
	    size_bytes > mesh->job->memory_bytes ||
	    others_bytes > mesh->job->memory_bytes - size_bytes)
		return -ENOMEM;
	records = realloc(table->records, size_bytes);
	if (!records)
		return -ENOMEM;
	table->records = records;
	table->capacity = capacity;
	return 0;
}

static int mesh_too_big(const struct mesh *mesh, struct why *why)
{
	return why_set(why, -ENOMEM, "its vertices do not fit in %llu MiB",
		       (unsigned long long)(mesh->job->options->memory_bytes / MIB));
}

int mesh_expect_vertices(struct mesh *mesh, uint64_t count, struct why *why)
{
	if (count > 0 && table_reserve(mesh, &mesh->vertices, count) < 0)
		return mesh_too_big(mesh, why);
	return 0;
}

int mesh_part(struct mesh *mesh, const struct import_part *part, uint32_t *ret_number,
	      struct why *why)
{
	uint32_t number;
	int r = batcher_part(&mesh->batcher, part, &number, why);

	if (r < 0)
		return r;
	if (number >= mesh->part_capacity) {
		uint32_t capacity = mesh->part_capacity ? 2 * mesh->part_capacity : 16;
		uint32_t *colours = realloc(mesh->part_colours, capacity * sizeof(*colours));

		if (!colours)
			return why_set(why, -ENOMEM, "no memory for %u parts", capacity);
		mesh->part_colours = colours;
		mesh->part_capacity = capacity;
	}
	mesh->part_colours[number] = part->colour;
	*ret_number = number;
	return 0;
}

static int table_add(struct mesh *mesh, struct mesh_table *table, const void *records,
		     uint64_t count, struct why *why)
{
	if (count > table->capacity - table->count) {
		uint64_t wanted = table->count + count;
		uint64_t grown = u64_max(wanted, table->capacity + table->capacity / 2);

		if (table_reserve(mesh, table, u64_max(grown, 4096)) < 0 &&
		    table_reserve(mesh, table, wanted) < 0)
			return mesh_too_big(mesh, why);
	}
	memcpy(table->records + table->count * table->record_bytes, records,
	       count * table->record_bytes);
	table->count += count;
	return 0;
}

int mesh_add_vertices(struct mesh *mesh, const void *records, uint64_t count, struct why *why)
{
	return table_add(mesh, &mesh->vertices, records, count, why);
}

int mesh_add_normal(struct mesh *mesh, const float normal[3], struct why *why)
{
	return table_add(mesh, &mesh->normals, normal, 1, why);
}

/* Copies what corner number `corner` of the polygon has to a corner of the batch. */
static void mesh_put_corner(struct mesh *mesh, const struct batch_kind *kind, uint32_t corner,
			    size_t to)
{
	const uint8_t *record = mesh->corners[corner];
	struct batcher *batcher = &mesh->batcher;

	if (mesh->layout.positions_double)
		memcpy(batcher->positions64 + 3 * to, record, 3 * sizeof(double));
	else
		memcpy(batcher->positions32 + 3 * to, record, 3 * sizeof(float));
	if (kind->normals) {
		const void *normal = mesh->layout.normals
					     ? (const void *)(record + mesh->normal_offset)
					     : (const void *)mesh->corner_normals[corner];

		memcpy(batcher->normals + 3 * to, normal, NORMAL_BYTES);
	}
	if (kind->colours) {
		uint32_t colour;

		memcpy(&colour, record + mesh->colour_offset, sizeof(colour));
		batcher->colours[to] = colour ? colour : mesh->part_colours[kind->part];
	}
}

/* Hands on the polygon whose corners stand in mesh->corners. */
static int mesh_emit(struct mesh *mesh, uint32_t part, uint32_t corner_count, bool normals,
		     struct why *why)
{
	static const uint32_t whole[3] = { 0, 1, 2 };
	struct batch_kind kind = {
		.part = part,
		.normals = normals || mesh->layout.normals,
		.colours = mesh->colours_present,
	};
	const uint32_t *cut = whole;

	if (corner_count > 3) {
		for (uint32_t i = 0; i < corner_count; i++) {
			double *position = mesh->polygon.positions + 3 * (size_t)i;
			float single[3];

			if (mesh->layout.positions_double) {
				memcpy(position, mesh->corners[i], 3 * sizeof(double));
				continue;
			}
			memcpy(single, mesh->corners[i], sizeof(single));
			for (int k = 0; k < 3; k++)
				position[k] = single[k];
		}
		cut = polygon_cut(&mesh->polygon, corner_count);
	}
	for (uint32_t i = 0; i < corner_count - 2; i++, cut += 3) {
		uint32_t index;
		int r = batcher_next(&mesh->batcher, &kind, &index, why);

		if (r < 0)
			return r;
		for (uint32_t k = 0; k < 3; k++)
			mesh_put_corner(mesh, &kind, cut[k], 3 * (size_t)index + k);
	}
	return 0;
}

/* Room for a face's corners, and for cutting it. */
static int mesh_reserve_corners(struct mesh *mesh, uint32_t corner_count, struct why *why)
{
	uint32_t corner_max = mesh->polygon.corner_max;
	const uint8_t **corners;
	const float **normals;

	if (corner_count > POLYGON_CORNERS_MAX)
		return why_set(why, -EUCLEAN, "a face of %u corners; at most %u are read",
			       corner_count, POLYGON_CORNERS_MAX);
	if (corner_count <= corner_max)
		return 0;
	if (polygon_reserve(&mesh->polygon, corner_count) < 0)
		return why_set(why, -ENOMEM, "no memory for a face of %u corners", corner_count);
	corner_max = mesh->polygon.corner_max;
	corners = realloc(mesh->corners, corner_max * sizeof(*corners));
	if (corners)
		mesh->corners = corners;
	normals = realloc(mesh->corner_normals, corner_max * sizeof(*normals));
	if (normals)
		mesh->corner_normals = normals;
	if (!corners || !normals)
		return why_set(why, -ENOMEM, "no memory for a face of %u corners", corner_count);
	return 0;
}

/* The record that a face points at, or NULL. */
static const uint8_t *table_find(const struct mesh_table *table, uint64_t number)
{
	return number < table->count ? table->records + number * table->record_bytes : NULL;
}

int mesh_add_face(struct mesh *mesh, const struct mesh_face *face, struct why *why)
{
	int r;

	mesh->job->info->face_count++;
	if (face->corner_count < 3) {
		mesh->job->info->dropped_faces++;
		return 0;
	}
	r = mesh_reserve_corners(mesh, face->corner_count, why);
	if (r < 0)
		return r;
	for (uint32_t i = 0; i < face->corner_count; i++) {
		mesh->corners[i] = table_find(&mesh->vertices, face->vertices[i]);
		if (!mesh->corners[i])
			return why_set(why, -EUCLEAN, "a face points at vertex %lld of %llu",
				       (long long)face->vertices[i],
				       (unsigned long long)mesh->vertices.count);
		if (!face->normals)
			continue;
		mesh->corner_normals[i] =
			(const float *)(const void *)table_find(&mesh->normals, face->normals[i]);
		if (!mesh->corner_normals[i])
			return why_set(why, -EUCLEAN, "a face points at normal %lld of %llu",
				       (long long)face->normals[i],
				       (unsigned long long)mesh->normals.count);
	}
	return mesh_emit(mesh, face->part, face->corner_count, face->normals != NULL, why);
}

int mesh_finish(struct mesh *mesh, struct why *why)
{
	return batcher_flush(&mesh->batcher, why);
}
