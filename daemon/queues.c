/* SPDX-License-Identifier: MIT */
#include "daemon/queues.h"

#include <errno.h>

#include "daemon/limits.h"
#include "formats/base/check.h"

static struct queue_entry *fetching_first(struct queues *queues)
{
	return LIST_ENTRY(queues->fetching.next, struct queue_entry, fetch_link);
}

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
		      uint32_t session)
{
	*entry = (struct queue_entry){
		.calls = calls,
		.calls_arg = calls_arg,
		.session = session,
		.turn_bytes = TURN_BYTES,
	};
	list_init(&entry->fetch_link);
	list_init(&entry->prefetch_link);
}

void queue_entry_done(struct queue_entry *entry)
{
	list_remove(&entry->fetch_link);
	list_remove(&entry->prefetch_link);
}

void queues_add_fetch(struct queues *queues, struct queue_entry *entry)
{
	if (list_is_empty(&entry->fetch_link))
		list_push_back(&queues->fetching, &entry->fetch_link);
}

void queues_add_prefetch(struct queues *queues, struct queue_entry *entry)
{
	if (list_is_empty(&entry->prefetch_link))
		list_push_back(&queues->prefetching, &entry->prefetch_link);
}

/* To the end of the queue, with a new turn. */
static void turn_end(struct queues *queues, struct queue_entry *entry)
{
	entry->turn_bytes += TURN_BYTES;
	list_remove(&entry->fetch_link);
	list_push_back(&queues->fetching, &entry->fetch_link);
}

/*
 * One session's turn.  Returns: true when it got on; false when it has to wait for a segment or for
 * staging, which other sessions perhaps need not.
 */
static bool turn(struct queues *queues, struct queue_entry *entry)
{
	struct queue_want want;
	int r;

	if (!entry->calls->next(entry->calls_arg, &want)) {
		/* It has nothing to save its turn for. */
		entry->turn_bytes = TURN_BYTES;
		list_remove(&entry->fetch_link);
		return true;
	}
	r = fills_start(queues->fills, want.served, want.index, entry->session, false);
	if (r == -EAGAIN) {
		list_remove(&entry->fetch_link);
		list_push_back(&queues->fetching, &entry->fetch_link);
		return false;
	}
	CHECK(r == 0 || r == -ENOBUFS);
	entry->calls->begun(entry->calls_arg, &want, r);
	if (r == 0)
		entry->turn_bytes -= want.served->records[want.index].stored_bytes;
	while (entry->turn_bytes <= 0)
		turn_end(queues, entry);
	return true;
}

static void pump_fetches(struct queues *queues)
{
	const struct queue_entry *stuck = NULL;

	while (!list_is_empty(&queues->fetching) && fills_has_room(queues->fills)) {
		struct queue_entry *entry = fetching_first(queues);

		if (entry == stuck)
			return;
		if (turn(queues, entry))
			stuck = NULL;
		else if (!stuck)
			stuck = entry;
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
	pump_fetches(queues);
	if (list_is_empty(&queues->fetching))
		pump_prefetches(queues);
}
