/* SPDX-License-Identifier: MIT */
/* One want: its hold, its grant, its state; and which wants of a set are admitted. */
#include "daemon/sharing/visible_private.h"

#include "formats/base/check.h"
#include "formats/base/clock.h"

/* ---- what is counted and recorded ---- */

void want_count_new(struct visible *visible, struct want *want)
{
	const struct node *node = visible_node_of(visible, want);
	struct store_counters *counters = visible_counters_of(visible, want);

	want_record(visible, node_is_ready(node) ? TRACE_HIT : TRACE_MISS, want);
	if (!node_is_ready(node)) {
		counters->misses++;
		visible->counters.misses++;
		want->missed = true;
		return;
	}
	counters->hits++;
	visible->counters.hits++;
	counters->prefetch_hits += node->unused_prefetch;
	if (node->payer != 0 && node->payer != visible->session) {
		counters->shared_hits++;
		debts_add(&visible->debts, node->payer);
	}
}

/* A missed node is there, or on its way by a read that was begun for somebody else. */
static void count_joined(struct visible *visible, struct want *want)
{
	const struct node *node = visible_node_of(visible, want);

	if (!want->missed)
		return;
	want->missed = false;
	visible_counters_of(visible, want)->joined++;
	if (node->payer != 0 && node->payer != visible->session)
		debts_add(&visible->debts, node->payer);
}

static void count_refused(struct visible *visible, struct want *want, enum wire_reason reason)
{
	struct store_counters *counters = visible_counters_of(visible, want);

	counters->refusals[reason]++;
	visible->counters.refused++;
	counters->refused += want->missed;
	want->missed = false;
}

/* ---- grants and holds ---- */

/*
 * A grant says that the node is READY and stays so: it is set when there is a hold and the bytes are
 * there, both.  (Were it set with the hold of a BUSY node, a client could read it, the fill fail and
 * the hold go, another session bring the node in, and the client read READY then.)
 *
 * Clearing is relaxed: a client believes a grant only after it has read `acknowledged`, which is
 * written with release after them (visible_take).  Setting comes after the fence of the node's word
 * (node_set_state), so that whoever reads the grant also reads that word, or a newer one.
 */
static void grant_set(struct visible *visible, const struct want *want, bool granted)
{
	struct wire_grants *grants = visible->attachments[want->slot]->grants;
	uint64_t bit = UINT64_C(1) << (want->node % 64);
	uint64_t word = atomic_load_explicit(&grants->words[want->node / 64], memory_order_relaxed);

	if (visible->frozen)
		return;
	word = granted ? word | bit : word & ~bit;
	atomic_store_explicit(&grants->words[want->node / 64], word, memory_order_relaxed);
}

static void hold(struct visible *visible, struct want *want)
{
	uint32_t pages = visible_pages_of(visible, want);

	CHECK(!want->holding);
	cache_hold(visible->cache, visible_served_of(visible, want), want->node);
	want->holding = true;
	visible->held_count++;
	visible->held_pages += pages;
	visible->account->held_pages += pages;
	if (visible_node_of(visible, want)->state == NODE_BUSY)
		fills_upgrade(visible->fills, visible_served_of(visible, want), want->node);
}

static void set_revoked(struct visible *visible, struct want *want, bool revoked)
{
	if (want->revoked == revoked)
		return;
	visible->unsure_count += revoked;
	visible->unsure_count -= want->revoked && !want->is_sure;
	want->revoked = revoked;
	want->is_sure = false;
	visible->revoked_count += revoked ? 1 : -1u;
	visible->given_up_count += !revoked;
	room_note_leaving(visible->room, revoked);
}

static void revoke(struct visible *visible, struct want *want)
{
	if (want->revoked)
		return;
	grant_set(visible, want, false);
	set_revoked(visible, want, true);
	visible_counters_of(visible, want)->revocations++;
	visible->counters.revocations++;
}

void want_release(struct visible *visible, struct want *want)
{
	uint32_t pages = visible_pages_of(visible, want);

	CHECK(want->holding);
	grant_set(visible, want, false);
	/*
	 * The cleared grant must be seen by whoever sees what is done to the place after this.
	 * Pairs with the acquire loads of the directory's word and of `acknowledged` in
	 * libclient/client_view.c.
	 */
	atomic_thread_fence(memory_order_release);
	want->holding = false;
	set_revoked(visible, want, false);
	visible->held_count--;
	visible->held_pages -= pages;
	visible->account->held_pages -= pages;
	cache_release(visible->cache, visible_served_of(visible, want), want->node);
}

/* ---- what is wanted at all ---- */

void want_count_in(struct visible *visible, const struct want *want)
{
	if (visible_node_of(visible, want)->want_count++ == 0)
		visible->room->wanted_pages += visible_pages_of(visible, want);
}

void want_count_out(struct visible *visible, const struct want *want)
{
	struct node *node = visible_node_of(visible, want);
	struct room *room = visible->room;

	CHECK(node->want_count > 0);
	if (--node->want_count > 0)
		return;
	room->wanted_pages -= node->page_count;
	if (node->plan == room->plan && node->residence == RESIDENCE_NONE)
		room->left_pages += node->page_count;
	node->plan = 0;
}

bool visible_plan_rest(struct visible *visible)
{
	struct room *room = visible->room;
	uint64_t pages = 0;

	for (uint32_t i = 0; i < visible->count; i++)
		pages += room_new_pages(room, visible_node_of(visible, &visible->wants[i]));
	if (pages > room->left_pages)
		return false;
	room->left_pages -= pages;
	for (uint32_t i = 0; i < visible->count; i++)
		visible_node_of(visible, &visible->wants[i])->plan = room->plan;
	return true;
}

/* ---- states ---- */

static void set_state(struct visible *visible, struct want *want, enum want_state state)
{
	visible->counts[want->state]--;
	visible->counts[state]++;
	visible->unanswered_count -= want_is_unanswered(want);
	if (want->state != state)
		visible->changed = true;
	want->state = state;
	visible->unanswered_count += want_is_unanswered(want);
}

/* The want leaves the state that it is in, which may be REFUSED. */
static void unrefuse(struct visible *visible, struct want *want)
{
	if (want->state != WANT_REFUSED)
		return;
	visible->untold_count -= want->told != want->reason;
	visible->full_count -= visible_is_for_room(want->reason);
	want->reason = WIRE_REASON_NONE;
}

void want_refuse(struct visible *visible, struct want *want, enum wire_reason reason)
{
	uint32_t index = (uint32_t)(want - visible->wants);

	if (want->state != WANT_REFUSED || want->reason != reason)
		count_refused(visible, want, reason);
	if (want->state != WANT_REFUSED)
		want_record(visible, TRACE_REFUSE, want);
	unrefuse(visible, want);
	want->queued_ns = 0;
	want->reason = reason;
	set_state(visible, want, WANT_REFUSED);
	visible->untold_count += want->told != reason;
	visible->full_count += visible_is_for_room(reason);
	if (want->told != reason && index < visible->next_untold)
		visible->next_untold = index;
}

static void queue(struct visible *visible, struct want *want)
{
	uint32_t index = (uint32_t)(want - visible->wants);

	if (!want->missed)
		visible_counters_of(visible, want)->retries++;
	if (want->queued_ns == 0)
		want->queued_ns = visible->now_ns;
	want->missed = true;
	unrefuse(visible, want);
	set_state(visible, want, WANT_QUEUED);
	if (index < visible->next_queued)
		visible->next_queued = index;
}

void want_admit(struct visible *visible, struct want *want)
{
	const struct node *node = visible_node_of(visible, want);

	/* It is fetched anew when all have let go of where it lies. */
	if (cache_is_leaving(visible->cache, visible_served_of(visible, want), want->node)) {
		if (want->holding)
			revoke(visible, want);
		queue(visible, want);
		return;
	}
	set_revoked(visible, want, false);
	if (!want->holding && node->state != NODE_ABSENT)
		hold(visible, want);
	if (node->state == NODE_HELD)
		grant_set(visible, want, true);
	if (node->state == NODE_ABSENT) {
		queue(visible, want);
		return;
	}
	want->queued_ns = 0;
	count_joined(visible, want);
	unrefuse(visible, want);
	set_state(visible, want, node->state == NODE_BUSY ? WANT_WAITING : WANT_DRAWABLE);
}

/* ---- admission ---- */

static bool has_room(const struct visible *visible, const struct want *want)
{
	const struct room *room = visible->room;

	return !room->divided || visible_node_of(visible, want)->plan == room->plan;
}

/* What may still be drawn lies in a segment that is drained: the client is asked to let go. */
static void admit_retained(struct visible *visible)
{
	for (uint32_t i = visible->count; i < visible->total; i++) {
		struct want *want = &visible->wants[i];

		if (cache_is_leaving(visible->cache, visible_served_of(visible, want), want->node))
			revoke(visible, want);
	}
}

void visible_admit(struct visible *visible)
{
	visible->undecided = false;
	visible->now_ns = clock_now_ns();
	visible->retry_at_bytes = UINT64_MAX;
	for (uint32_t i = 0; i < visible->count; i++) {
		struct want *want = &visible->wants[i];

		if (visible_node_of(visible, want)->state == NODE_DAMAGED) {
			want_refuse(visible, want, WIRE_REASON_DAMAGED);
			continue;
		}
		/* A device that has failed is asked again when the node was not wanted for a set. */
		if (want->state == WANT_REFUSED && !visible_is_for_room(want->reason))
			continue;
		if (has_room(visible, want)) {
			want_admit(visible, want);
			continue;
		}
		if (want->holding)
			revoke(visible, want);
		want_refuse(visible, want, WIRE_REASON_FULL);
	}
	if (visible->cache->draining_count > 0)
		admit_retained(visible);
}
