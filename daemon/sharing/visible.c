/* SPDX-License-Identifier: MIT */
#include "daemon/sharing/visible_private.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"

void visible_init(struct visible *visible, struct room *room, struct account *account,
		  struct fills *fills, uint32_t session, struct wire_session_page *page)
{
	*visible = (struct visible){
		.room = room,
		.cache = room->cache,
		.account = account,
		.fills = fills,
		.session = session,
		.page = page,
	};
	list_init(&visible->claim_link);
	list_push_back(&room->sets, &visible->link);
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

/* The arrays are made anew: place_want() for each want, in order, counts what they say. */
static void begin_places(struct visible *visible)
{
	memset(visible->counts, 0, sizeof(visible->counts));
	visible->unanswered_count = 0;
	visible->untold_count = 0;
	visible->full_count = 0;
	visible->next_queued = 0;
	visible->next_untold = 0;
}

static void place_want(struct visible *visible, const struct want *want, uint32_t index)
{
	visible->attachments[want->slot]->want_of_node[want->node] = index + 1;
	visible->counts[want->state]++;
	visible->unanswered_count += want_is_unanswered(want);
	if (want->state != WANT_REFUSED)
		return;
	visible->untold_count += want->told != want->reason;
	visible->full_count += visible_is_for_room(want->reason);
}

void visible_detach(struct visible *visible, uint32_t slot)
{
	struct attachment *attachment = visible->attachments[slot];
	uint32_t total = 0;
	uint32_t count = 0;

	/* Before any hold goes: a client that is thrown out may be about to draw. */
	if (!visible->frozen)
		atomic_store_explicit(&attachment->grants->epoch, 0, memory_order_release);
	begin_places(visible);
	for (uint32_t i = 0; i < visible->total; i++) {
		struct want *want = &visible->wants[i];

		if (want->slot == slot) {
			if (want->holding)
				want_release(visible, want);
			attachment->served->counters.dropped += want->missed;
			want_record(visible, TRACE_DROP, want);
			want_count_out(visible, want);
			continue;
		}
		count += i < visible->count;
		place_want(visible, want, total);
		visible->wants[total++] = *want;
	}
	visible->total = total;
	visible->count = count;
	room_note_change(visible->room);
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
	list_remove(&visible->link);
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
		.slot = (uint8_t)entry->store,
		.node = entry->node,
		.state = WANT_QUEUED,
	};

	if (!before) {
		want_count_new(visible, &want);
		want_count_in(visible, &want);
		return want;
	}
	/* The set came after the socket was empty, so it was sent after the grant was cleared. */
	if (before->is_sure && retire)
		want_release(visible, before);
	want.holding = before->holding;
	want.revoked = before->revoked;
	want.is_sure = before->is_sure;
	want.sure = before->sure;
	want.missed = before->missed;
	want.queued_ns = before->queued_ns;
	if (before->state == WANT_REFUSED) {
		want.state = WANT_REFUSED;
		want.reason = before->reason;
	}
	/* Its hold is the new want's from here on. */
	before->holding = false;
	before->revoked = false;
	before->is_sure = false;
	return want;
}

/*
 * want_of_node leads to a node's place in the old array, or in the new one once it is there.  The
 * new one is looked at first: where it has the node at that place, it is a second mention.
 *
 * ret_same:  the set is the one before, said again, and nothing was retained.
 */
static uint32_t make_wants(struct visible *visible, const struct wire_entry *entries,
			   uint32_t entry_count, uint64_t serial, bool retire, bool *ret_same)
{
	struct want *next = visible->spare;
	uint32_t count = 0;
	bool same = true;

	for (uint32_t i = 0; i < entry_count; i++) {
		const struct wire_entry *entry = &entries[i];
		uint32_t place = visible->attachments[entry->store]->want_of_node[entry->node];
		uint32_t at = place - 1;
		struct want *before = NULL;

		if (place > 0 && at < count && is_node(&next[at], entry))
			continue;
		if (place > 0)
			before = &visible->wants[at];
		same = same && before && at == count;
		next[count] = make_want(visible, entry, before, serial, retire);
		if (before)
			before->serial = serial;
		place_want(visible, &next[count], count);
		count++;
	}
	*ret_same = same && count == visible->total;
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
		visible_counters_of(visible, old)->dropped += old->missed;
		old->missed = false;
		if (retire && old->holding)
			want_release(visible, old);
		if (!old->holding) {
			want_record(visible, TRACE_DROP, old);
			want_count_out(visible, old);
			continue;
		}
		next[total] = *old;
		next[total].state = WANT_RETAINED;
		place_want(visible, &next[total], total);
		total++;
	}
	return total;
}

int visible_take(struct visible *visible, const struct wire_entry *entries, uint32_t entry_count,
		 uint64_t serial, bool retire)
{
	struct want *wants = visible->wants;
	uint32_t capacity = visible->capacity;
	struct room *room = visible->room;
	bool same;

	CHECK(serial > visible->serial);
	for (uint32_t i = 0; i < entry_count; i++)
		if (!entry_is_valid(visible, &entries[i]))
			return -EPROTO;
	if (reserve_spare(visible, entry_count + visible->total) < 0)
		return -ENOMEM;
	recorder_session(visible->cache->recorder, TRACE_SET, visible->session, entry_count);
	begin_places(visible);
	visible->count = make_wants(visible, entries, entry_count, serial, retire, &same);
	visible->total = keep_retained(visible, visible->count, serial, retire);

	visible->wants = visible->spare;
	visible->capacity = visible->spare_capacity;
	visible->spare = wants;
	visible->spare_capacity = capacity;
	visible->serial = serial;
	visible->counters.sets++;
	if (!same)
		room_note_change(room);
	/* Where more is wanted than fits, all sets are looked at together (division.h). */
	visible->undecided = room->changed && (room->divided || room_is_tight(room));
	/* But who asks for little that others do not want as well does not wait until they are. */
	if (visible->undecided && room->divided)
		visible->undecided = !visible_plan_rest(visible);
	if (!visible->undecided)
		visible_admit(visible);
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
	want_record(visible, TRACE_DROP, want);
	visible->attachments[want->slot]->want_of_node[want->node] = 0;
	want_count_out(visible, want);
	room_note_change(visible->room);
	if (want != last) {
		*want = *last;
		visible->attachments[want->slot]->want_of_node[want->node] = index + 1;
	}
	visible->total--;
	visible->counts[WANT_RETAINED]--;
}

void visible_retire(struct visible *visible, uint64_t serial)
{
	serial = u64_min(serial, visible->serial + 1);
	for (uint32_t i = visible->total; i-- > 0;) {
		struct want *want = &visible->wants[i];
		/* Low halves do: no lease lasts for 2^31 sets. */
		bool revoked = want->is_sure && (int32_t)((uint32_t)serial - want->sure) > 0;
		bool retained = want->state == WANT_RETAINED;

		if (!revoked && !(retained && want->serial < serial))
			continue;
		want_release(visible, want);
		if (retained)
			retained_remove(visible, i);
	}
}

void visible_note_quiet(struct visible *visible)
{
	for (uint32_t i = 0; visible->unsure_count > 0 && i < visible->total; i++) {
		struct want *want = &visible->wants[i];

		if (!want->revoked || want->is_sure)
			continue;
		want->is_sure = true;
		want->sure = (uint32_t)visible->serial;
		visible->unsure_count--;
	}
	CHECK(visible->unsure_count == 0);
}

void visible_retry(struct visible *visible)
{
	if (visible->full_count > 0 && visible->cache->released_bytes >= visible->retry_at_bytes)
		visible_admit(visible);
}

bool visible_next(struct visible *visible, struct queue_want *ret)
{
	/* Each turn takes a want out of QUEUED; only one that is not QUEUED is passed. */
	while (!visible->undecided && visible->counts[WANT_QUEUED] > 0) {
		struct want *want = &visible->wants[visible->next_queued];
		struct served *served = visible_served_of(visible, want);
		enum node_state state = visible_node_of(visible, want)->state;

		if (want->state != WANT_QUEUED) {
			visible->next_queued++;
		} else if (state == NODE_DAMAGED) {
			want_refuse(visible, want, WIRE_REASON_DAMAGED);
		} else if (cache_is_leaving(visible->cache, served, want->node)) {
			return false;
		} else if (state != NODE_ABSENT) {
			want_admit(visible, want);
		} else {
			*ret = (struct queue_want){ served, want->node, want->queued_ns };
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
	CHECK(visible_served_of(visible, want) == asked->served && want->node == asked->index);
	if (error == 0) {
		visible->counters.fetches++;
		want->missed = false;
		want_admit(visible, want);
		return;
	}
	visible->retry_at_bytes =
		u64_min(visible->retry_at_bytes,
			cache->released_bytes +
				(uint64_t)WIRE_PAGE_BYTES * visible_pages_of(visible, want));
	want_refuse(visible, want,
		    cache->short_since_ns > 0 ? WIRE_REASON_NO_MEMORY : WIRE_REASON_FULL);
	room_note_no_place(visible->room);
}

static void want_fill_ended(struct visible *visible, struct want *want, enum wire_reason reason)
{
	bool waits = want->state == WANT_WAITING || want->state == WANT_QUEUED;

	if (reason == WIRE_REASON_NONE) {
		if (waits)
			want_admit(visible, want);
		return;
	}
	if (want->holding)
		want_release(visible, want);
	if (waits)
		want_refuse(visible, want, reason);
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

uint32_t visible_queued_count(const struct visible *visible)
{
	uint32_t count = 0;

	if (!visible->undecided)
		return visible->counts[WANT_QUEUED];
	for (uint32_t i = 0; i < visible->count; i++)
		count += visible->wants[i].missed;
	return count;
}

void visible_settle(struct visible *visible)
{
	struct wire_session_page *page = visible->page;
	uint64_t serial = visible->serial;

	/* Asked of each session in each round: most have nothing to say. */
	if (visible->complete == serial || visible->undecided || visible->unanswered_count > 0 ||
	    visible->untold_count > 0)
		return;
	if (visible->settled < serial) {
		/* After the directory's words and the grants that make it true, as `acknowledged`. */
		atomic_store_explicit(&page->settled, serial, memory_order_release);
		visible->settled = serial;
		visible->changed = true;
	}
	if (visible->counts[WANT_REFUSED] == 0 && visible_missing_count(visible) == 0) {
		atomic_store_explicit(&page->complete, serial, memory_order_release);
		visible->complete = serial;
		visible->changed = true;
	}
}

static void want_check(const struct visible *visible, uint32_t index)
{
	const struct want *want = &visible->wants[index];
	const struct wire_grants *grants = visible->attachments[want->slot]->grants;
	enum node_state state = visible_node_of(visible, want)->state;
	uint64_t word = atomic_load_explicit(&grants->words[want->node / 64], memory_order_relaxed);
	bool granted = word >> (want->node % 64) & 1;

	CHECK(visible->attachments[want->slot]->want_of_node[want->node] == index + 1);
	CHECK((want->state == WANT_RETAINED) == (index >= visible->count));
	CHECK(!granted || (want->holding && !want->revoked && state == NODE_HELD));
	CHECK(want->holding || !want->revoked);
	CHECK(want->revoked || !want->is_sure);
	CHECK(visible->undecided || want->missed == (want->state == WANT_QUEUED));
	switch (want->state) {
	case WANT_QUEUED:
		/* Until it is decided a new set's wants have the holds of the set before. */
		CHECK(!want->holding || want->revoked || visible->undecided);
		CHECK(index >= visible->next_queued);
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
	uint32_t unsure_count = 0;
	uint64_t held_pages = 0;
	uint32_t unanswered_count = 0;
	uint32_t untold_count = 0;
	uint32_t full_count = 0;

	for (uint32_t i = 0; i < visible->total; i++) {
		const struct want *want = &visible->wants[i];
		bool refused = want->state == WANT_REFUSED;

		want_check(visible, i);
		counts[want->state]++;
		held_count += want->holding;
		revoked_count += want->revoked;
		unsure_count += want->revoked && !want->is_sure;
		held_pages += want->holding ? visible_pages_of(visible, want) : 0;
		unanswered_count += want_is_unanswered(want);
		untold_count += refused && want->told != want->reason;
		full_count += refused && visible_is_for_room(want->reason);
	}
	CHECK(memcmp(counts, visible->counts, sizeof(counts)) == 0);
	CHECK(held_count == visible->held_count && held_pages == visible->held_pages);
	CHECK(revoked_count == visible->revoked_count && unsure_count == visible->unsure_count);
	CHECK(unanswered_count == visible->unanswered_count);
	CHECK(untold_count == visible->untold_count && full_count == visible->full_count);
}
