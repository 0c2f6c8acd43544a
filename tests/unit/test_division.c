/* SPDX-License-Identifier: MIT */
/* Goal: where more is wanted than fits, who has what is as division.h says, and others are told and let go. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdbool.h>
#include <stdlib.h>

#include "daemon/sharing/division.h"
#include "tests/unit/visible_kit.h"

static void what_does_not_fit_is_refused_from_the_end_of_the_set(void **state)
{
	struct kit *kit = *state;
	struct visible *visible = &kit->visible[0];
	struct wire_refusal refusals[WANTS_MAX];
	uint32_t count;

	kit_take(kit, 0, 0, kit->fit_count + 50, true);
	kit_settle(kit, visible);
	assert_int_equal(kit->pages[0].settled, visible->serial);
	assert_int_equal(kit->pages[0].complete, 0);
	assert_in_range(visible->counts[WANT_DRAWABLE], kit->fit_count / 8 * 7, kit->fit_count);
	for (uint32_t i = 0; i < visible->counts[WANT_DRAWABLE]; i++)
		assert_int_equal(kit_want_of(kit, 0, i)->state, WANT_DRAWABLE);
	/* They were told, each once, and are told again with the next set. */
	assert_int_equal(visible_take_refusals(visible, refusals, WANTS_MAX), 0);
	kit_take(kit, 0, 0, kit->fit_count + 50, true);
	count = visible_take_refusals(visible, refusals, WANTS_MAX);
	assert_int_equal(count, visible->counts[WANT_REFUSED]);
	for (uint32_t i = 0; i < count; i++)
		assert_int_equal(refusals[i].reason, WIRE_REASON_FULL);
	kit_settle(kit, visible);
}

static void what_was_refused_comes_when_another_session_lets_go(void **state)
{
	struct kit *kit = *state;
	struct visible *visible = &kit->visible[1];

	kit_take(kit, 0, 0, kit->fit_count / 2, true);
	kit_settle(kit, &kit->visible[0]);
	kit_take(kit, 1, 200, kit->fit_count - 8, true);
	kit_settle(kit, visible);
	assert_true(visible->counts[WANT_REFUSED] > 0);
	assert_int_equal(kit_want_of(kit, 1, 200)->state, WANT_DRAWABLE);
	kit_take(kit, 0, 0, 0, true);
	visible_retry(visible);
	kit_settle(kit, visible);
	assert_int_equal(visible->counts[WANT_REFUSED], 0);
	assert_int_equal(kit->pages[1].complete, visible->serial);
}

static void what_another_session_holds_is_never_taken(void **state)
{
	struct kit *kit = *state;

	/* Somewhat less than its share: segments have ends that are too short. */
	kit_take(kit, 0, 0, kit->fit_count / 5 * 2, true);
	kit_settle(kit, &kit->visible[0]);
	kit_take(kit, 1, 100, kit->fit_count * 2, true);
	kit_settle(kit, &kit->visible[1]);
	for (uint32_t i = 0; i < kit->fit_count / 5 * 2; i++) {
		assert_true(kit_is_granted(kit, 0, i));
		assert_int_equal(kit_state_of(kit, i), NODE_HELD);
	}
}

static void what_matters_more_revokes_a_hold_of_the_same_session(void **state)
{
	struct kit *kit = *state;
	struct visible *visible = &kit->visible[0];
	uint32_t fits;

	kit_take(kit, 0, 50, kit->fit_count + 20, true);
	kit_settle(kit, visible);
	fits = visible->counts[WANT_DRAWABLE];
	/* Ten nodes before all others: the last ten that were drawable have to go. */
	kit_take(kit, 0, 40, fits + 10, true);
	assert_false(kit_is_granted(kit, 0, 40 + fits + 9));
	assert_int_equal(kit_want_of(kit, 0, 40 + fits + 9)->state, WANT_REFUSED);
	/* But not before the client can have seen it: a set sent before that retires nothing of it. */
	kit_take(kit, 0, 40, fits + 10, true);
	visible_retire(visible, visible->serial);
	assert_int_equal(kit_state_of(kit, 40 + fits + 9), NODE_HELD);
	kit_settle(kit, visible);
	assert_true(visible_wants_quiet(visible));
	visible_note_quiet(visible);
	visible_retire(visible, visible->serial);
	assert_int_equal(kit_state_of(kit, 40 + fits + 9), NODE_HELD);
	kit_take(kit, 0, 40, fits + 10, true);
	kit_settle(kit, visible);
	kit_settle_all(kit);
	for (uint32_t i = 40; i < 50; i++)
		assert_int_equal(kit_want_of(kit, 0, i)->state, WANT_DRAWABLE);
	assert_int_not_equal(kit_state_of(kit, 40 + fits + 9), NODE_HELD);
}

static void an_answer_counts_for_what_was_revoked_before_it_whatever_is_revoked_since(void **state)
{
	struct kit *kit = *state;
	struct visible *visible = &kit->visible[0];
	uint32_t first_count;
	uint32_t both_count;

	kit_take(kit, 0, 100, kit->fit_count, true);
	kit_settle_all(kit);
	kit_take(kit, 2, 400, kit->fit_count / 4, true);
	first_count = visible->revoked_count;
	assert_true(first_count > 0);
	visible_note_quiet(visible);
	kit_take(kit, 2, 400, kit->fit_count / 2, true);
	both_count = visible->revoked_count;
	assert_true(both_count > first_count);
	kit_say_again(kit, 0);
	assert_int_equal(visible->revoked_count, both_count - first_count);
	/* Retired by a message it is the same. */
	visible_note_quiet(visible);
	visible_retire(visible, visible->serial);
	assert_int_equal(visible->revoked_count, both_count - first_count);
	visible_retire(visible, visible->serial + 1);
	assert_int_equal(visible->revoked_count, 0);
	kit_books_check(kit);
}

static void who_was_refused_once_is_not_waited_for(void **state)
{
	struct kit *kit = *state;
	struct visible *visible = &kit->visible[0];
	struct wire_refusal refusals[WANTS_MAX];

	kit_take(kit, 2, 400, kit->fit_count, true);
	kit_settle_all(kit);
	kit_take(kit, 0, 0, kit->fit_count * 3 / 4, true);
	kit_settle_all(kit);
	assert_true(visible->counts[WANT_REFUSED] > 0);
	/* Said again, told again, and admitted after that: on its way, for nobody who waits. */
	kit_say_again(kit, 0);
	assert_true(kit->pages[0].settled < visible->serial);
	(void)visible_take_refusals(visible, refusals, WANTS_MAX);
	kit_take(kit, 2, 0, 0, true);
	division_settle(&kit->room);
	assert_true(visible_missing_count(visible) > 0);
	visible_settle(visible);
	assert_int_equal(kit->pages[0].settled, visible->serial);
	assert_true(kit->pages[0].complete < visible->serial);
	kit_settle_all(kit);
	assert_int_equal(kit->pages[0].complete, visible->serial);
}

/* How many nodes from `first` on a session draws before the first that it does not. */
static uint32_t drawn_from(const struct kit *kit, uint32_t session, uint32_t first)
{
	uint32_t count = 0;

	while (kit_is_granted(kit, session, first + count) &&
	       node_is_ready(&kit->parts.served->nodes[kit->parts.nodes[first + count]]))
		count++;
	return count;
}

/*
 * Parts of what fits: a tenth less for what is too short at segments' ends, and a sixteenth of the cache
 * more or less for what stays with those who have it.
 */
static void assert_share(const struct kit *kit, uint32_t count, double share)
{
	double kept = kit->fit_count / 16.0;
	double fair = share * kit->fit_count;

	assert_in_range(count, (uint32_t)(0.9 * 15.0 / 16.0 * fair), (uint32_t)(fair + kept) + 2);
}

static void sessions_share_by_account_then_equally(void **state)
{
	struct kit *kit = *state;
	uint32_t fit = kit->fit_count;

	kit_take(kit, 0, 0, fit, true);
	kit_take(kit, 1, 200, fit, true);
	kit_take(kit, 2, 400, fit, true);
	kit_settle_all(kit);
	assert_share(kit, drawn_from(kit, 0, 0), 0.25);
	assert_share(kit, drawn_from(kit, 1, 200), 0.25);
	assert_share(kit, drawn_from(kit, 2, 400), 0.5);
	/* And by the policies of a new configuration. */
	kit->accounts[0].policy.weight = 400;
	room_note_change(&kit->room);
	kit_settle_all(kit);
	assert_share(kit, drawn_from(kit, 0, 0), 0.4);
	assert_share(kit, drawn_from(kit, 2, 400), 0.2);
	kit->accounts[1].policy.share_permille = 700;
	room_note_change(&kit->room);
	kit_settle_all(kit);
	assert_share(kit, drawn_from(kit, 1, 200), 0.15);
	assert_share(kit, drawn_from(kit, 2, 400), 0.7);
}

static void what_nobody_claims_is_used_and_taken_back(void **state)
{
	struct kit *kit = *state;
	uint32_t fit = kit->fit_count;

	kit_take(kit, 2, 400, fit / 10, true);
	kit_take(kit, 0, 0, fit * 2, true);
	kit_settle_all(kit);
	assert_int_equal(drawn_from(kit, 2, 400), fit / 10);
	assert_share(kit, drawn_from(kit, 0, 0), 0.9);
	/* Somebody below its share wants it: it comes from the end of the other's set. */
	kit_take(kit, 2, 400, fit, true);
	kit_settle_all(kit);
	assert_share(kit, drawn_from(kit, 0, 0), 0.5);
	assert_share(kit, drawn_from(kit, 2, 400), 0.5);
	/* And goes back when it is gone. */
	kit_take(kit, 2, 0, 0, true);
	kit_settle_all(kit);
	assert_share(kit, drawn_from(kit, 0, 0), 1.0);
}

static void what_several_want_takes_its_room_once(void **state)
{
	struct kit *kit = *state;
	uint32_t fit = kit->fit_count;

	for (uint32_t i = 0; i < 3; i++)
		kit_take(kit, i, 0, fit / 2, true);
	kit_take(kit, 3, 400, fit / 3, true);
	kit_settle_all(kit);
	for (uint32_t i = 0; i < 3; i++)
		assert_int_equal(drawn_from(kit, i, 0), fit / 2);
	assert_int_equal(drawn_from(kit, 3, 400), fit / 3);
	assert_int_equal(kit->parts.served->counters.fetches, fit / 2 + fit / 3);
	/* What the three share leaves room for more of another's own. */
	kit_take(kit, 3, 400, fit, true);
	kit_settle_all(kit);
	for (uint32_t i = 0; i < 3; i++)
		assert_int_equal(drawn_from(kit, i, 0), fit / 2);
	assert_share(kit, drawn_from(kit, 3, 400), 0.5);
}

/* Two sets of one user with the same nodes, the one from the front and the other from the back. */
static void naming_what_ones_other_sets_name_takes_nothing_from_another_user(void **state)
{
	struct kit *kit = *state;
	struct wire_entry entries[WANTS_MAX] = { 0 };
	uint32_t fit = kit->fit_count;

	for (uint32_t i = 0; i < fit; i++)
		entries[i] =
			(struct wire_entry){ 0, kit->parts.nodes[fit - 1 - i], (float)(fit - i) };
	assert_int_equal(
		visible_take(&kit->visible[1], entries, fit, kit->visible[1].serial + 1, true), 0);
	kit_take(kit, 0, 0, fit, true);
	kit_take(kit, 2, 400, fit, true);
	kit_settle_all(kit);
	assert_share(kit, drawn_from(kit, 2, 400), 0.5);
}

static void a_set_that_fits_into_what_is_left_waits_for_no_division(void **state)
{
	struct kit *kit = *state;
	struct visible *visible = &kit->visible[2];
	struct wire_entry entries[WANTS_MAX] = { 0 };
	uint32_t fit = kit->fit_count;
	uint32_t count = fit / 4;

	kit_take(kit, 0, 0, fit * 2, true);
	kit_take(kit, 2, 400, count, true);
	kit_settle_all(kit);
	assert_true(kit->room.divided);
	/* Half of it is drawn by another, half was its own. */
	for (uint32_t i = 0; i < count; i++)
		entries[i] = (struct wire_entry){ 0, kit->parts.nodes[i < count / 2 ? i : 400 + i],
						  (float)(count - i) };
	assert_int_equal(visible_take(visible, entries, count, visible->serial + 1, true), 0);
	assert_false(visible->undecided);
	for (uint32_t i = 0; i < count; i++)
		assert_int_equal(visible->wants[i].state, WANT_DRAWABLE);
	visible_settle(visible);
	assert_int_equal(kit->pages[2].settled, visible->serial);
	kit_books_check(kit);
	/* Others take the room of what it lets go. */
	for (uint32_t i = 0; i < count; i++)
		entries[i] = (struct wire_entry){ 0, kit->parts.nodes[i < count / 2 ? i : 300 + i],
						  (float)(count - i) };
	assert_int_equal(visible_take(visible, entries, count, visible->serial + 1, true), 0);
	assert_false(visible->undecided);
	/* What does not fit waits, whole: what of it comes is for the division to say. */
	for (uint32_t i = 0; i < 2 * fit; i++)
		entries[i] =
			(struct wire_entry){ 0, kit->parts.nodes[200 + i], (float)(2 * fit - i) };
	assert_int_equal(visible_take(visible, entries, 2 * fit, visible->serial + 1, true), 0);
	assert_true(visible->undecided);
	kit_settle_all(kit);
	assert_share(kit, drawn_from(kit, 2, 200), 0.5);
}

static void a_hit_does_not_keep_out_what_matters_more(void **state)
{
	struct kit *kit = *state;
	struct visible *visible = &kit->visible[0];
	struct wire_entry entries[WANTS_MAX] = { 0 };
	uint32_t fit = kit->fit_count;

	/* The less important half is there and held at once; the set is never said anew by itself. */
	kit_take(kit, 0, 0, fit, true);
	kit_settle_all(kit);
	for (uint32_t i = 0; i < 2 * fit; i++)
		entries[i] = (struct wire_entry){ 0, kit->parts.nodes[i < fit ? 200 + i : i - fit],
						  (float)(2 * fit - i) };
	assert_int_equal(visible_take(visible, entries, 2 * fit, visible->serial + 1, true), 0);
	kit_settle_all(kit);
	assert_share(kit, drawn_from(kit, 0, 200), 1.0);
}

static void what_has_settled_stays_settled(void **state)
{
	struct kit *kit = *state;
	unsigned seed = 23;

	for (uint32_t step = 0; step < 30; step++) {
		uint64_t fetches;

		for (uint32_t i = 0; i < SESSION_COUNT; i++)
			kit_take(kit, i, (uint32_t)rand_r(&seed) % 250,
				 kit->fit_count / 2 + (uint32_t)rand_r(&seed) % 200,
				 rand_r(&seed) % 3);
		kit_settle_all(kit);
		for (uint32_t i = 0; i < SESSION_COUNT; i++)
			visible_retire(&kit->visible[i], kit->visible[i].serial);
		kit_settle_all(kit);
		fetches = kit->parts.served->counters.fetches;
		/* What is said again changes nothing: nothing is read, nobody gives way. */
		for (uint32_t round = 0; round < 3; round++)
			for (uint32_t i = 0; i < SESSION_COUNT; i++) {
				kit_say_again(kit, i);
				kit_settle(kit, &kit->visible[i]);
				assert_int_equal(kit->room.leaving_count, 0);
			}
		assert_int_equal(kit->parts.served->counters.fetches, fetches);
		assert_true(kit->room.divided);
		assert_true(kit->parts.cache.pinned_bytes * 10 > BUDGET_BYTES * UINT64_C(8));
	}
}

int main(void)
{
#define KIT_TEST(name) cmocka_unit_test_setup_teardown(name, kit_setup, kit_teardown)
	const struct CMUnitTest tests[] = {
		KIT_TEST(what_does_not_fit_is_refused_from_the_end_of_the_set),
		KIT_TEST(what_was_refused_comes_when_another_session_lets_go),
		KIT_TEST(what_another_session_holds_is_never_taken),
		KIT_TEST(what_matters_more_revokes_a_hold_of_the_same_session),
		KIT_TEST(sessions_share_by_account_then_equally),
		KIT_TEST(what_nobody_claims_is_used_and_taken_back),
		KIT_TEST(what_several_want_takes_its_room_once),
		KIT_TEST(naming_what_ones_other_sets_name_takes_nothing_from_another_user),
		KIT_TEST(a_set_that_fits_into_what_is_left_waits_for_no_division),
		KIT_TEST(an_answer_counts_for_what_was_revoked_before_it_whatever_is_revoked_since),
		KIT_TEST(who_was_refused_once_is_not_waited_for),
		KIT_TEST(a_hit_does_not_keep_out_what_matters_more),
		KIT_TEST(what_has_settled_stays_settled),
	};

	return TEST_RUN(tests);
}
