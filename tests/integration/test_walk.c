/* SPDX-License-Identifier: MIT */
/* oocbench walk on a small plant: its counters, not its times. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <jansson.h>

#include "tests/helper.h"

static void run(const char *folder, const char *command, int status)
{
	char line[4096];

	(void)snprintf(line, sizeof(line), "cd %s && $OOCD_BIN/%s >output 2>errors", folder,
		       command);
	assert_int_equal(system(line), status << 8);
}

static json_t *output_of(const char *folder)
{
	json_t *json = json_load_file(test_path(folder, "output"), 0, NULL);

	assert_non_null(json);
	return json;
}

static double number(const json_t *json, const char *group, const char *key)
{
	const json_t *value = json_object_get(json_object_get(json, group), key);

	assert_true(json_is_number(value));
	return json_number_value(value);
}

static int walk_setup(void **state)
{
	if (test_folder_setup(state) < 0)
		return -1;
	run(*state, "oocgen plant --triangles 20000 -o m.ply", 0);
	run(*state, "oocbuild --quiet --leaf-triangles 400 -o m.ooc m.ply", 0);
	run(*state, "oocbench path m.ooc --kind fly --frames 60 -o p.csv", 0);
	return 0;
}

static void waiting_runs_show_the_same_pictures_whatever_is_fetched_when(void **state)
{
	json_t *json;

	run(*state,
	    "oocbench walk m.ooc --path p.csv -o w --mode waiting --fps 500 --budget 3000 "
	    "--size 64x48 --cache 1M --disk 20M:0.3 --json",
	    0);
	json = output_of(*state);
	assert_true(json_number_value(json_object_get(json, "differing_pictures")) == 0.0);
	assert_true(number(json, "sequential", "fetched_mb") > 0.0);
	assert_true(number(json, "sequential", "ahead_mb") == 0.0);
	assert_true(number(json, "concurrent", "never_drawn") == 0.0);
	assert_true(number(json, "ahead", "ahead_mb") > 0.0);
	json_decref(json);
	assert_non_null(strstr(test_folder_list(test_path(*state, "w")), "ahead.csv "));
}

static void live_runs_lack_what_has_not_come_and_less_where_the_path_is_known(void **state)
{
	json_t *json;

	/* What is not asked for ahead of time is not there before it is wanted. */
	run(*state,
	    "oocbench walk m.ooc --path p.csv -o w --mode live --rivals --fps 100 --budget 3000 "
	    "--size 64x48 --cache 8M --disk 100M:2 --horizon 0.6 --stride 20 --json",
	    0);
	json = output_of(*state);
	assert_true(number(json, "live", "ready_before") == 0.0);
	assert_true(number(json, "live", "ahead_mb") == 0.0);
	assert_true(number(json, "live_path", "ready_before") >
		    number(json, "live", "ready_before"));
	assert_true(number(json, "live_path", "used") > 50.0);
	assert_true(number(json, "live_frustum", "ahead_mb") > 0.0);
	json_decref(json);
}

static void what_cannot_be_walked_is_said(void **state)
{
	run(*state, "oocbench walk m.ooc -o w", 2);
	run(*state, "oocbench walk m.ooc --path p.csv -o w --order backwards", 2);
	run(*state, "oocbench walk m.ooc --path none.csv -o w", 1);
	run(*state, "oocbench walk p.csv --path p.csv -o w", 1);
	run(*state, "oocbench walk m.ooc --path p.csv -o w --disk floppy", 1);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(waiting_runs_show_the_same_pictures_whatever_is_fetched_when),
		cmocka_unit_test(live_runs_lack_what_has_not_come_and_less_where_the_path_is_known),
		cmocka_unit_test(what_cannot_be_walked_is_said),
	};

	struct test_descriptors before;

	test_descriptors_note(&before);
	return cmocka_run_group_tests(tests, walk_setup, test_folder_teardown) +
	       test_descriptors_leaked(&before);
}
