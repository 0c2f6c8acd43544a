/* SPDX-License-Identifier: MIT */
#include "daemon/server/connection.h"

#include <errno.h>
#include <poll.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/pidfd.h>
#include <sys/socket.h>

#include "formats/base/file.h"
#include "libclient/wire.h"

/* Linux 6.5; the headers of Debian 12 do not have it. */
#ifndef SO_PEERPIDFD
#define SO_PEERPIDFD 77
#endif

struct connection {
	struct connection_calls calls;
	void *calls_arg;
	sd_event_source *socket_source;
	sd_event_source *peer_source; /* NULL: its death shows by hang-up only */
	sd_event_source *break_source;
	int socket_fd;
	int peer_fd;
	bool peer_by_number; /* peer_fd is of the process that has the peer's number now */
	struct ucred peer;
	_Atomic uint64_t *message_count;
	bool broken;
	int error; /* that goes with the reason */
	bool has_reason;
	struct why reason;
	_Alignas(8) uint8_t message[WIRE_MESSAGE_BYTES_MAX];
};

static void set_broken(struct connection *connection)
{
	if (connection->broken)
		return;
	connection->broken = true;
	(void)sd_event_source_set_enabled(connection->socket_source, SD_EVENT_OFF);
	if (connection->peer_source)
		(void)sd_event_source_set_enabled(connection->peer_source, SD_EVENT_OFF);
	(void)sd_event_source_set_enabled(connection->break_source, SD_EVENT_ONESHOT);
}

void connection_break(struct connection *connection, int error, const char *text)
{
	if (connection->broken)
		return;
	connection->error = why_set(&connection->reason, error, "%s", text);
	connection->has_reason = true;
	set_broken(connection);
}

static int on_break(sd_event_source *source, void *arg)
{
	struct connection *connection = arg;

	(void)source;
	connection->calls.gone(connection->calls_arg,
			       connection->has_reason ? &connection->reason : NULL);
	return 0;
}

static int on_peer_exit(sd_event_source *source, int fd, uint32_t events, void *arg)
{
	(void)source;
	(void)fd;
	(void)events;
	set_broken(arg);
	return 0;
}

static void receive(struct connection *connection)
{
	int fds[WIRE_FD_COUNT_MAX];
	size_t fd_count = 0;
	int r;

	r = wire_receive(connection->socket_fd, connection->message, fds, &fd_count);
	if (r == -EAGAIN || r == -EINTR)
		return;
	if (r == 0 || r == -ECONNRESET) {
		set_broken(connection);
		return;
	}
	if (r < 0) {
		connection_break(connection, r, "its message cannot be received");
		return;
	}
	r = wire_check(WIRE_FROM_CLIENT, connection->message, (size_t)r, fd_count,
		       &connection->reason);
	if (r < 0) {
		for (size_t i = 0; i < fd_count; i++)
			(void)fd_close(fds[i]);
		connection->error = r;
		connection->has_reason = true;
		set_broken(connection);
		return;
	}
	connection->calls.message(connection->calls_arg, connection->message, fds, fd_count);
}

static int on_socket(sd_event_source *source, int fd, uint32_t events, void *arg)
{
	struct connection *connection = arg;

	(void)fd;
	if (events & EPOLLOUT) {
		(void)sd_event_source_set_io_events(source, EPOLLIN);
		connection->calls.writable(connection->calls_arg);
	}
	if (connection->broken)
		return 0;
	/* What a client said before it hung up is still heard, for it may be the release of all. */
	if (events & EPOLLIN)
		receive(connection);
	else if (events & (EPOLLHUP | EPOLLERR))
		set_broken(connection);
	return 0;
}

/*
 * From 6.5 on the kernel says which process connected, without the race of the second way: a pid may
 * be another process's by now.  Then its death would not be seen here, but by hang-up.
 */
static int open_peer(struct connection *connection)
{
	socklen_t length = sizeof(int);
	int fd = -1;

	if (getsockopt(connection->socket_fd, SOL_SOCKET, SO_PEERPIDFD, &fd, &length) == 0)
		return fd;
	connection->peer_by_number = true;
	return pidfd_open(connection->peer.pid, 0);
}

static int add_sources(struct connection *connection, sd_event *event)
{
	socklen_t length = sizeof(connection->peer);
	int r;

	if (getsockopt(connection->socket_fd, SOL_SOCKET, SO_PEERCRED, &connection->peer, &length) <
	    0)
		return -errno;
	r = sd_event_add_io(event, &connection->socket_source, connection->socket_fd, EPOLLIN,
			    on_socket, connection);
	if (r < 0)
		return r;
	r = sd_event_add_defer(event, &connection->break_source, on_break, connection);
	if (r < 0)
		return r;
	(void)sd_event_source_set_enabled(connection->break_source, SD_EVENT_OFF);
	connection->peer_fd = open_peer(connection);
	if (connection->peer_fd < 0)
		return 0;
	(void)sd_event_add_io(event, &connection->peer_source, connection->peer_fd, EPOLLIN,
			      on_peer_exit, connection);
	return 0;
}

int connection_create(sd_event *event, int socket_fd, const struct connection_calls *calls,
		      void *calls_arg, struct connection **ret, struct why *why)
{
	struct connection *connection = calloc(1, sizeof(*connection));
	int r;

	if (!connection) {
		(void)fd_close(socket_fd);
		return why_errno(why, -ENOMEM, "a connection");
	}
	connection->calls = *calls;
	connection->calls_arg = calls_arg;
	connection->socket_fd = socket_fd;
	connection->peer_fd = -1;
	r = add_sources(connection, event);
	if (r < 0) {
		connection_destroy(connection);
		return why_errno(why, r, "a connection");
	}
	*ret = connection;
	return 0;
}

struct connection *connection_destroy(struct connection *connection)
{
	if (!connection)
		return NULL;
	(void)sd_event_source_disable_unref(connection->socket_source);
	(void)sd_event_source_disable_unref(connection->peer_source);
	(void)sd_event_source_disable_unref(connection->break_source);
	(void)fd_close(connection->peer_fd);
	(void)fd_close(connection->socket_fd);
	free(connection);
	return NULL;
}

void connection_count_in(struct connection *connection, _Atomic uint64_t *message_count)
{
	connection->message_count = message_count;
}

int connection_send(struct connection *connection, const void *message, size_t message_bytes,
		    const int *fds, size_t fd_count)
{
	int r;

	if (connection->broken)
		return -EPIPE;
	r = wire_send(connection->socket_fd, message, message_bytes, fds, fd_count);
	if (r == -EAGAIN)
		connection_break(connection, r, "it does not read what it is sent");
	else if (r < 0)
		set_broken(connection);
	else
		/* Pairs with the client's acquire load: the message is in its socket by then. */
		atomic_fetch_add_explicit(connection->message_count, 1, memory_order_release);
	return r;
}

bool connection_can_send(struct connection *connection)
{
	struct pollfd poll_fd = { .fd = connection->socket_fd, .events = POLLOUT };

	return !connection->broken && poll(&poll_fd, 1, 0) == 1 && (poll_fd.revents & POLLOUT);
}

void connection_want_send(struct connection *connection)
{
	if (!connection->broken)
		(void)sd_event_source_set_io_events(connection->socket_source, EPOLLIN | EPOLLOUT);
}

bool connection_is_quiet(struct connection *connection)
{
	struct pollfd poll_fd = { .fd = connection->socket_fd, .events = POLLIN };

	/* The client writes to its socket, then reads shared memory; here it is the other way round. */
	atomic_thread_fence(memory_order_seq_cst);
	return poll(&poll_fd, 1, 0) == 0;
}

bool connection_knows_peer(const struct connection *connection)
{
	return !connection->peer_by_number;
}

pid_t connection_pid(const struct connection *connection)
{
	return connection->peer.pid;
}

uid_t connection_uid(const struct connection *connection)
{
	return connection->peer.uid;
}

int connection_error(const struct connection *connection)
{
	return connection->error;
}

bool connection_in_group(const struct connection *connection, gid_t gid)
{
	/* As many as Linux allows a process. */
	static gid_t groups[65536];
	socklen_t length = sizeof(groups);

	if (connection->peer.gid == gid)
		return true;
	if (getsockopt(connection->socket_fd, SOL_SOCKET, SO_PEERGROUPS, groups, &length) < 0)
		return false;
	for (size_t i = 0; i < length / sizeof(groups[0]); i++)
		if (groups[i] == gid)
			return true;
	return false;
}
