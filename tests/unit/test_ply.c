/* SPDX-License-Identifier: MIT */
/* Goal: PLY in any order, type and encoding; larger than memory; and hostile. */
#include <endian.h>
#include <errno.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "tests/helper.h"
#include "tests/unit/import_kit.h"

#define GRID_EDGE 70u

/* A value of any type, in text or either byte order. */
static void put_value(struct kit_bytes *bytes, const char *encoding, const char *type, double value)
{
	uint8_t raw[8];
	size_t size_bytes = 0;

	if (strcmp(encoding, "ascii") == 0) {
		kit_print(bytes, "%.17g ", value);
		return;
	}
	if (strcmp(type, "uchar") == 0 || strcmp(type, "char") == 0) {
		raw[0] = (uint8_t)(int)value;
		size_bytes = 1;
	} else if (strcmp(type, "ushort") == 0 || strcmp(type, "short") == 0) {
		uint16_t small = (uint16_t)(int)value;

		memcpy(raw, &small, 2);
		size_bytes = 2;
	} else if (strcmp(type, "float") == 0) {
		float single = (float)value;

		memcpy(raw, &single, 4);
		size_bytes = 4;
	} else if (strcmp(type, "double") == 0) {
		memcpy(raw, &value, 8);
		size_bytes = 8;
	} else {
		uint32_t whole = (uint32_t)(int64_t)value;

		memcpy(raw, &whole, 4);
		size_bytes = 4;
	}
	if (strcmp(encoding, "binary_big_endian") == 0)
		for (size_t i = 0; i < size_bytes / 2; i++) {
			uint8_t swap = raw[i];

			raw[i] = raw[size_bytes - 1 - i];
			raw[size_bytes - 1 - i] = swap;
		}
	kit_append(bytes, raw, size_bytes);
}

static void put_header(struct kit_bytes *bytes, const char *encoding, const char *rest)
{
	kit_print(bytes, "ply\nformat %s 1.0\ncomment made by a test\n%send_header\n", encoding,
		  rest);
}

/* A grid of quads, triangles and a pentagon, whose vertices' types and order differ. */
static struct kit_bytes grid(const char *encoding, const char *position_type, bool extras,
			     const char *count_type, const char *index_type)
{
	struct kit_bytes bytes = { 0 };
	char header[1024];
	uint32_t vertices = (GRID_EDGE + 1) * (GRID_EDGE + 1), faces = GRID_EDGE * GRID_EDGE;

	(void)snprintf(
		header, sizeof(header),
		"%selement vertex %u\n%sproperty %s x\nproperty %s y\nproperty %s z\n%s"
		"element face %u\n%sproperty list %s %s vertex_indices\n%s",
		extras ? "element odd 3\nproperty short a\nproperty list uchar double b\n" : "",
		vertices, extras ? "property uchar red\nproperty list uchar short junk\n" : "",
		position_type, position_type, position_type,
		extras ? "property uchar green\nproperty uchar blue\n" : "", faces,
		extras ? "property int flags\n" : "", count_type, index_type,
		extras ? "property list uchar float texcoord\n" : "");
	put_header(&bytes, encoding, header);
	for (int i = 0; extras && i < 3; i++) {
		put_value(&bytes, encoding, "short", -i);
		put_value(&bytes, encoding, "uchar", i);
		for (int k = 0; k < i; k++)
			put_value(&bytes, encoding, "double", k * 0.25);
	}
	for (uint32_t i = 0; i < vertices; i++) {
		uint32_t x = i % (GRID_EDGE + 1), y = i / (GRID_EDGE + 1);

		if (extras) {
			put_value(&bytes, encoding, "uchar", x);
			put_value(&bytes, encoding, "uchar", x % 3);
			for (uint32_t k = 0; k < x % 3; k++)
				put_value(&bytes, encoding, "short", k);
		}
		put_value(&bytes, encoding, position_type, x);
		put_value(&bytes, encoding, position_type, y);
		put_value(&bytes, encoding, position_type, (x * y) % 5);
		if (extras) {
			put_value(&bytes, encoding, "uchar", y);
			put_value(&bytes, encoding, "uchar", 7);
		}
	}
	for (uint32_t i = 0; i < faces; i++) {
		uint32_t a = i / GRID_EDGE * (GRID_EDGE + 1) + i % GRID_EDGE;
		const uint32_t corners[5] = { a, a + 1, a + GRID_EDGE + 2, a + GRID_EDGE + 1, a };
		uint32_t count = i % 11 == 0 ? 5 : i % 2 ? 3 : i % 7 == 0 ? 2 : 4;

		if (extras)
			put_value(&bytes, encoding, "int", i);
		put_value(&bytes, encoding, count_type, count);
		for (uint32_t k = 0; k < count; k++)
			put_value(&bytes, encoding, index_type, corners[k]);
		if (extras) {
			put_value(&bytes, encoding, "uchar", 2);
			put_value(&bytes, encoding, "float", 0.5);
			put_value(&bytes, encoding, "float", 0.25);
		}
	}
	return bytes;
}

static void every_encoding_and_type_reads_the_same(void **state)
{
	static const char *const encodings[] = { "ascii", "binary_little_endian",
						 "binary_big_endian" };
	static const char *const positions[] = { "float", "double", "short", "int" };
	static const char *const counts[] = { "uchar", "char", "ushort", "int", "uint" };
	static const char *const indices[] = { "int", "uint", "ushort", "short" };

	for (int extras = 0; extras < 2; extras++) {
		struct kit_bytes bytes =
			grid("binary_little_endian", "float", extras, "uchar", "int");
		struct kit_model *expected =
			kit_import_bytes(*state, "a.ply", bytes.data, bytes.size_bytes);

		free(bytes.data);
		kit_assert_ok(expected);
		assert_int_equal(expected->info.face_count, GRID_EDGE * GRID_EDGE);
		assert_true(expected->info.dropped_faces > 0);
		assert_int_equal(expected->has_colours, extras);
		for (unsigned i = 0; i < 3 * 4 * 5; i++) {
			const char *position = positions[i / 3 % 4];
			struct kit_model *model;

			bytes = grid(encodings[i % 3], position, extras, counts[i % 5],
				     indices[i % 4]);
			model = kit_import_bytes(*state, "b.ply", bytes.data, bytes.size_bytes);
			assert_int_equal(model->positions_double, strcmp(position, "float") != 0);
			kit_assert_same(expected, model);
			kit_model_free(model);
			free(bytes.data);
		}
		kit_model_free(expected);
	}
}

static void doubles_stay_doubles(void **state)
{
	struct kit_model *model = kit_import_text(
		*state, "a.ply",
		"ply\r\nformat ascii 1.0\r\nelement vertex 3\r\nproperty double x\r\n"
		"property double y\r\nproperty double z\r\nelement face 1\r\n"
		"property list uchar int vertex_index\r\nend_header\r\n"
		"500000.123456789 0.1 -1e-300\r\n1 0 0\r\n0 1 0\r\n3 0 1 2\r\n");

	kit_assert_ok(model);
	assert_true(model->positions_double);
	assert_true(model->positions[0] == 500000.123456789);
	assert_true(model->positions[1] == 0.1);
	assert_true(model->positions[2] == -1e-300);
	kit_model_free(model);
}

static void normals_and_colours_come_with_their_corners(void **state)
{
	struct kit_model *model = kit_import_text(
		*state, "a.ply",
		"ply\nformat ascii 1.0\nelement vertex 3\nproperty float nx\nproperty float ny\n"
		"property float nz\nproperty float x\nproperty float y\nproperty float z\n"
		"property float red\nproperty float green\nproperty float blue\n"
		"element face 1\nproperty list uchar int vertex_indices\nend_header\n"
		"0 0 1 0 0 0 1 0 0\n0 1 0 1 0 0 0 0.5 0\n1 0 0 0 1 0 0 0 2\n3 2 1 0\n");

	kit_assert_ok(model);
	assert_true(model->has_normals && model->has_colours);
	assert_true(model->normals[0] == 1.0f);
	assert_true(model->normals[8] == 1.0f);
	assert_int_equal(model->colours[0], 0xffff0000);
	assert_int_equal(model->colours[1], 0xff008000);
	assert_int_equal(model->colours[2], 0xff0000ff);
	kit_model_free(model);
}

static void the_colour_option_leaves_vertex_colours_out(void **state)
{
	struct kit_bytes bytes = grid("ascii", "float", true, "uchar", "int");
	const char *path = test_path(*state, "a.ply");
	struct import_options options = { .memory_bytes = 64 * MIB, .scratch_directory = *state };

	test_file_write(path, bytes.data, bytes.size_bytes);
	for (int colour = IMPORT_COLOUR_TEXTURE; colour <= IMPORT_COLOUR_NONE; colour++) {
		struct kit_model *model;

		options.colour = (enum import_colour)colour;
		model = kit_import(path, &options);
		kit_assert_ok(model);
		assert_int_equal(model->has_colours, colour <= IMPORT_COLOUR_VERTEX);
		assert_int_equal(model->parts[0].colour, IMPORT_COLOUR_DEFAULT);
		kit_model_free(model);
	}
	free(bytes.data);
}

static void strips_become_triangles_of_one_orientation(void **state)
{
	struct kit_model *model = kit_import_text(
		*state, "a.ply",
		"ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\n"
		"property float z\nelement tristrips 1\nproperty list int int vertex_indices\n"
		"end_header\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 2 0\n1 2 0\n"
		"10 0 1 2 3 4 -1 2 3 4 5\n");
	double area[3];

	kit_assert_ok(model);
	assert_int_equal(model->triangle_count, 5);
	kit_area(model, area);
	assert_true(area[2] == 5.0);
	kit_model_free(model);
}

static void comments_may_say_unit_and_up_axis(void **state)
{
	static const struct {
		const char *comments;
		double unit_metres;
		enum store_axis up_axis;
	} cases[] = {
		{ "comment unit metres\ncomment up z\n", 1.0, STORE_AXIS_Z },
		{ "comment unit millimeters\ncomment up y\n", 0.001, STORE_AXIS_Y },
		{ "comment unit parsecs\ncomment up w\n", 0.0, STORE_AXIS_UNKNOWN },
		{ "comment up\ncomment the unit metres is best\n", 0.0, STORE_AXIS_UNKNOWN },
	};

	for (size_t i = 0; i < ARRAY_LENGTH(cases); i++) {
		char text[512];
		struct kit_model *model;

		(void)snprintf(text, sizeof(text),
			       "ply\nformat ascii 1.0\n%selement vertex 0\nproperty float x\n"
			       "property float y\nproperty float z\nend_header\n",
			       cases[i].comments);
		model = kit_import_text(*state, "a.ply", text);
		kit_assert_ok(model);
		assert_true(model->info.unit_metres == cases[i].unit_metres);
		assert_int_equal(model->info.up_axis, cases[i].up_axis);
		kit_model_free(model);
	}
}

static void faces_may_come_before_their_vertices(void **state)
{
	struct kit_model *model = kit_import_text(
		*state, "a.ply",
		"ply\nformat ascii 1.0\nelement face 2\nproperty list uchar int vertex_indices\n"
		"element vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
		"end_header\n3 0 1 2\n4 0 1 3 2\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n");

	kit_assert_ok(model);
	assert_int_equal(model->triangle_count, 3);
	assert_true(kit_surface(model) == 1.5);
	kit_model_free(model);
}

static void vertices_that_exceed_memory_give_the_same_triangles(void **state)
{
	static const uint64_t memories[] = { 60000, 120000, 16 * MIB };

	for (int extras = 0; extras < 2; extras++) {
		struct kit_bytes bytes =
			grid("binary_little_endian", "float", extras, "uchar", "int");

		kit_assert_same_within(*state, "a.ply", &bytes, memories, ARRAY_LENGTH(memories));
		free(bytes.data);
	}
}

static void vertices_that_exceed_memory_without_scratch_are_refused(void **state)
{
	struct kit_bytes bytes = grid("binary_little_endian", "float", false, "uchar", "int");
	struct import_options options = { .memory_bytes = 60000 };
	const char *path = test_path(*state, "a.ply");
	struct kit_model *model;

	test_file_write(path, bytes.data, bytes.size_bytes);
	model = kit_import(path, &options);
	kit_assert_refused(model, -ENOMEM, "do not fit");
	kit_model_free(model);
	options.scratch_directory = "/nonexistent";
	model = kit_import(path, &options);
	kit_assert_refused(model, -ENOENT, "scratch");
	kit_model_free(model);
	free(bytes.data);
}

static void gzip_reads_the_same(void **state)
{
	struct kit_bytes bytes = grid("binary_little_endian", "double", true, "uchar", "int");

	kit_assert_same_gzipped(*state, "a.ply", &bytes);
	free(bytes.data);
}

static void a_cancelled_import_or_a_full_sink_ends_it(void **state)
{
	struct kit_bytes bytes = grid("binary_little_endian", "float", false, "uchar", "int");
	bool cancelled = true;
	struct import_options options = { .memory_bytes = 64 * MIB,
					  .scratch_directory = *state,
					  .cancelled = &cancelled };
	const char *path = test_path(*state, "a.ply");
	struct kit_model *model;

	test_file_write(path, bytes.data, bytes.size_bytes);
	model = kit_import(path, &options);
	kit_assert_refused(model, -ECANCELED, "cancelled");
	kit_model_free(model);
	for (kit_batch_fails_at = 1; kit_batch_fails_at <= 2; kit_batch_fails_at++) {
		model = kit_import(path, NULL);
		kit_assert_refused(model, -ENOSPC, "the sink is full");
		kit_model_free(model);
	}
	kit_batch_fails_at = 0;
	free(bytes.data);
}

/* ---- hostile ---- */

#define XYZ  "property float x\nproperty float y\nproperty float z\n"
#define FACE "element face 1\nproperty list uchar int vertex_indices\n"

static void ply_refuses_what_is_no_ply(void **state)
{
	static const struct kit_refusal cases[] = {
		{ "", -ENODATA, "empty" },
		{ "Dear Sir,\nthis is a letter.\n", -EUCLEAN, "no PLY" },
		{ "ply", -ENODATA, "header" },
		{ "ply\n", -ENODATA, "header" },
		{ "ply\nformat ascii 1.0\nelement vertex 3\n" XYZ, -ENODATA, "header" },
		{ "ply\nformat ebcdic 1.0\nend_header\n", -EUCLEAN, "format" },
		{ "ply\nelement vertex 0\n" XYZ "end_header\n", -EUCLEAN, "format" },
		{ "ply\nformat ascii 1.0\nend_header\n", -EUCLEAN, "no vertices" },
		{ "ply\nformat ascii 1.0\nproperty float x\nend_header\n", -EUCLEAN, "line 3" },
		{ "ply\nformat ascii 1.0\nelement vertex -1\n" XYZ "end_header\n", -EUCLEAN,
		  "line 3" },
		{ "ply\nformat ascii 1.0\nelement vertex 3\nproperty quad x\nend_header\n",
		  -EUCLEAN, "type" },
		{ "ply\nformat ascii 1.0\nelement vertex 3\nproperty list float int x\nend_header\n",
		  -EUCLEAN, "type" },
		{ "ply\nformat ascii 1.0\nwhatever\nend_header\n", -EUCLEAN, "line 3" },
		{ "ply\nformat ascii 1.0\nelement vertex 1\n" XYZ "end_header\n0 0 apple\n",
		  -EUCLEAN, "apple" },
		{ "ply\nformat ascii 1.0\nelement vertex 1\n" XYZ "end_header\n0 0 0x10\n",
		  -EUCLEAN, "line" },
	};

	kit_assert_all_refused(*state, "a.ply", cases, ARRAY_LENGTH(cases));
}

static void ply_refuses_a_count_that_the_file_cannot_hold_at_once(void **state)
{
	static const char *const texts[] = {
		"ply\nformat binary_little_endian 1.0\nelement vertex 4611686018427387904\n" XYZ
		"end_header\n",
		"ply\nformat ascii 1.0\nelement vertex 4611686018427387904\n" XYZ "end_header\n",
		"ply\nformat binary_little_endian 1.0\nelement vertex 18446744073709551615\n" XYZ
		"end_header\n",
		"ply\nformat binary_big_endian 1.0\nelement vertex 0\n" XYZ
		"element face 4611686018427387904\nproperty list uchar int vertex_indices\nend_header\n",
		"ply\nformat ascii 1.0\nelement junk 4611686018427387904\nproperty char c\n"
		"element vertex 0\n" XYZ "end_header\n",
	};
	struct kit_bytes padded = { 0 };

	for (size_t i = 0; i < ARRAY_LENGTH(texts); i++) {
		uint64_t begin_ns = clock_spent_ns();
		struct kit_model *model;

		padded.size_bytes = 0;
		kit_print(&padded, "%s", texts[i]);
		while (padded.size_bytes < 1024)
			kit_append(&padded, "", 1);
		model = kit_import_bytes(*state, "a.ply", padded.data, padded.size_bytes);
		kit_assert_refused(model, -ENODATA, "claims");
		kit_model_free(model);
		assert_true(clock_spent_ns() - begin_ns < 100 * NS_PER_MS);
	}
	free(padded.data);
}

static void an_element_of_nothing_costs_nothing_however_often(void **state)
{
	struct kit_model *model = kit_import_text(
		*state, "a.ply",
		"ply\nformat ascii 1.0\nelement ghost 18446744073709551615\nelement vertex 0\n" XYZ
		"end_header\n");

	kit_assert_ok(model);
	kit_model_free(model);
}

static void a_list_longer_than_the_file_is_refused_at_once(void **state)
{
	struct kit_bytes bytes = { 0 };
	struct kit_model *model;

	kit_print(&bytes, "ply\nformat binary_little_endian 1.0\nelement vertex 0\n" XYZ
			  "element face 1\nproperty list uint int vertex_indices\nend_header\n");
	kit_append(&bytes, "\xff\xff\xff\xff\0\0\0\0", 8);
	model = kit_import_bytes(*state, "a.ply", bytes.data, bytes.size_bytes);
	kit_assert_refused(model, -ENODATA, "list");
	kit_model_free(model);
	free(bytes.data);
	kit_assert_text_refused(*state, "a.ply",
				"ply\nformat ascii 1.0\nelement vertex 0\n" XYZ
				"element face 1\nproperty list int int vertex_indices\n"
				"end_header\n-5 1 2 3\n",
				-EUCLEAN, "list");
}

static void an_index_outside_of_the_vertices_is_refused(void **state)
{
	static const char *const faces[] = { "3 0 1 3", "3 0 -1 2", "4 0 1 2 4000000000",
					     "3 0 1 99999999999999999999" };

	for (size_t i = 0; i < ARRAY_LENGTH(faces); i++) {
		char text[512];

		(void)snprintf(text, sizeof(text),
			       "ply\nformat ascii 1.0\nelement vertex 3\n" XYZ FACE
			       "end_header\n0 0 0\n1 0 0\n0 1 0\n%s\n",
			       faces[i]);
		kit_assert_text_refused(*state, "a.ply", text, -EUCLEAN, "points at vertex");
	}
}

static void an_index_outside_is_refused_by_the_join_too(void **state)
{
	kit_assert_text_refused(*state, "a.ply",
				"ply\nformat ascii 1.0\n" FACE "element vertex 3\n" XYZ
				"end_header\n3 0 1 3\n0 0 0\n1 0 0\n0 1 0\n",
				-EUCLEAN, "points at vertex 3 of 3");
}

static void a_file_cut_anywhere_is_refused_or_whole(void **state)
{
	static const char *const encodings[] = { "ascii", "binary_little_endian" };

	for (size_t e = 0; e < ARRAY_LENGTH(encodings); e++) {
		struct kit_bytes bytes = grid(encodings[e], "float", true, "uchar", "int");

		for (size_t i = 0; i < 60; i++) {
			size_t size_bytes = bytes.size_bytes * i / 60;
			struct kit_model *model =
				kit_import_bytes(*state, "a.ply", bytes.data, size_bytes);

			assert_true(model->result == -ENODATA || model->result == -EUCLEAN);
			kit_model_free(model);
		}
		free(bytes.data);
	}
}

static void a_line_that_never_ends_is_refused(void **state)
{
	kit_assert_endless_refused(*state, "a.ply", "ply\ncomment ");
}

static void too_many_elements_or_properties_are_refused(void **state)
{
	struct kit_bytes bytes = { 0 };
	struct kit_model *model;

	kit_print(&bytes, "ply\nformat ascii 1.0\n");
	for (int i = 0; i < 40; i++)
		kit_print(&bytes, "element e%d 0\n", i);
	model = kit_import_bytes(*state, "a.ply", bytes.data, bytes.size_bytes);
	kit_assert_refused(model, -EUCLEAN, "elements");
	kit_model_free(model);
	bytes.size_bytes = 0;
	kit_print(&bytes, "ply\nformat ascii 1.0\nelement vertex 1\n");
	for (int i = 0; i < 200; i++)
		kit_print(&bytes, "property float p%d\n", i);
	model = kit_import_bytes(*state, "a.ply", bytes.data, bytes.size_bytes);
	kit_assert_refused(model, -EUCLEAN, "properties");
	kit_model_free(model);
	free(bytes.data);
}

int main(void)
{
#define PLY_TEST(name)                                                                             \
	cmocka_unit_test_setup_teardown(name, test_folder_setup, test_folder_teardown)
	const struct CMUnitTest tests[] = {
		PLY_TEST(every_encoding_and_type_reads_the_same),
		PLY_TEST(doubles_stay_doubles),
		PLY_TEST(normals_and_colours_come_with_their_corners),
		PLY_TEST(the_colour_option_leaves_vertex_colours_out),
		PLY_TEST(strips_become_triangles_of_one_orientation),
		PLY_TEST(comments_may_say_unit_and_up_axis),
		PLY_TEST(faces_may_come_before_their_vertices),
		PLY_TEST(vertices_that_exceed_memory_give_the_same_triangles),
		PLY_TEST(vertices_that_exceed_memory_without_scratch_are_refused),
		PLY_TEST(gzip_reads_the_same),
		PLY_TEST(a_cancelled_import_or_a_full_sink_ends_it),
		PLY_TEST(ply_refuses_what_is_no_ply),
		PLY_TEST(ply_refuses_a_count_that_the_file_cannot_hold_at_once),
		PLY_TEST(an_element_of_nothing_costs_nothing_however_often),
		PLY_TEST(a_list_longer_than_the_file_is_refused_at_once),
		PLY_TEST(an_index_outside_of_the_vertices_is_refused),
		PLY_TEST(an_index_outside_is_refused_by_the_join_too),
		PLY_TEST(a_file_cut_anywhere_is_refused_or_whole),
		PLY_TEST(a_line_that_never_ends_is_refused),
		PLY_TEST(too_many_elements_or_properties_are_refused),
	};

	return TEST_RUN(tests);
}
