/* SPDX-License-Identifier: MIT */
#include "daemon/cache/node.h"

#include "formats/base/check.h"

/* The table of node.h.  One row for each state left, one column for each state entered. */
static const bool edge_allowed[NODE_STATE_COUNT_][NODE_STATE_COUNT_] = {
	[NODE_ABSENT] = { [NODE_BUSY] = true },
	[NODE_BUSY] = { [NODE_HELD] = true,
			[NODE_FREE] = true,
			[NODE_ABSENT] = true,
			[NODE_DAMAGED] = true },
	[NODE_HELD] = { [NODE_FREE] = true },
	[NODE_FREE] = { [NODE_HELD] = true, [NODE_ABSENT] = true },
};

bool node_edge_allowed(enum node_state from, enum node_state to)
{
	CHECK(from < NODE_STATE_COUNT_ && to < NODE_STATE_COUNT_);
	return edge_allowed[from][to];
}

const char *node_state_name(enum node_state state)
{
#define NODE_STATE_NAME(name) [NODE_##name] = #name,
	static const char *const names[NODE_STATE_COUNT_] = { NODE_STATES(NODE_STATE_NAME) };
#undef NODE_STATE_NAME

	CHECK(state < NODE_STATE_COUNT_);
	return names[state];
}

void node_check(const struct node *node)
{
	switch (node->state) {
	case NODE_ABSENT:
	case NODE_FREE:
	case NODE_DAMAGED:
		CHECK(node->hold_count == 0);
		CHECK(node->fill == NODE_NO_FILL);
		break;
	case NODE_BUSY:
		CHECK(node->fill != NODE_NO_FILL);
		break;
	case NODE_HELD:
		CHECK(node->hold_count >= 1);
		CHECK(node->fill == NODE_NO_FILL);
		break;
	case NODE_STATE_COUNT_:
		CHECK(false);
		break;
	}
}

static enum wire_node_state wire_state(enum node_state state)
{
	switch (state) {
	case NODE_ABSENT:
	case NODE_STATE_COUNT_:
		break;
	case NODE_BUSY:
		return WIRE_NODE_BUSY;
	case NODE_HELD:
	case NODE_FREE:
		return WIRE_NODE_READY;
	case NODE_DAMAGED:
		return WIRE_NODE_DAMAGED;
	}
	return WIRE_NODE_ABSENT;
}

/*
 * Writes the word with release: whoever reads READY also sees the verified bytes, which the worker
 * that verified them has handed to this thread.  Pairs with the acquire load of a word in
 * libclient/client.c.
 *
 * A word that leaves READY must be seen before what is written to the place next.  The fence keeps
 * those later writes, ours and the kernel's (whose submission is a store of ours), behind it.
 * Pairs with the acquire fence after the bytes were read in ooc_still_valid().
 */
static void node_set_state(struct node *node, _Atomic uint64_t *word, enum node_state to)
{
	enum wire_node_state wire_from = wire_state(node->state);

	CHECK(node_edge_allowed(node->state, to));
	node->state = to;
	node_check(node);
	/* HELD and FREE are the same to clients: their grants say what is theirs. */
	if (wire_state(to) == wire_from)
		return;
	atomic_store_explicit(
		word,
		wire_word(wire_state(to), node->place.segment, node->place.page, node->fill_count),
		memory_order_release);
	atomic_thread_fence(memory_order_seq_cst);
}

void node_init(struct node *node, uint32_t payload_bytes)
{
	*node = (struct node){
		.page_count = (payload_bytes + WIRE_PAGE_BYTES - 1u) / WIRE_PAGE_BYTES,
		.fill = NODE_NO_FILL,
		.state = NODE_ABSENT,
	};
	list_init(&node->link);
}

void node_begin_fill(struct node *node, _Atomic uint64_t *word, struct place place, uint32_t fill)
{
	CHECK(node->state == NODE_ABSENT);
	CHECK(fill != NODE_NO_FILL);
	node->place = place;
	node->fill = fill;
	/* 34 bits in a word: at 1,000 fills a second of one node, half a year. */
	node->fill_count++;
	node_set_state(node, word, NODE_BUSY);
}

void node_change_fill(struct node *node, uint32_t fill)
{
	CHECK(node->state == NODE_BUSY);
	CHECK(fill != NODE_NO_FILL);
	node->fill = fill;
	node_check(node);
}

void node_end_fill(struct node *node, _Atomic uint64_t *word)
{
	CHECK(node->state == NODE_BUSY);
	node->fill = NODE_NO_FILL;
	node_set_state(node, word, node->hold_count > 0 ? NODE_HELD : NODE_FREE);
}

void node_fail_fill(struct node *node, _Atomic uint64_t *word, bool damaged)
{
	CHECK(node->state == NODE_BUSY);
	CHECK(node->hold_count == 0);
	node->fill = NODE_NO_FILL;
	node_set_state(node, word, damaged ? NODE_DAMAGED : NODE_ABSENT);
}

void node_hold(struct node *node, _Atomic uint64_t *word)
{
	CHECK(node->state == NODE_BUSY || node->state == NODE_HELD || node->state == NODE_FREE);
	CHECK(node->hold_count < UINT32_MAX);
	node->hold_count++;
	if (node->state == NODE_FREE)
		node_set_state(node, word, NODE_HELD);
}

void node_release(struct node *node, _Atomic uint64_t *word)
{
	CHECK(node->state == NODE_BUSY || node->state == NODE_HELD);
	CHECK(node->hold_count > 0);
	node->hold_count--;
	if (node->state == NODE_HELD && node->hold_count == 0)
		node_set_state(node, word, NODE_FREE);
}

void node_evict(struct node *node, _Atomic uint64_t *word)
{
	CHECK(node->state == NODE_FREE);
	CHECK(node->hold_count == 0);
	node_set_state(node, word, NODE_ABSENT);
}
