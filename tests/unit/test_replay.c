/* SPDX-License-Identifier: MIT */
/*
 * Goal: a replay reads what the daemon's cache would read, and the bounds are bounds.
 * Method: random traces, written and read as real ones; LRU and the best possible by brute force.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <fcntl.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/trace/trace_writer.h"
#include "tests/helper.h"
#include "tools/bench/replay/bound.h"
#include "tools/bench/replay/replay_cache.h"

#define NODES_MAX   400u
#define VIEWERS_MAX 4u

static uint32_t random_state;

static uint32_t random_below(uint32_t bound)
{
	random_state = random_state * 1664525u + 1013904223u;
	return (random_state >> 8) % bound;
}

/* What a random trace is like. */
struct kind {
	uint32_t node_count;
	uint32_t viewer_count;
	uint32_t set_count;
	uint32_t want_count; /* of a set */
	uint32_t page_max;   /* 1: all alike */
	uint32_t stride;     /* by which a viewer's sets move on; 0: anywhere */
};

static void add(struct trace_writer *writer, struct trace_event event)
{
	trace_writer_add(writer, &event);
}

static void add_set(struct trace_writer *writer, const struct kind *kind, uint32_t viewer,
		    uint32_t number, bool *wanted)
{
	bool wants[NODES_MAX] = { false };

	for (uint32_t i = 0; i < kind->want_count; i++)
		wants[kind->stride ? (number * kind->stride + i + 50 * viewer) % kind->node_count
				   : random_below(kind->node_count)] = true;
	add(writer, (struct trace_event){ .kind = TRACE_SET, .session = viewer });
	for (uint32_t i = 0; i < kind->node_count; i++)
		if (wants[i] && !wanted[i])
			add(writer, (struct trace_event){
					    .kind = TRACE_MISS, .session = viewer, .entry = i });
	for (uint32_t i = 0; i < kind->node_count; i++)
		if (!wants[i] && wanted[i])
			add(writer, (struct trace_event){
					    .kind = TRACE_DROP, .session = viewer, .entry = i });
	memcpy(wanted, wants, sizeof(wants));
}

static void make_schedule(const char *folder, const struct kind *kind, struct schedule *ret)
{
	static bool wanted[VIEWERS_MAX][NODES_MAX];
	const char *path = test_path(folder, "a.trace");
	const struct trace_header header = { .cache_bytes = MIB };
	struct trace_writer *writer;
	struct why why;

	memset(wanted, 0, sizeof(wanted));
	assert_int_equal(
		trace_writer_create(open(path, O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0600),
				    &header, &writer, &why),
		0);
	add(writer, (struct trace_event){ .kind = TRACE_OPEN, .count = NODES_MAX, .path = "" });
	for (uint32_t i = 0; i < kind->node_count; i++) {
		uint32_t pages = 1 + random_below(kind->page_max);

		add(writer, (struct trace_event){ .kind = TRACE_NODE,
						  .node = i,
						  .pages = pages,
						  .bytes = pages * 4000 + 1 });
	}
	for (uint32_t i = 0; i < kind->set_count; i++)
		add_set(writer, kind, i % kind->viewer_count, i / kind->viewer_count,
			wanted[i % kind->viewer_count]);
	trace_writer_destroy(writer);
	if (schedule_read(path, ret, &why) < 0)
		fail_msg("%s", why.text);
}

static struct replay_result replay(const struct schedule *schedule, enum replacement_policy policy,
				   uint64_t cache_pages)
{
	struct replay_result result;
	struct why why;

	if (replay_cache(schedule, policy, cache_pages * TRACE_PAGE_BYTES, &result, &why) < 0)
		fail_msg("%s", why.text);
	assert_int_equal(result.hit_count + result.miss_count, schedule->want_count);
	return result;
}

static const struct kind kinds[] = {
	{ .node_count = 300, .viewer_count = 1, .set_count = 300, .want_count = 30, .page_max = 1 },
	{ .node_count = 300, .viewer_count = 3, .set_count = 400, .want_count = 20, .page_max = 1 },
	{ .node_count = 200, .viewer_count = 1, .set_count = 300, .want_count = 9, .page_max = 20 },
	{ .node_count = 200, .viewer_count = 4, .set_count = 400, .want_count = 5, .page_max = 20 },
	{ .node_count = 300,
	  .viewer_count = 1,
	  .set_count = 400,
	  .want_count = 20,
	  .page_max = 9,
	  .stride = 5 },
	{ .node_count = 300,
	  .viewer_count = 4,
	  .set_count = 400,
	  .want_count = 9,
	  .page_max = 9,
	  .stride = 3 },
};

static void no_cache_reads_less_than_the_bounds(void **state)
{
	for (size_t k = 0; k < ARRAY_LENGTH(kinds); k++) {
		struct schedule schedule;
		struct gaps gaps;

		random_state = (uint32_t)k + 1;
		make_schedule(*state, &kinds[k], &schedule);
		assert_int_equal(gaps_make(&schedule, &gaps), 0);
		for (uint32_t pages = 256; pages <= 1024; pages *= 2) {
			bool fits = gaps.wanted_pages_max <= pages;
			double belady;
			double pfoo;
			double foo;

			for (unsigned i = 0; i < REPLACEMENT_COUNT_; i++)
				fits = fits && replay(&schedule, i, pages).refused_count == 0;
			assert_int_equal(bound_belady(&schedule, pages, &belady), 0);
			assert_int_equal(bound_pfoo(&gaps, pages, fits, &pfoo), 0);
			assert_int_equal(bound_foo(&gaps, pages, fits, &foo), 0);
			assert_true(pfoo >= (double)gaps.compulsory_bytes - 1);
			assert_true(foo >= pfoo - 1);
			assert_true(belady >= foo - 1);
			for (unsigned i = 0; i < REPLACEMENT_COUNT_; i++)
				assert_true((double)replay(&schedule, i, pages).read_bytes >=
					    foo - 1);
		}
		gaps_done(&gaps);
		schedule_done(&schedule);
	}
}

static void a_cache_for_all_reads_what_is_compulsory(void **state)
{
	for (size_t k = 0; k < ARRAY_LENGTH(kinds); k++) {
		struct schedule schedule;
		struct gaps gaps;
		double bytes;

		random_state = (uint32_t)k + 10;
		make_schedule(*state, &kinds[k], &schedule);
		assert_int_equal(gaps_make(&schedule, &gaps), 0);
		for (unsigned i = 0; i < REPLACEMENT_COUNT_; i++) {
			struct replay_result result = replay(&schedule, i, 16384);

			assert_int_equal(result.read_bytes, gaps.compulsory_bytes);
			assert_int_equal(result.eviction_count, 0);
		}
		assert_int_equal(bound_belady(&schedule, 16384, &bytes), 0);
		assert_true(bytes == (double)gaps.compulsory_bytes);
		assert_int_equal(bound_foo(&gaps, 16384, true, &bytes), 0);
		assert_true(bytes == (double)gaps.compulsory_bytes);
		gaps_done(&gaps);
		schedule_done(&schedule);
	}
}

/* What LRU reads, as simply as it can be said: all are of one page. */
static uint64_t lru_by_brute_force(const struct schedule *schedule, uint32_t cache_pages)
{
	uint32_t want_counts[NODES_MAX] = { 0 };
	bool is_there[NODES_MAX] = { false };
	uint64_t let_go[NODES_MAX] = { 0 };
	uint32_t there_count = 0;
	uint64_t clock = 0;
	uint64_t bytes = 0;
	uint64_t begin = 0;

	for (uint64_t i = 0; i < schedule->op_count; i++) {
		uint32_t entry = schedule_entry_of(schedule->ops[i]);

		if (schedule_op_of(schedule->ops[i]) == SCHEDULE_DROP) {
			if (--want_counts[entry] == 0)
				let_go[entry] = ++clock;
			continue;
		}
		if (schedule_op_of(schedule->ops[i]) == SCHEDULE_WANT) {
			want_counts[entry]++;
			continue;
		}
		for (; begin < i; begin++) {
			uint32_t oldest = UINT32_MAX;

			entry = schedule_entry_of(schedule->ops[begin]);
			if (schedule_op_of(schedule->ops[begin]) != SCHEDULE_WANT ||
			    is_there[entry])
				continue;
			bytes += schedule->entries[entry].bytes;
			for (uint32_t k = 0; k < schedule->entry_count; k++)
				if (is_there[k] && want_counts[k] == 0 &&
				    (oldest == UINT32_MAX || let_go[k] < let_go[oldest]))
					oldest = k;
			if (there_count == cache_pages) {
				assert_true(oldest != UINT32_MAX);
				is_there[oldest] = false;
				there_count--;
			}
			is_there[entry] = true;
			there_count++;
		}
	}
	return bytes;
}

static void lru_reads_what_brute_force_says_it_reads(void **state)
{
	for (size_t k = 0; k < 2; k++) {
		struct schedule schedule;

		random_state = (uint32_t)k + 20;
		make_schedule(*state, &kinds[k], &schedule);
		for (uint32_t pages = 64; pages <= 256; pages += 32)
			assert_int_equal(replay(&schedule, REPLACEMENT_lru, pages).read_bytes,
					 lru_by_brute_force(&schedule, pages));
		schedule_done(&schedule);
	}
}

/* ---- the best possible, of few nodes ---- */

#define FEW_NODES 7u
#define FEW_SETS  14u
#define FEW_KEEPS (1u << FEW_NODES)

static bool may_keep(const struct schedule *schedule, uint32_t keep, uint32_t wanted,
		     uint32_t cache_pages)
{
	uint32_t pages = 0;

	for (uint32_t i = 0; i < schedule->entry_count; i++)
		pages += keep >> i & 1 ? schedule->entries[i].pages : 0;
	return (keep & wanted) == wanted && pages <= cache_pages;
}

static uint64_t bytes_of(const struct schedule *schedule, uint32_t nodes)
{
	uint64_t bytes = 0;

	for (uint32_t i = 0; i < schedule->entry_count; i++)
		bytes += nodes >> i & 1 ? schedule->entries[i].bytes : 0;
	return bytes;
}

/* The least that can be read: after each step, for every part of the nodes that may be kept. */
static uint64_t best_possible(const struct schedule *schedule, uint32_t cache_pages)
{
	uint64_t best[FEW_KEEPS];
	uint64_t least = UINT64_MAX;
	uint32_t wanted = 0;

	memset(best, 0xff, sizeof(best));
	best[0] = 0;
	for (uint64_t i = 0; i < schedule->op_count; i++) {
		uint32_t bit = 1u << schedule_entry_of(schedule->ops[i]);
		uint64_t next[FEW_KEEPS];

		if (schedule_op_of(schedule->ops[i]) == SCHEDULE_DROP)
			wanted &= ~bit;
		if (schedule_op_of(schedule->ops[i]) == SCHEDULE_WANT)
			wanted |= bit;
		if (schedule_op_of(schedule->ops[i]) != SCHEDULE_STEP)
			continue;
		memset(next, 0xff, sizeof(next));
		for (uint32_t from = 0; from < FEW_KEEPS; from++)
			for (uint32_t to = 0; to < FEW_KEEPS && best[from] < UINT64_MAX; to++)
				if ((to & ~(from | wanted)) == 0 &&
				    may_keep(schedule, to, wanted, cache_pages))
					next[to] = u64_min(
						next[to],
						best[from] + bytes_of(schedule, wanted & ~from));
		memcpy(best, next, sizeof(best));
	}
	for (uint32_t keep = 0; keep < FEW_KEEPS; keep++)
		least = u64_min(least, best[keep]);
	return least;
}

static void the_bounds_are_below_the_best_possible_and_belady_above(void **state)
{
	const struct kind kind = { .node_count = FEW_NODES,
				   .viewer_count = 1,
				   .set_count = FEW_SETS,
				   .want_count = 2,
				   .page_max = 4 };
	unsigned tight_count = 0;

	for (uint32_t seed = 0; seed < 40; seed++) {
		struct schedule schedule;
		struct gaps gaps;
		uint64_t best;
		double belady;
		double pfoo;
		double foo;

		random_state = 100 + seed;
		make_schedule(*state, &kind, &schedule);
		assert_int_equal(gaps_make(&schedule, &gaps), 0);
		best = best_possible(&schedule, 11);
		assert_int_equal(bound_belady(&schedule, 11, &belady), 0);
		assert_int_equal(bound_pfoo(&gaps, 11, true, &pfoo), 0);
		assert_int_equal(bound_foo(&gaps, 11, true, &foo), 0);
		assert_true(pfoo <= foo + 1);
		assert_true(foo <= (double)best + 1);
		assert_true(belady >= (double)best - 1);
		tight_count += foo > 0.75 * (double)best;
		gaps_done(&gaps);
		schedule_done(&schedule);
	}
	/* A bound of nothing would be one, too. */
	assert_true(tight_count > 20);
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, test_folder_setup, test_folder_teardown)
	const struct CMUnitTest tests[] = {
		TEST(no_cache_reads_less_than_the_bounds),
		TEST(a_cache_for_all_reads_what_is_compulsory),
		TEST(lru_reads_what_brute_force_says_it_reads),
		TEST(the_bounds_are_below_the_best_possible_and_belady_above),
	};

	return TEST_RUN(tests);
}
