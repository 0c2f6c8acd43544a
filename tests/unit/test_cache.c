/* SPDX-License-Identifier: MIT */
/* Goal: the cache keeps what is held, evicts the oldest, and says "full" only when it is. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "daemon/cache/cache.h"
#include "daemon/limits.h"
#include "formats/base/bytes.h"
#include "tests/helper.h"

#define BUDGET_BYTES (1u * MIB)

struct fixture {
	char *folder;
	struct cache cache;
	bool deny_memory;
	uint32_t gone_count;
	struct store_node *mixed; /* records of a store whose payloads differ in size */
};

/* Segments are made at once here, and are there with the next call. */
static void on_make(void *arg, struct served *served)
{
	struct fixture *fixture = arg;
	struct memfile memfile;
	struct segment *segment;

	if (fixture->deny_memory) {
		cache_segment_failed(&fixture->cache, served);
		return;
	}
	assert_int_equal(memfile_create("test", served->arena.segment_bytes, false, &memfile, NULL),
			 0);
	assert_int_equal(memfile_publish(&memfile, MEMFILE_CHANGING, NULL), 0);
	assert_int_equal(cache_add_segment(&fixture->cache, served, &memfile, &segment), 0);
}

static void on_gone(void *arg, struct served *served, struct segment *segment)
{
	struct fixture *fixture = arg;

	(void)served;
	(void)segment;
	fixture->gone_count++;
}

static int setup(void **state)
{
	const struct cache_calls calls = { .make = on_make, .gone = on_gone };
	struct fixture *fixture = calloc(1, sizeof(*fixture));

	fixture->folder = test_folder_make();
	cache_init(&fixture->cache, BUDGET_BYTES, &calls, fixture);
	*state = fixture;
	return 0;
}

static int teardown(void **state)
{
	struct fixture *fixture = *state;

	LIST_FOR_EACH (link, &fixture->cache.stores) {
		struct served *served = LIST_ENTRY(link, struct served, link);

		cache_check(&fixture->cache);
		cache_remove_store(&fixture->cache, served);
		served_close(served);
	}
	assert_int_equal(fixture->cache.segment_bytes, 0);
	assert_int_equal(fixture->cache.pinned_bytes, 0);
	test_folder_remove(fixture->folder);
	free(fixture->mixed);
	free(fixture);
	return 0;
}

/* A store with more payloads than the budget holds. */
static struct served *add_store(struct fixture *fixture, const char *name)
{
	const char *path = test_path(fixture->folder, name);
	const struct test_grid grid = { .count = 16, .face_quads = 2 };
	struct served *served;
	struct why why;

	test_store_grid_make(path, &grid);
	if (served_open(open(path, O_RDONLY | O_CLOEXEC), path, BUDGET_BYTES, 1, &served, &why) < 0)
		fail_msg("%s", why.text);
	cache_add_store(&fixture->cache, served);
	return served;
}

/* Lets the payloads have 1 to 9 pages, which nothing here reads. */
static void mix_sizes(struct served *served, struct store_node **ret_records)
{
	struct store_node *records = malloc(served->node_count * sizeof(*records));

	assert_non_null(records);
	memcpy(records, served->records, served->node_count * sizeof(*records));
	for (uint32_t i = 0; i < served->node_count; i++) {
		if (records[i].payload_id == 0)
			continue;
		records[i].payload_bytes = WIRE_PAGE_BYTES * (1 + i * 2654435761u % 97 % 9);
		node_init(&served->nodes[i], records[i].payload_bytes);
	}
	served->records = records;
	*ret_records = records;
}

/* The first node with payload after `index`. */
static uint32_t next_node(const struct served *served, uint32_t index)
{
	do
		index++;
	while (index < served->node_count && !served_has_payload(served, index));
	assert_true(index < served->node_count);
	return index;
}

/* As often as segments come first; -EBUSY: a segment is drained. */
static int begin(struct fixture *fixture, struct served *served, uint32_t index)
{
	int r = -EAGAIN;

	for (uint32_t i = 0; i < 8 && r == -EAGAIN; i++)
		r = cache_begin_fill(&fixture->cache, served, index, 0, false);
	return r;
}

static void fill(struct fixture *fixture, struct served *served, uint32_t index)
{
	assert_int_equal(begin(fixture, served, index), 0);
	cache_end_fill(&fixture->cache, served, index);
}

/* Fills node after node until one has to go.  Returns: how many were filled. */
static uint32_t fill_until_evicting(struct fixture *fixture, struct served *served, uint32_t *last)
{
	uint32_t count = 0;

	*last = 0;
	while (served->counters.evictions == 0) {
		*last = next_node(served, *last);
		fill(fixture, served, *last);
		count++;
	}
	return count;
}

static void cache_evicts_what_was_unused_for_the_longest(void **state)
{
	struct fixture *fixture = *state;
	struct served *served = add_store(fixture, "a.ooc");
	uint32_t first = next_node(served, 0);
	uint32_t second = next_node(served, first);
	uint32_t last;

	assert_true(fill_until_evicting(fixture, served, &last) > 10);
	assert_int_equal(served->nodes[first].state, NODE_ABSENT);
	assert_int_equal(served->nodes[second].state, NODE_FREE);
	cache_check(&fixture->cache);
}

static void cache_keeps_what_is_held_and_evicts_around_it(void **state)
{
	struct fixture *fixture = *state;
	struct served *served = add_store(fixture, "a.ooc");
	uint32_t first = next_node(served, 0);
	uint32_t last;

	fill(fixture, served, first);
	cache_hold(&fixture->cache, served, first);
	last = first;
	for (uint32_t i = 0; i < 400; i++) {
		last = next_node(served, last);
		fill(fixture, served, last);
	}
	assert_true(served->counters.evictions > 0);
	assert_int_equal(served->nodes[first].state, NODE_HELD);
	cache_release(&fixture->cache, served, first);
}

static void cache_counts_a_release_as_the_last_use(void **state)
{
	struct fixture *fixture = *state;
	struct served *served = add_store(fixture, "a.ooc");
	uint32_t first = next_node(served, 0);
	uint32_t second = next_node(served, first);
	uint32_t last;

	fill(fixture, served, first);
	fill(fixture, served, second);
	cache_hold(&fixture->cache, served, first);
	cache_release(&fixture->cache, served, first);
	last = second;
	while (served->counters.evictions == 0) {
		last = next_node(served, last);
		fill(fixture, served, last);
	}
	assert_int_equal(served->nodes[first].state, NODE_FREE);
	assert_int_equal(served->nodes[second].state, NODE_ABSENT);
}

static void cache_is_full_when_all_is_held_and_not_after_one_release(void **state)
{
	struct fixture *fixture = *state;
	struct served *served = add_store(fixture, "a.ooc");
	uint32_t held[512];
	uint32_t held_count = 0;
	uint32_t last = next_node(served, 0);

	while (begin(fixture, served, last) == 0) {
		cache_hold(&fixture->cache, served, last);
		cache_end_fill(&fixture->cache, served, last);
		held[held_count++] = last;
		last = next_node(served, last);
	}
	assert_int_equal(begin(fixture, served, last), -ENOBUFS);
	assert_true(fixture->cache.pinned_bytes <= BUDGET_BYTES);
	assert_true(fixture->cache.pinned_bytes > BUDGET_BYTES / 10 * 9);
	/* BUSY nodes are not evicted either. */
	cache_release(&fixture->cache, served, held[7]);
	assert_int_equal(begin(fixture, served, last), 0);
	assert_int_equal(served->nodes[held[7]].state, NODE_ABSENT);
	cache_fail_fill(&fixture->cache, served, last, true);
	assert_int_equal(served->nodes[last].state, NODE_DAMAGED);
	assert_int_equal(served->counters.errors, 1);
	for (uint32_t i = 0; i < held_count; i++)
		if (i != 7)
			cache_release(&fixture->cache, served, held[i]);
}

static void cache_takes_memory_that_another_store_used_before(void **state)
{
	struct fixture *fixture = *state;
	struct served *a = add_store(fixture, "a.ooc");
	struct served *b = add_store(fixture, "b.ooc");
	uint32_t last;

	fill_until_evicting(fixture, a, &last);
	assert_int_equal(fixture->cache.segment_bytes, BUDGET_BYTES);
	last = 0;
	for (uint32_t i = 0; i < 300; i++) {
		last = next_node(b, last);
		fill(fixture, b, last);
		cache_check(&fixture->cache);
	}
	assert_true(fixture->gone_count > 0);
	assert_true(arena_bytes(&b->arena) > BUDGET_BYTES / 2);
	assert_int_equal(fixture->cache.segment_bytes, BUDGET_BYTES);
}

static void cache_drains_a_segment_for_a_store_that_has_none(void **state)
{
	struct fixture *fixture = *state;
	struct served *a = add_store(fixture, "a.ooc");
	struct served *b = add_store(fixture, "b.ooc");
	uint32_t wanted = next_node(b, 0);
	uint32_t last = 0;

	/* Something is held in every segment of the first store. */
	while (fixture->cache.segment_bytes < BUDGET_BYTES || a->counters.evictions == 0) {
		last = next_node(a, last);
		fill(fixture, a, last);
	}
	LIST_FOR_EACH (link, &a->arena.in_order)
		for (uint32_t i = 0; i < a->node_count; i++)
			if (a->nodes[i].state == NODE_FREE &&
			    a->nodes[i].place.segment == ARENA_SEGMENT(link)->number) {
				cache_hold(&fixture->cache, a, i);
				break;
			}
	assert_int_equal(begin(fixture, b, wanted), -EBUSY);
	assert_true(fixture->cache.room_is_coming);
	assert_int_equal(fixture->cache.draining_count, 1);
	cache_check(&fixture->cache);
	for (uint32_t i = 0; i < a->node_count && fixture->gone_count == 0; i++)
		if (a->nodes[i].state == NODE_HELD)
			cache_release(&fixture->cache, a, i);
	assert_int_equal(fixture->gone_count, 1);
	fill(fixture, b, wanted);
	for (uint32_t i = 0; i < a->node_count; i++)
		if (a->nodes[i].state == NODE_HELD)
			cache_release(&fixture->cache, a, i);
}

static void cache_lives_with_the_memory_there_is(void **state)
{
	struct fixture *fixture = *state;
	struct served *served = add_store(fixture, "a.ooc");
	uint32_t first = next_node(served, 0);
	uint32_t last;

	fill(fixture, served, first);
	fixture->deny_memory = true;
	last = first;
	for (uint32_t i = 0; i < 300; i++) {
		last = next_node(served, last);
		fill(fixture, served, last);
	}
	assert_true(fixture->cache.budget_bytes < BUDGET_BYTES);
	assert_true(fixture->cache.short_since_ns > 0);
	/* And takes what it may have when memory is there again. */
	fixture->deny_memory = false;
	cache_trim(&fixture->cache, fixture->cache.short_since_ns + UINT64_C(11000000000), 1);
	assert_int_equal(fixture->cache.budget_bytes, BUDGET_BYTES);
	fill_until_evicting(fixture, add_store(fixture, "b.ooc"), &last);
	assert_int_equal(fixture->cache.segment_bytes, BUDGET_BYTES);
}

static void cache_gives_back_segments_that_stay_empty(void **state)
{
	struct fixture *fixture = *state;
	struct served *served = add_store(fixture, "a.ooc");

	cache_warm_up(&fixture->cache, served);
	assert_int_equal(served->arena.segment_count, 1);
	cache_trim(&fixture->cache, 1000, 500);
	cache_trim(&fixture->cache, 1400, 500);
	assert_int_equal(served->arena.segment_count, 1);
	cache_trim(&fixture->cache, 1600, 500);
	assert_int_equal(served->arena.segment_count, 0);
	assert_int_equal(fixture->gone_count, 1);
}

/* Holds as a random walk over two stores, with fills that end well, badly and late. */
/* Single free pages between payloads of many sizes: a window is made of them and of what they part. */
static void cache_makes_room_among_payloads_of_many_sizes(void **state)
{
	struct fixture *fixture = *state;
	struct served *served = add_store(fixture, "a.ooc");
	unsigned seed = 5;

	mix_sizes(served, &fixture->mixed);
	for (uint32_t step = 0; step < 20000; step++) {
		uint32_t index = (uint32_t)rand_r(&seed) % served->node_count;

		if (!served_has_payload(served, index) || served->nodes[index].state != NODE_ABSENT)
			continue;
		fill(fixture, served, index);
		if (step % 64 == 0)
			cache_check(&fixture->cache);
	}
	assert_true(served->counters.evictions > 1000);
}

static void cache_keeps_its_books_through_anything(void **state)
{
	struct fixture *fixture = *state;
	struct served *stores[] = { add_store(fixture, "a.ooc"), add_store(fixture, "b.ooc") };
	unsigned seed = 11;
	uint32_t full_count = 0;

	for (uint32_t step = 0; step < 60000; step++) {
		struct served *served = stores[rand_r(&seed) % 2];
		uint32_t index = (uint32_t)rand_r(&seed) % served->node_count;
		struct node *node = &served->nodes[index];
		bool begins = rand_r(&seed) % 2 == 0;
		int r;

		if (!served_has_payload(served, index))
			continue;
		switch (node->state) {
		case NODE_ABSENT:
			r = cache_begin_fill(&fixture->cache, served, index, 0, false);
			assert_true(r == 0 || r == -EAGAIN || r == -EBUSY || r == -ENOBUFS);
			full_count += r == -ENOBUFS;
			/* As when what is drained is not given up for too long. */
			if (r == -EBUSY && begins)
				fixture->cache.room_is_coming = false;
			break;
		case NODE_BUSY:
			if (begins)
				cache_hold(&fixture->cache, served, index);
			else if (node->hold_count == 0 && rand_r(&seed) % 4 == 0)
				cache_fail_fill(&fixture->cache, served, index, false);
			else
				cache_end_fill(&fixture->cache, served, index);
			break;
		case NODE_HELD:
			if (begins && node->hold_count < 3)
				cache_hold(&fixture->cache, served, index);
			else
				cache_release(&fixture->cache, served, index);
			break;
		case NODE_FREE:
			if (begins)
				cache_hold(&fixture->cache, served, index);
			break;
		case NODE_DAMAGED:
		case NODE_STATE_COUNT_:
			break;
		}
		if (step % 64 == 0)
			cache_check(&fixture->cache);
	}
	print_message("full %u times\n", full_count);
	for (uint32_t s = 0; s < 2; s++)
		for (uint32_t i = 0; i < stores[s]->node_count; i++) {
			if (stores[s]->nodes[i].state == NODE_BUSY)
				cache_end_fill(&fixture->cache, stores[s], i);
			while (stores[s]->nodes[i].hold_count > 0)
				cache_release(&fixture->cache, stores[s], i);
		}
}

int main(void)
{
#define CACHE_TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)
	const struct CMUnitTest tests[] = {
		CACHE_TEST(cache_evicts_what_was_unused_for_the_longest),
		CACHE_TEST(cache_keeps_what_is_held_and_evicts_around_it),
		CACHE_TEST(cache_counts_a_release_as_the_last_use),
		CACHE_TEST(cache_is_full_when_all_is_held_and_not_after_one_release),
		CACHE_TEST(cache_takes_memory_that_another_store_used_before),
		CACHE_TEST(cache_drains_a_segment_for_a_store_that_has_none),
		CACHE_TEST(cache_lives_with_the_memory_there_is),
		CACHE_TEST(cache_gives_back_segments_that_stay_empty),
		CACHE_TEST(cache_makes_room_among_payloads_of_many_sizes),
		CACHE_TEST(cache_keeps_its_books_through_anything),
	};

	return TEST_RUN(tests);
}
