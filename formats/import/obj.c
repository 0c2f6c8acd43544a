/* SPDX-License-Identifier: MIT */
/*
 * Wavefront OBJ: polygons, their normals, texture coordinates, groups and materials; lines, points
 * and curves are passed over.  Source: Alias|Wavefront, "Advanced Visualizer Manual", appendix B1,
 * 1995.  Coordinates are read as doubles: the format does not say, and surveys need it.
 */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/import/colour.h"
#include "formats/import/faces.h"
#include "formats/import/mtl.h"
#include "formats/import/number.h"

#define NAME_BYTES 1024u
/* As long as a line without "\" may be. */
#define JOINED_BYTES_MAX (4 * MIB)

struct obj {
	struct import_job *job;
	struct source *source;
	struct faces *faces;
	struct textures textures;
	struct mtl mtl;
	bool has_vertices;

	char object[NAME_BYTES];
	char group[NAME_BYTES];
	char material[NAME_BYTES];
	struct names part_names; /* object, group and material: the number is the part's */
	uint32_t part;
	bool part_stale; /* a name has changed since part was looked up */

	char *joined; /* a line that goes on behind "\" */
	size_t joined_length;
	size_t joined_capacity;
};

static int line_fault(const struct obj *obj, struct why *why, const char *what)
{
	return why_set(why, -EUCLEAN, "line %llu: %s", (unsigned long long)obj->source->line, what);
}

static inline bool is_gap(char c)
{
	return c == ' ' || c == '\t' || c == '\r';
}

static inline const char *skip_gaps(const char *at)
{
	while (is_gap(*at))
		at++;
	return at;
}

/* ---- vertices ---- */

/* "v x y z", "v x y z w" or "v x y z r g b". */
static int take_vertex(struct obj *obj, const char *at, struct why *why)
{
	struct {
		double position[3];
		uint32_t colour;
	} record = { .colour = 0 };
	double rgb[3];
	int rgb_count = 0;

	for (int k = 0; k < 3; k++) {
		at = number_to_double(skip_gaps(at), &record.position[k]);
		if (!at)
			return line_fault(obj, why, "three numbers are wanted behind \"v\"");
	}
	at = skip_gaps(at);
	while (*at != '\n' && *at != '\0' && rgb_count < 3) {
		at = number_to_double(at, &rgb[rgb_count]);
		if (!at)
			return line_fault(obj, why, "a number is wanted");
		at = skip_gaps(at);
		rgb_count++;
	}
	obj->has_vertices = true;
	if (!obj->faces->layout.colours)
		return faces_add_vertices(obj->faces, &record, 1, why);
	if (rgb_count == 3) {
		/* Most say 0 to 1, some 0 to 255. */
		double scale = rgb[0] > 1.0 || rgb[1] > 1.0 || rgb[2] > 1.0 ? 1.0 / 255.0 : 1.0;

		record.colour = colour_from_rgb(rgb[0] * scale, rgb[1] * scale, rgb[2] * scale);
		obj->faces->colours_present = true;
	}
	return faces_add_vertices(obj->faces, &record, 1, why);
}

static int take_normal(struct obj *obj, const char *at, struct why *why)
{
	float normal[3];

	for (int k = 0; k < 3; k++) {
		at = number_to_float(skip_gaps(at), &normal[k]);
		if (!at)
			return line_fault(obj, why, "three numbers are wanted behind \"vn\"");
	}
	return faces_add_normal(obj->faces, normal, why);
}

/* "vt u", "vt u v" or "vt u v w". */
static int take_coordinate(struct obj *obj, const char *at, struct why *why)
{
	float coordinate[2] = { 0 };

	for (int k = 0; k < 2; k++) {
		at = skip_gaps(at);
		if (k > 0 && (*at == '\n' || *at == '\0'))
			break;
		at = number_to_float(at, &coordinate[k]);
		if (!at)
			return line_fault(obj, why, "numbers are wanted behind \"vt\"");
	}
	return faces_add_coordinate(obj->faces, coordinate, why);
}

/* ---- names, parts, materials ---- */

static void take_name(char *to, const char *from, size_t length)
{
	while (length > 0 && is_gap(*from)) {
		from++;
		length--;
	}
	while (length > 0 && is_gap(from[length - 1]))
		length--;
	if (length >= NAME_BYTES)
		length = NAME_BYTES - 1;
	memcpy(to, from, length);
	to[length] = '\0';
}

/* The material's colour and image for a new part; an image that cannot be read is left out. */
static int find_material(struct obj *obj, struct mtl_material *ret, struct why *why)
{
	int r;

	*ret = mtl_material(&obj->mtl, obj->material);
	if (ret->map.texture == TEXTURE_NONE)
		return 0;
	r = textures_need(&obj->textures, ret->map.texture, why);
	if (r == 0)
		ret->map.texture = TEXTURE_NONE;
	return r < 0 ? r : 0;
}

/* Makes obj->part that of the names in force.  Names that come back find their part again. */
static int find_part(struct obj *obj, struct why *why)
{
	char key[3 * NAME_BYTES], scene_path[2 * NAME_BYTES];
	struct import_part part = {
		.name = obj->group[0] ? obj->group : obj->object,
		.scene_path = scene_path,
		.material = obj->material,
	};
	struct mtl_material material;
	uint32_t number;
	int r;

	(void)snprintf(key, sizeof(key), "%s\n%s\n%s", obj->object, obj->group, obj->material);
	(void)snprintf(scene_path, sizeof(scene_path), "%s%s%s", obj->object,
		       obj->object[0] && obj->group[0] ? "/" : "", obj->group);
	number = names_find(&obj->part_names, key);
	if (number == UINT32_MAX) {
		r = names_add(&obj->part_names, key, &number, why);
		if (r == 0)
			r = find_material(obj, &material, why);
		if (r < 0)
			return r;
		part.colour = material.colour;
		r = faces_part(obj->faces, &part, &material.map, &number, why);
		if (r < 0)
			return r;
	}
	obj->part = number;
	obj->part_stale = false;
	return 0;
}

/* Reads the library beside the model; backslashes and folders of another machine are forgiven. */
static int read_library(struct obj *obj, char *name, struct why *why)
{
	const char *slash = strrchr(obj->job->path, '/');
	int folder_length = slash ? (int)(slash - obj->job->path) + 1 : 0;
	const char *tries[2];
	struct why library_why;
	int r = -ENOENT;

	for (char *at = name; *at; at++)
		if (*at == '\\')
			*at = '/';
	tries[0] = name;
	tries[1] = strrchr(name, '/') ? strrchr(name, '/') + 1 : name;
	for (int i = 0; i < 2 && r < 0 && r != -ENOMEM; i++) {
		char *path = NULL;

		if (asprintf(&path, "%.*s%s", tries[i][0] == '/' ? 0 : folder_length,
			     obj->job->path, tries[i]) < 0)
			return why_set(why, -ENOMEM, "no memory for a path");
		r = mtl_read(&obj->mtl, path, &library_why);
		free(path);
	}
	if (r == -ENOMEM)
		return why_set(why, r, "%s", library_why.text);
	return r;
}

/* "mtllib": one name that may have blanks, or several.  What is missing is told, not an error. */
static int take_library(struct obj *obj, const char *at, size_t length, struct why *why)
{
	char names[NAME_BYTES], *save = NULL;
	int r;

	take_name(names, at, length);
	r = read_library(obj, names, why);
	if (r < 0 && r != -ENOMEM && strpbrk(names, " \t")) {
		r = 0;
		for (char *name = strtok_r(names, " \t", &save); name && r != -ENOMEM;
		     name = strtok_r(NULL, " \t", &save)) {
			int one = read_library(obj, name, why);

			r = one < 0 ? one : r;
		}
	}
	if (r == -ENOMEM)
		return r;
	if (r < 0)
		obj->job->info->missing_material_file = true;
	return 0;
}

/* ---- faces ---- */

/* 1 is the first, -1 the latest so far; others become one that no table has. */
static inline uint64_t resolve(int64_t index, uint64_t count)
{
	if (index > 0)
		return (uint64_t)index - 1;
	return index < 0 && (uint64_t)-index <= count ? count - (uint64_t)-index : FACES_NONE;
}

/* "v", "v/t", "v//n" or "v/t/n".  What is not there stays 0. */
static const char *take_corner(const char *at, int64_t *vertex, int64_t *texture, int64_t *normal)
{
	at = number_to_i64(at, vertex);
	if (!at || *at != '/')
		return at;
	at++;
	if (*at != '/') {
		const char *end = number_to_i64(at, texture);

		/* "1/" is written by some for "1". */
		at = end ? end : at;
	}
	if (*at != '/')
		return at;
	at++;
	return number_to_i64(at, normal);
}

static int take_face(struct obj *obj, const char *at, struct why *why)
{
	uint64_t vertex_count = faces_vertex_count(obj->faces);
	uint64_t normal_count = faces_normal_count(obj->faces);
	uint64_t coordinate_count = faces_coordinate_count(obj->faces);
	struct face face = { .normals = true, .textured = true };
	int r;

	for (at = skip_gaps(at); *at != '\n' && *at != '\0'; at = skip_gaps(at)) {
		int64_t vertex = 0, texture = 0, normal = 0;
		uint64_t coordinate;

		at = take_corner(at, &vertex, &texture, &normal);
		if (!at || (!is_gap(*at) && *at != '\n' && *at != '\0'))
			return line_fault(obj, why, "a corner of a face is wanted, such as 1/2/3");
		r = faces_reserve(obj->faces, face.corner_count + UINT64_C(1), why);
		if (r < 0) {
			why_prefix(why, "line %llu", (unsigned long long)obj->source->line);
			return r;
		}
		face.normals &= normal != 0;
		obj->faces->face_vertices[face.corner_count] = resolve(vertex, vertex_count);
		obj->faces->face_normals[face.corner_count] = resolve(normal, normal_count);
		/* Without an image they were never of use: a wrong one only means that. */
		coordinate = resolve(texture, coordinate_count);
		face.textured &= texture != 0 && coordinate < coordinate_count;
		obj->faces->face_coordinates[face.corner_count] = coordinate;
		face.corner_count++;
	}
	if (obj->part_stale) {
		r = find_part(obj, why);
		if (r < 0)
			return r;
	}
	face.part = obj->part;
	r = faces_add_face(obj->faces, &face, why);
	/* What the sink says is about itself, not about the line. */
	if (r == -EUCLEAN)
		why_prefix(why, "line %llu", (unsigned long long)obj->source->line);
	return r;
}

/* ---- lines ---- */

/* Does the line begin with the keyword?  Then what follows is at *ret. */
static bool is_keyword(const char *line, const char *keyword, const char **ret)
{
	size_t length = strlen(keyword);

	if (strncmp(line, keyword, length) != 0 || !is_gap(line[length]))
		return false;
	*ret = line + length;
	return true;
}

static int take_names_line(struct obj *obj, const char *line, const char *end, struct why *why)
{
	const char *rest;

	if (is_keyword(line, "o", &rest)) {
		take_name(obj->object, rest, (size_t)(end - rest));
		obj->group[0] = '\0';
	} else if (is_keyword(line, "g", &rest)) {
		take_name(obj->group, rest, (size_t)(end - rest));
	} else if (is_keyword(line, "usemtl", &rest)) {
		take_name(obj->material, rest, (size_t)(end - rest));
	} else if (is_keyword(line, "mtllib", &rest)) {
		return take_library(obj, rest, (size_t)(end - rest), why);
	} else {
		return 0;
	}
	obj->part_stale = true;
	return 0;
}

/* One whole line.  Words that are unknown are passed over: the format has many. */
static int take_line(struct obj *obj, const char *line, size_t length, struct why *why)
{
	const char *end = line + length;

	line = skip_gaps(line);
	if (*line == 'v') {
		if (is_gap(line[1]))
			return take_vertex(obj, line + 2, why);
		if (line[1] == 'n' && is_gap(line[2]))
			return take_normal(obj, line + 3, why);
		if (line[1] == 't' && is_gap(line[2]) && obj->faces->layout.texture_table)
			return take_coordinate(obj, line + 3, why);
		return 0;
	}
	if (*line == 'f' && (is_gap(line[1]) || line + 1 == end))
		return take_face(obj, line + 1, why);
	if (*line == '\0' && line < end)
		return line_fault(obj, why, "a zero byte: this is no text");
	return take_names_line(obj, line, end, why);
}

static int join_line(struct obj *obj, const char *line, size_t length, struct why *why)
{
	size_t wanted = obj->joined_length + length + 1;

	if (wanted > obj->joined_capacity) {
		size_t capacity = 2 * wanted;
		char *grown;

		if (capacity > JOINED_BYTES_MAX)
			return line_fault(obj, why, "a line that goes on for too long");
		grown = realloc(obj->joined, capacity);
		if (!grown)
			return why_set(why, -ENOMEM, "no memory for a long line");
		obj->joined = grown;
		obj->joined_capacity = capacity;
	}
	memcpy(obj->joined + obj->joined_length, line, length);
	obj->joined_length += length;
	obj->joined[obj->joined_length] = '\0';
	return 0;
}

/* Does the line end with "\", so that it goes on with the next?  Then its length is without it. */
static bool goes_on(const char *line, size_t *length)
{
	size_t bare_length = *length;

	if (bare_length > 0 && line[bare_length - 1] == '\r')
		bare_length--;
	if (bare_length == 0 || line[bare_length - 1] != '\\')
		return false;
	*length = bare_length - 1;
	return true;
}

static int take_lines(struct obj *obj, struct why *why)
{
	const char *line;
	size_t length;
	int r;

	while ((r = source_line(obj->source, &line, &length, why)) > 0) {
		bool more = goes_on(line, &length);

		if (!more && obj->joined_length == 0) {
			r = take_line(obj, line, length, why);
			if (r < 0)
				return r;
			continue;
		}
		r = join_line(obj, line, length, why);
		if (r == 0 && more)
			r = join_line(obj, " ", 1, why);
		if (r == 0 && !more) {
			r = take_line(obj, obj->joined, obj->joined_length, why);
			obj->joined_length = 0;
		}
		if (r < 0)
			return r;
	}
	if (r == 0 && obj->joined_length > 0)
		r = why_set(why, -ENODATA, "line %llu: it ends where the line should go on",
			    (unsigned long long)obj->source->line);
	return r;
}

static int obj_prepare(struct obj *obj, struct why *why)
{
	bool textured = obj->job->options->colour == IMPORT_COLOUR_TEXTURE;
	uint64_t memory_bytes = obj->job->memory_bytes;
	const struct faces_layout layout = {
		.positions_double = true,
		.colours = obj->job->options->colour <= IMPORT_COLOUR_VERTEX,
		.normal_table = true,
		.texture_table = textured,
	};
	int r;

	/* A quarter of the memory for names, one for images; the vertices have the rest. */
	textures_init(&obj->textures, memory_bytes / 4);
	mtl_init(&obj->mtl, textured ? &obj->textures : NULL, memory_bytes / 8);
	names_init(&obj->part_names, memory_bytes / 8);
	obj->job->memory_bytes -= memory_bytes / 4 * (textured ? 2 : 1);
	obj->part_stale = true;
	r = faces_create(obj->job, &layout, &obj->faces, why);
	if (r == 0)
		obj->faces->textures = &obj->textures;
	return r;
}

int obj_import(struct import_job *job, struct why *why)
{
	struct obj *obj = calloc(1, sizeof(*obj));
	int r;

	if (!obj)
		return why_set(why, -ENOMEM, "no memory to read it");
	obj->job = job;
	obj->source = job->source;
	r = obj_prepare(obj, why);
	if (r == 0)
		r = take_lines(obj, why);
	if (r == 0 && !obj->has_vertices)
		r = why_set(why, -EUCLEAN, "it is no OBJ file: it has no vertices");
	if (r == 0)
		r = faces_finish(obj->faces, why);
	job->info->missing_texture_count = obj->textures.unreadable_count;
	faces_destroy(obj->faces);
	textures_done(&obj->textures);
	mtl_done(&obj->mtl);
	names_done(&obj->part_names);
	free(obj->joined);
	free(obj);
	return r;
}
