/* SPDX-License-Identifier: MIT */
#include "tools/build/hierarchy.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/store/payload.h"

/** A node that is still to be given its children: what of the leaves is below it. */
struct span {
	uint64_t begin;
	uint64_t end;
	double normal_sum[3];
	double projected[STORE_SOLIDITY_DIRECTIONS];
	double area;
};

struct maker {
	const struct grid *grid;
	const struct leaf *leaves;
	struct store_node *nodes;
	struct span *spans; /* per node */
	uint64_t node_count;
	uint64_t node_max;
};

static float float_above(double value)
{
	float rounded = (float)value;

	return (double)rounded < value ? nextafterf(rounded, INFINITY) : rounded;
}

/* Which of its parent's children a leaf is below, at a level. */
static uint32_t octant_at(const struct store_node *leaf, uint32_t level)
{
	uint32_t shift = leaf->level - level - 1;

	return (leaf->cell[0] >> shift & 1) | (leaf->cell[1] >> shift & 1) << 1 |
	       (leaf->cell[2] >> shift & 1) << 2;
}

static int add_node(struct maker *maker, uint64_t begin, uint64_t end, uint32_t *ret)
{
	if (maker->node_count == maker->node_max) {
		uint64_t node_max = u64_max(maker->node_max * 3 / 2, 64);
		struct store_node *nodes = reallocarray(maker->nodes, node_max, sizeof(*nodes));
		struct span *spans;

		if (!nodes)
			return -ENOMEM;
		maker->nodes = nodes;
		spans = reallocarray(maker->spans, node_max, sizeof(*spans));
		if (!spans)
			return -ENOMEM;
		maker->spans = spans;
		maker->node_max = node_max;
	}
	if (maker->node_count >= STORE_NODE_COUNT_MAX)
		return -EOVERFLOW;
	*ret = (uint32_t)maker->node_count++;
	maker->nodes[*ret] = (struct store_node){ .first_child = STORE_NODE_NONE };
	maker->spans[*ret] = (struct span){ .begin = begin, .end = end };
	return 0;
}

/* A node for some leaves: the leaf itself, or the least cell that holds them all. */
static int add_child(struct maker *maker, uint32_t parent, uint64_t begin, uint64_t end)
{
	const struct store_node *first = &maker->leaves[begin].record;
	const struct store_node *last = &maker->leaves[end - 1].record;
	struct store_node *node;
	uint32_t level;
	uint32_t index;
	int r = add_node(maker, begin, end, &index);

	if (r < 0)
		return r;
	node = &maker->nodes[index];
	if (end - begin == 1) {
		*node = *first;
	} else {
		level = (uint32_t)u64_min(first->level, last->level);
		while (level > 0 && (first->cell[0] >> (first->level - level) !=
					     last->cell[0] >> (last->level - level) ||
				     first->cell[1] >> (first->level - level) !=
					     last->cell[1] >> (last->level - level) ||
				     first->cell[2] >> (first->level - level) !=
					     last->cell[2] >> (last->level - level)))
			level--;
		node->level = (uint8_t)level;
		for (unsigned k = 0; k < 3; k++)
			node->cell[k] = first->cell[k] >> (first->level - level);
	}
	node->parent = parent;
	node->first_child = STORE_NODE_NONE;
	node->parent_error = INFINITY;
	maker->nodes[parent].child_count++;
	if (maker->nodes[parent].first_child == STORE_NODE_NONE)
		maker->nodes[parent].first_child = index;
	return 0;
}

static int add_children(struct maker *maker, uint32_t index)
{
	struct span span = maker->spans[index];
	uint32_t level = maker->nodes[index].level;
	uint64_t begin = span.begin;

	while (begin < span.end) {
		uint32_t octant = octant_at(&maker->leaves[begin].record, level);
		uint64_t end = begin + 1;
		int r;

		while (end < span.end && octant_at(&maker->leaves[end].record, level) == octant)
			end++;
		r = add_child(maker, index, begin, end);
		if (r < 0)
			return r;
		begin = end;
	}
	return 0;
}

/* ---- what inner nodes say of what is below them ---- */

static void begin_sums(struct maker *maker, uint32_t index)
{
	struct span *span = &maker->spans[index];
	const struct leaf *leaf = &maker->leaves[span->begin];

	if (maker->nodes[index].child_count > 0)
		return;
	memcpy(span->normal_sum, leaf->normal_sum, sizeof(span->normal_sum));
	memcpy(span->projected, leaf->projected, sizeof(span->projected));
	span->area = leaf->area;
}

static void add_sums(struct maker *maker, uint32_t parent_index, uint32_t child_index)
{
	struct store_node *parent = &maker->nodes[parent_index];
	const struct store_node *child = &maker->nodes[child_index];
	struct span *sum = &maker->spans[parent_index];
	const struct span *span = &maker->spans[child_index];
	bool first = child_index == parent->first_child;

	for (unsigned k = 0; k < 3; k++) {
		sum->normal_sum[k] += span->normal_sum[k];
		parent->box_min[k] =
			first ? child->box_min[k] : fminf(parent->box_min[k], child->box_min[k]);
		parent->box_max[k] =
			first ? child->box_max[k] : fmaxf(parent->box_max[k], child->box_max[k]);
	}
	for (unsigned d = 0; d < STORE_SOLIDITY_DIRECTIONS; d++)
		sum->projected[d] += span->projected[d];
	sum->area += span->area;
	parent->longest_edge = fmaxf(parent->longest_edge, child->longest_edge);
}

/* A sphere about the box's middle that holds the spheres of all children. */
static void enclose_children(struct maker *maker, struct store_node *node)
{
	double radius = 0;

	for (unsigned k = 0; k < 3; k++)
		node->sphere[k] =
			(float)((double)node->box_min[k] +
				((double)node->box_max[k] - (double)node->box_min[k]) / 2);
	for (uint32_t i = 0; i < node->child_count; i++) {
		const struct store_node *child = &maker->nodes[node->first_child + i];
		double squared = 0;

		for (unsigned k = 0; k < 3; k++) {
			double away = (double)child->sphere[k] - (double)node->sphere[k];

			squared += away * away;
		}
		radius = fmax(radius, sqrt(squared) + (double)child->sphere[3]);
	}
	node->sphere[3] = float_above(radius * (1 + 0x1p-40));
}

/* The fields that are ratios, from the sums. */
static void finish_node(const struct maker *maker, uint32_t index)
{
	struct store_node *node = &maker->nodes[index];
	const struct span *span = &maker->spans[index];
	double edge = ldexp(maker->grid->root_size, -(int)node->level);
	double largest = 0;
	float direction[3];

	node->area = (float)span->area;
	for (unsigned k = 0; k < 3; k++)
		largest = fmax(largest, fabs(span->normal_sum[k]));
	for (unsigned k = 0; k < 3; k++)
		direction[k] = (float)(largest > 0 ? span->normal_sum[k] / largest : 0);
	node->mean_normal[0] = 0;
	node->mean_normal[1] = 0;
	if (largest > 0)
		payload_encode_oct8(direction, node->mean_normal);
	for (unsigned d = 0; d < STORE_SOLIDITY_DIRECTIONS; d++)
		node->solidity[d] =
			(uint8_t)rint(255 * (1 - exp(-span->projected[d] / (edge * edge))));
}

static void sum_up(struct maker *maker)
{
	/* Children lie behind their parents: backwards, each is complete when its parent needs it. */
	for (uint64_t i = maker->node_count; i-- > 0;) {
		uint32_t index = (uint32_t)i;
		struct store_node *node = &maker->nodes[index];

		begin_sums(maker, index);
		if (node->child_count > 0) {
			for (uint32_t k = 0; k < node->child_count; k++)
				add_sums(maker, index, node->first_child + k);
			enclose_children(maker, node);
		}
		finish_node(maker, index);
	}
}

static int make_all(struct maker *maker, uint64_t leaf_count)
{
	uint32_t root;
	int r = add_node(maker, 0, leaf_count, &root);

	if (r < 0)
		return r;
	/* A model of one leaf is its root; else the root is the whole cube, whatever is in it. */
	if (leaf_count == 1 && maker->leaves[0].record.level == 0)
		maker->nodes[0] = maker->leaves[0].record;
	maker->nodes[0].parent = STORE_NODE_NONE;
	maker->nodes[0].first_child = STORE_NODE_NONE;
	maker->nodes[0].parent_error = INFINITY;
	if (leaf_count == 0)
		return 0;
	for (uint64_t i = 0; i < maker->node_count; i++) {
		/* Leaves have their kind already. */
		if (maker->nodes[i].kind != STORE_KIND_NONE)
			continue;
		r = add_children(maker, (uint32_t)i);
		if (r < 0)
			return r;
	}
	sum_up(maker);
	return 0;
}

int hierarchy_make(const struct grid *grid, const struct leaf *leaves, uint64_t leaf_count,
		   struct hierarchy *ret, struct why *why)
{
	struct maker maker = { .grid = grid, .leaves = leaves };
	int r = make_all(&maker, leaf_count);

	free(maker.spans);
	if (r < 0) {
		free(maker.nodes);
		return why_set(why, r, "no memory for the hierarchy of %llu leaves",
			       (unsigned long long)leaf_count);
	}
	*ret = (struct hierarchy){ .nodes = maker.nodes, .node_count = (uint32_t)maker.node_count };
	for (uint32_t i = 0; i < ret->node_count; i++)
		ret->level_max = (uint32_t)u64_max(ret->level_max, ret->nodes[i].level);
	return 0;
}

void hierarchy_done(struct hierarchy *hierarchy)
{
	free(hierarchy->nodes);
	*hierarchy = (struct hierarchy){ 0 };
}
