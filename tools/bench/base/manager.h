/* SPDX-License-Identifier: MIT */
/**
 * manager.h - a service manager of our own: it has the socket, keeps descriptors, and hands both to the
 * oocd that it starts next.  For measurements and tests of what outlives a daemon.
 *
 * It restarts nothing by itself, and no watchdog of it kills.
 *
 * Threads: the one that made it; one of its own reads what the daemon says, so that the daemon never
 *	waits for us.
 */
#ifndef TOOLS_BENCH_BASE_MANAGER_H
#define TOOLS_BENCH_BASE_MANAGER_H

#include <stdbool.h>
#include <stdint.h>
#include <sys/types.h>

#include "formats/base/why.h"

struct manager;

/**
 * folder:  where its sockets are, oocd.sock among them.
 *
 * Returns: 0, -ENAMETOOLONG, -ENOMEM or -errno.
 * Ownership: ends with manager_destroy().
 */
int manager_create(const char *folder, struct manager **ret, struct why *why);
/** Kills what runs, and forgets what is kept.  NULL is allowed.  Returns: NULL. */
struct manager *manager_destroy(struct manager *manager);

/**
 * Starts oocd and waits until it says that it is ready.  None may run.
 *
 * program:  its path.
 * options:  of the command line, at most 16, NULL at the end.
 *
 * Returns: 0, -ETIMEDOUT or -errno.
 */
int manager_start(struct manager *manager, const char *program, const char *const *options,
		  struct why *why);
/** Ends it by a signal and waits.  Returns: its exit status, or minus the signal that killed it. */
int manager_stop(struct manager *manager, int signal);
/** 0: none runs. */
pid_t manager_pid(const struct manager *manager);
const char *manager_socket(const struct manager *manager);

/** How many descriptors are kept whose names have `part` in them. */
uint32_t manager_kept_count(struct manager *manager, const char *part);
/** The n-th of them, or -1; it stays the manager's. */
int manager_kept(struct manager *manager, const char *part, uint32_t n);
/** How often the daemon that was started last has said something that has `part` in it. */
uint32_t manager_said(struct manager *manager, const char *part);
/** Waits until it was so often.  Returns: false when it takes too long. */
bool manager_await(struct manager *manager, const char *part, uint32_t count);
/** Waits until exactly so many descriptors are kept.  Returns: likewise. */
bool manager_await_kept(struct manager *manager, const char *part, uint32_t count);
/** Keeps nothing from now on, and forgets what there is. */
void manager_keep_nothing(struct manager *manager);

#endif /* TOOLS_BENCH_BASE_MANAGER_H */
