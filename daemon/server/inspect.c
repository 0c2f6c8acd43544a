/* SPDX-License-Identifier: MIT */
#include "daemon/server/inspect.h"

#include "daemon/cache/replacement.h"
#include "formats/base/clock.h"

static uint16_t cached_of(enum node_state state)
{
	switch (state) {
	case NODE_ABSENT:
		return WIRE_CACHED_ABSENT;
	case NODE_BUSY:
		return WIRE_CACHED_BUSY;
	case NODE_HELD:
		return WIRE_CACHED_HELD;
	case NODE_FREE:
		return WIRE_CACHED_FREE;
	case NODE_DAMAGED:
		return WIRE_CACHED_DAMAGED;
	case NODE_STATE_COUNT_:
		break;
	}
	return WIRE_CACHED_ABSENT;
}

/* Its time is that of its coming where it is there, and of its going where it is not any more. */
static bool has_age(const struct node *node)
{
	return node_is_ready(node) || node->was_evicted;
}

/* As the cache compares it, and above 0, which says that it is in no order. */
static uint64_t order_of(const struct served *served, uint32_t index)
{
	if (served->nodes[index].state != NODE_FREE)
		return 0;
	return replacement_is_lru(served->replacement)
		       ? 1 + served->nodes[index].last_use
		       : replacement_worth(served->replacement, index);
}

uint32_t inspect_nodes(const struct served *served, uint32_t first, struct wire_node *ret)
{
	uint32_t now_ds = clock_now_ds();
	uint32_t count = 0;

	for (; count < WIRE_NODES_ENTRY_COUNT_MAX && first < served->node_count; first++) {
		const struct node *node = &served->nodes[first];

		ret[count++] = (struct wire_node){
			.order = order_of(served, first),
			.age_ds = has_age(node) ? now_ds - node->since_ds : WIRE_AGE_NEVER,
			.holds = node->hold_count,
			.payer = node->payer,
			.cached = cached_of(node->state),
			.flags =
				(uint16_t)((node->unused_prefetch ? WIRE_NODE_UNUSED_PREFETCH : 0) |
					   (node->residence != RESIDENCE_NONE ? WIRE_NODE_PINNED
									      : 0)),
		};
	}
	return count;
}
