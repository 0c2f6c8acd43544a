/* SPDX-License-Identifier: MIT */
#include "daemon/sharing/residents.h"

#include <errno.h>

#include "daemon/limits.h"
#include "formats/base/check.h"
#include "formats/base/text.h"

/* A session's number is never 0. */
#define NO_SESSION 0u

static uint32_t node_at(const uint32_t *nodes, uint32_t i)
{
	return nodes ? nodes[i] : i;
}

uint64_t residents_bytes(const struct residents *residents)
{
	uint64_t pages = 0;

	LIST_FOR_EACH (link, &residents->cache->stores)
		pages += LIST_ENTRY(link, struct served, link)->resident_pages;
	return pages * WIRE_PAGE_BYTES;
}

static void hold(struct residents *residents, struct served *served, uint32_t index)
{
	struct node *node = &served->nodes[index];

	CHECK(node->residence == RESIDENCE_WANTED);
	cache_hold(residents->cache, served, index);
	node->residence = RESIDENCE_HELD;
	served->resident_wanted_count--;
}

/* Is it there or on its way, and where it can stay? */
static bool can_be_held(const struct residents *residents, const struct served *served,
			uint32_t index)
{
	const struct node *node = &served->nodes[index];

	return (node_is_ready(node) || node->state == NODE_BUSY) &&
	       !cache_is_leaving(residents->cache, served, index);
}

static void set_wanted(struct served *served, uint32_t index)
{
	served->nodes[index].residence = RESIDENCE_WANTED;
	served->resident_count++;
	served->resident_wanted_count++;
	served->resident_pages += served_pages(served, index);
	served->resident_next = (uint32_t)u64_min(served->resident_next, index);
}

/* Its hold has been given back, if it had one. */
static void set_none(struct served *served, uint32_t index)
{
	struct node *node = &served->nodes[index];

	if (node->residence == RESIDENCE_WANTED)
		served->resident_wanted_count--;
	node->residence = RESIDENCE_NONE;
	served->resident_count--;
	served->resident_pages -= served_pages(served, index);
}

/* Pages that pinning the nodes would add; one that is given twice counts twice, which only refuses. */
static uint64_t pages_to_add(const struct served *served, const uint32_t *nodes,
			     uint32_t node_count)
{
	uint64_t pages = 0;

	for (uint32_t i = 0; i < node_count; i++) {
		uint32_t index = node_at(nodes, i);

		if (served_has_payload(served, index) &&
		    served->nodes[index].residence == RESIDENCE_NONE)
			pages += served_pages(served, index);
	}
	return pages;
}

int residents_pin(struct residents *residents, struct served *served, const uint32_t *nodes,
		  uint32_t node_count, struct residents_sum *ret, struct why *why)
{
	uint64_t share_bytes = residents->cache->budget_wanted_bytes / RESIDENT_SHARE;
	uint64_t bytes = residents_bytes(residents) +
			 pages_to_add(served, nodes, node_count) * WIRE_PAGE_BYTES;
	struct residents_sum sum = { 0 };

	if (bytes > share_bytes) {
		char asked[TEXT_SIZE_BYTES];
		char share[TEXT_SIZE_BYTES];

		return why_set(
			why, -ENOBUFS,
			"%s would be pinned, %s may be (1/%u of the cache): pin fewer nodes, "
			"unpin others, or give oocd a larger --cache-size",
			text_from_size(bytes, asked), text_from_size(share_bytes, share),
			RESIDENT_SHARE);
	}
	for (uint32_t i = 0; i < node_count; i++) {
		uint32_t index = node_at(nodes, i);
		struct node *node = &served->nodes[index];

		if (!served_has_payload(served, index) || node->state == NODE_DAMAGED)
			continue;
		if (node->residence == RESIDENCE_NONE)
			set_wanted(served, index);
		if (node->residence == RESIDENCE_WANTED && can_be_held(residents, served, index))
			hold(residents, served, index);
		sum.nodes++;
		sum.bytes += (uint64_t)served_pages(served, index) * WIRE_PAGE_BYTES;
		sum.there += node_is_ready(node);
	}
	if (served->resident_wanted_count > 0)
		queues_add_prefetch(residents->queues, &residents->queue_entry);
	*ret = sum;
	return 0;
}

void residents_unpin(struct residents *residents, struct served *served, const uint32_t *nodes,
		     uint32_t node_count, struct residents_sum *ret)
{
	struct residents_sum sum = { 0 };

	for (uint32_t i = 0; i < node_count && served->resident_count > 0; i++) {
		uint32_t index = node_at(nodes, i);
		const struct node *node = &served->nodes[index];

		if (node->residence == RESIDENCE_NONE)
			continue;
		sum.nodes++;
		sum.bytes += (uint64_t)served_pages(served, index) * WIRE_PAGE_BYTES;
		sum.there += node_is_ready(node);
		if (node->residence == RESIDENCE_HELD)
			cache_release(residents->cache, served, index);
		set_none(served, index);
	}
	*ret = sum;
}

void residents_fill_ended(struct residents *residents, const struct fill_result *result)
{
	struct served *served = result->served;
	const struct node *node = &served->nodes[result->index];

	if (node->residence == RESIDENCE_NONE)
		return;
	if (result->reason == WIRE_REASON_NONE) {
		if (node->residence == RESIDENCE_WANTED &&
		    can_be_held(residents, served, result->index))
			hold(residents, served, result->index);
		return;
	}
	/* A failed node loses its holders before it changes; the log has said what is wrong with it. */
	if (node->residence == RESIDENCE_HELD)
		cache_release(residents->cache, served, result->index);
	set_none(served, result->index);
}

/* What lies in a segment that is drained comes anew, elsewhere. */
static void let_go(struct residents *residents, struct served *served)
{
	for (uint32_t i = 0; i < served->node_count && served->resident_count > 0; i++) {
		struct node *node = &served->nodes[i];

		if (node->residence != RESIDENCE_HELD ||
		    !cache_is_leaving(residents->cache, served, i))
			continue;
		node->residence = RESIDENCE_WANTED;
		served->resident_wanted_count++;
		served->resident_next = (uint32_t)u64_min(served->resident_next, i);
		cache_release(residents->cache, served, i);
	}
}

void residents_retry(struct residents *residents)
{
	struct cache *cache = residents->cache;

	if (residents->drain_count != cache->drain_count) {
		residents->drain_count = cache->drain_count;
		LIST_FOR_EACH (link, &cache->stores)
			let_go(residents, LIST_ENTRY(link, struct served, link));
		queues_add_prefetch(residents->queues, &residents->queue_entry);
	}
	if (residents->retry_at_bytes == 0 ||
	    residents->cache->released_bytes < residents->retry_at_bytes)
		return;
	residents->retry_at_bytes = 0;
	queues_add_prefetch(residents->queues, &residents->queue_entry);
}

/* ---- queues ---- */

/* The next node of a store that is wanted and has to be read. */
static bool next_of(struct residents *residents, struct served *served, struct queue_want *ret)
{
	if (served->resident_wanted_count == 0)
		return false;
	for (; served->resident_next < served->node_count; served->resident_next++) {
		const struct node *node = &served->nodes[served->resident_next];

		if (node->residence != RESIDENCE_WANTED)
			continue;
		if (can_be_held(residents, served, served->resident_next)) {
			hold(residents, served, served->resident_next);
		} else if (node->state == NODE_ABSENT) {
			*ret = (struct queue_want){ served, served->resident_next, 0 };
			return true;
		}
	}
	return false;
}

static bool queue_next_prefetch(void *arg, struct queue_want *ret)
{
	struct residents *residents = arg;

	if (residents->retry_at_bytes > 0)
		return false;
	LIST_FOR_EACH (link, &residents->cache->stores) {
		if (next_of(residents, LIST_ENTRY(link, struct served, link), ret)) {
			residents->asked = *ret;
			return true;
		}
	}
	return false;
}

/* The one that was asked for is being read, or there was no place for it. */
static void queue_prefetch_over(void *arg)
{
	struct residents *residents = arg;
	struct served *served = residents->asked.served;
	uint32_t index = residents->asked.index;

	if (can_be_held(residents, served, index))
		hold(residents, served, index);
	else
		residents->retry_at_bytes = residents->cache->released_bytes +
					    (uint64_t)served_pages(served, index) * WIRE_PAGE_BYTES;
}

static const struct queue_calls queue_calls = {
	.next_prefetch = queue_next_prefetch,
	.prefetch_over = queue_prefetch_over,
};

void residents_init(struct residents *residents, struct cache *cache, struct queues *queues)
{
	*residents = (struct residents){ .cache = cache, .queues = queues };
	queue_entry_init(&residents->queue_entry, &queue_calls, residents, NO_SESSION, NULL);
}

void residents_done(struct residents *residents)
{
	if (residents->queues)
		queue_entry_done(residents->queues, &residents->queue_entry);
}
