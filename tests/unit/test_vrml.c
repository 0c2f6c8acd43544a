/* SPDX-License-Identifier: MIT */
/* Goal: the surfaces of VRML97 scenes, placed and named as the scene says; and hostile scenes. */
#include <errno.h>
#include <math.h>
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

#define HEAD "#VRML V2.0 utf8\n"
#define GEOMETRY                                                                                   \
	"IndexedFaceSet { coordIndex [0,1,2,-1] coord Coordinate { point [0 0 0, 1 0 0, 0 1 0] } }"
#define TRIANGLE "Shape { geometry " GEOMETRY " }\n"
/* A unit square in the plane z = 0, four corners. */
#define SQUARE                                                                                     \
	"Shape { geometry IndexedFaceSet { coordIndex [0 1 2 3] coord Coordinate {"                \
	" point [0 0 0 1 0 0 1 1 0 0 1 0] } } }\n"

static struct kit_model *import_scene(void **state, const char *text)
{
	struct kit_model *model = kit_import_text(*state, "a.wrl", text);

	kit_assert_ok(model);
	return model;
}

static void assert_triangles(void **state, const char *text, size_t count)
{
	struct kit_model *model = import_scene(state, text);

	if (model->triangle_count != count)
		fail_msg("%zu triangles, not %zu, in: %s", model->triangle_count, count, text);
	kit_model_free(model);
}

static void a_part_of_an_electronic_library_is_read(void **state)
{
	/* As the tools of that world write it: materials first, in shapes without geometry. */
	struct kit_model *model = import_scene(
		state, HEAD
		"# made by a test\nShape { appearance Appearance {material DEF PIN-01 Material {\n"
		"ambientIntensity 0.271\ndiffuseColor 0.824 0.82 0.781\ntransparency 0.5\n} } }\n"
		"Shape { appearance Appearance {material DEF BODY Material { diffuseColor 0 0 1 } } }\n"
		"Shape { geometry IndexedFaceSet\n{ creaseAngle 0.50 coordIndex [0,1,2,-1,2,1,3,-1]\n"
		"coord Coordinate { point [-0.315 -0.157 0.018,-0.315 -0.157 0.159,-0.315 0.157 0.018,"
		"-0.315 0.157 0.159]\n}}\nappearance Appearance{material USE PIN-01 }\n}\n"
		"Shape { geometry " GEOMETRY "appearance Appearance{material USE BODY } }\n"
		"Shape { geometry " GEOMETRY "appearance Appearance{material USE PIN-01 } }\n");

	assert_int_equal(model->triangle_count, 4);
	assert_int_equal(model->part_count, 2);
	assert_string_equal(model->parts[0].material, "PIN-01");
	assert_int_equal(model->parts[0].colour, 0x80c7d1d2);
	assert_string_equal(model->parts[1].material, "BODY");
	assert_int_equal(model->triangle_parts[3], 0);
	assert_false(model->positions_double);
	assert_true(model->positions[0] == (double)-0.315f);
	assert_true(model->info.unit_metres == 0.0);
	assert_int_equal(model->info.up_axis, STORE_AXIS_UNKNOWN);
	kit_model_free(model);
}

static void faces_need_no_order_no_commas_and_no_last_minus_one(void **state)
{
	assert_triangles(state, HEAD SQUARE, 2);
	assert_triangles(state,
			 HEAD
			 "Shape{geometry IndexedFaceSet{coord Coordinate{point[0 0 0,1 0 0,,0 1 0]}"
			 "coordIndex[0 1 2 -1 2 1 0 -1]}}",
			 2);
	assert_triangles(state, HEAD "Shape{geometry IndexedFaceSet{}}" TRIANGLE, 1);
	assert_triangles(state,
			 HEAD "Shape{geometry IndexedFaceSet{coordIndex[0 -1 0 1 -1 -1 0 1 2]"
			      "coord Coordinate{point[0 0 0 1 0 0 0 1 0]}}}",
			 1);
}

static void nested_transforms_place_their_shapes(void **state)
{
	struct kit_model *model = import_scene(
		state, HEAD "DEF A Transform { translation 10 0 0 children [ Transform {\n"
			    "rotation 0 0 1 1.5707963267948966 center 1 0 0 scale 2 3 4\n"
			    "children DEF B Group { children [ " TRIANGLE " ] } } ] }\n");
	/* p: minus the centre, scaled, turned by a quarter about Z, plus the centre, plus 10. */
	static const double expected[9] = { 11, -2, 0, 11, 0, 0, 8, -2, 0 };

	assert_true(model->positions_double);
	for (int i = 0; i < 9; i++)
		if (fabs(model->positions[i] - expected[i]) > 1e-12)
			fail_msg("coordinate %d is %.17g, not %g", i, model->positions[i],
				 expected[i]);
	assert_string_equal(model->parts[0].name, "B");
	assert_string_equal(model->parts[0].scene_path, "A/B");
	kit_model_free(model);
}

static void a_scale_along_a_turned_axis_is_applied(void **state)
{
	/* Doubling along the diagonal of x and y takes (1, 0, 0) to (1.5, 0.5, 0). */
	struct kit_model *model = import_scene(
		state, HEAD "Transform { scaleOrientation 0 0 1 0.78539816339744831 scale 2 1 1\n"
			    "children [ " TRIANGLE " ] }\n");

	assert_true(fabs(model->positions[3] - 1.5) < 1e-12);
	assert_true(fabs(model->positions[4] - 0.5) < 1e-12);
	kit_model_free(model);
}

static void mirrors_and_clockwise_faces_keep_the_outside_outside(void **state)
{
	static const struct {
		const char *text;
		double area;
	} cases[] = {
		{ HEAD TRIANGLE, 1.0 },
		{ HEAD "Transform { scale -1 1 1 children " TRIANGLE " }", 1.0 },
		{ HEAD "Shape { geometry IndexedFaceSet { ccw FALSE coordIndex [0 1 2] coord "
		       "Coordinate { point [0 0 0, 1 0 0, 0 1 0] } } }",
		  -1.0 },
	};

	for (size_t i = 0; i < ARRAY_LENGTH(cases); i++) {
		struct kit_model *model = import_scene(state, cases[i].text);
		double area[3];

		kit_area(model, area);
		assert_true(fabs(area[2] - cases[i].area) < 1e-12);
		kit_model_free(model);
	}
}

static void what_is_used_again_is_there_again(void **state)
{
	assert_triangles(state,
			 HEAD "Shape { geometry DEF G " GEOMETRY " } Shape { geometry USE G }", 2);
	assert_triangles(
		state,
		HEAD "DEF S " TRIANGLE "USE S Transform { translation 1 0 0 children USE S }", 3);
	assert_triangles(state,
			 HEAD "DEF T Group { children [ " TRIANGLE
			      " ] } Group { children [ USE T USE T ] }",
			 3);
	/* A coordinate that lines define and faces use. */
	assert_triangles(
		state,
		HEAD
		"Shape { geometry IndexedLineSet { coord DEF C Coordinate { point [0 0 0 1 0 0 0 1 0] }"
		" coordIndex [0 1 -1] } } Shape { geometry IndexedFaceSet { coord USE C coordIndex [0 1 2] } }"
		"Shape { geometry PointSet { coord USE C } }",
		1);
	/* The latest of two definitions counts. */
	assert_triangles(state,
			 HEAD "Shape { geometry DEF G " GEOMETRY
			      " } Shape { geometry DEF G IndexedFaceSet { } } "
			      "Shape { geometry USE G }",
			 1);
}

static void switches_and_levels_show_what_they_choose(void **state)
{
	assert_triangles(state, HEAD "Switch { choice [ " TRIANGLE SQUARE " ] }", 0);
	assert_triangles(state, HEAD "Switch { whichChoice 1 choice [ " TRIANGLE SQUARE " ] }", 2);
	assert_triangles(state, HEAD "Switch { whichChoice 5 choice [ " TRIANGLE SQUARE " ] }", 0);
	assert_triangles(state, HEAD "LOD { range [ 3 ] level [ " SQUARE TRIANGLE " ] }", 2);
	assert_triangles(state, HEAD "Anchor { url \"x\" children [ " SQUARE " ] }", 2);
}

static void unknown_nodes_and_prototypes_are_passed_over(void **state)
{
	assert_triangles(
		state,
		HEAD
		"Strange { a 1 b [ 2 3 ] c \"}\" d Other { e [ Odd { } ] } } # }\n"
		"WorldInfo { title \"a \\\" } title\" }\n"
		"PROTO Thing [ field SFNode n NULL exposedField MFNode m [ ] ] { Group { children [ " TRIANGLE
		" ] } }\nEXTERNPROTO Far [ field SFFloat f ] [ \"far.wrl\" ]\nThing { n " TRIANGLE
		" }\n"
		"ROUTE A.x TO B.y\nScript { url \"javascript: if (a) { b }\" directOutput TRUE }\n" TRIANGLE
		"Shape { geometry Box { size 1 2 3 } }\n"
		"Shape { appearance Appearance { texture ImageTexture { url \"a.png\" } } geometry " GEOMETRY
		" }\n",
		2);
}

static void colours_and_normals_are_read_by_corner_and_by_face(void **state)
{
	struct kit_model *model = import_scene(
		state, HEAD "Shape { geometry IndexedFaceSet { coordIndex [0 1 2 -1 2 1 0 -1]\n"
			    "coord Coordinate { point [0 0 0 1 0 0 0 1 0] }\n"
			    "color Color { color [1 0 0, 0 1 0, 0 0 1] }\n"
			    "normal Normal { vector [0 0 1, 0 1 0] } normalPerVertex FALSE } }");

	assert_int_equal(model->colours[1], 0xff00ff00);
	assert_int_equal(model->colours[3], 0xffff0000);
	assert_true(model->normals[2] == 1.0f);
	assert_true(model->normals[9 + 1] == 1.0f);
	kit_model_free(model);
	model = import_scene(state, HEAD
			     "Shape { geometry IndexedFaceSet { coordIndex [0 1 2 -1 2 1 0 -1]\n"
			     "coord Coordinate { point [0 0 0 1 0 0 0 1 0] } colorPerVertex FALSE\n"
			     "color Color { color [1 0 0, 0 1 0] } colorIndex [1 0]\n"
			     "normal Normal { vector [0 0 1] } normalIndex [0 0 0 -1 0 0 0] } }");
	assert_int_equal(model->colours[0], 0xff00ff00);
	assert_int_equal(model->colours[3], 0xff0000ff);
	assert_true(model->normals[9 + 8] == 1.0f);
	kit_model_free(model);
}

static void gzip_by_any_of_its_names_reads_the_same(void **state)
{
	static const char *const names[] = { "a.wrl.gz", "a.wrz", "a.vrml.gz", "a.txt" };
	const char *text = HEAD SQUARE TRIANGLE;
	struct kit_model *expected = import_scene(state, text);

	for (size_t i = 0; i < ARRAY_LENGTH(names); i++) {
		struct kit_model *model;

		kit_write_gzip(test_path(*state, names[i]), text, strlen(text));
		model = kit_import(test_path(*state, names[i]), NULL);
		kit_assert_same(expected, model);
		kit_model_free(model);
	}
	kit_model_free(expected);
}

/* ---- hostile ---- */

static void vrml_refuses_what_is_wrong_with_the_line(void **state)
{
	static const struct kit_refusal cases[] = {
		{ "", -ENODATA, "empty" },
		{ "Dear Sir,\nthis is a letter.\n", -EUCLEAN, "VRML" },
		{ "#VRML V1.0 ascii\nSeparator { }\n", -EUCLEAN, "V2.0" },
		{ HEAD "Group {", -ENODATA, "line 2" },
		{ HEAD "Group { }\n}", -EUCLEAN, "line 3" },
		{ HEAD "{ }", -EUCLEAN, "line 2" },
		{ HEAD "USE nothing", -EUCLEAN, "no DEF" },
		{ HEAD "DEF x", -EUCLEAN, "DEF" },
		{ HEAD "DEF x Group", -EUCLEAN, "DEF" },
		{ HEAD "DEF x Group { children USE x }", -EUCLEAN, "no DEF" },
		{ HEAD "WorldInfo { title \"unterminated", -ENODATA, "too early" },
		{ HEAD "PROTO X [", -ENODATA, "too early" },
		{ HEAD "PROTO X [ ] Group { }", -EUCLEAN, "PROTO" },
		{ HEAD "Shape { geometry IndexedFaceSet { coordIndex [ 0 1 x ] } }", -EUCLEAN,
		  "line 2" },
		{ HEAD "Shape { geometry IndexedFaceSet { coordIndex [ 0 1 2", -ENODATA, "line 2" },
		{ HEAD "Shape { geometry IndexedFaceSet { coord Coordinate { point [ 0 0", -ENODATA,
		  "line 2" },
		{ HEAD "Transform { translation 1 2 }", -EUCLEAN, "line 2" },
		{ HEAD
		  "Shape { geometry IndexedFaceSet { coordIndex [0 1 3] coord Coordinate { point "
		  "[0 0 0 1 0 0 0 1 0] } } }",
		  -EUCLEAN, "vertex 3 of 3" },
		{ HEAD
		  "Shape { geometry IndexedFaceSet { coordIndex [0 1 -7] coord Coordinate { point "
		  "[0 0 0 1 0 0 0 1 0] } } }",
		  -EUCLEAN, "points at vertex" },
		{ HEAD "Shape { geometry IndexedFaceSet { coordIndex [0 1 99999999999] coord "
		       "Coordinate { point [0 0 0 1 0 0 0 1 0] } } }",
		  -EUCLEAN, "points at vertex" },
		{ HEAD
		  "Shape { geometry IndexedFaceSet { coordIndex [0 1 2] coord Coordinate { point "
		  "[0 0 0 1 0 0 0 1 0] } color Color { color [1 1 1] } } }",
		  -EUCLEAN, "colour" },
		{ HEAD
		  "Shape { geometry IndexedFaceSet { coordIndex [0 1 2] coord Coordinate { point "
		  "[0 0 0 1 0 0 0 1 0] } normal Normal { vector [1 1 1] } normalIndex [0] } }",
		  -EUCLEAN, "normal" },
	};

	kit_assert_all_refused(*state, "a.wrl", cases, ARRAY_LENGTH(cases));
}

static void nodes_nested_too_deep_are_refused(void **state)
{
	struct kit_bytes bytes = { 0 };
	struct kit_model *model;

	kit_print(&bytes, HEAD);
	for (int i = 0; i < 100000; i++)
		kit_print(&bytes, "Group { children [ ");
	model = kit_import_bytes(*state, "a.wrl", bytes.data, bytes.size_bytes);
	kit_assert_refused(model, -EUCLEAN, "nested");
	kit_model_free(model);
	free(bytes.data);
}

static void a_bomb_of_uses_is_refused(void **state)
{
	struct kit_bytes bytes = { 0 };
	struct kit_model *model;

	/* 2^60 shapes in less than 3 KB. */
	kit_print(&bytes, HEAD "DEF g0 Group { }\n");
	for (int i = 1; i <= 60; i++)
		kit_print(&bytes, "DEF g%d Group { children [ USE g%d USE g%d ] }\n", i, i - 1,
			  i - 1);
	model = kit_import_bytes(*state, "a.wrl", bytes.data, bytes.size_bytes);
	kit_assert_refused(model, -EUCLEAN, "repeat");
	kit_model_free(model);
	free(bytes.data);
}

static void a_scene_larger_than_memory_is_refused(void **state)
{
	struct kit_bytes bytes = { 0 };
	struct import_options options = { .memory_bytes = 16 * MIB, .scratch_directory = *state };
	struct kit_model *model;

	kit_print(&bytes, HEAD "Shape { geometry IndexedFaceSet { coord Coordinate { point [");
	for (int i = 0; i < 2000000; i++)
		kit_print(&bytes, "%d ", i % 10);
	kit_print(&bytes, "] } } }");
	test_file_write(test_path(*state, "a.wrl"), bytes.data, bytes.size_bytes);
	model = kit_import(test_path(*state, "a.wrl"), &options);
	kit_assert_refused(model, -ENOMEM, "PLY");
	kit_model_free(model);
	free(bytes.data);
}

static void a_file_cut_anywhere_is_refused_or_whole(void **state)
{
	const char *text = HEAD "DEF A Transform { rotation 0 0 1 0.5 children [ " TRIANGLE SQUARE
				" Strange { a \"b\" } ] }";

	for (size_t size_bytes = 1; size_bytes < strlen(text); size_bytes++) {
		struct kit_model *model = kit_import_bytes(*state, "a.wrl", text, size_bytes);

		if (model->result < 0 && model->result != -ENODATA && model->result != -EUCLEAN)
			fail_msg("%zu bytes: %d: %s", size_bytes, model->result, model->why.text);
		kit_model_free(model);
	}
}

int main(void)
{
#define VRML_TEST(name)                                                                            \
	cmocka_unit_test_setup_teardown(name, test_folder_setup, test_folder_teardown)
	const struct CMUnitTest tests[] = {
		VRML_TEST(a_part_of_an_electronic_library_is_read),
		VRML_TEST(faces_need_no_order_no_commas_and_no_last_minus_one),
		VRML_TEST(nested_transforms_place_their_shapes),
		VRML_TEST(a_scale_along_a_turned_axis_is_applied),
		VRML_TEST(mirrors_and_clockwise_faces_keep_the_outside_outside),
		VRML_TEST(what_is_used_again_is_there_again),
		VRML_TEST(switches_and_levels_show_what_they_choose),
		VRML_TEST(unknown_nodes_and_prototypes_are_passed_over),
		VRML_TEST(colours_and_normals_are_read_by_corner_and_by_face),
		VRML_TEST(gzip_by_any_of_its_names_reads_the_same),
		VRML_TEST(vrml_refuses_what_is_wrong_with_the_line),
		VRML_TEST(nodes_nested_too_deep_are_refused),
		VRML_TEST(a_bomb_of_uses_is_refused),
		VRML_TEST(a_scene_larger_than_memory_is_refused),
		VRML_TEST(a_file_cut_anywhere_is_refused_or_whole),
	};

	return TEST_RUN(tests);
}
