/* SPDX-License-Identifier: MIT */
#include <endian.h>
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/import/faces.h"
#include "formats/import/ply_header.h"

/* Rows of vertices that are made at a time. */
#define ROWS_MAX 1024u

enum ply_role {
	ROLE_NONE,
	ROLE_POSITION,
	ROLE_NORMAL,
	ROLE_COLOUR,
};

/* What becomes of one property of a vertex. */
struct ply_field {
	enum ply_role role;
	uint32_t axis; /* 0 to 2; of a colour 0 to 3 */
};

struct ply {
	struct import_job *job;
	struct source *source;
	struct ply_header header;
	struct faces *faces;
	uint32_t part;
};

static uint16_t load16(const uint8_t *bytes, bool big)
{
	uint16_t value;

	memcpy(&value, bytes, sizeof(value));
	return big ? be16toh(value) : value;
}

static uint32_t load32(const uint8_t *bytes, bool big)
{
	uint32_t value;

	memcpy(&value, bytes, sizeof(value));
	return big ? be32toh(value) : value;
}

static uint64_t load64(const uint8_t *bytes, bool big)
{
	uint64_t value;

	memcpy(&value, bytes, sizeof(value));
	return big ? be64toh(value) : value;
}

/* A binary value; a double holds each of the types exactly. */
static double load_value(const uint8_t *bytes, enum ply_type type, bool big)
{
	union {
		uint32_t u32;
		uint64_t u64;
		float f32;
		double f64;
	} bits;

	switch (type) {
	case PLY_INT8:
		return (int8_t)*bytes;
	case PLY_UINT8:
		return *bytes;
	case PLY_INT16:
		return (int16_t)load16(bytes, big);
	case PLY_UINT16:
		return load16(bytes, big);
	case PLY_INT32:
		return (int32_t)load32(bytes, big);
	case PLY_UINT32:
		return load32(bytes, big);
	case PLY_FLOAT:
		bits.u32 = load32(bytes, big);
		return bits.f32;
	case PLY_DOUBLE:
		bits.u64 = load64(bytes, big);
		return bits.f64;
	case PLY_NONE:
	case PLY_TYPE_COUNT_:
		break;
	}
	return 0.0;
}

/* Takes the next value of a row. */
static int take_value(struct ply *ply, enum ply_type type, double *ret, struct why *why)
{
	struct source *source = ply->source;
	int r;

	if (ply->header.encoding == PLY_ASCII) {
		float single;

		if (type != PLY_FLOAT)
			return source_double(source, ret, why);
		r = source_float(source, &single, why);
		*ret = single;
		return r;
	}
	r = source_need(source, ply_type_bytes[type], why);
	if (r < 0)
		return r;
	*ret = load_value(source->at, type, ply->header.encoding == PLY_BIG_ENDIAN);
	source->at += ply_type_bytes[type];
	return 0;
}

/* Takes a list's count. */
static int take_count(struct ply *ply, const struct ply_property *property, uint64_t *ret,
		      struct why *why)
{
	uint64_t value_bytes =
		ply->header.encoding == PLY_ASCII ? 2 : ply_type_bytes[property->type];
	double count = 0.0;
	int r = take_value(ply, property->count_type, &count, why);

	if (r < 0)
		return r;
	if (!(count >= 0.0) || count > UINT32_MAX || count != floor(count))
		return why_set(why, -EUCLEAN, "a list of %.0f values, near byte %llu", count,
			       (unsigned long long)source_offset(ply->source));
	*ret = (uint64_t)count;
	if (*ret > (source_rest_max(ply->source) + 1) / value_bytes)
		return why_set(why, -ENODATA, "a list of %.0f values near byte %llu, where it ends",
			       count, (unsigned long long)source_offset(ply->source));
	return 0;
}

static int skip_property(struct ply *ply, const struct ply_property *property, struct why *why)
{
	uint64_t count = 1;
	int r;

	if (property->count_type != PLY_NONE) {
		r = take_count(ply, property, &count, why);
		if (r < 0)
			return r;
	}
	if (ply->header.encoding != PLY_ASCII)
		return source_skip(ply->source, count * ply_type_bytes[property->type], why);
	for (; count > 0; count--) {
		double value;

		r = source_double(ply->source, &value, why);
		if (r < 0)
			return r;
	}
	return 0;
}

/* ---- vertices ---- */

static struct ply_field field_of_property(const struct ply_property *property)
{
	static const struct {
		const char *name;
		struct ply_field field;
	} fields[] = {
		{ "x", { ROLE_POSITION, 0 } },
		{ "y", { ROLE_POSITION, 1 } },
		{ "z", { ROLE_POSITION, 2 } },
		{ "nx", { ROLE_NORMAL, 0 } },
		{ "ny", { ROLE_NORMAL, 1 } },
		{ "nz", { ROLE_NORMAL, 2 } },
		{ "red", { ROLE_COLOUR, 0 } },
		{ "green", { ROLE_COLOUR, 1 } },
		{ "blue", { ROLE_COLOUR, 2 } },
		{ "alpha", { ROLE_COLOUR, 3 } },
		{ "r", { ROLE_COLOUR, 0 } },
		{ "g", { ROLE_COLOUR, 1 } },
		{ "b", { ROLE_COLOUR, 2 } },
		{ "diffuse_red", { ROLE_COLOUR, 0 } },
		{ "diffuse_green", { ROLE_COLOUR, 1 } },
		{ "diffuse_blue", { ROLE_COLOUR, 2 } },
	};

	if (property->count_type == PLY_NONE)
		for (size_t i = 0; i < ARRAY_LENGTH(fields); i++)
			if (strcmp(fields[i].name, property->name) == 0)
				return fields[i].field;
	return (struct ply_field){ ROLE_NONE, 0 };
}

/* Does the element have a property for each of three axes? */
static bool has_axes(const struct ply_element *element, enum ply_role role)
{
	bool found[4] = { false, false, false, false };

	for (uint32_t i = 0; i < element->property_count; i++) {
		struct ply_field field = field_of_property(&element->properties[i]);

		if (field.role == role)
			found[field.axis] = true;
	}
	return found[0] && found[1] && found[2];
}

static uint8_t colour_byte(double value, enum ply_type type)
{
	if (type == PLY_FLOAT || type == PLY_DOUBLE)
		value *= 255.0;
	else if (type == PLY_UINT16)
		value /= 257.0;
	if (!(value > 0.0))
		return 0;
	return value >= 255.0 ? 255 : (uint8_t)(value + 0.5);
}

/* Writes one value where the record has its place. */
static void store_field(const struct faces *faces, const struct ply_property *property,
			struct ply_field field, double value, uint8_t *record)
{
	float single = (float)value;

	switch (field.role) {
	case ROLE_NONE:
		break;
	case ROLE_POSITION:
		if (faces->layout.positions_double)
			memcpy(record + 8 * field.axis, &value, 8);
		else
			memcpy(record + 4 * field.axis, &single, 4);
		break;
	case ROLE_NORMAL:
		if (faces->layout.normals)
			memcpy(record + faces->normal_offset + 4 * field.axis, &single, 4);
		break;
	case ROLE_COLOUR:
		if (faces->layout.colours)
			record[faces->colour_offset + field.axis] =
				colour_byte(value, property->type);
		break;
	}
}

/* One row in any encoding, value by value. */
static int take_vertex(struct ply *ply, const struct ply_element *element,
		       const struct ply_field *fields, uint8_t *record, struct why *why)
{
	for (uint32_t i = 0; i < element->property_count; i++) {
		const struct ply_property *property = &element->properties[i];
		double value;
		int r;

		if (fields[i].role == ROLE_NONE) {
			r = skip_property(ply, property, why);
			if (r < 0)
				return r;
			continue;
		}
		r = take_value(ply, property->type, &value, why);
		if (r < 0)
			return r;
		store_field(ply->faces, property, fields[i], value, record);
	}
	return 0;
}

static int take_vertices(struct ply *ply, const struct ply_element *element, struct why *why)
{
	struct faces *faces = ply->faces;
	uint32_t record_bytes = faces->vertices.record_bytes;
	struct ply_field fields[PLY_PROPERTIES_MAX];
	uint8_t *records = calloc(ROWS_MAX, record_bytes);
	int r = 0;

	if (!records)
		return why_set(why, -ENOMEM, "no memory for vertices");
	for (uint32_t i = 0; i < element->property_count; i++)
		fields[i] = field_of_property(&element->properties[i]);
	if (faces->layout.colours)
		for (uint32_t i = 0; i < ROWS_MAX; i++)
			records[i * record_bytes + faces->colour_offset + 3] = 255;
	for (uint64_t done = 0; done < element->count && r == 0;) {
		uint32_t rows = (uint32_t)u64_min(element->count - done, ROWS_MAX);

		for (uint32_t i = 0; i < rows && r == 0; i++)
			r = take_vertex(ply, element, fields, records + i * record_bytes, why);
		if (r == 0)
			r = faces_add_vertices(faces, records, rows, why);
		done += rows;
	}
	free(records);
	return r;
}

/* Are the rows of the file the records that are kept, byte for byte? */
static bool vertices_are_records(const struct ply *ply, const struct ply_element *element)
{
	const struct faces_layout *layout = &ply->faces->layout;

	if (ply->header.encoding != PLY_LITTLE_ENDIAN || element->has_list || layout->colours ||
	    element->property_count != (layout->normals ? 6u : 3u))
		return false;
	for (uint32_t i = 0; i < element->property_count; i++) {
		struct ply_field field = field_of_property(&element->properties[i]);
		bool normal = i >= 3;

		if (field.role != (normal ? ROLE_NORMAL : ROLE_POSITION) || field.axis != i % 3 ||
		    element->properties[i].type !=
			    (layout->positions_double && !normal ? PLY_DOUBLE : PLY_FLOAT))
			return false;
	}
	return true;
}

static int take_vertex_records(struct ply *ply, const struct ply_element *element, struct why *why)
{
	struct source *source = ply->source;
	uint32_t row_bytes = ply->faces->vertices.record_bytes;

	for (uint64_t done = 0; done < element->count;) {
		uint64_t rows;
		int r = source_need(source, row_bytes, why);

		if (r < 0)
			return r;
		rows = u64_min((uint64_t)(source->end - source->at) / row_bytes,
			       element->count - done);
		r = faces_add_vertices(ply->faces, source->at, rows, why);
		if (r < 0)
			return r;
		source->at += rows * row_bytes;
		done += rows;
	}
	return 0;
}

/* ---- faces ---- */

static int take_list(struct ply *ply, const struct ply_property *property, uint64_t count,
		     struct why *why)
{
	int r = faces_reserve(ply->faces, count, why);

	if (r < 0)
		return r;
	for (uint64_t i = 0; i < count; i++) {
		double value;

		r = take_value(ply, property->type, &value, why);
		if (r < 0)
			return r;
		/* What is no whole number in reach becomes one that no table has. */
		ply->faces->face_vertices[i] =
			value >= 0.0 && value <= UINT32_MAX ? (uint64_t)value : FACES_NONE;
	}
	return 0;
}

static int take_face(struct ply *ply, const struct ply_element *element, uint32_t list,
		     struct why *why)
{
	struct face face = { .part = ply->part };

	for (uint32_t i = 0; i < element->property_count; i++) {
		const struct ply_property *property = &element->properties[i];
		uint64_t count;
		int r;

		if (i != list) {
			r = skip_property(ply, property, why);
			if (r < 0)
				return r;
			continue;
		}
		r = take_count(ply, property, &count, why);
		if (r == 0)
			r = take_list(ply, property, count, why);
		if (r < 0)
			return r;
		face.corner_count = (uint32_t)count;
	}
	return faces_add_face(ply->faces, &face, why);
}

/* Rows of "list uchar int vertex_indices" and nothing else: the usual ones, and most of the time. */
static bool faces_are_usual(const struct ply *ply, const struct ply_element *element)
{
	const struct ply_property *property = &element->properties[0];

	return ply->header.encoding == PLY_LITTLE_ENDIAN && element->property_count == 1 &&
	       (property->count_type == PLY_UINT8 || property->count_type == PLY_INT8) &&
	       (property->type == PLY_INT32 || property->type == PLY_UINT32);
}

/* Takes usual triangles for as long as they are whole in the window. */
static int take_usual_triangles(struct ply *ply, uint64_t count_max, uint64_t *ret_count,
				struct why *why)
{
	struct source *source = ply->source;
	const uint8_t *at = source->at;
	uint64_t rows = u64_min((uint64_t)(source->end - at) / 13, count_max);
	uint64_t i;

	for (i = 0; i < rows && *at == 3; i++, at += 13) {
		uint32_t indices[3];
		int r;

		memcpy(indices, at + 1, sizeof(indices));
		r = faces_add_triangle(ply->faces, ply->part,
				       (uint64_t[3]){ indices[0], indices[1], indices[2] }, why);
		if (r < 0)
			return r;
	}
	source->at = at;
	*ret_count = i;
	return 0;
}

static int take_faces(struct ply *ply, const struct ply_element *element, uint32_t list,
		      struct why *why)
{
	bool usual = faces_are_usual(ply, element);

	for (uint64_t done = 0; done < element->count;) {
		uint64_t taken = 0;
		int r = 0;

		if (usual)
			r = take_usual_triangles(ply, element->count - done, &taken, why);
		if (r == 0 && taken == 0) {
			r = take_face(ply, element, list, why);
			taken = 1;
		}
		if (r < 0)
			return r;
		done += taken;
	}
	return 0;
}

/* A strip as long as the model; -1 begins another one.  Every second triangle is turned round. */
static int take_strip(struct ply *ply, const struct ply_property *property, struct why *why)
{
	uint64_t corners[3] = { 0, 0, 0 };
	uint64_t count, run = 0;
	int r = take_count(ply, property, &count, why);

	if (r < 0)
		return r;
	for (; count > 0; count--) {
		double value;

		r = take_value(ply, property->type, &value, why);
		if (r < 0)
			return r;
		if (value == -1.0) {
			run = 0;
			continue;
		}
		corners[0] = corners[1];
		corners[1] = corners[2];
		corners[2] = value >= 0.0 && value <= UINT32_MAX ? (uint64_t)value : FACES_NONE;
		if (++run < 3)
			continue;
		r = faces_add_triangle(
			ply->faces, ply->part,
			run & 1 ? (uint64_t[3]){ corners[0], corners[1], corners[2] }
				: (uint64_t[3]){ corners[1], corners[0], corners[2] },
			why);
		if (r < 0)
			return r;
	}
	return 0;
}

static int take_strips(struct ply *ply, const struct ply_element *element, uint32_t list,
		       struct why *why)
{
	for (uint64_t row = 0; row < element->count; row++) {
		for (uint32_t i = 0; i < element->property_count; i++) {
			const struct ply_property *property = &element->properties[i];
			int r = i == list ? take_strip(ply, property, why)
					  : skip_property(ply, property, why);

			if (r < 0)
				return r;
		}
	}
	return 0;
}

/* ---- the file ---- */

static int skip_element(struct ply *ply, const struct ply_element *element, struct why *why)
{
	if (element->property_count == 0)
		return 0;
	if (ply->header.encoding != PLY_ASCII && !element->has_list)
		return source_skip(ply->source, element->count * element->row_bytes_min, why);
	for (uint64_t row = 0; row < element->count; row++) {
		for (uint32_t i = 0; i < element->property_count; i++) {
			int r = skip_property(ply, &element->properties[i], why);

			if (r < 0)
				return r;
		}
	}
	return 0;
}

static uint32_t find_indices(const struct ply_element *element)
{
	uint32_t list = ply_element_find(element, "vertex_indices");

	if (list == UINT32_MAX)
		list = ply_element_find(element, "vertex_index");
	if (list == UINT32_MAX || element->properties[list].count_type == PLY_NONE ||
	    element->properties[list].type >= PLY_FLOAT)
		return UINT32_MAX;
	return list;
}

/* Do faces come before the vertices that they point at? */
static bool faces_come_first(const struct ply_header *header)
{
	bool faces_seen = false;

	for (uint32_t i = 0; i < header->element_count; i++) {
		if (find_indices(&header->elements[i]) != UINT32_MAX)
			faces_seen = true;
		else if (faces_seen && strcmp(header->elements[i].name, "vertex") == 0)
			return true;
	}
	return false;
}

/* Makes room as the vertices want it. */
static int ply_prepare(struct ply *ply, struct why *why)
{
	const struct import_part part = { .colour = IMPORT_COLOUR_DEFAULT };
	const struct ply_element *vertices = NULL;
	struct faces_layout layout = { 0 };
	int r;

	for (uint32_t i = 0; i < ply->header.element_count; i++)
		if (strcmp(ply->header.elements[i].name, "vertex") == 0)
			vertices = &ply->header.elements[i];
	if (!vertices || !has_axes(vertices, ROLE_POSITION))
		return why_set(why, -EUCLEAN, "it has no vertices with x, y and z");
	for (uint32_t i = 0; i < vertices->property_count; i++)
		if (field_of_property(&vertices->properties[i]).role == ROLE_POSITION &&
		    vertices->properties[i].type != PLY_FLOAT)
			layout.positions_double = true;
	layout.normals = has_axes(vertices, ROLE_NORMAL);
	layout.colours = has_axes(vertices, ROLE_COLOUR) &&
			 ply->job->options->colour <= IMPORT_COLOUR_VERTEX;
	r = faces_create(ply->job, &layout, &ply->faces, why);
	if (r < 0)
		return r;
	ply->faces->colours_present = layout.colours;
	if (faces_come_first(&ply->header))
		r = faces_defer(ply->faces, why);
	if (r == 0)
		r = faces_expect_vertices(ply->faces, vertices->count, why);
	if (r == 0)
		r = faces_part(ply->faces, &part, NULL, &ply->part, why);
	return r;
}

static int take_element(struct ply *ply, const struct ply_element *element, struct why *why)
{
	uint32_t list = find_indices(element);

	if (strcmp(element->name, "vertex") == 0)
		return vertices_are_records(ply, element) ? take_vertex_records(ply, element, why)
							  : take_vertices(ply, element, why);
	if (strcmp(element->name, "face") == 0 && list != UINT32_MAX)
		return take_faces(ply, element, list, why);
	if (strcmp(element->name, "tristrips") == 0 && list != UINT32_MAX)
		return take_strips(ply, element, list, why);
	return skip_element(ply, element, why);
}

int ply_import(struct import_job *job, struct why *why)
{
	struct ply ply = { .job = job, .source = job->source };
	int r = ply_header_read(job->source, &ply.header, why);

	job->info->unit_metres = ply.header.unit_metres;
	job->info->up_axis = ply.header.up_axis;
	if (r == 0)
		r = ply_prepare(&ply, why);
	for (uint32_t i = 0; i < ply.header.element_count && r == 0; i++)
		r = take_element(&ply, &ply.header.elements[i], why);
	if (r == 0)
		r = faces_finish(ply.faces, why);
	faces_destroy(ply.faces);
	ply_header_done(&ply.header);
	return r;
}
