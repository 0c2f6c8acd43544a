/* SPDX-License-Identifier: MIT */
/* Goal: segments are what memfile.h and arena.h promise, and windows are the best there are. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "daemon/arena/arena.h"
#include "formats/base/bytes.h"
#include "formats/base/file.h"
#include "tests/helper.h"

#define SEGMENT_BYTES (64u * KIB)
#define SEGMENT_PAGES (SEGMENT_BYTES / WIRE_PAGE_BYTES)
#define OWNERS_MAX    4096u
#define NO_OTHER_USER 77

static struct memfile published(uint64_t bytes)
{
	struct memfile memfile;
	struct why why;

	assert_int_equal(memfile_create("test", bytes, false, &memfile, &why), 0);
	assert_int_equal(memfile_publish(&memfile, MEMFILE_CHANGING, &why), 0);
	return memfile;
}

static struct arena *arena_with(uint32_t segment_count)
{
	struct arena *arena = malloc(sizeof(*arena));

	arena_init(arena, SEGMENT_BYTES);
	for (uint32_t i = 0; i < segment_count; i++) {
		struct memfile memfile = published(SEGMENT_BYTES);
		struct segment *segment;

		assert_int_equal(arena_add(arena, &memfile, &segment), 0);
	}
	return arena;
}

static void arena_free(struct arena *arena)
{
	arena_done(arena);
	free(arena);
}

static void memory_of_a_client_cannot_be_written_by_another_user(void **state)
{
	struct memfile memfile = published(SEGMENT_BYTES);
	pid_t child;
	int way;

	(void)state;
	memset(memfile.base, 7, memfile.bytes);
	child = test_fork();
	if (child == 0)
		_exit(test_become_other_user() ? test_write_in_every_way(memfile.read_fd)
					       : NO_OTHER_USER);
	way = test_wait(child);
	for (size_t i = 0; i < memfile.bytes; i++)
		assert_int_equal(((const uint8_t *)memfile.base)[i], 7);
	memfile_done(&memfile);
	if (way == NO_OTHER_USER) {
		print_message("not root: no other user to be\n");
		skip();
	}
	assert_int_equal(way, 0);
}

static void memory_cannot_be_resized_by_anyone(void **state)
{
	struct memfile memfile = published(SEGMENT_BYTES);

	(void)state;
	assert_int_equal(ftruncate(memfile.fd, 0), -1);
	assert_int_equal(ftruncate(memfile.fd, 1 << 20), -1);
	memfile_done(&memfile);
}

static void memory_of_fixed_content_cannot_be_written_by_anyone(void **state)
{
	struct memfile memfile;
	struct why why;

	(void)state;
	assert_int_equal(memfile_create("test", 100, false, &memfile, &why), 0);
	memset(memfile.base, 9, 100);
	assert_int_equal(memfile_publish(&memfile, MEMFILE_FIXED, &why), 0);
	assert_int_equal(((uint8_t *)memfile.base)[99], 9);
	assert_int_equal(pwrite(memfile.fd, "x", 1, 0), -1);
	assert_ptr_equal(mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_SHARED, memfile.fd, 0),
			 MAP_FAILED);
	memfile_done(&memfile);
}

static void memory_is_populated_and_given_back_although_clients_map_it(void **state)
{
	struct memfile memfile = published(SEGMENT_BYTES);
	int fd = dup(memfile.read_fd);
	struct stat status;
	void *map;

	(void)state;
	map = mmap(NULL, SEGMENT_BYTES, PROT_READ, MAP_SHARED, fd, 0);
	assert_ptr_not_equal(map, MAP_FAILED);
	assert_int_equal(fstat(fd, &status), 0);
	assert_true((uint64_t)status.st_blocks * 512 >= SEGMENT_BYTES);
	memfile_reclaim(&memfile);
	memfile_done(&memfile);
	assert_int_equal(fstat(fd, &status), 0);
	assert_int_equal(status.st_blocks, 0);
	(void)munmap(map, SEGMENT_BYTES);
	(void)close(fd);
}

static void arena_takes_segment_numbers_in_a_circle(void **state)
{
	struct arena *arena = arena_with(2);

	(void)state;
	for (uint32_t i = 2; i < WIRE_SEGMENT_COUNT_MAX + 3; i++) {
		struct memfile memfile = published(SEGMENT_BYTES);
		struct segment *segment;
		uint32_t expected = i % WIRE_SEGMENT_COUNT_MAX;

		assert_int_equal(arena_add(arena, &memfile, &segment), 0);
		/* Segments 0 and 1 are still there. */
		if (i >= WIRE_SEGMENT_COUNT_MAX)
			expected += 2;
		assert_int_equal(segment->number, expected);
		arena_remove(arena, segment->number);
	}
	arena_check(arena);
	arena_free(arena);
}

static void arena_skips_a_segment_that_is_drained(void **state)
{
	struct arena *arena = arena_with(2);
	struct place place;

	(void)state;
	arena->by_number[0]->draining = true;
	assert_int_equal(arena_take(arena, SEGMENT_PAGES, 1, &place), 0);
	assert_int_equal(place.segment, 1);
	assert_int_equal(arena_take(arena, 1, 2, &place), -ENOBUFS);
	arena_free(arena);
}

static void arena_fragmentation_is_none_when_whole_and_most_when_in_dust(void **state)
{
	struct arena *arena = arena_with(2);
	struct place places[2 * SEGMENT_PAGES];

	(void)state;
	assert_true(arena_fragmentation(arena) == 0.0);
	for (uint32_t i = 0; i < ARRAY_LENGTH(places); i++)
		assert_int_equal(arena_take(arena, 1, i, &places[i]), 0);
	for (uint32_t i = 0; i < ARRAY_LENGTH(places); i += 2)
		arena_give(arena, places[i]);
	assert_true(arena_fragmentation(arena) > 0.8);
	arena_free(arena);
}

/* ---- windows ---- */

static uint64_t costs[OWNERS_MAX];

static uint64_t cost_of(void *arg, uint32_t owner)
{
	(void)arg;
	return costs[owner];
}

/* The cost of the best window, by trying every beginning and end. */
static uint64_t best_by_force(const struct arena *arena, uint32_t page_count)
{
	uint64_t best = ARENA_NEVER;

	LIST_FOR_EACH (link, &arena->in_order) {
		const struct pages *pages = ARENA_SEGMENT(link)->pages;

		for (uint32_t first = 0; first < SEGMENT_PAGES;
		     first += pages_run_at(pages, first).count) {
			uint64_t sum = 0;
			uint32_t end = first;

			while (end < SEGMENT_PAGES && end - first < page_count) {
				struct pages_run run = pages_run_at(pages, end);

				if (run.owner != PAGES_FREE && sum != ARENA_NEVER)
					sum = costs[run.owner] == ARENA_NEVER
						      ? ARENA_NEVER
						      : sum + costs[run.owner];
				end += run.count;
			}
			if (end - first >= page_count)
				best = u64_min(best, sum);
		}
	}
	return best;
}

static void arena_window_is_the_cheapest_there_is(void **state)
{
	unsigned seed = 5;

	(void)state;
	for (unsigned round = 0; round < 200; round++) {
		struct arena *arena = arena_with(3);
		uint32_t owner_count = 0;
		struct place place;

		while (arena_take(arena, 1 + (uint32_t)rand_r(&seed) % 4, owner_count, &place) == 0)
			costs[owner_count++] = rand_r(&seed) % 4 == 0
						       ? ARENA_NEVER
						       : 1 + (uint64_t)(rand_r(&seed) % 100);
		for (uint32_t page_count = 1; page_count <= SEGMENT_PAGES; page_count++) {
			uint64_t best = best_by_force(arena, page_count);
			struct window window = { 0 };
			int r = arena_window_best(arena, page_count, cost_of, NULL, &window);

			assert_int_equal(r, best == ARENA_NEVER ? -ENOBUFS : 0);
			if (r < 0)
				continue;
			assert_true(window.cost == best);
			assert_true(window.page_count >= page_count);
		}
		arena_free(arena);
	}
}

static void arena_windows_are_found_as_soon_as_their_nodes_are_let_go(void **state)
{
	unsigned seed = 6;

	(void)state;
	for (unsigned round = 0; round < 200; round++) {
		struct arena *arena = arena_with(3);
		struct place places[OWNERS_MAX];
		uint32_t counts[OWNERS_MAX];
		uint32_t owner_count = 0;

		do {
			counts[owner_count] = 1 + (uint32_t)rand_r(&seed) % 4;
			costs[owner_count] = ARENA_NEVER;
		} while (arena_take(arena, counts[owner_count], owner_count,
				    &places[owner_count]) == 0 &&
			 ++owner_count > 0);
		for (uint32_t i = 0; i < owner_count; i++) {
			uint32_t owner = (uint32_t)rand_r(&seed) % owner_count;
			uint32_t page_count = 1 + (uint32_t)rand_r(&seed) % SEGMENT_PAGES;
			uint64_t best;
			struct window window;

			if (costs[owner] == ARENA_NEVER) {
				costs[owner] = 1 + (uint64_t)(rand_r(&seed) % 100);
				arena_note_let_go(arena->by_number[places[owner].segment],
						  counts[owner]);
			}
			best = best_by_force(arena, page_count);
			assert_int_equal(
				arena_window_best(arena, page_count, cost_of, NULL, &window),
				best == ARENA_NEVER ? -ENOBUFS : 0);
			assert_true(best == ARENA_NEVER || window.cost == best);
		}
		arena_free(arena);
	}
}

static void arena_window_around_a_place_holds_it_and_only_what_may_go(void **state)
{
	struct arena *arena = arena_with(1);
	struct place places[SEGMENT_PAGES];
	struct window window;

	(void)state;
	for (uint32_t i = 0; i < SEGMENT_PAGES; i++) {
		assert_int_equal(arena_take(arena, 1, i, &places[i]), 0);
		costs[i] = 100 + i;
	}
	costs[4] = ARENA_NEVER;
	costs[9] = ARENA_NEVER;
	assert_int_equal(arena_window_around(arena, places[6], 3, cost_of, NULL, &window), 0);
	assert_int_equal(window.first, places[5].page);
	assert_int_equal(window.page_count, 3);
	assert_int_equal(window.cost, 105 + 106 + 107);
	assert_int_equal(arena_window_around(arena, places[6], 5, cost_of, NULL, &window),
			 -ENOBUFS);
	assert_int_equal(arena_window_around(arena, places[4], 1, cost_of, NULL, &window),
			 -ENOBUFS);
	arena_free(arena);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(memory_of_a_client_cannot_be_written_by_another_user),
		cmocka_unit_test(memory_cannot_be_resized_by_anyone),
		cmocka_unit_test(memory_of_fixed_content_cannot_be_written_by_anyone),
		cmocka_unit_test(memory_is_populated_and_given_back_although_clients_map_it),
		cmocka_unit_test(arena_takes_segment_numbers_in_a_circle),
		cmocka_unit_test(arena_skips_a_segment_that_is_drained),
		cmocka_unit_test(arena_fragmentation_is_none_when_whole_and_most_when_in_dust),
		cmocka_unit_test(arena_window_is_the_cheapest_there_is),
		cmocka_unit_test(arena_windows_are_found_as_soon_as_their_nodes_are_let_go),
		cmocka_unit_test(arena_window_around_a_place_holds_it_and_only_what_may_go),
	};

	return TEST_RUN(tests);
}
