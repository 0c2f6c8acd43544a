/* SPDX-License-Identifier: MIT */
/*
 * Goal: `oocctl trace` and `oocbench replay` say of a recorded trace what it holds, and what is wrong
 * with a file that is none.
 * Method: the programs, the golden trace, and pieces of it.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <jansson.h>
#include <stdlib.h>
#include <string.h>

#include "tests/helper.h"

#define GOLDEN "$OOCD_SOURCE/tests/golden/orbit.trace"

static char output[1 << 16];

static double number(const json_t *object, const char *key)
{
	const json_t *value = json_object_get(object, key);

	if (!json_is_number(value))
		fail_msg("no number %s", key);
	return json_number_value(value);
}

static json_t *parse(void)
{
	json_t *root = json_loads(output, 0, NULL);

	assert_non_null(root);
	return root;
}

static void a_trace_is_summed_up(void **state)
{
	json_t *sums;

	(void)state;
	assert_int_equal(
		test_command(output, sizeof(output), "$OOCD_BIN/oocctl trace --json " GOLDEN), 0);
	sums = parse();
	assert_false(json_is_true(json_object_get(sums, "cut")));
	assert_string_equal(json_string_value(json_object_get(sums, "replacement")), "lru");
	assert_true(number(sums, "sets") == 34);
	assert_true(number(sums, "hits") + number(sums, "misses") == 5579);
	assert_true(number(sums, "wanted_nodes") == 1300);
	assert_true(number(sums, "compulsory_bytes") == number(sums, "wanted_bytes"));
	assert_true(number(sums, "read_bytes") > 3 * number(sums, "compulsory_bytes"));
	assert_true(number(sums, "adopted") == 0);
	json_decref(sums);
	assert_int_equal(test_command(output, sizeof(output),
				      "$OOCD_BIN/oocctl trace --events " GOLDEN
				      " | grep -cE ' (HIT|MISS) '"),
			 0);
	assert_int_equal(atoi(output), 5579);
}

static void a_replay_says_what_each_policy_reads(void **state)
{
	json_t *root;
	const json_t *trace;
	const json_t *size;

	(void)state;
	assert_int_equal(test_command(output, sizeof(output),
				      "cd $OOCD_SOURCE/tests/golden && $OOCD_BIN/oocbench replay "
				      "orbit.trace --cache 38M --json"),
			 0);
	root = parse();
	trace = json_object_get(root, "orbit.trace");
	assert_true(number(trace, "wants") == 5579);
	size = json_object_get(trace, "39845888");
	assert_true(number(size, "fits") == 1);
	assert_true(number(size, "pfoo_bytes") <= number(size, "foo_bytes"));
	assert_true(number(size, "foo_bytes") <= number(size, "belady_bytes"));
	assert_true(number(size, "belady_bytes") < number(size, "lru_bytes"));
	assert_true(number(size, "reuse_bytes") < number(size, "lru_bytes"));
	json_decref(root);
}

static void what_is_no_trace_is_named(void **state)
{
	const char *cut = test_path(*state, "cut.trace");

	assert_int_equal(test_command(output, sizeof(output), "head -c 20000 " GOLDEN " >%s", cut),
			 0);
	assert_int_equal(
		test_command(output, sizeof(output), "$OOCD_BIN/oocctl trace --json %s", cut), 0);
	assert_non_null(strstr(output, "\"cut\": true"));
	test_file_write(cut, "no trace", 8);
	for (unsigned i = 0; i < 2; i++) {
		assert_int_equal(test_command(output, sizeof(output), "$OOCD_BIN/%s %s",
					      i ? "oocctl trace" : "oocbench replay", cut),
				 1);
		assert_non_null(strstr(output, "cut.trace"));
	}
	assert_int_equal(test_command(output, sizeof(output),
				      "$OOCD_BIN/oocbench replay " GOLDEN " --policy random"),
			 2);
	assert_int_equal(test_command(output, sizeof(output), "$OOCD_BIN/oocctl trace"), 2);
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, test_folder_setup, test_folder_teardown)
	const struct CMUnitTest tests[] = {
		TEST(a_trace_is_summed_up),
		TEST(a_replay_says_what_each_policy_reads),
		TEST(what_is_no_trace_is_named),
	};

	return TEST_RUN(tests);
}
