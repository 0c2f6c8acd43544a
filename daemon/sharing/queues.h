/* SPDX-License-Identifier: MIT */
/**
 * queues.h - who gets the disk next: fetches of all sessions in turn, prefetches when none waits.
 *
 * Each session keeps its own wants in its own order and is asked for the next one (queue_calls), so
 * that a new set never has to be taken out of a queue.  Sessions that wait take turns; a turn is as
 * long as the user's weight says, divided among those of the user's sessions that wait.
 * No more is begun than the fetch layer can read at once, so that what is asked for later and
 * matters more overtakes what has not been begun.
 *
 * Threads: loop thread.
 * Source: deficit round robin, Shreedhar and Varghese (1995).
 */
#ifndef DAEMON_SHARING_QUEUES_H
#define DAEMON_SHARING_QUEUES_H

#include <stdbool.h>
#include <stdint.h>

#include "daemon/fetch/fills.h"
#include "daemon/sharing/accounts.h"
#include "formats/base/list.h"

/** A node that a session wants read. */
struct queue_want {
	struct served *served;
	uint32_t index;
	uint64_t wanted_ns; /* since; of a fetch */
};

/** Asked of whoever waits in a queue. */
struct queue_calls {
	/** The most important ABSENT node that is wanted and not refused; false: none. */
	bool (*next)(void *arg, struct queue_want *ret);
	/** What became of it: error 0 (BUSY now), -ENOBUFS (all is held) or -EBUSY (still). */
	void (*begun)(void *arg, const struct queue_want *want, int error);
	/** The next ABSENT node to prefetch; false: none. */
	bool (*next_prefetch)(void *arg, struct queue_want *ret);
	/** It was begun, or cannot be: the one after it is the next. */
	void (*prefetch_over)(void *arg);
};

/** One for each session; zeroed, then queue_entry_init(). */
struct queue_entry {
	struct list fetch_link;    /* queues.fetching */
	struct list prefetch_link; /* queues.prefetching */
	const struct queue_calls *calls;
	void *calls_arg;
	struct account *account; /* NULL: it never fetches */
	uint32_t session;
	bool reads;         /* has asked for a fetch: the disk is shared with it */
	int64_t turn_bytes; /* left of its turn */
	/* There is no room for what it wants before the cache has released so much, or until then. */
	uint64_t room_at_bytes;
	uint64_t room_at_ns;
};

struct queues {
	struct fills *fills;
	struct list fetching; /* sessions with fetches that wait, whose turn it is first */
	struct list prefetching;
	uint32_t reader_count; /* sessions that have asked for fetches */
	uint64_t now_ns;       /* when the newest pump began */
};

void queues_init(struct queues *queues, struct fills *fills);

void queue_entry_init(struct queue_entry *entry, const struct queue_calls *calls, void *calls_arg,
		      uint32_t session, struct account *account);
void queue_entry_done(struct queues *queues, struct queue_entry *entry);

/** The session may have wants that wait, perhaps others than before.  Harmless when it has none. */
void queues_add_fetch(struct queues *queues, struct queue_entry *entry);
void queues_add_prefetch(struct queues *queues, struct queue_entry *entry);

/** Does it wait for fetches already? */
static inline bool queues_has_fetch(const struct queue_entry *entry)
{
	return !list_is_empty(&entry->fetch_link);
}

/** Begins what can be begun. */
void queues_pump(struct queues *queues);

#endif /* DAEMON_SHARING_QUEUES_H */
