/* SPDX-License-Identifier: MIT */
/* oocbench chart on a small plant: what it says and leaves, not how fast anything was. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/helper.h"

static int run(const char *folder, const char *command)
{
	char line[4096];
	int status;

	(void)snprintf(line, sizeof(line),
		       "cd %s && XDG_CACHE_HOME=$PWD/cache $OOCD_BIN/%s >output 2>errors", folder,
		       command);
	status = system(line);
	return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

static char *text_of(const char *path)
{
	size_t bytes;
	char *read = test_file_read(path, &bytes);
	char *text = strndup(read, bytes);

	free(read);
	return text;
}

/* The field of a table's row whose first field begins so. */
static double field(const char *table, const char *row, const char *column)
{
	char *copy = strdup(table);
	char *lines = copy;
	char *head = strsep(&lines, "\n");
	unsigned index = 0;
	double value = -1.0;

	for (char *name; (name = strsep(&head, ",")) && strcmp(name, column) != 0;)
		index++;
	for (char *line; value < 0.0 && (line = strsep(&lines, "\n"));) {
		if (strncmp(line, row, strlen(row)) != 0)
			continue;
		for (unsigned i = 0; i < index; i++)
			(void)strsep(&line, ",");
		value = strtod(line, NULL);
	}
	free(copy);
	assert_true(value >= 0.0);
	return value;
}

static void a_chart_says_what_every_setting_costs_and_how_wrong_it_is(void **state)
{
	const char *folder = *state;
	const char *chart = test_path(folder, "c");
	char *report;
	char *table;

	assert_int_equal(run(folder, "oocgen plant --triangles 20000 -o m.ply"), 0);
	assert_int_equal(run(folder, "oocbuild --quiet --leaf-triangles 400 -o m.ooc m.ply"), 0);
	assert_int_equal(run(folder, "oocbench path m.ooc --kind fly --frames 40 -o p.csv"), 0);
	assert_int_equal(run(folder, "oocbench chart m.ooc --path p.csv --quick --size 96x72 -o c "
				     "--error 2 --json"),
			 0);
	table = text_of(test_path(chart, "path.csv"));
	/* The full mode is what the others are compared with; what is conservative equals it. */
	assert_true(field(table, "full,", "wrong_of_covered") == 0.0);
	assert_true(field(table, "full,", "flip") == 0.0);
	assert_true(field(table, "conservative items,", "wrong_of_covered") == 0.0);
	assert_true(field(table, "conservative items,", "triangles") <=
		    field(table, "full,", "triangles"));
	/* More triangles, fewer errors. */
	assert_true(field(table, "auto 2 %,", "triangles") <
		    field(table, "auto 20 %,", "triangles"));
	assert_true(field(table, "auto 2 %,", "wrong_of_covered") >
		    field(table, "auto 20 %,", "wrong_of_covered"));
	assert_true(field(table, "full size / 2,", "flip") > 0.0);
	free(table);

	report = text_of(test_path(chart, "report.html"));
	assert_non_null(strstr(report, "The knee: with at most 2 %"));
	assert_non_null(strstr(report, "Worst frame of"));
	assert_non_null(strstr(report, "Fetching: cache and look-ahead"));
	/* It stands alone. */
	assert_null(strstr(report, "src=\"/"));
	assert_null(strstr(report, "http-equiv"));
	free(report);
	report = text_of(test_path(folder, "output"));
	assert_non_null(strstr(report, "\"knee\""));
	free(report);
	/* What it has found is there for the viewer, and only where nothing else was said. */
	assert_int_equal(strncmp(test_folder_list(test_path(folder, "cache/oocd")), "chart-", 6),
			 0);
	assert_int_equal(run(folder, "oocview --headless --error 2 --mode full --screenshot s.png "
				     "m.ooc"),
			 2);
	assert_int_equal(run(folder, "oocview --headless --error 2 --socket none.sock "
				     "--screenshot s.png m.ooc"),
			 1);
	report = text_of(test_path(folder, "errors"));
	assert_non_null(strstr(report, "where it was charted"));
	free(report);
}

static void what_cannot_be_charted_is_said(void **state)
{
	const char *folder = *state;

	assert_int_equal(run(folder, "oocbench chart m.ooc"), 2);
	assert_int_equal(run(folder, "oocbench chart m.ooc -o c --error 101"), 2);
	assert_int_equal(run(folder, "oocbench chart none.ooc -o c"), 1);
}

#define IN_FOLDER(test)                                                                            \
	cmocka_unit_test_setup_teardown(test, test_folder_setup, test_folder_teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		IN_FOLDER(a_chart_says_what_every_setting_costs_and_how_wrong_it_is),
		IN_FOLDER(what_cannot_be_charted_is_said),
	};

	return TEST_RUN(tests);
}
