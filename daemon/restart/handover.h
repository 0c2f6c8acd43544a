/* SPDX-License-Identifier: MIT */
/**
 * handover.h - what outlives the daemon: descriptors that it leaves with the service manager as they
 * come to be, and that the manager hands to the daemon that it starts next.
 *
 * For each store these are, under names that begin with the store's key: its file, its ledger, its
 * directory and those of predecessors whose clients may still look at them, and its segments.  A
 * daemon may be killed between any two calls, so a successor takes only what is whole (takeover.h).
 * Where there is no manager with a descriptor store, nothing is left and a successor begins cold.
 *
 * Threads: loop thread.  May block for as long as the manager does not read.
 * Source: sd_pid_notify_with_fds(3), FDSTORE=1.
 */
#ifndef DAEMON_RESTART_HANDOVER_H
#define DAEMON_RESTART_HANDOVER_H

#include <stdbool.h>
#include <stdint.h>

#include "daemon/cache/served.h"
#include "formats/base/list.h"

/* ---- what a predecessor left ---- */

/** A daemon that dies again and again leaves a directory each time. */
#define KEPT_DIRECTORY_MAX 16u

struct kept_segment {
	uint32_t number;
	uint32_t huge_mib; /* of it in pages of 2 MiB */
	int fd;
};

struct kept_directory {
	uint64_t epoch;
	int fd;
};

/** What is left of one store; whoever takes a descriptor puts -1 in its place. */
struct kept_store {
	struct list link;
	uint64_t key;
	int file_fd;
	int ledger_fd;
	uint32_t directory_count;
	struct kept_directory directories[KEPT_DIRECTORY_MAX]; /* the newest first */
	uint32_t segment_count;
	struct kept_segment segments[WIRE_SEGMENT_COUNT_MAX];
};

/**
 * Takes what the service manager hands to this process, as its environment says.
 *
 * ret_stores:     kept_store entries.
 * ret_socket_fd:  the socket to listen on, or -1.
 *
 * What is neither is closed, and taken out of the descriptor store if it is of ours.
 */
void handover_collect(struct list *ret_stores, int *ret_socket_fd);

/** Closes what was not taken.  forget: and has the manager close it as well. */
struct kept_store *kept_store_destroy(struct kept_store *kept, bool forget);

/* ---- what is left to a successor ---- */

/** Is there anyone to leave it with, as far as that can be known? */
bool handover_is_possible(void);

/** Its file and ledger; then, once its nodes are as they are, its directory. */
void handover_keep_store(const struct served *served);
void handover_keep_directory(const struct served *served, uint64_t epoch);
void handover_keep_segment(const struct served *served, const struct segment *segment);

void handover_forget_segment(const struct served *served, const struct segment *segment);
void handover_forget_directory(const struct served *served, uint64_t epoch);
/** But for segments and directories. */
void handover_forget_store(const struct served *served);

#endif /* DAEMON_RESTART_HANDOVER_H */
