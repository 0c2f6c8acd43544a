/* SPDX-License-Identifier: MIT */
#include <errno.h>
#include <float.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/check.h"
#include "libclient/client_private.h"

#define REASON_BITS 3u

static_assert(OOC_REASON_FULL == (int)WIRE_REASON_FULL, "reasons are passed on as they come");
static_assert(OOC_REASON_DAMAGED == (int)WIRE_REASON_DAMAGED, "reasons are passed on");
static_assert(OOC_REASON_UNREADABLE == (int)WIRE_REASON_UNREADABLE, "reasons are passed on");
static_assert(OOC_REASON_NO_MEMORY == (int)WIRE_REASON_NO_MEMORY, "reasons are passed on");
static_assert(OOC_REASON_LOST == (int)WIRE_REASON_COUNT_, "the library's own come after them");
static_assert(OOC_REASON_LOST < 1 << REASON_BITS, "a reason fits beside a serial");

/* ---- what is given ---- */

static_assert(sizeof(struct ooc_want) ==
		      sizeof(struct ooc_store *) + sizeof(uint32_t) + sizeof(float),
	      "no hidden padding: wants are compared as bytes");

/* A thousand of them in half a microsecond: in most frames nothing has changed. */
static bool set_is_given(const struct ooc_client *client, const struct ooc_want *wants,
			 size_t count)
{
	const struct set *set = &client->set;

	return set->given != 0 && set->is_whole && !set->recalled && set->want_count == count &&
	       (count == 0 || memcmp(set->wants, wants, count * sizeof(*wants)) == 0);
}

static bool has_payload(const struct ooc_store *store, uint32_t node)
{
	return node < store->node_count &&
	       (store->wants[node].payload_bytes > 0 || store->nodes[node].payload_bytes > 0);
}

/* Judges what a caller wants, for sets and prefetches alike. */
static int wants_validate(struct ooc_client *client, const struct ooc_want *wants, size_t count)
{
	float importance_max = FLT_MAX;

	if (count > WIRE_SET_NODE_COUNT_MAX)
		return why_set(&client->why, -E2BIG, "%zu nodes are wanted, %u may be", count,
			       WIRE_SET_NODE_COUNT_MAX);
	for (size_t i = 0; i < count; i++) {
		const struct ooc_want *want = &wants[i];

		if (!want->store || want->store->client != client)
			return why_set(&client->why, -EINVAL, "want %zu is of no open store", i);
		if (!has_payload(want->store, want->node))
			return why_set(&client->why, -EINVAL, "node %u of %s has nothing to draw",
				       want->node, want->store->path);
		/* Both comparisons are false for a NaN. */
		if (!(want->importance >= 0.0f) || !(want->importance <= importance_max))
			return why_set(&client->why, -EINVAL,
				       "wants do not descend in importance at %zu", i);
		importance_max = want->importance;
	}
	return 0;
}

/* Room for what is wanted, as it was given and as it is said. */
static int set_reserve(struct ooc_client *client, size_t want_count)
{
	struct set *set = &client->set;
	size_t capacity = set->want_capacity ? set->want_capacity : 256;
	struct wire_entry *entries;
	struct ooc_want *wants;

	if (want_count <= set->want_capacity)
		return 0;
	while (capacity < want_count)
		capacity *= 2;
	entries = realloc(set->entries, capacity * sizeof(*entries));
	if (entries)
		set->entries = entries;
	wants = realloc(set->wants, capacity * sizeof(*wants));
	if (wants)
		set->wants = wants;
	if (!entries || !wants)
		return why_set(&client->why, -ENOMEM, "no memory for a set of %zu nodes",
			       want_count);
	set->want_capacity = capacity;
	return 0;
}

int64_t ooc_visible_set(struct ooc_client *client, const struct ooc_want *wants, size_t count)
{
	struct set *set = &client->set;
	int r;

	if (set_is_given(client, wants, count)) {
		set_flush(client);
		return (int64_t)set->given;
	}
	r = wants_validate(client, wants, count);
	if (r == 0)
		r = set_reserve(client, count);
	if (r < 0)
		return r;

	set->given = ++client->serial;
	set->recalled = false;
	if (count > 0)
		memcpy(set->wants, wants, count * sizeof(*wants));
	set->want_count = count;
	set->is_whole = true;
	set->entry_count = 0;
	for (size_t i = 0; i < count; i++) {
		struct want *want = &wants[i].store->wants[wants[i].node];

		/* A node given twice counts once, where it is most important. */
		if (want->given == set->given)
			continue;
		want->given = set->given;
		if (want->payload_bytes == 0)
			want->payload_bytes = wants[i].store->nodes[wants[i].node].payload_bytes;
		set->entries[set->entry_count++] = (struct wire_entry){
			.store = wants[i].store->number,
			.node = wants[i].node,
			.importance = wants[i].importance,
		};
	}
	set->unsaid = true;
	/* What was begun of the set before is forgotten by the daemon when it sees the next FIRST. */
	set->saying = 0;
	set_flush(client);
	return (int64_t)set->given;
}

void set_drop_store(struct ooc_client *client, const struct ooc_store *store)
{
	struct set *set = &client->set;
	size_t kept_count = 0;

	for (size_t i = 0; i < set->entry_count; i++) {
		if (set->entries[i].store != store->number)
			set->entries[kept_count++] = set->entries[i];
	}
	/* The entries said so far are no longer a head of those that are left. */
	if (kept_count < set->entry_count) {
		set->saying = 0;
		set->is_whole = false;
	}
	set->entry_count = kept_count;
}

/* ---- what is said ---- */

void set_restart(struct ooc_client *client)
{
	struct set *set = &client->set;

	/* A number that no node has: in this session nothing was ever sent. */
	set->sent = ++client->serial;
	set->unsaid = set->given != 0;
	set->unanswered = 0;
	set->saying = 0;
	set->said_with_events = false;
	/* Holds of the session before are gone with it: there is nothing to retire. */
	set->retire_unsent = 0;
	set->retire_sent = 0;
	set->answer_owed = false;
	set->sent_count = 0;
}

bool set_wants_events(const struct ooc_client *client)
{
	return client->notify || client->waiting;
}

/* Fills `outgoing` with the next piece of the set.  Returns: the entries of ours that it covers. */
static size_t piece_write(struct ooc_client *client, struct wire_set *message)
{
	const struct set *set = &client->set;
	size_t i = set->said_count;
	uint32_t flags = 0;

	message->entry_count = 0;
	for (; i < set->entry_count && message->entry_count < WIRE_SET_ENTRY_COUNT_MAX; i++) {
		if (client->stores[set->entries[i].store]->state == STORE_OPEN)
			message->entries[message->entry_count++] = set->entries[i];
	}
	if (set->said_count == 0)
		flags |= WIRE_SET_FIRST;
	if (i == set->entry_count)
		flags |= WIRE_SET_LAST;
	if (!client->keep_drawing || set->retired >= set->given)
		flags |= WIRE_SET_RETIRE;
	if (set_wants_events(client))
		flags |= WIRE_SET_EVENTS;
	message->flags = flags;
	message->serial = set->saying;
	wire_header_init(&message->header, WIRE_SET,
			 sizeof(*message) + message->entry_count * sizeof(message->entries[0]));
	return i - set->said_count;
}

/* The whole set is sent: notes for each node since when it has been in all sets that were. */
static void set_was_sent(struct ooc_client *client)
{
	struct set *set = &client->set;
	uint64_t serial = set->saying;

	for (size_t i = 0; i < set->entry_count; i++) {
		struct want *want =
			&client->stores[set->entries[i].store]->wants[set->entries[i].node];

		if (want->sent != set->sent)
			want->since = serial;
		want->sent = serial;
	}
	set->sent = serial;
	set->unanswered = serial;
	set->sent_serials[set->sent_count++ % SENT_COUNT_MAX] = serial;
	set->unsaid = false;
	set->saying = 0;
	set->said_with_events = set_wants_events(client);
	client->counters.sets_sent++;
}

static bool set_is_unanswered(const struct ooc_client *client)
{
	/* Pairs with the daemon's release store of `acknowledged`. */
	return client->set.unanswered > 0 &&
	       atomic_load_explicit(&session_page(client)->acknowledged, memory_order_acquire) <
		       client->set.unanswered;
}

static int retire_flush(struct ooc_client *client)
{
	struct set *set = &client->set;
	struct wire_retire message = { .serial = u64_max(set->retire_unsent, set->retire_sent) };
	int r;

	if (set->retire_unsent == 0 && !set->answer_owed)
		return 0;
	/* A caller maps again after each dispatch: it draws nothing that it looked at before. */
	if (set->answer_owed && !client->keep_drawing)
		message.serial = set->sent + 1;
	wire_header_init(&message.header, WIRE_RETIRE, sizeof(message));
	r = session_send(client, &message, sizeof(message), NULL, 0);
	if (r < 0)
		return r;
	set->retire_sent = u64_max(set->retire_unsent, set->retire_sent);
	set->retire_unsent = 0;
	set->answer_owed = false;
	return 0;
}

/* Nothing wakes a caller that sleeps now and did not when its set was said. */
static void listen_flush(struct ooc_client *client)
{
	struct wire_listen message;

	if (client->set.said_with_events || !set_wants_events(client))
		return;
	wire_header_init(&message.header, WIRE_LISTEN, sizeof(message));
	if (session_send(client, &message, sizeof(message), NULL, 0) == 0)
		client->set.said_with_events = true;
}

void set_flush(struct ooc_client *client)
{
	struct set *set = &client->set;
	struct wire_set *message = (struct wire_set *)(void *)client->outgoing;

	if (client->state != SESSION_LIVE || retire_flush(client) < 0)
		return;
	if (set->given == 0)
		return;
	if (!set->unsaid) {
		listen_flush(client);
		return;
	}
	/*
	 * One unanswered set at a time keeps a busy daemon from working through sets that are old by
	 * then.  But nothing wakes a caller that sleeps when the answer comes: its set goes at once.
	 */
	if (!set_wants_events(client) && set_is_unanswered(client))
		return;
	for (uint32_t i = 0; i < WIRE_STORE_COUNT_MAX; i++) {
		/* After a loss the set waits until all stores are open again. */
		if (client->stores[i] && client->stores[i]->state < STORE_OPEN)
			return;
	}

	if (set->saying == 0) {
		/* Said for the first time it keeps the number that its giver knows. */
		set->saying = set->given > set->sent ? set->given : ++client->serial;
		set->said_count = 0;
	}
	while (set->saying != 0) {
		size_t count = piece_write(client, message);

		if (session_send(client, message, message->header.bytes, NULL, 0) < 0)
			return;
		set->said_count += count;
		if (message->flags & WIRE_SET_LAST)
			set_was_sent(client);
	}
}

/* ---- what is no longer drawn ---- */

void ooc_keep_drawing(struct ooc_client *client, bool keep)
{
	client->keep_drawing = keep;
}

void ooc_notify(struct ooc_client *client, bool notify)
{
	client->notify = notify;
	set_flush(client);
}

int ooc_retire(struct ooc_client *client, int64_t serial)
{
	struct set *set = &client->set;
	uint64_t oldest = set->sent_count > SENT_COUNT_MAX ? set->sent_count - SENT_COUNT_MAX : 0;

	if (serial < 0 || (uint64_t)serial > set->given)
		return why_set(&client->why, -EINVAL, "no set %lld was given", (long long)serial);
	set->retired = u64_max(set->retired, (uint64_t)serial);
	for (uint32_t i = 0; i < WIRE_STORE_COUNT_MAX; i++) {
		if (client->stores[i])
			view_release_old(client->stores[i]);
	}

	/*
	 * A set that was replaced before it was sent is unknown to the daemon.  What was drawn under
	 * it was in the set sent before it too, which must therefore not be retired.
	 */
	for (uint64_t i = set->sent_count; i > oldest; i--) {
		uint64_t sent = set->sent_serials[(i - 1) % SENT_COUNT_MAX];

		if (sent > set->retired)
			continue;
		if (sent > set->retire_sent)
			set->retire_unsent = sent;
		break;
	}
	/* Where there is no room in the socket it waits; where there is no daemon nothing is held. */
	if (client->state == SESSION_LIVE)
		(void)retire_flush(client);
	return 0;
}

void set_take_recall(struct ooc_client *client)
{
	struct set *set = &client->set;

	set->answer_owed = true;
	/* A caller that keeps drawing retires the next set that it gives, which must be another one. */
	set->recalled = client->keep_drawing;
}

/* ---- what is refused ---- */

void set_take_not_now(struct ooc_client *client, const struct wire_not_now *message)
{
	for (uint32_t i = 0; i < message->entry_count; i++) {
		const struct wire_refusal *refusal = &message->entries[i];
		const struct ooc_store *store = client->stores[refusal->store];

		if (store && refusal->node < store->node_count)
			store->wants[refusal->node].refused =
				message->serial << REASON_BITS | refusal->reason;
	}
}

/* Was the node refused in the newest set, or in `serial` or a later one? */
static enum ooc_reason refused_since(const struct ooc_store *store, uint32_t node, uint64_t serial)
{
	uint64_t refused = store->wants[node].refused;

	if (store->state == STORE_LOST)
		return OOC_REASON_LOST;
	if (refused >> REASON_BITS < serial)
		return OOC_REASON_NONE;
	return (enum ooc_reason)(refused & ((1u << REASON_BITS) - 1));
}

enum ooc_reason ooc_not_now(const struct ooc_store *store, uint32_t node)
{
	const struct ooc_client *client = store->client;
	const struct want *want;
	uint64_t settled;

	if (node >= store->node_count || ooc_map(store, node))
		return OOC_REASON_NONE;
	want = &store->wants[node];
	if (want->given != client->set.given || client->set.given == 0)
		return OOC_REASON_NONE;
	if (!client->page.base)
		return OOC_REASON_NONE;
	/*
	 * Each set is answered anew.  Until the newest one has been, the answer before it is the best
	 * that is known: a viewer that gives a set a frame would never see one otherwise.
	 * Pairs with the daemon's release store of `settled`.
	 */
	settled = atomic_load_explicit(&session_page(client)->settled, memory_order_acquire);
	return refused_since(store, node, u64_max(want->since, settled));
}

void ooc_progress(const struct ooc_client *client, struct ooc_progress *ret)
{
	const struct set *set = &client->set;
	struct ooc_progress progress = {
		.serial = (int64_t)set->given,
		.want_count = set->entry_count,
	};

	for (size_t i = 0; i < set->entry_count; i++) {
		const struct ooc_store *store = client->stores[set->entries[i].store];
		uint32_t node = set->entries[i].node;

		if (ooc_map(store, node))
			progress.drawable_count++;
		else if (!set->unsaid && refused_since(store, node, set->sent) != OOC_REASON_NONE)
			progress.refused_count++;
	}
	progress.complete = progress.drawable_count == progress.want_count;
	progress.settled = progress.drawable_count + progress.refused_count == progress.want_count;
	*ret = progress;
}

/* ---- what may be wanted soon ---- */

int ooc_prefetch(struct ooc_client *client, const struct ooc_want *wants, size_t count)
{
	struct wire_prefetch *message = (struct wire_prefetch *)(void *)client->outgoing;
	int r;

	r = wants_validate(client, wants, count);
	if (r < 0)
		return r;
	if (client->state != SESSION_LIVE)
		return why_set(&client->why, -ENOTCONN, "the daemon is away");
	*message = (struct wire_prefetch){ 0 };
	/* One message replaces the one before it, so what does not fit into one is not asked for. */
	for (size_t i = 0; i < count && message->entry_count < WIRE_SET_ENTRY_COUNT_MAX; i++) {
		if (wants[i].store->state == STORE_OPEN)
			message->entries[message->entry_count++] = (struct wire_entry){
				.store = wants[i].store->number,
				.node = wants[i].node,
				.importance = wants[i].importance,
			};
	}
	wire_header_init(&message->header, WIRE_PREFETCH,
			 sizeof(*message) + message->entry_count * sizeof(message->entries[0]));
	return session_send(client, message, message->header.bytes, NULL, 0);
}
