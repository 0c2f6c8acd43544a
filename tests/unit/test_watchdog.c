/* SPDX-License-Identifier: MIT */
/* Goal: a ping is given when it is due and all that was pending has got somewhere, and else not. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "daemon/server/watchdog.h"
#include "formats/base/clock.h"
#include "tests/helper.h"

static bool tick(struct watchdog *watchdog, uint64_t now_ns, struct watchdog_work fills,
		 struct watchdog_work jobs)
{
	const struct watchdog_work work[WATCHDOG_KIND_COUNT_] = {
		[WATCHDOG_FILLS] = fills,
		[WATCHDOG_JOBS] = jobs,
	};

	return watchdog_tick(watchdog, now_ns, work);
}

#define WORK(pending, ended)                                                                       \
	(struct watchdog_work)                                                                     \
	{                                                                                          \
		pending, ended                                                                     \
	}
#define IDLE WORK(0, 0)

static void an_idle_daemon_pings_when_it_is_due(void **state)
{
	struct watchdog watchdog;

	(void)state;
	watchdog_init(&watchdog, 4 * NS_PER_S / NS_PER_US, 100);
	assert_true(tick(&watchdog, 100, IDLE, IDLE));
	assert_false(tick(&watchdog, 100 + NS_PER_S - 1, IDLE, IDLE));
	assert_true(tick(&watchdog, 100 + NS_PER_S, IDLE, IDLE));
}

static void nobody_is_told_where_nobody_watches(void **state)
{
	struct watchdog watchdog;

	(void)state;
	watchdog_init(&watchdog, 0, 100);
	assert_false(tick(&watchdog, 100 + 1000 * NS_PER_S, IDLE, IDLE));
}

static void what_is_stuck_is_no_ping_until_it_goes_on(void **state)
{
	struct watchdog watchdog;
	uint64_t now_ns = 1;

	(void)state;
	watchdog_init(&watchdog, 4, now_ns);
	assert_true(tick(&watchdog, now_ns += NS_PER_S, WORK(3, 10), IDLE));
	/* Reads hang, whatever the workers do; more may be begun. */
	assert_false(tick(&watchdog, now_ns += NS_PER_S, WORK(3, 10), WORK(0, 5)));
	assert_false(tick(&watchdog, now_ns += NS_PER_S, WORK(9, 10), WORK(0, 7)));
	/* One has ended. */
	assert_true(tick(&watchdog, now_ns += NS_PER_S, WORK(9, 11), WORK(1, 7)));
	/* Now it is a worker. */
	assert_false(tick(&watchdog, now_ns += NS_PER_S, WORK(9, 12), WORK(1, 7)));
	assert_true(tick(&watchdog, now_ns += NS_PER_S, WORK(9, 12), WORK(0, 7)));
}

static void what_has_just_begun_is_not_stuck(void **state)
{
	struct watchdog watchdog;
	uint64_t now_ns = 1;

	(void)state;
	watchdog_init(&watchdog, 4, now_ns);
	assert_true(tick(&watchdog, now_ns += NS_PER_S, IDLE, IDLE));
	assert_true(tick(&watchdog, now_ns += NS_PER_S, WORK(5, 0), WORK(2, 0)));
	assert_false(tick(&watchdog, now_ns += NS_PER_S, WORK(5, 0), WORK(2, 0)));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(an_idle_daemon_pings_when_it_is_due),
		cmocka_unit_test(nobody_is_told_where_nobody_watches),
		cmocka_unit_test(what_is_stuck_is_no_ping_until_it_goes_on),
		cmocka_unit_test(what_has_just_begun_is_not_stuck),
	};

	return TEST_RUN(tests);
}
