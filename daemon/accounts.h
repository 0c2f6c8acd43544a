/* SPDX-License-Identifier: MIT */
/**
 * accounts.h - who uses the daemon: one account a uid, and what each may use.
 *
 * Threads: loop thread.
 */
#ifndef DAEMON_ACCOUNTS_H
#define DAEMON_ACCOUNTS_H

#include <stdint.h>
#include <sys/types.h>

/** What the configuration says of one user; 0: the usual. */
struct account_policy {
	uid_t uid;
	uint32_t weight;             /* of its fetches, and of its share of the cache; usual: 100 */
	uint32_t share_permille;     /* of the cache, guaranteed; usual: by weight */
	uint32_t session_count_max;  /* connections at one time */
	uint64_t prefetch_bytes_max; /* that one PREFETCH may fill */
};

#endif /* DAEMON_ACCOUNTS_H */
