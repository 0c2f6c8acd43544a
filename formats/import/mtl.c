/* SPDX-License-Identifier: MIT */
#include "formats/import/mtl.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/import/colour.h"
#include "formats/import/import.h"
#include "formats/import/number.h"
#include "formats/import/source.h"

#define LINE_BYTES_MAX MIB

void mtl_init(struct mtl *mtl, uint64_t bytes_max)
{
	*mtl = (struct mtl){ 0 };
	names_init(&mtl->names, bytes_max);
}

void mtl_done(struct mtl *mtl)
{
	names_done(&mtl->names);
	free(mtl->colours);
	mtl->colours = NULL;
}

uint32_t mtl_colour(const struct mtl *mtl, const char *name)
{
	uint32_t number = names_find(&mtl->names, name);

	return number == UINT32_MAX ? IMPORT_COLOUR_DEFAULT : mtl->colours[number];
}

static int add_material(struct mtl *mtl, const char *name, uint32_t *ret_number, struct why *why)
{
	int r = names_add(&mtl->names, name, ret_number, why);

	if (r < 0)
		return r;
	if (*ret_number >= mtl->capacity) {
		uint32_t capacity = mtl->capacity ? 2 * mtl->capacity : 64;
		uint32_t *colours = realloc(mtl->colours, capacity * sizeof(*colours));

		if (!colours)
			return why_set(why, -ENOMEM, "no memory for its materials");
		mtl->colours = colours;
		mtl->capacity = capacity;
	}
	mtl->colours[*ret_number] = IMPORT_COLOUR_DEFAULT;
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

/* One line, whose end is a zero; faults in it are nothing to stop for. */
static int take_line(struct mtl *mtl, const char *line, uint32_t *current, struct why *why)
{
	const char *rest;

	while (source_is_blank((uint8_t)*line))
		line++;
	rest = behind(line, "newmtl");
	if (rest)
		return add_material(mtl, rest, current, why);
	if (*current == UINT32_MAX)
		return 0;
	rest = behind(line, "Kd");
	if (rest) {
		double rgb[3] = { NAN, NAN, NAN };

		take_numbers(rest, rgb, 3);
		/* "Kd grey" is allowed; "Kd spectral" and "Kd xyz" are not read. */
		if (rgb[0] == rgb[0])
			mtl->colours[*current] =
				(mtl->colours[*current] & UINT32_C(0xff000000)) |
				(colour_from_rgb(rgb[0], rgb[1] == rgb[1] ? rgb[1] : rgb[0],
						 rgb[2] == rgb[2] ? rgb[2] : rgb[0]) &
				 UINT32_C(0x00ffffff));
		return 0;
	}
	rest = behind(line, "d");
	if (rest) {
		double opacity = 1.0;

		take_numbers(rest, &opacity, 1);
		mtl->colours[*current] = colour_with_opacity(mtl->colours[*current], opacity);
	}
	return 0;
}

int mtl_read(struct mtl *mtl, const char *path, struct why *why)
{
	uint32_t current = UINT32_MAX;
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
		r = take_line(mtl, line, &current, why);
		free(line);
		if (r < 0)
			break;
	}
	source_close(source);
	return r;
}
