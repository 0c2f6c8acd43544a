/* SPDX-License-Identifier: MIT */
#include "daemon/server/notify.h"

#include <stdio.h>
#include <string.h>
#include <systemd/sd-daemon.h>

#include "daemon/server/server_private.h"
#include "formats/base/clock.h"
#include "formats/base/text.h"

/* The line changes with every read; nobody looks more often. */
#define STATUS_INTERVAL_NS NS_PER_S

void notify_init(struct notify *notify, uint64_t now_ns)
{
	uint64_t limit_us = 0;

	*notify = (struct notify){ .status_due_ns = now_ns };
	if (sd_watchdog_enabled(0, &limit_us) <= 0)
		limit_us = 0;
	watchdog_init(&notify->watchdog, limit_us, now_ns);
}

static void write_status(const struct server *server, char ret[NOTIFY_STATUS_BYTES])
{
	const struct cache *cache = &server->cache;
	struct takeover_counts takeover;
	char used[TEXT_SIZE_BYTES];
	char of[TEXT_SIZE_BYTES];
	int length;

	takeover_count(server->takeover, &takeover);
	length = snprintf(ret, NOTIFY_STATUS_BYTES, "%u client%s, %u store%s, %s of %s in memory",
			  server->session_count, server->session_count == 1 ? "" : "s",
			  cache->store_count, cache->store_count == 1 ? "" : "s",
			  text_from_size(cache_used_bytes(cache), used),
			  text_from_size(cache->budget_bytes, of));
	if (takeover.left > 0)
		(void)snprintf(ret + length, NOTIFY_STATUS_BYTES - (size_t)length,
			       ", %u payloads to be verified", takeover.left);
}

void notify_tick(struct notify *notify, const struct server *server, uint64_t now_ns)
{
	const struct fill_times *times = fills_times(server->fills);
	const struct watchdog_work work[WATCHDOG_KIND_COUNT_] = {
		[WATCHDOG_FILLS] = { fills_count(server->fills),
				     times->fetch.count + times->prefetch.count },
		[WATCHDOG_JOBS] = { workers_job_count(server->workers),
				    workers_ended_count(server->workers) },
	};
	char status[NOTIFY_STATUS_BYTES];

	if (watchdog_tick(&notify->watchdog, now_ns, work))
		(void)sd_notify(0, "WATCHDOG=1");
	if (now_ns < notify->status_due_ns)
		return;
	notify->status_due_ns = now_ns + STATUS_INTERVAL_NS;
	write_status(server, status);
	if (strcmp(status, notify->status) == 0)
		return;
	(void)snprintf(notify->status, sizeof(notify->status), "%s", status);
	(void)sd_notifyf(0, "STATUS=%s", status);
}
