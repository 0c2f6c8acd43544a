/* SPDX-License-Identifier: MIT */
/* Goal: pages.h keeps runs as its header says.  Method: random use beside a table of owners. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <stdlib.h>

#include "daemon/arena/pages.h"
#include "tests/helper.h"

#define PAGE_COUNT 1000u
#define STEPS      20000u

static uint32_t random_below(uint64_t *state, uint32_t bound)
{
	*state = *state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
	return (uint32_t)((*state >> 33) % bound);
}

static uint32_t longest_free(const uint32_t *owners)
{
	uint32_t longest = 0;
	uint32_t run = 0;

	for (uint32_t i = 0; i < PAGE_COUNT; i++) {
		run = owners[i] == PAGES_FREE ? run + 1 : 0;
		longest = run > longest ? run : longest;
	}
	return longest;
}

static void pages_agree_with_a_table_of_owners(void **state)
{
	uint32_t owners[PAGE_COUNT];
	uint32_t firsts[PAGE_COUNT];
	uint32_t taken_count = 0;
	uint64_t random = 1;
	struct pages *pages;

	(void)state;
	assert_int_equal(pages_create(PAGE_COUNT, &pages), 0);
	for (uint32_t i = 0; i < PAGE_COUNT; i++)
		owners[i] = PAGES_FREE;
	for (uint32_t step = 0; step < STEPS; step++) {
		uint32_t count = 1 + random_below(&random, random_below(&random, 8) ? 20 : 200);
		uint32_t longest = longest_free(owners);
		uint32_t first;

		assert_int_equal(pages_largest_free(pages), longest);
		if (taken_count > 0 && random_below(&random, 100) < 48) {
			uint32_t which = random_below(&random, taken_count);
			struct pages_run run = pages_run_at(pages, firsts[which]);

			for (uint32_t i = 0; i < run.count; i++) {
				assert_int_equal(owners[run.first + i], run.owner);
				owners[run.first + i] = PAGES_FREE;
			}
			pages_give(pages, run.first);
			firsts[which] = firsts[--taken_count];
		} else if (pages_take(pages, count, step, &first) == 0) {
			for (uint32_t i = 0; i < count; i++) {
				assert_int_equal(owners[first + i], PAGES_FREE);
				owners[first + i] = step;
			}
			firsts[taken_count++] = first;
		} else {
			/* Full is said exactly when no run is long enough. */
			assert_true(count > longest);
		}
		if (step % 16 == 0)
			pages_check(pages);
	}
	while (taken_count > 0)
		pages_give(pages, firsts[--taken_count]);
	assert_int_equal(pages_largest_free(pages), PAGE_COUNT);
	pages_destroy(pages);
}

static void pages_take_the_tightest_class(void **state)
{
	struct pages *pages;
	uint32_t hole;
	uint32_t wall;
	uint32_t first;

	(void)state;
	assert_int_equal(pages_create(100, &pages), 0);
	assert_int_equal(pages_take(pages, 5, 1, &hole), 0);
	assert_int_equal(pages_take(pages, 1, 2, &wall), 0);
	pages_give(pages, hole);
	assert_int_equal(pages_take(pages, 5, 3, &first), 0);
	assert_int_equal(first, hole);
	pages_destroy(pages);
}

static void pages_of_any_size_can_be_made_and_taken_whole(void **state)
{
	static const uint32_t counts[] = { 1, 2, 15, 16, 17, 31, 32, 4095, 65536, 1u << 24 };

	(void)state;
	for (size_t i = 0; i < sizeof(counts) / sizeof(counts[0]); i++) {
		struct pages *pages;
		uint32_t first = 1;

		assert_int_equal(pages_create(counts[i], &pages), 0);
		assert_int_equal(pages_take(pages, counts[i], 7, &first), 0);
		assert_int_equal(first, 0);
		assert_int_equal(pages_take(pages, 1, 7, &first), -ENOBUFS);
		assert_int_equal(pages_largest_free(pages), 0);
		pages_give(pages, 0);
		pages_check(pages);
		pages_destroy(pages);
	}
	assert_int_equal(pages_create(0, NULL), -EINVAL);
	assert_int_equal(pages_create((1u << 24) + 1, NULL), -EINVAL);
}

static void places_are_taken_again_in_ascending_order_only(void **state)
{
	struct pages *pages;
	uint32_t first;

	(void)state;
	assert_int_equal(pages_create(100, &pages), 0);
	assert_int_equal(pages_take_at(pages, 10, 5, 1), 0);
	assert_int_equal(pages_take_at(pages, 15, 5, 2), 0);
	/* Over what is taken, before it, and beyond the end. */
	assert_int_equal(pages_take_at(pages, 19, 1, 3), -ENOBUFS);
	assert_int_equal(pages_take_at(pages, 0, 1, 3), -ENOBUFS);
	assert_int_equal(pages_take_at(pages, 90, 11, 3), -ENOBUFS);
	assert_int_equal(pages_take_at(pages, 100, 1, 3), -ENOBUFS);
	assert_int_equal(pages_take_at(pages, UINT32_MAX - 1, 5, 3), -ENOBUFS);
	assert_int_equal(pages_take_at(pages, 90, 10, 3), 0);
	assert_int_equal(pages_take_at(pages, 95, 1, 4), -ENOBUFS);
	pages_check(pages);
	assert_int_equal(pages_free_count(pages), 80);
	/* What lies between is free for all. */
	assert_int_equal(pages_take(pages, 70, 5, &first), 0);
	assert_int_equal(first, 20);
	pages_give(pages, 15);
	pages_give(pages, 90);
	pages_check(pages);
	pages_destroy(pages);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(places_are_taken_again_in_ascending_order_only),
		cmocka_unit_test(pages_agree_with_a_table_of_owners),
		cmocka_unit_test(pages_take_the_tightest_class),
		cmocka_unit_test(pages_of_any_size_can_be_made_and_taken_whole),
	};

	return TEST_RUN(tests);
}
