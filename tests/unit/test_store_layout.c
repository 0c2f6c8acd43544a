/* SPDX-License-Identifier: MIT */
/*
 * Goal: formats/STORE.md and the headers say the same, both ways.
 * Method: the tables of the text are read; a field or a constant that only one side has, or that
 * differs in place, type or value, is named.  The list of fields below is complete: without a gap.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "formats/store/layout.h"
#include "formats/store/payload_layout.h"
#include "tests/helper.h"

struct field {
	const char *structure; /* as the text's heading calls it */
	size_t structure_bytes;
	const char *name;
	size_t offset;
	size_t size_bytes;
	const char *type; /* of an element */
	size_t element_bytes;
	bool is_in_text;
};

/* clang-format off */
#define TYPE_NAME(value)                                                                           \
	_Generic((value), uint8_t: "u8", uint8_t *: "u8", int8_t *: "i8", uint16_t: "u16",         \
		uint32_t: "u32", uint32_t *: "u32", int32_t: "i32", uint64_t: "u64",               \
		float: "f32", float *: "f32", double: "f64", double *: "f64",                      \
		struct store_extent: "extent", struct payload_stream *: "stream")
#define ELEMENT_BYTES(value)                                                                       \
	_Generic((value), uint8_t *: 1, int8_t *: 1, uint32_t *: 4, float *: 4, double *: 8,       \
		struct payload_stream *: sizeof(struct payload_stream), default: sizeof(value))
/* clang-format on */
#define FIELD(text, tag, member)                                                                   \
	{                                                                                          \
		.structure = text, .structure_bytes = sizeof(struct tag), .name = #member,         \
		.offset = offsetof(struct tag, member),                                            \
		.size_bytes = sizeof(((struct tag *)0)->member),                                   \
		.type = TYPE_NAME(((struct tag *)0)->member),                                      \
		.element_bytes = ELEMENT_BYTES(((struct tag *)0)->member),                         \
	}
#define EXTENT(member)     FIELD("extent", store_extent, member)
#define SUPERBLOCK(member) FIELD("superblock", store_superblock, member)
#define NODE(member)       FIELD("node", store_node, member)
#define HEADER(member)     FIELD("payload header", payload_header, member)
#define STREAM(member)     FIELD("stream", payload_stream, member)
#define RUN(member)        FIELD("run", payload_run, member)
#define NAMES(member)      FIELD("names header", store_names_header, member)
#define SECTION(member)    FIELD("section", store_section, member)
#define SOURCE(member)     FIELD("source", store_source, member)
#define PART(member)       FIELD("part", store_part, member)

static struct field fields[] = {
	EXTENT(file_offset),
	EXTENT(stored_bytes),
	EXTENT(raw_bytes),
	EXTENT(checksum),
	SUPERBLOCK(magic),
	SUPERBLOCK(version),
	SUPERBLOCK(superblock_bytes),
	SUPERBLOCK(uuid),
	SUPERBLOCK(generation),
	SUPERBLOCK(file_bytes),
	SUPERBLOCK(hs),
	SUPERBLOCK(names),
	SUPERBLOCK(node_count),
	SUPERBLOCK(leaf_count),
	SUPERBLOCK(triangle_count),
	SUPERBLOCK(vertex_count),
	SUPERBLOCK(part_count),
	SUPERBLOCK(section_count),
	SUPERBLOCK(payload_stored_bytes),
	SUPERBLOCK(payload_raw_bytes),
	SUPERBLOCK(payload_id_next),
	SUPERBLOCK(triangles_in),
	SUPERBLOCK(payload_bytes_max),
	SUPERBLOCK(level_max),
	SUPERBLOCK(origin),
	SUPERBLOCK(unit_metres),
	SUPERBLOCK(error),
	SUPERBLOCK(error_measured),
	SUPERBLOCK(root_min),
	SUPERBLOCK(root_size),
	SUPERBLOCK(box_min),
	SUPERBLOCK(box_max),
	SUPERBLOCK(crease_degrees),
	SUPERBLOCK(step_exponent),
	SUPERBLOCK(up_axis),
	SUPERBLOCK(layout),
	SUPERBLOCK(leaf_triangles_max),
	SUPERBLOCK(leaf_vertices_max),
	SUPERBLOCK(reserved0),
	SUPERBLOCK(producer),
	SUPERBLOCK(reserved),
	SUPERBLOCK(checksum),
	NODE(payload_id),
	NODE(file_offset),
	NODE(payload_checksum),
	NODE(stored_bytes),
	NODE(payload_bytes),
	NODE(parent),
	NODE(first_child),
	NODE(child_count),
	NODE(level),
	NODE(kind),
	NODE(codec),
	NODE(cell),
	NODE(triangle_count),
	NODE(vertex_count),
	NODE(box_min),
	NODE(box_max),
	NODE(error),
	NODE(parent_error),
	NODE(sphere),
	NODE(longest_edge),
	NODE(area),
	NODE(mean_normal),
	NODE(solidity),
	NODE(scalar_range),
	HEADER(magic),
	HEADER(kind),
	HEADER(stream_count),
	HEADER(reserved0),
	HEADER(payload_id),
	HEADER(payload_bytes),
	HEADER(vertex_count),
	HEADER(triangle_count),
	HEADER(run_count),
	HEADER(runs_offset_bytes),
	HEADER(reserved1),
	HEADER(origin),
	HEADER(scale),
	HEADER(streams),
	HEADER(reserved),
	STREAM(semantic),
	STREAM(format),
	STREAM(element_bytes),
	STREAM(offset_bytes),
	RUN(part),
	RUN(section),
	RUN(first_triangle),
	RUN(colour),
	NAMES(section_count),
	NAMES(source_count),
	NAMES(part_count),
	NAMES(string_bytes),
	SECTION(name),
	SECTION(source),
	SECTION(first_part),
	SECTION(part_count),
	SECTION(placement),
	SOURCE(path),
	PART(name),
	PART(scene_path),
	PART(material),
	PART(section),
	PART(colour),
	PART(triangle_count),
};

struct constant {
	const char *name;
	long value;
	bool is_in_text;
};

/* clang-format off */
#define CONSTANT(name) { #name, name, false }
/* clang-format on */

static struct constant constants[] = {
	CONSTANT(STORE_AXIS_UNKNOWN),
	CONSTANT(STORE_AXIS_X),
	CONSTANT(STORE_AXIS_Y),
	CONSTANT(STORE_AXIS_Z),
	CONSTANT(STORE_LAYOUT_UNIQUE),
	CONSTANT(STORE_LAYOUT_REPLICATE),
	CONSTANT(STORE_KIND_NONE),
	CONSTANT(STORE_KIND_TRIANGLES),
	CONSTANT(STORE_KIND_TEXTURED),
	CONSTANT(STORE_KIND_FACES),
	CONSTANT(STORE_KIND_VOXELS),
	CONSTANT(STORE_CODEC_NONE),
	CONSTANT(STORE_CODEC_ZSTD),
	CONSTANT(STORE_CODEC_MESHOPT),
	CONSTANT(STORE_CODEC_MESHOPT_ZSTD),
	CONSTANT(PAYLOAD_INDEX),
	CONSTANT(PAYLOAD_POSITION),
	CONSTANT(PAYLOAD_NORMAL),
	CONSTANT(PAYLOAD_COLOUR),
	CONSTANT(PAYLOAD_TRIANGLE_ID),
	CONSTANT(PAYLOAD_U16),
	CONSTANT(PAYLOAD_U32),
	CONSTANT(PAYLOAD_U16X3_RUN),
	CONSTANT(PAYLOAD_F32X3_RUN),
	CONSTANT(PAYLOAD_OCT8),
	CONSTANT(PAYLOAD_OCT16),
	CONSTANT(PAYLOAD_RGBA8),
	CONSTANT(PAYLOAD_U64),
};

/* A new value of an enum makes this list too short; one that is here twice makes it too long. */
static_assert(ARRAY_LENGTH(constants) == STORE_AXIS_COUNT_ + STORE_LAYOUT_COUNT_ +
						 STORE_KIND_COUNT_ + STORE_CODEC_COUNT_ +
						 (PAYLOAD_SEMANTIC_COUNT_ - 1) +
						 (PAYLOAD_FORMAT_COUNT_ - 1),
	      "every constant is listed");

static struct field *find_field(const char *structure, const char *name)
{
	for (size_t i = 0; i < ARRAY_LENGTH(fields); i++)
		if (strcmp(fields[i].structure, structure) == 0 &&
		    strcmp(fields[i].name, name) == 0)
			return &fields[i];
	return NULL;
}

static struct constant *find_constant(const char *name)
{
	for (size_t i = 0; i < ARRAY_LENGTH(constants); i++)
		if (strcmp(constants[i].name, name) == 0)
			return &constants[i];
	return NULL;
}

static void check_field_row(const char *structure, size_t offset, const char *type,
			    const char *name)
{
	struct field *field = find_field(structure, name);
	char expected[64];

	if (!field)
		fail_msg("the text has a field that the code has not: %s.%s", structure, name);
	if (field->size_bytes == field->element_bytes)
		(void)snprintf(expected, sizeof(expected), "%s", field->type);
	else
		(void)snprintf(expected, sizeof(expected), "%s[%zu]", field->type,
			       field->size_bytes / field->element_bytes);
	if (offset != field->offset || strcmp(type, expected) != 0)
		fail_msg("%s.%s: the text says %zu %s, the code %zu %s", structure, name, offset,
			 type, field->offset, expected);
	if (field->is_in_text)
		fail_msg("%s.%s stands twice in the text", structure, name);
	field->is_in_text = true;
}

static void check_constant_row(long value, const char *name)
{
	struct constant *constant = find_constant(name);

	if (!constant)
		fail_msg("the text has a constant that the code has not: %s", name);
	if (constant->value != value)
		fail_msg("%s: the text says %ld, the code %ld", name, value, constant->value);
	constant->is_in_text = true;
}

static void check_heading(const char *structure, size_t size_bytes)
{
	for (size_t i = 0; i < ARRAY_LENGTH(fields); i++)
		if (strcmp(fields[i].structure, structure) == 0) {
			assert_int_equal(fields[i].structure_bytes, size_bytes);
			return;
		}
	fail_msg("the text has a structure that the code has not: %s", structure);
}

static void text_and_code_have_the_same_fields_and_constants(void **state)
{
	char structure[64] = "";
	char line[1024];
	char path[512];
	FILE *file;

	(void)state;
	(void)snprintf(path, sizeof(path), "%s/formats/STORE.md", getenv("OOCD_SOURCE"));
	file = fopen(path, "re");
	assert_non_null(file);
	while (fgets(line, sizeof(line), file)) {
		char type[32];
		char name[64];
		size_t number;
		long value;

		if (sscanf(line, "### %63[^,], %zu bytes", structure, &number) == 2)
			check_heading(structure, number);
		else if (sscanf(line, "| %zu | %31[][a-z0-9] | %63[a-z0-9_] |", &number, type,
				name) == 3)
			check_field_row(structure, number, type, name);
		else if (sscanf(line, "| %ld | %63[A-Z0-9_] |", &value, name) == 2)
			check_constant_row(value, name);
	}
	(void)fclose(file);
	for (size_t i = 0; i < ARRAY_LENGTH(fields); i++)
		if (!fields[i].is_in_text)
			fail_msg("the code has a field that the text has not: %s.%s",
				 fields[i].structure, fields[i].name);
	for (size_t i = 0; i < ARRAY_LENGTH(constants); i++)
		if (!constants[i].is_in_text)
			fail_msg("the code has a constant that the text has not: %s",
				 constants[i].name);
}

static void the_list_of_fields_has_no_gap(void **state)
{
	size_t end = 0;

	(void)state;
	for (size_t i = 0; i < ARRAY_LENGTH(fields); i++) {
		const struct field *field = &fields[i];
		bool is_first = i == 0 || strcmp(fields[i - 1].structure, field->structure) != 0;

		/* The one that lies over others. */
		if (strcmp(field->name, "scalar_range") == 0)
			continue;
		if (is_first && i > 0)
			assert_int_equal(end, fields[i - 1].structure_bytes);
		assert_int_equal(field->offset, is_first ? 0 : end);
		end = field->offset + field->size_bytes;
	}
	assert_int_equal(end, fields[ARRAY_LENGTH(fields) - 1].structure_bytes);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(text_and_code_have_the_same_fields_and_constants),
		cmocka_unit_test(the_list_of_fields_has_no_gap),
	};

	return TEST_RUN(tests);
}
