/* SPDX-License-Identifier: MIT */
/**
 * room.h - what all sets of all clients together want of the cache, and whether it fits.
 *
 * While all that is wanted fits, there is nothing to divide: each set is admitted as it comes.  When it
 * does not, the cache is *divided* (division.h): every node is planned or not, for everybody, and a set
 * may hold what is planned.
 *
 * Threads: loop thread.
 */
#ifndef DAEMON_SHARING_ROOM_H
#define DAEMON_SHARING_ROOM_H

#include <stdbool.h>
#include <stdint.h>

#include "daemon/cache/cache.h"
#include "formats/base/bytes.h"
#include "formats/base/list.h"

struct room {
	struct cache *cache;
	struct list sets; /* struct visible.link: of all sessions */
	/* Of all nodes that a set wants or a client may still draw, each once. */
	uint64_t wanted_pages;
	/*
	 * Pages that turned out to be of no use, because what is held lies scattered.  It only grows
	 * while no set changes, so that trying ends; with each set that changes a quarter is forgotten.
	 */
	uint64_t unusable_pages;
	uint64_t resident_pages; /* that administrators have pinned; division.c refreshes it */
	uint64_t pages;          /* room_pages() at the newest division */
	/* Of them, what it left to nobody, and what nobody wants any more since. */
	uint64_t left_pages;
	uint32_t plan;          /* number of the newest division; 0: there was none */
	bool changed;           /* what is wanted has, since the newest division */
	bool divided;           /* what is planned counts */
	uint32_t leaving_count; /* revoked holds that are not given up yet */
	uint64_t drain_count;   /* of the cache, when sets were last told */

	/* Whether what is leaving still gets anywhere: room_tick(). */
	uint64_t leaving_clock; /* +1 with each hold that is revoked or given up */
	uint64_t leaving_seen;
	uint64_t leaving_since_ns;
};

void room_init(struct room *room, struct cache *cache);

/** Pages that sets may plan with. */
static inline uint64_t room_pages(const struct room *room)
{
	uint64_t pages = cache_room_bytes(room->cache) / WIRE_PAGE_BYTES;

	return pages - u64_min(pages, room->unusable_pages + room->resident_pages);
}

/** What a node takes of what the newest division leaves: nothing, if it is planned already. */
static inline uint32_t room_new_pages(const struct room *room, const struct node *node)
{
	/* What is pinned is in the cache anyhow: room_pages() goes without it. */
	return node->plan == room->plan || node->residence != RESIDENCE_NONE ? 0 : node->page_count;
}

/** Is more wanted than fits? */
static inline bool room_is_tight(const struct room *room)
{
	return room->wanted_pages > room_pages(room);
}

/** Has division_settle() something to do? */
static inline bool room_is_unsettled(const struct room *room)
{
	return room->changed || room->drain_count != room->cache->drain_count ||
	       room->pages != room_pages(room);
}

/** A set has changed. */
void room_note_change(struct room *room);

/** A place that is planned was not to be found: what is free is of no use as it lies. */
void room_note_no_place(struct room *room);

/** A revoked hold has come, or has been given up. */
void room_note_leaving(struct room *room, bool revoked);

/**
 * Once a while: fetches wait for revoked holds (cache.room_is_coming) only while these are given up one
 * after the other.
 */
void room_tick(struct room *room, uint64_t now_ns);

#endif /* DAEMON_SHARING_ROOM_H */
