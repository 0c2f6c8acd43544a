/* SPDX-License-Identifier: MIT */
/*
 * Goal: selections leave nothing out, keep the budget, and come in the order that select.h says.
 * Method: random HS (points in an adaptive octree) against brute force over leaves and cells.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "formats/base/random.h"
#include "libclient/select/select.h"
#include "tests/helper.h"

static struct random dice;

/* ---- a hierarchy of points ---- */

#define ROOT_SIZE 64.0
#define ROOT_MIN  (-32.0)

struct tree {
	struct store_superblock superblock;
	struct store_node *nodes;
	double (*points)[3];   /* sorted by leaf */
	uint32_t *first_point; /* a node, and one */
	double poke;           /* how far tight boxes reach beyond the points */
	bool is_short;         /* nodes with one child have no record */
};

static int point_compare(const void *a, const void *b)
{
	const double *p = a;
	const double *q = b;
	uint32_t cell_p[3];
	uint32_t cell_q[3];
	uint64_t morton_p = 0;
	uint64_t morton_q = 0;

	for (int k = 0; k < 3; k++) {
		cell_p[k] = (uint32_t)((p[k] - ROOT_MIN) / ROOT_SIZE * 65536.0);
		cell_q[k] = (uint32_t)((q[k] - ROOT_MIN) / ROOT_SIZE * 65536.0);
	}
	for (unsigned bit = 16; bit-- > 0;)
		for (unsigned k = 3; k-- > 0;) {
			morton_p = morton_p << 1 | (cell_p[k] >> bit & 1);
			morton_q = morton_q << 1 | (cell_q[k] >> bit & 1);
		}
	return morton_p < morton_q ? -1 : morton_p > morton_q;
}

static unsigned octant_of(const struct store_node *node, const double point[3])
{
	double edge = ldexp(ROOT_SIZE, -node->level);
	unsigned octant = 0;

	for (unsigned k = 0; k < 3; k++)
		if (point[k] >= ROOT_MIN + (node->cell[k] + 0.5) * edge)
			octant |= 1u << k;
	return octant;
}

static void tight_box(struct tree *tree, uint32_t index, uint32_t begin, uint32_t end)
{
	struct store_node *node = &tree->nodes[index];

	for (int k = 0; k < 3; k++) {
		double low = INFINITY;
		double high = -INFINITY;

		for (uint32_t i = begin; i < end; i++) {
			low = fmin(low, tree->points[i][k]);
			high = fmax(high, tree->points[i][k]);
		}
		node->box_min[k] = nextafterf((float)(low - tree->poke), -INFINITY);
		node->box_max[k] = nextafterf((float)(high + tree->poke), INFINITY);
	}
}

/* Goes down while all points are in one octant. */
static void node_sink(const struct tree *tree, struct store_node *node, uint32_t begin,
		      uint32_t end)
{
	while (node->level < 12) {
		unsigned octant = octant_of(node, tree->points[begin]);

		for (uint32_t i = begin; i < end; i++)
			if (octant_of(node, tree->points[i]) != octant)
				return;
		node->level++;
		for (unsigned k = 0; k < 3; k++)
			node->cell[k] = 2 * node->cell[k] + (octant >> k & 1);
	}
}

/* Divides until a leaf has at most leaf_points; records breadth first.  Takes the points. */
static void tree_make(struct tree *tree, double (*points)[3], uint32_t point_count,
		      uint32_t leaf_points, double poke, bool is_short)
{
	uint32_t *end = malloc((8 * (size_t)point_count + 8) * sizeof(*end));
	uint32_t node_count = 1;

	*tree = (struct tree){ .points = points, .poke = poke, .is_short = is_short };
	tree->nodes = calloc(8 * (size_t)point_count + 8, sizeof(*tree->nodes));
	tree->first_point = calloc(8 * (size_t)point_count + 9, sizeof(*tree->first_point));
	assert_true(end && tree->nodes && tree->first_point);
	qsort(points, point_count, sizeof(*points), point_compare);
	tree->nodes[0].parent = STORE_NODE_NONE;
	end[0] = point_count;
	for (uint32_t i = 0; i < node_count; i++) {
		struct store_node *node = &tree->nodes[i];
		uint32_t begin = tree->first_point[i];

		tight_box(tree, i, begin, end[i]);
		node->first_child = STORE_NODE_NONE;
		if (end[i] - begin <= leaf_points || node->level == 12) {
			node->triangle_count = end[i] - begin;
			node->payload_id = i + 1;
			node->kind = STORE_KIND_TRIANGLES;
			tree->superblock.leaf_count++;
			continue;
		}
		node->first_child = node_count;
		for (unsigned octant = 0; octant < 8; octant++) {
			struct store_node *child = &tree->nodes[node_count];
			uint32_t from = begin;

			while (begin < end[i] && octant_of(node, points[begin]) == octant)
				begin++;
			if (begin == from)
				continue;
			child->parent = i;
			child->level = (uint8_t)(node->level + 1);
			for (unsigned k = 0; k < 3; k++)
				child->cell[k] = 2 * node->cell[k] + (octant >> k & 1);
			if (tree->is_short && begin - from > leaf_points)
				node_sink(tree, child, from, begin);
			tree->first_point[node_count] = from;
			end[node_count++] = begin;
			node->child_count++;
		}
	}
	/* Leaves in ascending order of records do not own ascending points; keep the ends too. */
	for (uint32_t i = 0; i < node_count; i++)
		tree->nodes[i].vertex_count = end[i] - tree->first_point[i];
	tree->superblock.node_count = node_count;
	tree->superblock.triangle_count = point_count;
	tree->superblock.step_exponent = -10;
	tree->superblock.root_size = ROOT_SIZE;
	for (int k = 0; k < 3; k++)
		tree->superblock.root_min[k] = ROOT_MIN;
	free(end);
}

static void tree_done(struct tree *tree)
{
	free(tree->nodes);
	free(tree->points);
	free(tree->first_point);
}

/* Points on the walls and floors of rooms, and in a lump. */
static void tree_random(struct tree *tree, uint64_t seed, uint32_t point_count,
			uint32_t leaf_points, double poke)
{
	double(*points)[3] = malloc(point_count * sizeof(*points));

	assert_non_null(points);
	dice.state = seed;
	for (uint32_t i = 0; i < point_count; i++) {
		unsigned wall = (unsigned)(4.0 * random_unit(&dice));

		for (unsigned k = 0; k < 3; k++) {
			double low = wall == 3 ? 5.0 : -20.0;
			double size = wall == 3 ? 2.0 : 40.0;

			points[i][k] = low + size * random_unit(&dice);
			if (k == wall)
				points[i][k] = -20.0 + 10.0 * floor(5.0 * random_unit(&dice));
		}
	}
	tree_make(tree, points, point_count, leaf_points, poke, false);
}

static struct camera_view random_view(const struct tree *tree, double reach)
{
	struct camera camera = { .up = { 0, 0, 1 },
				 .fov_y_degrees = 20.0 + 80.0 * random_unit(&dice) };
	struct camera_view view;

	for (int k = 0; k < 3; k++) {
		camera.eye[k] = reach * (2.0 * random_unit(&dice) - 1.0);
		camera.at[k] = camera.eye[k] + random_unit(&dice) - 0.5;
	}
	assert_int_equal(camera_view_init(&view, &camera, &tree->superblock, 1.3, 0.05), 0);
	return view;
}

static double plane_distance(const struct camera_view *view, int plane, const double point[3])
{
	const double *p = view->planes[plane];

	return p[0] * point[0] + p[1] * point[1] + p[2] * point[2] + p[3];
}

static bool point_in_view(const struct camera_view *view, const double point[3])
{
	for (int i = 0; i < 5; i++)
		if (plane_distance(view, i, point) < 0.0)
			return false;
	return true;
}

/* Is all of the box beyond one of the planes, by more than `margin`? */
static bool box_out_of_view(const struct camera_view *view, const struct store_node *node,
			    double margin)
{
	for (int i = 0; i < 5; i++) {
		double largest = -INFINITY;

		for (unsigned corner = 0; corner < 8; corner++) {
			double at[3];

			for (unsigned k = 0; k < 3; k++)
				at[k] = corner >> k & 1 ? node->box_max[k] : node->box_min[k];
			largest = fmax(largest, plane_distance(view, i, at));
		}
		if (largest < -margin)
			return true;
	}
	return false;
}

static bool is_leaf(const struct tree *tree, uint32_t node)
{
	return tree->nodes[node].first_child == STORE_NODE_NONE;
}

/* Marks what a selection has; checks that nothing is in it twice, and its sums. */
static bool *selection_marks(const struct tree *tree, const struct selection *selection)
{
	bool *marks = calloc(tree->superblock.node_count, sizeof(*marks));
	uint64_t triangle_count = 0;

	assert_non_null(marks);
	for (size_t i = 0; i < selection->entry_count; i++) {
		uint32_t node = selection->entries[i].node;

		assert_true(node < tree->superblock.node_count && is_leaf(tree, node));
		assert_false(marks[node]);
		marks[node] = true;
		triangle_count += tree->nodes[node].triangle_count;
		assert_true(selection->entries[i].importance > 0.0f);
		if (i > 0)
			assert_true(selection->entries[i].importance <
				    selection->entries[i - 1].importance);
	}
	assert_int_equal(triangle_count, selection->triangle_count);
	return marks;
}

static double box_distance2(const struct camera_view *view, const struct store_node *node)
{
	double sum = 0.0;

	for (int k = 0; k < 3; k++) {
		double outside =
			fmax(node->box_min[k] - view->eye[k], view->eye[k] - node->box_max[k]);

		if (outside > 0.0)
			sum += outside * outside;
	}
	return sum;
}

static void select_in_order(struct selector *selector, const struct camera_view *view,
			    enum select_order order, uint64_t budget_triangles,
			    struct selection *ret)
{
	struct select_options options = { order, budget_triangles };

	select_approximate(selector, view, &options, ret);
}

/* ---- the tests ---- */

static void select_frustum_leaves_nothing_out_that_covers_a_pixel(void **state)
{
	(void)state;
	for (uint64_t seed = 1; seed <= 6; seed++) {
		struct selector *selector;
		struct tree tree;

		tree_random(&tree, seed, 4000, 10, 0.0);
		assert_int_equal(selector_create(&tree.superblock, tree.nodes, &selector), 0);
		for (int i = 0; i < 60; i++) {
			struct camera_view view = random_view(&tree, 50.0);
			struct selection selection;
			bool *marks;

			select_frustum(selector, &view, &selection);
			marks = selection_marks(&tree, &selection);
			assert_false(selection.budget_reached);
			for (uint32_t n = 0; n < tree.superblock.node_count; n++) {
				if (!is_leaf(&tree, n))
					continue;
				/* Something of it is in view: it must be there. */
				for (uint32_t p = 0; p < tree.nodes[n].vertex_count; p++)
					if (point_in_view(&view,
							  tree.points[tree.first_point[n] + p]))
						assert_true(marks[n]);
				/* Its box is clearly out of view: it must not. */
				if (box_out_of_view(&view, &tree.nodes[n], 1e-3))
					assert_false(marks[n]);
				else if (!box_out_of_view(&view, &tree.nodes[n], 0.0))
					assert_true(marks[n]);
			}
			free(marks);
		}
		selector_destroy(selector);
		tree_done(&tree);
	}
}

static void select_frustum_gives_the_nearest_first(void **state)
{
	struct selector *selector;
	struct tree tree;

	(void)state;
	tree_random(&tree, 3, 4000, 10, 0.0);
	assert_int_equal(selector_create(&tree.superblock, tree.nodes, &selector), 0);
	for (int i = 0; i < 20; i++) {
		struct camera_view view = random_view(&tree, 40.0);
		struct selection selection;
		double before = 0.0;

		select_frustum(selector, &view, &selection);
		for (size_t k = 0; k < selection.entry_count; k++) {
			double distance2 =
				box_distance2(&view, &tree.nodes[selection.entries[k].node]);

			assert_true(distance2 >= before - 1e-3);
			before = fmax(before, distance2);
		}
	}
	selector_destroy(selector);
	tree_done(&tree);
}

/* Each in turn, but AUTO: that may choose another for another budget. */
static enum select_order order_of(int number)
{
	return (enum select_order)((unsigned)number % SELECT_ORDER_AUTO);
}

static void every_order_without_budget_selects_what_the_frustum_holds(void **state)
{
	(void)state;
	for (uint64_t seed = 1; seed <= 6; seed++) {
		struct selector *selector;
		struct tree tree;

		/* Half of them with boxes that reach far out of their cells. */
		tree_random(&tree, seed, 3000, 10, seed % 2 == 0 ? 0.0 : 3.0);
		assert_int_equal(selector_create(&tree.superblock, tree.nodes, &selector), 0);
		for (int i = 0; i < 60; i++) {
			struct camera_view view = random_view(&tree, 60.0);
			struct selection selection;
			bool *of_frustum;
			bool *of_layers;

			select_frustum(selector, &view, &selection);
			of_frustum = selection_marks(&tree, &selection);
			select_in_order(selector, &view, order_of(i), 0, &selection);
			of_layers = selection_marks(&tree, &selection);
			assert_false(selection.budget_reached);
			assert_memory_equal(of_frustum, of_layers,
					    tree.superblock.node_count * sizeof(*of_layers));
			free(of_frustum);
			free(of_layers);
		}
		selector_destroy(selector);
		tree_done(&tree);
	}
}

static void every_order_with_a_budget_is_the_beginning_of_the_whole(void **state)
{
	struct selection_entry *whole;
	struct selector *selector;
	struct tree tree;

	(void)state;
	tree_random(&tree, 8, 4000, 10, 1.0);
	assert_int_equal(selector_create(&tree.superblock, tree.nodes, &selector), 0);
	whole = malloc(tree.superblock.node_count * sizeof(*whole));
	assert_non_null(whole);
	for (int i = 0; i < 60; i++) {
		struct camera_view view = random_view(&tree, 50.0);
		uint64_t budget = 1 + (uint64_t)(4000.0 * random_unit(&dice) * random_unit(&dice));
		struct selection selection;
		uint64_t whole_triangles;
		size_t whole_count;

		select_in_order(selector, &view, order_of(i), 0, &selection);
		whole_count = selection.entry_count;
		whole_triangles = selection.triangle_count;
		memcpy(whole, selection.entries, whole_count * sizeof(*whole));

		select_in_order(selector, &view, order_of(i), budget, &selection);
		assert_memory_equal(whole, selection.entries,
				    selection.entry_count * sizeof(*whole));
		assert_int_equal(selection.budget_reached, selection.entry_count < whole_count);
		if (selection.budget_reached)
			assert_true(selection.triangle_count >= budget);
		else
			assert_int_equal(selection.triangle_count, whole_triangles);
		/* Spent on the last node, not before. */
		if (selection.entry_count > 1) {
			uint32_t last = selection.entries[selection.entry_count - 1].node;

			assert_true(selection.triangle_count - tree.nodes[last].triangle_count <
				    budget);
		}
		assert_true((selection.entry_count > 0) == (whole_count > 0));
	}
	free(whole);
	selector_destroy(selector);
	tree_done(&tree);
}

static void selections_are_the_same_every_time(void **state)
{
	struct selector *selectors[2];
	struct selection_entry *first;
	struct tree tree;

	(void)state;
	tree_random(&tree, 5, 4000, 10, 0.5);
	first = malloc(tree.superblock.node_count * sizeof(*first));
	assert_non_null(first);
	for (int i = 0; i < 2; i++)
		assert_int_equal(selector_create(&tree.superblock, tree.nodes, &selectors[i]), 0);
	for (int i = 0; i < 20; i++) {
		struct camera_view view = random_view(&tree, 40.0);
		struct selection selection;
		size_t count;

		select_in_order(selectors[0], &view, order_of(i), 2000, &selection);
		count = selection.entry_count;
		memcpy(first, selection.entries, count * sizeof(*first));
		/* Other calls between leave no trace. */
		select_frustum(selectors[0], &view, &selection);
		for (int k = 0; k < 2; k++) {
			select_in_order(selectors[k], &view, order_of(i), 2000, &selection);
			assert_int_equal(selection.entry_count, count);
			assert_memory_equal(first, selection.entries, count * sizeof(*first));
		}
	}
	for (int i = 0; i < 2; i++)
		selector_destroy(selectors[i]);
	free(first);
	tree_done(&tree);
}

/* ---- layers against brute force: cells as boxes, neighbours by looking at all pairs ---- */

struct cell {
	double low[3], high[3];
	uint32_t leaf; /* or STORE_NODE_NONE */
};

static size_t cells_make(const struct tree *tree, struct cell *cells)
{
	size_t count = 0;

	for (uint32_t i = 0; i < tree->superblock.node_count; i++) {
		const struct store_node *node = &tree->nodes[i];
		bool is_inner = !is_leaf(tree, i);

		for (unsigned octant = 0; octant < (is_inner ? 8 : 1); octant++) {
			struct cell *cell = &cells[count];
			double edge = ldexp(ROOT_SIZE, -node->level - is_inner);
			bool taken = false;

			for (unsigned k = 0; k < 3; k++) {
				uint32_t at = is_inner ? 2 * node->cell[k] + (octant >> k & 1)
						       : node->cell[k];

				cell->low[k] = ROOT_MIN + at * edge;
				cell->high[k] = cell->low[k] + edge;
			}
			cell->leaf = is_inner ? STORE_NODE_NONE : i;
			for (unsigned c = 0; is_inner && c < node->child_count; c++) {
				const struct store_node *child =
					&tree->nodes[node->first_child + c];

				taken |= ((child->cell[0] & 1) | (child->cell[1] & 1) << 1 |
					  (child->cell[2] & 1) << 2) == octant;
			}
			count += !taken;
		}
	}
	return count;
}

static bool cells_share_a_face(const struct cell *a, const struct cell *b)
{
	unsigned touching = 0;
	unsigned overlapping = 0;

	for (int k = 0; k < 3; k++) {
		touching += a->low[k] == b->high[k] || a->high[k] == b->low[k];
		overlapping += a->low[k] < b->high[k] && b->low[k] < a->high[k];
	}
	return touching == 1 && overlapping == 2;
}

/* Is all of the cell outside one of the four side planes? */
static bool cell_out_of_view(const struct camera_view *view, const struct cell *cell)
{
	for (int i = 0; i < 4; i++) {
		double largest = -INFINITY;

		for (unsigned corner = 0; corner < 8; corner++) {
			double at[3];

			for (unsigned k = 0; k < 3; k++)
				at[k] = corner >> k & 1 ? cell->high[k] : cell->low[k];
			largest = fmax(largest, plane_distance(view, i, at));
		}
		if (largest < -1e-4)
			return true;
	}
	return false;
}

static double cell_distance2(const struct camera_view *view, const struct cell *cell)
{
	double sum = 0.0;

	for (int k = 0; k < 3; k++) {
		double outside = fmax(cell->low[k] - view->eye[k], view->eye[k] - cell->high[k]);

		if (outside > 0.0)
			sum += outside * outside;
	}
	return sum;
}

/* The layer of each cell, -1 where the walk does not come. */
static void layers_make(const struct camera_view *view, const struct cell *cells, size_t cell_count,
			int *layers)
{
	double nearest = INFINITY;
	size_t first = 0;

	for (size_t i = 0; i < cell_count; i++) {
		double distance2 = cell_distance2(view, &cells[i]);

		layers[i] = -1;
		if (distance2 < nearest &&
		    (distance2 == 0.0 || !cell_out_of_view(view, &cells[i]))) {
			nearest = distance2;
			first = i;
		}
	}
	if (isinf(nearest))
		return;
	layers[first] = 0;
	for (int layer = 0;; layer++) {
		bool changed = false;

		for (size_t i = 0; i < cell_count; i++) {
			if (layers[i] != layer)
				continue;
			for (size_t k = 0; k < cell_count; k++) {
				if (layers[k] >= 0 || !cells_share_a_face(&cells[i], &cells[k]) ||
				    cell_out_of_view(view, &cells[k]))
					continue;
				layers[k] = layer + 1;
				changed = true;
			}
		}
		if (!changed)
			return;
	}
}

static void select_layers_walks_face_by_face_through_empty_cells(void **state)
{
	unsigned compared = 0;

	(void)state;
	for (uint64_t seed = 1; seed <= 4; seed++) {
		struct selector *selector;
		struct cell *cells;
		size_t cell_count;
		struct tree tree;
		int *layers;

		tree_random(&tree, seed, 400, 4, 0.0);
		assert_int_equal(selector_create(&tree.superblock, tree.nodes, &selector), 0);
		cells = malloc(9 * tree.superblock.node_count * sizeof(*cells));
		assert_non_null(cells);
		cell_count = cells_make(&tree, cells);
		layers = malloc(cell_count * sizeof(*layers));
		assert_non_null(layers);
		for (int i = 0; i < 12; i++) {
			struct camera_view view = random_view(&tree, i % 2 == 0 ? 20.0 : 60.0);
			int *layer_of = malloc(tree.superblock.node_count * sizeof(*layer_of));
			struct selection selection;
			int before = 0;

			assert_non_null(layer_of);
			layers_make(&view, cells, cell_count, layers);
			for (size_t k = 0; k < cell_count; k++)
				if (cells[k].leaf != STORE_NODE_NONE)
					layer_of[cells[k].leaf] = layers[k];
			select_in_order(selector, &view, SELECT_ORDER_LAYER, 0, &selection);
			for (size_t k = 0; k < selection.entry_count; k++) {
				int layer = layer_of[selection.entries[k].node];

				/* What the walk does not reach comes last. */
				if (layer < 0)
					layer = 1000000;
				assert_true(layer >= before);
				before = layer;
				compared++;
			}
			free(layer_of);
		}
		free(layers);
		free(cells);
		selector_destroy(selector);
		tree_done(&tree);
	}
	assert_true(compared > 500);
}

static void records_left_out_between_levels_change_nothing(void **state)
{
	(void)state;
	for (uint64_t seed = 1; seed <= 8; seed++) {
		struct selector *selectors[2];
		struct tree trees[2];

		for (int i = 0; i < 2; i++) {
			double(*points)[3] = malloc(600 * sizeof(*points));

			/* Lumps far apart: long chains. */
			assert_non_null(points);
			dice.state = seed;
			for (int p = 0; p < 600; p++)
				for (int k = 0; k < 3; k++)
					points[p][k] = -30.0 + 58.0 * (p % 5 * (k + 1) % 5) / 4.0 +
						       random_unit(&dice);
			tree_make(&trees[i], points, 600, 8, 0.25, i == 1);
			assert_int_equal(selector_create(&trees[i].superblock, trees[i].nodes,
							 &selectors[i]),
					 0);
		}
		assert_true(trees[1].superblock.node_count < trees[0].superblock.node_count);
		assert_int_equal(trees[1].superblock.leaf_count, trees[0].superblock.leaf_count);
		for (int i = 0; i < 20; i++) {
			struct camera_view view = random_view(&trees[0], 40.0);
			struct selection selections[2];

			for (int k = 0; k < 2; k++)
				select_in_order(selectors[k], &view, SELECT_ORDER_LAYER, 300,
						&selections[k]);
			assert_int_equal(selections[0].entry_count, selections[1].entry_count);
			for (size_t k = 0; k < selections[0].entry_count; k++)
				assert_int_equal(
					trees[0].first_point[selections[0].entries[k].node],
					trees[1].first_point[selections[1].entries[k].node]);
		}
		for (int i = 0; i < 2; i++) {
			selector_destroy(selectors[i]);
			tree_done(&trees[i]);
		}
	}
}

static struct camera_view view_of(const struct tree *tree, double eye_x, double eye_y, double eye_z,
				  double at_x, double at_y, double at_z)
{
	struct camera camera = { .eye = { eye_x, eye_y, eye_z },
				 .at = { at_x, at_y, at_z },
				 .up = { 0, 0, 1 },
				 .fov_y_degrees = 40.0 };
	struct camera_view view;

	assert_int_equal(camera_view_init(&view, &camera, &tree->superblock, 1.0, 0.01), 0);
	return view;
}

static void an_eye_in_a_wall_outside_or_turned_away_is_no_trouble(void **state)
{
	struct selector *selector;
	struct selection selection;
	struct camera_view view;
	struct tree tree;
	uint32_t leaf;

	(void)state;
	tree_random(&tree, 7, 4000, 10, 0.0);
	assert_int_equal(selector_create(&tree.superblock, tree.nodes, &selector), 0);

	/* In a wall: the eye's own leaf comes first. */
	view = view_of(&tree, tree.points[0][0], tree.points[0][1], tree.points[0][2], 0, 0, 0);
	select_in_order(selector, &view, SELECT_ORDER_LAYER, 1, &selection);
	leaf = select_find_leaf(selector, view.eye);
	assert_int_not_equal(leaf, STORE_NODE_NONE);
	assert_int_equal(selection.entry_count, 1);
	assert_int_equal(selection.entries[0].node, leaf);
	assert_true(selection.budget_reached);

	/* Far outside, everything in view: everything is selected, nearest cells first. */
	view = view_of(&tree, 0, -500, 0, 0, 0, 0);
	select_in_order(selector, &view, SELECT_ORDER_LAYER, 0, &selection);
	assert_int_equal(selection.entry_count, tree.superblock.leaf_count);
	assert_true(box_distance2(&view, &tree.nodes[selection.entries[0].node]) < 485.0 * 485.0);

	/* Turned away: nothing. */
	view = view_of(&tree, 0, -500, 0, 0, -501, 0);
	select_in_order(selector, &view, SELECT_ORDER_LAYER, 0, &selection);
	assert_int_equal(selection.entry_count, 0);
	assert_false(selection.budget_reached);
	select_frustum(selector, &view, &selection);
	assert_int_equal(selection.entry_count, 0);

	selector_destroy(selector);
	tree_done(&tree);
}

static void triangles_that_reach_into_view_are_selected_though_their_cell_is_not(void **state)
{
	double(*points)[3] = calloc(2, sizeof(*points));
	struct selector *selector;
	struct selection selection;
	struct camera_view view;
	struct tree tree;

	(void)state;
	assert_non_null(points);
	points[0][0] = points[0][1] = points[0][2] = -31.0;
	points[1][0] = points[1][1] = points[1][2] = 31.0;
	tree_make(&tree, points, 2, 1, 0.0, false);
	/* The second leaf lies behind the eye, but a triangle of it reaches far before it. */
	for (int k = 0; k < 3; k++)
		tree.nodes[2].box_min[k] = -30.0f;
	assert_int_equal(selector_create(&tree.superblock, tree.nodes, &selector), 0);
	view = view_of(&tree, 10, 10, 10, -20, -20, -20);
	select_in_order(selector, &view, SELECT_ORDER_LAYER, 0, &selection);
	assert_int_equal(selection.entry_count, 2);
	selector_destroy(selector);
	tree_done(&tree);
}

static void select_find_leaf_finds_the_leaf_of_every_point(void **state)
{
	static const double outside[3] = { 33.0, 0.0, 0.0 };
	static const double empty[3] = { 31.0, 31.0, 31.0 };
	struct selector *selector;
	struct tree tree;

	(void)state;
	tree_random(&tree, 9, 3000, 5, 0.0);
	assert_int_equal(selector_create(&tree.superblock, tree.nodes, &selector), 0);
	for (uint32_t i = 0; i < tree.superblock.node_count; i++)
		for (uint32_t p = 0; is_leaf(&tree, i) && p < tree.nodes[i].vertex_count; p++)
			assert_int_equal(
				select_find_leaf(selector, tree.points[tree.first_point[i] + p]),
				i);
	assert_int_equal(select_find_leaf(selector, outside), STORE_NODE_NONE);
	assert_int_equal(select_find_leaf(selector, empty), STORE_NODE_NONE);
	selector_destroy(selector);
	tree_done(&tree);
}

static void a_store_of_nothing_or_of_one_leaf_is_no_trouble(void **state)
{
	struct store_superblock superblock = { .step_exponent = -10 };
	struct store_node root = { .first_child = STORE_NODE_NONE, .parent = STORE_NODE_NONE };
	struct camera camera = { .at = { 0, 1, 0 }, .up = { 0, 0, 1 }, .fov_y_degrees = 60 };
	struct camera_view view;

	(void)state;
	assert_int_equal(camera_view_init(&view, &camera, &superblock, 1.0, 0.1), 0);
	for (uint64_t node_count = 0; node_count <= 2; node_count++) {
		struct selector *selector;
		struct selection selection;

		/* No record; a root without payload; a root that is the only leaf. */
		superblock.node_count = node_count > 0;
		if (node_count == 2) {
			root.payload_id = 1;
			root.triangle_count = 7;
			for (int k = 0; k < 3; k++)
				root.box_max[k] = 1.0f;
			superblock.root_size = 1.0;
		}
		assert_int_equal(selector_create(&superblock, &root, &selector), 0);
		select_frustum(selector, &view, &selection);
		assert_int_equal(selection.entry_count, node_count == 2);
		select_in_order(selector, &view, SELECT_ORDER_LAYER, 1, &selection);
		assert_int_equal(selection.entry_count, node_count == 2);
		assert_false(selection.budget_reached);
		selector_destroy(selector);
	}
	assert_null(selector_destroy(NULL));
}

static void a_model_moved_far_from_the_origin_gives_the_same_selection(void **state)
{
	struct selection_entry *first;
	struct selector *selector;
	struct tree tree;

	(void)state;
	tree_random(&tree, 11, 3000, 10, 0.5);
	first = malloc(tree.superblock.node_count * sizeof(*first));
	assert_non_null(first);
	for (int i = 0; i < 10; i++) {
		size_t count = 0;

		for (double shift = 0.0; shift < 2e7; shift = shift == 0.0 ? 1e3 : shift * 10.0) {
			struct camera camera = { .up = { 0, 0, 1 }, .fov_y_degrees = 60 };
			struct camera_view view;
			struct selection selection;

			dice.state = (uint64_t)i;
			for (int k = 0; k < 3; k++) {
				/* Eyes that a double holds exactly at any shift. */
				tree.superblock.origin[k] = shift;
				camera.eye[k] =
					shift + rint(4096 * (random_unit(&dice) - 0.5)) / 64;
				camera.at[k] = shift + rint(4096 * (random_unit(&dice) - 0.5)) / 64;
			}
			assert_int_equal(
				camera_view_init(&view, &camera, &tree.superblock, 1.0, 0.1), 0);
			assert_int_equal(selector_create(&tree.superblock, tree.nodes, &selector),
					 0);
			select_in_order(selector, &view, SELECT_ORDER_LAYER, 2000, &selection);
			if (shift == 0.0) {
				count = selection.entry_count;
				memcpy(first, selection.entries, count * sizeof(*first));
			}
			assert_int_equal(selection.entry_count, count);
			assert_memory_equal(first, selection.entries, count * sizeof(*first));
			selector_destroy(selector);
		}
	}
	free(first);
	tree_done(&tree);
}

int main(void)
{
	static const struct CMUnitTest tests[] = {
		cmocka_unit_test(select_frustum_leaves_nothing_out_that_covers_a_pixel),
		cmocka_unit_test(select_frustum_gives_the_nearest_first),
		cmocka_unit_test(every_order_without_budget_selects_what_the_frustum_holds),
		cmocka_unit_test(every_order_with_a_budget_is_the_beginning_of_the_whole),
		cmocka_unit_test(selections_are_the_same_every_time),
		cmocka_unit_test(select_layers_walks_face_by_face_through_empty_cells),
		cmocka_unit_test(records_left_out_between_levels_change_nothing),
		cmocka_unit_test(an_eye_in_a_wall_outside_or_turned_away_is_no_trouble),
		cmocka_unit_test(
			triangles_that_reach_into_view_are_selected_though_their_cell_is_not),
		cmocka_unit_test(select_find_leaf_finds_the_leaf_of_every_point),
		cmocka_unit_test(a_store_of_nothing_or_of_one_leaf_is_no_trouble),
		cmocka_unit_test(a_model_moved_far_from_the_origin_gives_the_same_selection),
	};

	return TEST_RUN(tests);
}
