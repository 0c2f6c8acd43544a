/* SPDX-License-Identifier: MIT */
/**
 * watchdog.h - whether the service manager may go on to believe in this daemon.
 *
 * A loop that turns is not enough: clients wait just as well for a device that answers no more, or a
 * worker that hangs.  So the ping is due now and then, and given only if everything that was pending
 * at the last one has got somewhere since: of each kind of work something has ended, or nothing was
 * pending.  Without it the manager ends the daemon and starts the next, which has the cache again.
 *
 * Threads: loop thread.
 */
#ifndef DAEMON_SERVER_WATCHDOG_H
#define DAEMON_SERVER_WATCHDOG_H

#include <stdbool.h>
#include <stdint.h>

/** One kind of work. */
struct watchdog_work {
	uint64_t pending; /* begun and not ended */
	uint64_t ended;   /* ever */
};

enum watchdog_kind {
	WATCHDOG_FILLS, /* reads and what follows them */
	WATCHDOG_JOBS,  /* of workers */
	WATCHDOG_KIND_COUNT_
};

struct watchdog {
	uint64_t interval_ns; /* 0: nobody watches */
	uint64_t due_ns;
	struct watchdog_work last[WATCHDOG_KIND_COUNT_];
};

/** limit_us: as the manager says; 0: it does not watch. */
void watchdog_init(struct watchdog *watchdog, uint64_t limit_us, uint64_t now_ns);

/** Returns: is a ping due, and deserved? */
bool watchdog_tick(struct watchdog *watchdog, uint64_t now_ns,
		   const struct watchdog_work work[WATCHDOG_KIND_COUNT_]);

#endif /* DAEMON_SERVER_WATCHDOG_H */
