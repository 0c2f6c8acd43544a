/* SPDX-License-Identifier: MIT */
/** server_private.h - what the files of the server share: server.c, server_stores.c, status.c. */
#ifndef DAEMON_SERVER_PRIVATE_H
#define DAEMON_SERVER_PRIVATE_H

#include <stdbool.h>
#include <systemd/sd-event.h>

#include "daemon/accounts.h"
#include "daemon/cache.h"
#include "daemon/fetch.h"
#include "daemon/fills.h"
#include "daemon/listener.h"
#include "daemon/queues.h"
#include "daemon/server.h"
#include "daemon/session.h"
#include "daemon/workers.h"

struct server {
	struct server_config config;
	struct listener listener;
	uint64_t epoch;
	uint64_t start_ns;

	sd_event *event;
	sd_event_source *listen_source;
	sd_event_source *fetch_source;
	sd_event_source *workers_source;
	sd_event_source *round_source; /* runs when the events that are pending have been handled */
	sd_event_source *tick_source;

	struct cache cache;
	struct fetch *fetch;
	struct workers *workers;
	struct fills *fills;
	struct queues queues;

	struct accounts accounts;
	struct list sessions;
	uint32_t session_count;
	uint32_t next_number;
	uint32_t opening_count; /* OPENs that are with a worker */
	uint64_t idle_since_ns; /* nobody is connected since; 0: somebody is */
	int buffer_error;       /* the last failure to register memory, or 0 */
	bool stopping;
	uint32_t round_count;
};

/** Something changed: run a round when the pending events have been handled. */
void server_active(struct server *server);

/* ---- server_stores.c ---- */

/** See session_calls.open. */
void server_open(struct server *server, struct session *session, uint32_t slot, uint32_t ticket,
		 int fd, const char *path);
/** See cache_calls. */
void server_make_segment(void *server, struct served *served);
void server_segment_gone(void *server, struct served *served, struct segment *segment);
/** Closes what nobody has had open for a while. */
void server_close_idle(struct server *server, uint64_t now_ns);
/** Closes all, for good: nothing is in flight, nobody is attached. */
void server_close_stores(struct server *server);

/**
 * Has a store open that a changed configuration names.  It is opened on a worker; a failure is logged.
 *
 * Returns: 0, or -errno when it is no file that can be read.
 */
int server_want_store(struct server *server, const char *path, struct why *why);

/* ---- status.c ---- */

/** The status as JSON.  Ownership: free().  NULL: no memory. */
char *server_status(struct server *server);

#endif /* DAEMON_SERVER_PRIVATE_H */
