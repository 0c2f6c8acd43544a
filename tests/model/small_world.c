/* SPDX-License-Identifier: MIT */
#include "tests/model/small_world.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/sharing/division.h"
#include "daemon/sharing/visible.h"
#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "tests/model/region.h"

#define EPOCH 7u

/*
 * The readers are alike to the daemon, so one of them is enough to look and to draw, one node at a
 * time.  The other wants, lets go and is thrown out, which is all that the first can see of it.
 */
#define ARTIST 0u
#define RIVAL  1u

/* Sets a reader may send: node numbers, the most important one first. */
#define SET_COUNT 5u

static const struct {
	uint8_t count;
	uint8_t nodes[WORLD_NODES];
	const char *text;
} sets[SET_COUNT] = {
	{ 0, { 0 }, "{}" },       { 1, { 0 }, "{0}" },      { 1, { 1 }, "{1}" },
	{ 2, { 0, 1 }, "{0 1}" }, { 2, { 1, 0 }, "{1 0}" },
};

#define SETS_ALL ((1u << SET_COUNT) - 1)
/* In short: one of them, both, both in the other order; and a rival for the second that lets go. */
#define SETS_ARTIST (1u << 1 | 1u << 3 | 1u << 4)
#define SETS_RIVAL  (1u << 0 | 1u << 2)

/* Argument of STEP_SEND. */
#define SEND_RETIRE               1u
#define SEND_TWICE                2u
#define SEND_FLAGS                4u
#define SEND_ARGUMENT(set, flags) (SEND_FLAGS * (set) + (flags))

enum message_kind {
	MESSAGE_NONE = 0,
	MESSAGE_SET,
	MESSAGE_RETIRE,
};

struct message {
	enum message_kind kind;
	uint8_t set;
	bool retire;
	bool twice; /* before it the empty set, which is on its way too */
	uint64_t serial;
};

/* A look is three: the answer to the set, the grant, the word.  Others act in between. */
enum look {
	LOOK_NONE = 0,
	LOOK_ACKNOWLEDGED,
	LOOK_GRANTED,
};

struct drawing {
	bool on;
	struct place place;
	uint64_t content;
	uint64_t serial; /* newest set when it was looked at */
};

struct reader {
	const struct wire_grants *grants;
	uint64_t serial; /* of the newest set sent */
	uint8_t set;
	uint64_t since[WORLD_NODES]; /* 0: not in the newest set */
	struct message message;      /* sent, not read */
	enum look look;
	uint8_t look_node;
	struct drawing drawing[WORLD_NODES];
	bool thrown_out;
};

struct world {
	struct cache cache;
	struct room room;
	struct account account;
	struct served served;
	struct store_superblock superblock;
	struct store_node records[WORLD_NODES + 1];
	struct visible visible[WORLD_READERS];
	struct wire_session_page pages[WORLD_READERS];
	struct reader readers[WORLD_READERS];
	uint64_t content[2]; /* of each page; 0: anything */
	uint32_t node_count;
	uint32_t set_masks[WORLD_READERS];
};

/* The one that exists, for what the linker sends here in the middle of its steps. */
static struct world *the_world;

/* ---- making it ---- */

/* Makes at once the only segment that fits into the budget. */
static void on_make(void *arg, struct served *served)
{
	struct world *world = arg;
	struct memfile memfile = MEMFILE_NONE;
	struct segment *segment;

	memfile.bytes = served->arena.segment_bytes;
	CHECK(cache_add_segment(&world->cache, served, &memfile, &segment) == 0);
}

static void on_gone(void *arg, struct served *served, struct segment *segment)
{
	(void)arg;
	(void)served;
	(void)segment;
}

static void make_served(struct world *world, uint32_t room_pages)
{
	struct served *served = &world->served;

	list_init(&served->link);
	list_init(&served->lru);
	for (uint32_t i = 0; i < world->node_count; i++) {
		world->records[i].payload_id = i + 1;
		world->records[i].payload_bytes = WIRE_PAGE_BYTES;
	}
	world->superblock.node_count = world->node_count;
	served->superblock = &world->superblock;
	served->records = world->records;
	served->node_count = world->node_count;
	served->nodes = region_take(world->node_count * sizeof(*served->nodes));
	for (uint32_t i = 0; i < world->node_count; i++)
		node_init(&served->nodes[i], WIRE_PAGE_BYTES);
	served->ledger.held = region_take(world->node_count * sizeof(served->ledger.held[0]));
	served->directory = region_take(sizeof(*served->directory) +
					world->node_count * sizeof(served->directory->words[0]));
	atomic_init(&served->directory->epoch, EPOCH);
	arena_init(&served->arena, room_pages * WIRE_PAGE_BYTES);
}

struct world *world_create(uint32_t room_pages, bool whole)
{
	const struct cache_calls calls = { .make = on_make, .gone = on_gone };
	struct world *world;

	region_reset();
	world = region_take(sizeof(*world));
	the_world = world;
	world->set_masks[ARTIST] = whole ? SETS_ALL : SETS_ARTIST;
	world->set_masks[RIVAL] = whole ? SETS_ALL : SETS_RIVAL;
	/* Where all fit, another one has to take the room that makes the cache evict. */
	world->node_count = WORLD_NODES + (room_pages > 1);
	region_use(true);
	make_served(world, room_pages);
	cache_init(&world->cache, room_pages * WIRE_PAGE_BYTES, &calls, world);
	room_init(&world->room, &world->cache);
	world->account.policy.weight = 1;
	cache_add_store(&world->cache, &world->served);
	cache_warm_up(&world->cache, &world->served);
	for (uint32_t i = 0; i < WORLD_READERS; i++) {
		visible_init(&world->visible[i], &world->room, &world->account, NULL, i + 1,
			     &world->pages[i]);
		CHECK(visible_attach(&world->visible[i], 0, &world->served, EPOCH, NULL) == 0);
		world->readers[i].grants = world->visible[i].attachments[0]->grants;
	}
	region_use(false);
	return world;
}

/* ---- the readers ---- */

static uint64_t word_of(const struct world *world, uint32_t node)
{
	return atomic_load(&world->served.directory->words[node]);
}

static bool is_acknowledged(const struct world *world, uint32_t r, uint32_t node)
{
	const struct reader *reader = &world->readers[r];

	return reader->since[node] > 0 &&
	       atomic_load(&world->pages[r].acknowledged) >= reader->since[node];
}

static bool is_granted(const struct reader *reader, uint32_t node)
{
	return atomic_load(&reader->grants->words[0]) >> node & 1;
}

static bool is_alive(const struct world *world, const struct reader *reader)
{
	return atomic_load(&reader->grants->epoch) == EPOCH &&
	       atomic_load(&world->served.directory->epoch) == EPOCH;
}

static uint64_t content_of_fill(uint32_t node, uint64_t fill_count)
{
	return fill_count * (WORLD_NODES + 1) + node + 1;
}

static uint64_t content_at(const struct world *world, struct place place)
{
	CHECK(place.segment == 0 && place.page < ARRAY_LENGTH(world->content));
	return world->content[place.page];
}

static void look(struct world *world, uint32_t r, uint32_t node)
{
	struct reader *reader = &world->readers[r];
	uint64_t word;

	switch (reader->look) {
	case LOOK_NONE:
		if (is_acknowledged(world, r, node)) {
			reader->look = LOOK_ACKNOWLEDGED;
			reader->look_node = (uint8_t)node;
		}
		return;
	case LOOK_ACKNOWLEDGED:
		reader->look = is_granted(reader, node) ? LOOK_GRANTED : LOOK_NONE;
		return;
	case LOOK_GRANTED:
		break;
	}
	reader->look = LOOK_NONE;
	word = word_of(world, node);
	if (!is_alive(world, reader) || wire_word_state(word) != WIRE_NODE_READY)
		return;
	reader->drawing[node] = (struct drawing){
		.on = true,
		.place = { wire_word_segment(word), wire_word_page(word) },
		.content = content_of_fill(node, wire_word_fill_count(word)),
		.serial = reader->serial,
	};
}

/* twice: the reader has let go of all in between, and the daemon has yet to read of it. */
static void send_set(struct reader *reader, uint8_t set, bool retire, bool twice)
{
	uint64_t since[WORLD_NODES] = { 0 };

	if (twice) {
		reader->serial++;
		memset(reader->since, 0, sizeof(reader->since));
	}
	reader->serial++;
	reader->set = set;
	for (uint32_t i = 0; i < sets[set].count; i++) {
		uint32_t node = sets[set].nodes[i];

		since[node] = reader->since[node] > 0 ? reader->since[node] : reader->serial;
	}
	memcpy(reader->since, since, sizeof(since));
	reader->message = (struct message){ MESSAGE_SET, set, retire, twice, reader->serial };
}

static bool is_drawing(const struct reader *reader, uint64_t before_serial)
{
	for (uint32_t i = 0; i < WORLD_NODES; i++)
		if (reader->drawing[i].on && reader->drawing[i].serial < before_serial)
			return true;
	return false;
}

/* ---- the daemon ---- */

static void read_message(struct world *world, uint32_t r)
{
	struct visible *visible = &world->visible[r];
	struct message message = world->readers[r].message;
	struct wire_entry entries[WORLD_NODES] = { 0 };

	if (message.twice) {
		world->readers[r].message.twice = false;
		CHECK(visible_take(visible, entries, 0, message.serial - 1, true) == 0);
		return;
	}
	world->readers[r].message.kind = MESSAGE_NONE;
	if (message.kind == MESSAGE_RETIRE) {
		visible_retire(visible, message.serial);
		return;
	}
	for (uint32_t i = 0; i < sets[message.set].count; i++)
		entries[i] = (struct wire_entry){ 0, sets[message.set].nodes[i], 1.0f };
	CHECK(visible_take(visible, entries, sets[message.set].count, message.serial,
			   message.retire) == 0);
}

/* As fills_start(): from here on the kernel may write to the place. */
static int begin_fill(struct world *world, uint32_t node, bool prefetch)
{
	int r = cache_begin_fill(&world->cache, &world->served, node, node, prefetch);

	if (r == 0)
		world->content[world->served.nodes[node].place.page] = 0;
	return r;
}

static void begin_fetch(struct world *world, uint32_t r)
{
	struct queue_want want;
	int error;

	if (!visible_next(&world->visible[r], &want))
		return;
	error = begin_fill(world, want.index, false);
	if (error != -EAGAIN && error != -EBUSY)
		visible_begun(&world->visible[r], &want, error);
}

/* As fill_end(). */
static void end_fill(struct world *world, uint32_t node, enum wire_reason reason)
{
	const struct node *state = &world->served.nodes[node];
	struct fill_result result = { &world->served, node, .reason = reason };

	if (reason == WIRE_REASON_NONE) {
		world->content[state->place.page] = content_of_fill(node, state->fill_count);
		cache_end_fill(&world->cache, &world->served, node);
	}
	for (uint32_t r = 0; r < WORLD_READERS; r++)
		visible_fill_ended(&world->visible[r], &result);
	if (reason != WIRE_REASON_NONE)
		cache_fail_fill(&world->cache, &world->served, node, reason == WIRE_REASON_DAMAGED);
}

/* What the daemon does for each session at the end of each round, if it has to be done. */
static void end_round(struct world *world)
{
	struct wire_refusal refusals[WORLD_NODES];

	division_settle(&world->room);
	for (uint32_t r = 0; r < WORLD_READERS; r++) {
		struct visible *visible = &world->visible[r];

		visible_retry(visible);
		if (visible_wants_quiet(visible) && world->readers[r].message.kind == MESSAGE_NONE)
			visible_note_quiet(visible);
		(void)visible_take_refusals(visible, refusals, WORLD_NODES);
		visible_settle(visible);
	}
}

/* Its client may live on and look: but not through a grant. */
static void throw_out(struct world *world, uint32_t r)
{
	struct reader *reader = &world->readers[r];

	visible_detach(&world->visible[r], 0);
	reader->thrown_out = true;
	reader->message.kind = MESSAGE_NONE;
	/* What it draws now it has to look at again (ooc_still_valid). */
	memset(reader->drawing, 0, sizeof(reader->drawing));
}

/* What visible.c wants of fills.c: here every fill is somebody's or nobody's, and all end. */
void fills_upgrade(struct fills *fills, const struct served *served, uint32_t index)
{
	(void)fills;
	CHECK(served->nodes[index].state == NODE_BUSY);
}

/* ---- in the middle of a step ---- */

void __real_cache_release(struct cache *cache, struct served *served, uint32_t index);
void __wrap_cache_release(struct cache *cache, struct served *served, uint32_t index);
void __wrap_cache_release(struct cache *cache, struct served *served, uint32_t index)
{
	uint32_t granted_count = 0;

	/* The grant has gone before the hold goes. */
	for (uint32_t r = 0; r < WORLD_READERS; r++)
		granted_count += is_alive(the_world, &the_world->readers[r]) &&
				 is_granted(&the_world->readers[r], index);
	CHECK(granted_count < served->nodes[index].hold_count);
	__real_cache_release(cache, served, index);
	world_observe(the_world);
}

void __real_arena_give(struct arena *arena, struct place place);
void __wrap_arena_give(struct arena *arena, struct place place);
void __wrap_arena_give(struct arena *arena, struct place place)
{
	/* Another's from here on. */
	the_world->content[place.page] = 0;
	world_observe(the_world);
	__real_arena_give(arena, place);
}

/* ---- steps ---- */

static void add(struct step *steps, uint32_t *count, enum step_kind kind, uint32_t r,
		uint32_t argument)
{
	CHECK(*count < WORLD_STEPS_MAX);
	steps[(*count)++] = (struct step){ (uint8_t)kind, (uint8_t)r, (uint8_t)argument };
}

static void add_artist_steps(const struct world *world, struct step *ret, uint32_t *count)
{
	const struct reader *reader = &world->readers[ARTIST];

	if (!reader->thrown_out)
		add(ret, count, STEP_THROW_OUT, ARTIST, 0);
	if (reader->look != LOOK_NONE) {
		add(ret, count, STEP_LOOK, ARTIST, reader->look_node);
		return;
	}
	for (uint32_t i = 0; i < WORLD_NODES; i++) {
		if (reader->drawing[i].on)
			add(ret, count, STEP_END, ARTIST, i);
		else if (!reader->thrown_out && is_acknowledged(world, ARTIST, i) &&
			 !is_drawing(reader, UINT64_MAX))
			add(ret, count, STEP_LOOK, ARTIST, i);
	}
	if (reader->thrown_out || reader->message.kind != MESSAGE_NONE)
		return;
	for (uint32_t set = 0; set < SET_COUNT; set++) {
		if (!(world->set_masks[ARTIST] >> set & 1))
			continue;
		add(ret, count, STEP_SEND, ARTIST, SEND_ARGUMENT(set, 0));
		if (is_drawing(reader, UINT64_MAX))
			continue;
		add(ret, count, STEP_SEND, ARTIST, SEND_ARGUMENT(set, SEND_RETIRE));
		add(ret, count, STEP_SEND, ARTIST, SEND_ARGUMENT(set, SEND_RETIRE | SEND_TWICE));
	}
	if (reader->serial > 0 && !is_drawing(reader, reader->serial))
		add(ret, count, STEP_RETIRE, ARTIST, 0);
}

static void add_rival_steps(const struct world *world, struct step *ret, uint32_t *count)
{
	for (uint32_t set = 0; set < SET_COUNT; set++)
		if (world->set_masks[RIVAL] >> set & 1)
			add(ret, count, STEP_SEND, RIVAL, SEND_ARGUMENT(set, SEND_RETIRE));
	add(ret, count, STEP_THROW_OUT, RIVAL, 0);
}

static void add_daemon_steps(const struct world *world, uint32_t r, struct step *ret,
			     uint32_t *count)
{
	const struct visible *visible = &world->visible[r];
	const struct reader *reader = &world->readers[r];

	if (reader->message.kind != MESSAGE_NONE)
		add(ret, count, STEP_READ, r, 0);
	if (visible->counts[WANT_QUEUED] > 0)
		add(ret, count, STEP_BEGIN, r, 0);
}

uint32_t world_steps(const struct world *world, struct step ret[WORLD_STEPS_MAX])
{
	uint32_t count = 0;

	for (uint32_t r = 0; r < WORLD_READERS; r++) {
		bool is_here = !world->readers[r].thrown_out;

		if (r == ARTIST)
			add_artist_steps(world, ret, &count);
		else if (is_here)
			add_rival_steps(world, ret, &count);
		if (is_here)
			add_daemon_steps(world, r, ret, &count);
	}
	if (world->cache.room_is_coming)
		add(ret, &count, STEP_GIVE_UP, 0, 0);
	for (uint32_t i = 0; i < world->node_count; i++) {
		enum node_state state = world->served.nodes[i].state;

		if (state == NODE_ABSENT)
			add(ret, &count, STEP_PREFETCH, 0, i);
		if (state != NODE_BUSY)
			continue;
		add(ret, &count, STEP_FILLED, 0, i);
		add(ret, &count, STEP_FAILED, 0, i);
		if (i == 0)
			add(ret, &count, STEP_DAMAGED, 0, i);
	}
	return count;
}

static void take(struct world *world, struct step step)
{
	struct reader *reader = &world->readers[step.reader];

	switch ((enum step_kind)step.kind) {
	case STEP_SEND:
		send_set(reader, step.argument / SEND_FLAGS, step.argument & SEND_RETIRE,
			 step.argument & SEND_TWICE);
		/* Only who draws by old grants cares how long a set is on its way. */
		if (step.reader == RIVAL)
			read_message(world, RIVAL);
		break;
	case STEP_RETIRE:
		reader->message =
			(struct message){ .kind = MESSAGE_RETIRE, .serial = reader->serial };
		break;
	case STEP_LOOK:
		look(world, step.reader, step.argument);
		break;
	case STEP_END:
		reader->drawing[step.argument] = (struct drawing){ 0 };
		break;
	case STEP_READ:
		read_message(world, step.reader);
		break;
	case STEP_BEGIN:
		begin_fetch(world, step.reader);
		break;
	case STEP_THROW_OUT:
		throw_out(world, step.reader);
		break;
	case STEP_GIVE_UP:
		/* As room_tick(). */
		world->cache.room_is_coming = false;
		break;
	case STEP_PREFETCH:
		(void)begin_fill(world, step.argument, true);
		break;
	case STEP_FILLED:
		end_fill(world, step.argument, WIRE_REASON_NONE);
		break;
	case STEP_FAILED:
		end_fill(world, step.argument, WIRE_REASON_UNREADABLE);
		break;
	case STEP_DAMAGED:
		end_fill(world, step.argument, WIRE_REASON_DAMAGED);
		break;
	case STEP_KIND_COUNT_:
		CHECK(false);
		break;
	}
}

void world_take(struct world *world, struct step step)
{
	region_use(true);
	take(world, step);
	end_round(world);
	region_use(false);
}

/* ---- what must hold ---- */

static void observe_reader(const struct world *world, uint32_t r)
{
	const struct reader *reader = &world->readers[r];

	for (uint32_t i = 0; i < WORLD_NODES; i++) {
		const struct drawing *drawing = &reader->drawing[i];
		uint64_t word = word_of(world, i);
		struct place place = { wire_word_segment(word), wire_word_page(word) };

		/* Nobody writes to what is drawn. */
		if (drawing->on)
			CHECK(content_at(world, drawing->place) == drawing->content);
		if (!is_acknowledged(world, r, i) || !is_granted(reader, i) ||
		    !is_alive(world, reader) || wire_word_state(word) != WIRE_NODE_READY)
			continue;
		/* What may be drawn is held, and is the node. */
		CHECK(world->served.nodes[i].state == NODE_HELD);
		CHECK(content_at(world, place) == content_of_fill(i, wire_word_fill_count(word)));
	}
}

void world_observe(const struct world *world)
{
	for (uint32_t r = 0; r < WORLD_READERS; r++)
		observe_reader(world, r);
}

/* READY says of whatever node, held or not, that its bytes are right. */
static void check_words(const struct world *world)
{
	for (uint32_t i = 0; i < world->node_count; i++) {
		uint64_t word = word_of(world, i);
		struct place place = { wire_word_segment(word), wire_word_page(word) };

		CHECK((wire_word_state(word) == WIRE_NODE_READY) ==
		      node_is_ready(&world->served.nodes[i]));
		if (wire_word_state(word) == WIRE_NODE_READY)
			CHECK(content_at(world, place) ==
			      content_of_fill(i, wire_word_fill_count(word)));
	}
}

/* Holds are those of the sets, and what the daemon has read and has no more to do for is answered. */
static void check_answers(const struct world *world)
{
	uint32_t hold_count = 0;

	for (uint32_t i = 0; i < world->node_count; i++)
		hold_count += world->served.nodes[i].hold_count;
	for (uint32_t r = 0; r < WORLD_READERS; r++) {
		const struct visible *visible = &world->visible[r];

		CHECK(hold_count >= visible->held_count);
		hold_count -= visible->held_count;
		if (world->readers[r].thrown_out) {
			CHECK(visible->held_count == 0);
			continue;
		}
		/* A want that waits waits for a fill that is under way, or for one to be begun. */
		if (visible_missing_count(visible) == 0)
			CHECK(atomic_load(&world->pages[r].settled) == visible->serial);
	}
	CHECK(hold_count == 0);
}

void world_check(const struct world *world)
{
	cache_check(&world->cache);
	for (uint32_t r = 0; r < WORLD_READERS; r++)
		visible_check(&world->visible[r]);
	check_words(world);
	check_answers(world);
	world_observe(world);
}

/* ---- keys ---- */

struct key {
	uint8_t *bytes;
	size_t count;
};

static void put(struct key *key, uint64_t value)
{
	CHECK(key->count < WORLD_KEY_BYTES && value <= UINT8_MAX);
	key->bytes[key->count++] = (uint8_t)value;
}

/* How far a moment of released bytes lies ahead, in pages: beyond a few it is out of reach. */
static uint64_t pages_ahead(const struct world *world, uint64_t at_bytes)
{
	return world->cache.released_bytes >= at_bytes
		       ? 0
		       : u64_min((at_bytes - world->cache.released_bytes) / WIRE_PAGE_BYTES, 15);
}

static void put_node(struct key *key, const struct world *world, uint32_t index)
{
	const struct node *node = &world->served.nodes[index];
	uint32_t older_count = 0;

	for (uint32_t i = 0; i < world->node_count; i++)
		older_count += world->served.nodes[i].state == NODE_FREE &&
			       world->served.nodes[i].last_use < node->last_use;
	put(key,
	    node->state | node->hold_count << 4 | (uint32_t)(node->plan == world->room.plan) << 7);
	put(key, node->state == NODE_ABSENT || node->state == NODE_DAMAGED
			 ? 0
			 : node->place.page | (node->state == NODE_FREE ? older_count << 4 : 0));
}

static void put_want(struct key *key, const struct visible *visible, uint32_t node)
{
	uint32_t at = visible->attachments[0]->want_of_node[node];
	const struct want *want = &visible->wants[at - 1];

	put(key, at);
	if (at == 0)
		return;
	put(key, want->state | want->reason << 4);
	put(key, (uint32_t)want->holding | (uint32_t)want->revoked << 1 |
			 (uint32_t)(want->serial == visible->serial) << 2 |
			 (uint32_t)want->is_sure << 3 |
			 (uint32_t)(want->is_sure && want->sure == visible->serial) << 4);
}

/*
 * Left out is what the future does not depend on: what was told (all that is owed is told in each
 * round) and where a search begins that finds the same.
 */
static void put_visible(struct key *key, const struct world *world, uint32_t r)
{
	const struct visible *visible = &world->visible[r];
	for (uint32_t i = 0; i < WORLD_NODES; i++)
		put_want(key, visible, i);
	put(key, visible->count | visible->total << 4);
	put(key, visible->full_count > 0 ? pages_ahead(world, visible->retry_at_bytes) : 0);
	put(key, (uint32_t)(visible->serial == world->readers[r].serial) |
			 (uint32_t)(visible->serial == 0) << 1);
}

static void put_reader(struct key *key, const struct world *world, uint32_t r)
{
	const struct reader *reader = &world->readers[r];

	put(key, reader->set | (uint32_t)reader->thrown_out << 4);
	if (r == RIVAL)
		return;
	put(key, reader->message.kind | (uint32_t)reader->message.set << 2 |
			 (uint32_t)reader->message.twice << 5 |
			 (uint32_t)reader->message.retire << 6);
	put(key, reader->look | (uint32_t)reader->look_node << 4);
	for (uint32_t i = 0; i < WORLD_NODES; i++)
		put(key, (uint32_t)reader->drawing[i].on |
				 (uint32_t)(reader->drawing[i].serial == reader->serial) << 1 |
				 (uint32_t)(reader->since[i] == reader->serial) << 2);
}

static void put_room(struct key *key, const struct world *world)
{
	const struct room *room = &world->room;
	const struct cache *cache = &world->cache;
	bool is_full_now = world->served.full_at_bytes == cache->released_bytes;

	CHECK(!room->changed && room->drain_count == cache->drain_count);
	put(key, room->unusable_pages | (uint64_t)room->divided << 4 |
			 (uint64_t)cache->room_is_coming << 5 |
			 (uint64_t)cache->draining_count << 6);
	put(key, is_full_now ? world->served.full_pages : 0);
}

size_t world_key(const struct world *world, uint8_t ret[WORLD_KEY_BYTES])
{
	struct key key = { .bytes = ret };

	for (uint32_t i = 0; i < world->node_count; i++)
		put_node(&key, world, i);
	put_room(&key, world);
	for (uint32_t r = 0; r < WORLD_READERS; r++) {
		put_reader(&key, world, r);
		if (!world->readers[r].thrown_out)
			put_visible(&key, world, r);
	}
	return key.count;
}

/* ---- for people ---- */

const char *step_text(struct step step)
{
	static const char *const names[STEP_KIND_COUNT_] = {
		[STEP_RETIRE] = "retires",          [STEP_LOOK] = "looks at",
		[STEP_END] = "has drawn",           [STEP_READ] = "is read from",
		[STEP_BEGIN] = "has a fetch begun", [STEP_THROW_OUT] = "is thrown out",
		[STEP_GIVE_UP] = "waits no longer", [STEP_PREFETCH] = "is prefetched",
		[STEP_FILLED] = "is filled",        [STEP_FAILED] = "cannot be read",
		[STEP_DAMAGED] = "is damaged",
	};
	static char text[64];

	if (step.kind == STEP_SEND)
		(void)snprintf(text, sizeof(text), "reader %u sends %s%s%s", step.reader,
			       step.argument & SEND_TWICE ? "{} and " : "",
			       sets[step.argument / SEND_FLAGS].text,
			       step.argument & SEND_RETIRE ? ", and retires" : "");
	else if (step.kind >= STEP_PREFETCH)
		(void)snprintf(text, sizeof(text), "node %u %s", step.argument, names[step.kind]);
	else if (step.kind == STEP_LOOK || step.kind == STEP_END)
		(void)snprintf(text, sizeof(text), "reader %u %s node %u", step.reader,
			       names[step.kind], step.argument);
	else
		(void)snprintf(text, sizeof(text), "reader %u %s", step.reader, names[step.kind]);
	return text;
}
