/* SPDX-License-Identifier: MIT */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "tests/unit/visible_kit.h"

#include <errno.h>
#include <stdlib.h>

#include "daemon/sharing/division.h"

static void on_ended(void *arg, const struct fill_result *result)
{
	struct kit *kit = arg;

	for (uint32_t i = 0; i < SESSION_COUNT; i++)
		visible_fill_ended(&kit->visible[i], result);
}

static int setup_with(void **state, struct fetch_sim sim, const struct test_grid *grid)
{
	struct kit *kit = calloc(1, sizeof(*kit));
	struct why why;

	parts_begin(&kit->parts, BUDGET_BYTES, grid, &sim, on_ended, kit);
	kit->fit_count = BUDGET_BYTES / WIRE_PAGE_BYTES /
			 served_pages(kit->parts.served, kit->parts.nodes[0]);
	room_init(&kit->room, &kit->parts.cache);
	for (uint32_t i = 0; i < ACCOUNT_COUNT; i++)
		kit->accounts[i].policy.weight = 100;
	for (uint32_t i = 0; i < SESSION_COUNT; i++) {
		visible_init(&kit->visible[i], &kit->room, &kit->accounts[i / 2], kit->parts.fills,
			     i + 1, &kit->pages[i]);
		assert_int_equal(visible_attach(&kit->visible[i], 0, kit->parts.served, 1, &why),
				 0);
	}
	*state = kit;
	return 0;
}

static const struct test_grid plain = { .count = 16, .face_quads = 4 };
static const struct test_grid coded = { .count = 16, .face_quads = 4, .codec = STORE_CODEC_ZSTD };

int kit_setup(void **state)
{
	return setup_with(state, (struct fetch_sim){ .seed = 1, .delay_permille = 200 }, &plain);
}

int kit_setup_coded(void **state)
{
	return setup_with(state, (struct fetch_sim){ .seed = 1, .short_permille = 200 }, &coded);
}

int kit_setup_failing(void **state)
{
	return setup_with(state, (struct fetch_sim){ .seed = 2, .error_permille = 500 }, &plain);
}

int kit_setup_corrupting(void **state)
{
	return setup_with(state, (struct fetch_sim){ .seed = 2, .corrupt_permille = 150 }, &plain);
}

void kit_books_check(const struct kit *kit)
{
	const struct store_counters *counters = &kit->parts.served->counters;
	uint32_t queued_count = 0;
	uint32_t hold_count = 0;

	cache_check(&kit->parts.cache);
	for (uint32_t i = 0; i < SESSION_COUNT; i++) {
		visible_check(&kit->visible[i]);
		queued_count += visible_queued_count(&kit->visible[i]);
		hold_count += kit->visible[i].held_count;
	}
	for (uint32_t i = 0; i < kit->parts.served->node_count; i++)
		hold_count -= kit->parts.served->nodes[i].hold_count;
	assert_int_equal(hold_count, 0);
	/* What was missed is read, found on its way, given up or still waits. */
	assert_int_equal(counters->misses + counters->retries,
			 counters->fetches + counters->joined + counters->refused +
				 counters->dropped + queued_count);
}

bool kit_begin_fetches(struct kit *kit, struct visible *visible)
{
	struct queue_want want;
	int r = 0;

	division_settle(&kit->room);
	visible_retry(visible);
	while (r != -EAGAIN && r != -EBUSY && fills_has_room(kit->parts.fills) &&
	       visible_next(visible, &want)) {
		r = fills_start(kit->parts.fills, want.served, want.index, 1, false);
		if (r != -EAGAIN && r != -EBUSY)
			visible_begun(visible, &want, r);
	}
	fetch_flush(kit->parts.fetch);
	return r == -EBUSY;
}

void kit_run_once(struct kit *kit)
{
	if (fills_count(kit->parts.fills) > 0)
		parts_take_reads(&kit->parts);
}

void kit_settle(struct kit *kit, struct visible *visible)
{
	struct wire_refusal refusals[WANTS_MAX];
	bool waits;

	do {
		waits = kit_begin_fetches(kit, visible);
		kit_run_once(kit);
	} while (fills_count(kit->parts.fills) > 0 || kit->room.changed ||
		 (!waits && visible_missing_count(visible) > 0));
	(void)visible_take_refusals(visible, refusals, WANTS_MAX);
	visible_settle(visible);
	kit_books_check(kit);
}

int kit_teardown(void **state)
{
	struct kit *kit = *state;

	while (fills_count(kit->parts.fills) > 0)
		kit_run_once(kit);
	kit_books_check(kit);
	for (uint32_t i = 0; i < SESSION_COUNT; i++)
		visible_done(&kit->visible[i]);
	parts_end(&kit->parts);
	free(kit);
	return 0;
}

void kit_take(struct kit *kit, uint32_t session, uint32_t first, uint32_t count, bool retire)
{
	struct visible *visible = &kit->visible[session];
	struct wire_entry entries[WANTS_MAX] = { 0 };

	for (uint32_t i = 0; i < count; i++)
		entries[i] =
			(struct wire_entry){ 0, kit->parts.nodes[first + i], (float)(count - i) };
	assert_int_equal(visible_take(visible, entries, count, visible->serial + 1, retire), 0);
	assert_int_equal(kit->pages[session].acknowledged, visible->serial);
	kit_books_check(kit);
	division_settle(&kit->room);
	kit_books_check(kit);
}

const struct want *kit_want_of(const struct kit *kit, uint32_t session, uint32_t at)
{
	const struct visible *visible = &kit->visible[session];
	uint32_t want = visible->attachments[0]->want_of_node[kit->parts.nodes[at]];

	return want > 0 ? &visible->wants[want - 1] : NULL;
}

void kit_say_again(struct kit *kit, uint32_t session)
{
	struct visible *visible = &kit->visible[session];
	struct wire_entry entries[WANTS_MAX] = { 0 };

	for (uint32_t i = 0; i < visible->count; i++)
		entries[i] = (struct wire_entry){ visible->wants[i].slot, visible->wants[i].node,
						  (float)(visible->count - i) };
	assert_int_equal(visible_take(visible, entries, visible->count, visible->serial + 1, true),
			 0);
	division_settle(&kit->room);
	kit_books_check(kit);
}

/* What a client does that is asked to let go. */
static bool answer_recall(struct kit *kit, uint32_t session)
{
	if (kit->visible[session].revoked_count == 0)
		return false;
	visible_note_quiet(&kit->visible[session]);
	kit_say_again(kit, session);
	return true;
}

void kit_settle_all(struct kit *kit)
{
	bool again;

	do {
		again = false;
		for (uint32_t i = 0; i < SESSION_COUNT; i++)
			kit_settle(kit, &kit->visible[i]);
		for (uint32_t i = 0; i < SESSION_COUNT; i++)
			again |= answer_recall(kit, i);
	} while (again);
	for (uint32_t i = 0; i < SESSION_COUNT; i++) {
		assert_int_equal(visible_missing_count(&kit->visible[i]), 0);
		assert_int_equal(kit->pages[i].settled, kit->visible[i].serial);
	}
}

bool kit_is_granted(const struct kit *kit, uint32_t session, uint32_t at)
{
	uint32_t node = kit->parts.nodes[at];

	return kit->visible[session].attachments[0]->grants->words[node / 64] >> (node % 64) & 1;
}

enum node_state kit_state_of(const struct kit *kit, uint32_t at)
{
	return kit->parts.served->nodes[kit->parts.nodes[at]].state;
}
