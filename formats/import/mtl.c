/* SPDX-License-Identifier: MIT */
#include "formats/import/mtl.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/import/colour.h"
#include "formats/import/import.h"
#include "formats/import/number.h"
#include "formats/import/source.h"

#define LINE_BYTES_MAX MIB

static const struct mtl_material grey = {
	.colour = IMPORT_COLOUR_DEFAULT,
	.map = { .texture = TEXTURE_NONE, .scale = { 1, 1 } },
};

void mtl_init(struct mtl *mtl, struct textures *textures, uint64_t bytes_max)
{
	*mtl = (struct mtl){ .textures = textures };
	names_init(&mtl->names, bytes_max);
}

void mtl_done(struct mtl *mtl)
{
	names_done(&mtl->names);
	free(mtl->materials);
	mtl->materials = NULL;
}

struct mtl_material mtl_material(const struct mtl *mtl, const char *name)
{
	uint32_t number = names_find(&mtl->names, name);

	return number == UINT32_MAX ? grey : mtl->materials[number];
}

static int add_material(struct mtl *mtl, const char *name, uint32_t *ret_number, struct why *why)
{
	int r = names_add(&mtl->names, name, ret_number, why);

	if (r < 0)
		return r;
	if (*ret_number >= mtl->capacity) {
		uint32_t capacity = mtl->capacity ? 2 * mtl->capacity : 64;
		struct mtl_material *materials =
			realloc(mtl->materials, capacity * sizeof(*materials));

		if (!materials)
			return why_set(why, -ENOMEM, "no memory for its materials");
		mtl->materials = materials;
		mtl->capacity = capacity;
	}
	mtl->materials[*ret_number] = grey;
	return 0;
}

/* What stands behind a keyword: "" where it is another one. */
static const char *behind(const char *line, const char *keyword)
{
	size_t length = strlen(keyword);

	if (strncmp(line, keyword, length) != 0 || !source_is_blank((uint8_t)line[length]))
		return NULL;
	line += length;
	while (source_is_blank((uint8_t)*line))
		line++;
	return line;
}

/* Up to three numbers; the rest stay as they are. */
static void take_numbers(const char *text, double *numbers, int count)
{
	for (int i = 0; i < count && text; i++) {
		while (source_is_blank((uint8_t)*text))
			text++;
		text = number_to_double(text, &numbers[i]);
	}
}

/* ---- images ---- */

/* Passes over a word and the blanks behind it. */
static const char *behind_word(const char *text)
{
	while (*text && !source_is_blank((uint8_t)*text))
		text++;
	while (source_is_blank((uint8_t)*text))
		text++;
	return text;
}

/* Passes over up to three numbers; the first two are kept. */
static const char *take_vector(const char *text, float vector[2])
{
	double number;
	const char *end;

	for (int i = 0; i < 3; i++) {
		end = number_to_double(text, &number);
		/* "3d.png" begins with a number, but is none. */
		if (!end || !source_is_blank((uint8_t)*end))
			break;
		if (i < 2)
			vector[i] = (float)number;
		text = behind_word(text);
	}
	return text;
}

/* Takes the options before an image's name.  Returns the name, which may have blanks. */
static const char *take_map_options(const char *text, struct texture_map *map)
{
	static const struct {
		const char *name;
		int word_count;
	} others[] = {
		{ "-blendu", 1 }, { "-blendv", 1 },     { "-bm", 1 },      { "-boost", 1 },
		{ "-cc", 1 },     { "-colorspace", 1 }, { "-imfchan", 1 }, { "-mm", 2 },
		{ "-texres", 1 }, { "-type", 1 },
	};
	const char *rest, *before;
	float ignored[2];

	do {
		before = text;
		if ((rest = behind(text, "-s")))
			text = take_vector(rest, map->scale);
		else if ((rest = behind(text, "-o")))
			text = take_vector(rest, map->offset);
		else if ((rest = behind(text, "-t")))
			text = take_vector(rest, ignored);
		else if ((rest = behind(text, "-clamp"))) {
			map->clamped = strncmp(rest, "on", 2) == 0;
			text = behind_word(rest);
		}
		for (size_t i = 0; i < ARRAY_LENGTH(others) && text == before; i++) {
			rest = behind(text, others[i].name);
			for (int k = 0; rest && k < others[i].word_count; k++)
				rest = behind_word(rest);
			text = rest ? rest : text;
		}
	} while (text != before);
	return text;
}

/* The image's path from that of the library; folders of another machine are forgiven. */
static int find_image(const char *library, const char *name, char **ret)
{
	const char *slash = strrchr(library, '/');
	int folder_length = slash ? (int)(slash - library) + 1 : 0;
	int before_length = name[0] == '/' ? 0 : folder_length;
	const char *last;
	char *path;

	if (asprintf(&path, "%.*s%s", before_length, library, name) < 0)
		return -ENOMEM;
	for (char *at = path + before_length; *at; at++)
		if (*at == '\\')
			*at = '/';
	last = strrchr(path + before_length, '/');
	if (last && access(path, F_OK) < 0) {
		char *beside;

		if (asprintf(&beside, "%.*s%s", folder_length, library, last + 1) < 0) {
			free(path);
			return -ENOMEM;
		}
		free(path);
		path = beside;
	}
	*ret = path;
	return 0;
}

/* "map_Kd -s 2 2 1 wood grain.png". */
static int take_map(struct mtl *mtl, const char *library, const char *text, struct texture_map *ret,
		    struct why *why)
{
	struct texture_map map = { .scale = { 1, 1 } };
	const char *name = take_map_options(text, &map);
	char *path;
	int r;

	if (!mtl->textures || *name == '\0')
		return 0;
	if (find_image(library, name, &path) < 0)
		return why_set(why, -ENOMEM, "no memory for a path");
	r = textures_add(mtl->textures, path, &map.texture, why);
	free(path);
	if (r == 0)
		*ret = map;
	return r;
}

/* ---- lines ---- */

/* "Kd r g b"; "Kd grey" is allowed; "Kd spectral" and "Kd xyz" are not read. */
static void take_diffuse(const char *text, uint32_t *colour)
{
	double rgb[3] = { NAN, NAN, NAN };

	take_numbers(text, rgb, 3);
	if (rgb[0] != rgb[0])
		return;
	*colour = (*colour & UINT32_C(0xff000000)) |
		  (colour_from_rgb(rgb[0], rgb[1] == rgb[1] ? rgb[1] : rgb[0],
				   rgb[2] == rgb[2] ? rgb[2] : rgb[0]) &
		   UINT32_C(0x00ffffff));
}

/* A library that is being read. */
struct reading {
	struct mtl *mtl;
	const char *path;
	uint32_t current; /* material; UINT32_MAX: none yet */
};

/* One line, whose end is a zero; faults in it are nothing to stop for. */
static int take_line(struct reading *reading, const char *line, struct why *why)
{
	struct mtl_material *material;
	const char *rest;

	while (source_is_blank((uint8_t)*line))
		line++;
	rest = behind(line, "newmtl");
	if (rest)
		return add_material(reading->mtl, rest, &reading->current, why);
	if (reading->current == UINT32_MAX)
		return 0;
	material = &reading->mtl->materials[reading->current];
	if ((rest = behind(line, "Kd"))) {
		take_diffuse(rest, &material->colour);
	} else if ((rest = behind(line, "d"))) {
		double opacity = 1.0;

		take_numbers(rest, &opacity, 1);
		material->colour = colour_with_opacity(material->colour, opacity);
	} else if ((rest = behind(line, "map_Kd"))) {
		return take_map(reading->mtl, reading->path, rest, &material->map, why);
	}
	return 0;
}

int mtl_read(struct mtl *mtl, const char *path, struct why *why)
{
	struct reading reading = { .mtl = mtl, .path = path, .current = UINT32_MAX };
	struct source *source;
	const char *text;
	size_t length;
	int r = source_open(path, LINE_BYTES_MAX, NULL, NULL, &source, why);

	if (r < 0)
		return r;
	while ((r = source_line(source, &text, &length, why)) > 0) {
		char *line;

		while (length > 0 && source_is_blank((uint8_t)text[length - 1]))
			length--;
		line = strndup(text, length);
		if (!line) {
			r = why_set(why, -ENOMEM, "no memory for its materials");
			break;
		}
		r = take_line(&reading, line, why);
		free(line);
		if (r < 0)
			break;
	}
	source_close(source);
	return r;
}
