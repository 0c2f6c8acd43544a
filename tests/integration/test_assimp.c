/* SPDX-License-Identifier: MIT */
/* Goal: other formats come through their own process, and whatever happens to it is one line. */
#include <errno.h>
#include <math.h>
#include <pthread.h>
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

/* A box of quads, in a text format that only assimp reads. */
static const char box[] = "OFF\n8 6 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n1 0 1\n1 1 1\n0 1 1\n"
			  "4 0 3 2 1\n4 4 5 6 7\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7\n";

/*
 * glTF with its buffer inside: one triangle (0,0,0) (1,0,0) (0,1,0) at a node that is moved by 10
 * and doubled, within a node that mirrors; a red material.
 */
static const char gltf[] =
	"{\"asset\":{\"version\":\"2.0\"},\"scene\":0,\"scenes\":[{\"nodes\":[0]}],"
	"\"nodes\":[{\"name\":\"outer\",\"children\":[1],\"scale\":[-1,1,1]},"
	"{\"name\":\"inner\",\"mesh\":0,\"translation\":[10,0,0],\"scale\":[2,2,2]}],"
	"\"materials\":[{\"name\":\"paint\",\"pbrMetallicRoughness\":{\"baseColorFactor\":[1,0,0,1]}}],"
	"\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"material\":0}]}],"
	"\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\","
	"\"min\":[0,0,0],\"max\":[1,1,0]}],"
	"\"bufferViews\":[{\"buffer\":0,\"byteLength\":36}],"
	"\"buffers\":[{\"byteLength\":36,\"uri\":\"data:application/octet-stream;base64,"
	"AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA\"}]}";

static void a_box_of_another_format_is_cut_into_triangles(void **state)
{
	struct kit_model *model = kit_import_text(*state, "box.off", box);

	kit_assert_ok(model);
	assert_int_equal(model->triangle_count, 12);
	assert_int_equal(model->info.face_count, 6);
	assert_true(kit_surface(model) == 6.0);
	assert_false(model->positions_double);
	kit_model_free(model);
}

static void nodes_place_name_and_mirror_their_meshes(void **state)
{
	struct kit_model *model = kit_import_text(*state, "scene.gltf", gltf);
	double area[3];

	kit_assert_ok(model);
	assert_int_equal(model->triangle_count, 1);
	assert_true(model->positions_double);
	assert_non_null(strstr(model->parts[0].scene_path, "outer/inner"));
	assert_string_equal(model->parts[0].name, "inner");
	assert_string_equal(model->parts[0].material, "paint");
	assert_int_equal(model->parts[0].colour, 0xff0000ff);
	assert_true(model->info.unit_metres == 1.0);
	assert_int_equal(model->info.up_axis, STORE_AXIS_Y);
	/* Mirrored, yet its outside is where it was. */
	kit_area(model, area);
	assert_true(fabs(area[2] - 4.0) < 1e-6);
	for (int i = 0; i < 3; i++)
		assert_true(model->positions[3 * i] <= -10.0);
	kit_model_free(model);
}

static void what_no_library_knows_is_refused(void **state)
{
	kit_assert_text_refused(*state, "a.xyzzy", "hello\n", -ENOTSUP, "no importer");
	kit_assert_text_refused(*state, "noname", "hello\n", -ENOTSUP, "no importer");
	kit_assert_text_refused(*state, "a.fbx", "", -ENODATA, "empty");
	kit_assert_text_refused(*state, "a.off", "Dear Sir,\nthis is a letter\n", -EUCLEAN,
				"a.off");
	kit_assert_text_refused(*state, "a.gltf", "{\"asset\":", -EUCLEAN, "a.gltf");
	kit_assert_text_refused(*state, "a.dae", "<COLLADA", -EUCLEAN, "a.dae");
}

static void a_reason_is_one_line(void **state)
{
	struct kit_model *model = kit_import_text(*state, "a.fbx", "; FBX 7.4.0\nObjects: {\n");

	assert_true(model->result < 0);
	assert_null(strchr(model->why.text, '\n'));
	kit_model_free(model);
}

/* Sanitizers need more memory than any limit: there is none under them. */
#ifndef OOCD_SANITIZED
static void a_model_that_exceeds_memory_is_refused_in_one_line(void **state)
{
	struct import_options options = { .memory_bytes = 24 * MIB, .scratch_directory = *state };
	struct kit_bytes bytes = { 0 };
	struct kit_model *model;
	const int edge = 600;

	kit_print(&bytes, "OFF\n%d %d 0\n", edge * edge, (edge - 1) * (edge - 1));
	for (int i = 0; i < edge * edge; i++)
		kit_print(&bytes, "%d %d 0\n", i % edge, i / edge);
	for (int i = 0; i < (edge - 1) * (edge - 1); i++) {
		int a = i / (edge - 1) * edge + i % (edge - 1);

		kit_print(&bytes, "4 %d %d %d %d\n", a, a + 1, a + edge + 1, a + edge);
	}
	test_file_write(test_path(*state, "big.off"), bytes.data, bytes.size_bytes);
	model = kit_import(test_path(*state, "big.off"), &options);
	kit_assert_refused(model, -ENOMEM, "convert it to PLY or OBJ first");
	kit_model_free(model);
	options.memory_bytes = 512 * MIB;
	model = kit_import(test_path(*state, "big.off"), &options);
	kit_assert_ok(model);
	assert_int_equal(model->triangle_count, 2 * (edge - 1) * (edge - 1));
	kit_model_free(model);
	free(bytes.data);
}
#endif

static void a_cancelled_import_and_a_full_sink_leave_no_process(void **state)
{
	bool cancelled = true;
	struct import_options options = { .memory_bytes = 64 * MIB,
					  .scratch_directory = *state,
					  .cancelled = &cancelled };
	struct kit_model *model;

	test_file_write(test_path(*state, "box.off"), box, strlen(box));
	model = kit_import(test_path(*state, "box.off"), &options);
	kit_assert_refused(model, -ECANCELED, "cancelled");
	kit_model_free(model);
	kit_batch_fails_at = 1;
	model = kit_import(test_path(*state, "box.off"), NULL);
	kit_assert_refused(model, -ENOSPC, "full");
	kit_model_free(model);
	kit_batch_fails_at = 0;
}

static void *import_one(void *path)
{
	return kit_import(path, NULL);
}

static void several_threads_import_at_once(void **state)
{
	char *path = strdup(test_path(*state, "box.off"));
	pthread_t threads[4];

	assert_non_null(path);
	test_file_write(path, box, strlen(box));
	for (size_t i = 0; i < ARRAY_LENGTH(threads); i++)
		assert_int_equal(pthread_create(&threads[i], NULL, import_one, path), 0);
	for (size_t i = 0; i < ARRAY_LENGTH(threads); i++) {
		void *model;

		assert_int_equal(pthread_join(threads[i], &model), 0);
		kit_assert_ok(model);
		assert_int_equal(((struct kit_model *)model)->triangle_count, 12);
		kit_model_free(model);
	}
	free(path);
}

int main(void)
{
#define ASSIMP_TEST(name)                                                                          \
	cmocka_unit_test_setup_teardown(name, test_folder_setup, test_folder_teardown)
	const struct CMUnitTest tests[] = {
		ASSIMP_TEST(a_box_of_another_format_is_cut_into_triangles),
		ASSIMP_TEST(nodes_place_name_and_mirror_their_meshes),
		ASSIMP_TEST(what_no_library_knows_is_refused),
		ASSIMP_TEST(a_reason_is_one_line),
#ifndef OOCD_SANITIZED
		ASSIMP_TEST(a_model_that_exceeds_memory_is_refused_in_one_line),
#endif
		ASSIMP_TEST(a_cancelled_import_and_a_full_sink_leave_no_process),
		ASSIMP_TEST(several_threads_import_at_once),
	};

	return TEST_RUN(tests);
}
