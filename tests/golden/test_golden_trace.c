/* SPDX-License-Identifier: MIT */
/*
 * Goal: a trace that was recorded once stays readable, and no policy comes to read more of it than it
 * did when its figures were put down here.
 * Method: a recorded trace, done again by the daemon's own cache, beside the offline bound.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "tests/helper.h"
#include "tools/bench/replay/bound.h"
#include "tools/bench/replay/replay_cache.h"

#define CACHE_BYTES (38 * MIB)

/* (bytes - compulsory) / (bound - compulsory), as measured, and a fiftieth more. */
static const double ratio_max[REPLACEMENT_COUNT_] = {
	[REPLACEMENT_reuse] = 1.41,
	[REPLACEMENT_lru] = 1.92,
};

static void an_old_trace_is_replayed_as_near_to_the_bound_as_ever(void **state)
{
	struct schedule schedule;
	struct gaps gaps;
	struct why why;
	char path[4096];
	double foo;

	(void)state;
	assert_non_null(getenv("OOCD_SOURCE"));
	(void)snprintf(path, sizeof(path), "%s/tests/golden/orbit.trace", getenv("OOCD_SOURCE"));
	if (schedule_read(path, &schedule, &why) < 0)
		fail_msg("%s", why.text);
	assert_false(schedule.was_cut);
	assert_int_equal(gaps_make(&schedule, &gaps), 0);
	assert_int_equal(bound_foo(&gaps, CACHE_BYTES / TRACE_PAGE_BYTES, true, &foo), 0);
	/* It says something: more has to be read than what is compulsory. */
	assert_true(foo > 1.5 * (double)gaps.compulsory_bytes);
	for (unsigned i = 0; i < REPLACEMENT_COUNT_; i++) {
		struct replay_result result;
		double above;

		if (replay_cache(&schedule, i, CACHE_BYTES, &result, &why) < 0)
			fail_msg("%s", why.text);
		above = (double)(result.read_bytes - gaps.compulsory_bytes);
		print_message("%s: %.3f of the bound\n", replacement_name(i),
			      above / (foo - (double)gaps.compulsory_bytes));
		assert_true(above >= foo - (double)gaps.compulsory_bytes);
		assert_true(above <= ratio_max[i] * (foo - (double)gaps.compulsory_bytes));
	}
	gaps_done(&gaps);
	schedule_done(&schedule);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(an_old_trace_is_replayed_as_near_to_the_bound_as_ever),
	};

	return TEST_RUN(tests);
}
