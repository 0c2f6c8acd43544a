/* SPDX-License-Identifier: MIT */
/* Goal: OBJ and MTL as they are found in the wild; larger than memory; and hostile. */
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
#include "tests/helper.h"
#include "tests/unit/import_kit.h"

#define SQUARE "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"

static void assert_surface(void **state, const char *text, size_t triangles, double surface)
{
	struct kit_model *model = kit_import_text(*state, "a.obj", text);

	kit_assert_ok(model);
	assert_int_equal(model->triangle_count, triangles);
	if (kit_surface(model) != surface)
		fail_msg("the surface is %g, not %g, of: %s", kit_surface(model), surface, text);
	kit_model_free(model);
}

static void every_form_of_a_corner_is_read(void **state)
{
	assert_surface(state, SQUARE "f 1 2 3\n", 1, 0.5);
	assert_surface(state, SQUARE "vt 0 0\nf 1/1 2/1 3/1\n", 1, 0.5);
	assert_surface(state, SQUARE "vn 0 0 1\nf 1//1 2//1 3//1\n", 1, 0.5);
	assert_surface(state, SQUARE "vt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1 4/1/1\n", 2, 1.0);
	assert_surface(state, SQUARE "f -4 -3 -2 -1\n", 2, 1.0);
	assert_surface(state, SQUARE "f 1/ 2/ 3/\n", 1, 0.5);
	assert_surface(state, SQUARE "vn 0 0 1\nf 1//-1 2//-1 3//-1\n", 1, 0.5);
}

static void blanks_line_ends_and_continuations_change_nothing(void **state)
{
	static const char *const texts[] = {
		"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4",
		"v 0 0 0\r\nv 1 0 0\r\nv 1 1 0\r\nv 0 1 0\r\nf 1 2 3 4\r\n",
		"\t v\t0 0  0 \nv 1 0 0\nv 1 1 0\n\n# a comment\nv 0 1 0\n  f  1 2\t3 4  \n",
		"v 0 0 0\nv 1 0 \\\n0\nv 1 1 0\nv 0 \\\r\n1 \\\r\n0\nf 1 2 \\\n3 \\\n4\n",
		"#\nv 0 0 0 1.0\nv 1 0 0 1.0\nv 1 1 0 1.0\nv 0 1 0 1.0\nvt 0 0\nvp 1 1\ns off\nf 1 2 3 4\nl 1 2\n",
	};

	for (size_t i = 0; i < ARRAY_LENGTH(texts); i++)
		assert_surface(state, texts[i], 2, 1.0);
}

static void concave_faces_are_cut_within_themselves(void **state)
{
	/* A notch: a fan from its first corner would cover 10, not 8. */
	assert_surface(state, "v 0 0 0\nv 4 0 0\nv 4 3 0\nv 2 1 0\nv 0 3 0\nf 1 2 3 4 5\n", 3, 8.0);
	/* Standing upright, and turned round. */
	assert_surface(state, "v 7 0 0\nv 7 4 0\nv 7 4 3\nv 7 2 1\nv 7 0 3\nf 5 4 3 2 1\n", 3, 8.0);
}

static void odd_faces_are_counted_and_kept(void **state)
{
	struct kit_model *model = kit_import_text(
		*state, "a.obj", SQUARE "f 1\nf 1 2\nf 1 1 2\nf 1 2 2 3 4 4\nf\nf 1 2 3\n");

	kit_assert_ok(model);
	assert_int_equal(model->info.face_count, 6);
	assert_int_equal(model->info.dropped_faces, 3);
	assert_int_equal(model->triangle_count, 1 + 4 + 1);
	assert_true(kit_surface(model) == 1.5);
	kit_model_free(model);
}

static void coordinates_keep_all_their_digits(void **state)
{
	struct kit_model *model = kit_import_text(
		*state, "a.obj", "v 5412345.123456 0.1 1e-20\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");

	kit_assert_ok(model);
	assert_true(model->positions_double);
	assert_true(model->positions[0] == 5412345.123456);
	assert_true(model->positions[1] == 0.1);
	assert_true(model->positions[2] == 1e-20);
	kit_model_free(model);
}

static void colours_of_vertices_are_read_in_both_scales(void **state)
{
	struct kit_model *model = kit_import_text(
		*state, "a.obj", "v 0 0 0 1 0 0\nv 1 0 0 0 255 0\nv 1 1 0\nf 1 2 3\n");

	kit_assert_ok(model);
	assert_true(model->has_colours);
	assert_int_equal(model->colours[0], 0xff0000ff);
	assert_int_equal(model->colours[1], 0xff00ff00);
	assert_int_equal(model->colours[2], IMPORT_COLOUR_DEFAULT);
	kit_model_free(model);
}

static void normals_are_there_where_a_face_has_them(void **state)
{
	struct kit_model *model = kit_import_text(
		*state, "a.obj", SQUARE "vn 0 0 1\nvn 0 1 0\nf 1//2 2//1 3//1\nf 1 2 3\n");

	kit_assert_ok(model);
	assert_int_equal(model->batch_count, 2);
	assert_true(model->normals[1] == 1.0f);
	assert_true(model->normals[5] == 1.0f);
	assert_true(model->normals[9 + 2] == 0.0f);
	kit_model_free(model);
}

static void groups_and_materials_are_parts_that_come_back(void **state)
{
	const char *library = "newmtl red\r\nKd 1 0 0\r\nd 0.5\r\nnewmtl blue\r\n\tKd 0 0 1\r\n";
	struct kit_model *model;

	test_file_write(test_path(*state, "lib with blank.mtl"), library, strlen(library));
	model = kit_import_text(
		*state, "a.obj",
		"mtllib lib with blank.mtl\n" SQUARE
		"o Table\ng top\nusemtl red\nf 1 2 3\ng legs\nusemtl blue\nf 1 2 3\n"
		"g top\nusemtl red\nf 1 2 3\nusemtl unknown\nf 1 2 3\no Chair\nf 1 2 3\n");
	kit_assert_ok(model);
	assert_false(model->info.missing_material_file);
	assert_int_equal(model->part_count, 4);
	assert_string_equal(model->parts[0].name, "top");
	assert_string_equal(model->parts[0].scene_path, "Table/top");
	assert_string_equal(model->parts[0].material, "red");
	assert_int_equal(model->parts[0].colour, 0x800000ff);
	assert_int_equal(model->parts[1].colour, 0xffff0000);
	assert_int_equal(model->triangle_parts[2], 0);
	assert_string_equal(model->parts[2].material, "unknown");
	assert_int_equal(model->parts[2].colour, IMPORT_COLOUR_DEFAULT);
	assert_string_equal(model->parts[3].name, "Chair");
	assert_string_equal(model->parts[3].scene_path, "Chair");
	kit_model_free(model);
}

static void the_material_file_of_another_machine_is_found_by_its_name(void **state)
{
	static const char *const names[] = { "C:\\models\\some\\lib.mtl", "/nowhere/lib.mtl",
					     "./lib.mtl", "none.mtl lib.mtl" };

	test_file_write(test_path(*state, "lib.mtl"), "newmtl m\nKd 0 1 0\n", 18);
	for (size_t i = 0; i < ARRAY_LENGTH(names); i++) {
		char text[256];
		struct kit_model *model;

		(void)snprintf(text, sizeof(text), "mtllib %s\n" SQUARE "usemtl m\nf 1 2 3\n",
			       names[i]);
		model = kit_import_text(*state, "a.obj", text);
		kit_assert_ok(model);
		assert_int_equal(model->parts[0].colour, 0xff00ff00);
		kit_model_free(model);
	}
}

static void a_missing_material_file_is_told_and_no_error(void **state)
{
	struct kit_model *model =
		kit_import_text(*state, "a.obj", "mtllib none.mtl\n" SQUARE "usemtl m\nf 1 2 3\n");

	kit_assert_ok(model);
	assert_true(model->info.missing_material_file);
	assert_string_equal(model->parts[0].material, "m");
	assert_int_equal(model->parts[0].colour, IMPORT_COLOUR_DEFAULT);
	kit_model_free(model);
}

static void the_colour_option_goes_from_vertex_to_material_to_grey(void **state)
{
	const char *text = "mtllib lib.mtl\nv 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 1 1 0 1 0 0\n"
			   "usemtl m\nf 1 2 3\n";
	struct import_options options = { .memory_bytes = 64 * MIB, .scratch_directory = *state };

	test_file_write(test_path(*state, "lib.mtl"), "newmtl m\nKd 0 1 0\n", 18);
	test_file_write(test_path(*state, "a.obj"), text, strlen(text));
	for (int colour = IMPORT_COLOUR_TEXTURE; colour <= IMPORT_COLOUR_NONE; colour++) {
		struct kit_model *model;

		options.colour = (enum import_colour)colour;
		model = kit_import(test_path(*state, "a.obj"), &options);
		kit_assert_ok(model);
		assert_int_equal(model->has_colours, colour <= IMPORT_COLOUR_VERTEX);
		assert_int_equal(model->parts[0].colour,
				 colour == IMPORT_COLOUR_NONE ? IMPORT_COLOUR_DEFAULT : 0xff00ff00);
		kit_model_free(model);
	}
}

/* A model of many vertices, normals, parts and kinds of faces, in which these alternate. */
static struct kit_bytes mixed_model(void)
{
	struct kit_bytes bytes = { 0 };

	for (int i = 0; i < 3000; i++) {
		kit_print(&bytes, "v %d %d %d\nv %d 1 0 0 1 0\nvn 0 %d 1\n", i, i % 7, i % 3, i, i);
		if (i % 500 == 3)
			kit_print(&bytes, "g part%d\n", i % 4);
		if (i < 3)
			continue;
		if (i % 3 == 0)
			kit_print(&bytes, "f -1 -3 -5\n");
		else if (i % 3 == 1)
			kit_print(&bytes, "f 1//1 %d//%d -1//-1 -2//-2\n", i, i / 2);
		else
			kit_print(&bytes, "f %d %d 3 4 5\nf 1 2\n", i, i + 1);
	}
	return bytes;
}

static void what_exceeds_memory_gives_the_same_triangles(void **state)
{
	static const uint64_t memories[] = { 70000, 200000, 16 * MIB };
	struct kit_bytes bytes = mixed_model();

	kit_assert_same_within(*state, "a.obj", &bytes, memories, ARRAY_LENGTH(memories));
	free(bytes.data);
}

static void gzip_reads_the_same(void **state)
{
	struct kit_bytes bytes = mixed_model();

	kit_assert_same_gzipped(*state, "a.obj", &bytes);
	free(bytes.data);
}

/* ---- hostile ---- */

static void obj_refuses_what_is_wrong_with_the_line(void **state)
{
	static const struct kit_refusal cases[] = {
		{ "", -ENODATA, "empty" },
		{ "Dear Sir,\nthis is a letter.\n", -EUCLEAN, "no OBJ" },
		{ "v 1 2\n", -EUCLEAN, "line 1" },
		{ "v 1 2 x\n", -EUCLEAN, "line 1" },
		{ "v 1 2 3 four\n", -EUCLEAN, "line 1" },
		{ SQUARE "vn 1 2\n", -EUCLEAN, "line 5" },
		{ SQUARE "f 1 2 5\n", -EUCLEAN, "line 5" },
		{ SQUARE "f 1 2 0\n", -EUCLEAN, "points at vertex" },
		{ SQUARE "f 1 2 -5\n", -EUCLEAN, "points at vertex" },
		{ SQUARE "f 1 2 99999999999999999999999\n", -EUCLEAN, "corner" },
		{ SQUARE "f 1 2 4611686018427387904\n", -EUCLEAN, "points at vertex" },
		{ SQUARE "f 1 2 900000000000000000\n", -EUCLEAN, "points at vertex" },
		{ SQUARE "f 1//1 2//1 3//1\n", -EUCLEAN, "points at normal" },
		{ SQUARE "f 1 2 three\n", -EUCLEAN, "line 5" },
		{ SQUARE "f 1 2 3,4\n", -EUCLEAN, "line 5" },
		{ SQUARE "f 1 2 3 \\", -ENODATA, "line 5" },
	};

	kit_assert_all_refused(*state, "a.obj", cases, ARRAY_LENGTH(cases));
}

static void bytes_of_no_text_are_refused(void **state)
{
	struct kit_model *model = kit_import_bytes(*state, "a.obj", "\0\1\2\3\n\0\0", 7);

	kit_assert_refused(model, -EUCLEAN, "no text");
	kit_model_free(model);
}

static void a_face_of_too_many_corners_is_refused(void **state)
{
	struct kit_bytes bytes = { 0 };
	struct kit_model *model;

	kit_print(&bytes, SQUARE "f");
	for (int i = 0; i < 70000; i++)
		kit_print(&bytes, " %d", i % 4 + 1);
	model = kit_import_bytes(*state, "a.obj", bytes.data, bytes.size_bytes);
	kit_assert_refused(model, -EUCLEAN, "65536");
	kit_model_free(model);
	free(bytes.data);
}

static void a_line_that_goes_on_for_ever_is_refused(void **state)
{
	struct kit_bytes bytes = { 0 };
	struct import_options options = { .memory_bytes = 16 * MIB, .scratch_directory = *state };
	struct kit_model *model;

	while (bytes.size_bytes < 12 * MIB)
		kit_print(&bytes, "v 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 \\\n");
	test_file_write(test_path(*state, "a.obj"), bytes.data, bytes.size_bytes);
	model = kit_import(test_path(*state, "a.obj"), &options);
	kit_assert_refused(model, -EUCLEAN, "too long");
	kit_model_free(model);
	free(bytes.data);
}

static void more_names_than_memory_are_refused(void **state)
{
	struct kit_bytes bytes = { 0 };
	struct import_options options = { .memory_bytes = 16 * MIB, .scratch_directory = *state };
	struct kit_model *model;

	kit_print(&bytes, SQUARE);
	for (int i = 0; i < 20000; i++)
		kit_print(&bytes, "g a_long_name_of_a_group_that_comes_only_once_%d\nf 1 2 3\n", i);
	test_file_write(test_path(*state, "a.obj"), bytes.data, bytes.size_bytes);
	model = kit_import(test_path(*state, "a.obj"), &options);
	kit_assert_refused(model, -ENOMEM, "names");
	kit_model_free(model);
	free(bytes.data);
}

int main(void)
{
#define OBJ_TEST(name)                                                                             \
	cmocka_unit_test_setup_teardown(name, test_folder_setup, test_folder_teardown)
	const struct CMUnitTest tests[] = {
		OBJ_TEST(every_form_of_a_corner_is_read),
		OBJ_TEST(blanks_line_ends_and_continuations_change_nothing),
		OBJ_TEST(concave_faces_are_cut_within_themselves),
		OBJ_TEST(odd_faces_are_counted_and_kept),
		OBJ_TEST(coordinates_keep_all_their_digits),
		OBJ_TEST(colours_of_vertices_are_read_in_both_scales),
		OBJ_TEST(normals_are_there_where_a_face_has_them),
		OBJ_TEST(groups_and_materials_are_parts_that_come_back),
		OBJ_TEST(the_material_file_of_another_machine_is_found_by_its_name),
		OBJ_TEST(a_missing_material_file_is_told_and_no_error),
		OBJ_TEST(the_colour_option_goes_from_vertex_to_material_to_grey),
		OBJ_TEST(what_exceeds_memory_gives_the_same_triangles),
		OBJ_TEST(gzip_reads_the_same),
		OBJ_TEST(obj_refuses_what_is_wrong_with_the_line),
		OBJ_TEST(bytes_of_no_text_are_refused),
		OBJ_TEST(a_face_of_too_many_corners_is_refused),
		OBJ_TEST(a_line_that_goes_on_for_ever_is_refused),
		OBJ_TEST(more_names_than_memory_are_refused),
	};

	return TEST_RUN(tests);
}
