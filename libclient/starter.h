/* SPDX-License-Identifier: MIT */
/**
 * starter.h - starts a daemon for this user where none listens.
 *
 * Many programs may find at the same time that no daemon runs.  They meet at a lock beside the
 * socket: whoever gets it looks once more and then starts one; the others go on trying to connect,
 * and take their turn at the lock should the first one die.  The daemon gets nothing of the program
 * that happened to start it: no descriptor, no terminal, no parent.
 *
 *	IDLE --step--> LOCKED --step, still nobody listens--> STARTED --connected, or it died--> IDLE
 *
 * Threads: one caller at a time.
 */
#ifndef LIBCLIENT_STARTER_H
#define LIBCLIENT_STARTER_H

#include "formats/base/why.h"

/** Options of the daemon beside its socket. */
#define STARTER_OPTION_COUNT_MAX 16

struct starter {
	const char *const *options; /* of the daemon, ended by NULL; or NULL: none */
	int lock_fd;                /* -1: not held */
	int process_fd;             /* pidfd of the daemon that was started; -1: none */
};

/** options: at most STARTER_OPTION_COUNT_MAX, ended by NULL; they outlive the starter.  Or NULL. */
void starter_init(struct starter *starter, const char *const *options);

/** Gives the lock back.  A daemon that was started runs on. */
void starter_done(struct starter *starter);

/**
 * Goes one step further.  Call after each attempt to connect that found nobody.
 *
 * socket_path:  absolute.
 *
 * Returns: -EAGAIN (connect again, soon), or
 *	-EACCES  the folder belongs to someone else
 *	-ENOENT  there is no folder, or no oocd to be found
 *	-ECONNREFUSED  the daemon ended without ever listening; the reason says where its words are
 *	or -errno.
 * May block: for the milliseconds that starting a process takes.
 */
int starter_step(struct starter *starter, const char *socket_path, struct why *why);

/**
 * Is the folder of a user's own socket this user's alone?  In /tmp anyone could have made it first.
 *
 * Returns: 0 (also where it does not exist) or -EACCES with the reason.
 */
int starter_check_folder(const char *socket_path, struct why *why);

#endif /* LIBCLIENT_STARTER_H */
