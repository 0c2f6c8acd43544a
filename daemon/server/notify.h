/* SPDX-License-Identifier: MIT */
/**
 * notify.h - what the service manager is told now and then: that all is well, and a line for people.
 *
 * Threads: loop thread.
 * Source: sd_notify(3); nothing is said where nobody listens.
 */
#ifndef DAEMON_SERVER_NOTIFY_H
#define DAEMON_SERVER_NOTIFY_H

#include <stdint.h>

#include "daemon/server/watchdog.h"

#define NOTIFY_STATUS_BYTES 160

struct server;

struct notify {
	struct watchdog watchdog;
	uint64_t status_due_ns;
	char status[NOTIFY_STATUS_BYTES]; /* as it was told */
};

void notify_init(struct notify *notify, uint64_t now_ns);

/** Once a while. */
void notify_tick(struct notify *notify, const struct server *server, uint64_t now_ns);

#endif /* DAEMON_SERVER_NOTIFY_H */
