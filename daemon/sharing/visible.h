/* SPDX-License-Identifier: MIT */
/**
 * visible.h - the visible set of one session: what it wants, holds, waits for and was refused.
 *
 * A set replaces the set before it.  Its wants are in the client's order, most important first:
 *
 *	QUEUED     absent; a fetch will be begun when its turn comes.  No hold, unless it is revoked:
 *	           the node lies where it cannot stay, and is fetched anew when all have let go.
 *	WAITING    the node is BUSY.  Hold; no grant before it is there.
 *	DRAWABLE   the node is HELD.  Hold and grant.
 *	REFUSED    "not now", with a reason.  No grant, and no hold unless it is revoked (below).
 *	RETAINED   an older set had it and the newest one has not, but the client may still draw it.
 *	           Hold, and grant if it had one, until it is retired.
 *
 *	from                to         when
 *	(new)               any but RETAINED   visible_take: by the node's state and the room
 *	QUEUED              WAITING    its fill is begun, by whomever
 *	QUEUED, WAITING     DRAWABLE   the fill has ended well
 *	QUEUED, WAITING     REFUSED    the fill has failed, or there is no room
 *	DRAWABLE, WAITING   REFUSED    revoked: something more important needs the room
 *	DRAWABLE, WAITING   QUEUED     revoked: its segment is drained
 *	REFUSED             QUEUED..   room has appeared, or a new set
 *	any with a hold     RETAINED   a new set has it not
 *	RETAINED            (gone)     retired
 *
 * Room: while all that is wanted by all sets fits into the cache, every want is admitted.  Otherwise
 * the cache is divided among the sets (division.h), and admitted is what is planned; the rest is
 * refused, and a hold on it is *revoked*: its grant bit is cleared at once, the hold itself is given
 * up later, for the client may be drawing the node.  It is given up when the client retires what it
 * drew before a set that it surely sent after the bit was cleared: one that came after its socket had
 * been seen empty (visible_note_quiet).  A client that says nothing is asked to let go (session.h).
 *
 * Order towards clients (all of it is in daemon/README.md): a grant is cleared before its hold is
 * given up, and `acknowledged` is written after all grants of the set are right.
 *
 * Threads: loop thread.
 */
#ifndef DAEMON_SHARING_VISIBLE_H
#define DAEMON_SHARING_VISIBLE_H

#include <assert.h>
#include <stdbool.h>
#include <stdint.h>

#include "daemon/cache/cache.h"
#include "daemon/sharing/accounts.h"
#include "daemon/sharing/debts.h"
#include "daemon/sharing/queues.h"
#include "daemon/sharing/room.h"
#include "libclient/wire.h"

/** A session's view of a store. */
struct attachment {
	struct served *served;
	struct memfile grants_file;
	struct wire_grants *grants;
	uint32_t *want_of_node; /* node_count: 0, or 1 + index of the want */
};

enum want_state {
	WANT_QUEUED,
	WANT_WAITING,
	WANT_DRAWABLE,
	WANT_REFUSED,
	WANT_RETAINED,
	WANT_STATE_COUNT_
};

/** Two a cache line: with every frame thousands are made and let go. */
struct want {
	uint64_t serial;    /* newest set that has it */
	uint64_t queued_ns; /* while QUEUED: since */
	uint32_t node;
	uint32_t sure; /* while is_sure: visible.serial then, its low half */
	uint8_t slot;  /* of the store */
	enum want_state state : 8;
	enum wire_reason reason : 8; /* while REFUSED */
	enum wire_reason told : 8;   /* the last reason that the client was told in this set */
	bool holding;
	bool revoked; /* holding, but its grant was cleared */
	bool is_sure; /* and the client's socket was seen empty since */
	bool missed;  /* not there when it was asked for, and nothing has come of it yet */
};

static_assert(sizeof(struct want) <= 32, "two a cache line");
static_assert(WIRE_STORE_COUNT_MAX <= UINT8_MAX, "a want names its store");

/** What has happened to a session's wants: see STORE_COUNTERS. */
struct visible_counters {
	uint64_t sets;
	uint64_t hits;
	uint64_t misses;
	uint64_t fetches;
	uint64_t refused;
	uint64_t revocations;
};

struct visible {
	struct list link; /* room.sets */
	struct room *room;
	struct cache *cache;
	struct account *account; /* of its user */
	struct fills *fills;
	struct wire_session_page *page;
	uint32_t session; /* whose it is */
	struct attachment *attachments[WIRE_STORE_COUNT_MAX];
	uint64_t attached; /* bit: slot */

	struct want *wants; /* the set in its order, then what is retained */
	struct want *spare; /* the next set is made here */
	uint32_t capacity;
	uint32_t spare_capacity;
	uint32_t count; /* of the set */
	uint32_t total; /* with what is retained */

	uint64_t serial;   /* of the set; 0: there was none */
	uint64_t settled;  /* as the page says, and */
	uint64_t complete; /* likewise */
	uint64_t now_ns;   /* when it was last admitted, as wants are queued then */
	uint32_t counts[WANT_STATE_COUNT_];
	uint32_t
		unanswered_count; /* wants that keep the set from being settled: want_is_unanswered() */
	uint32_t untold_count;
	uint32_t next_queued; /* no QUEUED want lies before it */
	uint32_t next_untold; /* no untold one */
	/* What was refused for want of a place is tried again when the cache has released so much. */
	uint64_t retry_at_bytes;
	uint32_t full_count; /* refused for room */
	bool undecided;      /* taken over; what of it is admitted is not yet known */

	/* Of the newest division of the cache (division.c). */
	struct list claim_link;
	uint32_t claim_next;
	uint64_t claim_share;
	uint64_t claim_charge;

	uint32_t revoked_count;
	uint32_t unsure_count;   /* of them, what is not sure yet */
	uint64_t given_up_count; /* revoked holds that were given up, ever */

	struct visible_counters counters;
	struct debts debts;

	uint32_t held_count; /* holds */
	uint64_t held_pages;
	bool changed; /* something that an EVENT tells has happened */
	bool frozen;  /* the daemon ends: what clients see stays as it is */
};

/** session, page: of whose it is; all outlive it. */
void visible_init(struct visible *visible, struct room *room, struct account *account,
		  struct fills *fills, uint32_t session, struct wire_session_page *page);
/** Gives everything back. */
void visible_done(struct visible *visible);

/**
 * Opens a store for the session.
 *
 * Returns: 0, -ENOMEM or -errno.
 */
int visible_attach(struct visible *visible, uint32_t slot, struct served *served, uint64_t epoch,
		   struct why *why);
/** Gives all of it back, and all that was wanted of it. */
void visible_detach(struct visible *visible, uint32_t slot);

/**
 * Takes a set over and acknowledges it.
 *
 * entries:  of attached stores, nodes with payload, in descending importance; the second mention
 *           of a node counts as none.
 * serial:   above that of the set before.
 * retire:   older sets are no longer drawn.
 *
 * Returns: 0, -EPROTO (a node that is none) or -ENOMEM; then the set before stays.
 */
int visible_take(struct visible *visible, const struct wire_entry *entries, uint32_t entry_count,
		 uint64_t serial, bool retire);

/** Sets before `serial` are no longer drawn; above the newest: nothing is that was looked at so far. */
void visible_retire(struct visible *visible, uint64_t serial);

/** Is it worth looking whether the socket is empty? */
static inline bool visible_wants_quiet(const struct visible *visible)
{
	return visible->unsure_count > 0;
}

/** Nothing that the client has sent is unread: what comes next was sent after all that was done. */
void visible_note_quiet(struct visible *visible);

/** Gives each want of the set a state: what there is room for is admitted, the rest refused. */
void visible_admit(struct visible *visible);

/** Admits again what was refused for want of a place, if enough has been released. */
void visible_retry(struct visible *visible);

/** For queues.h. */
bool visible_next(struct visible *visible, struct queue_want *ret);
void visible_begun(struct visible *visible, const struct queue_want *want, int error);

/** A fill has ended (see fills_ended_fn for when). */
void visible_fill_ended(struct visible *visible, const struct fill_result *result);

/** Is there something for visible_take_refusals()?  What the set before was refused is not decided anew yet. */
static inline bool visible_owes_refusals(const struct visible *visible)
{
	return visible->untold_count > 0 && !visible->undecided;
}

/**
 * Refusals of the set that the client has not been told of, most important first; they count as told.
 *
 * Returns: how many there are in ret.
 */
uint32_t visible_take_refusals(struct visible *visible, struct wire_refusal *ret,
			       uint32_t count_max);

/** Writes `settled` and `complete` when it is so. */
void visible_settle(struct visible *visible);

/**
 * Missed nodes whose read has not been begun.  While it is not decided what is admitted of a set, what
 * is in the cache waits as well, and is none of them.
 *
 * Cost: O(1); O(wants) while it is not decided.
 */
uint32_t visible_queued_count(const struct visible *visible);

static inline uint32_t visible_missing_count(const struct visible *visible)
{
	return visible->counts[WANT_QUEUED] + visible->counts[WANT_WAITING];
}

static inline struct served *visible_served_of(const struct visible *visible,
					       const struct want *want)
{
	return visible->attachments[want->slot]->served;
}

static inline struct node *visible_node_of(const struct visible *visible, const struct want *want)
{
	return &visible_served_of(visible, want)->nodes[want->node];
}

static inline uint32_t visible_pages_of(const struct visible *visible, const struct want *want)
{
	return served_pages(visible_served_of(visible, want), want->node);
}

static inline struct store_counters *visible_counters_of(const struct visible *visible,
							 const struct want *want)
{
	return &visible_served_of(visible, want)->counters;
}

/** A refusal that ends by itself when others let go. */
static inline bool visible_is_for_room(enum wire_reason reason)
{
	return reason == WIRE_REASON_FULL || reason == WIRE_REASON_NO_MEMORY;
}

/** Asserts the comments above.  O(wants). */
void visible_check(const struct visible *visible);

#endif /* DAEMON_SHARING_VISIBLE_H */
