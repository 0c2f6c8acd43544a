/* SPDX-License-Identifier: MIT */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "tests/helper.h"
#include "tools/bench/accuracy/pareto.h"

static void pareto_front_is_what_nothing_beats(void **state)
{
	struct pareto_point points[] = {
		{ 10.0, 0.5 }, { 20.0, 0.2 }, { 20.0, 0.3 },
		{ 30.0, 0.2 }, { 40.0, 0.0 }, { 10.0, 0.5 },
	};
	static const bool expected[] = { true, true, false, false, true, true };

	(void)state;
	pareto_mark(points, ARRAY_LENGTH(points));
	for (size_t i = 0; i < ARRAY_LENGTH(points); i++)
		assert_int_equal(points[i].is_on_front, expected[i]);
}

static void pareto_knee_is_the_cheapest_that_is_right_enough(void **state)
{
	static const struct pareto_point points[] = {
		{ 40.0, 0.0 },
		{ 20.0, 0.2 },
		{ 10.0, 0.5 },
		{ 20.0, 0.1 },
	};

	(void)state;
	assert_int_equal(pareto_knee(points, ARRAY_LENGTH(points), 1.0), 2);
	assert_int_equal(pareto_knee(points, ARRAY_LENGTH(points), 0.3), 3);
	assert_int_equal(pareto_knee(points, ARRAY_LENGTH(points), 0.0), 0);
	assert_int_equal(pareto_knee(points, 3, -1.0), 3);
	assert_int_equal(pareto_knee(points, 0, 1.0), 0);
}

static void pareto_hypervolume_is_the_area_ruled_out(void **state)
{
	static const struct pareto_point points[] = {
		{ 5.0, 0.5 }, { 2.0, 0.8 }, { 5.0, 0.6 }, { 6.0, 0.9 }, { 20.0, 0.0 },
	};
	static const struct pareto_point perfect[] = { { 0.0, 0.0 } };

	(void)state;
	/* Of 10 x 1: from 2 on all above 0.8, from 5 on all above 0.5. */
	assert_float_equal(pareto_hypervolume(points, ARRAY_LENGTH(points), 10.0, 1.0),
			   (8.0 * 0.2 + 5.0 * 0.3) / 10.0, 1e-12);
	assert_float_equal(pareto_hypervolume(perfect, 1, 10.0, 1.0), 1.0, 1e-12);
	assert_float_equal(pareto_hypervolume(points, 0, 10.0, 1.0), 0.0, 0.0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(pareto_front_is_what_nothing_beats),
		cmocka_unit_test(pareto_knee_is_the_cheapest_that_is_right_enough),
		cmocka_unit_test(pareto_hypervolume_is_the_area_ruled_out),
	};

	return TEST_RUN(tests);
}
