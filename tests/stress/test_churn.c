/* SPDX-License-Identifier: MIT */
/*
 * Goal: however long payloads of mixed sizes come and go, none is refused because what is free lies in
 * pieces, while a twentieth of the cache is free (and in some segment as much as the payload has, which
 * for one of up to a twentieth of a segment is the same); and the books are right all the while.
 * Method: the daemon's cache and sets without disk and sockets: reads are done at once, and clients
 * that are asked to let go do.  So hours of changing sets take seconds.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/limits.h"
#include "daemon/sharing/division.h"
#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "tests/helper.h"

#define SEGMENT_COUNT 16u
#define SEGMENT_PAGES 512u
#define BUDGET_PAGES  (SEGMENT_COUNT * SEGMENT_PAGES)
#define PAYLOAD_PAGES (SEGMENT_PAGES / 8)
#define NODE_COUNT    8192u
#define SESSION_COUNT 4u
#define STEPS_USUAL   1500u

struct fixture {
	struct cache cache;
	struct room room;
	struct served served;
	struct store_superblock superblock;
	struct store_node records[NODE_COUNT];
	uint8_t held[NODE_COUNT];
	struct account account;
	struct visible visible[SESSION_COUNT];
	struct wire_session_page pages[SESSION_COUNT];
	unsigned seed;
	uint64_t wanted_pages; /* that a set of a session has, at most */
	uint64_t read_pages;   /* ever */
	uint64_t asked_pages;  /* of nodes that sets began to want */
	uint64_t refused;      /* though there was room: is_fragmented() */
};

/* What visible.c wants of fills.c: here reads are done at once. */
void fills_upgrade(struct fills *fills, const struct served *served, uint32_t index)
{
	(void)fills;
	(void)served;
	(void)index;
}

static void on_make(void *arg, struct served *served)
{
	struct fixture *fixture = arg;
	struct memfile memfile = MEMFILE_NONE;
	struct segment *segment;

	memfile.bytes = served->arena.segment_bytes;
	assert_int_equal(cache_add_segment(&fixture->cache, served, &memfile, &segment), 0);
}

static void on_gone(void *arg, struct served *served, struct segment *segment)
{
	(void)arg;
	(void)served;
	(void)segment;
}

/* Mostly small ones, some of each size up to the largest: as leaves and the parts that end early. */
static uint32_t payload_pages(struct fixture *fixture)
{
	uint32_t kind = (uint32_t)rand_r(&fixture->seed) % 8;
	uint32_t pages_max = kind == 0 ? PAYLOAD_PAGES : kind < 4 ? PAYLOAD_PAGES / 4 : 4;

	return 1 + (uint32_t)rand_r(&fixture->seed) % pages_max;
}

static int setup(void **state)
{
	const struct cache_calls calls = { .make = on_make, .gone = on_gone };
	struct fixture *fixture = calloc(1, sizeof(*fixture));
	struct served *served = &fixture->served;

	fixture->seed = 3;
	list_init(&served->link);
	list_init(&served->lru);
	for (uint32_t i = 0; i < NODE_COUNT; i++) {
		fixture->records[i].payload_id = i + 1;
		fixture->records[i].payload_bytes = payload_pages(fixture) * WIRE_PAGE_BYTES;
		fixture->superblock.payload_raw_bytes += fixture->records[i].payload_bytes;
	}
	fixture->superblock.node_count = NODE_COUNT;
	served->superblock = &fixture->superblock;
	served->records = fixture->records;
	served->node_count = NODE_COUNT;
	served->ledger.held = (_Atomic uint8_t *)fixture->held;
	served->nodes = calloc(NODE_COUNT, sizeof(*served->nodes));
	for (uint32_t i = 0; i < NODE_COUNT; i++)
		node_init(&served->nodes[i], fixture->records[i].payload_bytes);
	served->directory = calloc(1, sizeof(*served->directory) +
					      NODE_COUNT * sizeof(served->directory->words[0]));
	arena_init(&served->arena, SEGMENT_PAGES * WIRE_PAGE_BYTES);
	cache_init(&fixture->cache, BUDGET_PAGES * (uint64_t)WIRE_PAGE_BYTES, &calls, fixture);
	cache_add_store(&fixture->cache, served);
	room_init(&fixture->room, &fixture->cache);
	fixture->account.policy.weight = ACCOUNT_WEIGHT_USUAL;
	for (uint32_t i = 0; i < SESSION_COUNT; i++) {
		visible_init(&fixture->visible[i], &fixture->room, &fixture->account, NULL, i + 1,
			     &fixture->pages[i]);
		assert_int_equal(visible_attach(&fixture->visible[i], 0, served, 1, NULL), 0);
	}
	*state = fixture;
	return 0;
}

static int teardown(void **state)
{
	struct fixture *fixture = *state;

	for (uint32_t i = 0; i < SESSION_COUNT; i++)
		visible_done(&fixture->visible[i]);
	cache_check(&fixture->cache);
	cache_remove_store(&fixture->cache, &fixture->served);
	free(fixture->served.nodes);
	free(fixture->served.directory);
	free(fixture);
	return 0;
}

/* Reads a node.  Returns: 0, or what cache_begin_fill() says. */
static int read_node(struct fixture *fixture, uint32_t index)
{
	return cache_begin_fill(&fixture->cache, &fixture->served, index, 0, false);
}

static void end_read(struct fixture *fixture, uint32_t index)
{
	struct fill_result result = { &fixture->served, index, .reason = WIRE_REASON_NONE };

	fixture->read_pages += served_pages(&fixture->served, index);
	cache_end_fill(&fixture->cache, &fixture->served, index);
	for (uint32_t i = 0; i < SESSION_COUNT; i++)
		visible_fill_ended(&fixture->visible[i], &result);
}

/* Is a twentieth free, and as much as the payload has in some segment, in pieces or not? */
static bool is_fragmented(const struct fixture *fixture, uint32_t pages)
{
	uint64_t free_bytes = fixture->cache.budget_bytes - fixture->cache.pinned_bytes;

	if (free_bytes < fixture->cache.budget_bytes / FRAGMENTED_SHARE)
		return false;
	LIST_FOR_EACH (link, &fixture->served.arena.in_order)
		if (SEGMENT_PAGES - ARENA_SEGMENT(link)->pinned_pages >= pages)
			return true;
	return false;
}

/* Begins and ends what a session's set waits for.  Returns: did anything come of it? */
static bool read_for(struct fixture *fixture, struct visible *visible)
{
	struct queue_want want;
	bool any = false;

	while (visible_next(visible, &want)) {
		uint64_t segment_count = fixture->cache.segment_count;
		int r = read_node(fixture, want.index);

		if (r == -EBUSY || (r == -EAGAIN && fixture->cache.segment_count == segment_count))
			return any;
		if (r == -EAGAIN)
			continue;
		any = true;
		fixture->refused +=
			r < 0 && is_fragmented(fixture, served_pages(want.served, want.index));
		visible_begun(visible, &want, r);
		if (r == 0)
			end_read(fixture, want.index);
	}
	return any;
}

static void say(struct visible *visible, const uint32_t *nodes, uint32_t count)
{
	static struct wire_entry entries[NODE_COUNT];

	for (uint32_t i = 0; i < count; i++)
		entries[i] = (struct wire_entry){ 0, nodes[i], (float)(count - i) };
	visible_note_quiet(visible);
	assert_int_equal(visible_take(visible, entries, count, visible->serial + 1, true), 0);
}

/* A client that is asked to let go says its set again. */
static bool answer(struct visible *visible)
{
	static uint32_t nodes[NODE_COUNT];

	if (visible->revoked_count == 0)
		return false;
	for (uint32_t i = 0; i < visible->count; i++)
		nodes[i] = visible->wants[i].node;
	say(visible, nodes, visible->count);
	return true;
}

static void settle(struct fixture *fixture)
{
	uint32_t rounds = 0;
	bool again;

	do {
		again = false;
		division_settle(&fixture->room);
		for (uint32_t i = 0; i < SESSION_COUNT; i++) {
			visible_retry(&fixture->visible[i]);
			again |= read_for(fixture, &fixture->visible[i]);
		}
		for (uint32_t i = 0; i < SESSION_COUNT; i++)
			again |= answer(&fixture->visible[i]);
		again |= room_is_unsettled(&fixture->room);
		if (++rounds > 10000)
			fail_msg("it does not settle");
	} while (again);
}

/*
 * A camera's step: most of what a session wants stays, some of it goes and is replaced by nodes from
 * anywhere, as many as it may want.
 */
static void step(struct fixture *fixture)
{
	static uint32_t nodes[NODE_COUNT];
	static bool taken[NODE_COUNT];
	struct visible *visible =
		&fixture->visible[(uint32_t)rand_r(&fixture->seed) % SESSION_COUNT];
	uint64_t pages = 0;
	uint32_t count = 0;

	memset(taken, 0, sizeof(taken));
	for (uint32_t i = 0; i < visible->count; i++) {
		uint32_t node = visible->wants[i].node;

		if (rand_r(&fixture->seed) % 8 == 0)
			continue;
		nodes[count++] = node;
		taken[node] = true;
		pages += served_pages(&fixture->served, node);
	}
	for (;;) {
		uint32_t node = (uint32_t)rand_r(&fixture->seed) % NODE_COUNT;

		if (taken[node])
			continue;
		pages += served_pages(&fixture->served, node);
		if (pages > fixture->wanted_pages)
			break;
		fixture->asked_pages += served_pages(&fixture->served, node);
		nodes[count++] = node;
		taken[node] = true;
	}
	say(visible, nodes, count);
}

/* share: of the cache that all sets together want, at most. */
static void churn(struct fixture *fixture, double share)
{
	uint32_t step_count = (uint32_t)test_repeats(STEPS_USUAL);

	fixture->wanted_pages = (uint64_t)(share * BUDGET_PAGES / SESSION_COUNT);
	for (uint32_t i = 0; i < step_count; i++) {
		step(fixture);
		settle(fixture);
		if (i % 64 == 0) {
			cache_check(&fixture->cache);
			for (uint32_t k = 0; k < SESSION_COUNT; k++)
				visible_check(&fixture->visible[k]);
		}
		for (uint32_t k = 0; k < SESSION_COUNT; k++) {
			struct visible *visible = &fixture->visible[k];

			assert_int_equal(visible_missing_count(visible), 0);
			if (share < 1.0 - 1.0 / FRAGMENTED_SHARE)
				assert_int_equal(visible->counts[WANT_REFUSED], 0);
		}
	}
	print_message("%.0f %% wanted: %llu segments drained in %u steps, %.2f pages read for each "
		      "that was asked for, fragmentation %.2f\n",
		      100 * share, (unsigned long long)fixture->cache.drain_count, step_count,
		      (double)fixture->read_pages / (double)fixture->asked_pages,
		      arena_fragmentation(&fixture->served.arena));
	assert_int_equal(fixture->refused, 0);
}

static void nothing_is_refused_while_half_is_held(void **state)
{
	churn(*state, 0.5);
}

static void nothing_is_refused_while_a_twentieth_is_free(void **state)
{
	churn(*state, 0.94);
}

static void nothing_is_refused_for_its_place_when_too_much_is_wanted(void **state)
{
	churn(*state, 2.0);
}

int main(void)
{
#define CHURN_TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)
	const struct CMUnitTest tests[] = {
		CHURN_TEST(nothing_is_refused_while_half_is_held),
		CHURN_TEST(nothing_is_refused_while_a_twentieth_is_free),
		CHURN_TEST(nothing_is_refused_for_its_place_when_too_much_is_wanted),
	};

	return TEST_RUN(tests);
}
