/* SPDX-License-Identifier: MIT */
/* Goal: what oocctl says and writes of a store is what the store holds, and failures leave nothing. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <jansson.h>

#include "formats/base/bytes.h"
#include "tests/helper.h"
#include "tests/integration/triangles.h"
#include "tests/store_image.h"

#define OUTPUT_BYTES (1 << 18)

static char output[OUTPUT_BYTES];

/* ---- tests ---- */

static void an_export_is_what_the_store_holds(void **state)
{
	const char *store = test_path(*state, "grid.ooc");
	const char *ply = test_path(*state, "grid.ply");

	for (unsigned i = 0; i < 8; i++) {
		const struct test_grid grid = {
			.count = i == 0 ? 0 : 3,
			.codec = i % 4,
			.float_positions = i & 4,
			.normals = true,
			.colours = true,
		};

		test_store_grid_make(store, &grid);
		if (test_command(output, sizeof(output), "$OOCD_BIN/oocctl export %s -o %s %s %s",
				 store, ply, i & 1 ? "--ascii" : "",
				 i & 2 ? "--normals --colours" : "") != 0)
			fail_msg("%s", output);
		assert_same_triangles(triangles_of_store(store, UINT32_MAX), triangles_of_ply(ply));
	}
}

static void positions_that_no_float_holds_are_written_as_doubles(void **state)
{
	const char *store = test_path(*state, "grid.ooc");
	const char *ply = test_path(*state, "grid.ply");
	struct store_image image;

	test_store_grid(store, 2);
	store_image_load(store, &image);
	store_image_superblock(&image, 0)->origin[1] = 1e7 + 0.015625;
	store_image_seal_superblock(&image, 0);
	store_image_save(&image, store);
	store_image_done(&image);
	assert_int_equal(test_command(output, sizeof(output), "$OOCD_BIN/oocctl export %s -o %s",
				      store, ply),
			 0);
	assert_int_equal(
		test_command(output, sizeof(output), "head -c 200 %s | grep -c double", ply), 0);
	assert_same_triangles(triangles_of_store(store, UINT32_MAX), triangles_of_ply(ply));
}

static void an_export_can_be_of_parts_and_of_boxes(void **state)
{
	const char *store = test_path(*state, "grid.ooc");
	const char *ply = test_path(*state, "grid.ply");
	struct triangles triangles;

	test_store_grid_make(store, &(struct test_grid){ .count = 4, .part_count = 2 });
	/* Part 0 is the only one of the first section. */
	assert_int_equal(test_command(NULL, 0, "$OOCD_BIN/oocctl export %s -o %s --part 'first*'",
				      store, ply),
			 0);
	assert_same_triangles(triangles_of_store(store, 0), triangles_of_ply(ply));
	/* One box of the grid: the cube from the store's origin. */
	assert_int_equal(
		test_command(NULL, 0,
			     "$OOCD_BIN/oocctl export %s -o %s --box 100,200,300,101,201,301",
			     store, ply),
		0);
	triangles = triangles_of_ply(ply);
	assert_int_equal(triangles.count, 12);
	free(triangles.list);
	assert_int_equal(test_command(NULL, 0, "$OOCD_BIN/oocctl export %s -o %s --box 0,0,0,1,1,1",
				      store, ply),
			 0);
	triangles = triangles_of_ply(ply);
	assert_int_equal(triangles.count, 0);
	free(triangles.list);
	/* To standard output, with both. */
	assert_int_equal(test_command(NULL, 0,
				      "$OOCD_BIN/oocctl export %s -o - --part 'first*' "
				      "--box 100,200,300,104,204,304 >%s",
				      store, ply),
			 0);
	assert_same_triangles(triangles_of_store(store, 0), triangles_of_ply(ply));
}

static void an_export_that_fails_leaves_no_file(void **state)
{
	const char *store = test_path(*state, "grid.ooc");
	struct store_image image;

	test_store_grid(store, 3);
	assert_int_equal(test_command(output, sizeof(output),
				      "$OOCD_BIN/oocctl export %s -o %s/no/x.ply", store,
				      (char *)*state),
			 1);
	assert_int_equal(test_command(output, sizeof(output),
				      "$OOCD_BIN/oocctl export %s -o %s/x.ply --part nothing",
				      store, (char *)*state),
			 1);
	assert_non_null(strstr(output, "no part matches"));
	assert_int_equal(test_command(output, sizeof(output),
				      "$OOCD_BIN/oocctl export %s -o %s/x.ply --normals", store,
				      (char *)*state),
			 1);
	assert_non_null(strstr(output, "has no normals"));
	store_image_load(store, &image);
	image.bytes[store_image_nodes(&image)[8].file_offset + 300] ^= 1;
	store_image_save(&image, store);
	store_image_done(&image);
	assert_int_equal(test_command(output, sizeof(output),
				      "$OOCD_BIN/oocctl export %s -o %s/x.ply", store,
				      (char *)*state),
			 1);
	assert_non_null(strstr(output, "node 8"));
	/* A full device, as far as a pipe can play one. */
	test_store_grid(store, 3);
	assert_int_equal(test_command(output, sizeof(output),
				      "$OOCD_BIN/oocctl export %s -o - >/dev/full", store),
			 1);
	assert_string_equal(test_folder_list(*state), "grid.ooc ");
}

static json_t *command_json(const char *arguments, const char *store, int expected_status)
{
	json_error_t error;
	json_t *json;

	assert_int_equal(test_command(output, sizeof(output), "$OOCD_BIN/oocctl %s %s 2>/dev/null",
				      arguments, store),
			 expected_status);
	json = json_loads(output, 0, &error);
	if (!json)
		fail_msg("%s: %s", error.text, output);
	return json;
}

static void info_and_parts_say_what_was_stored(void **state)
{
	const char *store = test_path(*state, "grid.ooc");
	json_t *json;

	test_store_grid_make(store, &(struct test_grid){ .count = 5, .codec = 3 });
	json = command_json("info --json", store, 0);
	assert_int_equal(json_integer_value(json_object_get(json, "triangles")), 1500);
	assert_int_equal(json_integer_value(json_object_get(json, "leaves")), 27);
	assert_int_equal(json_integer_value(
				 json_object_get(json_object_get(json, "codecs"), "meshopt+zstd")),
			 27);
	json_decref(json);
	json = command_json("parts --json", store, 0);
	assert_int_equal(json_array_size(json), 4);
	assert_string_equal(json_string_value(json_object_get(json_array_get(json, 3), "section")),
			    "second half");
	json_decref(json);
	assert_int_equal(test_command(output, sizeof(output), "$OOCD_BIN/oocctl info %s", store),
			 0);
	assert_non_null(strstr(output, "1500 of 1500"));
	assert_int_equal(
		test_command(output, sizeof(output), "$OOCD_BIN/oocctl parts %s 'pa?t'", store), 0);
	assert_non_null(strstr(output, "plant/floor/box"));

	test_store_grid(store, 0);
	json = command_json("info --json", store, 0);
	assert_int_equal(json_integer_value(json_object_get(json, "nodes")), 1);
	json_decref(json);
}

static void verify_names_what_is_damaged(void **state)
{
	const char *store = test_path(*state, "grid.ooc");
	struct store_image image;
	const json_t *damage;
	json_t *json;

	test_store_grid(store, 3);
	json = command_json("verify --json", store, 0);
	assert_true(json_is_true(json_object_get(json, "whole")));
	json_decref(json);

	store_image_load(store, &image);
	image.bytes[store_image_nodes(&image)[8].file_offset + 800] ^= 1;
	image.bytes[store_image_nodes(&image)[3].file_offset + 800] ^= 1;
	store_image_save(&image, store);
	store_image_done(&image);
	json = command_json("verify --json", store, 1);
	assert_true(json_is_false(json_object_get(json, "whole")));
	assert_int_equal(json_array_size(json_object_get(json, "damage")), 2);
	damage = json_array_get(json_object_get(json, "damage"), 0);
	assert_int_equal(json_integer_value(json_object_get(damage, "node")), 3);
	assert_int_equal(json_array_size(json_object_get(damage, "box")), 6);
	assert_true(json_array_size(json_object_get(damage, "parts")) > 0);
	json_decref(json);
	assert_int_equal(test_command(output, sizeof(output), "$OOCD_BIN/oocctl verify %s", store),
			 1);
	assert_non_null(strstr(output, "node 8: payload: wrong checksum"));
	assert_non_null(strstr(output, "parts: part"));

	/* What does not even open is said in the same way. */
	test_file_write(store, "ply\n", 4);
	json = command_json("verify --json", store, 1);
	assert_int_equal(json_array_size(json_object_get(json, "damage")), 1);
	json_decref(json);
	assert_int_equal(test_command(output, sizeof(output), "$OOCD_BIN/oocctl verify %s", store),
			 1);
	assert_non_null(strstr(output, "grid.ooc: is no store; build it again"));
	assert_int_equal(test_command(output, sizeof(output), "$OOCD_BIN/oocctl verify %s/none",
				      (char *)*state),
			 1);
	assert_non_null(strstr(output, "No such file"));
}

static void wrong_usage_is_told_from_failure(void **state)
{
	static const char *const wrong[] = {
		"",
		"nonsense",
		"info",
		"info a b",
		"parts",
		"parts a b c",
		"export a",
		"export -o x",
		"export a --box 1 -o x",
		"export a --box 1,1,1,0,0,0 -o x",
		"status a",
		"nodes",
		"verify --nonsense a",
	};
	static const char *const verbs[] = { "",       "info",   "parts",  "verify",
					     "export", "status", "stores", "nodes" };

	(void)state;
	for (size_t i = 0; i < ARRAY_LENGTH(wrong); i++)
		if (test_command(output, sizeof(output), "$OOCD_BIN/oocctl %s", wrong[i]) != 2)
			fail_msg("oocctl %s: %s", wrong[i], output);
	for (size_t i = 0; i < ARRAY_LENGTH(verbs); i++) {
		assert_int_equal(test_command(output, sizeof(output), "$OOCD_BIN/oocctl %s --help",
					      verbs[i]),
				 0);
		assert_non_null(strstr(output, "Usage: oocctl"));
	}
	assert_int_equal(test_command(output, sizeof(output), "$OOCD_BIN/oocctl --version"), 0);
	assert_int_equal(test_command(output, sizeof(output),
				      "$OOCD_BIN/oocctl status --socket /nonexistent/oocd.sock"),
			 1);
	assert_non_null(strstr(output, "is `oocd` running?"));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(an_export_is_what_the_store_holds,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(
			positions_that_no_float_holds_are_written_as_doubles, test_folder_setup,
			test_folder_teardown),
		cmocka_unit_test_setup_teardown(an_export_can_be_of_parts_and_of_boxes,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(an_export_that_fails_leaves_no_file,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(info_and_parts_say_what_was_stored,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(verify_names_what_is_damaged, test_folder_setup,
						test_folder_teardown),
		cmocka_unit_test(wrong_usage_is_told_from_failure),
	};

	return TEST_RUN(tests);
}
