/* SPDX-License-Identifier: MIT */
/*
 * Goal: the disk is shared as queues.h says: by weight, fetches before prefetches, and nobody fills it.
 * Method: callers with lists of nodes in place of sessions, over the simulated back end.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <stdbool.h>
#include <stdlib.h>

#include "daemon/limits.h"
#include "daemon/sharing/queues.h"
#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "tests/unit/parts_kit.h"

#define BUDGET_BYTES (32u * MIB)
#define CALLER_COUNT 4u

struct caller {
	struct queue_entry entry;
	struct served *served;
	const uint32_t *fetches;
	uint32_t fetch_count;
	const uint32_t *prefetches;
	uint32_t prefetch_count;
	uint64_t wanted_before_ns; /* so long */
	struct cache *holder;      /* what is begun is held; NULL: it is not */
	uint64_t begun_bytes;
	uint32_t refused_count;
};

struct fixture {
	struct parts parts;
	struct queues queues;
	struct account accounts[CALLER_COUNT];
	struct caller callers[CALLER_COUNT];
};

static bool on_next(void *arg, struct queue_want *ret)
{
	const struct caller *caller = arg;

	if (caller->fetch_count == 0)
		return false;
	*ret = (struct queue_want){ caller->served, caller->fetches[0],
				    clock_now_ns() - caller->wanted_before_ns };
	return true;
}

static void on_begun(void *arg, const struct queue_want *want, int error)
{
	struct caller *caller = arg;

	if (error == 0)
		caller->begun_bytes += caller->served->records[want->index].stored_bytes;
	caller->refused_count += error == -EBUSY;
	assert_true(error == 0 || error == -EBUSY);
	if (error == 0 && caller->holder)
		cache_hold(caller->holder, caller->served, want->index);
	caller->fetches++;
	caller->fetch_count--;
}

static bool on_next_prefetch(void *arg, struct queue_want *ret)
{
	const struct caller *caller = arg;

	if (caller->prefetch_count == 0)
		return false;
	*ret = (struct queue_want){ caller->served, caller->prefetches[0], 0 };
	return true;
}

static void on_prefetch_over(void *arg)
{
	struct caller *caller = arg;

	caller->prefetches++;
	caller->prefetch_count--;
}

static const struct queue_calls queue_calls = {
	.next = on_next,
	.begun = on_begun,
	.next_prefetch = on_next_prefetch,
	.prefetch_over = on_prefetch_over,
};

static void on_ended(void *arg, const struct fill_result *result)
{
	(void)arg;
	assert_int_equal(result->reason, WIRE_REASON_NONE);
}

static int setup(void **state)
{
	const struct test_grid grid = { .count = 20, .face_quads = 4 };
	const struct fetch_sim sim = { .seed = 5 };
	struct fixture *fixture = calloc(1, sizeof(*fixture));

	parts_begin(&fixture->parts, BUDGET_BYTES, &grid, &sim, on_ended, NULL);
	queues_init(&fixture->queues, fixture->parts.fills);
	for (uint32_t i = 0; i < CALLER_COUNT; i++) {
		fixture->accounts[i].policy.weight = ACCOUNT_WEIGHT_USUAL;
		fixture->callers[i].served = fixture->parts.served;
		queue_entry_init(&fixture->callers[i].entry, &queue_calls, &fixture->callers[i],
				 i + 1, &fixture->accounts[i]);
	}
	*state = fixture;
	return 0;
}

/* As often as it takes a segment to be made, which is at once here. */
static void pump(struct fixture *fixture)
{
	for (uint32_t i = 0; i < 3; i++)
		queues_pump(&fixture->queues);
	fetch_flush(fixture->parts.fetch);
}

/* Takes what has come back, and begins what can be begun. */
static void run_once(struct fixture *fixture)
{
	parts_take_reads(&fixture->parts);
	pump(fixture);
}

static int teardown(void **state)
{
	struct fixture *fixture = *state;

	for (uint32_t i = 0; i < CALLER_COUNT; i++) {
		fixture->callers[i].fetch_count = 0;
		fixture->callers[i].prefetch_count = 0;
		queue_entry_done(&fixture->queues, &fixture->callers[i].entry);
	}
	for (uint32_t i = 0; i < CALLER_COUNT; i++)
		assert_int_equal(fixture->accounts[i].fetching_count, 0);
	assert_int_equal(fixture->queues.reader_count, 0);
	while (fills_count(fixture->parts.fills) > 0)
		run_once(fixture);
	cache_check(&fixture->parts.cache);
	parts_end(&fixture->parts);
	free(fixture);
	return 0;
}

static struct caller *wants(struct fixture *fixture, uint32_t i, uint32_t first, uint32_t count)
{
	struct caller *caller = &fixture->callers[i];

	assert_true(first + count <= fixture->parts.node_count);
	caller->fetches = &fixture->parts.nodes[first];
	caller->fetch_count = count;
	queues_add_fetch(&fixture->queues, &caller->entry);
	return caller;
}

static struct caller *wishes(struct fixture *fixture, uint32_t i, uint32_t first, uint32_t count)
{
	struct caller *caller = &fixture->callers[i];

	caller->prefetches = &fixture->parts.nodes[first];
	caller->prefetch_count = count;
	queues_add_prefetch(&fixture->queues, &caller->entry);
	return caller;
}

/* Neighbours in the file are read with one read. */
static void put_in_file_order(struct fixture *fixture)
{
	const struct store_node *records = fixture->parts.served->records;
	uint32_t *nodes = fixture->parts.nodes;

	for (uint32_t i = 0; i < fixture->parts.node_count; i++)
		for (uint32_t k = i;
		     k > 0 && records[nodes[k]].file_offset < records[nodes[k - 1]].file_offset;
		     k--) {
			uint32_t node = nodes[k];

			nodes[k] = nodes[k - 1];
			nodes[k - 1] = node;
		}
}

/* Afterwards none follow each other. */
static void put_apart(struct fixture *fixture)
{
	uint32_t nodes[PARTS_NODES_MAX];
	uint32_t count = 0;

	put_in_file_order(fixture);
	for (uint32_t k = 0; k < 3; k++)
		for (uint32_t i = k; i < fixture->parts.node_count; i += 3)
			nodes[count++] = fixture->parts.nodes[i];
	for (uint32_t i = 0; i < count; i++)
		fixture->parts.nodes[i] = nodes[i];
}

static void users_read_as_much_as_they_weigh(void **state)
{
	struct fixture *fixture = *state;
	struct caller *callers[CALLER_COUNT];
	uint64_t heavy_bytes;
	uint64_t light_bytes;

	/* Few pieces, two clients each: none is held back from all of the queue. */
	put_in_file_order(fixture);
	for (uint32_t i = 0; i < CALLER_COUNT; i++)
		fixture->callers[i].entry.account = &fixture->accounts[i / 2];
	fixture->accounts[0].policy.weight = 3 * ACCOUNT_WEIGHT_USUAL;
	for (uint32_t i = 0; i < CALLER_COUNT; i++)
		callers[i] = wants(fixture, i, 130 * i, 130);
	pump(fixture);
	while (callers[0]->fetch_count > 0 && callers[1]->fetch_count > 0)
		run_once(fixture);
	heavy_bytes = callers[0]->begun_bytes + callers[1]->begun_bytes;
	light_bytes = callers[2]->begun_bytes + callers[3]->begun_bytes;
	/* But for what they had when they came: a turn for the first, half a one for the second. */
	assert_in_range(light_bytes, heavy_bytes / 3 - TURN_BYTES, heavy_bytes / 3 + TURN_BYTES);
}

static void clients_of_one_user_share_its_turn(void **state)
{
	struct fixture *fixture = *state;
	struct caller *callers[CALLER_COUNT];

	for (uint32_t i = 1; i < 3; i++)
		fixture->callers[i].entry.account = &fixture->accounts[0];
	put_in_file_order(fixture);
	for (uint32_t i = 0; i < 3; i++)
		callers[i] = wants(fixture, i, 100 * i, 100);
	callers[3] = wants(fixture, 3, 300, 300);
	pump(fixture);
	while (callers[3]->fetch_count > 0 && callers[1]->fetch_count > 0)
		run_once(fixture);
	/* Three times as much each, but for what the first had before the others came. */
	for (uint32_t i = 1; i < 3; i++)
		assert_true(callers[3]->begun_bytes > 2 * callers[i]->begun_bytes);
}

static void a_prefetch_begins_when_no_fetch_waits(void **state)
{
	struct fixture *fixture = *state;
	const struct caller *caller = wants(fixture, 0, 0, 200);

	wishes(fixture, 1, 200, 100);
	pump(fixture);
	while (caller->fetch_count > 0) {
		assert_int_equal(fixture->parts.served->counters.prefetches, 0);
		run_once(fixture);
	}
	/* And a fetch that comes then goes first again. */
	while (fixture->parts.served->counters.prefetches < 20)
		run_once(fixture);
	wants(fixture, 0, 300, 100);
	while (caller->fetch_count > 0) {
		uint64_t prefetches = fixture->parts.served->counters.prefetches;

		run_once(fixture);
		if (caller->fetch_count > 0)
			assert_int_equal(fixture->parts.served->counters.prefetches, prefetches);
	}
	assert_int_equal(fills_times(fixture->parts.fills)->wait.count, 300);
	assert_int_equal(fills_times(fixture->parts.fills)->wait_behind_prefetch.count, 300);
}

/* Somebody always is about to give something up, and it is always gone. */
static void no_fetch_waits_for_room_for_ever(void **state)
{
	struct fixture *fixture = *state;
	struct caller *caller = wants(fixture, 0, 0, fixture->parts.node_count);
	uint32_t held_count;

	caller->holder = &fixture->parts.cache;
	fixture->parts.cache.budget_bytes = fixture->parts.served->arena.segment_bytes;
	fixture->parts.cache.room_is_coming = true;
	pump(fixture);
	while (fills_count(fixture->parts.fills) > 0)
		run_once(fixture);
	held_count = fixture->parts.node_count - caller->fetch_count;
	assert_true(held_count > 0 && caller->fetch_count > 0);
	assert_int_equal(caller->refused_count, 0);

	caller->wanted_before_ns = (ROOM_WAIT_MS_MAX + 1) * NS_PER_MS;
	queues_add_fetch(&fixture->queues, &caller->entry);
	pump(fixture);
	assert_int_equal(caller->refused_count, fixture->parts.node_count - held_count);
	for (uint32_t i = 0; i < held_count; i++)
		cache_release(&fixture->parts.cache, fixture->parts.served,
			      fixture->parts.nodes[i]);
}

static void what_is_prefetched_does_not_change_the_order_of_replacement(void **state)
{
	struct fixture *fixture = *state;
	const struct caller *caller = wants(fixture, 0, 0, 50);
	const struct served *served = fixture->parts.served;
	uint64_t last_use[50];

	pump(fixture);
	while (caller->fetch_count > 0 || fills_count(fixture->parts.fills) > 0)
		run_once(fixture);
	for (uint32_t i = 0; i < 50; i++)
		last_use[i] = served->nodes[fixture->parts.nodes[i]].last_use;
	/* What others prefetch comes behind it, and what is there is not asked for (session.c). */
	caller = wishes(fixture, 1, 50, 50);
	pump(fixture);
	while (caller->prefetch_count > 0 || fills_count(fixture->parts.fills) > 0)
		run_once(fixture);
	for (uint32_t i = 0; i < 50; i++)
		assert_true(served->nodes[fixture->parts.nodes[i]].last_use == last_use[i]);
	assert_int_equal(served->counters.prefetches, 50);
	assert_int_equal(fixture->parts.cache.pinned_bytes, 0);
}

static void one_client_leaves_some_of_the_queue_to_others_that_read(void **state)
{
	struct fixture *fixture = *state;
	const struct caller *other;

	put_apart(fixture);
	/* Alone it may have all. */
	wants(fixture, 0, 0, 170);
	pump(fixture);
	assert_int_equal(fetch_in_flight(fixture->parts.fetch), PARTS_DEPTH);
	other = wants(fixture, 1, 400, 1);
	while (other->fetch_count > 0 ||
	       fetch_in_flight(fixture->parts.fetch) > PARTS_DEPTH * 3 / 4)
		run_once(fixture);
	/* From now on there is room at once for one that has read before. */
	assert_true(fixture->callers[0].fetch_count > 0);
	other = wants(fixture, 1, 410, 1);
	queues_pump(&fixture->queues);
	assert_int_equal(other->fetch_count, 0);
}

int main(void)
{
#define QUEUES_TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)
	const struct CMUnitTest tests[] = {
		QUEUES_TEST(users_read_as_much_as_they_weigh),
		QUEUES_TEST(clients_of_one_user_share_its_turn),
		QUEUES_TEST(no_fetch_waits_for_room_for_ever),
		QUEUES_TEST(a_prefetch_begins_when_no_fetch_waits),
		QUEUES_TEST(what_is_prefetched_does_not_change_the_order_of_replacement),
		QUEUES_TEST(one_client_leaves_some_of_the_queue_to_others_that_read),
	};

	return TEST_RUN(tests);
}
