/* SPDX-License-Identifier: MIT */
#include "daemon/sharing/room.h"

#include "daemon/limits.h"
#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/base/clock.h"

void room_init(struct room *room, struct cache *cache)
{
	*room = (struct room){ .cache = cache };
	list_init(&room->sets);
}

void room_note_change(struct room *room)
{
	room->changed = true;
	room->unusable_pages -= (room->unusable_pages + 3) / 4;
}

void room_note_no_place(struct room *room)
{
	const struct cache *cache = room->cache;
	uint64_t unusable_pages = (cache->budget_bytes - cache->pinned_bytes) / WIRE_PAGE_BYTES;

	/* What is leaving is room that is still to come. */
	if (room->leaving_count > 0 || unusable_pages <= room->unusable_pages)
		return;
	room->unusable_pages = unusable_pages;
	room->changed = true;
}

void room_note_leaving(struct room *room, bool revoked)
{
	CHECK(revoked || room->leaving_count > 0);
	room->leaving_count += revoked ? 1 : -1u;
	room->leaving_clock++;
	/* Holders in a segment that is about to be drained have yet to be told. */
	room->cache->room_is_coming =
		room->leaving_count > 0 || room->drain_count != room->cache->drain_count;
}

void room_tick(struct room *room, uint64_t now_ns)
{
	if (room->leaving_clock != room->leaving_seen) {
		room->leaving_seen = room->leaving_clock;
		room->leaving_since_ns = now_ns;
	} else if (now_ns - room->leaving_since_ns > LEAVING_MS_MAX * NS_PER_MS) {
		room->cache->room_is_coming = false;
	}
}
