/* SPDX-License-Identifier: MIT */
/*
 * The walk of prioritized-layered projection: a front of cells, of which the best is taken next and
 * gives way to its neighbours.
 */
#include <math.h>
#include <string.h>

#include "libclient/select/selector.h"

/* ---- where it begins ---- */

/* The cell in view that is nearest to the eye. */
struct nearest {
	uint32_t cell;
	double distance2;
};

static void find_nearest(const struct places *places, const struct view_planes *planes,
			 uint32_t place, struct nearest *nearest, uint64_t *nodes_visited)
{
	const struct cube *cube = &places->cubes[place];
	double distance2 = cube_distance2(planes, cube);
	unsigned eye_octant = 0;

	++*nodes_visited;
	if (distance2 >= nearest->distance2 || !cube_in_view(planes, cube))
		return;
	if (place_is_cell(places, place)) {
		nearest->cell = place;
		nearest->distance2 = distance2;
		return;
	}
	/* The eye's side first, so that most of the rest is farther than what was found. */
	for (unsigned i = 0; i < 3; i++)
		eye_octant |= planes->eye[i] >= cube->centre[i] ? 1u << i : 0;
	for (unsigned i = 0; i < 8; i++)
		find_nearest(places, planes, place_child(places, place, eye_octant ^ i), nearest,
			     nodes_visited);
}

/* Where the walk begins: the eye's cell, else the nearest one in view, else PLACE_NONE. */
static uint32_t first_cell(const struct places *places, const struct view_planes *planes,
			   uint64_t *nodes_visited)
{
	struct nearest nearest = { PLACE_NONE, INFINITY };
	uint32_t cell = places_find_cell(places, planes->eye);

	if (cell == PLACE_NONE && places->place_count > 0) {
		find_nearest(places, planes, 0, &nearest, nodes_visited);
		cell = nearest.cell;
	}
	return cell;
}

/* ---- the front ---- */

#define SLOT_NONE UINT32_MAX

/*
 * In the order of layers what arrives later never goes first, and the front is a queue: entries
 * begin .. end - 1.  In the others it is a heap, entries 0 .. end - 1.
 */
struct front {
	struct selector *selector;
	enum select_order order;
	uint32_t begin;
	uint32_t end;
	uint32_t arrivals;
};

/* The least depth first, then the oldest: no two keys are the same.  A depth is not negative. */
static uint64_t front_key(struct front *front, float depth)
{
	uint32_t bits;

	memcpy(&bits, &depth, sizeof(bits));
	return (uint64_t)bits << 32 | front->arrivals++;
}

static void heap_put(struct selector *selector, uint32_t slot, const struct front_entry *entry)
{
	selector->front[slot] = *entry;
	selector->front_slot[entry->cell] = slot;
}

/* Moves an entry from a slot towards the root until its parent is better. */
static void heap_rise(struct selector *selector, uint32_t slot, struct front_entry entry)
{
	while (slot > 0) {
		uint32_t above = (slot - 1) / 2;

		if (selector->front[above].key < entry.key)
			break;
		heap_put(selector, slot, &selector->front[above]);
		slot = above;
	}
	heap_put(selector, slot, &entry);
}

/* Moves an entry from the root down until its children are worse. */
static void heap_sink(struct selector *selector, uint32_t count, struct front_entry entry)
{
	uint32_t slot = 0;

	for (;;) {
		uint32_t below = 2 * slot + 1;

		if (below >= count)
			break;
		if (below + 1 < count &&
		    selector->front[below + 1].key < selector->front[below].key)
			below++;
		if (entry.key < selector->front[below].key)
			break;
		heap_put(selector, slot, &selector->front[below]);
		slot = below;
	}
	heap_put(selector, slot, &entry);
}

static void front_push(struct front *front, uint32_t cell, float depth)
{
	struct selector *selector = front->selector;
	struct front_entry entry = { .cell = cell };

	selector->enqueued[cell] = selector->call;
	if (front->order == SELECT_ORDER_LAYER) {
		selector->front[front->end++] = entry;
		return;
	}
	entry.key = front_key(front, depth);
	selector->depth[cell] = depth;
	heap_rise(selector, front->end++, entry);
}

/* A better way to a cell that waits was found. */
static void front_improve(struct front *front, uint32_t cell, float depth)
{
	struct selector *selector = front->selector;
	struct front_entry entry = { front_key(front, depth), cell };

	selector->depth[cell] = depth;
	heap_rise(selector, selector->front_slot[cell], entry);
}

static uint32_t front_pop(struct front *front)
{
	struct selector *selector = front->selector;
	uint32_t cell;

	if (front->order == SELECT_ORDER_LAYER)
		return selector->front[front->begin++].cell;
	cell = selector->front[0].cell;
	selector->front_slot[cell] = SLOT_NONE;
	front->end--;
	if (front->end > 0)
		heap_sink(selector, front->end, selector->front[front->end]);
	return cell;
}

/* ---- keys ---- */

/* Depth of what lies between the eye and the far side of a cell that is taken from the front. */
static float depth_behind(const struct front *front, const struct view_planes *planes,
			  uint32_t cell)
{
	const struct selector *selector = front->selector;
	const struct cube *cube = &selector->places.cubes[cell];
	struct hiding_direction along;
	double from_eye[3];

	switch (front->order) {
	case SELECT_ORDER_SOLIDITY:
		return selector->depth[cell] + hiding_mean_depth(&selector->hiding, cell);
	case SELECT_ORDER_EXTINCTION:
		for (unsigned k = 0; k < 3; k++)
			from_eye[k] = cube->centre[k] - planes->eye[k];
		hiding_direction_set(&along, from_eye);
		return selector->depth[cell] + hiding_depth(&selector->hiding, cell, &along);
	case SELECT_ORDER_LAYER:
	case SELECT_ORDER_TRANSMITTANCE:
	case SELECT_ORDER_COVERAGE:
	case SELECT_ORDER_DISTANCE:
	case SELECT_ORDER_AUTO:
	case SELECT_ORDER_COUNT_:
		break;
	}
	return 0.0f;
}

/*
 * Looks at the neighbours of a cell.  Orders that add depths up along the walk keep the least of all
 * ways to a cell, so that what a doorway shows is not judged by the wall beside it.
 */
static void neighbours_push(struct front *front, const struct view_planes *planes, uint32_t cell,
			    uint64_t *nodes_visited)
{
	struct selector *selector = front->selector;
	const struct places *places = &selector->places;
	bool is_sum =
		front->order == SELECT_ORDER_SOLIDITY || front->order == SELECT_ORDER_EXTINCTION;
	float behind = depth_behind(front, planes, cell);

	for (uint32_t i = places->first_adjacent[cell]; i < places->first_adjacent[cell + 1]; i++) {
		uint32_t neighbour = places->adjacent[i];
		float depth = behind;

		if (selector->enqueued[neighbour] == selector->call) {
			if (is_sum && selector->front_slot[neighbour] != SLOT_NONE &&
			    depth < selector->depth[neighbour])
				front_improve(front, neighbour, depth);
			continue;
		}
		/* In view or not, it is looked at once. */
		selector->enqueued[neighbour] = selector->call;
		selector->front_slot[neighbour] = SLOT_NONE;
		if (!cube_in_view(planes, &places->cubes[neighbour]))
			continue;
		if (front->order == SELECT_ORDER_TRANSMITTANCE)
			depth = hiding_along_ray(&selector->hiding, planes->eye, neighbour,
						 nodes_visited);
		front_push(front, neighbour, depth);
	}
}

bool select_walk(struct selector *selector, const struct view_planes *planes,
		 const struct select_options *options, struct selection *ret)
{
	struct front front = { .selector = selector, .order = options->order };
	uint32_t cell = first_cell(&selector->places, planes, &ret->nodes_visited);

	if (cell != PLACE_NONE)
		front_push(&front, cell, 0.0f);
	while (front.begin < front.end) {
		cell = front_pop(&front);
		ret->nodes_visited++;
		if (cell < selector->node_count && !bounds_are_empty(&selector->bounds[cell]) &&
		    bounds_side(planes, &selector->bounds[cell]) != SIDE_OUTSIDE) {
			/* The budget is judged here, so that it is known that something is left out. */
			if (ret->entry_count > 0 &&
			    ret->triangle_count >= options->budget_triangles) {
				ret->budget_reached = true;
				return false;
			}
			selection_add(selector, cell, ret);
		}
		neighbours_push(&front, planes, cell, &ret->nodes_visited);
	}
	return true;
}
