/* SPDX-License-Identifier: MIT */
/*
 * Goal: sets are taken over, answered and given back as visible.h says.
 * Method: the daemon's own parts below a session, with the simulated back end, driven by hand.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "daemon/sharing/division.h"
#include "daemon/sharing/visible.h"
#include "formats/base/bytes.h"
#include "formats/base/log.h"
#include "tests/helper.h"

#define BUDGET_BYTES  (2u * MIB)
#define SESSION_COUNT 4u
#define ACCOUNT_COUNT 2u
#define WANTS_MAX     1024u

struct fixture {
	char *folder;
	struct cache cache;
	struct room room;
	struct account
		accounts[ACCOUNT_COUNT]; /* sessions 0 and 1 are the first's, others the second's */
	struct workers *workers;
	struct fills *fills;
	struct fetch *fetch;
	struct served *served;
	struct visible visible[SESSION_COUNT];
	struct wire_session_page pages[SESSION_COUNT];
	uint32_t nodes[WANTS_MAX]; /* with payload */
	uint32_t node_count;
	uint32_t fit_count; /* payloads that the cache holds at one time */
};

static void on_make(void *arg, struct served *served)
{
	struct fixture *fixture = arg;
	struct memfile memfile;
	struct segment *segment;

	assert_int_equal(memfile_create("test", served->arena.segment_bytes, false, &memfile, NULL),
			 0);
	assert_int_equal(memfile_publish(&memfile, MEMFILE_CHANGING, NULL), 0);
	assert_int_equal(cache_add_segment(&fixture->cache, served, &memfile, &segment), 0);
	segment->buffer = FETCH_BUFFER_NONE;
}

static void on_gone(void *arg, struct served *served, struct segment *segment)
{
	(void)arg;
	(void)served;
	(void)segment;
}

static void on_ended(void *arg, const struct fill_result *result)
{
	struct fixture *fixture = arg;

	for (uint32_t i = 0; i < SESSION_COUNT; i++)
		visible_fill_ended(&fixture->visible[i], result);
}

static int setup_with(void **state, struct fetch_sim sim, const struct test_grid *grid)
{
	const struct cache_calls calls = { .make = on_make, .gone = on_gone };
	struct fixture *fixture = calloc(1, sizeof(*fixture));
	struct fetch_config fetch_config = {
		.kind = FETCH_SIM, .depth = 4, .done = fills_read_done, .sim = sim
	};
	struct why why;
	const char *path;

	fixture->folder = test_folder_make();
	path = test_path(fixture->folder, "a.ooc");
	test_store_grid_make(path, grid);
	cache_init(&fixture->cache, BUDGET_BYTES, &calls, fixture);
	assert_int_equal(workers_create(1, &fixture->workers, &why), 0);
	assert_int_equal(fills_create(&fixture->cache, fixture->workers, on_ended, fixture,
				      &fixture->fills, &why),
			 0);
	fetch_config.done_arg = fixture->fills;
	assert_int_equal(fetch_create(&fetch_config, &fixture->fetch, &why), 0);
	fills_set_fetch(fixture->fills, fixture->fetch);
	if (served_open(open(path, O_RDONLY | O_CLOEXEC), path, BUDGET_BYTES, 1, &fixture->served,
			&why) < 0)
		fail_msg("%s", why.text);
	assert_int_equal(fills_prepare(fixture->fills, fixture->served, &why), 0);
	assert_int_equal(
		fetch_add_file(fixture->fetch, fixture->served->fd, &fixture->served->file), 0);
	cache_add_store(&fixture->cache, fixture->served);
	for (uint32_t i = 0; i < fixture->served->node_count && fixture->node_count < WANTS_MAX;
	     i++)
		if (served_has_payload(fixture->served, i))
			fixture->nodes[fixture->node_count++] = i;
	fixture->fit_count =
		BUDGET_BYTES / WIRE_PAGE_BYTES / served_pages(fixture->served, fixture->nodes[0]);
	room_init(&fixture->room, &fixture->cache);
	for (uint32_t i = 0; i < ACCOUNT_COUNT; i++)
		fixture->accounts[i].policy.weight = 100;
	for (uint32_t i = 0; i < SESSION_COUNT; i++) {
		visible_init(&fixture->visible[i], &fixture->room, &fixture->accounts[i / 2],
			     fixture->fills, i + 1, &fixture->pages[i]);
		assert_int_equal(visible_attach(&fixture->visible[i], 0, fixture->served, 1, &why),
				 0);
	}
	*state = fixture;
	return 0;
}

static const struct test_grid plain = { .count = 16, .face_quads = 4 };
static const struct test_grid coded = { .count = 16, .face_quads = 4, .codec = STORE_CODEC_ZSTD };

static int setup(void **state)
{
	return setup_with(state, (struct fetch_sim){ .seed = 1, .delay_permille = 200 }, &plain);
}

static int setup_coded(void **state)
{
	return setup_with(state, (struct fetch_sim){ .seed = 1, .short_permille = 200 }, &coded);
}

static int setup_failing(void **state)
{
	return setup_with(state, (struct fetch_sim){ .seed = 2, .error_permille = 500 }, &plain);
}

static int setup_corrupting(void **state)
{
	return setup_with(state, (struct fetch_sim){ .seed = 2, .corrupt_permille = 150 }, &plain);
}

static void books_check(const struct fixture *fixture)
{
	const struct store_counters *counters = &fixture->served->counters;
	uint32_t queued_count = 0;
	uint32_t hold_count = 0;

	cache_check(&fixture->cache);
	for (uint32_t i = 0; i < SESSION_COUNT; i++) {
		visible_check(&fixture->visible[i]);
		queued_count += visible_queued_count(&fixture->visible[i]);
		hold_count += fixture->visible[i].held_count;
	}
	for (uint32_t i = 0; i < fixture->served->node_count; i++)
		hold_count -= fixture->served->nodes[i].hold_count;
	assert_int_equal(hold_count, 0);
	/* What was missed is read, found on its way, given up or still waits. */
	assert_int_equal(counters->misses + counters->retries,
			 counters->fetches + counters->joined + counters->refused +
				 counters->dropped + queued_count);
}

/* What the loop does with one session's queue and what comes back.  Returns: does it wait for room? */
static bool begin_fetches(struct fixture *fixture, struct visible *visible)
{
	struct queue_want want;
	int r = 0;

	division_settle(&fixture->room);
	visible_retry(visible);
	while (r != -EAGAIN && r != -EBUSY && fills_has_room(fixture->fills) &&
	       visible_next(visible, &want)) {
		r = fills_start(fixture->fills, want.served, want.index, 1, false);
		if (r != -EAGAIN && r != -EBUSY)
			visible_begun(visible, &want, r);
	}
	fetch_flush(fixture->fetch);
	return r == -EBUSY;
}

static void run_once(struct fixture *fixture)
{
	struct pollfd fds[] = {
		{ .fd = fetch_fd(fixture->fetch), .events = POLLIN },
		{ .fd = workers_fd(fixture->workers), .events = POLLIN },
	};

	if (fills_count(fixture->fills) == 0)
		return;
	assert_true(poll(fds, 2, 20000) > 0);
	if (fds[0].revents)
		fetch_dispatch(fixture->fetch);
	fetch_flush(fixture->fetch);
	fills_verify(fixture->fills);
	if (fds[1].revents)
		workers_dispatch(fixture->workers);
}

/* Until nothing moves: the set is settled, or waits for others to let go. */
static void settle(struct fixture *fixture, struct visible *visible)
{
	struct wire_refusal refusals[WANTS_MAX];
	bool waits;

	do {
		waits = begin_fetches(fixture, visible);
		run_once(fixture);
	} while (fills_count(fixture->fills) > 0 || fixture->room.changed ||
		 (!waits && visible_missing_count(visible) > 0));
	(void)visible_take_refusals(visible, refusals, WANTS_MAX);
	visible_settle(visible);
	books_check(fixture);
}

static int teardown(void **state)
{
	struct fixture *fixture = *state;

	while (fills_count(fixture->fills) > 0)
		run_once(fixture);
	books_check(fixture);
	for (uint32_t i = 0; i < SESSION_COUNT; i++)
		visible_done(&fixture->visible[i]);
	cache_remove_store(&fixture->cache, fixture->served);
	workers_destroy(fixture->workers);
	fetch_destroy(fixture->fetch);
	fills_destroy(fixture->fills);
	served_close(fixture->served);
	test_folder_remove(fixture->folder);
	free(fixture);
	return 0;
}

/* Takes nodes first .. first + count - 1 of those with payload as a set. */
static void take(struct fixture *fixture, uint32_t session, uint32_t first, uint32_t count,
		 bool retire)
{
	struct visible *visible = &fixture->visible[session];
	struct wire_entry entries[WANTS_MAX] = { 0 };

	for (uint32_t i = 0; i < count; i++)
		entries[i] =
			(struct wire_entry){ 0, fixture->nodes[first + i], (float)(count - i) };
	assert_int_equal(visible_take(visible, entries, count, visible->serial + 1, retire), 0);
	assert_int_equal(fixture->pages[session].acknowledged, visible->serial);
	books_check(fixture);
	division_settle(&fixture->room);
	books_check(fixture);
}

static const struct want *want_of(const struct fixture *fixture, uint32_t session, uint32_t at)
{
	const struct visible *visible = &fixture->visible[session];
	uint32_t want = visible->attachments[0]->want_of_node[fixture->nodes[at]];

	return want > 0 ? &visible->wants[want - 1] : NULL;
}

static void say_again(struct fixture *fixture, uint32_t session)
{
	struct visible *visible = &fixture->visible[session];
	struct wire_entry entries[WANTS_MAX] = { 0 };

	for (uint32_t i = 0; i < visible->count; i++)
		entries[i] = (struct wire_entry){ visible->wants[i].slot, visible->wants[i].node,
						  (float)(visible->count - i) };
	assert_int_equal(visible_take(visible, entries, visible->count, visible->serial + 1, true),
			 0);
	division_settle(&fixture->room);
	books_check(fixture);
}

/* What a client does that is asked to let go. */
static bool answer_recall(struct fixture *fixture, uint32_t session)
{
	if (fixture->visible[session].revoked_count == 0)
		return false;
	visible_note_quiet(&fixture->visible[session]);
	say_again(fixture, session);
	return true;
}

/* Until all sets are settled and nobody is asked for anything any more. */
static void settle_all(struct fixture *fixture)
{
	bool again;

	do {
		again = false;
		for (uint32_t i = 0; i < SESSION_COUNT; i++)
			settle(fixture, &fixture->visible[i]);
		for (uint32_t i = 0; i < SESSION_COUNT; i++)
			again |= answer_recall(fixture, i);
	} while (again);
	for (uint32_t i = 0; i < SESSION_COUNT; i++) {
		assert_int_equal(visible_missing_count(&fixture->visible[i]), 0);
		assert_int_equal(fixture->pages[i].settled, fixture->visible[i].serial);
	}
}

static bool is_granted(const struct fixture *fixture, uint32_t session, uint32_t at)
{
	uint32_t node = fixture->nodes[at];

	return fixture->visible[session].attachments[0]->grants->words[node / 64] >> (node % 64) &
	       1;
}

static enum node_state state_of(const struct fixture *fixture, uint32_t at)
{
	return fixture->served->nodes[fixture->nodes[at]].state;
}

/* ---- tests ---- */

static void a_set_becomes_drawable_and_complete(void **state)
{
	struct fixture *fixture = *state;
	struct visible *visible = &fixture->visible[0];

	take(fixture, 0, 0, 20, true);
	assert_int_equal(visible->counts[WANT_QUEUED], 20);
	settle(fixture, visible);
	assert_int_equal(visible->counts[WANT_DRAWABLE], 20);
	assert_int_equal(fixture->pages[0].settled, visible->serial);
	assert_int_equal(fixture->pages[0].complete, visible->serial);
	assert_int_equal(fixture->served->counters.misses, 20);
	for (uint32_t i = 0; i < 20; i++)
		assert_true(is_granted(fixture, 0, i));
}

static void a_few_payloads_are_verified_without_a_worker_and_coded_ones_with(void **state)
{
	struct fixture *fixture = *state;
	bool is_coded = fixture->served->records[fixture->nodes[0]].codec != STORE_CODEC_NONE;

	take(fixture, 0, 0, 3, true);
	settle(fixture, &fixture->visible[0]);
	assert_int_equal(visible_missing_count(&fixture->visible[0]), 0);
	assert_int_equal(workers_ended_count(fixture->workers), is_coded ? 3 : 0);
}

static void a_hit_is_granted_at_once_and_overtakes_misses(void **state)
{
	struct fixture *fixture = *state;

	take(fixture, 0, 5, 1, true);
	settle(fixture, &fixture->visible[0]);
	take(fixture, 1, 0, 10, true);
	assert_int_equal(want_of(fixture, 1, 5)->state, WANT_DRAWABLE);
	assert_true(is_granted(fixture, 1, 5));
	assert_int_equal(fixture->visible[1].counts[WANT_QUEUED], 9);
	assert_int_equal(fixture->served->counters.hits, 1);
	settle(fixture, &fixture->visible[1]);
}

static void two_sessions_share_one_read(void **state)
{
	struct fixture *fixture = *state;

	take(fixture, 0, 0, 30, true);
	take(fixture, 1, 0, 30, true);
	begin_fetches(fixture, &fixture->visible[0]);
	settle(fixture, &fixture->visible[0]);
	assert_int_equal(fixture->visible[1].counts[WANT_DRAWABLE], 30);
	assert_int_equal(fixture->served->counters.fetches, 30);
	settle(fixture, &fixture->visible[1]);
}

static void what_a_set_drops_is_given_back_with_the_retire_flag(void **state)
{
	struct fixture *fixture = *state;

	take(fixture, 0, 0, 10, true);
	settle(fixture, &fixture->visible[0]);
	take(fixture, 0, 5, 10, true);
	assert_null(want_of(fixture, 0, 0));
	assert_false(is_granted(fixture, 0, 0));
	assert_int_equal(state_of(fixture, 0), NODE_FREE);
	assert_int_equal(want_of(fixture, 0, 5)->state, WANT_DRAWABLE);
	settle(fixture, &fixture->visible[0]);
}

static void what_a_set_drops_stays_drawable_until_it_is_retired(void **state)
{
	struct fixture *fixture = *state;
	struct visible *visible = &fixture->visible[0];

	take(fixture, 0, 0, 10, false);
	settle(fixture, visible);
	take(fixture, 0, 5, 10, false);
	settle(fixture, visible);
	assert_int_equal(want_of(fixture, 0, 0)->state, WANT_RETAINED);
	assert_true(is_granted(fixture, 0, 0));
	/* The set that dropped it is not the one before: an earlier retire changes nothing. */
	visible_retire(visible, 1);
	assert_int_equal(state_of(fixture, 0), NODE_HELD);
	visible_retire(visible, 2);
	assert_null(want_of(fixture, 0, 0));
	assert_int_equal(state_of(fixture, 0), NODE_FREE);
	assert_int_equal(visible->held_count, 10);
}

static void what_comes_back_before_it_is_retired_has_never_been_away(void **state)
{
	struct fixture *fixture = *state;
	struct visible *visible = &fixture->visible[0];

	take(fixture, 0, 0, 10, false);
	settle(fixture, visible);
	take(fixture, 0, 20, 10, false);
	take(fixture, 0, 0, 10, false);
	assert_int_equal(visible->counts[WANT_DRAWABLE], 10);
	visible_retire(visible, visible->serial);
	settle(fixture, visible);
	assert_int_equal(visible->held_count, 10);
	/* Only what was never dropped is asked for anew. */
	assert_int_equal(fixture->served->counters.hits, 0);
}

static void a_node_named_twice_counts_once(void **state)
{
	struct fixture *fixture = *state;
	struct visible *visible = &fixture->visible[0];
	struct wire_entry entries[] = {
		{ 0, fixture->nodes[3], 3.0f },
		{ 0, fixture->nodes[4], 2.0f },
		{ 0, fixture->nodes[3], 1.0f },
	};

	for (uint64_t serial = 1; serial <= 3; serial++) {
		assert_int_equal(visible_take(visible, entries, 3, serial, true), 0);
		assert_int_equal(visible->count, 2);
		settle(fixture, visible);
		assert_int_equal(visible->held_count, 2);
	}
}

static void a_set_of_what_is_no_node_is_refused_and_changes_nothing(void **state)
{
	struct fixture *fixture = *state;
	struct visible *visible = &fixture->visible[0];
	struct wire_entry bad[] = {
		{ 1, fixture->nodes[0], 1.0f },
		{ 64, fixture->nodes[0], 1.0f },
		{ UINT32_MAX, fixture->nodes[0], 1.0f },
		{ 0, fixture->served->node_count, 1.0f },
		{ 0, UINT32_MAX, 1.0f },
		{ 0, 0, 1.0f }, /* the root has no payload */
	};

	take(fixture, 0, 0, 10, true);
	for (size_t i = 0; i < ARRAY_LENGTH(bad); i++) {
		assert_int_equal(visible_take(visible, &bad[i], 1, 2, true), -EPROTO);
		assert_int_equal(visible->serial, 1);
	}
	settle(fixture, visible);
	assert_int_equal(visible->counts[WANT_DRAWABLE], 10);
}

static void what_does_not_fit_is_refused_from_the_end_of_the_set(void **state)
{
	struct fixture *fixture = *state;
	struct visible *visible = &fixture->visible[0];
	struct wire_refusal refusals[WANTS_MAX];
	uint32_t count;

	take(fixture, 0, 0, fixture->fit_count + 50, true);
	settle(fixture, visible);
	assert_int_equal(fixture->pages[0].settled, visible->serial);
	assert_int_equal(fixture->pages[0].complete, 0);
	assert_in_range(visible->counts[WANT_DRAWABLE], fixture->fit_count / 8 * 7,
			fixture->fit_count);
	for (uint32_t i = 0; i < visible->counts[WANT_DRAWABLE]; i++)
		assert_int_equal(want_of(fixture, 0, i)->state, WANT_DRAWABLE);
	/* They were told, each once, and are told again with the next set. */
	assert_int_equal(visible_take_refusals(visible, refusals, WANTS_MAX), 0);
	take(fixture, 0, 0, fixture->fit_count + 50, true);
	count = visible_take_refusals(visible, refusals, WANTS_MAX);
	assert_int_equal(count, visible->counts[WANT_REFUSED]);
	for (uint32_t i = 0; i < count; i++)
		assert_int_equal(refusals[i].reason, WIRE_REASON_FULL);
	settle(fixture, visible);
}

static void what_was_refused_comes_when_another_session_lets_go(void **state)
{
	struct fixture *fixture = *state;
	struct visible *visible = &fixture->visible[1];

	take(fixture, 0, 0, fixture->fit_count / 2, true);
	settle(fixture, &fixture->visible[0]);
	take(fixture, 1, 200, fixture->fit_count - 8, true);
	settle(fixture, visible);
	assert_true(visible->counts[WANT_REFUSED] > 0);
	assert_int_equal(want_of(fixture, 1, 200)->state, WANT_DRAWABLE);
	take(fixture, 0, 0, 0, true);
	visible_retry(visible);
	settle(fixture, visible);
	assert_int_equal(visible->counts[WANT_REFUSED], 0);
	assert_int_equal(fixture->pages[1].complete, visible->serial);
}

static void what_another_session_holds_is_never_taken(void **state)
{
	struct fixture *fixture = *state;

	/* Somewhat less than its share: segments have ends that are too short. */
	take(fixture, 0, 0, fixture->fit_count / 5 * 2, true);
	settle(fixture, &fixture->visible[0]);
	take(fixture, 1, 100, fixture->fit_count * 2, true);
	settle(fixture, &fixture->visible[1]);
	for (uint32_t i = 0; i < fixture->fit_count / 5 * 2; i++) {
		assert_true(is_granted(fixture, 0, i));
		assert_int_equal(state_of(fixture, i), NODE_HELD);
	}
}

static void what_matters_more_revokes_a_hold_of_the_same_session(void **state)
{
	struct fixture *fixture = *state;
	struct visible *visible = &fixture->visible[0];
	uint32_t fits;

	take(fixture, 0, 50, fixture->fit_count + 20, true);
	settle(fixture, visible);
	fits = visible->counts[WANT_DRAWABLE];
	/* Ten nodes before all others: the last ten that were drawable have to go. */
	take(fixture, 0, 40, fits + 10, true);
	assert_false(is_granted(fixture, 0, 40 + fits + 9));
	assert_int_equal(want_of(fixture, 0, 40 + fits + 9)->state, WANT_REFUSED);
	/* But not before the client can have seen it: a set sent before that retires nothing of it. */
	take(fixture, 0, 40, fits + 10, true);
	visible_retire(visible, visible->serial);
	assert_int_equal(state_of(fixture, 40 + fits + 9), NODE_HELD);
	settle(fixture, visible);
	assert_true(visible_wants_quiet(visible));
	visible_note_quiet(visible);
	visible_retire(visible, visible->serial);
	assert_int_equal(state_of(fixture, 40 + fits + 9), NODE_HELD);
	take(fixture, 0, 40, fits + 10, true);
	settle(fixture, visible);
	settle_all(fixture);
	for (uint32_t i = 40; i < 50; i++)
		assert_int_equal(want_of(fixture, 0, i)->state, WANT_DRAWABLE);
	assert_int_not_equal(state_of(fixture, 40 + fits + 9), NODE_HELD);
}

static void an_answer_counts_for_what_was_revoked_before_it_whatever_is_revoked_since(void **state)
{
	struct fixture *fixture = *state;
	struct visible *visible = &fixture->visible[0];
	uint32_t first_count;
	uint32_t both_count;

	take(fixture, 0, 100, fixture->fit_count, true);
	settle_all(fixture);
	take(fixture, 2, 400, fixture->fit_count / 4, true);
	first_count = visible->revoked_count;
	assert_true(first_count > 0);
	visible_note_quiet(visible);
	take(fixture, 2, 400, fixture->fit_count / 2, true);
	both_count = visible->revoked_count;
	assert_true(both_count > first_count);
	say_again(fixture, 0);
	assert_int_equal(visible->revoked_count, both_count - first_count);
	/* Retired by a message it is the same. */
	visible_note_quiet(visible);
	visible_retire(visible, visible->serial);
	assert_int_equal(visible->revoked_count, both_count - first_count);
	visible_retire(visible, visible->serial + 1);
	assert_int_equal(visible->revoked_count, 0);
	books_check(fixture);
}

static void who_was_refused_once_is_not_waited_for(void **state)
{
	struct fixture *fixture = *state;
	struct visible *visible = &fixture->visible[0];
	struct wire_refusal refusals[WANTS_MAX];

	take(fixture, 2, 400, fixture->fit_count, true);
	settle_all(fixture);
	take(fixture, 0, 0, fixture->fit_count * 3 / 4, true);
	settle_all(fixture);
	assert_true(visible->counts[WANT_REFUSED] > 0);
	/* Said again, told again, and admitted after that: on its way, for nobody who waits. */
	say_again(fixture, 0);
	assert_true(fixture->pages[0].settled < visible->serial);
	(void)visible_take_refusals(visible, refusals, WANTS_MAX);
	take(fixture, 2, 0, 0, true);
	division_settle(&fixture->room);
	assert_true(visible_missing_count(visible) > 0);
	visible_settle(visible);
	assert_int_equal(fixture->pages[0].settled, visible->serial);
	assert_true(fixture->pages[0].complete < visible->serial);
	settle_all(fixture);
	assert_int_equal(fixture->pages[0].complete, visible->serial);
}

/* ---- more is wanted than fits ---- */

/* How many nodes from `first` on a session draws before the first that it does not. */
static uint32_t drawn_from(const struct fixture *fixture, uint32_t session, uint32_t first)
{
	uint32_t count = 0;

	while (is_granted(fixture, session, first + count) &&
	       node_is_ready(&fixture->served->nodes[fixture->nodes[first + count]]))
		count++;
	return count;
}

/*
 * Parts of what fits: a tenth less for what is too short at segments' ends, and a sixteenth of the cache
 * more or less for what stays with those who have it.
 */
static void assert_share(const struct fixture *fixture, uint32_t count, double share)
{
	double kept = fixture->fit_count / 16.0;
	double fair = share * fixture->fit_count;

	assert_in_range(count, (uint32_t)(0.9 * 15.0 / 16.0 * fair), (uint32_t)(fair + kept) + 2);
}

static void sessions_share_by_account_then_equally(void **state)
{
	struct fixture *fixture = *state;
	uint32_t fit = fixture->fit_count;

	take(fixture, 0, 0, fit, true);
	take(fixture, 1, 200, fit, true);
	take(fixture, 2, 400, fit, true);
	settle_all(fixture);
	assert_share(fixture, drawn_from(fixture, 0, 0), 0.25);
	assert_share(fixture, drawn_from(fixture, 1, 200), 0.25);
	assert_share(fixture, drawn_from(fixture, 2, 400), 0.5);
	/* And by the policies of a new configuration. */
	fixture->accounts[0].policy.weight = 400;
	room_note_change(&fixture->room);
	settle_all(fixture);
	assert_share(fixture, drawn_from(fixture, 0, 0), 0.4);
	assert_share(fixture, drawn_from(fixture, 2, 400), 0.2);
	fixture->accounts[1].policy.share_permille = 700;
	room_note_change(&fixture->room);
	settle_all(fixture);
	assert_share(fixture, drawn_from(fixture, 1, 200), 0.15);
	assert_share(fixture, drawn_from(fixture, 2, 400), 0.7);
}

static void what_nobody_claims_is_used_and_taken_back(void **state)
{
	struct fixture *fixture = *state;
	uint32_t fit = fixture->fit_count;

	take(fixture, 2, 400, fit / 10, true);
	take(fixture, 0, 0, fit * 2, true);
	settle_all(fixture);
	assert_int_equal(drawn_from(fixture, 2, 400), fit / 10);
	assert_share(fixture, drawn_from(fixture, 0, 0), 0.9);
	/* Somebody below its share wants it: it comes from the end of the other's set. */
	take(fixture, 2, 400, fit, true);
	settle_all(fixture);
	assert_share(fixture, drawn_from(fixture, 0, 0), 0.5);
	assert_share(fixture, drawn_from(fixture, 2, 400), 0.5);
	/* And goes back when it is gone. */
	take(fixture, 2, 0, 0, true);
	settle_all(fixture);
	assert_share(fixture, drawn_from(fixture, 0, 0), 1.0);
}

static void what_several_want_takes_its_room_once(void **state)
{
	struct fixture *fixture = *state;
	uint32_t fit = fixture->fit_count;

	for (uint32_t i = 0; i < 3; i++)
		take(fixture, i, 0, fit / 2, true);
	take(fixture, 3, 400, fit / 3, true);
	settle_all(fixture);
	for (uint32_t i = 0; i < 3; i++)
		assert_int_equal(drawn_from(fixture, i, 0), fit / 2);
	assert_int_equal(drawn_from(fixture, 3, 400), fit / 3);
	assert_int_equal(fixture->served->counters.fetches, fit / 2 + fit / 3);
	/* What the three share leaves room for more of another's own. */
	take(fixture, 3, 400, fit, true);
	settle_all(fixture);
	for (uint32_t i = 0; i < 3; i++)
		assert_int_equal(drawn_from(fixture, i, 0), fit / 2);
	assert_share(fixture, drawn_from(fixture, 3, 400), 0.5);
}

/* Two sets of one user with the same nodes, the one from the front and the other from the back. */
static void naming_what_ones_other_sets_name_takes_nothing_from_another_user(void **state)
{
	struct fixture *fixture = *state;
	struct wire_entry entries[WANTS_MAX] = { 0 };
	uint32_t fit = fixture->fit_count;

	for (uint32_t i = 0; i < fit; i++)
		entries[i] =
			(struct wire_entry){ 0, fixture->nodes[fit - 1 - i], (float)(fit - i) };
	assert_int_equal(visible_take(&fixture->visible[1], entries, fit,
				      fixture->visible[1].serial + 1, true),
			 0);
	take(fixture, 0, 0, fit, true);
	take(fixture, 2, 400, fit, true);
	settle_all(fixture);
	assert_share(fixture, drawn_from(fixture, 2, 400), 0.5);
}

static void a_set_that_fits_into_what_is_left_waits_for_no_division(void **state)
{
	struct fixture *fixture = *state;
	struct visible *visible = &fixture->visible[2];
	struct wire_entry entries[WANTS_MAX] = { 0 };
	uint32_t fit = fixture->fit_count;
	uint32_t count = fit / 4;

	take(fixture, 0, 0, fit * 2, true);
	take(fixture, 2, 400, count, true);
	settle_all(fixture);
	assert_true(fixture->room.divided);
	/* Half of it is drawn by another, half was its own. */
	for (uint32_t i = 0; i < count; i++)
		entries[i] = (struct wire_entry){ 0, fixture->nodes[i < count / 2 ? i : 400 + i],
						  (float)(count - i) };
	assert_int_equal(visible_take(visible, entries, count, visible->serial + 1, true), 0);
	assert_false(visible->undecided);
	for (uint32_t i = 0; i < count; i++)
		assert_int_equal(visible->wants[i].state, WANT_DRAWABLE);
	visible_settle(visible);
	assert_int_equal(fixture->pages[2].settled, visible->serial);
	books_check(fixture);
	/* Others take the room of what it lets go. */
	for (uint32_t i = 0; i < count; i++)
		entries[i] = (struct wire_entry){ 0, fixture->nodes[i < count / 2 ? i : 300 + i],
						  (float)(count - i) };
	assert_int_equal(visible_take(visible, entries, count, visible->serial + 1, true), 0);
	assert_false(visible->undecided);
	/* What does not fit waits, whole: what of it comes is for the division to say. */
	for (uint32_t i = 0; i < 2 * fit; i++)
		entries[i] =
			(struct wire_entry){ 0, fixture->nodes[200 + i], (float)(2 * fit - i) };
	assert_int_equal(visible_take(visible, entries, 2 * fit, visible->serial + 1, true), 0);
	assert_true(visible->undecided);
	settle_all(fixture);
	assert_share(fixture, drawn_from(fixture, 2, 200), 0.5);
}

static void a_hit_does_not_keep_out_what_matters_more(void **state)
{
	struct fixture *fixture = *state;
	struct visible *visible = &fixture->visible[0];
	struct wire_entry entries[WANTS_MAX] = { 0 };
	uint32_t fit = fixture->fit_count;

	/* The less important half is there and held at once; the set is never said anew by itself. */
	take(fixture, 0, 0, fit, true);
	settle_all(fixture);
	for (uint32_t i = 0; i < 2 * fit; i++)
		entries[i] = (struct wire_entry){ 0, fixture->nodes[i < fit ? 200 + i : i - fit],
						  (float)(2 * fit - i) };
	assert_int_equal(visible_take(visible, entries, 2 * fit, visible->serial + 1, true), 0);
	settle_all(fixture);
	assert_share(fixture, drawn_from(fixture, 0, 200), 1.0);
}

static void what_has_settled_stays_settled(void **state)
{
	struct fixture *fixture = *state;
	unsigned seed = 23;

	for (uint32_t step = 0; step < 30; step++) {
		uint64_t fetches;

		for (uint32_t i = 0; i < SESSION_COUNT; i++)
			take(fixture, i, (uint32_t)rand_r(&seed) % 250,
			     fixture->fit_count / 2 + (uint32_t)rand_r(&seed) % 200,
			     rand_r(&seed) % 3);
		settle_all(fixture);
		for (uint32_t i = 0; i < SESSION_COUNT; i++)
			visible_retire(&fixture->visible[i], fixture->visible[i].serial);
		settle_all(fixture);
		fetches = fixture->served->counters.fetches;
		/* What is said again changes nothing: nothing is read, nobody gives way. */
		for (uint32_t round = 0; round < 3; round++)
			for (uint32_t i = 0; i < SESSION_COUNT; i++) {
				say_again(fixture, i);
				settle(fixture, &fixture->visible[i]);
				assert_int_equal(fixture->room.leaving_count, 0);
			}
		assert_int_equal(fixture->served->counters.fetches, fetches);
		assert_true(fixture->room.divided);
		assert_true(fixture->cache.pinned_bytes * 10 > BUDGET_BYTES * UINT64_C(8));
	}
}

static void closing_a_store_gives_everything_back(void **state)
{
	struct fixture *fixture = *state;
	struct visible *visible = &fixture->visible[0];
	struct why why;

	assert_int_equal(visible_attach(visible, 7, fixture->served, 1, &why), 0);
	take(fixture, 0, 0, 10, false);
	settle(fixture, visible);
	take(fixture, 0, 20, 10, false);
	begin_fetches(fixture, visible);
	visible_detach(visible, 0);
	assert_int_equal(visible->held_count, 0);
	assert_int_equal(visible->total, 0);
	while (fills_count(fixture->fills) > 0)
		run_once(fixture);
	assert_int_equal(fixture->cache.pinned_bytes, 0);
	assert_int_equal(visible_attach(visible, 0, fixture->served, 1, &why), 0);
}

static void unreadable_nodes_are_refused_and_read_when_they_are_wanted_anew(void **state)
{
	struct fixture *fixture = *state;
	struct visible *visible = &fixture->visible[0];
	uint32_t failed;

	take(fixture, 0, 0, 60, true);
	settle(fixture, visible);
	failed = visible->counts[WANT_REFUSED];
	assert_in_range(failed, 1, 59);
	assert_int_equal(fixture->served->counters.errors, failed);
	for (uint32_t i = 0; i < 60; i++)
		if (want_of(fixture, 0, i)->state == WANT_REFUSED) {
			assert_int_equal(want_of(fixture, 0, i)->reason, WIRE_REASON_UNREADABLE);
			assert_int_equal(state_of(fixture, i), NODE_ABSENT);
		}
	/* The same set again does not hammer the device. */
	take(fixture, 0, 0, 60, true);
	assert_int_equal(visible->counts[WANT_QUEUED], 0);
	take(fixture, 0, 0, 0, true);
	take(fixture, 0, 0, 60, true);
	assert_int_equal(visible->counts[WANT_QUEUED], failed);
	settle(fixture, visible);
	assert_true(visible->counts[WANT_REFUSED] < failed);
}

static void damaged_nodes_are_refused_to_everybody_and_the_rest_is_served(void **state)
{
	struct fixture *fixture = *state;
	uint32_t damaged;
	uint64_t fetches;

	take(fixture, 0, 0, 60, true);
	settle(fixture, &fixture->visible[0]);
	damaged = fixture->visible[0].counts[WANT_REFUSED];
	assert_in_range(damaged, 1, 59);
	fetches = fixture->served->counters.fetches;
	take(fixture, 1, 0, 60, true);
	assert_int_equal(fixture->visible[1].counts[WANT_REFUSED], damaged);
	assert_int_equal(fixture->visible[1].counts[WANT_DRAWABLE], 60 - damaged);
	settle(fixture, &fixture->visible[1]);
	/* They are not read again. */
	assert_int_equal(fixture->served->counters.fetches, fetches);
}

static void sets_at_random_keep_the_books(void **state)
{
	struct fixture *fixture = *state;
	unsigned seed = 17;

	for (uint32_t step = 0; step < 1500; step++) {
		uint32_t session = (uint32_t)rand_r(&seed) % SESSION_COUNT;
		struct visible *visible = &fixture->visible[session];
		uint32_t first = (uint32_t)rand_r(&seed) % 300;
		uint32_t count = (uint32_t)rand_r(&seed) % 200;

		switch (rand_r(&seed) % 6) {
		case 0:
			take(fixture, session, first, count, true);
			break;
		case 1:
			take(fixture, session, first, count, false);
			break;
		case 2:
			if (visible->serial > 0)
				visible_retire(visible,
					       visible->serial - (uint32_t)rand_r(&seed) % 2);
			break;
		case 3:
			visible_retry(visible);
			visible_note_quiet(visible);
			break;
		default:
			begin_fetches(fixture, visible);
			run_once(fixture);
			break;
		}
		visible_settle(visible);
		books_check(fixture);
	}
	for (uint32_t i = 0; i < SESSION_COUNT; i++)
		settle(fixture, &fixture->visible[i]);
}

int main(void)
{
#define VISIBLE_TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)
	const struct CMUnitTest tests[] = {
		VISIBLE_TEST(a_set_becomes_drawable_and_complete),
		cmocka_unit_test_setup_teardown(a_set_becomes_drawable_and_complete, setup_coded,
						teardown),
		VISIBLE_TEST(a_few_payloads_are_verified_without_a_worker_and_coded_ones_with),
		cmocka_unit_test_setup_teardown(
			a_few_payloads_are_verified_without_a_worker_and_coded_ones_with,
			setup_coded, teardown),
		VISIBLE_TEST(a_hit_is_granted_at_once_and_overtakes_misses),
		VISIBLE_TEST(two_sessions_share_one_read),
		VISIBLE_TEST(what_a_set_drops_is_given_back_with_the_retire_flag),
		VISIBLE_TEST(what_a_set_drops_stays_drawable_until_it_is_retired),
		VISIBLE_TEST(what_comes_back_before_it_is_retired_has_never_been_away),
		VISIBLE_TEST(a_node_named_twice_counts_once),
		VISIBLE_TEST(a_set_of_what_is_no_node_is_refused_and_changes_nothing),
		VISIBLE_TEST(what_does_not_fit_is_refused_from_the_end_of_the_set),
		VISIBLE_TEST(what_was_refused_comes_when_another_session_lets_go),
		VISIBLE_TEST(what_another_session_holds_is_never_taken),
		VISIBLE_TEST(what_matters_more_revokes_a_hold_of_the_same_session),
		VISIBLE_TEST(sessions_share_by_account_then_equally),
		VISIBLE_TEST(what_nobody_claims_is_used_and_taken_back),
		VISIBLE_TEST(what_several_want_takes_its_room_once),
		VISIBLE_TEST(naming_what_ones_other_sets_name_takes_nothing_from_another_user),
		VISIBLE_TEST(a_set_that_fits_into_what_is_left_waits_for_no_division),
		VISIBLE_TEST(
			an_answer_counts_for_what_was_revoked_before_it_whatever_is_revoked_since),
		VISIBLE_TEST(who_was_refused_once_is_not_waited_for),
		VISIBLE_TEST(a_hit_does_not_keep_out_what_matters_more),
		VISIBLE_TEST(what_has_settled_stays_settled),
		VISIBLE_TEST(closing_a_store_gives_everything_back),
		cmocka_unit_test_setup_teardown(
			unreadable_nodes_are_refused_and_read_when_they_are_wanted_anew,
			setup_failing, teardown),
		cmocka_unit_test_setup_teardown(
			damaged_nodes_are_refused_to_everybody_and_the_rest_is_served,
			setup_corrupting, teardown),
		VISIBLE_TEST(sets_at_random_keep_the_books),
		cmocka_unit_test_setup_teardown(sets_at_random_keep_the_books, setup_coded,
						teardown),
	};

	/* Damaged nodes are logged, which is not what is looked at here. */
	log_init("test_visible", LOG_LEVEL_ERROR - 1);
	return TEST_RUN(tests);
}
