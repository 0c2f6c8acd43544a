/* SPDX-License-Identifier: MIT */
#include "daemon/arena/pages.h"

#include <errno.h>
#include <stdlib.h>

#include "formats/base/check.h"

#define PAGES_COUNT_MAX (1u << 24)
#define CLASS_BITS      4u
#define CLASS_COUNT     (22u << CLASS_BITS)
#define CLASS_WORDS     ((CLASS_COUNT + 63u) / 64u)
#define NO_PAGE         UINT32_MAX

/* Of the first page of a run; count and owner of its last page as well. */
struct page_record {
	uint32_t count;
	uint32_t owner;
	uint32_t next; /* free runs of the class */
	uint32_t prev;
};

struct pages {
	uint32_t page_count;
	uint32_t free_count;
	uint32_t heads[CLASS_COUNT];
	uint64_t filled[CLASS_WORDS]; /* bit c: class c has a run */
	struct page_record records[];
};

/* Lengths below 16 have a class each; above, sixteen classes a power of two. */
static uint32_t class_of(uint32_t count)
{
	uint32_t log2;

	if (count < 1u << CLASS_BITS)
		return count;
	log2 = 31u - (uint32_t)__builtin_clz(count);
	return ((log2 - CLASS_BITS + 1u) << CLASS_BITS) +
	       ((count >> (log2 - CLASS_BITS)) & ((1u << CLASS_BITS) - 1u));
}

static uint32_t class_next_filled(const struct pages *pages, uint32_t class)
{
	uint32_t word = class / 64;
	uint64_t bits;

	if (class >= CLASS_COUNT)
		return CLASS_COUNT;
	bits = pages->filled[word] & (UINT64_MAX << (class % 64));
	while (bits == 0) {
		if (++word == CLASS_WORDS)
			return CLASS_COUNT;
		bits = pages->filled[word];
	}
	return word * 64 + (uint32_t)__builtin_ctzll(bits);
}

static void run_write(struct pages *pages, uint32_t first, uint32_t count, uint32_t owner)
{
	struct page_record *last = &pages->records[first + count - 1];

	pages->records[first].count = count;
	pages->records[first].owner = owner;
	last->count = count;
	last->owner = owner;
}

static void free_list_add(struct pages *pages, uint32_t first, uint32_t count)
{
	uint32_t class = class_of(count);
	struct page_record *record = &pages->records[first];

	run_write(pages, first, count, PAGES_FREE);
	record->prev = NO_PAGE;
	record->next = pages->heads[class];
	if (record->next != NO_PAGE)
		pages->records[record->next].prev = first;
	pages->heads[class] = first;
	pages->filled[class / 64] |= UINT64_C(1) << (class % 64);
}

static void free_list_remove(struct pages *pages, uint32_t first)
{
	struct page_record *record = &pages->records[first];
	uint32_t class = class_of(record->count);

	CHECK(record->owner == PAGES_FREE);
	if (record->next != NO_PAGE)
		pages->records[record->next].prev = record->prev;
	if (record->prev != NO_PAGE)
		pages->records[record->prev].next = record->next;
	else
		pages->heads[class] = record->next;
	if (pages->heads[class] == NO_PAGE)
		pages->filled[class / 64] &= ~(UINT64_C(1) << (class % 64));
}

int pages_create(uint32_t page_count, struct pages **ret)
{
	struct pages *pages;

	if (page_count == 0 || page_count > PAGES_COUNT_MAX)
		return -EINVAL;
	pages = calloc(1, sizeof(*pages) + page_count * sizeof(struct page_record));
	if (!pages)
		return -ENOMEM;
	pages->page_count = page_count;
	pages->free_count = page_count;
	for (uint32_t i = 0; i < CLASS_COUNT; i++)
		pages->heads[i] = NO_PAGE;
	free_list_add(pages, 0, page_count);
	*ret = pages;
	return 0;
}

struct pages *pages_destroy(struct pages *pages)
{
	free(pages);
	return NULL;
}

/*
 * The first class holds runs that may be too short by less than a class; every run of a later class
 * is long enough.
 */
static uint32_t free_run_find(const struct pages *pages, uint32_t count)
{
	uint32_t class = class_of(count);
	uint32_t page;

	for (page = pages->heads[class]; page != NO_PAGE; page = pages->records[page].next)
		if (pages->records[page].count >= count)
			return page;
	class = class_next_filled(pages, class + 1);
	return class < CLASS_COUNT ? pages->heads[class] : NO_PAGE;
}

int pages_take(struct pages *pages, uint32_t count, uint32_t owner, uint32_t *ret_first)
{
	uint32_t first;
	uint32_t rest;

	CHECK(count >= 1);
	CHECK(owner != PAGES_FREE);
	if (count > pages->free_count)
		return -ENOBUFS;
	first = free_run_find(pages, count);
	if (first == NO_PAGE)
		return -ENOBUFS;
	rest = pages->records[first].count - count;
	free_list_remove(pages, first);
	run_write(pages, first, count, owner);
	if (rest > 0)
		free_list_add(pages, first + count, rest);
	pages->free_count -= count;
	*ret_first = first;
	return 0;
}

int pages_take_at(struct pages *pages, uint32_t first, uint32_t count, uint32_t owner)
{
	struct pages_run last = pages_run_before(pages, pages->page_count);

	CHECK(count >= 1);
	CHECK(owner != PAGES_FREE);
	if (last.owner != PAGES_FREE || first < last.first || first >= pages->page_count ||
	    count > pages->page_count - first)
		return -ENOBUFS;
	free_list_remove(pages, last.first);
	if (first > last.first)
		free_list_add(pages, last.first, first - last.first);
	run_write(pages, first, count, owner);
	if (first + count < pages->page_count)
		free_list_add(pages, first + count, pages->page_count - first - count);
	pages->free_count -= count;
	return 0;
}

void pages_give(struct pages *pages, uint32_t first)
{
	uint32_t count;
	uint32_t after;

	CHECK(first < pages->page_count);
	CHECK(pages->records[first].owner != PAGES_FREE);
	count = pages->records[first].count;
	CHECK(count >= 1 && count <= pages->page_count - first);
	pages->free_count += count;

	after = first + count;
	if (after < pages->page_count && pages->records[after].owner == PAGES_FREE) {
		free_list_remove(pages, after);
		count += pages->records[after].count;
	}
	if (first > 0 && pages->records[first - 1].owner == PAGES_FREE) {
		first -= pages->records[first - 1].count;
		free_list_remove(pages, first);
		count += pages->records[first].count;
	}
	free_list_add(pages, first, count);
}

uint32_t pages_count(const struct pages *pages)
{
	return pages->page_count;
}

uint32_t pages_free_count(const struct pages *pages)
{
	return pages->free_count;
}

uint32_t pages_largest_free(const struct pages *pages)
{
	uint32_t largest = 0;

	for (uint32_t word = CLASS_WORDS; word-- > 0;) {
		uint32_t class;

		if (pages->filled[word] == 0)
			continue;
		class = word * 64 + 63u - (uint32_t)__builtin_clzll(pages->filled[word]);
		for (uint32_t at = pages->heads[class]; at != NO_PAGE; at = pages->records[at].next)
			if (pages->records[at].count > largest)
				largest = pages->records[at].count;
		break;
	}
	return largest;
}

struct pages_run pages_run_at(const struct pages *pages, uint32_t first)
{
	const struct page_record *record;

	CHECK(first < pages->page_count);
	record = &pages->records[first];
	return (struct pages_run){ first, record->count, record->owner };
}

struct pages_run pages_run_before(const struct pages *pages, uint32_t first)
{
	const struct page_record *record;

	CHECK(first > 0 && first <= pages->page_count);
	record = &pages->records[first - 1];
	return (struct pages_run){ first - record->count, record->count, record->owner };
}

void pages_check(const struct pages *pages)
{
	uint32_t free_count = 0;
	uint32_t free_runs = 0;
	bool before_free = false;

	for (uint32_t at = 0; at < pages->page_count;) {
		struct pages_run run = pages_run_at(pages, at);
		struct pages_run same = pages_run_before(pages, at + run.count);

		CHECK(run.count >= 1 && run.count <= pages->page_count - at);
		CHECK(same.first == run.first && same.owner == run.owner);
		CHECK(!(before_free && run.owner == PAGES_FREE));
		before_free = run.owner == PAGES_FREE;
		if (before_free) {
			free_count += run.count;
			free_runs++;
		}
		at += run.count;
	}
	CHECK(free_count == pages->free_count);
	for (uint32_t class = 0; class < CLASS_COUNT; class ++)
		for (uint32_t at = pages->heads[class]; at != NO_PAGE; at = pages->records[at].next)
			free_runs--;
	CHECK(free_runs == 0);
}
