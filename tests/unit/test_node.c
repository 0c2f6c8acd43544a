/* SPDX-License-Identifier: MIT */
/* Goal: a node takes the edges of node.h's table and no other, and its word says what it is. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "daemon/cache/node.h"
#include "formats/base/bytes.h"
#include "tests/helper.h"

static const struct place test_place = { 3, 17 };

static _Atomic uint64_t word;

static void op_begin_fill(struct node *node)
{
	node_begin_fill(node, &word, test_place, 5);
}

static void op_end_fill(struct node *node)
{
	node_end_fill(node, &word);
}

static void op_fail_fill(struct node *node)
{
	node_fail_fill(node, &word, false);
}

static void op_damage(struct node *node)
{
	node_fail_fill(node, &word, true);
}

static void op_hold(struct node *node)
{
	node_hold(node, &word);
}

static void op_release(struct node *node)
{
	node_release(node, &word);
}

static void op_evict(struct node *node)
{
	node_evict(node, &word);
}

/* A state with its hold count tells apart all that an operation may depend on. */
struct position {
	enum node_state state;
	uint32_t hold_count;
};

static const struct position positions[] = {
	{ NODE_ABSENT, 0 }, { NODE_BUSY, 0 }, { NODE_BUSY, 1 }, { NODE_BUSY, 2 },
	{ NODE_HELD, 1 },   { NODE_HELD, 2 }, { NODE_FREE, 0 }, { NODE_DAMAGED, 0 },
};

static const struct edge {
	const char *name;
	void (*op)(struct node *node);
	struct position from;
	struct position to;
} edges[] = {
	{ "begin_fill", op_begin_fill, { NODE_ABSENT, 0 }, { NODE_BUSY, 0 } },
	{ "end_fill", op_end_fill, { NODE_BUSY, 0 }, { NODE_FREE, 0 } },
	{ "end_fill", op_end_fill, { NODE_BUSY, 1 }, { NODE_HELD, 1 } },
	{ "end_fill", op_end_fill, { NODE_BUSY, 2 }, { NODE_HELD, 2 } },
	{ "fail_fill", op_fail_fill, { NODE_BUSY, 0 }, { NODE_ABSENT, 0 } },
	{ "damage", op_damage, { NODE_BUSY, 0 }, { NODE_DAMAGED, 0 } },
	{ "hold", op_hold, { NODE_BUSY, 0 }, { NODE_BUSY, 1 } },
	{ "hold", op_hold, { NODE_BUSY, 1 }, { NODE_BUSY, 2 } },
	{ "hold", op_hold, { NODE_BUSY, 2 }, { NODE_BUSY, 3 } },
	{ "hold", op_hold, { NODE_FREE, 0 }, { NODE_HELD, 1 } },
	{ "hold", op_hold, { NODE_HELD, 1 }, { NODE_HELD, 2 } },
	{ "hold", op_hold, { NODE_HELD, 2 }, { NODE_HELD, 3 } },
	{ "release", op_release, { NODE_BUSY, 1 }, { NODE_BUSY, 0 } },
	{ "release", op_release, { NODE_BUSY, 2 }, { NODE_BUSY, 1 } },
	{ "release", op_release, { NODE_HELD, 1 }, { NODE_FREE, 0 } },
	{ "release", op_release, { NODE_HELD, 2 }, { NODE_HELD, 1 } },
	{ "evict", op_evict, { NODE_FREE, 0 }, { NODE_ABSENT, 0 } },
};

static void (*const operations[])(struct node *node) = {
	op_begin_fill, op_end_fill, op_fail_fill, op_damage, op_hold, op_release, op_evict,
};

static struct node node_at(struct position position)
{
	struct node node;

	node_init(&node, WIRE_PAGE_BYTES);
	word = 0;
	if (position.state == NODE_ABSENT)
		return node;
	op_begin_fill(&node);
	if (position.state == NODE_DAMAGED) {
		op_damage(&node);
		return node;
	}
	for (uint32_t i = 0; i < position.hold_count; i++)
		op_hold(&node);
	if (position.state != NODE_BUSY)
		op_end_fill(&node);
	return node;
}

/* expect_assert_failure() is a setjmp(): in a function of its own it cannot spoil a variable. */
static void assert_refused(void (*op)(struct node *node), struct node *node)
{
	expect_assert_failure(op(node));
}

static const struct edge *edge_find(void (*op)(struct node *node), struct position from)
{
	for (size_t i = 0; i < ARRAY_LENGTH(edges); i++)
		if (edges[i].op == op && edges[i].from.state == from.state &&
		    edges[i].from.hold_count == from.hold_count)
			return &edges[i];
	return NULL;
}

static void node_takes_each_edge_of_the_table_and_no_other(void **state)
{
	(void)state;
	for (size_t o = 0; o < ARRAY_LENGTH(operations); o++)
		for (size_t p = 0; p < ARRAY_LENGTH(positions); p++) {
			struct node node = node_at(positions[p]);
			const struct edge *edge = edge_find(operations[o], positions[p]);

			assert_int_equal(node.state, positions[p].state);
			if (!edge) {
				assert_refused(operations[o], &node);
				continue;
			}
			operations[o](&node);
			assert_int_equal(node.state, edge->to.state);
			assert_int_equal(node.hold_count, edge->to.hold_count);
			node_check(&node);
		}
}

static void node_word_says_to_clients_what_the_node_is(void **state)
{
	static const enum wire_node_state wire_states[] = {
		[NODE_ABSENT] = WIRE_NODE_ABSENT,   [NODE_BUSY] = WIRE_NODE_BUSY,
		[NODE_HELD] = WIRE_NODE_READY,      [NODE_FREE] = WIRE_NODE_READY,
		[NODE_DAMAGED] = WIRE_NODE_DAMAGED,
	};

	(void)state;
	for (size_t p = 0; p < ARRAY_LENGTH(positions); p++) {
		struct node node = node_at(positions[p]);

		assert_int_equal(wire_word_state(word), wire_states[node.state]);
		if (node.state == NODE_ABSENT)
			continue;
		assert_int_equal(wire_word_segment(word), test_place.segment);
		assert_int_equal(wire_word_page(word), test_place.page);
		assert_int_equal(wire_word_fill_count(word), 1);
	}
}

static void node_word_differs_for_each_filling(void **state)
{
	struct node node = node_at((struct position){ NODE_FREE, 0 });
	uint64_t before = word;

	(void)state;
	op_evict(&node);
	op_begin_fill(&node);
	op_end_fill(&node);
	assert_int_equal(wire_word_state(word), WIRE_NODE_READY);
	assert_true(word != before);
}

static void node_states_have_names(void **state)
{
	(void)state;
	assert_string_equal(node_state_name(NODE_ABSENT), "ABSENT");
	assert_string_equal(node_state_name(NODE_DAMAGED), "DAMAGED");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(node_takes_each_edge_of_the_table_and_no_other),
		cmocka_unit_test(node_word_says_to_clients_what_the_node_is),
		cmocka_unit_test(node_word_differs_for_each_filling),
		cmocka_unit_test(node_states_have_names),
	};

	return TEST_RUN(tests);
}
