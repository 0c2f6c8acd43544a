/* SPDX-License-Identifier: MIT */
#include "daemon/server/watchdog.h"

#include <string.h>

#include "formats/base/clock.h"

/* Pings in the time after which the manager gives up: one that is late does no harm. */
#define PINGS_A_LIMIT 4u

void watchdog_init(struct watchdog *watchdog, uint64_t limit_us, uint64_t now_ns)
{
	*watchdog = (struct watchdog){
		.interval_ns = limit_us * NS_PER_US / PINGS_A_LIMIT,
		.due_ns = now_ns,
	};
}

static bool got_somewhere(const struct watchdog_work *last, const struct watchdog_work *now)
{
	return last->pending == 0 || now->pending == 0 || now->ended != last->ended;
}

bool watchdog_tick(struct watchdog *watchdog, uint64_t now_ns,
		   const struct watchdog_work work[WATCHDOG_KIND_COUNT_])
{
	if (watchdog->interval_ns == 0 || now_ns < watchdog->due_ns)
		return false;
	for (int kind = 0; kind < WATCHDOG_KIND_COUNT_; kind++)
		if (!got_somewhere(&watchdog->last[kind], &work[kind]))
			return false;
	memcpy(watchdog->last, work, sizeof(watchdog->last));
	watchdog->due_ns = now_ns + watchdog->interval_ns;
	return true;
}
