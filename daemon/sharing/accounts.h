/* SPDX-License-Identifier: MIT */
/**
 * accounts.h - who uses the daemon: one account a uid, what each may use, and what it does use.
 *
 * Everything that a client can make the daemon spend is charged to its user's account: sessions, held
 * pages, fetches and prefetches, bytes of answers, lines in the log.  What is bounded is bounded
 * here, by the configuration's policies or by what is usual (limits.h).
 *
 * An account lives while its user has sessions, and afterwards as long as there are few, so that what
 * it did stays to be seen.  It knows no sessions: they tell it.
 *
 * Threads: loop thread.
 */
#ifndef DAEMON_SHARING_ACCOUNTS_H
#define DAEMON_SHARING_ACCOUNTS_H

#include <stdbool.h>
#include <stdint.h>
#include <sys/types.h>

#include "formats/base/list.h"
#include "formats/base/why.h"

/** What the configuration says of one user; 0: the usual. */
struct account_policy {
	uid_t uid;
	uint32_t weight;             /* of its fetches, and of its share of the cache; usual: 100 */
	uint32_t share_permille;     /* of the cache, guaranteed; usual: by weight */
	uint32_t session_count_max;  /* connections at one time */
	uint64_t prefetch_bytes_max; /* that one PREFETCH may fill */
};

struct account {
	struct list link; /* accounts.in_order */
	struct account_policy
		policy; /* with nothing left at 0 but share_permille, prefetch_bytes_max */

	uint32_t session_count;
	uint32_t fetching_count; /* its sessions with fetches that wait; queues.c counts */
	uint64_t held_pages;     /* once for each session that holds them; visible.c counts */

	/* Since it came. */
	uint64_t refused_count; /* connections beyond its cap */
	uint64_t fetched_bytes;
	uint64_t prefetched_bytes;
	uint64_t prefetch_count;      /* nodes asked for */
	uint64_t sent_bytes;          /* answers */
	uint64_t unlogged_count;      /* lines that were left out */
	uint64_t unlogged_told_count; /* of which a later line has told */

	uint64_t log_since_ns; /* of the time in which log_count lines were written */
	uint32_t log_count;

	/* Of the newest division of the cache (division.c). */
	uint32_t claim_count; /* sessions that want something */
	uint64_t claim_share; /* what each of them is guaranteed */
};

struct accounts {
	struct list in_order; /* of having come */
	uint32_t count;
	const struct account_policy *policies;
	uint32_t policy_count;
};

/** policies: one a uid at most; they outlive the accounts, or are replaced. */
void accounts_init(struct accounts *accounts, const struct account_policy *policies,
		   uint32_t policy_count);
/** Nobody may be in any of them. */
void accounts_done(struct accounts *accounts);
/** From now on; sessions that are beyond a lower cap stay. */
void accounts_set_policies(struct accounts *accounts, const struct account_policy *policies,
			   uint32_t policy_count);

/**
 * A session of a user begins.
 *
 * ret:  also set when the user has as many as it may, for account_may_log().
 *
 * Returns: 0, -EAGAIN (it has as many: the reason is one line), or -ENOMEM.
 * Ownership: ended with account_leave(), on success.
 */
int accounts_join(struct accounts *accounts, uid_t uid, struct account **ret, struct why *why);
void account_leave(struct account *account);

/**
 * May a line about this user be written now?  ACCOUNT_LOG_LINES_MAX in ACCOUNT_LOG_SECONDS, so that
 * nobody fills the disk with what he makes the daemon say.
 *
 * ret_unlogged:  lines left out since the last one that was written; to be said with this one.
 */
bool account_may_log(struct account *account, uint64_t now_ns, uint64_t *ret_unlogged);

/** Asserts the counts.  O(accounts). */
void accounts_check(const struct accounts *accounts);

#endif /* DAEMON_SHARING_ACCOUNTS_H */
