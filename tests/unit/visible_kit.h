/* SPDX-License-Identifier: MIT */
/**
 * visible_kit.h - sets of four sessions of two users over one cache, driven by hand.
 *
 * The daemon's own parts below a session, with the simulated back end.  What goes wrong fails the test,
 * and so do books that do not agree, whatever is done.
 */
#ifndef TESTS_UNIT_VISIBLE_KIT_H
#define TESTS_UNIT_VISIBLE_KIT_H

#include <stdbool.h>
#include <stdint.h>

#include "daemon/sharing/visible.h"
#include "formats/base/bytes.h"
#include "tests/unit/parts_kit.h"

#define BUDGET_BYTES  (2u * MIB)
#define SESSION_COUNT 4u
#define ACCOUNT_COUNT 2u
#define WANTS_MAX     1024u

struct kit {
	struct parts parts;
	struct room room;
	struct account accounts[ACCOUNT_COUNT]; /* the first has sessions 0 and 1 */
	struct visible visible[SESSION_COUNT];
	struct wire_session_page pages[SESSION_COUNT];
	uint32_t fit_count; /* payloads that the cache holds at one time */
};

/** For cmocka: all is well; payloads are coded; reads fail; payloads are damaged. */
int kit_setup(void **state);
int kit_setup_coded(void **state);
int kit_setup_failing(void **state);
int kit_setup_corrupting(void **state);
int kit_teardown(void **state);

/** Do all counts agree? */
void kit_books_check(const struct kit *kit);

/** What the loop does with one session's queue.  Returns: does it wait for room? */
bool kit_begin_fetches(struct kit *kit, struct visible *visible);
/** Takes what comes back, if anything is on its way. */
void kit_run_once(struct kit *kit);
/** Until nothing moves: the set is settled, or waits for others to let go. */
void kit_settle(struct kit *kit, struct visible *visible);
/** Until all sets are settled and nobody is asked for anything any more. */
void kit_settle_all(struct kit *kit);

/** Takes nodes first .. first + count - 1 of those with payload as a set. */
void kit_take(struct kit *kit, uint32_t session, uint32_t first, uint32_t count, bool retire);
/** The same set once more. */
void kit_say_again(struct kit *kit, uint32_t session);

/** Of the at-th node with payload.  NULL: the session does not want it. */
const struct want *kit_want_of(const struct kit *kit, uint32_t session, uint32_t at);
bool kit_is_granted(const struct kit *kit, uint32_t session, uint32_t at);
enum node_state kit_state_of(const struct kit *kit, uint32_t at);

#endif /* TESTS_UNIT_VISIBLE_KIT_H */
