/* SPDX-License-Identifier: MIT */
#include "tools/bench/replay/bound.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"

#define PRICE_ROUNDS 400u
/* How much a price moves in the first round where all of the cache is too much or too little. */
#define PRICE_STEP 0.5
#define NEVER      UINT64_MAX

/* ---- gaps ---- */

/* Where an entry is while the trace is walked. */
struct walk_entry {
	uint64_t want_count; /* that want it now */
	uint64_t free_since; /* step; NEVER: it was not wanted yet */
};

/* Takes an entry that nobody wanted. */
static void begin_use(const struct schedule *schedule, struct gaps *gaps, uint32_t index,
		      const struct walk_entry *entry, uint64_t step)
{
	const struct trace_entry *size = &schedule->entries[index];

	if (entry->free_since == NEVER) {
		gaps->compulsory_bytes += size->bytes;
		return;
	}
	/* Dropped and wanted by one step: it never has to be kept. */
	if (entry->free_since == step)
		return;
	gaps->gaps[gaps->count++] =
		(struct gap){ entry->free_since, step, size->pages, size->bytes };
	gaps->gap_bytes += size->bytes;
}

int gaps_make(const struct schedule *schedule, struct gaps *ret)
{
	struct gaps gaps = { .step_count = schedule->step_count };
	struct walk_entry *entries = calloc((size_t)schedule->entry_count + 1, sizeof(*entries));
	uint64_t wanted_pages = 0;
	uint64_t step = 0;

	gaps.gaps = malloc((schedule->want_count + 1) * sizeof(*gaps.gaps));
	gaps.wanted_pages = malloc((schedule->step_count + 1) * sizeof(*gaps.wanted_pages));
	if (!entries || !gaps.gaps || !gaps.wanted_pages) {
		free(entries);
		gaps_done(&gaps);
		return -ENOMEM;
	}
	for (uint32_t i = 0; i < schedule->entry_count; i++)
		entries[i].free_since = NEVER;
	for (uint64_t i = 0; i < schedule->op_count; i++) {
		uint32_t index = schedule_entry_of(schedule->ops[i]);
		struct walk_entry *entry = &entries[index];

		switch (schedule_op_of(schedule->ops[i])) {
		case SCHEDULE_WANT:
			if (entry->want_count++ > 0)
				break;
			begin_use(schedule, &gaps, index, entry, step);
			wanted_pages += schedule->entries[index].pages;
			break;
		case SCHEDULE_DROP:
			if (--entry->want_count > 0)
				break;
			entry->free_since = step;
			wanted_pages -= schedule->entries[index].pages;
			break;
		case SCHEDULE_STEP:
			gaps.wanted_pages[step++] = wanted_pages;
			gaps.wanted_pages_max = u64_max(gaps.wanted_pages_max, wanted_pages);
			break;
		}
	}
	free(entries);
	*ret = gaps;
	return 0;
}

void gaps_done(struct gaps *gaps)
{
	free(gaps->gaps);
	free(gaps->wanted_pages);
	memset(gaps, 0, sizeof(*gaps));
}

static double room_at(const struct gaps *gaps, uint64_t step, uint64_t cache_pages,
		      bool wants_need_room)
{
	uint64_t wanted_pages = wants_need_room ? gaps->wanted_pages[step] : 0;

	return (double)(cache_pages - u64_min(cache_pages, wanted_pages));
}

static double gap_cost(const struct gap *gap)
{
	return (double)gap->pages * (double)(gap->end - gap->begin);
}

static int by_density(const void *a, const void *b)
{
	const struct gap *x = a;
	const struct gap *y = b;
	double x_worth = (double)x->bytes * gap_cost(y);
	double y_worth = (double)y->bytes * gap_cost(x);

	return (x_worth < y_worth) - (x_worth > y_worth);
}

/* Bytes saved, and the price at which the room is used up (bytes for a page and step). */
static int fill_by_density(const struct gaps *gaps, double room, double *ret_saved,
			   double *ret_price)
{
	struct gap *sorted = malloc((gaps->count + 1) * sizeof(*sorted));
	double saved = 0;
	double price = 0;

	if (!sorted)
		return -ENOMEM;
	if (gaps->count > 0) {
		memcpy(sorted, gaps->gaps, gaps->count * sizeof(*sorted));
		qsort(sorted, gaps->count, sizeof(*sorted), by_density);
	}
	for (uint64_t i = 0; i < gaps->count && room > 0; i++) {
		double share = fmin(1.0, room / gap_cost(&sorted[i]));

		saved += share * sorted[i].bytes;
		room -= share * gap_cost(&sorted[i]);
		price = share < 1.0 ? sorted[i].bytes / gap_cost(&sorted[i]) : 0;
	}
	free(sorted);
	*ret_saved = saved;
	*ret_price = price;
	return 0;
}

static double bytes_of_all(const struct gaps *gaps)
{
	return (double)(gaps->compulsory_bytes + gaps->gap_bytes);
}

int bound_pfoo(const struct gaps *gaps, uint64_t cache_pages, bool wants_need_room, double *ret)
{
	double room = 0;
	double saved;
	double price;
	int r;

	for (uint64_t step = 0; step < gaps->step_count; step++)
		room += room_at(gaps, step, cache_pages, wants_need_room);
	r = fill_by_density(gaps, room, &saved, &price);
	if (r == 0)
		*ret = bytes_of_all(gaps) - saved;
	return r;
}

/* ---- a price at each step ---- */

struct prices {
	double *price; /* a step */
	double *sum;   /* of the prices before a step */
	double *used;  /* pages, at these prices */
};

/* The most that can be saved at these prices, and what would be kept for that. */
static double saved_at(const struct gaps *gaps, struct prices *prices, uint64_t cache_pages,
		       bool wants_need_room)
{
	double saved = 0;
	double used = 0;

	prices->sum[0] = 0;
	for (uint64_t step = 0; step < gaps->step_count; step++) {
		prices->sum[step + 1] = prices->sum[step] + prices->price[step];
		saved += prices->price[step] * room_at(gaps, step, cache_pages, wants_need_room);
	}
	memset(prices->used, 0, (gaps->step_count + 1) * sizeof(*prices->used));
	for (uint64_t i = 0; i < gaps->count; i++) {
		const struct gap *gap = &gaps->gaps[i];
		double rent = gap->pages * (prices->sum[gap->end] - prices->sum[gap->begin]);

		if (rent >= gap->bytes)
			continue;
		saved += gap->bytes - rent;
		prices->used[gap->begin] += gap->pages;
		prices->used[gap->end] -= gap->pages;
	}
	for (uint64_t step = 0; step < gaps->step_count; step++) {
		used += prices->used[step];
		prices->used[step] = used;
	}
	return saved;
}

static void move_prices(const struct gaps *gaps, struct prices *prices, uint64_t cache_pages,
			bool wants_need_room, double by)
{
	for (uint64_t step = 0; step < gaps->step_count; step++) {
		double room = room_at(gaps, step, cache_pages, wants_need_room);
		double excess =
			(prices->used[step] - room) / fmax(room, 0.02 * (double)cache_pages);

		prices->price[step] *= exp(by * fmin(1.0, fmax(-1.0, excess)));
	}
}

int bound_foo(const struct gaps *gaps, uint64_t cache_pages, bool wants_need_room, double *ret)
{
	size_t count = gaps->step_count + 1;
	struct prices prices = {
		.price = malloc(count * sizeof(double)),
		.sum = malloc(count * sizeof(double)),
		.used = malloc(count * sizeof(double)),
	};
	double room = 0;
	double saved = 0;
	double price = 0;
	int r = prices.price && prices.sum && prices.used ? 0 : -ENOMEM;

	for (uint64_t step = 0; r == 0 && step < gaps->step_count; step++)
		room += room_at(gaps, step, cache_pages, wants_need_room);
	if (r == 0)
		r = fill_by_density(gaps, room, &saved, &price);
	for (uint64_t step = 0; r == 0 && step < gaps->step_count; step++)
		prices.price[step] = price;
	for (unsigned round = 0; r == 0 && price > 0 && round < PRICE_ROUNDS; round++) {
		saved = fmin(saved, saved_at(gaps, &prices, cache_pages, wants_need_room));
		move_prices(gaps, &prices, cache_pages, wants_need_room,
			    PRICE_STEP / sqrt(1.0 + round));
	}
	free(prices.price);
	free(prices.sum);
	free(prices.used);
	if (r == 0)
		*ret = bytes_of_all(gaps) - saved;
	return r;
}

/* ---- Belady ---- */

struct belady_entry {
	uint64_t want_count;
	uint64_t next; /* step of the next want, while it may go */
	uint32_t slot; /* 1 + index in `free`; 0: it may not go */
	bool is_there;
};

struct belady {
	const struct schedule *schedule;
	struct belady_entry *entries;
	uint32_t *free;
	uint32_t free_count;
	uint64_t *nexts; /* an op: step in which the entry is wanted next after it */
	uint64_t used_pages;
	double read_bytes;
};

/* From the end: the step of the next want after each op. */
static int find_nexts(struct belady *belady)
{
	const struct schedule *schedule = belady->schedule;
	uint64_t *next = malloc(((size_t)schedule->entry_count + 1) * sizeof(*next));
	uint64_t step = schedule->step_count;

	if (!next)
		return -ENOMEM;
	memset(next, 0xff, ((size_t)schedule->entry_count + 1) * sizeof(*next));
	for (uint64_t i = schedule->op_count; i-- > 0;) {
		uint32_t entry = schedule_entry_of(schedule->ops[i]);

		switch (schedule_op_of(schedule->ops[i])) {
		case SCHEDULE_STEP:
			step--;
			break;
		case SCHEDULE_WANT:
			next[entry] = step;
			break;
		case SCHEDULE_DROP:
			belady->nexts[i] = next[entry];
			break;
		}
	}
	free(next);
	return 0;
}

static void belady_unfree(struct belady *belady, uint32_t entry)
{
	uint32_t slot = belady->entries[entry].slot - 1;
	uint32_t last = belady->free[--belady->free_count];

	belady->free[slot] = last;
	belady->entries[last].slot = slot + 1;
	belady->entries[entry].slot = 0;
}

static double belady_cost(const struct belady *belady, uint32_t entry, uint64_t step)
{
	uint64_t next = belady->entries[entry].next;

	if (next == NEVER)
		return INFINITY;
	return (double)(next - step) * belady->schedule->entries[entry].pages;
}

static void belady_evict(struct belady *belady, uint64_t step)
{
	uint32_t worst = belady->free[0];
	double worst_cost = belady_cost(belady, worst, step);

	for (uint32_t i = 1; i < belady->free_count && worst_cost < INFINITY; i++) {
		double cost = belady_cost(belady, belady->free[i], step);

		if (cost <= worst_cost)
			continue;
		worst = belady->free[i];
		worst_cost = cost;
	}
	belady_unfree(belady, worst);
	belady->entries[worst].is_there = false;
	belady->used_pages -= belady->schedule->entries[worst].pages;
}

static void belady_read(struct belady *belady, uint32_t index, uint64_t cache_pages, uint64_t step)
{
	const struct trace_entry *size = &belady->schedule->entries[index];

	belady->read_bytes += size->bytes;
	while (belady->used_pages + size->pages > cache_pages && belady->free_count > 0)
		belady_evict(belady, step);
	if (belady->used_pages + size->pages > cache_pages)
		return;
	belady->used_pages += size->pages;
	belady->entries[index].is_there = true;
}

static void belady_drop(struct belady *belady, uint32_t index, uint64_t next)
{
	struct belady_entry *entry = &belady->entries[index];

	if (--entry->want_count > 0 || !entry->is_there)
		return;
	entry->next = next;
	belady->free[belady->free_count++] = index;
	entry->slot = belady->free_count;
}

/* One step, from op `at` on.  Returns: the op behind it.  What is there is taken first. */
static uint64_t belady_step(struct belady *belady, uint64_t at, uint64_t cache_pages, uint64_t step)
{
	const uint64_t *ops = belady->schedule->ops;
	uint64_t end = at;

	for (; schedule_op_of(ops[end]) != SCHEDULE_STEP; end++) {
		uint32_t index = schedule_entry_of(ops[end]);
		struct belady_entry *entry = &belady->entries[index];

		if (schedule_op_of(ops[end]) == SCHEDULE_DROP) {
			belady_drop(belady, index, belady->nexts[end]);
			continue;
		}
		if (entry->slot > 0)
			belady_unfree(belady, index);
		entry->want_count++;
	}
	for (; at < end; at++) {
		uint32_t index = schedule_entry_of(ops[at]);

		if (schedule_op_of(ops[at]) == SCHEDULE_WANT && !belady->entries[index].is_there)
			belady_read(belady, index, cache_pages, step);
	}
	return end + 1;
}

int bound_belady(const struct schedule *schedule, uint64_t cache_pages, double *ret)
{
	size_t entry_room = (size_t)schedule->entry_count + 1;
	struct belady belady = {
		.schedule = schedule,
		.entries = calloc(entry_room, sizeof(*belady.entries)),
		.free = malloc(entry_room * sizeof(*belady.free)),
		.nexts = malloc((schedule->op_count + 1) * sizeof(*belady.nexts)),
	};
	uint64_t step = 0;
	int r = belady.entries && belady.free && belady.nexts ? 0 : -ENOMEM;

	if (r == 0)
		r = find_nexts(&belady);
	for (uint64_t at = 0; r == 0 && at < schedule->op_count; step++)
		at = belady_step(&belady, at, cache_pages, step);
	free(belady.entries);
	free(belady.free);
	free(belady.nexts);
	if (r == 0)
		*ret = belady.read_bytes;
	return r;
}
