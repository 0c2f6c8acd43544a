/* SPDX-License-Identifier: MIT */
/**
 * listener.h - the socket that the daemon listens on, and that no second daemon does.
 *
 * A lock file beside the socket settles the race: whoever has it may replace a socket file that
 * nobody listens on.  Both files go when the listener is closed.
 *
 * Threads: loop thread.
 */
#ifndef DAEMON_SERVER_LISTENER_H
#define DAEMON_SERVER_LISTENER_H

#include "formats/base/why.h"

struct listener {
	int fd;
	int lock_fd; /* -1: the socket was handed to us */
	char path[108];
	char lock_path[128];
};

#define LISTENER_NONE ((struct listener){ .fd = -1, .lock_fd = -1 })

/**
 * Listens on a path; its folder is made where it is missing.
 *
 * kind:  SOCK_SEQPACKET or SOCK_STREAM.
 *
 * Returns: 0, -EADDRINUSE (another daemon or program listens there), -ENAMETOOLONG, -EPERM (the
 *	folder belongs to somebody else) or -errno.
 */
int listener_open(const char *path, int kind, struct listener *ret, struct why *why);

/** Takes over a socket that somebody else has bound and listens on, who also removes it. */
int listener_adopt(int fd, struct listener *ret, struct why *why);

void listener_close(struct listener *listener);

#endif /* DAEMON_SERVER_LISTENER_H */
