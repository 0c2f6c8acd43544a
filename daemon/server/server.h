/* SPDX-License-Identifier: MIT */
/**
 * server.h - the daemon as a whole: one loop, one cache, its clients and stores.
 *
 * Threads: the thread that creates the server runs it, and is the loop thread of all of daemon/.
 *	server_stop() may be called from anywhere.
 */
#ifndef DAEMON_SERVER_SERVER_H
#define DAEMON_SERVER_SERVER_H

#include <stdbool.h>
#include <stdint.h>
#include <sys/types.h>

#include "daemon/cache/replacement.h"
#include "daemon/fetch/fetch.h"
#include "daemon/sharing/accounts.h"
#include "formats/base/list.h"
#include "formats/base/why.h"

struct server;

/** Texts and arrays outlive the server, or are replaced by a reload. */
struct server_config {
	const char *socket_path; /* NULL: listens on socket_fd */
	int socket_fd;           /* bound and listening already, or -1; taken over */
	uint64_t cache_bytes;
	uint32_t queue_depth;
	uint32_t worker_count;
	enum fetch_kind fetch_kind;
	struct fetch_sim sim;
	const struct disk_profile *disk; /* see fetch_config */
	uint64_t idle_exit_s; /* ends when nobody has been connected for so long; 0: never */
	uint64_t lease_ms;    /* that a client may hold what others need without a word; 0: usual */
	uint64_t idle_close_s; /* closes a store that nobody has had open for so long */

	struct list *kept_stores; /* of handover_collect(): taken over; NULL: none */
	uint64_t grace_ms; /* for so long, what clients of a predecessor draw stays as it is */

	const char *const *stores; /* that are open whether anybody asks or not */
	uint32_t store_count;
	const struct account_policy *policies; /* one a uid at most */
	uint32_t policy_count;
	gid_t admin_gid; /* may steer, besides root and our user; 0: nobody else */
	enum replacement_policy replacement;
	const char *trace_path;          /* NULL: none */
	const char *metrics_path;        /* file that is written anew now and then; NULL: none */
	const char *metrics_socket_path; /* whoever connects is told; NULL: none */

	/**
	 * Reads the configuration anew.  reload_done() follows where it succeeds: what of ret is
	 * taken is used until the next one is, and what is not taken may go.
	 *
	 * Returns: 0, or -errno with what is wrong.  NULL: there is nothing to read.
	 */
	int (*reload)(void *arg, struct server_config *ret, struct why *why);
	void (*reload_done)(void *arg, bool taken);
	void *reload_arg;
};

/**
 * Signals SIGTERM, SIGINT and SIGHUP are blocked from here on; the first two end the server, the last
 * one reloads it where there is a configuration, and ends it where there is none.
 *
 * Returns: 0, -EADDRINUSE (somebody serves that socket), or another -errno with what to do.
 */
int server_create(const struct server_config *config, struct server **ret, struct why *why);

/** Opens a store before any client asks.  It stays open.  Returns: 0 or -errno. */
int server_open_store(struct server *server, const char *path, struct why *why);

/**
 * Takes over what may change while it serves: cache_bytes (0: as it is), idle times, stores, policies,
 * the group that may steer.  On failure all stays as it is.
 *
 * Returns: 0, -EOPNOTSUPP (there is no configuration to read), or -errno with what is wrong.
 */
int server_reload(struct server *server, struct why *why);

/** Serves until it is told to stop.  Returns: 0 or -errno. */
int server_run(struct server *server);

/** Removes the socket.  NULL is allowed.  Returns: NULL. */
struct server *server_destroy(struct server *server);

#endif /* DAEMON_SERVER_SERVER_H */
