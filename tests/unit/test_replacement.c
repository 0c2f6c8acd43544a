/* SPDX-License-Identifier: MIT */
/* Goal: a policy orders what may go, and nothing else; `reuse` learns what LRU cannot, or does as LRU does. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/cache/replacement.h"
#include "formats/base/bytes.h"
#include "tests/helper.h"

#define NODES 300u
#define ROOM  200u /* nodes of one page */

static void every_policy_has_a_name_by_which_it_is_found(void **state)
{
	enum replacement_policy found;

	(void)state;
	for (unsigned i = 0; i < REPLACEMENT_COUNT_; i++) {
		const char *name = replacement_name((enum replacement_policy)i);

		assert_int_equal(replacement_find(name, &found), 0);
		assert_int_equal(found, i);
	}
	assert_int_equal(replacement_find("random", &found), -EINVAL);
	assert_int_equal(replacement_find("", &found), -EINVAL);
}

static struct replacement *make(uint32_t node_count)
{
	struct replacement *replacement;

	assert_int_equal(replacement_create(REPLACEMENT_reuse, node_count, &replacement), 0);
	return replacement;
}

static void lru_needs_no_object(void **state)
{
	struct replacement *replacement;

	(void)state;
	assert_int_equal(replacement_create(REPLACEMENT_lru, NODES, &replacement), 0);
	assert_null(replacement);
	assert_null(replacement_destroy(replacement));
}

static void a_sample_is_of_what_may_go(void **state)
{
	struct replacement *replacement = make(NODES);
	uint32_t sample[NODES];

	(void)state;
	assert_int_equal(replacement_sample(replacement, sample, 8), 0);
	for (uint32_t i = 0; i < NODES; i++) {
		replacement_use(replacement, i, 1 + i % 7, ROOM);
		replacement_let_go(replacement, i, 1 + i % 7, true);
	}
	for (uint32_t i = 0; i < NODES; i += 3)
		replacement_use(replacement, i, 1 + i % 7, ROOM);
	for (uint32_t i = 1; i < NODES; i += 3)
		replacement_evict(replacement, i);
	replacement_check(replacement);
	assert_int_equal(replacement_count(replacement), NODES / 3);
	for (uint32_t tries = 0; tries < 100; tries++) {
		assert_int_equal(replacement_sample(replacement, sample, 8), 8);
		for (uint32_t i = 0; i < 8; i++) {
			assert_int_equal(sample[i] % 3, 2);
			assert_true(replacement_has(replacement, sample[i]));
			assert_true(replacement_worth(replacement, sample[i]) > 0);
		}
	}
	/* Few are all told, once each. */
	assert_int_equal(replacement_sample(replacement, sample, NODES), NODES / 3);
	replacement_destroy(replacement);
}

static void what_nothing_is_known_of_is_worth_less_the_older_it_is(void **state)
{
	struct replacement *replacement = make(NODES);

	(void)state;
	for (uint32_t i = 0; i < 20; i++)
		replacement_let_go(replacement, i, 3, true);
	for (uint32_t i = 1; i < 20; i++)
		assert_true(replacement_worth(replacement, i - 1) <
			    replacement_worth(replacement, i));
	assert_true(replacement_lru_worth(5) < replacement_lru_worth(4));
	replacement_destroy(replacement);
}

static void what_could_not_be_had_is_imagined_nowhere(void **state)
{
	struct replacement *replacement = make(NODES);

	(void)state;
	replacement_use(replacement, 0, 3, ROOM);
	replacement_fail(replacement, 0);
	/* Of another size: the counts would no longer agree if it were still there. */
	replacement_let_go(replacement, 1, 3, false);
	replacement_use(replacement, 0, 5, ROOM);
	replacement_check(replacement);
	replacement_destroy(replacement);
}

/* A cache of ROOM nodes that asks the policy, or LRU (NULL).  Nodes are used and let go at once. */
struct toy {
	struct replacement *replacement;
	bool is_there[NODES];
	uint64_t used_at[NODES];
	uint64_t clock;
	uint32_t there_count;
	uint32_t hits;
};

static uint32_t toy_victim(struct toy *toy)
{
	uint32_t sample[NODES];
	uint32_t count;
	uint32_t worst = UINT32_MAX;

	if (replacement_is_lru(toy->replacement)) {
		for (uint32_t i = 0; i < NODES; i++)
			if (toy->is_there[i] &&
			    (worst == UINT32_MAX || toy->used_at[i] < toy->used_at[worst]))
				worst = i;
	} else {
		count = replacement_sample(toy->replacement, sample, NODES);
		worst = sample[0];
		for (uint32_t i = 1; i < count; i++)
			if (replacement_worth(toy->replacement, sample[i]) <
			    replacement_worth(toy->replacement, worst))
				worst = sample[i];
	}
	if (toy->replacement)
		replacement_evict(toy->replacement, worst);
	return worst;
}

static void toy_use(struct toy *toy, uint32_t node)
{
	toy->hits += toy->is_there[node];
	if (!toy->is_there[node] && toy->there_count == ROOM) {
		toy->is_there[toy_victim(toy)] = false;
		toy->there_count--;
	}
	toy->there_count += !toy->is_there[node];
	toy->is_there[node] = true;
	toy->used_at[node] = ++toy->clock;
	if (!toy->replacement)
		return;
	replacement_use(toy->replacement, node, 1, ROOM);
	replacement_let_go(toy->replacement, node, 1, true);
}

static uint32_t hits_of_loops(struct replacement *replacement, uint32_t laps)
{
	struct toy toy = { .replacement = replacement };

	for (uint32_t i = 0; i < laps * NODES; i++)
		toy_use(&toy, i % NODES);
	return toy.hits;
}

static void a_loop_larger_than_the_cache_has_hits(void **state)
{
	struct replacement *replacement = make(NODES);
	uint32_t hits = hits_of_loops(replacement, 20);

	(void)state;
	assert_int_equal(hits_of_loops(NULL, 20), 0);
	/* Of the 18 laps after the two that teach, the best have ROOM - 1 hits in NODES - 1 uses. */
	assert_true(hits >= 18 * NODES * (ROOM - 1) / (NODES - 1) * 3 / 4);
	replacement_check(replacement);
	replacement_destroy(replacement);
}

/* Nodes around a place that moves on: what was seen just now is seen again, what lies behind is not. */
static uint32_t hits_of_a_walk(struct replacement *replacement)
{
	struct toy toy = { .replacement = replacement };
	uint32_t random = 1;

	for (uint32_t i = 0; i < 30 * NODES; i++) {
		random = random * 1664525u + 1013904223u;
		toy_use(&toy, (i / 30 + (random >> 16) % 150) % NODES);
	}
	return toy.hits;
}

static void a_walk_has_the_hits_that_it_has_with_lru(void **state)
{
	struct replacement *replacement = make(NODES);
	uint32_t hits = hits_of_a_walk(replacement);

	(void)state;
	assert_true(hits + hits / 100 >= hits_of_a_walk(NULL));
	replacement_check(replacement);
	replacement_destroy(replacement);
}

static void lru_leads_until_it_would_have_read_more(void **state)
{
	struct replacement *replacement = make(NODES);

	(void)state;
	assert_true(replacement_is_lru(NULL));
	assert_true(replacement_is_lru(replacement));
	/* While all is read for the first time none is better. */
	(void)hits_of_loops(replacement, 1);
	assert_true(replacement_is_lru(replacement));
	(void)hits_of_loops(replacement, 4);
	assert_false(replacement_is_lru(replacement));
	replacement_destroy(replacement);
}

static void the_same_calls_have_the_same_answers(void **state)
{
	struct replacement *first = make(NODES);
	struct replacement *second = make(NODES);

	(void)state;
	assert_int_equal(hits_of_loops(first, 5), hits_of_loops(second, 5));
	for (uint32_t i = 0; i < NODES; i++)
		assert_int_equal(replacement_worth(first, i), replacement_worth(second, i));
	replacement_destroy(first);
	replacement_destroy(second);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(every_policy_has_a_name_by_which_it_is_found),
		cmocka_unit_test(lru_needs_no_object),
		cmocka_unit_test(a_sample_is_of_what_may_go),
		cmocka_unit_test(what_nothing_is_known_of_is_worth_less_the_older_it_is),
		cmocka_unit_test(what_could_not_be_had_is_imagined_nowhere),
		cmocka_unit_test(a_loop_larger_than_the_cache_has_hits),
		cmocka_unit_test(a_walk_has_the_hits_that_it_has_with_lru),
		cmocka_unit_test(lru_leads_until_it_would_have_read_more),
		cmocka_unit_test(the_same_calls_have_the_same_answers),
	};

	return TEST_RUN(tests);
}
