/* SPDX-License-Identifier: MIT */
#include "daemon/arena/arena.h"

#include <errno.h>
#include <stdlib.h>
#include <sys/stat.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"

static uint32_t segment_pages(const struct arena *arena)
{
	return (uint32_t)(arena->segment_bytes / WIRE_PAGE_BYTES);
}

void arena_init(struct arena *arena, uint64_t segment_bytes)
{
	CHECK(segment_bytes >= WIRE_PAGE_BYTES);
	CHECK(segment_bytes <= (uint64_t)WIRE_SEGMENT_PAGES_MAX * WIRE_PAGE_BYTES);
	CHECK((segment_bytes & (segment_bytes - 1)) == 0);
	*arena = (struct arena){ .segment_bytes = segment_bytes };
	list_init(&arena->in_order);
}

static void segment_destroy(struct segment *segment)
{
	pages_destroy(segment->pages);
	memfile_done(&segment->memfile);
	free(segment);
}

void arena_done(struct arena *arena)
{
	LIST_FOR_EACH (link, &arena->in_order) {
		list_remove(link);
		segment_destroy(ARENA_SEGMENT(link));
	}
}

static int add_segment(struct arena *arena, struct memfile *memfile, uint32_t number,
		       struct segment **ret)
{
	struct segment *segment = calloc(1, sizeof(*segment));
	int r;

	CHECK(memfile->bytes == arena->segment_bytes);
	if (!segment)
		return -ENOMEM;
	r = pages_create(segment_pages(arena), &segment->pages);
	if (r < 0) {
		free(segment);
		return r;
	}
	segment->number = number;
	segment->window_max = segment_pages(arena);
	segment->memfile = *memfile;
	*memfile = MEMFILE_NONE;
	arena->by_number[number] = segment;
	list_push_back(&arena->in_order, &segment->link);
	arena->segment_count++;
	*ret = segment;
	return 0;
}

int arena_add(struct arena *arena, struct memfile *memfile, struct segment **ret)
{
	int r;

	if (arena->segment_count == WIRE_SEGMENT_COUNT_MAX)
		return -EMFILE;
	while (arena->by_number[arena->next_number])
		arena->next_number = (arena->next_number + 1) % WIRE_SEGMENT_COUNT_MAX;
	r = add_segment(arena, memfile, arena->next_number, ret);
	if (r == 0)
		arena->next_number = (arena->next_number + 1) % WIRE_SEGMENT_COUNT_MAX;
	return r;
}

int arena_adopt(struct arena *arena, struct memfile *memfile, uint32_t number, struct segment **ret)
{
	int r;

	CHECK(number < WIRE_SEGMENT_COUNT_MAX);
	if (arena->by_number[number])
		return -EEXIST;
	r = add_segment(arena, memfile, number, ret);
	if (r == 0 && number >= arena->next_number)
		arena->next_number = (number + 1) % WIRE_SEGMENT_COUNT_MAX;
	return r;
}

void arena_remove(struct arena *arena, uint32_t number)
{
	struct segment *segment = arena->by_number[number];

	CHECK(segment != NULL);
	CHECK(pages_free_count(segment->pages) == segment_pages(arena));
	arena->by_number[number] = NULL;
	list_remove(&segment->link);
	arena->segment_count--;
	memfile_reclaim(&segment->memfile);
	segment_destroy(segment);
}

int arena_take(struct arena *arena, uint32_t page_count, uint32_t owner, struct place *ret)
{
	LIST_FOR_EACH (link, &arena->in_order) {
		struct segment *segment = ARENA_SEGMENT(link);
		uint32_t page;

		if (segment->draining)
			continue;
		if (pages_take(segment->pages, page_count, owner, &page) < 0)
			continue;
		segment->empty_since_ns = 0;
		arena->used_pages += page_count;
		*ret = (struct place){ segment->number, page };
		return 0;
	}
	return -ENOBUFS;
}

int arena_take_at(struct arena *arena, struct place place, uint32_t page_count, uint32_t owner)
{
	struct segment *segment = arena->by_number[place.segment];

	if (!segment || pages_take_at(segment->pages, place.page, page_count, owner) < 0)
		return -ENOBUFS;
	segment->empty_since_ns = 0;
	arena->used_pages += page_count;
	return 0;
}

void arena_give(struct arena *arena, struct place place)
{
	struct segment *segment = arena->by_number[place.segment];

	CHECK(segment != NULL);
	arena->used_pages -= pages_run_at(segment->pages, place.page).count;
	pages_give(segment->pages, place.page);
}

uint8_t *arena_address(const struct arena *arena, struct place place)
{
	CHECK(arena->by_number[place.segment] != NULL);
	return (uint8_t *)arena->by_number[place.segment]->memfile.base +
	       (size_t)place.page * WIRE_PAGE_BYTES;
}

uint64_t arena_bytes(const struct arena *arena)
{
	return arena->segment_count * arena->segment_bytes;
}

uint64_t arena_huge_bytes(const struct arena *arena)
{
	uint64_t bytes = 0;

	LIST_FOR_EACH (link, &arena->in_order)
		bytes += ARENA_SEGMENT(link)->memfile.huge_bytes;
	return bytes;
}

uint64_t arena_memory_bytes(const struct arena *arena)
{
	uint64_t bytes = 0;

	LIST_FOR_EACH (link, &arena->in_order) {
		struct stat status;

		if (fstat(ARENA_SEGMENT(link)->memfile.read_fd, &status) == 0)
			bytes += (uint64_t)status.st_blocks * 512;
	}
	return bytes;
}

uint64_t arena_free_pages(const struct arena *arena)
{
	return arena_bytes(arena) / WIRE_PAGE_BYTES - arena->used_pages;
}

double arena_fragmentation(const struct arena *arena)
{
	uint64_t free_pages = arena_free_pages(arena);
	uint64_t whole_pages = 0;

	if (free_pages == 0)
		return 0.0;
	LIST_FOR_EACH (link, &arena->in_order)
		whole_pages += pages_largest_free(ARENA_SEGMENT(link)->pages);
	return 1.0 - (double)whole_pages / (double)free_pages;
}

static uint64_t run_cost(struct pages_run run, arena_cost_fn cost, void *arg)
{
	return run.owner == PAGES_FREE ? 0 : cost(arg, run.owner);
}

static uint64_t add_cost(uint64_t a, uint64_t b)
{
	return a == ARENA_NEVER || b == ARENA_NEVER ? ARENA_NEVER : a + b;
}

int arena_window_around(const struct arena *arena, struct place place, uint32_t page_count,
			arena_cost_fn cost, void *arg, struct window *ret)
{
	const struct pages *pages = arena->by_number[place.segment]->pages;
	struct pages_run run = pages_run_at(pages, place.page);
	uint32_t first = run.first;
	uint32_t end = run.first + run.count;
	uint64_t sum = run_cost(run, cost, arg);

	if (sum == ARENA_NEVER || arena->by_number[place.segment]->draining)
		return -ENOBUFS;
	while (end - first < page_count) {
		struct pages_run before = { 0 };
		struct pages_run after = { 0 };
		uint64_t before_cost = ARENA_NEVER;
		uint64_t after_cost = ARENA_NEVER;

		if (first > 0) {
			before = pages_run_before(pages, first);
			before_cost = run_cost(before, cost, arg);
		}
		if (end < pages_count(pages)) {
			after = pages_run_at(pages, end);
			after_cost = run_cost(after, cost, arg);
		}
		if (before_cost == ARENA_NEVER && after_cost == ARENA_NEVER)
			return -ENOBUFS;
		if (before_cost < after_cost)
			first = before.first;
		else
			end = after.first + after.count;
		sum += u64_min(before_cost, after_cost);
	}
	*ret = (struct window){ place.segment, first, end - first, sum };
	return 0;
}

/* Windows that begin at each run in turn, in one segment. */
static void segment_window_best(struct segment *segment, uint32_t page_count, arena_cost_fn cost,
				void *arg, struct window *best)
{
	const struct pages *pages = segment->pages;
	uint32_t first = 0;

	/* Nothing costs less than nothing. */
	while (first < pages_count(pages) && best->cost > 0) {
		uint32_t end = first;
		uint64_t sum = 0;
		uint64_t one = 0;

		while (end < pages_count(pages) && end - first < page_count && sum < best->cost) {
			struct pages_run run = pages_run_at(pages, end);

			one = run_cost(run, cost, arg);
			sum = add_cost(sum, one);
			end += run.count;
		}
		if (sum < best->cost && end - first >= page_count)
			*best = (struct window){ segment->number, first, end - first, sum };
		/* Nothing that begins before or at a run that costs too much alone is better. */
		first = one >= best->cost ? end : first + pages_run_at(pages, first).count;
	}
	if (best->cost == ARENA_NEVER)
		segment->window_max = page_count - 1;
}

int arena_window_best(struct arena *arena, uint32_t page_count, arena_cost_fn cost, void *arg,
		      struct window *ret)
{
	struct window best = { .cost = ARENA_NEVER };

	LIST_FOR_EACH (link, &arena->in_order)
		if (!ARENA_SEGMENT(link)->draining && ARENA_SEGMENT(link)->window_max >= page_count)
			segment_window_best(ARENA_SEGMENT(link), page_count, cost, arg, &best);
	if (best.cost == ARENA_NEVER)
		return -ENOBUFS;
	*ret = best;
	return 0;
}

void arena_check(const struct arena *arena)
{
	uint64_t used_pages = 0;
	uint32_t segment_count = 0;

	LIST_FOR_EACH (link, &arena->in_order) {
		const struct segment *segment = ARENA_SEGMENT(link);

		pages_check(segment->pages);
		used_pages += pages_count(segment->pages) - pages_free_count(segment->pages);
		CHECK(segment->pinned_pages <= pages_count(segment->pages));
		segment_count++;
	}
	CHECK(used_pages == arena->used_pages);
	CHECK(segment_count == arena->segment_count);
}
