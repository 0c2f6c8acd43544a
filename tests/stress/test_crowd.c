/* SPDX-License-Identifier: MIT */
/*
 * Goal: crowds whose clients are killed leave nothing, see nothing wrong and lose no request; so that
 * what `oocbench stress` and `oocbench soak` find in hours begins with a moment in every run.
 * Method: the programs as people run them, on a small store, and what they count.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/helper.h"

static double number_of(const char *json, const char *key)
{
	char quoted[64];
	const char *at;

	(void)snprintf(quoted, sizeof(quoted), "\"%s\": ", key);
	at = strstr(json, quoted);
	if (!at)
		fail_msg("no %s in: %s", key, json);
	return strtod(at + strlen(quoted), NULL);
}

static void run_crowd(const char *folder, const char *verb_and_options, char *ret, size_t ret_bytes)
{
	const struct test_grid grid = { .count = 16, .face_quads = 4 };
	const char *path = test_path(folder, "a.ooc");

	test_store_grid_make(path, &grid);
	if (test_command(ret, ret_bytes, "\"$OOCD_BIN\"/oocbench %s --json %s 2>&1",
			 verb_and_options, path) != 0)
		fail_msg("%s", ret);
	assert_true(number_of(ret, "sets") > 0);
	assert_true(number_of(ret, "reads") > 0);
	assert_true(number_of(ret, "kills") > 0);
	assert_true(number_of(ret, "wrong") == 0);
	assert_true(number_of(ret, "failed") == 0);
	assert_true(number_of(ret, "leaked_descriptors") <= 0);
	assert_true(number_of(ret, "leaked_holds_bytes") == 0);
	assert_true(number_of(ret, "leaked_sessions") == 0);
}

static void a_crowd_that_is_killed_leaves_nothing_and_sees_nothing_wrong(void **state)
{
	char output[8192];

	run_crowd(*state, "stress --clients 6 --rate 50 --seconds 1 --kill-ms 50", output,
		  sizeof(output));
	assert_true(number_of(output, "probes") > 0);
}

static void hostile_clients_cost_the_honest_no_request(void **state)
{
	char output[8192];

	run_crowd(*state, "stress --clients 4 --rate 50 --seconds 1 --kill-ms 100 --hostile",
		  output, sizeof(output));
}

static void a_crowd_comes_back_to_a_daemon_that_was_killed(void **state)
{
	char output[8192];

	run_crowd(*state, "soak --clients 4 --rate 50 --seconds 2 --restart-s 1 --kill-ms 100",
		  output, sizeof(output));
	assert_true(number_of(output, "restarts") > 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(
			a_crowd_that_is_killed_leaves_nothing_and_sees_nothing_wrong,
			test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(hostile_clients_cost_the_honest_no_request,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(a_crowd_comes_back_to_a_daemon_that_was_killed,
						test_folder_setup, test_folder_teardown),
	};

	return TEST_RUN(tests);
}
