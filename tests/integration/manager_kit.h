/* SPDX-License-Identifier: MIT */
/**
 * manager_kit.h - a service manager for tests: it has the socket, keeps descriptors, and hands both
 * to the oocd that it starts next.
 *
 * A thread reads what the daemon says, so that the daemon never waits for the test.  What goes wrong
 * fails the test.  Include it after <cmocka.h>.
 */
#ifndef TESTS_MANAGER_KIT_H
#define TESTS_MANAGER_KIT_H

#include <stdbool.h>
#include <stdint.h>
#include <sys/types.h>

struct manager;

/** folder: where its sockets are, oocd.sock among them. */
struct manager *manager_create(const char *folder);
/** Kills what runs, and forgets what is kept. */
struct manager *manager_destroy(struct manager *manager);

/**
 * Starts oocd and waits until it is ready.
 *
 * options:  of the command line, NULL at the end.
 */
void manager_start(struct manager *manager, const char *const *options);
/** Ends it by a signal and waits.  Returns: its exit status, or minus the signal that killed it. */
int manager_stop(struct manager *manager, int signal);
pid_t manager_pid(const struct manager *manager);
const char *manager_socket(const struct manager *manager);

/** How many descriptors are kept whose names have `part` in them. */
uint32_t manager_kept_count(struct manager *manager, const char *part);
/** The n-th of them; it stays the manager's. */
int manager_kept(struct manager *manager, const char *part, uint32_t n);
/** How often the daemon that was started last has said something that has `part` in it. */
uint32_t manager_said(struct manager *manager, const char *part);
/** Waits until it was. */
void manager_await(struct manager *manager, const char *part, uint32_t count);
/** Waits until so many descriptors are kept. */
void manager_await_kept(struct manager *manager, const char *part, uint32_t count);
/** Keeps nothing from now on, and forgets what there is. */
void manager_keep_nothing(struct manager *manager);

#endif /* TESTS_MANAGER_KIT_H */
