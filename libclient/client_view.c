/* SPDX-License-Identifier: MIT */
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/check.h"
#include "libclient/client_private.h"

/* ooc_place.fill: the view's number above the fill count of a directory word. */
#define FILL_COUNT_BITS 34u

static const struct wire_directory *view_directory(const struct view *view)
{
	return view->directory.base;
}

static const struct wire_grants *view_grants(const struct view *view)
{
	return view->grants.base;
}

int view_create(struct ooc_store *store, const struct wire_opened *opened, int directory_fd,
		int grants_fd, struct view **ret)
{
	struct why *why = &store->client->why;
	uint64_t node_count = opened->node_count;
	struct view *view;
	int r;

	if (opened->directory_bytes < sizeof(struct wire_directory) + 8 * node_count ||
	    opened->grants_bytes < sizeof(struct wire_grants) + 8 * ((node_count + 63) / 64))
		return why_set(why, -EPROTO, "the daemon's tables are too short for %llu nodes",
			       (unsigned long long)node_count);
	view = calloc(1, sizeof(*view));
	if (!view)
		return why_set(why, -ENOMEM, "no memory for a store's view");
	view->epoch = store->client->epoch;
	r = mapping_init(directory_fd, opened->directory_bytes, &view->directory, why);
	if (r == 0)
		r = mapping_init(grants_fd, opened->grants_bytes, &view->grants, why);
	if (r < 0)
		goto err_destroy;
	if (view_directory(view)->generation != opened->generation ||
	    view_directory(view)->node_count != node_count ||
	    view_grants(view)->node_count != node_count) {
		r = why_set(why, -EPROTO, "the daemon's tables are of another store");
		goto err_destroy;
	}
	view->number = ++store->view_count;
	*ret = view;
	return 0;

err_destroy:
	view_destroy(store, view);
	return r;
}

struct view *view_destroy(struct ooc_store *store, struct view *view)
{
	if (!view)
		return NULL;

	for (uint32_t i = 0; i < WIRE_SEGMENT_COUNT_MAX; i++) {
		if (view->slots[i] > 0)
			mapping_done(&store->segments[view->slots[i] - 1].mapping);
	}
	mapping_done(&view->directory);
	mapping_done(&view->grants);
	free(view->words);
	free(view);
	return NULL;
}

int view_take_segment(struct ooc_store *store, const struct wire_segment *message, int fd)
{
	struct why *why = &store->client->why;
	struct segment_slot *segment;
	uint32_t slot = 0;
	int r;

	if (store->view->slots[message->segment] > 0)
		return why_set(why, -EPROTO, "the daemon announces segment %u twice",
			       message->segment);
	while (slot < WIRE_SEGMENT_COUNT_MAX && store->segments[slot].mapping.base)
		slot++;
	/* Old views have all slots: what lies in this segment is not drawable here. */
	if (slot == WIRE_SEGMENT_COUNT_MAX)
		return 0;
	segment = &store->segments[slot];
	r = mapping_init(fd, message->segment_bytes, &segment->mapping, why);
	if (r < 0)
		return r;
	segment->unique = ++store->client->segment_unique;
	store->view->slots[message->segment] = (uint16_t)(slot + 1);
	return 0;
}

void view_take_segment_gone(struct ooc_store *store, uint32_t segment)
{
	uint16_t *slot = &store->view->slots[segment];

	if (*slot > 0)
		mapping_done(&store->segments[*slot - 1].mapping);
	*slot = 0;
}

/* ---- what is drawable ---- */

/*
 * Has nobody taken away what the view shows?  The daemon writes another epoch before it gives back
 * holds that a session does not know to be lost: it was thrown out (grants), or the daemon was
 * restarted, kept its memory and waited for long enough (directory).
 */
static bool view_is_alive(const struct view *view)
{
	/* Pairs with the daemon's release stores before it evicts. */
	return atomic_load_explicit(&view_grants(view)->epoch, memory_order_acquire) ==
		       view->epoch &&
	       atomic_load_explicit(&view_directory(view)->epoch, memory_order_acquire) ==
		       view->epoch;
}

static uint64_t view_word(const struct view *view, uint32_t node)
{
	/* Pairs with the daemon's release store of a word after its payload's bytes are verified. */
	return atomic_load_explicit(&view_directory(view)->words[node], memory_order_acquire);
}

/*
 * Does the session hold the node?  The grant bit alone does not say so: it may be one that a set of
 * ours has given back which the daemon has yet to read.  Since `since` no set of ours has, so once
 * the daemon has taken that one over, a bit that is set is a hold that stays.
 */
static bool node_is_held(const struct ooc_store *store, uint32_t node)
{
	const struct ooc_client *client = store->client;
	const struct want *want = &store->wants[node];
	uint64_t bits;

	if (want->sent != client->set.sent)
		return false;
	/* Pairs with the daemon's release store of `acknowledged` after the grants of that set. */
	if (atomic_load_explicit(&session_page(client)->acknowledged, memory_order_acquire) <
	    want->since)
		return false;
	/* Pairs with the daemon's release store of the bit after it counts the hold. */
	bits = atomic_load_explicit(&view_grants(store->view)->words[node / 64],
				    memory_order_acquire);
	return (bits >> (node % 64) & 1) != 0;
}

/* Where a READY word points to, if that is inside a segment that is known. */
static bool word_to_place(const struct ooc_store *store, const struct view *view, uint32_t node,
			  uint64_t word, struct ooc_place *ret)
{
	uint64_t offset_bytes = (uint64_t)wire_word_page(word) * WIRE_PAGE_BYTES;
	uint64_t payload_bytes = store->wants[node].payload_bytes;
	uint16_t slot = view->slots[wire_word_segment(word)];

	if (wire_word_state(word) != WIRE_NODE_READY || slot == 0)
		return false;
	if (offset_bytes + payload_bytes > store->segments[slot - 1].mapping.bytes)
		return false;
	ret->segment = slot - 1u;
	ret->offset_bytes = offset_bytes;
	ret->fill = view->number << FILL_COUNT_BITS | wire_word_fill_count(word);
	return true;
}

static bool node_find_new(const struct ooc_store *store, uint32_t node, struct ooc_place *ret)
{
	const struct view *view = store->view;

	return view && node_is_held(store, node) && view_is_alive(view) &&
	       word_to_place(store, view, node, view_word(view, node), ret);
}

static bool node_find_old(const struct ooc_store *store, uint32_t node, struct ooc_place *ret)
{
	for (const struct view *view = store->old_views; view; view = view->next) {
		if (view->words && view->last_serial == 0 && view_is_alive(view) &&
		    word_to_place(store, view, node, view->words[node], ret))
			return true;
	}
	return false;
}

/* The one definition of "drawable". */
static bool node_find(const struct ooc_store *store, uint32_t node, struct ooc_place *ret)
{
	if (node >= store->node_count || store->wants[node].given != store->client->set.given ||
	    store->client->set.given == 0)
		return false;
	return node_find_new(store, node, ret) || node_find_old(store, node, ret);
}

const void *ooc_map(const struct ooc_store *store, uint32_t node)
{
	struct ooc_place place;

	if (!node_find(store, node, &place))
		return NULL;
	return (const uint8_t *)store->segments[place.segment].mapping.base + place.offset_bytes;
}

int ooc_locate(const struct ooc_store *store, uint32_t node, struct ooc_place *ret)
{
	struct ooc_place place;

	if (!node_find(store, node, &place))
		return -EAGAIN;
	*ret = place;
	return 0;
}

bool ooc_still_valid(const struct ooc_store *store, uint32_t node, const struct ooc_place *place)
{
	uint64_t number = place->fill >> FILL_COUNT_BITS;
	const struct view *view = store->view;
	struct ooc_place now;

	/* The caller's reads of the payload come first, then the look at what it was. */
	atomic_thread_fence(memory_order_acquire);
	if (!view || view->number != number) {
		view = store->old_views;
		while (view && view->number != number)
			view = view->next;
	}
	return view && node < store->node_count && view_is_alive(view) &&
	       word_to_place(store, view, node, view_word(view, node), &now) &&
	       now.segment == place->segment && now.offset_bytes == place->offset_bytes &&
	       now.fill == place->fill;
}

int ooc_segment(const struct ooc_store *store, uint32_t segment, const void **ret_base,
		uint64_t *ret_bytes, uint64_t *ret_unique)
{
	const struct segment_slot *slot;

	if (segment >= WIRE_SEGMENT_COUNT_MAX || !store->segments[segment].mapping.base)
		return -ENOENT;
	slot = &store->segments[segment];
	*ret_base = slot->mapping.base;
	*ret_bytes = slot->mapping.bytes;
	*ret_unique = slot->unique;
	return 0;
}

enum ooc_state ooc_node_state(const struct ooc_store *store, uint32_t node)
{
	/* The public values are the wire's. */
	static_assert((int)OOC_STATE_DAMAGED == (int)WIRE_NODE_DAMAGED &&
			      (int)OOC_STATE_READY == (int)WIRE_NODE_READY &&
			      (int)OOC_STATE_BUSY == (int)WIRE_NODE_BUSY,
		      "a state is passed on as it is");

	if (!store->view || node >= store->node_count)
		return OOC_STATE_ABSENT;
	return (enum ooc_state)wire_word_state(view_word(store->view, node));
}

/* ---- views of lost sessions ---- */

/* Notes where everything is that is wanted and drawable, before the session's page goes. */
static void note_words(struct ooc_store *store, struct view *view)
{
	const struct set *set = &store->client->set;

	for (size_t i = 0; i < set->entry_count; i++) {
		uint32_t node = set->entries[i].node;
		struct ooc_place place;

		if (set->entries[i].store != store->number || !node_find_new(store, node, &place))
			continue;
		if (!view->words)
			view->words = calloc(store->node_count, sizeof(*view->words));
		/* Without memory for it nothing is shown until it has been fetched again. */
		if (!view->words)
			return;
		view->words[node] = view_word(view, node);
	}
}

bool view_make_room(struct ooc_store *store)
{
	struct view *oldest = store->old_views;
	unsigned count = 0;

	for (struct view *view = oldest; view; view = view->next) {
		oldest = view;
		count++;
	}
	if (count < OLD_VIEW_COUNT_MAX)
		return true;
	if (oldest->last_serial == 0)
		oldest->last_serial = store->client->set.given;
	view_release_old(store);
	for (struct view *view = store->old_views; view; view = view->next) {
		if (view == oldest)
			return false;
	}
	return true;
}

void view_grow_old(struct ooc_store *store)
{
	struct view *view = store->view;

	if (!view)
		return;
	note_words(store, view);
	store->view = NULL;
	if (!view->words && !store->client->keep_drawing) {
		view_destroy(store, view);
		return;
	}
	view->next = store->old_views;
	store->old_views = view;
}

void view_forget_old(struct ooc_store *store)
{
	for (struct view *view = store->old_views; view; view = view->next) {
		if (view->last_serial == 0)
			view->last_serial = store->client->set.given;
	}
	view_release_old(store);
}

void view_release_old(struct ooc_store *store)
{
	const struct ooc_client *client = store->client;
	struct view **link = &store->old_views;

	while (*link) {
		struct view *view = *link;

		/* Rule 2 of the public header: how long a pointer is good. */
		if (view->last_serial == 0 ||
		    (client->keep_drawing && client->set.retired <= view->last_serial)) {
			link = &view->next;
			continue;
		}
		*link = view->next;
		view_destroy(store, view);
	}
}
