/* SPDX-License-Identifier: MIT */
#include "formats/import/faces.h"

#include <errno.h>
#include <stdlib.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"

#define NORMAL_BYTES     12u
#define COORDINATE_BYTES 8u
#define RUN_CHUNK_BYTES  65536u

int faces_create(struct import_job *job, const struct faces_layout *layout, struct faces **ret,
		 struct why *why)
{
	struct faces *faces = calloc(1, sizeof(*faces));
	uint32_t record_bytes = layout->positions_double ? 24 : 12;
	int r;

	if (!faces)
		return why_set(why, -ENOMEM, "no memory to read it");
	faces->job = job;
	faces->layout = *layout;
	faces->normal_offset = record_bytes;
	record_bytes += layout->normals ? NORMAL_BYTES : 0;
	faces->colour_offset = record_bytes;
	record_bytes += layout->colours ? sizeof(uint32_t) : 0;
	faces->vertices.what = "vertex";
	faces->vertices.record_bytes = record_bytes;
	faces->normals.what = "normal";
	faces->normals.record_bytes = NORMAL_BYTES;
	faces->coordinates.what = "texture coordinate";
	faces->coordinates.record_bytes = COORDINATE_BYTES;
	faces->triangles_plain = record_bytes == 12;
	r = batcher_init(&faces->batcher, layout->positions_double, job->options, job->sink,
			 job->info, why);
	if (r < 0) {
		faces_destroy(faces);
		return r;
	}
	*ret = faces;
	return 0;
}

struct faces *faces_destroy(struct faces *faces)
{
	if (!faces)
		return NULL;
	batcher_done(&faces->batcher);
	polygon_done(&faces->polygon);
	free(faces->vertices.records);
	free(faces->normals.records);
	free(faces->coordinates.records);
	join_destroy(faces->vertices.join);
	join_destroy(faces->normals.join);
	join_destroy(faces->coordinates.join);
	spill_destroy(faces->noted);
	free(faces->joined);
	free(faces->parts);
	free(faces->face_vertices);
	free(faces->face_normals);
	free(faces->face_coordinates);
	free(faces->corners);
	free(faces->corner_normals);
	free(faces->corner_coordinates);
	free(faces);
	return NULL;
}

static uint64_t table_bytes(const struct faces_table *table)
{
	return table->capacity * table->record_bytes;
}

/* Makes room for capacity records.  -ENOMEM when that is more than there may be. */
static int table_reserve(struct faces *faces, struct faces_table *table, uint64_t capacity)
{
	uint64_t others_bytes = table_bytes(&faces->vertices) + table_bytes(&faces->normals) +
				table_bytes(&faces->coordinates) - table_bytes(table);
	uint64_t size_bytes;
	uint8_t *records;

	if (__builtin_mul_overflow(capacity, table->record_bytes, &size_bytes) ||
	    size_bytes > faces->job->memory_bytes ||
	    others_bytes > faces->job->memory_bytes - size_bytes)
		return -ENOMEM;
	records = realloc(table->records, size_bytes);
	if (!records)
		return -ENOMEM;
	table->records = records;
	table->capacity = capacity;
	return 0;
}

/* Moves a table to a join. */
static int table_defer(struct faces *faces, struct faces_table *table, uint64_t memory_bytes,
		       struct why *why)
{
	int r = join_create(&faces->job->scratch, table->record_bytes, memory_bytes, &table->join,
			    why);

	if (r == 0)
		r = join_add(table->join, table->records, table->count, why);
	free(table->records);
	table->records = NULL;
	table->capacity = 0;
	return r;
}

int faces_defer(struct faces *faces, struct why *why)
{
	uint64_t memory_bytes = faces->job->memory_bytes;
	uint64_t normal_bytes = faces->layout.normal_table ? memory_bytes / 3 : 0;
	uint64_t coordinate_bytes = faces->layout.texture_table ? memory_bytes / 5 : 0;
	int r;

	CHECK(!faces->deferred);
	if (!faces->job->options->scratch_directory)
		return why_set(why, -ENOMEM, "its vertices do not fit in %llu MiB",
			       (unsigned long long)(faces->job->options->memory_bytes / MIB));
	faces->deferred = true;
	r = spill_create(&faces->job->scratch, 1, RUN_CHUNK_BYTES, &faces->noted, why);
	if (r == 0)
		r = table_defer(faces, &faces->vertices,
				memory_bytes - normal_bytes - coordinate_bytes, why);
	if (r == 0 && faces->layout.normal_table)
		r = table_defer(faces, &faces->normals, normal_bytes, why);
	if (r == 0 && faces->layout.texture_table)
		r = table_defer(faces, &faces->coordinates, coordinate_bytes, why);
	return r;
}

int faces_expect_vertices(struct faces *faces, uint64_t count, struct why *why)
{
	if (!faces->deferred && count > 0 && table_reserve(faces, &faces->vertices, count) < 0)
		return faces_defer(faces, why);
	return 0;
}

int faces_part(struct faces *faces, const struct import_part *part, const struct texture_map *map,
	       uint32_t *ret_number, struct why *why)
{
	uint32_t number;
	int r = batcher_part(&faces->batcher, part, &number, why);

	if (r < 0)
		return r;
	if (number >= faces->part_capacity) {
		uint32_t capacity = faces->part_capacity ? 2 * faces->part_capacity : 16;
		struct faces_part *parts = realloc(faces->parts, capacity * sizeof(*parts));

		if (!parts)
			return why_set(why, -ENOMEM, "no memory for %u parts", capacity);
		faces->parts = parts;
		faces->part_capacity = capacity;
	}
	faces->parts[number] =
		(struct faces_part){ .colour = part->colour, .map = { .texture = TEXTURE_NONE } };
	if (map)
		faces->parts[number].map = *map;
	*ret_number = number;
	return 0;
}

/* Makes room for count more records, or defers everything. */
static int table_make_room(struct faces *faces, struct faces_table *table, uint64_t count,
			   struct why *why)
{
	uint64_t wanted = table->count + count;
	uint64_t grown = u64_max(wanted, table->capacity + table->capacity / 2);

	if (wanted <= table->capacity || table_reserve(faces, table, u64_max(grown, 4096)) == 0 ||
	    table_reserve(faces, table, wanted) == 0)
		return 0;
	return faces_defer(faces, why);
}

static int table_add(struct faces *faces, struct faces_table *table, const void *records,
		     uint64_t count, struct why *why)
{
	int r = faces->deferred ? 0 : table_make_room(faces, table, count, why);

	if (r < 0)
		return r;
	if (faces->deferred)
		r = join_add(table->join, records, count, why);
	else
		memcpy(table->records + table->count * table->record_bytes, records,
		       count * table->record_bytes);
	table->count += count;
	return r;
}

int faces_add_vertices(struct faces *faces, const void *records, uint64_t count, struct why *why)
{
	return table_add(faces, &faces->vertices, records, count, why);
}

int faces_add_normal(struct faces *faces, const float normal[3], struct why *why)
{
	return table_add(faces, &faces->normals, normal, 1, why);
}

int faces_add_coordinate(struct faces *faces, const float coordinate[2], struct why *why)
{
	return table_add(faces, &faces->coordinates, coordinate, 1, why);
}

/* Copies what corner number `corner` of the polygon has to a corner of the batch. */
static void faces_put_corner(struct faces *faces, const struct batch_kind *kind, uint32_t corner,
			     size_t to)
{
	const uint8_t *record = faces->corners[corner];
	struct batcher *batcher = &faces->batcher;

	if (faces->layout.positions_double)
		memcpy(batcher->positions64 + 3 * to, record, 3 * sizeof(double));
	else
		memcpy(batcher->positions32 + 3 * to, record, 3 * sizeof(float));
	if (kind->normals) {
		const void *normal = faces->layout.normals
					     ? record + faces->normal_offset
					     : (const void *)faces->corner_normals[corner];

		memcpy(batcher->normals + 3 * to, normal, NORMAL_BYTES);
	}
	if (kind->colours) {
		uint32_t colour;

		memcpy(&colour, record + faces->colour_offset, sizeof(colour));
		batcher->colours[to] = colour ? colour : faces->parts[kind->part].colour;
	}
}

/* Gives the triangle that begins at corner `to` of the batch the colours of its part's image. */
static void faces_put_texture(struct faces *faces, const struct faces_part *part,
			      const uint32_t corners[3], size_t to)
{
	uint32_t *colours = faces->batcher.colours + to;
	float coordinates[3][2];

	for (int k = 0; k < 3; k++)
		memcpy(coordinates[k], faces->corner_coordinates[corners[k]], COORDINATE_BYTES);
	textures_triangle(faces->textures, &part->map, coordinates, colours);
	/* How far it is seen through is the material's. */
	for (int k = 0; k < 3; k++)
		colours[k] =
			(colours[k] & UINT32_C(0x00ffffff)) | (part->colour & UINT32_C(0xff000000));
}

/* Hands on the polygon whose corners stand in faces->corners. */
static int faces_emit(struct faces *faces, const struct face *face, struct why *why)
{
	static const uint32_t whole[3] = { 0, 1, 2 };
	const struct faces_part *part = &faces->parts[face->part];
	struct batch_kind kind = {
		.part = face->part,
		.normals = face->normals || faces->layout.normals,
		.colours = face->textured || faces->colours_present,
	};
	const uint32_t *cut = whole;
	int r;

	if (face->textured) {
		r = textures_need(faces->textures, part->map.texture, why);
		if (r < 0)
			return r;
		/* Who gave the part its image has looked at it. */
		CHECK(r > 0);
	}
	if (face->corner_count > 3) {
		for (uint32_t i = 0; i < face->corner_count; i++) {
			double *position = faces->polygon.positions + 3 * (size_t)i;
			float single[3];

			if (faces->layout.positions_double) {
				memcpy(position, faces->corners[i], 3 * sizeof(double));
				continue;
			}
			memcpy(single, faces->corners[i], sizeof(single));
			for (int k = 0; k < 3; k++)
				position[k] = single[k];
		}
		cut = polygon_cut(&faces->polygon, face->corner_count);
	}
	for (uint32_t i = 0; i < face->corner_count - 2; i++, cut += 3) {
		uint32_t index;

		r = batcher_next(&faces->batcher, &kind, &index, why);
		if (r < 0)
			return r;
		for (uint32_t k = 0; k < 3; k++)
			faces_put_corner(faces, &kind, cut[k], 3 * (size_t)index + k);
		if (face->textured)
			faces_put_texture(faces, part, cut, 3 * (size_t)index);
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

int faces_reserve(struct faces *faces, uint64_t corner_count, struct why *why)
{
	size_t joined_bytes = faces->vertices.record_bytes + faces->normals.record_bytes +
			      faces->coordinates.record_bytes;
	uint32_t corner_max = faces->corner_max ? faces->corner_max : 64;

	if (corner_count <= faces->corner_max)
		return 0;
	if (corner_count > POLYGON_CORNERS_MAX)
		return why_set(why, -EUCLEAN, "a face of more than %u corners",
			       POLYGON_CORNERS_MAX);
	while (corner_max < corner_count)
		corner_max *= 2;
	if (grow_array(&faces->face_vertices, corner_max, sizeof(*faces->face_vertices)) < 0 ||
	    grow_array(&faces->face_normals, corner_max, sizeof(*faces->face_normals)) < 0 ||
	    grow_array(&faces->face_coordinates, corner_max, sizeof(*faces->face_coordinates)) <
		    0 ||
	    grow_array(&faces->corners, corner_max, sizeof(*faces->corners)) < 0 ||
	    grow_array(&faces->corner_normals, corner_max, sizeof(*faces->corner_normals)) < 0 ||
	    grow_array(&faces->corner_coordinates, corner_max, sizeof(*faces->corner_coordinates)) <
		    0 ||
	    grow_array(&faces->joined, corner_max, joined_bytes) < 0 ||
	    polygon_reserve(&faces->polygon, corner_max) < 0)
		return why_set(why, -ENOMEM, "no memory for a face of %u corners", corner_max);
	faces->corner_max = corner_max;
	return 0;
}

/* ---- faces that are deferred ---- */

/* Faces that are alike but for their corners, one after the other. */
struct face_run {
	uint64_t length;
	uint32_t part;
	uint32_t corner_count;
	uint32_t normals; /* 1: they have them */
	uint32_t textured;
};

static int write_run(struct faces *faces, struct why *why)
{
	struct face_run run = {
		.length = faces->run_length,
		.part = faces->run_part,
		.corner_count = faces->run_corner_count,
		.normals = faces->run_normals,
		.textured = faces->run_textured,
	};

	faces->run_length = 0;
	return run.length > 0 ? spill_write(faces->noted, 0, &run, sizeof(run), why) : 0;
}

static int note_face(struct faces *faces, const struct face *face, struct why *why)
{
	int r = 0;

	if (faces->run_part != face->part || faces->run_corner_count != face->corner_count ||
	    faces->run_normals != face->normals || faces->run_textured != face->textured)
		r = write_run(faces, why);
	faces->run_part = face->part;
	faces->run_corner_count = face->corner_count;
	faces->run_normals = face->normals;
	faces->run_textured = face->textured;
	faces->run_length++;
	for (uint32_t i = 0; i < face->corner_count && r == 0; i++) {
		r = join_refer(faces->vertices.join, faces->face_vertices[i], why);
		if (r == 0 && face->normals)
			r = join_refer(faces->normals.join, faces->face_normals[i], why);
		if (r == 0 && face->textured)
			r = join_refer(faces->coordinates.join, faces->face_coordinates[i], why);
	}
	return r;
}

/* Hands on the next face, whose corners come from the joins. */
static int emit_noted(struct faces *faces, const struct face_run *run, struct why *why)
{
	uint32_t vertex_bytes = faces->vertices.record_bytes;
	uint8_t *normals = faces->joined + (size_t)faces->corner_max * vertex_bytes;
	uint8_t *coordinates = normals + (size_t)faces->corner_max * NORMAL_BYTES;
	const struct face face = {
		.part = run->part,
		.corner_count = run->corner_count,
		.normals = run->normals != 0,
		.textured = run->textured != 0,
	};

	for (uint32_t i = 0; i < run->corner_count; i++) {
		uint8_t *vertex = faces->joined + (size_t)i * vertex_bytes;
		uint8_t *normal = normals + (size_t)i * NORMAL_BYTES;
		uint8_t *coordinate = coordinates + (size_t)i * COORDINATE_BYTES;
		int r = join_next(faces->vertices.join, vertex, why);

		if (r == 0 && run->normals)
			r = join_next(faces->normals.join, normal, why);
		if (r == 0 && run->textured)
			r = join_next(faces->coordinates.join, coordinate, why);
		if (r < 0)
			return r;
		faces->corners[i] = vertex;
		faces->corner_normals[i] = normal;
		faces->corner_coordinates[i] = coordinate;
	}
	return faces_emit(faces, &face, why);
}

static int table_resolve(struct faces_table *table, struct why *why)
{
	int r = table->join ? join_resolve(table->join, why) : 0;

	if (r == -EUCLEAN)
		return why_set(why, r, "a face points at %s %llu of %llu", table->what,
			       (unsigned long long)table->join->index_max,
			       (unsigned long long)table->count);
	return r;
}

static int emit_all_noted(struct faces *faces, struct why *why)
{
	struct face_run run;
	int r = write_run(faces, why);

	if (r == 0)
		r = table_resolve(&faces->vertices, why);
	if (r == 0)
		r = table_resolve(&faces->normals, why);
	if (r == 0)
		r = table_resolve(&faces->coordinates, why);
	if (r < 0)
		return r;
	while ((r = spill_read(faces->noted, 0, &run, sizeof(run), why)) > 0) {
		for (uint64_t i = 0; i < run.length; i++) {
			r = emit_noted(faces, &run, why);
			if (r < 0)
				return r;
		}
	}
	return r;
}

/* ---- faces ---- */

/* The record that a face points at. */
static int table_find(const struct faces_table *table, uint64_t number, const uint8_t **ret,
		      struct why *why)
{
	if (number >= table->count)
		return why_set(why, -EUCLEAN, "a face points at %s %lld of %llu", table->what,
			       (long long)number, (unsigned long long)table->count);
	*ret = table->records + number * table->record_bytes;
	return 0;
}

int faces_add_face(struct faces *faces, const struct face *given, struct why *why)
{
	struct face face = *given;
	int r = 0;

	CHECK(face.corner_count <= faces->corner_max);
	faces->job->info->face_count++;
	if (face.corner_count < 3) {
		faces->job->info->dropped_faces++;
		return 0;
	}
	face.textured = face.textured && faces->parts[face.part].map.texture != TEXTURE_NONE;
	if (faces->deferred)
		return note_face(faces, &face, why);
	for (uint32_t i = 0; i < face.corner_count && r == 0; i++) {
		r = table_find(&faces->vertices, faces->face_vertices[i], &faces->corners[i], why);
		if (r == 0 && face.normals)
			r = table_find(&faces->normals, faces->face_normals[i],
				       &faces->corner_normals[i], why);
		if (r == 0 && face.textured)
			r = table_find(&faces->coordinates, faces->face_coordinates[i],
				       &faces->corner_coordinates[i], why);
	}
	return r < 0 ? r : faces_emit(faces, &face, why);
}

int faces_finish(struct faces *faces, struct why *why)
{
	int r = faces->deferred ? emit_all_noted(faces, why) : 0;

	return r < 0 ? r : batcher_flush(&faces->batcher, why);
}
