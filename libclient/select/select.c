/* SPDX-License-Identifier: MIT */
#include "libclient/select/select.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/check.h"
#include "formats/store/layout.h"

/*
 * Cells.  The leaves and the empty octants of inner nodes together fill the root cell without gap or
 * overlap.  Empty octants have no record, so they are numbered behind the records: a cell below
 * node_count is a leaf, one above it is empty.  (Numbers of inner nodes are no cells.)
 */

/** Children of a node that has no record of its own to begin with: one a level, seven siblings. */
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

/** A cell is a cube; half is rounded up by what centre may be off. */
struct cell_cube {
	float centre[3];
	float half;
};

/** Planes and eye in the precision of the boxes. */
struct view_planes {
	double plane[PLANES][4];
	double abs_sum[PLANES]; /* |a| + |b| + |c|: reach of a cube of half size 1 */
	double eye[3];
};

struct selector {
	const struct store_superblock *superblock;
	const struct store_node *nodes;
	uint32_t node_count;
	uint32_t cell_count;

	struct bounds *bounds;    /* a node: its tight box; an inner one: of all leaves below */
	uint8_t *present;         /* a node: mask of the octants that have a record */
	uint32_t *first_empty;    /* a node: cell number of its first empty octant */
	struct cell_cube *cubes;  /* a cell */
	uint32_t *first_adjacent; /* a cell, and one: where its neighbours begin */
	uint32_t *adjacent;       /* cells that share a part of a face */

	/* Scratch of one call.  A cell or node is marked when its mark is the call's number. */
	uint32_t call;
	uint32_t *enqueued; /* a cell: it was in the front, or is out of view */
	uint32_t *selected; /* a node */
	uint32_t *front;    /* cells in the order of arrival: by layer, then by time */
	struct selection_entry *entries;
	uint64_t *sort_keys; /* distance in the high half, node in the low half */
	uint64_t *sort_spare;
};

/* ---- the tree ---- */

static bool node_is_leaf(const struct store_node *node)
{
	return node->first_child == STORE_NODE_NONE;
}

/* Does selecting it draw something?  A leaf without payload is air. */
static bool node_is_drawn(const struct store_node *node)
{
	return node_is_leaf(node) && node->payload_id != 0;
}

static bool is_cell(const struct selector *selector, uint32_t place)
{
	return place >= selector->node_count || node_is_leaf(&selector->nodes[place]);
}

static unsigned node_octant(const struct store_node *node)
{
	return (node->cell[0] & 1) | (node->cell[1] & 1) << 1 | (node->cell[2] & 1) << 2;
}

/* The node or empty cell in an octant of an inner node. */
static uint32_t child_in_octant(const struct selector *selector, uint32_t node, unsigned octant)
{
	unsigned below = (1u << octant) - 1;
	unsigned present = selector->present[node];

	if (present >> octant & 1)
		return selector->nodes[node].first_child +
		       (uint32_t)__builtin_popcount(present & below);
	return selector->first_empty[node] + (uint32_t)__builtin_popcount(~present & below);
}

/* ---- neighbours: both sides of every shared face are descended at the same time ---- */

/*
 * Called twice for each pair: first to count (adjacent is NULL), then to fill.  While filling,
 * first_adjacent[c + 1] is the end of what cell c has so far.
 */
static void pair_emit(struct selector *selector, uint32_t a, uint32_t b)
{
	if (selector->adjacent) {
		selector->adjacent[selector->first_adjacent[a + 1]] = b;
		selector->adjacent[selector->first_adjacent[b + 1]] = a;
	}
	selector->first_adjacent[a + 1]++;
	selector->first_adjacent[b + 1]++;
}

/* `low` and `high` share a face across `axis`, and one of them covers it. */
static void face_descend(struct selector *selector, uint32_t low, uint32_t high, unsigned axis)
{
	bool low_is_cell = is_cell(selector, low);
	bool high_is_cell = is_cell(selector, high);
	unsigned u = 1u << (axis + 1) % 3;
	unsigned v = 1u << (axis + 2) % 3;

	if (low_is_cell && high_is_cell) {
		pair_emit(selector, low, high);
		return;
	}
	for (unsigned i = 0; i < 4; i++) {
		unsigned quarter = (i & 1 ? u : 0) | (i & 2 ? v : 0);

		face_descend(selector,
			     low_is_cell ? low
					 : child_in_octant(selector, low, quarter | 1u << axis),
			     high_is_cell ? high : child_in_octant(selector, high, quarter), axis);
	}
}

/* All pairs of cells in the tree: those inside each node, across its three middle planes. */
static void pairs_emit_all(struct selector *selector)
{
	for (uint32_t node = 0; node < selector->node_count; node++) {
		if (is_cell(selector, node))
			continue;
		for (unsigned octant = 0; octant < 8; octant++)
			for (unsigned axis = 0; axis < 3; axis++)
				if (!(octant >> axis & 1))
					face_descend(selector,
						     child_in_octant(selector, node, octant),
						     child_in_octant(selector, node,
								     octant | 1u << axis),
						     axis);
	}
}

static int selector_connect(struct selector *selector)
{
	uint32_t *first = selector->first_adjacent;
	uint64_t sum = 0;

	pairs_emit_all(selector);
	for (uint32_t cell = 0; cell < selector->cell_count; cell++) {
		uint32_t count = first[cell + 1];

		/* Where the cell begins; filling moves it to where it ends, the next one's begin. */
		first[cell + 1] = (uint32_t)sum;
		sum += count;
		if (sum > UINT32_MAX)
			return -ENOMEM;
	}
	selector->adjacent = malloc((sum + 1) * sizeof(*selector->adjacent));
	if (!selector->adjacent)
		return -ENOMEM;
	pairs_emit_all(selector);
	return 0;
}

/* ---- boxes and cubes ---- */

static struct cell_cube cube_of(const struct store_superblock *superblock, unsigned level,
				const uint32_t coordinates[3])
{
	double edge = ldexp(superblock->root_size, -(int)level);
	double largest = 0.0;
	struct cell_cube cube;

	for (int i = 0; i < 3; i++) {
		double centre = superblock->root_min[i] + ((double)coordinates[i] + 0.5) * edge;

		cube.centre[i] = (float)centre;
		largest = fmax(largest, fabs(centre));
	}
	/* Rounded up by more than a float of the centre is off. */
	cube.half = (float)(0.5 * edge * (1.0 + 1e-6) + largest * 0x1p-23);
	return cube;
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

/* Numbers the empty octants; false when there are too many to number. */
static bool selector_number(struct selector *selector)
{
	uint64_t next = selector->node_count;

	for (uint32_t i = 1; i < selector->node_count; i++) {
		const struct store_node *node = &selector->nodes[i];

		CHECK(node->parent < i && node->level == selector->nodes[node->parent].level + 1);
		selector->present[node->parent] |= (uint8_t)(1u << node_octant(node));
	}
	for (uint32_t i = 0; i < selector->node_count; i++) {
		if (node_is_leaf(&selector->nodes[i]))
			continue;
		if (next > UINT32_MAX - 8)
			return false;
		selector->first_empty[i] = (uint32_t)next;
		next += 8u - (unsigned)__builtin_popcount(selector->present[i]);
	}
	selector->cell_count = (uint32_t)next;
	return true;
}

static void selector_place(struct selector *selector)
{
	for (uint32_t i = 0; i < selector->node_count; i++) {
		const struct store_node *node = &selector->nodes[i];
		uint32_t cell = selector->first_empty[i];

		if (node_is_leaf(node)) {
			selector->cubes[i] = cube_of(selector->superblock, node->level, node->cell);
			continue;
		}
		for (unsigned octant = 0; octant < 8; octant++) {
			uint32_t coordinates[3];

			if (selector->present[i] >> octant & 1)
				continue;
			for (unsigned k = 0; k < 3; k++)
				coordinates[k] = 2 * node->cell[k] + (octant >> k & 1);
			selector->cubes[cell++] =
				cube_of(selector->superblock, node->level + 1u, coordinates);
		}
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
	selector->superblock = superblock;
	selector->nodes = nodes;
	selector->node_count = (uint32_t)node_count;
	selector->bounds = array_create(node_count, sizeof(*selector->bounds));
	selector->present = array_create(node_count, sizeof(*selector->present));
	selector->first_empty = array_create(node_count, sizeof(*selector->first_empty));
	selector->selected = array_create(node_count, sizeof(*selector->selected));
	selector->entries = array_create(node_count, sizeof(*selector->entries));
	selector->sort_keys = array_create(node_count, sizeof(*selector->sort_keys));
	selector->sort_spare = array_create(node_count, sizeof(*selector->sort_spare));
	if (!selector->bounds || !selector->present || !selector->first_empty ||
	    !selector->selected || !selector->entries || !selector->sort_keys ||
	    !selector->sort_spare || !selector_number(selector))
		goto err_destroy;

	selector->cubes = array_create(selector->cell_count, sizeof(*selector->cubes));
	selector->first_adjacent =
		array_create(selector->cell_count, sizeof(*selector->first_adjacent));
	selector->enqueued = array_create(selector->cell_count, sizeof(*selector->enqueued));
	selector->front = array_create(selector->cell_count, sizeof(*selector->front));
	if (!selector->cubes || !selector->first_adjacent || !selector->enqueued ||
	    !selector->front || selector_connect(selector) < 0)
		goto err_destroy;

	selector_bound(selector);
	selector_place(selector);
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
	free(selector->bounds);
	free(selector->present);
	free(selector->first_empty);
	free(selector->cubes);
	free(selector->first_adjacent);
	free(selector->adjacent);
	free(selector->enqueued);
	free(selector->selected);
	free(selector->front);
	free(selector->entries);
	free(selector->sort_keys);
	free(selector->sort_spare);
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
static bool cube_in_view(const struct view_planes *planes, const struct cell_cube *cube)
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

static double cube_distance2(const struct view_planes *planes, const struct cell_cube *cube)
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
		memset(selector->enqueued, 0, selector->cell_count * sizeof(*selector->enqueued));
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

/* The node or empty cell that holds a point, or STORE_NODE_NONE outside of the root cell. */
static uint32_t find_cell(const struct selector *selector, const double point[3])
{
	const struct store_superblock *superblock = selector->superblock;
	double corner[3];
	double edge = superblock->root_size;
	uint32_t place = 0;

	if (selector->node_count == 0)
		return STORE_NODE_NONE;
	for (int i = 0; i < 3; i++) {
		corner[i] = superblock->root_min[i];
		if (!(point[i] >= corner[i] && point[i] < corner[i] + edge))
			return STORE_NODE_NONE;
	}
	while (!is_cell(selector, place)) {
		unsigned octant = 0;

		edge *= 0.5;
		for (unsigned i = 0; i < 3; i++) {
			if (point[i] < corner[i] + edge)
				continue;
			corner[i] += edge;
			octant |= 1u << i;
		}
		place = child_in_octant(selector, place, octant);
	}
	return place;
}

uint32_t select_find_leaf(const struct selector *selector, const double point[3])
{
	uint32_t cell = find_cell(selector, point);

	return cell < selector->node_count ? cell : STORE_NODE_NONE;
}

/* The cell in view that is nearest to the eye. */
struct nearest {
	uint32_t cell;
	double distance2;
};

static void find_nearest(struct selector *selector, const struct view_planes *planes,
			 uint32_t place, unsigned level, const uint32_t coordinates[3],
			 struct nearest *nearest, uint64_t *nodes_visited)
{
	struct cell_cube cube = cube_of(selector->superblock, level, coordinates);
	double distance2 = cube_distance2(planes, &cube);
	unsigned eye_octant = 0;

	++*nodes_visited;
	if (distance2 >= nearest->distance2 || !cube_in_view(planes, &cube))
		return;
	if (is_cell(selector, place)) {
		nearest->cell = place;
		nearest->distance2 = distance2;
		return;
	}
	/* The eye's side first, so that most of the rest is farther than what was found. */
	for (unsigned i = 0; i < 3; i++)
		eye_octant |= planes->eye[i] >= cube.centre[i] ? 1u << i : 0;
	for (unsigned i = 0; i < 8; i++) {
		unsigned octant = eye_octant ^ i;
		uint32_t below[3];

		for (unsigned k = 0; k < 3; k++)
			below[k] = 2 * coordinates[k] + (octant >> k & 1);
		find_nearest(selector, planes, child_in_octant(selector, place, octant), level + 1,
			     below, nearest, nodes_visited);
	}
}

/* Where the walk begins: the eye's cell, else the nearest one in view, else STORE_NODE_NONE. */
static uint32_t first_cell(struct selector *selector, const struct view_planes *planes,
			   uint64_t *nodes_visited)
{
	static const uint32_t root_coordinates[3] = { 0, 0, 0 };
	struct nearest nearest = { STORE_NODE_NONE, INFINITY };
	uint32_t cell = find_cell(selector, planes->eye);

	if (cell == STORE_NODE_NONE && selector->node_count > 0) {
		find_nearest(selector, planes, 0, 0, root_coordinates, &nearest, nodes_visited);
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
	struct view_planes planes;
	uint32_t front_begin = 0;
	uint32_t front_end = 0;
	uint32_t cell;

	if (budget_triangles == 0)
		budget_triangles = UINT64_MAX;
	view_planes_set(&planes, view);
	selection_begin(selector, ret);

	cell = first_cell(selector, &planes, &ret->nodes_visited);
	if (cell != STORE_NODE_NONE) {
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
		for (uint32_t i = selector->first_adjacent[cell];
		     i < selector->first_adjacent[cell + 1]; i++) {
			uint32_t neighbour = selector->adjacent[i];

			if (selector->enqueued[neighbour] == selector->call)
				continue;
			/* In view or not, it is looked at once. */
			selector->enqueued[neighbour] = selector->call;
			if (cube_in_view(&planes, &selector->cubes[neighbour]))
				selector->front[front_end++] = neighbour;
		}
	}
	/* Triangles reach out of their cells: into view from cells that the walk did not get to. */
	selection_add_candidates(selector, &planes, budget_triangles, ret);
}
