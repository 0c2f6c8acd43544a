/* SPDX-License-Identifier: MIT */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "libclient/charted.h"
#include "tests/helper.h"

static const uint8_t uuid[16] = { 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16 };
static const char file_name[] = "oocd/chart-0102030405060708090a0b0c0d0e0f10.csv";

static const struct charted three[] = {
	{ 0.0, 90.0, "--mode full" },
	{ 0.02, 20.0, "--mode approximate --order auto --budget 1000" },
	{ 0.2, 10.0, "--mode approximate --order auto --budget 10" },
};

static int setup(void **state)
{
	if (test_folder_setup(state) < 0)
		return -1;
	return setenv("XDG_CACHE_HOME", *state, 1);
}

static void charted_finds_the_cheapest_that_is_right_enough(void **state)
{
	struct charted charted;
	struct why why;

	(void)state;
	assert_int_equal(charted_write(uuid, three, 3, &why), 0);
	assert_int_equal(charted_find(uuid, 0.0, &charted, &why), 0);
	assert_string_equal(charted.options, "--mode full");
	assert_int_equal(charted_find(uuid, 0.1, &charted, &why), 0);
	assert_string_equal(charted.options, three[1].options);
	assert_int_equal(charted_find(uuid, 1.0, &charted, &why), 0);
	assert_true(charted.ms == 10.0 && charted.error == 0.2);
}

static void charted_says_when_it_knows_nothing_so_right(void **state)
{
	struct charted charted = { .ms = 7.0 };
	struct why why;

	(void)state;
	assert_int_equal(charted_find(uuid, 1.0, &charted, &why), -ENOENT);
	assert_non_null(strstr(why.text, "oocbench chart"));
	assert_int_equal(charted_write(uuid, &three[1], 2, &why), 0);
	assert_int_equal(charted_find(uuid, 0.001, &charted, &why), -ERANGE);
	/* A newer chart takes the place of the older one. */
	assert_int_equal(charted_write(uuid, three, 1, &why), 0);
	assert_int_equal(charted_find(uuid, 0.001, &charted, &why), 0);
	assert_true(charted.ms == 90.0);
}

static void charted_does_not_believe_files_that_are_not_its_own(void **state)
{
	static const char *const files[] = {
		"",
		"error,ms,options",
		"something else\n0,1,--mode full\n",
		"error,ms,options\n0,1\n",
		"error,ms,options\nx,1,--mode full\n",
		"error,ms,options\n-1,1,--mode full\n",
		"error,ms,options\n0,1,--mode full,2\n",
	};
	struct charted charted = { .ms = 7.0 };
	struct why why;

	assert_int_equal(charted_write(uuid, three, 3, &why), 0);
	for (size_t i = 0; i < sizeof(files) / sizeof(files[0]); i++) {
		test_file_write(test_path(*state, file_name), files[i], strlen(files[i]));
		assert_int_equal(charted_find(uuid, 1.0, &charted, &why), -EUCLEAN);
	}
	assert_true(charted.ms == 7.0);
}

#define IN_FOLDER(test) cmocka_unit_test_setup_teardown(test, setup, test_folder_teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		IN_FOLDER(charted_finds_the_cheapest_that_is_right_enough),
		IN_FOLDER(charted_says_when_it_knows_nothing_so_right),
		IN_FOLDER(charted_does_not_believe_files_that_are_not_its_own),
	};

	return TEST_RUN(tests);
}
