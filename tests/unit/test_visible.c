/* SPDX-License-Identifier: MIT */
/* Goal: a session's set is taken over, answered and given back as visible.h says. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <stdbool.h>
#include <stdlib.h>

#include "formats/base/log.h"
#include "tests/unit/visible_kit.h"

static void a_set_becomes_drawable_and_complete(void **state)
{
	struct kit *kit = *state;
	struct visible *visible = &kit->visible[0];

	kit_take(kit, 0, 0, 20, true);
	assert_int_equal(visible->counts[WANT_QUEUED], 20);
	kit_settle(kit, visible);
	assert_int_equal(visible->counts[WANT_DRAWABLE], 20);
	assert_int_equal(kit->pages[0].settled, visible->serial);
	assert_int_equal(kit->pages[0].complete, visible->serial);
	assert_int_equal(kit->parts.served->counters.misses, 20);
	for (uint32_t i = 0; i < 20; i++)
		assert_true(kit_is_granted(kit, 0, i));
}

static void a_few_payloads_are_verified_without_a_worker_and_coded_ones_with(void **state)
{
	struct kit *kit = *state;
	bool is_coded = kit->parts.served->records[kit->parts.nodes[0]].codec != STORE_CODEC_NONE;

	kit_take(kit, 0, 0, 3, true);
	kit_settle(kit, &kit->visible[0]);
	assert_int_equal(visible_missing_count(&kit->visible[0]), 0);
	assert_int_equal(workers_ended_count(kit->parts.workers), is_coded ? 3 : 0);
}

static void a_hit_is_granted_at_once_and_overtakes_misses(void **state)
{
	struct kit *kit = *state;

	kit_take(kit, 0, 5, 1, true);
	kit_settle(kit, &kit->visible[0]);
	kit_take(kit, 1, 0, 10, true);
	assert_int_equal(kit_want_of(kit, 1, 5)->state, WANT_DRAWABLE);
	assert_true(kit_is_granted(kit, 1, 5));
	assert_int_equal(kit->visible[1].counts[WANT_QUEUED], 9);
	assert_int_equal(kit->parts.served->counters.hits, 1);
	kit_settle(kit, &kit->visible[1]);
}

static void two_sessions_share_one_read(void **state)
{
	struct kit *kit = *state;

	kit_take(kit, 0, 0, 30, true);
	kit_take(kit, 1, 0, 30, true);
	kit_begin_fetches(kit, &kit->visible[0]);
	kit_settle(kit, &kit->visible[0]);
	assert_int_equal(kit->visible[1].counts[WANT_DRAWABLE], 30);
	assert_int_equal(kit->parts.served->counters.fetches, 30);
	kit_settle(kit, &kit->visible[1]);
}

static void what_a_set_drops_is_given_back_with_the_retire_flag(void **state)
{
	struct kit *kit = *state;

	kit_take(kit, 0, 0, 10, true);
	kit_settle(kit, &kit->visible[0]);
	kit_take(kit, 0, 5, 10, true);
	assert_null(kit_want_of(kit, 0, 0));
	assert_false(kit_is_granted(kit, 0, 0));
	assert_int_equal(kit_state_of(kit, 0), NODE_FREE);
	assert_int_equal(kit_want_of(kit, 0, 5)->state, WANT_DRAWABLE);
	kit_settle(kit, &kit->visible[0]);
}

static void what_a_set_drops_stays_drawable_until_it_is_retired(void **state)
{
	struct kit *kit = *state;
	struct visible *visible = &kit->visible[0];

	kit_take(kit, 0, 0, 10, false);
	kit_settle(kit, visible);
	kit_take(kit, 0, 5, 10, false);
	kit_settle(kit, visible);
	assert_int_equal(kit_want_of(kit, 0, 0)->state, WANT_RETAINED);
	assert_true(kit_is_granted(kit, 0, 0));
	/* The set that dropped it is not the one before: an earlier retire changes nothing. */
	visible_retire(visible, 1);
	assert_int_equal(kit_state_of(kit, 0), NODE_HELD);
	visible_retire(visible, 2);
	assert_null(kit_want_of(kit, 0, 0));
	assert_int_equal(kit_state_of(kit, 0), NODE_FREE);
	assert_int_equal(visible->held_count, 10);
}

static void what_comes_back_before_it_is_retired_has_never_been_away(void **state)
{
	struct kit *kit = *state;
	struct visible *visible = &kit->visible[0];

	kit_take(kit, 0, 0, 10, false);
	kit_settle(kit, visible);
	kit_take(kit, 0, 20, 10, false);
	kit_take(kit, 0, 0, 10, false);
	assert_int_equal(visible->counts[WANT_DRAWABLE], 10);
	visible_retire(visible, visible->serial);
	kit_settle(kit, visible);
	assert_int_equal(visible->held_count, 10);
	/* Only what was never dropped is asked for anew. */
	assert_int_equal(kit->parts.served->counters.hits, 0);
}

static void a_node_named_twice_counts_once(void **state)
{
	struct kit *kit = *state;
	struct visible *visible = &kit->visible[0];
	struct wire_entry entries[] = {
		{ 0, kit->parts.nodes[3], 3.0f },
		{ 0, kit->parts.nodes[4], 2.0f },
		{ 0, kit->parts.nodes[3], 1.0f },
	};

	for (uint64_t serial = 1; serial <= 3; serial++) {
		assert_int_equal(visible_take(visible, entries, 3, serial, true), 0);
		assert_int_equal(visible->count, 2);
		kit_settle(kit, visible);
		assert_int_equal(visible->held_count, 2);
	}
}

static void a_set_of_what_is_no_node_is_refused_and_changes_nothing(void **state)
{
	struct kit *kit = *state;
	struct visible *visible = &kit->visible[0];
	struct wire_entry bad[] = {
		{ 1, kit->parts.nodes[0], 1.0f },
		{ 64, kit->parts.nodes[0], 1.0f },
		{ UINT32_MAX, kit->parts.nodes[0], 1.0f },
		{ 0, kit->parts.served->node_count, 1.0f },
		{ 0, UINT32_MAX, 1.0f },
		{ 0, 0, 1.0f }, /* the root has no payload */
	};

	kit_take(kit, 0, 0, 10, true);
	for (size_t i = 0; i < ARRAY_LENGTH(bad); i++) {
		assert_int_equal(visible_take(visible, &bad[i], 1, 2, true), -EPROTO);
		assert_int_equal(visible->serial, 1);
	}
	kit_settle(kit, visible);
	assert_int_equal(visible->counts[WANT_DRAWABLE], 10);
}

static void closing_a_store_gives_everything_back(void **state)
{
	struct kit *kit = *state;
	struct visible *visible = &kit->visible[0];
	struct why why;

	assert_int_equal(visible_attach(visible, 7, kit->parts.served, 1, &why), 0);
	kit_take(kit, 0, 0, 10, false);
	kit_settle(kit, visible);
	kit_take(kit, 0, 20, 10, false);
	kit_begin_fetches(kit, visible);
	visible_detach(visible, 0);
	assert_int_equal(visible->held_count, 0);
	assert_int_equal(visible->total, 0);
	while (fills_count(kit->parts.fills) > 0)
		kit_run_once(kit);
	assert_int_equal(kit->parts.cache.pinned_bytes, 0);
	assert_int_equal(visible_attach(visible, 0, kit->parts.served, 1, &why), 0);
}

static void unreadable_nodes_are_refused_and_read_when_they_are_wanted_anew(void **state)
{
	struct kit *kit = *state;
	struct visible *visible = &kit->visible[0];
	uint32_t failed;

	kit_take(kit, 0, 0, 60, true);
	kit_settle(kit, visible);
	failed = visible->counts[WANT_REFUSED];
	assert_in_range(failed, 1, 59);
	assert_int_equal(kit->parts.served->counters.errors, failed);
	for (uint32_t i = 0; i < 60; i++)
		if (kit_want_of(kit, 0, i)->state == WANT_REFUSED) {
			assert_int_equal(kit_want_of(kit, 0, i)->reason, WIRE_REASON_UNREADABLE);
			assert_int_equal(kit_state_of(kit, i), NODE_ABSENT);
		}
	/* The same set again does not hammer the device. */
	kit_take(kit, 0, 0, 60, true);
	assert_int_equal(visible->counts[WANT_QUEUED], 0);
	kit_take(kit, 0, 0, 0, true);
	kit_take(kit, 0, 0, 60, true);
	assert_int_equal(visible->counts[WANT_QUEUED], failed);
	kit_settle(kit, visible);
	assert_true(visible->counts[WANT_REFUSED] < failed);
}

static void damaged_nodes_are_refused_to_everybody_and_the_rest_is_served(void **state)
{
	struct kit *kit = *state;
	uint32_t damaged;
	uint64_t fetches;

	kit_take(kit, 0, 0, 60, true);
	kit_settle(kit, &kit->visible[0]);
	damaged = kit->visible[0].counts[WANT_REFUSED];
	assert_in_range(damaged, 1, 59);
	fetches = kit->parts.served->counters.fetches;
	kit_take(kit, 1, 0, 60, true);
	assert_int_equal(kit->visible[1].counts[WANT_REFUSED], damaged);
	assert_int_equal(kit->visible[1].counts[WANT_DRAWABLE], 60 - damaged);
	kit_settle(kit, &kit->visible[1]);
	/* They are not read again. */
	assert_int_equal(kit->parts.served->counters.fetches, fetches);
}

static void sets_at_random_keep_the_books(void **state)
{
	struct kit *kit = *state;
	unsigned seed = 17;

	for (uint32_t step = 0; step < 1500; step++) {
		uint32_t session = (uint32_t)rand_r(&seed) % SESSION_COUNT;
		struct visible *visible = &kit->visible[session];
		uint32_t first = (uint32_t)rand_r(&seed) % 300;
		uint32_t count = (uint32_t)rand_r(&seed) % 200;

		switch (rand_r(&seed) % 6) {
		case 0:
			kit_take(kit, session, first, count, true);
			break;
		case 1:
			kit_take(kit, session, first, count, false);
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
			kit_begin_fetches(kit, visible);
			kit_run_once(kit);
			break;
		}
		visible_settle(visible);
		kit_books_check(kit);
	}
	for (uint32_t i = 0; i < SESSION_COUNT; i++)
		kit_settle(kit, &kit->visible[i]);
}

int main(void)
{
#define KIT_TEST(name) cmocka_unit_test_setup_teardown(name, kit_setup, kit_teardown)
	const struct CMUnitTest tests[] = {
		KIT_TEST(a_set_becomes_drawable_and_complete),
		cmocka_unit_test_setup_teardown(a_set_becomes_drawable_and_complete,
						kit_setup_coded, kit_teardown),
		KIT_TEST(a_few_payloads_are_verified_without_a_worker_and_coded_ones_with),
		cmocka_unit_test_setup_teardown(
			a_few_payloads_are_verified_without_a_worker_and_coded_ones_with,
			kit_setup_coded, kit_teardown),
		KIT_TEST(a_hit_is_granted_at_once_and_overtakes_misses),
		KIT_TEST(two_sessions_share_one_read),
		KIT_TEST(what_a_set_drops_is_given_back_with_the_retire_flag),
		KIT_TEST(what_a_set_drops_stays_drawable_until_it_is_retired),
		KIT_TEST(what_comes_back_before_it_is_retired_has_never_been_away),
		KIT_TEST(a_node_named_twice_counts_once),
		KIT_TEST(a_set_of_what_is_no_node_is_refused_and_changes_nothing),
		KIT_TEST(closing_a_store_gives_everything_back),
		cmocka_unit_test_setup_teardown(
			unreadable_nodes_are_refused_and_read_when_they_are_wanted_anew,
			kit_setup_failing, kit_teardown),
		cmocka_unit_test_setup_teardown(
			damaged_nodes_are_refused_to_everybody_and_the_rest_is_served,
			kit_setup_corrupting, kit_teardown),
		KIT_TEST(sets_at_random_keep_the_books),
		cmocka_unit_test_setup_teardown(sets_at_random_keep_the_books, kit_setup_coded,
						kit_teardown),
	};

	/* Damaged nodes are logged, which is not what is looked at here. */
	log_init("test_visible", LOG_LEVEL_ERROR - 1);
	return TEST_RUN(tests);
}
