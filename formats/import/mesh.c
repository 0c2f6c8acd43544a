/* SPDX-License-Identifier: MIT */
#include "formats/import/mesh.h"

#include <errno.h>
#include <stdlib.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"

#define NORMAL_BYTES    12u
#define RUN_CHUNK_BYTES 65536u

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
	mesh->vertices.what = "vertex";
	mesh->vertices.record_bytes = record_bytes;
	mesh->normals.what = "normal";
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
	join_destroy(mesh->vertices.join);
	join_destroy(mesh->normals.join);
	spill_destroy(mesh->faces);
	free(mesh->joined);
	free(mesh->part_colours);
	free(mesh->face_vertices);
	free(mesh->face_normals);
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

/* Moves a table to a join. */
static int table_defer(struct mesh *mesh, struct mesh_table *table, uint64_t memory_bytes,
		       struct why *why)
{
	int r = join_create(&mesh->job->scratch, table->record_bytes, memory_bytes, &table->join,
			    why);

	if (r == 0)
		r = join_add(table->join, table->records, table->count, why);
	free(table->records);
	table->records = NULL;
	table->capacity = 0;
	return r;
}

int mesh_defer(struct mesh *mesh, struct why *why)
{
	uint64_t memory_bytes = mesh->job->memory_bytes;
	uint64_t normal_bytes = mesh->layout.normal_table ? memory_bytes / 3 : 0;
	int r;

	CHECK(!mesh->deferred);
	if (!mesh->job->options->scratch_directory)
		return why_set(why, -ENOMEM, "its vertices do not fit in %llu MiB",
			       (unsigned long long)(mesh->job->options->memory_bytes / MIB));
	mesh->deferred = true;
	r = spill_create(&mesh->job->scratch, 1, RUN_CHUNK_BYTES, &mesh->faces, why);
	if (r == 0)
		r = table_defer(mesh, &mesh->vertices, memory_bytes - normal_bytes, why);
	if (r == 0 && mesh->layout.normal_table)
		r = table_defer(mesh, &mesh->normals, normal_bytes, why);
	return r;
}

int mesh_expect_vertices(struct mesh *mesh, uint64_t count, struct why *why)
{
	if (!mesh->deferred && count > 0 && table_reserve(mesh, &mesh->vertices, count) < 0)
		return mesh_defer(mesh, why);
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

/* Makes room for count more records, or defers the mesh. */
static int table_make_room(struct mesh *mesh, struct mesh_table *table, uint64_t count,
			   struct why *why)
{
	uint64_t wanted = table->count + count;
	uint64_t grown = u64_max(wanted, table->capacity + table->capacity / 2);

	if (wanted <= table->capacity || table_reserve(mesh, table, u64_max(grown, 4096)) == 0 ||
	    table_reserve(mesh, table, wanted) == 0)
		return 0;
	return mesh_defer(mesh, why);
}

static int table_add(struct mesh *mesh, struct mesh_table *table, const void *records,
		     uint64_t count, struct why *why)
{
	int r = mesh->deferred ? 0 : table_make_room(mesh, table, count, why);

	if (r < 0)
		return r;
	if (mesh->deferred)
		r = join_add(table->join, records, count, why);
	else
		memcpy(table->records + table->count * table->record_bytes, records,
		       count * table->record_bytes);
	table->count += count;
	return r;
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
					     ? record + mesh->normal_offset
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

/* Makes an array longer; what is in it stays. */
static int grow_array(void *array, size_t count, size_t item_bytes)
{
	void **pointer = array;
	void *grown = realloc(*pointer, count * item_bytes);

	if (!grown)
		return -ENOMEM;
	*pointer = grown;
	return 0;
}

int mesh_reserve(struct mesh *mesh, uint64_t corner_count, struct why *why)
{
	size_t joined_bytes = mesh->vertices.record_bytes + mesh->normals.record_bytes;
	uint32_t corner_max = mesh->corner_max ? mesh->corner_max : 64;

	if (corner_count <= mesh->corner_max)
		return 0;
	if (corner_count > POLYGON_CORNERS_MAX)
		return why_set(why, -EUCLEAN, "a face of more than %u corners",
			       POLYGON_CORNERS_MAX);
	while (corner_max < corner_count)
		corner_max *= 2;
	if (grow_array(&mesh->face_vertices, corner_max, sizeof(*mesh->face_vertices)) < 0 ||
	    grow_array(&mesh->face_normals, corner_max, sizeof(*mesh->face_normals)) < 0 ||
	    grow_array(&mesh->corners, corner_max, sizeof(*mesh->corners)) < 0 ||
	    grow_array(&mesh->corner_normals, corner_max, sizeof(*mesh->corner_normals)) < 0 ||
	    grow_array(&mesh->joined, corner_max, joined_bytes) < 0 ||
	    polygon_reserve(&mesh->polygon, corner_max) < 0)
		return why_set(why, -ENOMEM, "no memory for a face of %u corners", corner_max);
	mesh->corner_max = corner_max;
	return 0;
}

/* ---- faces of a deferred mesh ---- */

/* Faces that are alike but for their corners, one after the other. */
struct face_run {
	uint64_t length;
	uint32_t part;
	uint32_t corner_count;
	uint64_t normals; /* 1: they have them */
};

static int write_run(struct mesh *mesh, struct why *why)
{
	struct face_run run = {
		.length = mesh->run_length,
		.part = mesh->run_part,
		.corner_count = mesh->run_corner_count,
		.normals = mesh->run_normals,
	};

	mesh->run_length = 0;
	return run.length > 0 ? spill_write(mesh->faces, 0, &run, sizeof(run), why) : 0;
}

static int note_face(struct mesh *mesh, const struct mesh_face *face, struct why *why)
{
	int r = 0;

	if (mesh->run_part != face->part || mesh->run_corner_count != face->corner_count ||
	    mesh->run_normals != face->normals)
		r = write_run(mesh, why);
	mesh->run_part = face->part;
	mesh->run_corner_count = face->corner_count;
	mesh->run_normals = face->normals;
	mesh->run_length++;
	for (uint32_t i = 0; i < face->corner_count && r == 0; i++) {
		r = join_refer(mesh->vertices.join, mesh->face_vertices[i], why);
		if (r == 0 && face->normals)
			r = join_refer(mesh->normals.join, mesh->face_normals[i], why);
	}
	return r;
}

/* Hands on the next face, whose corners come from the joins. */
static int emit_noted(struct mesh *mesh, const struct face_run *run, struct why *why)
{
	uint32_t vertex_bytes = mesh->vertices.record_bytes;
	uint8_t *normals = mesh->joined + (size_t)mesh->corner_max * vertex_bytes;

	for (uint32_t i = 0; i < run->corner_count; i++) {
		uint8_t *vertex = mesh->joined + (size_t)i * vertex_bytes;
		uint8_t *normal = normals + (size_t)i * NORMAL_BYTES;
		int r = join_next(mesh->vertices.join, vertex, why);

		if (r == 0 && run->normals)
			r = join_next(mesh->normals.join, normal, why);
		if (r < 0)
			return r;
		mesh->corners[i] = vertex;
		mesh->corner_normals[i] = normal;
	}
	return mesh_emit(mesh, run->part, run->corner_count, run->normals, why);
}

static int table_resolve(struct mesh_table *table, struct why *why)
{
	int r = table->join ? join_resolve(table->join, why) : 0;

	if (r == -EUCLEAN)
		return why_set(why, r, "a face points at %s %llu of %llu", table->what,
			       (unsigned long long)table->join->index_max,
			       (unsigned long long)table->count);
	return r;
}

static int emit_all_noted(struct mesh *mesh, struct why *why)
{
	struct face_run run;
	int r = write_run(mesh, why);

	if (r == 0)
		r = table_resolve(&mesh->vertices, why);
	if (r == 0)
		r = table_resolve(&mesh->normals, why);
	if (r < 0)
		return r;
	while ((r = spill_read(mesh->faces, 0, &run, sizeof(run), why)) > 0) {
		for (uint64_t i = 0; i < run.length; i++) {
			r = emit_noted(mesh, &run, why);
			if (r < 0)
				return r;
		}
	}
	return r;
}

/* ---- faces ---- */

/* The record that a face points at. */
static int table_find(const struct mesh_table *table, uint64_t number, const uint8_t **ret,
		      struct why *why)
{
	if (number >= table->count)
		return why_set(why, -EUCLEAN, "a face points at %s %lld of %llu", table->what,
			       (long long)number, (unsigned long long)table->count);
	*ret = table->records + number * table->record_bytes;
	return 0;
}

int mesh_add_face(struct mesh *mesh, const struct mesh_face *face, struct why *why)
{
	int r = 0;

	CHECK(face->corner_count <= mesh->corner_max);
	mesh->job->info->face_count++;
	if (face->corner_count < 3) {
		mesh->job->info->dropped_faces++;
		return 0;
	}
	if (mesh->deferred)
		return note_face(mesh, face, why);
	for (uint32_t i = 0; i < face->corner_count && r == 0; i++) {
		r = table_find(&mesh->vertices, mesh->face_vertices[i], &mesh->corners[i], why);
		if (r == 0 && face->normals)
			r = table_find(&mesh->normals, mesh->face_normals[i],
				       &mesh->corner_normals[i], why);
	}
	return r < 0 ? r : mesh_emit(mesh, face->part, face->corner_count, face->normals, why);
}

int mesh_finish(struct mesh *mesh, struct why *why)
{
	int r = mesh->deferred ? emit_all_noted(mesh, why) : 0;

	return r < 0 ? r : batcher_flush(&mesh->batcher, why);
}
