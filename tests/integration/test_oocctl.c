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
#include "formats/store/payload.h"
#include "formats/store/store_file.h"
#include "tests/helper.h"
#include "tests/store_image.h"

#define OUTPUT_BYTES (1 << 18)

static char output[OUTPUT_BYTES];

/** Triangles as the bits of their corners, the least corner first, in order: a multiset. */
struct triangle {
	double corners[3][3];
};

struct triangles {
	struct triangle *list;
	size_t count;
};

static int compare_triangles(const void *a, const void *b)
{
	return memcmp(a, b, sizeof(struct triangle));
}

/* Turns a triangle so that its corner of the least bytes is first; winding stays. */
static void add_triangle(struct triangles *triangles, double (*const corners[3])[3])
{
	struct triangle *triangle;
	unsigned least = 0;

	for (unsigned i = 1; i < 3; i++)
		if (memcmp(*corners[i], *corners[least], sizeof(*corners[i])) < 0)
			least = i;
	triangles->list =
		realloc(triangles->list, (triangles->count + 1) * sizeof(*triangles->list));
	assert_non_null(triangles->list);
	triangle = &triangles->list[triangles->count++];
	for (unsigned i = 0; i < 3; i++)
		memcpy(triangle->corners[i], *corners[(least + i) % 3],
		       sizeof(triangle->corners[i]));
}

static void sort_triangles(struct triangles *triangles)
{
	if (triangles->count > 0)
		qsort(triangles->list, triangles->count, sizeof(*triangles->list),
		      compare_triangles);
}

/* ---- what a store holds, by the library ---- */

static void add_payload(struct triangles *triangles, const struct store_superblock *superblock,
			const void *payload, uint32_t part)
{
	struct payload_view view;

	payload_view(payload, &view);
	for (uint32_t i = 0; i < view.header->triangle_count; i++) {
		double positions[3][3];
		double(*const corners[3])[3] = { &positions[0], &positions[1], &positions[2] };

		for (uint32_t k = 0; k < 3; k++) {
			payload_position(&view, payload_index(&view, i, k), positions[k]);
			for (unsigned axis = 0; axis < 3; axis++)
				positions[k][axis] += superblock->origin[axis];
		}
		if (part == UINT32_MAX ||
		    view.runs[payload_vertex_run(&view, payload_index(&view, i, 0))].part == part)
			add_triangle(triangles, corners);
	}
}

/* part: UINT32_MAX means all. */
static struct triangles triangles_of_store(const char *path, uint32_t part)
{
	struct triangles triangles = { 0 };
	struct store_file *store;
	const struct store_superblock *superblock;
	struct store_node *nodes;
	void *payload;
	void *stored;

	assert_int_equal(store_open_path(path, &store, NULL), 0);
	superblock = store_superblock(store);
	nodes = malloc(superblock->node_count * sizeof(*nodes));
	payload =
		aligned_alloc(16, bytes_round_up((uint64_t)superblock->payload_bytes_max + 1, 16));
	stored = malloc((size_t)superblock->payload_bytes_max * 2 + 1);
	assert_int_equal(store_load_hs(store, nodes, NULL), 0);
	for (uint64_t i = 0; i < superblock->node_count; i++) {
		if (nodes[i].payload_id == 0)
			continue;
		assert_int_equal(store_read_payload(store, &nodes[i], payload, stored, NULL), 0);
		add_payload(&triangles, superblock, payload, part);
	}
	free(stored);
	free(payload);
	free(nodes);
	store_close(store);
	sort_triangles(&triangles);
	return triangles;
}

/* ---- what a PLY file of ours holds ---- */

struct ply {
	size_t vertex_count;
	size_t triangle_count;
	bool is_ascii;
	bool is_double;
	unsigned properties; /* of a vertex */
	size_t vertex_bytes;
	const char *data;
};

static struct ply parse_header(const char *text)
{
	struct ply ply = { 0 };
	const char *line = text;

	while (strncmp(line, "end_header\n", 11) != 0) {
		bool of_vertex = ply.triangle_count == 0 && !strstr(line, "element vertex");

		(void)sscanf(line, "element vertex %zu", &ply.vertex_count);
		(void)sscanf(line, "element face %zu", &ply.triangle_count);
		if (strncmp(line, "format ascii", 12) == 0)
			ply.is_ascii = true;
		if (strncmp(line, "property list", 13) != 0 && strncmp(line, "property", 8) == 0 &&
		    of_vertex) {
			ply.is_double |= strncmp(line, "property double", 15) == 0;
			ply.vertex_bytes += strncmp(line, "property double", 15) == 0  ? 8
					    : strncmp(line, "property float", 14) == 0 ? 4
										       : 1;
			ply.properties++;
		}
		line = strchr(line, '\n');
		assert_non_null(line);
		line++;
	}
	ply.data = line + 11;
	return ply;
}

static void read_binary_vertices(const struct ply *ply, double (*positions)[3])
{
	for (size_t i = 0; i < ply->vertex_count; i++) {
		const char *at = ply->data + i * ply->vertex_bytes;

		for (unsigned axis = 0; axis < 3; axis++) {
			float narrow;

			if (ply->is_double) {
				memcpy(&positions[i][axis], at + axis * 8, 8);
			} else {
				memcpy(&narrow, at + axis * 4, 4);
				positions[i][axis] = (double)narrow;
			}
		}
	}
}

static struct triangles triangles_of_ply(const char *path)
{
	struct triangles triangles = { 0 };
	size_t size_bytes;
	char *text = test_file_read(path, &size_bytes);
	struct ply ply;
	double(*positions)[3];
	char *at;

	text[size_bytes] = '\0';
	ply = parse_header(text);
	positions = calloc(ply.vertex_count + 1, sizeof(*positions));
	at = text + (ply.data - text);
	if (ply.is_ascii) {
		for (size_t i = 0; i < ply.vertex_count; i++)
			for (unsigned k = 0; k < ply.properties; k++) {
				double value = strtod(at, &at);

				if (k < 3)
					positions[i][k] = value;
			}
	} else {
		read_binary_vertices(&ply, positions);
		at += ply.vertex_count * ply.vertex_bytes;
	}
	for (size_t i = 0; i < ply.triangle_count; i++) {
		uint32_t corners[3];
		double(*pointers[3])[3];

		if (ply.is_ascii) {
			assert_int_equal(strtol(at, &at, 10), 3);
			for (unsigned k = 0; k < 3; k++)
				corners[k] = (uint32_t)strtoul(at, &at, 10);
		} else {
			assert_int_equal(*at, 3);
			memcpy(corners, at + 1, sizeof(corners));
			at += 13;
		}
		for (unsigned k = 0; k < 3; k++) {
			assert_true(corners[k] < ply.vertex_count);
			pointers[k] = &positions[corners[k]];
		}
		add_triangle(&triangles, pointers);
	}
	if (!ply.is_ascii)
		assert_true(at == text + size_bytes);
	free(positions);
	free(text);
	sort_triangles(&triangles);
	return triangles;
}

static void assert_same_triangles(struct triangles a, struct triangles b)
{
	assert_int_equal(a.count, b.count);
	if (a.count > 0)
		assert_memory_equal(a.list, b.list, a.count * sizeof(*a.list));
	free(a.list);
	free(b.list);
}

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
