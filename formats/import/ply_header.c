/* SPDX-License-Identifier: MIT */
#include "formats/import/ply_header.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/text.h"

/* "property list TYPE TYPE NAME" */
#define WORDS_MAX      5
#define LINE_BYTES_MAX 512

const uint8_t ply_type_bytes[PLY_TYPE_COUNT_] = { 0, 1, 1, 2, 2, 4, 4, 4, 8 };

static const struct {
	const char *name;
	enum ply_type type;
} type_names[] = {
	{ "char", PLY_INT8 },      { "int8", PLY_INT8 },     { "uchar", PLY_UINT8 },
	{ "uint8", PLY_UINT8 },    { "short", PLY_INT16 },   { "int16", PLY_INT16 },
	{ "ushort", PLY_UINT16 },  { "uint16", PLY_UINT16 }, { "int", PLY_INT32 },
	{ "int32", PLY_INT32 },    { "uint", PLY_UINT32 },   { "uint32", PLY_UINT32 },
	{ "float", PLY_FLOAT },    { "float32", PLY_FLOAT }, { "double", PLY_DOUBLE },
	{ "float64", PLY_DOUBLE },
};

struct header_line {
	char text[LINE_BYTES_MAX];
	char *words[WORDS_MAX];
	unsigned word_count; /* WORDS_MAX also when there are more */
};

void ply_header_done(struct ply_header *header)
{
	for (uint32_t i = 0; i < header->element_count; i++)
		free(header->elements[i].properties);
	*header = (struct ply_header){ 0 };
}

uint32_t ply_element_find(const struct ply_element *element, const char *name)
{
	for (uint32_t i = 0; i < element->property_count; i++)
		if (strcmp(element->properties[i].name, name) == 0)
			return i;
	return UINT32_MAX;
}

static int header_fault(const struct source *source, struct why *why, const char *what)
{
	return why_set(why, -EUCLEAN, "line %llu of the header: %s",
		       (unsigned long long)source->line, what);
}

static int read_line(struct source *source, struct header_line *line, struct why *why)
{
	const char *text;
	char *save = NULL, *word;
	size_t length;
	int r = source_line(source, &text, &length, why);

	if (r < 0)
		return r;
	if (r == 0)
		return why_set(why, -ENODATA, "it ends within its header");
	/* Only comments are long: what is behind their first words is not wanted. */
	if (length >= sizeof(line->text))
		length = sizeof(line->text) - 1;
	memcpy(line->text, text, length);
	line->text[length] = '\0';
	line->word_count = 0;
	for (word = strtok_r(line->text, " \t\r", &save); word && line->word_count < WORDS_MAX;
	     word = strtok_r(NULL, " \t\r", &save))
		line->words[line->word_count++] = word;
	return 0;
}

static enum ply_type type_of_name(const char *name)
{
	for (size_t i = 0; i < ARRAY_LENGTH(type_names); i++)
		if (strcmp(type_names[i].name, name) == 0)
			return type_names[i].type;
	return PLY_NONE;
}

static int take_name(char *to, const char *name, const struct source *source, struct why *why)
{
	size_t length = strlen(name);

	if (length >= PLY_NAME_BYTES)
		return header_fault(source, why, "a name of more than 63 letters");
	memcpy(to, name, length + 1);
	return 0;
}

static int take_format(struct ply_header *header, const struct header_line *line,
		       const struct source *source, struct why *why)
{
	const char *name = line->word_count > 1 ? line->words[1] : "";

	if (strcmp(name, "ascii") == 0)
		header->encoding = PLY_ASCII;
	else if (strcmp(name, "binary_little_endian") == 0)
		header->encoding = PLY_LITTLE_ENDIAN;
	else if (strcmp(name, "binary_big_endian") == 0)
		header->encoding = PLY_BIG_ENDIAN;
	else
		return header_fault(source, why, "an unknown format");
	return 0;
}

static int take_element(struct ply_header *header, const struct header_line *line,
			const struct source *source, struct why *why)
{
	struct ply_element *element;
	int r;

	if (header->element_count == PLY_ELEMENTS_MAX)
		return header_fault(source, why, "more than 32 elements");
	element = &header->elements[header->element_count];
	if (line->word_count != 3 || text_to_u64(line->words[2], &element->count) < 0)
		return header_fault(source, why, "\"element NAME COUNT\" is wanted");
	r = take_name(element->name, line->words[1], source, why);
	if (r < 0)
		return r;
	element->properties = calloc(PLY_PROPERTIES_MAX, sizeof(*element->properties));
	if (!element->properties)
		return why_set(why, -ENOMEM, "no memory for its header");
	header->element_count++;
	return 0;
}

static int take_property(struct ply_header *header, const struct header_line *line,
			 const struct source *source, struct why *why)
{
	struct ply_element *element;
	struct ply_property *property;
	unsigned words_wanted = 3;

	if (header->element_count == 0)
		return header_fault(source, why, "a property without an element");
	element = &header->elements[header->element_count - 1];
	if (element->property_count == PLY_PROPERTIES_MAX)
		return header_fault(source, why, "more than 128 properties");
	property = &element->properties[element->property_count];
	if (line->word_count > 1 && strcmp(line->words[1], "list") == 0) {
		words_wanted = 5;
		element->has_list = true;
		if (line->word_count == 5)
			property->count_type = type_of_name(line->words[2]);
	}
	if (line->word_count != words_wanted)
		return header_fault(source, why, "\"property TYPE NAME\" is wanted");
	property->type = type_of_name(line->words[words_wanted - 2]);
	if (property->type == PLY_NONE ||
	    (words_wanted == 5 &&
	     (property->count_type == PLY_NONE || property->count_type >= PLY_FLOAT)))
		return header_fault(source, why, "an unknown type");
	element->property_count++;
	return take_name(property->name, line->words[words_wanted - 1], source, why);
}

/* The fewest bytes a row can have: in text a digit and a blank for each value. */
static void element_measure(const struct ply_header *header, struct ply_element *element)
{
	for (uint32_t i = 0; i < element->property_count; i++) {
		const struct ply_property *property = &element->properties[i];
		enum ply_type type =
			property->count_type != PLY_NONE ? property->count_type : property->type;

		element->row_bytes_min += header->encoding == PLY_ASCII ? 2 : ply_type_bytes[type];
	}
}

/* Refuses counts that the rest of the file cannot hold, before anything is made for them. */
static int header_check_counts(const struct source *source, struct ply_header *header,
			       struct why *why)
{
	/* The last number of a text may end with the file. */
	uint64_t rest_bytes = source_rest_max(source) + (header->encoding == PLY_ASCII);

	for (uint32_t i = 0; i < header->element_count; i++) {
		struct ply_element *element = &header->elements[i];
		uint64_t wanted_bytes;

		element_measure(header, element);
		if (__builtin_mul_overflow(element->count, element->row_bytes_min, &wanted_bytes) ||
		    wanted_bytes > rest_bytes)
			return why_set(why, -ENODATA,
				       "it claims %llu of \"%s\", but not so many can follow",
				       (unsigned long long)element->count, element->name);
		rest_bytes -= wanted_bytes;
	}
	return 0;
}

/*
 * The format has no field for units and up axis; writers that know them say so in a comment, and
 * any other comment means nothing to us.
 */
static void take_comment(struct ply_header *header, const struct header_line *line)
{
	static const struct {
		const char *word;
		double metres;
	} units[] = { { "metres", 1.0 },        { "meters", 1.0 },       { "millimetres", 0.001 },
		      { "millimeters", 0.001 }, { "centimetres", 0.01 }, { "centimeters", 0.01 },
		      { "inches", 0.0254 },     { "feet", 0.3048 } };
	static const char *const axes[] = { "x", "y", "z" };

	if (line->word_count != 3)
		return;
	if (strcmp(line->words[1], "unit") == 0) {
		for (size_t i = 0; i < ARRAY_LENGTH(units); i++)
			if (strcmp(line->words[2], units[i].word) == 0)
				header->unit_metres = units[i].metres;
	} else if (strcmp(line->words[1], "up") == 0) {
		for (size_t i = 0; i < ARRAY_LENGTH(axes); i++)
			if (strcmp(line->words[2], axes[i]) == 0)
				header->up_axis = (enum store_axis)(STORE_AXIS_X + i);
	}
}

int ply_header_read(struct source *source, struct ply_header *ret, struct why *why)
{
	struct header_line line;
	bool format_seen = false;
	int r = 0;

	*ret = (struct ply_header){ 0 };
	r = read_line(source, &line, why);
	if (r < 0)
		return r;
	if (line.word_count != 1 || strcmp(line.words[0], "ply") != 0)
		return why_set(why, -EUCLEAN, "it is no PLY file: it does not begin with \"ply\"");
	for (;;) {
		const char *word;

		r = read_line(source, &line, why);
		if (r < 0)
			return r;
		word = line.word_count > 0 ? line.words[0] : "";
		if (strcmp(word, "end_header") == 0)
			break;
		if (strcmp(word, "format") == 0) {
			r = take_format(ret, &line, source, why);
			format_seen = true;
		} else if (strcmp(word, "element") == 0) {
			r = take_element(ret, &line, source, why);
		} else if (strcmp(word, "property") == 0) {
			r = take_property(ret, &line, source, why);
		} else if (strcmp(word, "comment") == 0) {
			take_comment(ret, &line);
		} else if (*word && strcmp(word, "obj_info") != 0) {
			r = header_fault(source, why, "an unknown word");
		}
		if (r < 0)
			return r;
	}
	if (!format_seen)
		return header_fault(source, why, "the format is not said");
	return header_check_counts(source, ret, why);
}
