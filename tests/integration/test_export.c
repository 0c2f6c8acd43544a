/* SPDX-License-Identifier: MIT */
/*
 * Goal: with --error 0 a model that was built into a store and exported again is the model: the same
 * triangles, as a multiset, with the same bits, whatever layout and codec the store has.
 */
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
#include "tests/integration/triangles.h"

#define SOUP_TRIANGLES 2000u

static char output[8192];

static void build_and_export(const char *folder, const char *model, const char *options)
{
	if (test_command(output, sizeof(output),
			 "cd %s && \"$OOCD_BIN\"/oocbuild --quiet --error 0 %s -o x.ooc %s && "
			 "\"$OOCD_BIN\"/oocctl export x.ooc -o x.ply && "
			 "\"$OOCD_BIN\"/oocctl verify x.ooc",
			 folder, options, model) != 0)
		fail_msg("%s", output);
}

static void a_plant_comes_back_from_every_layout_and_codec(void **state)
{
	static const char *const options[] = {
		"",
		"--layout replicate",
		"--codec meshopt+zstd",
		"--codec meshopt --leaf-triangles 500",
		"--codec zstd --layout replicate --jobs 2",
	};

	assert_int_equal(test_command(output, sizeof(output),
				      "\"$OOCD_BIN\"/oocgen plant --triangles 10000 --seed 7 "
				      "-o %s/model.ply",
				      (char *)*state),
			 0);
	for (size_t i = 0; i < ARRAY_LENGTH(options); i++) {
		build_and_export(*state, "model.ply", options[i]);
		assert_same_triangles(triangles_of_ply(test_path(*state, "model.ply")),
				      triangles_of_ply(test_path(*state, "x.ply")));
	}
}

/* Small numbers that look random, the same each time. */
static double next_number(uint64_t *random)
{
	*random = *random * UINT64_C(6364136223846793005) + 1442695040888963407u;
	return (double)(*random >> 40) / (1 << 24) - 0.5;
}

/* Of all sizes; far from the origin so large that rounding makes no two corners the same. */
static double spread(uint64_t *random, double offset)
{
	return offset == 0 ? pow(10, next_number(random) * 8) : 20000;
}

/*
 * Triangles that share nothing, some of them twice, coordinates that floats can hold and little
 * else: -0, numbers without a common grid, far from the origin.
 */
static void write_soup(const char *path, double offset)
{
	FILE *file = fopen(path, "we");
	uint64_t random = 1;

	assert_non_null(file);
	fprintf(file,
		"ply\nformat binary_little_endian 1.0\nelement vertex %u\nproperty float x\n"
		"property float y\nproperty float z\nelement face %u\n"
		"property list uchar uint vertex_indices\nend_header\n",
		SOUP_TRIANGLES * 3, SOUP_TRIANGLES);
	for (uint32_t i = 0; i < SOUP_TRIANGLES * 3; i++) {
		float position[3];

		for (unsigned axis = 0; axis < 3; axis++)
			position[axis] =
				(float)(next_number(&random) * spread(&random, offset) + offset);
		if (i % 7 == 0)
			position[i % 3] = -0.0f;
		(void)fwrite(position, sizeof(position), 1, file);
	}
	for (uint32_t i = 0; i < SOUP_TRIANGLES; i++) {
		/* Every tenth is the one before it once more. */
		uint32_t first = (i % 10 == 9 ? i - 1 : i) * 3;
		uint32_t corners[3] = { first, first + 1, first + 2 };

		(void)fputc(3, file);
		(void)fwrite(corners, sizeof(corners), 1, file);
	}
	assert_int_equal(fclose(file), 0);
}

static void a_soup_of_awkward_floats_comes_back_to_the_bit(void **state)
{
	static const double offsets[] = { 0, 1e7 };
	static const char *const options[] = { "--leaf-triangles 100",
					       "--leaf-triangles 100 --codec meshopt+zstd",
					       "--leaf-triangles 500 --layout replicate" };
	const char *model = test_path(*state, "model.ply");

	for (size_t i = 0; i < ARRAY_LENGTH(offsets); i++) {
		write_soup(model, offsets[i]);
		for (size_t k = 0; k < ARRAY_LENGTH(options); k++) {
			build_and_export(*state, "model.ply", options[k]);
			assert_same_triangles(triangles_of_ply(model),
					      triangles_of_ply(test_path(*state, "x.ply")));
		}
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(a_plant_comes_back_from_every_layout_and_codec,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(a_soup_of_awkward_floats_comes_back_to_the_bit,
						test_folder_setup, test_folder_teardown),
	};

	return TEST_RUN(tests);
}
