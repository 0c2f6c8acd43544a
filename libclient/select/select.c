/* SPDX-License-Identifier: MIT */
#include "libclient/select/select.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/check.h"
#include "libclient/select/places.h"

/** Nodes that wait during a descent: the siblings of one node a level. */
#define TRAVERSAL_STACK_MAX (8 * (STORE_LEVEL_MAX + 1))
#define SIDE_PLANES         4
#define PLANES              5
/*
 * The near plane is tested a little closer: a vertex that the float transform rounds to this side of
 * it is drawn.  (The side planes need no margin, for pixel centres lie half a pixel inside.)
 */
#define NEAR_SLACK 1e-3

/** A tight box as half sums and half differences, which is what a plane test needs. */
struct bounds {
	float centre[3];
	float half[3];
};

/** Planes and eye in the precision of the boxes. */
struct view_planes {
	double plane[PLANES][4];
	double abs_sum[PLANES]; /* |a| + |b| + |c|: reach of a cube of half size 1 */
	double eye[3];
};

struct selector {
	const struct store_node *nodes;
	uint32_t node_count;
	struct places places;  /* the first node_count of them are the nodes */
	struct bounds *bounds; /* a node: its tight box; an inner one: of all leaves below */

	/* Scratch of one call.  A place or node is marked when its mark is the call's number. */
	uint32_t call;
	uint32_t *enqueued; /* a place: it was in the front, or is out of view */
	uint32_t *selected; /* a node */
	uint32_t *front;    /* cells in the order of arrival: by layer, then by time */
	struct selection_entry *entries;
	uint64_t *sort_keys; /* distance in the high half, node in the low half */
	uint64_t *sort_spare;
};

/* ---- tight boxes ---- */

static bool node_is_leaf(const struct store_node *node)
{
	return node->first_child == STORE_NODE_NONE;
}

/* Does selecting it draw something?  A leaf without payload is air. */
static bool node_is_drawn(const struct store_node *node)
{
	return node_is_leaf(node) && node->payload_id != 0;
}

static void bounds_set(struct bounds *bounds, const float box_min[3], const float box_max[3])
{
	for (int i = 0; i < 3; i++) {
		double centre = 0.5 * ((double)box_min[i] + box_max[i]);
		double half = 0.5 * ((double)box_max[i] - box_min[i]);

		bounds->centre[i] = (float)centre;
		/* Again rounded up by what the centre lost. */
		bounds->half[i] = (float)(half * (1.0 + 0x1p-22) + fabs(centre) * 0x1p-23);
	}
}

static void bounds_join(struct bounds *bounds, const struct bounds *other)
{
	float box_min[3];
	float box_max[3];

	for (int i = 0; i < 3; i++) {
		box_min[i] = fminf(bounds->centre[i] - bounds->half[i],
				   other->centre[i] - other->half[i]);
		box_max[i] = fmaxf(bounds->centre[i] + bounds->half[i],
				   other->centre[i] + other->half[i]);
	}
	bounds_set(bounds, box_min, box_max);
}

/* A box of negative size is that of a node with nothing to draw below. */
static bool bounds_are_empty(const struct bounds *bounds)
{
	return bounds->half[0] < 0.0f;
}

/* Children have higher numbers than their parent, so from behind every child is done first. */
static void selector_bound(struct selector *selector)
{
	for (uint32_t i = 0; i < selector->node_count; i++)
		selector->bounds[i].half[0] = -1.0f;
	for (uint32_t i = selector->node_count; i-- > 0;) {
		const struct store_node *node = &selector->nodes[i];
		struct bounds *bounds = &selector->bounds[i];
		struct bounds *above;

		if (node_is_drawn(node))
			bounds_set(bounds, node->box_min, node->box_max);
		if (i == 0 || bounds_are_empty(bounds))
			continue;
		above = &selector->bounds[node->parent];
		if (bounds_are_empty(above))
			*above = *bounds;
		else
			bounds_join(above, bounds);
	}
}

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
	if (!selector->bounds || !selector->selected || !selector->entries ||
	    !selector->sort_keys || !selector->sort_spare || !selector->enqueued ||
	    !selector->front)
		goto err_destroy;

	selector_bound(selector);
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
	free(selector);
	return NULL;
}

/* ---- tests against the view ---- */

static void view_planes_set(struct view_planes *planes, const struct camera_view *view)
{
	memcpy(planes->plane, view->planes, sizeof(planes->plane));
	memcpy(planes->eye, view->eye, sizeof(planes->eye));
	planes->plane[PLANES - 1][3] += NEAR_SLACK * view->near;
	for (int i = 0; i < PLANES; i++)
		planes->abs_sum[i] = fabs(view->planes[i][0]) + fabs(view->planes[i][1]) +
				     fabs(view->planes[i][2]);
}

enum side {
	SIDE_OUTSIDE,
	SIDE_CROSSING,
	SIDE_INSIDE
};

static enum side bounds_side(const struct view_planes *planes, const struct bounds *bounds)
{
	enum side side = SIDE_INSIDE;

	for (int i = 0; i < PLANES; i++) {
		const double *p = planes->plane[i];
		double distance = p[0] * bounds->centre[0] + p[1] * bounds->centre[1] +
				  p[2] * bounds->centre[2] + p[3];
		double reach = fabs(p[0]) * bounds->half[0] + fabs(p[1]) * bounds->half[1] +
			       fabs(p[2]) * bounds->half[2];

		if (distance < -reach)
			return SIDE_OUTSIDE;
		if (distance < reach)
			side = SIDE_CROSSING;
	}
	return side;
}

/* The walk ignores the near plane: what it cuts off may still lead to what is seen. */
static bool cube_in_view(const struct view_planes *planes, const struct cube *cube)
{
	for (int i = 0; i < SIDE_PLANES; i++) {
		const double *p = planes->plane[i];

		if (p[0] * cube->centre[0] + p[1] * cube->centre[1] + p[2] * cube->centre[2] +
			    p[3] <
		    -cube->half * planes->abs_sum[i])
			return false;
	}
	return true;
}

static double bounds_distance2(const struct view_planes *planes, const struct bounds *bounds)
{
	double sum = 0.0;

	for (int i = 0; i < 3; i++) {
		double outside = fabs(planes->eye[i] - bounds->centre[i]) - bounds->half[i];

		if (outside > 0.0)
			sum += outside * outside;
	}
	return sum;
}

static double cube_distance2(const struct view_planes *planes, const struct cube *cube)
{
	struct bounds bounds = { { cube->centre[0], cube->centre[1], cube->centre[2] },
				 { cube->half, cube->half, cube->half } };

	return bounds_distance2(planes, &bounds);
}

/* ---- candidates by distance ---- */

/* A float that is not negative orders like its bits; equal distances go by node. */
static uint64_t distance_key(double distance2, uint32_t node)
{
	float rounded = (float)distance2;
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
				distance_key(bounds_distance2(planes, bounds), index);
		}
	}
	sort_by_key(selector, count);
	return count;
}

/* ---- selections ---- */

static void selection_begin(struct selector *selector, struct selection *ret)
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
static void selection_add(struct selector *selector, uint32_t node, struct selection *ret)
{
	struct selection_entry *entry = &selector->entries[ret->entry_count++];

	entry->node = node;
	entry->importance = 1.0f / (float)ret->entry_count;
	ret->triangle_count += selector->nodes[node].triangle_count;
	selector->selected[node] = selector->call;
}

/* Adds the candidates by distance until the budget is spent. */
static void selection_add_candidates(struct selector *selector, const struct view_planes *planes,
				     uint64_t budget_triangles, struct selection *ret)
{
	size_t count = candidates_sorted(selector, planes, &ret->nodes_visited);

	for (size_t i = 0; i < count; i++) {
		if (ret->entry_count > 0 && ret->triangle_count >= budget_triangles) {
			ret->budget_reached = true;
			return;
		}
		selection_add(selector, (uint32_t)selector->sort_keys[i], ret);
	}
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

/*
 * The keys of this order are layers, so the front is a queue: what is enqueued first has the least
 * layer, and among equals the oldest time stamp.
 */
void select_layers(struct selector *selector, const struct camera_view *view,
		   uint64_t budget_triangles, struct selection *ret)
{
	const struct places *places = &selector->places;
	struct view_planes planes;
	uint32_t front_begin = 0;
	uint32_t front_end = 0;
	uint32_t cell;

	if (budget_triangles == 0)
		budget_triangles = UINT64_MAX;
	view_planes_set(&planes, view);
	selection_begin(selector, ret);

	cell = first_cell(places, &planes, &ret->nodes_visited);
	if (cell != PLACE_NONE) {
		selector->enqueued[cell] = selector->call;
		selector->front[front_end++] = cell;
	}
	while (front_begin < front_end) {
		cell = selector->front[front_begin++];
		ret->nodes_visited++;
		if (cell < selector->node_count && !bounds_are_empty(&selector->bounds[cell]) &&
		    bounds_side(&planes, &selector->bounds[cell]) != SIDE_OUTSIDE) {
			/* The budget is judged here, so that it is known that something is left out. */
			if (ret->entry_count > 0 && ret->triangle_count >= budget_triangles) {
				ret->budget_reached = true;
				return;
			}
			selection_add(selector, cell, ret);
		}
		for (uint32_t i = places->first_adjacent[cell];
		     i < places->first_adjacent[cell + 1]; i++) {
			uint32_t neighbour = places->adjacent[i];

			if (selector->enqueued[neighbour] == selector->call)
				continue;
			/* In view or not, it is looked at once. */
			selector->enqueued[neighbour] = selector->call;
			if (cube_in_view(&planes, &places->cubes[neighbour]))
				selector->front[front_end++] = neighbour;
		}
	}
	/* Triangles reach out of their cells: into view from cells that the walk did not get to. */
	selection_add_candidates(selector, &planes, budget_triangles, ret);
}
