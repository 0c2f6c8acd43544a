/* SPDX-License-Identifier: MIT */
#include "daemon/visible.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/recorder.h"
#include "formats/base/bytes.h"
#include "formats/base/check.h"

void visible_init(struct visible *visible, struct cache *cache, struct fills *fills,
		  uint32_t session, struct wire_session_page *page)
{
	*visible = (struct visible){
		.cache = cache,
		.fills = fills,
		.session = session,
		.page = page,
	};
}

static struct served *served_of(const struct visible *visible, const struct want *want)
{
	return visible->attachments[want->slot]->served;
}

static struct node *node_of(const struct visible *visible, const struct want *want)
{
	return &served_of(visible, want)->nodes[want->node];
}

static uint32_t pages_of(const struct visible *visible, const struct want *want)
{
	return served_pages(served_of(visible, want), want->node);
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
	CHECK(!want->holding);
	cache_hold(visible->cache, served_of(visible, want), want->node);
	want->holding = true;
	visible->held_count++;
	visible->held_pages += pages_of(visible, want);
	if (node_of(visible, want)->state == NODE_BUSY)
		fills_upgrade(visible->fills, served_of(visible, want), want->node);
}

static void set_revoked(struct visible *visible, struct want *want, bool revoked)
{
	if (want->revoked == revoked)
		return;
	want->revoked = revoked;
	visible->revoked_count += revoked ? 1 : -1u;
	if (revoked)
		visible->quiet = false;
}

static void release(struct visible *visible, struct want *want)
{
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
	visible->held_pages -= pages_of(visible, want);
	cache_release(visible->cache, served_of(visible, want), want->node);
}

/* ---- what is counted and recorded ---- */

static void record(const struct visible *visible, enum trace_kind kind, const struct want *want)
{
	recorder_want(served_of(visible, want), kind, visible->session, want->node);
}

static struct store_counters *counters_of(const struct visible *visible, const struct want *want)
{
	return &served_of(visible, want)->counters;
}

/* A node that the set has begun to want. */
static void count_want(struct visible *visible, struct want *want)
{
	const struct node *node = node_of(visible, want);
	struct store_counters *counters = counters_of(visible, want);

	record(visible, node_is_ready(node) ? TRACE_HIT : TRACE_MISS, want);
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
	const struct node *node = node_of(visible, want);

	if (!want->missed)
		return;
	want->missed = false;
	counters_of(visible, want)->joined++;
	if (node->payer != 0 && node->payer != visible->session)
		debts_add(&visible->debts, node->payer);
}

static void count_refused(struct visible *visible, struct want *want, enum wire_reason reason)
{
	struct store_counters *counters = counters_of(visible, want);

	counters->refusals[reason]++;
	visible->counters.refused++;
	counters->refused += want->missed;
	want->missed = false;
}

/* ---- states ---- */

static void set_state(struct visible *visible, struct want *want, enum want_state state)
{
	visible->counts[want->state]--;
	visible->counts[state]++;
	if (want->state != state)
		visible->changed = true;
	want->state = state;
}

/* A refusal that ends by itself when others let go. */
static bool is_for_room(enum wire_reason reason)
{
	return reason == WIRE_REASON_FULL || reason == WIRE_REASON_NO_MEMORY;
}

/* The want leaves the state that it is in, which may be REFUSED. */
static void unrefuse(struct visible *visible, struct want *want)
{
	if (want->state != WANT_REFUSED)
		return;
	visible->untold_count -= want->told != want->reason;
	visible->full_count -= is_for_room(want->reason);
	want->reason = WIRE_REASON_NONE;
}

static void refuse(struct visible *visible, struct want *want, enum wire_reason reason)
{
	uint32_t index = (uint32_t)(want - visible->wants);

	if (want->state != WANT_REFUSED || want->reason != reason)
		count_refused(visible, want, reason);
	if (want->state != WANT_REFUSED)
		record(visible, TRACE_REFUSE, want);
	unrefuse(visible, want);
	want->reason = reason;
	set_state(visible, want, WANT_REFUSED);
	visible->untold_count += want->told != reason;
	visible->full_count += is_for_room(reason);
	if (want->told != reason && index < visible->next_untold)
		visible->next_untold = index;
}

/* By what the node is now: the want has room, and no hold or one that stays. */
static void admit_one(struct visible *visible, struct want *want)
{
	struct node *node = node_of(visible, want);

	set_revoked(visible, want, false);
	if (!want->holding && node->state != NODE_ABSENT)
		hold(visible, want);
	if (node->state == NODE_HELD)
		grant_set(visible, want, true);
	if (node->state == NODE_ABSENT) {
		uint32_t index = (uint32_t)(want - visible->wants);

		if (!want->missed)
			counters_of(visible, want)->retries++;
		want->missed = true;
		unrefuse(visible, want);
		set_state(visible, want, WANT_QUEUED);
		if (index < visible->next_queued)
			visible->next_queued = index;
	} else {
		count_joined(visible, want);
		unrefuse(visible, want);
		set_state(visible, want, node->state == NODE_BUSY ? WANT_WAITING : WANT_DRAWABLE);
	}
}

static void revoke(struct visible *visible, struct want *want)
{
	if (want->revoked)
		return;
	grant_set(visible, want, false);
	set_revoked(visible, want, true);
	counters_of(visible, want)->revocations++;
	visible->counters.revocations++;
}

/* Pages that only this session keeps from being evicted, or would. */
static uint32_t cost_of(const struct visible *visible, const struct want *want)
{
	uint32_t own_holds = want->holding ? 1 : 0;

	/* What is on its way is counted as pinned already, whoever asked for it. */
	if (!want->holding && node_of(visible, want)->state == NODE_BUSY)
		return 0;
	return node_of(visible, want)->hold_count == own_holds ? pages_of(visible, want) : 0;
}

/*
 * Walks the set from its most important node and gives each a state.  Hits are held and granted
 * here, at once; misses wait for the disk: that is how hits overtake misses.
 */
static void admit(struct visible *visible)
{
	const struct cache *cache = visible->cache;
	uint64_t pinned_pages = cache->pinned_bytes / WIRE_PAGE_BYTES;
	uint64_t room_pages = cache_room_bytes(cache) / WIRE_PAGE_BYTES;
	uint64_t own_pages = 0;
	uint64_t sum_pages = 0;
	uint64_t need_pages = 0;

	for (uint32_t i = 0; i < visible->total; i++) {
		const struct want *want = &visible->wants[i];

		if (want->holding)
			own_pages += cost_of(visible, want);
		if (want->holding && want->state == WANT_RETAINED)
			sum_pages += cost_of(visible, want);
	}
	CHECK(own_pages <= pinned_pages);
	room_pages -= u64_min(room_pages, pinned_pages - own_pages + visible->unusable_pages);

	for (uint32_t i = 0; i < visible->count; i++) {
		struct want *want = &visible->wants[i];
		uint32_t cost_pages = cost_of(visible, want);

		if (node_of(visible, want)->state == NODE_DAMAGED) {
			refuse(visible, want, WIRE_REASON_DAMAGED);
			continue;
		}
		/* A device that has failed is asked again when the node was not wanted for a set. */
		if (want->state == WANT_REFUSED && !is_for_room(want->reason))
			continue;
		if (need_pages == 0 && sum_pages + cost_pages <= room_pages) {
			sum_pages += cost_pages;
			admit_one(visible, want);
		} else if (cost_pages == 0) {
			admit_one(visible, want);
		} else {
			if (want->holding)
				revoke(visible, want);
			refuse(visible, want, WIRE_REASON_FULL);
			if (need_pages == 0)
				need_pages = cost_pages;
		}
	}
	visible->retry_at_bytes = cache->released_bytes + u64_max(need_pages, 1) * WIRE_PAGE_BYTES;
	if (need_pages == 0)
		visible->unusable_pages = 0;
}

/*
 * There was no place for a want although the sum allowed it.  What is free now is known to be of no
 * use, and the set is admitted again within the rest, which revokes holds from its end: more
 * important wants must not starve behind hits that are held at once.
 */
static void refuse_for_place(struct visible *visible, uint32_t index)
{
	const struct cache *cache = visible->cache;
	uint64_t unusable_pages = (cache->budget_bytes - cache->pinned_bytes) / WIRE_PAGE_BYTES;

	if (unusable_pages > visible->unusable_pages) {
		visible->unusable_pages = unusable_pages;
		admit(visible);
	}
	refuse(visible, &visible->wants[index],
	       cache->short_since_ns > 0 ? WIRE_REASON_NO_MEMORY : WIRE_REASON_FULL);
}

/* ---- stores ---- */

int visible_attach(struct visible *visible, uint32_t slot, struct served *served, uint64_t epoch,
		   struct why *why)
{
	struct attachment *attachment;
	uint64_t grants_bytes = sizeof(struct wire_grants) +
				((uint64_t)served->node_count + 63) / 64 * sizeof(uint64_t);
	int r;

	CHECK(slot < WIRE_STORE_COUNT_MAX && !visible->attachments[slot]);
	attachment = calloc(1, sizeof(*attachment));
	if (!attachment)
		return why_errno(why, -ENOMEM, "opening a store for a client");
	r = memfile_create("oocd-grants", grants_bytes, false, &attachment->grants_file, why);
	if (r < 0)
		goto err_free;
	attachment->grants = attachment->grants_file.base;
	atomic_init(&attachment->grants->epoch, epoch);
	attachment->grants->node_count = served->node_count;
	r = memfile_publish(&attachment->grants_file, MEMFILE_CHANGING, why);
	if (r < 0)
		goto err_memfile;
	attachment->want_of_node = calloc(served->node_count, sizeof(uint32_t));
	if (!attachment->want_of_node) {
		r = why_errno(why, -ENOMEM, "opening a store for a client");
		goto err_memfile;
	}
	attachment->served = served;
	served->attach_count++;
	visible->attachments[slot] = attachment;
	visible->attached |= UINT64_C(1) << slot;
	return 0;

err_memfile:
	memfile_done(&attachment->grants_file);
err_free:
	free(attachment);
	return r;
}

/* Recounts what the arrays say, after wants have gone from anywhere in them. */
static void recount(struct visible *visible)
{
	memset(visible->counts, 0, sizeof(visible->counts));
	visible->untold_count = 0;
	visible->full_count = 0;
	visible->next_queued = 0;
	visible->next_untold = 0;
	for (uint32_t i = 0; i < visible->total; i++) {
		const struct want *want = &visible->wants[i];

		visible->attachments[want->slot]->want_of_node[want->node] = i + 1;
		visible->counts[want->state]++;
		if (want->state != WANT_REFUSED)
			continue;
		visible->untold_count += want->told != want->reason;
		visible->full_count += is_for_room(want->reason);
	}
}

void visible_detach(struct visible *visible, uint32_t slot)
{
	struct attachment *attachment = visible->attachments[slot];
	uint32_t total = 0;
	uint32_t count = 0;

	/* Before any hold goes: a client that is thrown out may be about to draw. */
	if (!visible->frozen)
		atomic_store_explicit(&attachment->grants->epoch, 0, memory_order_release);
	for (uint32_t i = 0; i < visible->total; i++) {
		struct want *want = &visible->wants[i];

		if (want->slot == slot) {
			if (want->holding)
				release(visible, want);
			attachment->served->counters.dropped += want->missed;
			record(visible, TRACE_DROP, want);
			continue;
		}
		count += i < visible->count;
		visible->wants[total++] = *want;
	}
	visible->total = total;
	visible->count = count;
	recount(visible);
	visible->changed = true;
	visible->attachments[slot] = NULL;
	visible->attached &= ~(UINT64_C(1) << slot);
	attachment->served->attach_count--;
	memfile_done(&attachment->grants_file);
	free(attachment->want_of_node);
	free(attachment);
}

void visible_done(struct visible *visible)
{
	for (uint32_t slot = 0; slot < WIRE_STORE_COUNT_MAX; slot++)
		if (visible->attachments[slot])
			visible_detach(visible, slot);
	CHECK(visible->held_count == 0 && visible->held_pages == 0);
	free(visible->wants);
	free(visible->spare);
	visible->wants = NULL;
	visible->spare = NULL;
}

/* ---- a new set ---- */

static bool entry_is_valid(const struct visible *visible, const struct wire_entry *entry)
{
	return entry->store < WIRE_STORE_COUNT_MAX && visible->attachments[entry->store] &&
	       served_has_payload(visible->attachments[entry->store]->served, entry->node);
}

static int reserve_spare(struct visible *visible, uint32_t count)
{
	struct want *spare;

	if (count <= visible->spare_capacity)
		return 0;
	/* Some more, so that a set that grows a little every frame does not allocate every frame. */
	count += count / 2;
	spare = realloc(visible->spare, count * sizeof(*spare));
	if (!spare)
		return -ENOMEM;
	visible->spare = spare;
	visible->spare_capacity = count;
	return 0;
}

static bool is_node(const struct want *want, const struct wire_entry *entry)
{
	return want->slot == entry->store && want->node == entry->node;
}

/* A want of the new set: what the old one knew about the node, or what the cache says. */
static struct want make_want(struct visible *visible, const struct wire_entry *entry,
			     struct want *before, uint64_t serial, bool retire)
{
	struct want want = {
		.serial = serial,
		.slot = entry->store,
		.node = entry->node,
		.state = WANT_QUEUED,
	};

	if (!before) {
		count_want(visible, &want);
		return want;
	}
	/* The set came after the socket was quiet, so it was sent after the grants were cleared. */
	if (before->revoked && retire && visible->quiet)
		release(visible, before);
	want.holding = before->holding;
	want.revoked = before->revoked;
	want.missed = before->missed;
	if (before->state == WANT_REFUSED) {
		want.state = WANT_REFUSED;
		want.reason = before->reason;
	}
	/* Its hold is the new want's from here on. */
	before->holding = false;
	before->revoked = false;
	return want;
}

/*
 * want_of_node leads to a node's place in the old array, or in the new one once it is there.  The
 * new one is looked at first: where it has the node at that place, it is a second mention.
 */
static uint32_t make_wants(struct visible *visible, const struct wire_entry *entries,
			   uint32_t entry_count, uint64_t serial, bool retire)
{
	struct want *next = visible->spare;
	uint32_t count = 0;

	for (uint32_t i = 0; i < entry_count; i++) {
		const struct wire_entry *entry = &entries[i];
		uint32_t *want_of_node =
			&visible->attachments[entry->store]->want_of_node[entry->node];
		uint32_t at = *want_of_node - 1;
		struct want *before = NULL;

		if (*want_of_node > 0 && at < count && is_node(&next[at], entry))
			continue;
		if (*want_of_node > 0)
			before = &visible->wants[at];
		next[count] = make_want(visible, entry, before, serial, retire);
		if (before)
			before->serial = serial;
		*want_of_node = ++count;
	}
	return count;
}

/* What the new set has not: given back, or kept behind the set for as long as it may be drawn. */
static uint32_t keep_retained(struct visible *visible, uint32_t total, uint64_t serial, bool retire)
{
	struct want *next = visible->spare;

	for (uint32_t i = 0; i < visible->total; i++) {
		struct want *old = &visible->wants[i];

		if (old->serial == serial)
			continue;
		visible->attachments[old->slot]->want_of_node[old->node] = 0;
		counters_of(visible, old)->dropped += old->missed;
		if (retire && old->holding)
			release(visible, old);
		if (!old->holding) {
			record(visible, TRACE_DROP, old);
			continue;
		}
		next[total] = *old;
		next[total].state = WANT_RETAINED;
		total++;
	}
	return total;
}

int visible_take(struct visible *visible, const struct wire_entry *entries, uint32_t entry_count,
		 uint64_t serial, bool retire)
{
	struct want *wants = visible->wants;
	uint32_t capacity = visible->capacity;

	CHECK(serial > visible->serial);
	for (uint32_t i = 0; i < entry_count; i++)
		if (!entry_is_valid(visible, &entries[i]))
			return -EPROTO;
	if (reserve_spare(visible, entry_count + visible->total) < 0)
		return -ENOMEM;
	recorder_session(visible->cache->recorder, TRACE_SET, visible->session, entry_count);
	visible->count = make_wants(visible, entries, entry_count, serial, retire);
	visible->total = keep_retained(visible, visible->count, serial, retire);

	visible->wants = visible->spare;
	visible->capacity = visible->spare_capacity;
	visible->spare = wants;
	visible->spare_capacity = capacity;
	visible->serial = serial;
	visible->counters.sets++;
	visible->full_pages = 0;
	recount(visible);
	admit(visible);
	visible->changed = true;
	/*
	 * Pairs with the acquire load of `acknowledged` in libclient/client_view.c: whoever reads the
	 * serial reads the grants as they are now, or newer.
	 */
	atomic_store_explicit(&visible->page->acknowledged, serial, memory_order_release);
	return 0;
}

/* ---- what happens to a set ---- */

/* Takes a want without hold out of what is retained; the last one takes its place. */
static void retained_remove(struct visible *visible, uint32_t index)
{
	struct want *want = &visible->wants[index];
	const struct want *last = &visible->wants[visible->total - 1];

	CHECK(want->state == WANT_RETAINED && !want->holding);
	record(visible, TRACE_DROP, want);
	visible->attachments[want->slot]->want_of_node[want->node] = 0;
	if (want != last) {
		*want = *last;
		visible->attachments[want->slot]->want_of_node[want->node] = index + 1;
	}
	visible->total--;
	visible->counts[WANT_RETAINED]--;
}

void visible_retire(struct visible *visible, uint64_t serial)
{
	serial = u64_min(serial, visible->serial);
	for (uint32_t i = visible->total; i-- > 0;) {
		struct want *want = &visible->wants[i];
		bool revoked = want->revoked && visible->quiet && serial > visible->quiet_serial;
		bool retained = want->state == WANT_RETAINED;

		if (!revoked && !(retained && want->serial < serial))
			continue;
		release(visible, want);
		if (retained)
			retained_remove(visible, i);
	}
}

void visible_note_quiet(struct visible *visible)
{
	visible->quiet = true;
	visible->quiet_serial = visible->serial;
}

void visible_retry(struct visible *visible)
{
	if (visible->full_count == 0 || visible->cache->released_bytes < visible->retry_at_bytes)
		return;
	/* What was let go may lie where it joins something. */
	visible->unusable_pages -= (visible->unusable_pages + 3) / 4;
	admit(visible);
}

void visible_room_changed(struct visible *visible)
{
	visible->unusable_pages = 0;
	admit(visible);
}

bool visible_next(struct visible *visible, struct queue_want *ret)
{
	const struct cache *cache = visible->cache;

	/* Each turn takes a want out of QUEUED; only one that is not QUEUED is passed. */
	while (visible->next_queued < visible->count) {
		struct want *want = &visible->wants[visible->next_queued];
		enum node_state state = node_of(visible, want)->state;

		if (want->state != WANT_QUEUED) {
			visible->next_queued++;
		} else if (state == NODE_DAMAGED) {
			refuse(visible, want, WIRE_REASON_DAMAGED);
		} else if (state != NODE_ABSENT) {
			admit_one(visible, want);
		} else if (visible->full_pages > 0 &&
			   cache->released_bytes == visible->full_at_bytes &&
			   pages_of(visible, want) >= visible->full_pages) {
			/* Nothing was let go since a place for as much was not to be found. */
			refuse_for_place(visible, visible->next_queued);
		} else {
			*ret = (struct queue_want){ served_of(visible, want), want->node };
			return true;
		}
	}
	return false;
}

void visible_begun(struct visible *visible, const struct queue_want *asked, int error)
{
	struct want *want = &visible->wants[visible->next_queued];
	const struct cache *cache = visible->cache;

	CHECK(want->state == WANT_QUEUED);
	CHECK(served_of(visible, want) == asked->served && want->node == asked->index);
	if (error == 0) {
		visible->counters.fetches++;
		want->missed = false;
		admit_one(visible, want);
		return;
	}
	visible->full_pages = pages_of(visible, want);
	visible->full_at_bytes = cache->released_bytes;
	visible->retry_at_bytes = cache->released_bytes + visible->full_pages * WIRE_PAGE_BYTES;
	refuse(visible, want, cache->short_since_ns > 0 ? WIRE_REASON_NO_MEMORY : WIRE_REASON_FULL);
}

static void want_fill_ended(struct visible *visible, struct want *want, enum wire_reason reason)
{
	bool waits = want->state == WANT_WAITING || want->state == WANT_QUEUED;

	if (reason == WIRE_REASON_NONE) {
		if (waits)
			admit_one(visible, want);
		return;
	}
	if (want->holding)
		release(visible, want);
	if (waits)
		refuse(visible, want, reason);
	if (want->state == WANT_RETAINED)
		retained_remove(visible, (uint32_t)(want - visible->wants));
}

void visible_fill_ended(struct visible *visible, const struct fill_result *result)
{
	for (uint64_t slots = visible->attached; slots != 0; slots &= slots - 1) {
		uint32_t slot = (uint32_t)__builtin_ctzll(slots);
		const struct attachment *attachment = visible->attachments[slot];

		if (attachment->served == result->served &&
		    attachment->want_of_node[result->index] > 0)
			want_fill_ended(
				visible,
				&visible->wants[attachment->want_of_node[result->index] - 1],
				result->reason);
	}
}

uint32_t visible_take_refusals(struct visible *visible, struct wire_refusal *ret,
			       uint32_t count_max)
{
	uint32_t count = 0;

	for (; visible->untold_count > 0 && count < count_max; visible->next_untold++) {
		struct want *want = &visible->wants[visible->next_untold];

		CHECK(visible->next_untold < visible->count);
		if (want->state != WANT_REFUSED || want->told == want->reason)
			continue;
		want->told = want->reason;
		visible->untold_count--;
		ret[count++] = (struct wire_refusal){ want->slot, want->node, want->reason };
	}
	return count;
}

void visible_settle(struct visible *visible)
{
	struct wire_session_page *page = visible->page;

	if (visible_missing_count(visible) > 0 || visible->untold_count > 0)
		return;
	if (atomic_load_explicit(&page->settled, memory_order_relaxed) < visible->serial) {
		/* After the directory's words and the grants that make it true, as `acknowledged`. */
		atomic_store_explicit(&page->settled, visible->serial, memory_order_release);
		visible->changed = true;
	}
	if (visible->counts[WANT_REFUSED] == 0 &&
	    atomic_load_explicit(&page->complete, memory_order_relaxed) < visible->serial) {
		atomic_store_explicit(&page->complete, visible->serial, memory_order_release);
		visible->changed = true;
	}
}

static void want_check(const struct visible *visible, uint32_t index)
{
	const struct want *want = &visible->wants[index];
	const struct wire_grants *grants = visible->attachments[want->slot]->grants;
	enum node_state state = node_of(visible, want)->state;
	uint64_t word = atomic_load_explicit(&grants->words[want->node / 64], memory_order_relaxed);
	bool granted = word >> (want->node % 64) & 1;

	CHECK(visible->attachments[want->slot]->want_of_node[want->node] == index + 1);
	CHECK((want->state == WANT_RETAINED) == (index >= visible->count));
	CHECK(!granted || (want->holding && !want->revoked && state == NODE_HELD));
	CHECK(want->holding || !want->revoked);
	CHECK(want->missed == (want->state == WANT_QUEUED));
	switch (want->state) {
	case WANT_QUEUED:
		CHECK(!want->holding && index >= visible->next_queued);
		break;
	case WANT_WAITING:
		CHECK(want->holding && !want->revoked && state == NODE_BUSY);
		break;
	case WANT_DRAWABLE:
		CHECK(granted && state == NODE_HELD);
		break;
	case WANT_REFUSED:
		CHECK(!granted && want->reason != WIRE_REASON_NONE);
		break;
	case WANT_RETAINED:
		CHECK(want->holding);
		break;
	case WANT_STATE_COUNT_:
		CHECK(false);
		break;
	}
}

void visible_check(const struct visible *visible)
{
	uint32_t counts[WANT_STATE_COUNT_] = { 0 };
	uint32_t held_count = 0;
	uint32_t revoked_count = 0;
	uint64_t held_pages = 0;
	uint32_t untold_count = 0;
	uint32_t full_count = 0;

	for (uint32_t i = 0; i < visible->total; i++) {
		const struct want *want = &visible->wants[i];
		bool refused = want->state == WANT_REFUSED;

		want_check(visible, i);
		counts[want->state]++;
		held_count += want->holding;
		revoked_count += want->revoked;
		held_pages += want->holding ? pages_of(visible, want) : 0;
		untold_count += refused && want->told != want->reason;
		full_count += refused && is_for_room(want->reason);
	}
	CHECK(memcmp(counts, visible->counts, sizeof(counts)) == 0);
	CHECK(held_count == visible->held_count && held_pages == visible->held_pages);
	CHECK(revoked_count == visible->revoked_count);
	CHECK(untold_count == visible->untold_count && full_count == visible->full_count);
}
