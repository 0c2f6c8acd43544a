/* SPDX-License-Identifier: MIT */
#include "libclient/select/select.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/check.h"
#include "libclient/select/coverage.h"
#include "libclient/select/selector.h"

/** Nodes that wait during a descent: the siblings of one node a level. */
#define TRAVERSAL_STACK_MAX (8 * (STORE_LEVEL_MAX + 1))
/** Nodes that show less of the picture come last, those with the fewest triangles first. */
#define SQUARES_MIN 1e-20

/* ---- names ---- */

static const char *const order_names[SELECT_ORDER_COUNT_] = {
	[SELECT_ORDER_LAYER] = "layer",
	[SELECT_ORDER_SOLIDITY] = "solidity",
	[SELECT_ORDER_EXTINCTION] = "extinction",
	[SELECT_ORDER_TRANSMITTANCE] = "transmittance",
	[SELECT_ORDER_COVERAGE] = "coverage",
	[SELECT_ORDER_DISTANCE] = "distance",
	[SELECT_ORDER_AUTO] = "auto",
};

const char *select_order_name(enum select_order order)
{
	return order_names[order];
}

int select_order_find(const char *name, enum select_order *ret)
{
	for (unsigned i = 0; i < SELECT_ORDER_COUNT_; i++) {
		if (strcmp(name, order_names[i]) == 0) {
			*ret = (enum select_order)i;
			return 0;
		}
	}
	return -EINVAL;
}

/* ---- selectors ---- */

/* calloc() for at least one element, so that an empty store has arrays too. */
static void *array_create(uint64_t count, size_t element_bytes)
{
	return calloc(count + 1, element_bytes);
}

int selector_create(const struct store_superblock *superblock, const struct store_node *nodes,
		    struct selector **ret)
{
	struct selector *selector = calloc(1, sizeof(*selector));
	uint64_t node_count = superblock->node_count;

	if (!selector)
		return -ENOMEM;
	CHECK(node_count <= STORE_NODE_COUNT_MAX);
	selector->nodes = nodes;
	selector->node_count = (uint32_t)node_count;
	if (places_init(&selector->places, superblock, nodes) < 0)
		goto err_destroy;
	selector->bounds = array_create(node_count, sizeof(*selector->bounds));
	selector->selected = array_create(node_count, sizeof(*selector->selected));
	selector->entries = array_create(node_count, sizeof(*selector->entries));
	selector->sort_keys = array_create(node_count, sizeof(*selector->sort_keys));
	selector->sort_spare = array_create(node_count, sizeof(*selector->sort_spare));
	selector->enqueued =
		array_create(selector->places.place_count, sizeof(*selector->enqueued));
	selector->front = array_create(selector->places.place_count, sizeof(*selector->front));
	selector->front_slot =
		array_create(selector->places.place_count, sizeof(*selector->front_slot));
	selector->depth = array_create(selector->places.place_count, sizeof(*selector->depth));
	if (!selector->bounds || !selector->selected || !selector->entries ||
	    !selector->sort_keys || !selector->sort_spare || !selector->enqueued ||
	    !selector->front || !selector->front_slot || !selector->depth)
		goto err_destroy;

	bounds_of_nodes(nodes, selector->node_count, selector->bounds);
	hiding_init(&selector->hiding, &selector->places, nodes, selector->node_count);
	*ret = selector;
	return 0;

err_destroy:
	selector_destroy(selector);
	return -ENOMEM;
}

struct selector *selector_destroy(struct selector *selector)
{
	if (!selector)
		return NULL;
	places_done(&selector->places);
	free(selector->bounds);
	free(selector->selected);
	free(selector->entries);
	free(selector->sort_keys);
	free(selector->sort_spare);
	free(selector->enqueued);
	free(selector->front);
	free(selector->front_slot);
	free(selector->depth);
	free(selector);
	return NULL;
}

/* ---- candidates by distance ---- */

/* A float that is not negative orders like its bits; equal values go by node. */
static uint64_t ordering_key(double value, uint32_t node)
{
	float rounded = (float)value;
	uint32_t bits;

	memcpy(&bits, &rounded, sizeof(bits));
	return (uint64_t)bits << 32 | node;
}

/*
 * Sorts by the distance, four passes of a byte.  The nodes arrive in ascending order for each parent
 * but not overall, so the low half is sorted as well as far as node numbers reach.
 */
static void sort_by_key(struct selector *selector, size_t count)
{
	for (unsigned shift = 0; shift < 64; shift += 8) {
		size_t begin[256] = { 0 };
		uint64_t *swap = selector->sort_keys;
		size_t sum = 0;

		if (shift < 32 && selector->node_count >> shift == 0)
			continue;
		for (size_t i = 0; i < count; i++)
			begin[selector->sort_keys[i] >> shift & 0xff]++;
		for (unsigned digit = 0; digit < 256; digit++) {
			size_t digit_count = begin[digit];

			begin[digit] = sum;
			sum += digit_count;
		}
		for (size_t i = 0; i < count; i++) {
			uint64_t key = selector->sort_keys[i];

			selector->sort_spare[begin[key >> shift & 0xff]++] = key;
		}
		selector->sort_keys = selector->sort_spare;
		selector->sort_spare = swap;
	}
}

/* Fills sort_keys with every drawn leaf in view that is not selected yet, nearest first. */
static size_t candidates_sorted(struct selector *selector, const struct view_planes *planes,
				uint64_t *nodes_visited)
{
	struct {
		uint32_t node;
		bool inside; /* nothing below needs a test */
	} stack[TRAVERSAL_STACK_MAX];
	unsigned depth = 0;
	size_t count = 0;

	if (selector->node_count > 0) {
		stack[depth].node = 0;
		stack[depth++].inside = false;
	}
	while (depth > 0) {
		uint32_t index = stack[--depth].node;
		bool inside = stack[depth].inside;
		const struct store_node *node = &selector->nodes[index];
		const struct bounds *bounds = &selector->bounds[index];

		++*nodes_visited;
		if (bounds_are_empty(bounds))
			continue;
		if (!inside) {
			enum side side = bounds_side(planes, bounds);

			if (side == SIDE_OUTSIDE)
				continue;
			inside = side == SIDE_INSIDE;
		}
		if (!node_is_leaf(node)) {
			CHECK(depth + node->child_count <= TRAVERSAL_STACK_MAX);
			for (unsigned i = 0; i < node->child_count; i++) {
				stack[depth].node = node->first_child + i;
				stack[depth++].inside = inside;
			}
		} else if (selector->selected[index] != selector->call) {
			selector->sort_keys[count++] =
				ordering_key(bounds_distance2(planes, bounds), index);
		}
	}
	sort_by_key(selector, count);
	return count;
}

/* ---- selections ---- */

void selection_begin(struct selector *selector, struct selection *ret)
{
	/* Marks of 2^32 calls ago would look like this call's. */
	if (++selector->call == 0) {
		memset(selector->enqueued, 0,
		       selector->places.place_count * sizeof(*selector->enqueued));
		memset(selector->selected, 0, selector->node_count * sizeof(*selector->selected));
		selector->call = 1;
	}
	*ret = (struct selection){ .entries = selector->entries };
}

/* Importance falls with the place alone, so that the sets of different viewers compare fairly. */
void selection_add(struct selector *selector, uint32_t node, struct selection *ret)
{
	struct selection_entry *entry = &selector->entries[ret->entry_count++];

	entry->node = node;
	entry->importance = 1.0f / (float)ret->entry_count;
	ret->triangle_count += selector->nodes[node].triangle_count;
	selector->selected[node] = selector->call;
}

/* Adds the candidates that lie sorted until the budget is spent. */
static void add_sorted(struct selector *selector, size_t count, uint64_t budget_triangles,
		       struct selection *ret)
{
	for (size_t i = 0; i < count; i++) {
		if (ret->entry_count > 0 && ret->triangle_count >= budget_triangles) {
			ret->budget_reached = true;
			return;
		}
		selection_add(selector, (uint32_t)selector->sort_keys[i], ret);
	}
}

void selection_add_candidates(struct selector *selector, const struct view_planes *planes,
			      uint64_t budget_triangles, struct selection *ret)
{
	size_t count = candidates_sorted(selector, planes, &ret->nodes_visited);

	add_sorted(selector, count, budget_triangles, ret);
}

/* Adds all candidates in the order of what a part of the picture costs with each of them. */
static void add_by_coverage(struct selector *selector, const struct camera_view *view,
			    const struct view_planes *planes, uint64_t budget_triangles,
			    struct selection *ret)
{
	size_t count = candidates_sorted(selector, planes, &ret->nodes_visited);
	struct coverage coverage;

	coverage_begin(&coverage, view);
	for (size_t i = 0; i < count; i++) {
		uint32_t node = (uint32_t)selector->sort_keys[i];
		float squares =
			coverage_add(&coverage, &selector->hiding, &selector->bounds[node], node);

		selector->sort_keys[i] = ordering_key(
			selector->nodes[node].triangle_count / fmax(squares, SQUARES_MIN), node);
	}
	sort_by_key(selector, count);
	add_sorted(selector, count, budget_triangles, ret);
}

void select_frustum(struct selector *selector, const struct camera_view *view,
		    struct selection *ret)
{
	struct view_planes planes;

	view_planes_set(&planes, view);
	selection_begin(selector, ret);
	selection_add_candidates(selector, &planes, UINT64_MAX, ret);
}

uint32_t select_find_leaf(const struct selector *selector, const double point[3])
{
	uint32_t cell = places_find_cell(&selector->places, point);

	return cell < selector->node_count ? cell : STORE_NODE_NONE;
}

/* The order for such a view, as measured (README.md). */
static enum select_order order_for(const struct selector *selector,
				   const struct select_options *options)
{
	if (options->order != SELECT_ORDER_AUTO)
		return options->order;
	/* A model that fits is drawn, nearest first: there is nothing to choose. */
	if (selector->places.superblock->triangle_count <= options->budget_triangles)
		return SELECT_ORDER_DISTANCE;
	return SELECT_ORDER_COVERAGE;
}

void select_approximate(struct selector *selector, const struct camera_view *view,
			const struct select_options *options, struct selection *ret)
{
	struct select_options decided = *options;
	struct view_planes planes;

	view_planes_set(&planes, view);
	if (decided.budget_triangles == 0)
		decided.budget_triangles = UINT64_MAX;
	decided.order = order_for(selector, &decided);
	selection_begin(selector, ret);
	if (decided.order == SELECT_ORDER_COVERAGE) {
		add_by_coverage(selector, view, &planes, decided.budget_triangles, ret);
		return;
	}
	if (decided.order != SELECT_ORDER_DISTANCE &&
	    !select_walk(selector, &planes, &decided, ret))
		return;
	/* Triangles reach out of their cells: into view from cells that the walk did not get to. */
	selection_add_candidates(selector, &planes, decided.budget_triangles, ret);
}
