/* SPDX-License-Identifier: MIT */
/** server_private.h - what the files of the server share: server.c, server_stores.c, status.c. */
#ifndef DAEMON_SERVER_SERVER_PRIVATE_H
#define DAEMON_SERVER_SERVER_PRIVATE_H

#include <stdbool.h>
#include <systemd/sd-event.h>

#include "daemon/cache/cache.h"
#include "daemon/fetch/fetch.h"
#include "daemon/fetch/fills.h"
#include "daemon/fetch/workers.h"
#include "daemon/restart/takeover.h"
#include "daemon/server/listener.h"
#include "daemon/server/notify.h"
#include "daemon/server/server.h"
#include "daemon/server/session.h"
#include "daemon/sharing/accounts.h"
#include "daemon/sharing/queues.h"
#include "daemon/sharing/residents.h"

/** How clients have gone. */
enum session_end {
	SESSION_END_HUNG_UP,  /* or died */
	SESSION_END_PROTOCOL, /* broke it */
	SESSION_END_SILENT,   /* did not say HELLO */
	SESSION_END_UNREAD,   /* did not read what it was sent */
	SESSION_END_LEASE,    /* gave nothing back that others needed, for a whole lease */
	SESSION_END_OTHER,
	SESSION_END_COUNT_
};

/** Where metrics go by themselves. */
struct metrics {
	struct listener listener;
	sd_event_source *source;
	uint64_t next_ns; /* when the file is written */
	bool writing;     /* a worker does */
	int error;        /* of the last time, or 0 */
};

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
	sd_event_source *wake_source;  /* a round, later */
	uint64_t listen_at_ns;         /* nobody is accepted before; 0: whoever comes is */
	sd_event_source *tick_source;

	struct cache cache;
	struct room room;
	uint64_t division_after_ns; /* the next one, at the earliest */
	struct fetch *fetch;
	struct workers *workers;
	struct fills *fills;
	struct queues queues;
	struct residents residents;
	struct store_counters closed_counters; /* of stores that are served no longer */
	struct takeover *takeover;
	bool to_map; /* inherited segments are to be mapped and registered */

	struct notify notify;
	struct metrics metrics;
	struct accounts accounts;
	struct list sessions;
	uint32_t session_count;
	uint64_t accepted_count; /* clients, ever */
	uint64_t refused_count;  /* for there were too many */
	uint64_t session_ends[SESSION_END_COUNT_];
	uint32_t next_number;
	uint32_t opening_count; /* OPENs that are with a worker */
	uint64_t idle_since_ns; /* nobody is connected since; 0: somebody is */
	int accept_error;       /* the last failure to accept a client, or 0 */
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
/** Opens what a predecessor had open, with what it had in memory. */
void server_take_over(struct server *server);
/** Once it is verified: begins to map what was taken over. */
void server_map_inherited(struct server *server);
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

/* ---- admin.c ---- */

/** May it give orders, and see what others do? */
bool server_is_admin(const struct server *server, const struct session *session);
/** Answers an ADMIN; see session_calls.answer. */
int server_admin(struct server *server, struct session *session, const struct wire_admin *admin,
		 char **ret_text, struct why *why);

/* ---- degraded.c ---- */

/** What a sentence is shown to. */
typedef void (*degraded_fn)(void *arg, const char *sentence);
/**
 * Names everything that works worse than it could, each with what to do.
 *
 * sees:  may whoever looks know of this store?
 */
void server_degraded(const struct server *server,
		     bool (*sees)(const void *arg, const struct served *served), degraded_fn tell,
		     void *arg);

/* ---- metrics.c ---- */

/** As OpenMetrics text.  Ownership: free().  NULL: no memory. */
char *server_metrics(const struct server *server);
/** Opens the socket for them, if there shall be one.  Returns: 0 or -errno. */
int server_metrics_start(struct server *server, struct why *why);
void server_metrics_stop(struct server *server);
/** Once a while: has the file written. */
void server_metrics_tick(struct server *server, uint64_t now_ns);

/* ---- status.c ---- */

/** Names of refusals' reasons and of sessions' ends, as status and metrics have them. */
extern const char *const status_reason_names[WIRE_REASON_COUNT_];
extern const char *const status_end_names[SESSION_END_COUNT_];

/** Counters of all stores, of those served no longer as well. */
void server_sum(const struct server *server, struct store_counters *ret);
/** What waits, over all clients. */
void server_waiting(const struct server *server, uint64_t *ret_fetches, uint64_t *ret_prefetches);

/** What a session may know of the daemon, as JSON.  Ownership: free().  NULL: no memory. */
char *server_status(struct server *server, const struct session *session);

#endif /* DAEMON_SERVER_SERVER_PRIVATE_H */
