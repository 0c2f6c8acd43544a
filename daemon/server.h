/* SPDX-License-Identifier: MIT */
/**
 * server.h - the daemon as a whole: one loop, one cache, its clients and stores.
 *
 * Threads: the thread that creates the server runs it, and is the loop thread of all of daemon/.
 *	server_stop() may be called from anywhere.
 */
#ifndef DAEMON_SERVER_H
#define DAEMON_SERVER_H

#include <stdint.h>

#include "daemon/fetch.h"
#include "formats/base/why.h"

struct server;

struct server_config {
	const char *socket_path; /* NULL: listens on socket_fd */
	int socket_fd;           /* bound and listening already, or -1; taken over */
	uint64_t cache_bytes;
	uint32_t queue_depth;
	uint32_t worker_count;
	enum fetch_kind fetch_kind;
	struct fetch_sim sim;
	uint64_t idle_exit_s;  /* ends when nobody has been connected for so long; 0: never */
	uint64_t idle_close_s; /* closes a store that nobody has had open for so long */
};

/**
 * Signals SIGTERM and SIGINT are blocked from here on, and end the server.
 *
 * Returns: 0, -EADDRINUSE (somebody serves that socket), or another -errno with what to do.
 */
int server_create(const struct server_config *config, struct server **ret, struct why *why);

/** Opens a store before any client asks.  It stays open.  Returns: 0 or -errno. */
int server_open_store(struct server *server, const char *path, struct why *why);

/** Serves until it is told to stop.  Returns: 0 or -errno. */
int server_run(struct server *server);

/** Removes the socket.  NULL is allowed.  Returns: NULL. */
struct server *server_destroy(struct server *server);

#endif /* DAEMON_SERVER_H */
