/* SPDX-License-Identifier: MIT */
/**
 * debts.h - whose reads a client lives on: how many of its wants another session's read served.
 *
 * Threads: loop thread.  Memory: fixed; who owes to more than DEBT_COUNT_MAX sessions owes the rest to
 * "others".
 */
#ifndef DAEMON_SHARING_DEBTS_H
#define DAEMON_SHARING_DEBTS_H

#include <stdint.h>

#define DEBT_COUNT_MAX 16u

struct debt {
	uint32_t session; /* that paid */
	uint64_t nodes;
};

/** Zeroed: none. */
struct debts {
	struct debt debts[DEBT_COUNT_MAX];
	uint32_t count;
	uint64_t others; /* nodes */
};

/** One node more that a session's read has served. */
void debts_add(struct debts *debts, uint32_t session);

#endif /* DAEMON_SHARING_DEBTS_H */
