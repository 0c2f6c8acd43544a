/* SPDX-License-Identifier: MIT */
/**
 * connection.h - one client's socket: whole checked messages in, messages out, and its death.
 *
 * One message is taken a round.  Sends never block: what cannot be sent at once ends the
 * connection, so whatever is sent often or in pieces waits for connection_can_send().  Death is seen
 * by hang-up and by the process's pidfd, because a forked child that keeps the socket hides the
 * hang-up.
 *
 * It does not know what messages mean.
 *
 * Threads: loop thread.
 */
#ifndef DAEMON_SERVER_CONNECTION_H
#define DAEMON_SERVER_CONNECTION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>
#include <systemd/sd-event.h>

#include "formats/base/why.h"

struct connection;

struct connection_calls {
	/**
	 * A message that passed wire_check().
	 *
	 * fds:  the callee closes them.
	 */
	void (*message)(void *arg, const void *message, const int *fds, size_t fd_count);
	/** There is room to send again (connection_want_send()). */
	void (*writable)(void *arg);
	/**
	 * The client is gone, or has broken the protocol.  Called once, from the loop and never from
	 * inside another function of the connection.  why: NULL when it just hung up.
	 */
	void (*gone)(void *arg, const struct why *why);
};

/**
 * socket_fd:  taken over, whatever happens.
 *
 * Returns: 0, -ENOMEM or -errno.
 */
int connection_create(sd_event *event, int socket_fd, const struct connection_calls *calls,
		      void *calls_arg, struct connection **ret, struct why *why);
/** Counts there what is sent from now on.  The client reads it. */
void connection_count_in(struct connection *connection, _Atomic uint64_t *message_count);
/** NULL is allowed.  Returns: NULL. */
struct connection *connection_destroy(struct connection *connection);

/**
 * Sends one message.  Where that fails, the connection is broken and gone() will be called.
 *
 * Returns: 0 or -errno.
 */
int connection_send(struct connection *connection, const void *message, size_t message_bytes,
		    const int *fds, size_t fd_count);

/** Ends it from our side: gone() will be called with this reason. */
void connection_break(struct connection *connection, int error, const char *text);

/** Has the client read most of what was sent?  Then a message of any length will do. */
bool connection_can_send(struct connection *connection);
/** Asks for writable() once. */
void connection_want_send(struct connection *connection);

/**
 * Is everything read that the client has sent?  What comes next was then sent after all that this
 * thread has written to shared memory before the call.
 */
bool connection_is_quiet(struct connection *connection);

/** Is it surely the peer whose death is watched?  Before Linux 6.5 it is only who has its number. */
bool connection_knows_peer(const struct connection *connection);
pid_t connection_pid(const struct connection *connection);
uid_t connection_uid(const struct connection *connection);
/** Why it was broken from our side, an errno; 0: the client hung up, or nothing was broken yet. */
int connection_error(const struct connection *connection);
/** Was the client's user in the group when it connected? */
bool connection_in_group(const struct connection *connection, gid_t gid);

#endif /* DAEMON_SERVER_CONNECTION_H */
