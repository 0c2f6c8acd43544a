/* SPDX-License-Identifier: MIT */
/*
 * Goal: real models give the counts that are known of them.
 * Method: the sets of tools/fetch-data.  "small" is fetched when it is not there; the large ones are
 * read where somebody has fetched them before.
 */
#include <errno.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "formats/import/import.h"
#include "tests/helper.h"

#define FOLDER_BYTES 4096

/* The folder of a set, or NULL. */
static const char *data_folder(const char *set, bool fetch, char folder[FOLDER_BYTES])
{
	const char *cache = getenv("XDG_CACHE_HOME");
	const char *home = getenv("HOME");
	char command[FOLDER_BYTES];
	FILE *pipe;

	(void)snprintf(folder, FOLDER_BYTES, "%s%s/oocd-data/%s",
		       cache && *cache ? cache : (home ? home : ""),
		       cache && *cache ? "" : "/.cache", set);
	if (access(folder, R_OK) == 0)
		return folder;
	if (!fetch || !getenv("OOCD_SOURCE"))
		return NULL;
	(void)snprintf(command, sizeof(command), "'%s/tools/fetch-data' %s", getenv("OOCD_SOURCE"),
		       set);
	pipe = popen(command, "re");
	if (!pipe)
		return NULL;
	folder[0] = '\0';
	if (fgets(folder, FOLDER_BYTES, pipe))
		folder[strcspn(folder, "\n")] = '\0';
	return pclose(pipe) == 0 && folder[0] ? folder : NULL;
}

static int count_part(void *arg, const struct import_part *part, struct why *why)
{
	(void)arg;
	(void)why;
	assert_non_null(part->name);
	assert_non_null(part->scene_path);
	assert_non_null(part->material);
	return 0;
}

static int count_batch(void *arg, const struct import_batch *batch, struct why *why)
{
	uint64_t *triangle_count = arg;

	(void)why;
	*triangle_count += batch->triangle_count;
	return 0;
}

/* Imports everything in a folder and sums up what is said. */
static size_t import_folder(const char *folder, struct import_info *sum)
{
	const struct import_options options = { .memory_bytes = 64 * MIB,
						.scratch_directory = "/var/tmp" };
	struct import_inputs inputs;
	char *argument = (char *)folder;
	struct why why;
	size_t count;

	memset(sum, 0, sizeof(*sum));
	if (import_inputs_expand(&argument, 1, &inputs, &why) < 0)
		fail_msg("%s", why.text);
	for (size_t i = 0; i < inputs.input_count; i++) {
		uint64_t triangle_count = 0;
		const struct import_sink sink = { .part = count_part,
						  .batch = count_batch,
						  .arg = &triangle_count };
		struct import_info info;

		if (import_file(inputs.inputs[i].path, &options, &sink, &info, &why) < 0)
			fail_msg("%s", why.text);
		assert_int_equal(info.triangle_count, triangle_count);
		sum->triangle_count += info.triangle_count;
		sum->face_count += info.face_count;
		sum->dropped_faces += info.dropped_faces;
		sum->missing_material_file |= info.missing_material_file;
		sum->missing_texture_count += info.missing_texture_count;
	}
	count = inputs.input_count;
	import_inputs_done(&inputs);
	return count;
}

static void assert_file(const char *folder, const char *name, uint64_t triangle_count)
{
	struct import_info info;

	(void)import_folder(test_path(folder, name), &info);
	assert_int_equal(info.triangle_count, triangle_count);
}

static void the_small_set_has_its_known_counts(void **state)
{
	char room[FOLDER_BYTES];
	const char *folder = data_folder("small", true, room);
	struct import_info info;

	(void)state;
	if (!folder) {
		print_message("the package openfoam-examples cannot be had\n");
		skip();
	}
	assert_file(
		folder,
		"incompressible/simpleFoam/windAroundBuildings/constant/triSurface/buildings.obj.gz",
		400020);
	assert_file(folder, "resources/geometry/motorBike.obj.gz", 331653);
	assert_file(folder,
		    "incompressible/simpleFoam/turbineSiting/constant/triSurface/terrain.stl.gz",
		    21186);
	assert_int_equal(import_folder(folder, &info), 123);
	assert_int_equal(info.triangle_count, 2043664);
}

static void the_parts_have_their_known_counts(void **state)
{
	char room[FOLDER_BYTES];
	const char *folder = data_folder("parts", false, room);
	struct import_info info;

	(void)state;
#ifdef OOCD_SANITIZED
	folder = NULL;
#endif
	if (!folder) {
		print_message("optional: tools/fetch-data parts was not run\n");
		return;
	}
	assert_file(folder, "Button_Switch_SMD.3dshapes/SW_SPST_FSMSM.wrl", 1616);
	assert_int_equal(import_folder(folder, &info), 6227);
	assert_int_equal(info.triangle_count, 24480608);
}

static void the_furniture_has_its_known_counts(void **state)
{
	char room[FOLDER_BYTES];
	const char *folder = data_folder("furniture", false, room);
	struct import_info info;

	(void)state;
	if (!folder) {
		print_message("optional: tools/fetch-data furniture was not run\n");
		return;
	}
	assert_int_equal(import_folder(folder, &info), 820);
	assert_int_equal(info.triangle_count, 9890919);
	assert_int_equal(info.dropped_faces, 2244);
	assert_true(info.missing_material_file);
	assert_int_equal(info.missing_texture_count, 26);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(the_small_set_has_its_known_counts),
		cmocka_unit_test(the_parts_have_their_known_counts),
		cmocka_unit_test(the_furniture_has_its_known_counts),
	};

	return TEST_RUN(tests);
}
