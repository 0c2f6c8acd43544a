/* SPDX-License-Identifier: MIT */
/* Goal: files, folders and scene lists become one list of models, the same every time. */
#include <errno.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

#include "formats/import/import.h"
#include "tests/helper.h"

#define HEADER "file,m00,m01,m02,m03,m10,m11,m12,m13,m20,m21,m22,m23\n"
#define UNIT   ",1,0,0,0,0,1,0,0,0,0,1,0\n"

static void touch(const char *folder, const char *name)
{
	test_file_write(test_path(folder, name), "x", 1);
}

static void make_folder(const char *folder, const char *name)
{
	assert_int_equal(mkdir(test_path(folder, name), 0700), 0);
}

/* Expands one argument, which must succeed. */
static struct import_inputs expand(const char *path)
{
	struct import_inputs inputs;
	char *argument = (char *)path;
	struct why why;

	if (import_inputs_expand(&argument, 1, &inputs, &why) < 0)
		fail_msg("%s", why.text);
	return inputs;
}

static void assert_names(struct import_inputs inputs, const char *const *names)
{
	size_t count = 0;

	for (; names[count]; count++) {
		assert_true(count < inputs.input_count);
		assert_string_equal(inputs.inputs[count].name, names[count]);
		assert_false(inputs.inputs[count].placed);
	}
	assert_int_equal(inputs.input_count, count);
	import_inputs_done(&inputs);
}

static void assert_list_refused(const char *folder, const char *text, const char *words)
{
	const char *path = test_path(folder, "scene.csv");
	struct import_inputs inputs;
	char *argument = (char *)path;
	struct why why;

	test_file_write(path, text, strlen(text));
	assert_int_equal(import_inputs_expand(&argument, 1, &inputs, &why), -EUCLEAN);
	if (!strstr(why.text, words))
		fail_msg("\"%s\" does not say \"%s\"", why.text, words);
}

static void names_of_models_are_known_in_any_case_and_behind_gz(void **state)
{
	static const char *const models[] = { "a.ply",    "b.OBJ",    "c.Stl",   "d.wrl",   "e.wrz",
					      "f.ply.gz", "g.obj.GZ", "h.fbx",   "i.gltf",  "j.dae",
					      "k.vrml",   "x/y.ac",   "a.b.ply", "m.stl.gz" };
	static const char *const others[] = { "a",     "ply",      ".ply",  "a.ply.bak", "a.step",
					      "b.stp", "a.gz",     "a.mtl", "a.png",     "a.csv",
					      "a.ooc", "a.fbx.gz", "",      "a.plyx" };

	(void)state;
	for (size_t i = 0; i < sizeof(models) / sizeof(models[0]); i++)
		if (!import_is_model_name(models[i]))
			fail_msg("%s is a model", models[i]);
	for (size_t i = 0; i < sizeof(others) / sizeof(others[0]); i++)
		if (import_is_model_name(others[i]))
			fail_msg("%s is no model", others[i]);
}

static void a_folder_gives_its_models_in_the_order_of_their_bytes(void **state)
{
	make_folder(*state, "a");
	make_folder(*state, "a/b");
	make_folder(*state, ".hidden");
	touch(*state, "a.ply");
	touch(*state, "a/z.ply");
	touch(*state, "a/b/c.stl");
	touch(*state, "a-b.ply");
	touch(*state, "B.obj");
	touch(*state, "note.txt");
	touch(*state, ".hidden/x.ply");
	touch(*state, ".y.ply");
	assert_names(expand(*state), (const char *const[]){ "B.obj", "a-b.ply", "a.ply",
							    "a/b/c.stl", "a/z.ply", NULL });
	/* A slash at the end changes no name. */
	assert_names(
		expand(test_path(*state, "")),
		(const char *const[]){ "B.obj", "a-b.ply", "a.ply", "a/b/c.stl", "a/z.ply", NULL });
}

static void links_that_loop_or_lead_nowhere_are_passed_over(void **state)
{
	make_folder(*state, "a");
	make_folder(*state, "other");
	touch(*state, "a/m.ply");
	assert_int_equal(symlink("..", test_path(*state, "a/up")), 0);
	assert_int_equal(symlink("self", test_path(*state, "a/self")), 0);
	assert_int_equal(symlink("nowhere.ply", test_path(*state, "a/none.ply")), 0);
	assert_int_equal(symlink("../a/m.ply", test_path(*state, "other/link.ply")), 0);
	assert_names(expand(*state), (const char *const[]){ "a/m.ply", "other/link.ply", NULL });
}

static void folders_too_deep_are_refused(void **state)
{
	struct import_inputs inputs;
	char path[1024];
	size_t length = (size_t)snprintf(path, sizeof(path), "%s", (const char *)*state);
	char *argument = *state;
	struct why why;

	for (int i = 0; i < 45; i++) {
		length += (size_t)snprintf(path + length, sizeof(path) - length, "/d");
		assert_int_equal(mkdir(path, 0700), 0);
	}
	assert_int_equal(import_inputs_expand(&argument, 1, &inputs, &why), -ELOOP);
}

static void several_arguments_stay_in_their_order(void **state)
{
	struct import_inputs inputs;
	char *arguments[2];
	struct why why;

	touch(*state, "b.ply");
	touch(*state, "a.ply");
	arguments[0] = (char *)test_path(*state, "b.ply");
	arguments[1] = (char *)test_path(*state, "a.ply");
	assert_int_equal(import_inputs_expand(arguments, 2, &inputs, &why), 0);
	assert_int_equal(inputs.input_count, 2);
	assert_string_equal(inputs.inputs[0].path, arguments[0]);
	assert_string_equal(inputs.inputs[0].name, arguments[0]);
	assert_string_equal(inputs.inputs[1].path, arguments[1]);
	import_inputs_done(&inputs);
}

static void what_is_missing_is_told(void **state)
{
	struct import_inputs inputs;
	char *argument = (char *)test_path(*state, "none.ply");
	struct why why;

	assert_int_equal(import_inputs_expand(&argument, 1, &inputs, &why), -ENOENT);
	assert_non_null(strstr(why.text, "none.ply"));
}

static void a_scene_list_places_its_models(void **state)
{
	const char *text = "file,m00,m01,m02,m03,m10,m11,m12,m13,m20,m21,m22,m23\r\n"
			   "a.ply,0,-1,0,10.125,1,0,0,-2e3,0,0,1,0.1\r\n"
			   "\r\n"
			   "\"sub/b, \"\"two\"\".ply\", 2 ,0,0,0,0,2,0,0,0,0,-2,0\r\n"
			   "a.ply" UNIT;
	static const double expected[12] = { 0, -1, 0, 10.125, 1, 0, 0, -2000, 0, 0, 1, 0.1 };
	struct import_inputs inputs;

	make_folder(*state, "sub");
	touch(*state, "a.ply");
	touch(*state, "sub/b, \"two\".ply");
	test_file_write(test_path(*state, "scene.csv"), text, strlen(text));
	inputs = expand(test_path(*state, "scene.csv"));
	assert_int_equal(inputs.input_count, 3);
	assert_string_equal(inputs.inputs[0].path, test_path(*state, "a.ply"));
	assert_true(inputs.inputs[0].placed);
	assert_memory_equal(inputs.inputs[0].placement, expected, sizeof(expected));
	assert_string_equal(inputs.inputs[1].path, test_path(*state, "sub/b, \"two\".ply"));
	assert_true(inputs.inputs[1].placement[10] == -2.0);
	assert_true(inputs.inputs[2].placed);
	import_inputs_done(&inputs);
}

static void a_wrong_scene_list_is_refused_with_its_line(void **state)
{
	static const struct {
		const char *text;
		const char *words;
	} cases[] = {
		{ "", "empty" },
		{ "a.ply" UNIT, "line 1" },
		{ "file,m00\n", "line 1" },
		{ HEADER "a.ply\n", "line 2" },
		{ HEADER "a.ply,1,0,0,0,0,1,0,0,0,0,1\n", "line 2" },
		{ HEADER "a.ply" UNIT "a.ply,1,0,0,0,0,1,0,0,0,0,1,0,7\n", "line 3" },
		{ HEADER "a.ply,1,0,0,x,0,1,0,0,0,0,1,0\n", "line 2" },
		{ HEADER "a.ply,1,0,0,nan,0,1,0,0,0,0,1,0\n", "finite" },
		{ HEADER "a.ply,1,0,0,1e999,0,1,0,0,0,0,1,0\n", "finite" },
		{ HEADER "a.ply,1,0,0,0,0,1,0,0,0,0,0,0\n", "singular" },
		{ HEADER "a.ply,1,2,3,0,2,4,6,0,0,0,1,0\n", "singular" },
		{ HEADER "a.ply,0,0,0,0,0,0,0,0,0,0,0,0\n", "singular" },
		{ HEADER "\"a.ply,1,0,0,0,0,1,0,0,0,0,1,0\n", "line 2" },
		{ HEADER "\"a.ply\"x,1,0,0,0,0,1,0,0,0,0,1,0\n", "line 2" },
		{ HEADER UNIT, "line 2" },
		{ HEADER "a.txt" UNIT, "line 2" },
		{ HEADER "none.ply" UNIT, "line 2" },
	};

	touch(*state, "a.ply");
	touch(*state, "a.txt");
	for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++)
		assert_list_refused(*state, cases[i].text, cases[i].words);
}

static void small_and_large_models_are_not_singular(void **state)
{
	const char *text = HEADER "a.ply,1e-9,0,0,0,0,1e-9,0,0,0,0,1e-9,0\n"
				  "a.ply,1e9,0,0,0,0,1e9,0,0,0,0,1e9,1e12\n"
				  "a.ply,1,0,0,0,0,1,0,0,0,0,0.00001,0\n";
	struct import_inputs inputs;

	touch(*state, "a.ply");
	test_file_write(test_path(*state, "scene.csv"), text, strlen(text));
	inputs = expand(test_path(*state, "scene.csv"));
	assert_int_equal(inputs.input_count, 3);
	import_inputs_done(&inputs);
}

int main(void)
{
#define INPUTS_TEST(name)                                                                          \
	cmocka_unit_test_setup_teardown(name, test_folder_setup, test_folder_teardown)
	const struct CMUnitTest tests[] = {
		INPUTS_TEST(names_of_models_are_known_in_any_case_and_behind_gz),
		INPUTS_TEST(a_folder_gives_its_models_in_the_order_of_their_bytes),
		INPUTS_TEST(links_that_loop_or_lead_nowhere_are_passed_over),
		INPUTS_TEST(folders_too_deep_are_refused),
		INPUTS_TEST(several_arguments_stay_in_their_order),
		INPUTS_TEST(what_is_missing_is_told),
		INPUTS_TEST(a_scene_list_places_its_models),
		INPUTS_TEST(a_wrong_scene_list_is_refused_with_its_line),
		INPUTS_TEST(small_and_large_models_are_not_singular),
	};

	return TEST_RUN(tests);
}
