/* SPDX-License-Identifier: MIT */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "tests/helper.h"
#include "tools/bench/base/figures.h"

static void the_middle_of_an_even_number_lies_between_two(void **state)
{
	double values[] = { 4.0, 1.0, 3.0, 2.0 };
	struct spread spread = spread_of(values, ARRAY_LENGTH(values));

	(void)state;
	assert_true(spread.low == 1.0 && spread.median == 2.5 && spread.high == 4.0);
}

static void percentiles_are_of_the_nearest_rank(void **state)
{
	double values[200];

	(void)state;
	for (int i = 0; i < 200; i++)
		values[i] = 200 - i;
	assert_true(percentile_of(values, 200, 0.99) == 198.0);
	assert_true(percentile_of(values, 200, 0.95) == 190.0);
	assert_true(percentile_of(values, 100, 0.99) == 99.0);
	assert_true(percentile_of(values, 1, 0.99) == 1.0);
	assert_true(percentile_of(values, 200, 1.0) == 200.0);
}

static void a_distribution_of_nothing_is_nothing(void **state)
{
	double values[] = { 1.0, 2.0, 9.0 };
	struct distribution none = distribution_of(values, 0);
	struct distribution three = distribution_of(values, ARRAY_LENGTH(values));

	(void)state;
	assert_true(none.mean == 0.0 && none.highest == 0.0);
	assert_true(three.mean == 4.0 && three.median == 2.0 && three.p99 == 9.0);
	assert_true(share_above(values, ARRAY_LENGTH(values), 2.0) == 1.0 / 3.0);
	assert_true(share_above(values, 0, 2.0) == 0.0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(the_middle_of_an_even_number_lies_between_two),
		cmocka_unit_test(percentiles_are_of_the_nearest_rank),
		cmocka_unit_test(a_distribution_of_nothing_is_nothing),
	};

	return TEST_RUN(tests);
}
