/* SPDX-License-Identifier: MIT */
#include "daemon/sharing/queues.h"

#include <errno.h>

#include "daemon/limits.h"
#include "formats/base/check.h"
#include "formats/base/clock.h"

static struct queue_entry *prefetching_first(struct queues *queues)
{
	return LIST_ENTRY(queues->prefetching.next, struct queue_entry, prefetch_link);
}

void queues_init(struct queues *queues, struct fills *fills)
{
	queues->fills = fills;
	list_init(&queues->fetching);
	list_init(&queues->prefetching);
}

void queue_entry_init(struct queue_entry *entry, const struct queue_calls *calls, void *calls_arg,
		      uint32_t session, struct account *account)
{
	*entry = (struct queue_entry){
		.calls = calls,
		.calls_arg = calls_arg,
		.session = session,
		.account = account,
	};
	list_init(&entry->fetch_link);
	list_init(&entry->prefetch_link);
}

/* It has nothing to save the rest of its turn for. */
static void fetching_remove(struct queue_entry *entry)
{
	if (list_is_empty(&entry->fetch_link))
		return;
	list_remove(&entry->fetch_link);
	entry->account->fetching_count--;
	entry->turn_bytes = 0;
}

void queue_entry_done(struct queues *queues, struct queue_entry *entry)
{
	fetching_remove(entry);
	list_remove(&entry->prefetch_link);
	queues->reader_count -= entry->reads;
}

/* Its part of its user's turn. */
static int64_t turn_bytes(const struct queue_entry *entry)
{
	const struct account *account = entry->account;
	uint64_t bytes = (uint64_t)TURN_BYTES * account->policy.weight / ACCOUNT_WEIGHT_USUAL /
			 account->fetching_count;

	return (int64_t)u64_max(bytes, TURN_BYTES_MIN);
}

void queues_add_fetch(struct queues *queues, struct queue_entry *entry)
{
	entry->room_at_ns = 0;
	if (!list_is_empty(&entry->fetch_link))
		return;
	list_push_back(&queues->fetching, &entry->fetch_link);
	entry->account->fetching_count++;
	entry->turn_bytes = turn_bytes(entry);
	queues->reader_count += !entry->reads;
	entry->reads = true;
}

void queues_add_prefetch(struct queues *queues, struct queue_entry *entry)
{
	if (list_is_empty(&entry->prefetch_link))
		list_push_back(&queues->prefetching, &entry->prefetch_link);
}

static void to_the_end(struct queues *queues, struct queue_entry *entry)
{
	list_remove(&entry->fetch_link);
	list_push_back(&queues->fetching, &entry->fetch_link);
}

/* Holds are always about to be given up where many sets change: no want waits for that for ever. */
static bool has_waited(const struct queues *queues, const struct queue_want *want)
{
	/* It may have been wanted since this pump began. */
	return queues->now_ns > want->wanted_ns + ROOM_WAIT_MS_MAX * NS_PER_MS;
}

/*
 * One session's turn.  Returns: true when it got on; false when it has to wait for a segment, for
 * staging, for room, or for its own reads, which other sessions perhaps need not.
 */
static bool turn(struct queues *queues, struct queue_entry *entry)
{
	uint64_t released_bytes = fills_released_bytes(queues->fills);
	struct queue_want want;
	int r = -EAGAIN;

	if (released_bytes < entry->room_at_bytes && queues->now_ns < entry->room_at_ns)
		return false;
	if (entry->turn_bytes <= 0) {
		entry->turn_bytes += turn_bytes(entry);
		to_the_end(queues, entry);
		return true;
	}
	if (!entry->calls->next(entry->calls_arg, &want)) {
		fetching_remove(entry);
		return true;
	}
	if (fills_has_room_for(queues->fills, entry->session, queues->reader_count > 1))
		r = fills_start(queues->fills, want.served, want.index, entry->session, false);
	if (r == -EBUSY && !has_waited(queues, &want)) {
		entry->room_at_bytes =
			released_bytes +
			(uint64_t)WIRE_PAGE_BYTES * served_pages(want.served, want.index);
		entry->room_at_ns = queues->now_ns + ROOM_RETRY_MS * NS_PER_MS;
		return false;
	}
	if (r == -EAGAIN)
		return false;
	CHECK(r == 0 || r == -ENOBUFS || r == -EBUSY);
	entry->calls->begun(entry->calls_arg, &want, r);
	if (r == 0) {
		entry->turn_bytes -= want.served->records[want.index].stored_bytes;
		fills_note_wait(queues->fills, want.wanted_ns);
	}
	return true;
}

/* Who cannot get on is passed, and keeps its place: its turn is not over. */
static void pump_fetches(struct queues *queues)
{
	struct list *link = queues->fetching.next;

	while (link != &queues->fetching && fills_has_room(queues->fills)) {
		if (turn(queues, LIST_ENTRY(link, struct queue_entry, fetch_link)))
			link = queues->fetching.next;
		else
			link = link->next;
	}
}

static void pump_prefetches(struct queues *queues)
{
	while (!list_is_empty(&queues->prefetching) && fills_has_prefetch_room(queues->fills)) {
		struct queue_entry *entry = prefetching_first(queues);
		struct queue_want want;

		list_remove(&entry->prefetch_link);
		if (!entry->calls->next_prefetch(entry->calls_arg, &want))
			continue;
		list_push_back(&queues->prefetching, &entry->prefetch_link);
		if (fills_start(queues->fills, want.served, want.index, entry->session, true) ==
		    -EAGAIN)
			return;
		/* Where everything is held, a prefetch is not worth waiting for. */
		entry->calls->prefetch_over(entry->calls_arg);
	}
}

void queues_pump(struct queues *queues)
{
	queues->now_ns = clock_now_ns();
	pump_fetches(queues);
	if (list_is_empty(&queues->fetching))
		pump_prefetches(queues);
}
