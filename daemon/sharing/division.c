/* SPDX-License-Identifier: MIT */
#include "daemon/sharing/division.h"

#include "daemon/limits.h"
#include "daemon/sharing/accounts.h"
#include "formats/base/bytes.h"
#include "formats/base/check.h"

/* Shares and charges are in parts of a page, so that the share of one among many is something. */
#define PAGE_PARTS 256u
/* Steps in which a walk comes to its share, and how many of them come before what is kept. */
#define SHARE_STEPS 16u
#define SURE_STEPS  15u
/* What accounts without a guaranteed share have at least, whatever others are promised. */
#define UNPROMISED_PERMILLE_MIN 50u

struct division {
	struct room *room;
	uint64_t left_pages;
	uint32_t plan_before;
	struct list walking; /* struct visible.claim_link */
};

static struct visible *set_of(struct list *link)
{
	return LIST_ENTRY(link, struct visible, link);
}

static struct visible *walker_of(struct list *link)
{
	return LIST_ENTRY(link, struct visible, claim_link);
}

static bool claims(const struct visible *visible)
{
	return visible->total > 0;
}

/* ---- shares ---- */

static void count_claims(struct room *room)
{
	LIST_FOR_EACH (link, &room->sets)
		set_of(link)->account->claim_count = 0;
	LIST_FOR_EACH (link, &room->sets)
		if (claims(set_of(link)))
			set_of(link)->account->claim_count++;
}

/*
 * What each claim is guaranteed, in parts of a page.  An account's part is added up at each of its
 * sessions as 1 / claim_count of it, so that nobody has to list the accounts.
 */
static void set_shares(struct room *room)
{
	double promised_permille = 0.0;
	double weights = 0.0;
	double open_permille;
	double total_permille;
	double parts = (double)room_pages(room) * PAGE_PARTS;

	LIST_FOR_EACH (link, &room->sets) {
		const struct visible *visible = set_of(link);
		const struct account *account = visible->account;

		if (!claims(visible))
			continue;
		if (account->policy.share_permille > 0)
			promised_permille +=
				(double)account->policy.share_permille / account->claim_count;
		else
			weights += (double)account->policy.weight / account->claim_count;
	}
	/* Who promises more than there is gives each his part of it. */
	open_permille = promised_permille < 1000.0 - UNPROMISED_PERMILLE_MIN
				? 1000.0 - promised_permille
				: UNPROMISED_PERMILLE_MIN;
	total_permille = promised_permille + open_permille;
	LIST_FOR_EACH (link, &room->sets) {
		struct visible *visible = set_of(link);
		const struct account *account = visible->account;
		double permille;

		if (!claims(visible))
			continue;
		permille = account->policy.share_permille > 0
				   ? (double)account->policy.share_permille
				   : open_permille * account->policy.weight / weights;
		visible->claim_share =
			(uint64_t)(parts * permille / total_permille / account->claim_count);
	}
}

/* ---- the walk ---- */

/* Returns: false when it does not fit. */
static bool plan_one(struct division *division, struct visible *visible, const struct want *want)
{
	struct node *node = visible_node_of(visible, want);
	uint32_t pages = room_new_pages(division->room, node);

	if (pages > division->left_pages)
		return false;
	division->left_pages -= pages;
	visible->claim_charge += (uint64_t)pages * PAGE_PARTS;
	node->plan = division->room->plan;
	return true;
}

/* What a client may still draw of older sets stays, whatever is wanted now. */
static void plan_retained(struct division *division, struct visible *visible)
{
	for (uint32_t i = visible->count; i < visible->total; i++) {
		const struct want *want = &visible->wants[i];

		if (!want->revoked)
			(void)plan_one(division, visible, want);
	}
}

/* It is in memory, as the division before wanted it. */
static bool is_kept(const struct division *division, const struct node *node)
{
	return node->plan == division->plan_before &&
	       (node->state == NODE_HELD || node->state == NODE_BUSY);
}

/*
 * Walks on as far as so much pays for.
 *
 * kept_only:  passes all that is_kept() does not know.
 *
 * Returns: false when the walk has ended.
 */
static bool walk(struct division *division, struct visible *visible, uint64_t charge,
		 bool kept_only)
{
	for (; visible->claim_next < visible->count; visible->claim_next++) {
		const struct want *want = &visible->wants[visible->claim_next];
		const struct node *node = visible_node_of(visible, want);

		/* What is damaged or cannot be read needs no room. */
		if (node->state == NODE_DAMAGED ||
		    (want->state == WANT_REFUSED && !visible_is_for_room(want->reason)))
			continue;
		if (kept_only && !is_kept(division, node))
			continue;
		if (visible->claim_charge +
			    (uint64_t)room_new_pages(division->room, node) * PAGE_PARTS >
		    charge)
			return true;
		if (!plan_one(division, visible, want))
			return false;
	}
	return false;
}

/* All walks at the same time, from the first step to the last, or until they have ended. */
static void walk_all(struct division *division, uint64_t first, uint64_t last, bool kept_only)
{
	for (uint64_t step = first; step <= last && !list_is_empty(&division->walking); step++)
		LIST_FOR_EACH (link, &division->walking) {
			struct visible *visible = walker_of(link);
			uint64_t step_charge = u64_max(visible->claim_share / SHARE_STEPS, 1);

			if (!walk(division, visible, step * step_charge, kept_only))
				list_remove(link);
		}
}

/* All sets walk from their beginning: what is planned costs nothing. */
static void begin_walks(struct division *division)
{
	LIST_FOR_EACH (link, &division->room->sets) {
		struct visible *visible = set_of(link);

		visible->claim_next = 0;
		list_remove(&visible->claim_link);
		if (visible->count > 0)
			list_push_back(&division->walking, &visible->claim_link);
	}
}

static void divide(struct room *room)
{
	struct division division = {
		.room = room,
		.left_pages = room_pages(room),
		.plan_before = room->plan,
	};

	list_init(&division.walking);
	/* 0 is the plan of nodes that none has ever had. */
	if (++room->plan == 0)
		room->plan = 1;
	count_claims(room);
	set_shares(room);
	LIST_FOR_EACH (link, &room->sets) {
		struct visible *visible = set_of(link);

		visible->claim_charge = 0;
		plan_retained(&division, visible);
	}
	begin_walks(&division);
	walk_all(&division, 1, SURE_STEPS, false);
	begin_walks(&division);
	walk_all(&division, SURE_STEPS + 1, UINT64_MAX, true);
	begin_walks(&division);
	walk_all(&division, SURE_STEPS + 1, UINT64_MAX, false);
	room->left_pages = division.left_pages;
}

static uint64_t resident_pages(const struct cache *cache)
{
	uint64_t pages = 0;

	LIST_FOR_EACH (link, &cache->stores)
		pages += LIST_ENTRY(link, struct served, link)->resident_pages;
	return pages;
}

void division_settle(struct room *room)
{
	bool drained = room->drain_count != room->cache->drain_count;
	bool was_divided = room->divided;

	room->resident_pages = resident_pages(room->cache);
	if (!room_is_unsettled(room))
		return;
	room->changed = false;
	room->pages = room_pages(room);
	room->drain_count = room->cache->drain_count;
	room->divided = room_is_tight(room);
	if (room->divided)
		divide(room);
	if (!room->divided && !was_divided && !drained)
		return;
	LIST_FOR_EACH (link, &room->sets)
		visible_admit(set_of(link));
}
