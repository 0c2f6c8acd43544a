/* SPDX-License-Identifier: MIT */
/*
 * Goal: whichever request for memory fails, a build ends with one reason, leaves no file and no
 * descriptor, and the next one succeeds.
 * Method: fail the first, then the second, and so on, until a run has none left to fail.
 * The linker sends the calls here (--wrap, see build.cmake).
 */
#include <errno.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "tests/helper.h"
#include "tests/integration/models.h"
#include "tools/build/build.h"

static unsigned fault_countdown; /* the call that takes it to 0 fails; 0: none */

static bool fault_now(void)
{
	if (fault_countdown == 0 || --fault_countdown > 0)
		return false;
	errno = ENOMEM;
	return true;
}

#define WRAP(name, parameters, arguments)                                                          \
	void *__real_##name parameters;                                                            \
	void *__wrap_##name parameters;                                                            \
	void *__wrap_##name parameters                                                             \
	{                                                                                          \
		return fault_now() ? NULL : __real_##name arguments;                               \
	}

WRAP(malloc, (size_t size), (size))
WRAP(calloc, (size_t count, size_t size), (count, size))
WRAP(realloc, (void *memory, size_t size), (memory, size))
WRAP(reallocarray, (void *memory, size_t count, size_t size), (memory, count, size))
WRAP(aligned_alloc, (size_t alignment, size_t size), (alignment, size))
WRAP(strdup, (const char *text), (text))
WRAP(strndup, (const char *text, size_t size), (text, size))

/* Builds with the nth request failing.  Returns: as build_run(); *ret_left: was it not reached? */
static int build(const char *folder, bool replicate, unsigned nth, bool *ret_left, struct why *why)
{
	char *inputs[] = { (char *)(uintptr_t)test_path(folder, "soup.ply") };
	struct build_options options = {
		.output = test_path(folder, "s.ooc"),
		.inputs = inputs,
		.input_count = 1,
		.memory_bytes = 256 * MIB,
		.jobs = 1,
		.error = -1,
		.leaf_triangles = 100,
		.leaf_vertices = UINT32_MAX,
		.layout = replicate ? STORE_LAYOUT_REPLICATE : STORE_LAYOUT_UNIQUE,
		.normals = NORMALS_OCT8,
		.crease_degrees = 40,
		.codec = replicate ? STORE_CODEC_MESHOPT_ZSTD : STORE_CODEC_NONE,
	};
	struct build_report report;
	struct crew crew;
	int r;

	crew_init(&crew, options.jobs);
	fault_countdown = nth;
	r = build_run(&options, &crew, &report, why);
	*ret_left = fault_countdown > 0;
	fault_countdown = 0;
	crew_done(&crew);
	return r;
}

static void write_soup(const char *folder)
{
	static float corners[400 * 9];

	for (size_t i = 0; i < ARRAY_LENGTH(corners); i++)
		corners[i] = (float)(model_random() + (double)(i / 9 % 20));
	/* A hub: more faces at one position than are compared each with each. */
	for (size_t i = 0; i < 100; i++)
		memset(&corners[9 * i], 0, 3 * sizeof(float));
	model_write_floats(test_path(folder, "soup.ply"), corners, 400);
}

static void a_build_survives_the_failure_of_any_request_for_memory(void **state)
{
	unsigned failures = 0;

	write_soup(*state);
	for (unsigned replicate = 0; replicate < 2; replicate++) {
		for (unsigned nth = 1;; nth++) {
			struct why why = { 0 };
			bool left;
			int r = build(*state, replicate, nth, &left, &why);

			/* Who could do without says nothing; else there is a reason and no file. */
			if (r == 0) {
				assert_int_equal(unlink(test_path(*state, "s.ooc")), 0);
				if (left)
					break;
				continue;
			}
			failures++;
			assert_int_equal(r, -ENOMEM);
			assert_true(why.text[0] != '\0');
			assert_string_equal(test_folder_list(*state), "soup.ply ");
		}
	}
	assert_in_range(failures, 80, 100000);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(
			a_build_survives_the_failure_of_any_request_for_memory, test_folder_setup,
			test_folder_teardown),
	};

	return TEST_RUN(tests);
}
