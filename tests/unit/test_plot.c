/* SPDX-License-Identifier: MIT */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "tests/helper.h"
#include "tools/bench/base/measure.h"
#include "tools/bench/base/plot.h"

static const double ys[] = { 1.0, 4.0, 0.0, 9.0 };

static void plot_draws_what_it_is_given(void **state)
{
	const char *path = test_path(*state, "it's a plot.svg");
	const struct plot_series series[] = { { "first_one", NULL, ys, 4, PLOT_LINES },
					      { "it's 'another'", ys, ys, 4, PLOT_BOTH } };
	const struct plot plot = { "A title", "frames", "ms", false, true, series, 2 };
	struct why why;
	size_t bytes;
	char *text;

	if (!measure_has_program("gnuplot"))
		skip();
	assert_int_equal(plot_write(path, &plot, &why), 0);
	text = test_file_read(path, &bytes);
	assert_non_null(strstr(text, "first_one"));
	assert_non_null(strstr(text, "another"));
	assert_non_null(strstr(text, "A title"));
	free(text);
}

/* On a logarithmic axis there is no 0: it has a place of its own, with its name. */
static void plot_shows_what_is_zero_where_it_is_said(void **state)
{
	const char *path = test_path(*state, "p.svg");
	const double x[] = { 1.0, 2.0 };
	const double y[] = { 0.5, 0.0 };
	const struct plot_series series[] = { { "front", x, y, 2, PLOT_FRONT } };
	struct plot plot = { "t", "x", "y", false, true, series, 1, 0.0 };
	struct why why;
	size_t bytes[2];

	if (!measure_has_program("gnuplot"))
		skip();
	for (int i = 0; i < 2; i++) {
		char *text;

		plot.y_zero = i * 1e-3;
		assert_int_equal(plot_write(path, &plot, &why), 0);
		text = test_file_read(path, &bytes[i]);
		assert_int_equal(strstr(text, ">0<") != NULL, i == 1);
		free(text);
	}
}

static void plot_without_a_point_is_an_empty_one(void **state)
{
	const char *path = test_path(*state, "p.svg");
	const double none[] = { 0.0 };
	const struct plot_series series[] = { { "none", NULL, none, 1, PLOT_POINTS } };
	const struct plot plot = { "Nothing", "x", "y", true, true, series, 1 };
	struct why why;
	size_t bytes;

	if (!measure_has_program("gnuplot"))
		skip();
	assert_int_equal(plot_write(path, &plot, &why), 0);
	free(test_file_read(path, &bytes));
	assert_true(bytes > 0);
}

static void plot_into_a_folder_that_is_not_there_says_so(void **state)
{
	const char *path = test_path(*state, "none/p.svg");
	const struct plot_series series[] = { { "a", NULL, ys, 4, PLOT_STEPS } };
	const struct plot plot = { "t", "x", "y", false, false, series, 1 };
	struct why why;

	if (!measure_has_program("gnuplot"))
		skip();
	assert_int_equal(plot_write(path, &plot, &why), -EIO);
}

#define IN_FOLDER(test)                                                                            \
	cmocka_unit_test_setup_teardown(test, test_folder_setup, test_folder_teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		IN_FOLDER(plot_draws_what_it_is_given),
		IN_FOLDER(plot_shows_what_is_zero_where_it_is_said),
		IN_FOLDER(plot_without_a_point_is_an_empty_one),
		IN_FOLDER(plot_into_a_folder_that_is_not_there_says_so),
	};

	return TEST_RUN(tests);
}
