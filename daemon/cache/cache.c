/* SPDX-License-Identifier: MIT */
#include "daemon/cache/cache.h"

#include <errno.h>

#include "daemon/cache/recorder.h"
#include "daemon/limits.h"
#include "formats/base/check.h"
#include "formats/base/clock.h"

/*
 * Candidates looked at before the whole arena is searched for a window: of LRU's list the oldest, else
 * some at random.  (With 64 in place of 192, loops read 2 to 5 % more; the time is the same, because most
 * are seen to be worth too much at once.)
 */
#define WINDOW_TRIES_LRU 16u
#define WINDOW_TRIES     192u
/* Uses between two looks at whether another store's memory is older than what would be evicted. */
#define STEAL_USES 16u
/* How long the budget stays shrunk after memory could not be had. */
#define SHORT_OF_MEMORY_NS (10 * NS_PER_S)

static struct served *store_of(struct list *link)
{
	return LIST_ENTRY(link, struct served, link);
}

static _Atomic uint64_t *word_of(const struct served *served, uint32_t index)
{
	return &served->directory->words[index];
}

static struct segment *segment_of(const struct served *served, const struct node *node)
{
	return served->arena.by_number[node->place.segment];
}

/* BUSY and HELD nodes are pinned: their bytes may not go. */
static void pin(struct cache *cache, struct served *served, uint32_t index)
{
	uint32_t pages = served_pages(served, index);

	served->pinned_pages += pages;
	segment_of(served, &served->nodes[index])->pinned_pages += pages;
	cache->pinned_bytes += (uint64_t)pages * WIRE_PAGE_BYTES;
}

static void unpin(struct cache *cache, struct served *served, uint32_t index)
{
	struct segment *segment = segment_of(served, &served->nodes[index]);
	uint32_t pages = served_pages(served, index);

	CHECK(served->pinned_pages >= pages && segment->pinned_pages >= pages);
	served->pinned_pages -= pages;
	segment->pinned_pages -= pages;
	cache->pinned_bytes -= (uint64_t)pages * WIRE_PAGE_BYTES;
	cache->released_bytes += (uint64_t)pages * WIRE_PAGE_BYTES;
	arena_note_let_go(segment, pages);
}

/* ---- eviction ---- */

/* While nothing has had to go any order does, so until then a policy is told nothing. */
static struct replacement *replacement_of(const struct served *served)
{
	return served->has_evicted ? served->replacement : NULL;
}

/* What is in memory, as if the policy had seen it come. */
static void begin_replacement(struct served *served)
{
	uint64_t room_pages = arena_bytes(&served->arena) / WIRE_PAGE_BYTES;

	served->has_evicted = true;
	if (!served->replacement)
		return;
	for (uint32_t i = 0; i < served->node_count; i++)
		if (served->nodes[i].hold_count > 0)
			replacement_use(served->replacement, i, served_pages(served, i),
					room_pages);
	LIST_FOR_EACH (link, &served->lru) {
		const struct node *node = LIST_ENTRY(link, struct node, link);
		uint32_t index = (uint32_t)(node - served->nodes);

		replacement_let_go(served->replacement, index, served_pages(served, index),
				   !node->unused_prefetch);
	}
}

static void evict(struct served *served, uint32_t index)
{
	struct node *node = &served->nodes[index];

	if (!served->has_evicted)
		begin_replacement(served);
	/* The word says ABSENT before the place can be given to anyone. */
	node_evict(node, word_of(served, index));
	list_remove(&node->link);
	if (served->replacement)
		replacement_evict(served->replacement, index);
	arena_give(&served->arena, node->place);
	served->ready_count--;
	served->counters.evictions++;
	served->counters.prefetch_wasted += node->unused_prefetch;
	node->unused_prefetch = false;
	node->was_evicted = true;
	node->since_ds = clock_now_ds();
	recorder_node(served, TRACE_EVICT, index);
}

/* Where the first run that has an owner begins, from a run's first page on; `end` if there is none. */
static uint32_t owned_from(const struct pages *pages, uint32_t at, uint32_t end)
{
	while (at < end) {
		struct pages_run run = pages_run_at(pages, at);

		if (run.owner != PAGES_FREE)
			break;
		at += run.count;
	}
	return at;
}

/*
 * Evicts what nobody holds in whole runs from `at` to `end`.  The next run is found before one is
 * given back: that joins it with its free neighbours, whose own records then mean nothing.
 */
static void evict_range(struct served *served, const struct pages *pages, uint32_t at, uint32_t end)
{
	at = owned_from(pages, at, end);
	while (at < end) {
		struct pages_run run = pages_run_at(pages, at);

		at = owned_from(pages, at + run.count, end);
		if (served->nodes[run.owner].state == NODE_FREE)
			evict(served, run.owner);
	}
}

static void evict_window(struct served *served, struct window window)
{
	evict_range(served, served->arena.by_number[window.segment]->pages, window.first,
		    window.first + window.page_count);
}

static void evict_unpinned(struct served *served, const struct segment *segment)
{
	evict_range(served, segment->pages, 0, pages_count(segment->pages));
}

/* A budget that was made smaller is reached as segments go. */
static void follow_wanted(struct cache *cache)
{
	if (cache->budget_bytes > cache->budget_wanted_bytes)
		cache->budget_bytes = u64_max(cache->budget_wanted_bytes, cache->segment_bytes);
}

static void drop_segment(struct cache *cache, struct served *served, struct segment *segment)
{
	CHECK(segment->pinned_pages == 0);
	evict_unpinned(served, segment);
	cache->calls.gone(cache->calls_arg, served, segment);
	cache->draining_count -= segment->draining;
	arena_remove(&served->arena, segment->number);
	cache->segment_bytes -= served->arena.segment_bytes;
	cache->released_bytes += served->arena.segment_bytes;
	cache->segment_count--;
	follow_wanted(cache);
}

/* For whom windows are compared. */
struct evictor {
	const struct cache *cache;
	const struct served *served;
};

/* What is lost with a node, however it is compared: what a page is worth, times its pages. */
static uint64_t cost_of(void *arg, uint32_t owner)
{
	const struct evictor *evictor = arg;
	const struct served *served = evictor->served;
	const struct node *node = &served->nodes[owner];
	uint64_t worth;

	if (node->state != NODE_FREE)
		return ARENA_NEVER;
	worth = replacement_is_lru(served->replacement)
			? replacement_lru_worth(evictor->cache->clock - node->last_use)
			: replacement_worth(served->replacement, owner);
	return worth * served_pages(served, owner);
}

/* Some of the FREE nodes, among them one that should go first or soon. */
static uint32_t find_candidates(const struct served *served, uint32_t *ret)
{
	uint32_t count = 0;

	if (!replacement_is_lru(served->replacement))
		return replacement_sample(served->replacement, ret, WINDOW_TRIES);
	LIST_FOR_EACH (link, &served->lru) {
		if (count == WINDOW_TRIES_LRU)
			break;
		ret[count++] = (uint32_t)(LIST_ENTRY(link, struct node, link) - served->nodes);
	}
	return count;
}

/*
 * Each candidate is tried with its neighbours, because payloads of a store are of similar size and that
 * nearly always succeeds, and the window goes of which least is lost.  Only when there is none all
 * windows are compared, so that "full" is said exactly when it is true.
 */
static int find_window(const struct cache *cache, struct served *served, uint32_t pages,
		       struct window *ret)
{
	struct evictor evictor = { cache, served };
	struct window best = { .cost = ARENA_NEVER };
	uint32_t candidates[WINDOW_TRIES];
	uint32_t count = find_candidates(served, candidates);

	for (uint32_t i = 0; i < count; i++) {
		const struct node *node = &served->nodes[candidates[i]];
		struct window window;

		/* A window costs as much as each of its owners, at least. */
		if (cost_of(&evictor, candidates[i]) < best.cost &&
		    arena_window_around(&served->arena, node->place, pages, cost_of, &evictor,
					&window) == 0 &&
		    window.cost < best.cost)
			best = window;
	}
	if (best.cost == ARENA_NEVER)
		return arena_window_best(&served->arena, pages, cost_of, &evictor, ret);
	*ret = best;
	return 0;
}

/* ---- segments ---- */

static bool grow(struct cache *cache, struct served *served)
{
	uint64_t bytes = served->arena.segment_bytes;

	if (served->segment_coming || cache->segment_count == SEGMENT_COUNT_MAX ||
	    cache->segment_bytes + bytes > cache->budget_bytes)
		return false;
	served->segment_coming = true;
	cache->segment_bytes += bytes;
	cache->segment_count++;
	cache->calls.make(cache->calls_arg, served);
	return true;
}

/* A segment ahead of need, so that a fetch seldom waits for memory to be populated. */
static void grow_ahead(struct cache *cache, struct served *served)
{
	const struct store_superblock *superblock = served->superblock;

	if (arena_free_pages(&served->arena) * WIRE_PAGE_BYTES < served->arena.segment_bytes &&
	    arena_bytes(&served->arena) < superblock->payload_raw_bytes)
		(void)grow(cache, served);
}

/* Stamp of the newest use from `at` to `end`, in whole runs. */
static uint64_t newest_use(const struct served *served, const struct pages *pages, uint32_t at,
			   uint32_t end)
{
	uint64_t newest = 0;

	while (at < end) {
		struct pages_run run = pages_run_at(pages, at);

		at += run.count;
		if (run.owner != PAGES_FREE)
			newest = u64_max(newest, served->nodes[run.owner].last_use);
	}
	return newest;
}

static uint64_t window_age(const struct served *served, struct window window)
{
	return newest_use(served, served->arena.by_number[window.segment]->pages, window.first,
			  window.first + window.page_count);
}

/* Stamp of the segment's newest use, or ARENA_NEVER when something in it is pinned. */
static uint64_t segment_age(const struct served *served, const struct segment *segment)
{
	if (segment->pinned_pages > 0)
		return ARENA_NEVER;
	return newest_use(served, segment->pages, 0, pages_count(segment->pages));
}

/* Drops the oldest segment of another store that was last used before `limit`. */
static bool steal_one(struct cache *cache, const struct served *for_whom, uint64_t limit)
{
	struct segment *best = NULL;
	struct served *victim = NULL;

	LIST_FOR_EACH (link, &cache->stores) {
		struct served *served = store_of(link);

		if (served == for_whom)
			continue;
		LIST_FOR_EACH (at, &served->arena.in_order) {
			uint64_t age = segment_age(served, ARENA_SEGMENT(at));

			if (age >= limit)
				continue;
			limit = age;
			best = ARENA_SEGMENT(at);
			victim = served;
		}
	}
	if (best)
		drop_segment(cache, victim, best);
	return best != NULL;
}

/* Makes a segment's room in the budget out of what other stores used before `limit`. */
static bool steal(struct cache *cache, struct served *served, uint64_t limit)
{
	if (cache->store_count < 2)
		return false;
	cache->steal_clock = cache->clock;
	while (cache->segment_bytes + served->arena.segment_bytes > cache->budget_bytes)
		if (!steal_one(cache, served, limit))
			return false;
	return grow(cache, served);
}

/* Nothing comes into the segment until nothing is held in it.  gone: then it is given up. */
static void drain(struct cache *cache, struct served *served, struct segment *segment, bool gone)
{
	segment->draining = true;
	segment->draining_for_good = gone;
	cache->draining_count++;
	cache->drain_count++;
	/* Until its holders have been told (room.h says when that leads nowhere). */
	cache->room_is_coming = true;
	evict_unpinned(served, segment);
}

static void undrain(struct cache *cache, struct segment *segment)
{
	cache->draining_count -= segment->draining;
	segment->draining = false;
	segment->draining_for_good = false;
}

/* A segment that is drained has lost a hold; perhaps the last. */
static void drained(struct cache *cache, struct served *served, struct segment *segment)
{
	if (segment->pinned_pages > 0)
		return;
	if (segment->draining_for_good) {
		drop_segment(cache, served, segment);
		return;
	}
	undrain(cache, segment);
	cache->released_bytes += served->arena.segment_bytes;
}

/*
 * Other stores hold something in each of their segments, and this one has less than its share of
 * the budget: the segment with the fewest holds is filled no more, and given up with the last one.
 */
static void drain_one(struct cache *cache, const struct served *for_whom)
{
	struct segment *best = NULL;
	struct served *victim = NULL;

	if (arena_bytes(&for_whom->arena) >= cache->budget_bytes / cache->store_count)
		return;
	LIST_FOR_EACH (link, &cache->stores) {
		struct served *served = store_of(link);

		if (served == for_whom || served->arena.segment_count < 2)
			continue;
		LIST_FOR_EACH (at, &served->arena.in_order) {
			struct segment *segment = ARENA_SEGMENT(at);

			if (segment->draining)
				return;
			if (best && segment->pinned_pages >= best->pinned_pages)
				continue;
			best = segment;
			victim = served;
		}
	}
	if (best)
		drain(cache, victim, best, true);
}

/*
 * Enough is free in one segment of the store, but in pieces: the one with the least that is held is
 * drained and then filled anew, from one end.  That leaves what is free in it in one piece, so no
 * segment is drained twice for the same want, and draining ends.
 */
static void compact_one(struct cache *cache, struct served *served, uint32_t pages)
{
	struct segment *best = NULL;

	LIST_FOR_EACH (at, &served->arena.in_order) {
		struct segment *segment = ARENA_SEGMENT(at);

		if (segment->draining)
			return;
		if (pages_count(segment->pages) - segment->pinned_pages >= pages &&
		    (!best || segment->pinned_pages < best->pinned_pages))
			best = segment;
	}
	if (best)
		drain(cache, served, best, false);
}

/* ---- the interface ---- */

void cache_init(struct cache *cache, uint64_t budget_bytes, const struct cache_calls *calls,
		void *calls_arg)
{
	*cache = (struct cache){
		.budget_bytes = budget_bytes,
		.budget_wanted_bytes = budget_bytes,
		.calls = *calls,
		.calls_arg = calls_arg,
	};
	list_init(&cache->stores);
}

/* Of all segments that are filled, the one with the fewest pages pinned; ties: the one least used. */
static struct segment *least_pinned(struct cache *cache, struct served **ret_served)
{
	struct segment *best = NULL;
	uint64_t best_age = ARENA_NEVER;

	LIST_FOR_EACH (link, &cache->stores) {
		struct served *served = store_of(link);

		LIST_FOR_EACH (at, &served->arena.in_order) {
			struct segment *segment = ARENA_SEGMENT(at);
			uint64_t age = segment_age(served, segment);

			if (segment->draining ||
			    (best && segment->pinned_pages > best->pinned_pages) ||
			    (best && segment->pinned_pages == best->pinned_pages &&
			     age >= best_age))
				continue;
			best = segment;
			best_age = age;
			*ret_served = served;
		}
	}
	return best;
}

/* Bytes that stay when all that is draining has gone; segments that are being made included. */
static uint64_t staying_bytes(const struct cache *cache)
{
	uint64_t bytes = cache->segment_bytes;

	LIST_FOR_EACH (link, &cache->stores) {
		const struct served *served = store_of(link);

		LIST_FOR_EACH (at, &served->arena.in_order)
			bytes -= ARENA_SEGMENT(at)->draining_for_good ? served->arena.segment_bytes
								      : 0;
	}
	return bytes;
}

static void shrink(struct cache *cache)
{
	struct served *served = NULL;
	struct segment *segment;

	while (staying_bytes(cache) > cache->budget_wanted_bytes &&
	       (segment = least_pinned(cache, &served)) != NULL) {
		if (segment->pinned_pages == 0) {
			drop_segment(cache, served, segment);
			continue;
		}
		drain(cache, served, segment, true);
	}
}

void cache_set_budget(struct cache *cache, uint64_t budget_bytes)
{
	bool larger = budget_bytes > cache->budget_wanted_bytes;

	cache->budget_wanted_bytes = budget_bytes;
	cache->short_since_ns = 0;
	cache->budget_bytes = u64_max(budget_bytes, cache->segment_bytes);
	if (larger)
		LIST_FOR_EACH (link, &cache->stores)
			LIST_FOR_EACH (at, &store_of(link)->arena.in_order)
				undrain(cache, ARENA_SEGMENT(at));
	shrink(cache);
	/* Whoever was refused room asks again. */
	cache->released_bytes += budget_bytes;
}

void cache_add_store(struct cache *cache, struct served *served)
{
	list_push_back(&cache->stores, &served->link);
	cache->store_count++;
}

void cache_remove_store(struct cache *cache, struct served *served)
{
	CHECK(served->pinned_pages == 0);
	CHECK(!served->segment_coming);
	LIST_FOR_EACH (link, &served->arena.in_order)
		drop_segment(cache, served, ARENA_SEGMENT(link));
	list_remove(&served->link);
	cache->store_count--;
}

/* Is it the pieces, not the bytes, that there are too few of, and is what is free worth the trouble? */
static bool is_fragmented(const struct cache *cache, uint32_t pages)
{
	uint64_t unpinned_bytes = cache->budget_bytes - cache->pinned_bytes;

	return unpinned_bytes >= cache->budget_bytes / FRAGMENTED_SHARE &&
	       unpinned_bytes >= (uint64_t)pages * WIRE_PAGE_BYTES;
}

/* Was a window as long not to be found, and has nothing been let go since? */
static bool is_known_full(const struct cache *cache, const struct served *served, uint32_t pages)
{
	return served->full_pages > 0 && pages >= served->full_pages &&
	       cache->released_bytes == served->full_at_bytes;
}

/* No window is long enough.  What can be done so that there is one soon? */
static int wait_for_room(struct cache *cache, struct served *served, uint32_t pages)
{
	if (!is_known_full(cache, served, pages)) {
		served->full_pages = pages;
		served->full_at_bytes = cache->released_bytes;
	}
	if (!cache->room_is_coming) {
		if (is_fragmented(cache, pages))
			compact_one(cache, served, pages);
		drain_one(cache, served);
	}
	if (cache->room_is_coming)
		return -EBUSY;
	served->counters.fragmented += is_fragmented(cache, pages);
	return -ENOBUFS;
}

static int take_place(struct cache *cache, struct served *served, uint32_t index, bool prefetch,
		      struct place *ret)
{
	uint32_t pages = served_pages(served, index);
	struct window window = { 0 };
	int r = -ENOBUFS;

	if (!is_known_full(cache, served, pages) &&
	    arena_take(&served->arena, pages, index, ret) == 0)
		return 0;
	if (served->segment_coming || grow(cache, served))
		return -EAGAIN;
	if (!is_known_full(cache, served, pages)) {
		r = find_window(cache, served, pages, &window);
		if ((r < 0 || cache->clock - cache->steal_clock >= STEAL_USES) &&
		    steal(cache, served, r < 0 ? ARENA_NEVER : window_age(served, window)))
			return -EAGAIN;
	}
	if (r < 0)
		return prefetch ? r : wait_for_room(cache, served, pages);
	evict_window(served, window);
	r = arena_take(&served->arena, pages, index, ret);
	CHECK(r == 0);
	return 0;
}

int cache_begin_fill(struct cache *cache, struct served *served, uint32_t index, uint32_t fill,
		     bool prefetch)
{
	struct node *node = &served->nodes[index];
	struct place place;
	int r;

	CHECK(served_has_payload(served, index));
	CHECK(node->state == NODE_ABSENT);
	r = take_place(cache, served, index, prefetch, &place);
	if (r < 0)
		return r;
	node_begin_fill(node, word_of(served, index), place, fill);
	node->was_evicted = false;
	pin(cache, served, index);
	grow_ahead(cache, served);
	return 0;
}

int cache_adopt_segment(struct cache *cache, struct served *served, struct memfile *memfile,
			uint32_t number, struct segment **ret)
{
	uint64_t bytes = served->arena.segment_bytes;
	int r;

	if (cache->segment_count == SEGMENT_COUNT_MAX ||
	    cache->segment_bytes + bytes > cache->budget_bytes)
		return -ENOBUFS;
	r = arena_adopt(&served->arena, memfile, number, ret);
	if (r < 0)
		return r;
	cache->segment_bytes += bytes;
	cache->segment_count++;
	return 0;
}

int cache_adopt_node(struct cache *cache, struct served *served, uint32_t index, struct place place)
{
	int r = arena_take_at(&served->arena, place, served_pages(served, index), index);

	if (r < 0)
		return r;
	node_begin_fill(&served->nodes[index], word_of(served, index), place, NODE_TAKEOVER);
	pin(cache, served, index);
	return 0;
}

/* The node has become FREE: it is the one that was used last, if it was. */
static void set_free(struct cache *cache, struct served *served, uint32_t index, bool was_used)
{
	struct node *node = &served->nodes[index];
	struct segment *segment = segment_of(served, node);

	unpin(cache, served, index);
	ledger_note_held(&served->ledger, index, false);
	node->last_use = ++cache->clock;
	list_push_back(&served->lru, &node->link);
	if (replacement_of(served))
		replacement_let_go(served->replacement, index, served_pages(served, index),
				   was_used);
	recorder_node(served, TRACE_FREE, index);
	if (!segment->draining)
		return;
	evict(served, index);
	drained(cache, served, segment);
}

void cache_end_fill(struct cache *cache, struct served *served, uint32_t index)
{
	struct node *node = &served->nodes[index];

	/* Who waits for it has its grant already, and draws as soon as the word says READY. */
	if (node->hold_count > 0)
		ledger_note_held(&served->ledger, index, true);
	node_end_fill(node, word_of(served, index));
	node->since_ds = clock_now_ds();
	served->ready_count++;
	served->counters.filled++;
	if (node->state == NODE_FREE)
		set_free(cache, served, index, false);
	else
		served->held_pages += served_pages(served, index);
}

void cache_fail_fill(struct cache *cache, struct served *served, uint32_t index, bool damaged)
{
	struct node *node = &served->nodes[index];
	struct segment *segment = segment_of(served, node);

	node_fail_fill(node, word_of(served, index), damaged);
	node->unused_prefetch = false;
	if (replacement_of(served))
		replacement_fail(served->replacement, index);
	unpin(cache, served, index);
	arena_give(&served->arena, node->place);
	served->counters.errors++;
	if (segment->draining)
		drained(cache, served, segment);
}

void cache_hold(struct cache *cache, struct served *served, uint32_t index)
{
	struct node *node = &served->nodes[index];
	bool was_free = node->state == NODE_FREE;
	bool was_held = node->hold_count > 0;

	node_hold(node, word_of(served, index));
	served->counters.holds++;
	if (node->unused_prefetch) {
		node->unused_prefetch = false;
		served->counters.prefetch_used++;
	}
	if (!was_held && replacement_of(served))
		replacement_use(served->replacement, index, served_pages(served, index),
				arena_bytes(&served->arena) / WIRE_PAGE_BYTES);
	if (!was_free)
		return;
	ledger_note_held(&served->ledger, index, true);
	list_remove(&node->link);
	pin(cache, served, index);
	served->held_pages += served_pages(served, index);
}

void cache_release(struct cache *cache, struct served *served, uint32_t index)
{
	struct node *node = &served->nodes[index];

	node_release(node, word_of(served, index));
	served->counters.releases++;
	if (node->state != NODE_FREE)
		return;
	served->held_pages -= served_pages(served, index);
	set_free(cache, served, index, true);
}

bool cache_evict(struct served *served, uint32_t index)
{
	if (served->nodes[index].state != NODE_FREE)
		return false;
	evict(served, index);
	return true;
}

void cache_warm_up(struct cache *cache, struct served *served)
{
	if (served->arena.segment_count > 0 || served->segment_coming)
		return;
	if (!grow(cache, served))
		(void)steal(cache, served, ARENA_NEVER);
}

int cache_add_segment(struct cache *cache, struct served *served, struct memfile *memfile,
		      struct segment **ret)
{
	int r;

	CHECK(served->segment_coming);
	r = arena_add(&served->arena, memfile, ret);
	if (r < 0) {
		cache_segment_failed(cache, served);
		return r;
	}
	served->segment_coming = false;
	cache->released_bytes += served->arena.segment_bytes;
	return 0;
}

void cache_segment_failed(struct cache *cache, struct served *served)
{
	CHECK(served->segment_coming);
	served->segment_coming = false;
	cache->segment_bytes -= served->arena.segment_bytes;
	cache->segment_count--;
	cache->budget_bytes = cache->segment_bytes;
	cache->short_since_ns = clock_now_ns();
}

void cache_trim(struct cache *cache, uint64_t now_ns, uint64_t idle_ns)
{
	if (cache->short_since_ns > 0 && now_ns - cache->short_since_ns > SHORT_OF_MEMORY_NS) {
		cache->short_since_ns = 0;
		cache->budget_bytes = u64_max(cache->budget_wanted_bytes, cache->segment_bytes);
		cache->released_bytes += cache->budget_bytes - cache->segment_bytes;
	}
	/* A segment that was being made when the budget became smaller has come. */
	if (cache->budget_bytes > cache->budget_wanted_bytes)
		shrink(cache);
	LIST_FOR_EACH (link, &cache->stores) {
		struct served *served = store_of(link);

		LIST_FOR_EACH (at, &served->arena.in_order) {
			struct segment *segment = ARENA_SEGMENT(at);
			bool last = served->attach_count > 0 && served->arena.segment_count == 1;

			if (pages_free_count(segment->pages) < pages_count(segment->pages))
				segment->empty_since_ns = 0;
			else if (segment->empty_since_ns == 0)
				segment->empty_since_ns = now_ns;
			else if (!last && now_ns - segment->empty_since_ns > idle_ns)
				drop_segment(cache, served, segment);
		}
	}
}

uint64_t cache_used_bytes(const struct cache *cache)
{
	uint64_t pages = 0;

	LIST_FOR_EACH (link, &cache->stores)
		pages += store_of(link)->arena.used_pages;
	return pages * WIRE_PAGE_BYTES;
}

static void store_check(const struct served *served)
{
	uint64_t used_pages = 0;
	uint64_t pinned_pages = 0;
	uint64_t held_pages = 0;
	uint64_t ready_count = 0;
	uint64_t free_count = 0;
	uint64_t last_use = 0;

	arena_check(&served->arena);
	for (uint32_t i = 0; i < served->node_count; i++) {
		const struct node *node = &served->nodes[i];
		uint32_t pages = served_pages(served, i);

		node_check(node);
		CHECK((node->state == NODE_FREE) == !list_is_empty(&node->link));
		CHECK(!replacement_of(served) ||
		      replacement_has(served->replacement, i) == (node->state == NODE_FREE));
		if (node->state == NODE_ABSENT || node->state == NODE_DAMAGED)
			continue;
		CHECK(pages_run_at(segment_of(served, node)->pages, node->place.page).owner == i);
		used_pages += pages;
		pinned_pages += node->state == NODE_FREE ? 0 : pages;
		held_pages += node->state == NODE_HELD ? pages : 0;
		ready_count += node_is_ready(node);
		free_count += node->state == NODE_FREE;
	}
	LIST_FOR_EACH (link, &served->lru) {
		const struct node *node = LIST_ENTRY(link, struct node, link);

		CHECK(node->last_use > last_use);
		last_use = node->last_use;
		free_count--;
	}
	CHECK(free_count == 0);
	if (served->replacement)
		replacement_check(served->replacement);
	CHECK(used_pages == served->arena.used_pages);
	CHECK(pinned_pages == served->pinned_pages);
	CHECK(held_pages == served->held_pages);
	CHECK(ready_count == served->ready_count);
}

void cache_check(const struct cache *cache)
{
	uint64_t pinned_pages = 0;
	uint64_t segment_bytes = 0;
	uint32_t draining_count = 0;

	LIST_FOR_EACH (link, &cache->stores) {
		const struct served *served = store_of(link);

		store_check(served);
		LIST_FOR_EACH (at, &served->arena.in_order)
			draining_count += ARENA_SEGMENT(at)->draining;
		pinned_pages += served->pinned_pages;
		segment_bytes += arena_bytes(&served->arena);
		segment_bytes += served->segment_coming ? served->arena.segment_bytes : 0;
	}
	CHECK(cache->pinned_bytes == pinned_pages * WIRE_PAGE_BYTES);
	CHECK(cache->draining_count == draining_count);
	CHECK(cache->segment_bytes == segment_bytes);
	CHECK(cache->segment_bytes <= cache->budget_bytes);
}
