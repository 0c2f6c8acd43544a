/* SPDX-License-Identifier: MIT */
#include "libclient/select/places.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/check.h"

static bool node_is_leaf(const struct store_node *node)
{
	return node->first_child == STORE_NODE_NONE;
}

/* ---- numbering ---- */

/* Room for all of them. */
static int places_allocate(struct places *places, const struct store_node *nodes)
{
	uint64_t node_count = places->superblock->node_count;
	uint64_t division_count = 0;
	uint64_t place_count;

	for (uint64_t i = 0; i < node_count; i++) {
		division_count += !node_is_leaf(&nodes[i]);
		/* And the cubes between a node and its parent. */
		if (i > 0)
			division_count += nodes[i].level - nodes[nodes[i].parent].level - 1u;
	}
	/* Each division has eight children; all places but the root are a child. */
	place_count = node_count == 0 ? 0 : 8 * division_count + 1;
	if (place_count >= UINT32_MAX)
		return -ENOMEM;
	places->place_count = (uint32_t)place_count;
	/* One more of each, so that an empty store has arrays too. */
	places->cubes = calloc(place_count + 1, sizeof(*places->cubes));
	places->division_of = calloc(place_count + 1, sizeof(*places->division_of));
	places->divisions = calloc(division_count + 1, sizeof(*places->divisions));
	places->first_adjacent = calloc(place_count + 1, sizeof(*places->first_adjacent));
	return places->cubes && places->division_of && places->divisions && places->first_adjacent
		       ? 0
		       : -ENOMEM;
}

static struct cube cube_at(const struct store_superblock *superblock, unsigned level,
			   const uint32_t coordinates[3])
{
	double edge = ldexp(superblock->root_size, -(int)level);
	double largest = 0.0;
	struct cube cube;

	for (int i = 0; i < 3; i++) {
		double centre = superblock->root_min[i] + ((double)coordinates[i] + 0.5) * edge;

		cube.centre[i] = (float)centre;
		largest = fmax(largest, fabs(centre));
	}
	cube.half = (float)(0.5 * edge * (1.0 + 1e-6) + largest * 0x1p-23);
	return cube;
}

static uint32_t place_divide(struct places *places, uint32_t place, unsigned level,
			     const uint32_t coordinates[3])
{
	uint32_t number = places->division_count++;
	struct division *division = &places->divisions[number];

	division->level = level;
	memcpy(division->coordinates, coordinates, sizeof(division->coordinates));
	for (unsigned octant = 0; octant < 8; octant++)
		division->children[octant] = PLACE_NONE;
	places->division_of[place] = number;
	return number;
}

/* Hangs a node below its parent, with the cubes between where it is more than a level below. */
static void node_attach(struct places *places, const struct store_node *nodes, uint32_t index,
			uint32_t *next_place)
{
	const struct store_node *node = &nodes[index];
	uint32_t number = places->division_of[node->parent];

	for (unsigned level = nodes[node->parent].level + 1u;; level++) {
		unsigned octant = 0;
		uint32_t at[3];
		uint32_t *child;

		for (unsigned k = 0; k < 3; k++) {
			at[k] = node->cell[k] >> (node->level - level);
			octant |= (at[k] & 1) << k;
		}
		child = &places->divisions[number].children[octant];
		CHECK(*child == PLACE_NONE && level <= node->level);
		if (level == node->level) {
			*child = index;
			return;
		}
		*child = (*next_place)++;
		places->cubes[*child] = cube_at(places->superblock, level, at);
		number = place_divide(places, *child, level, at);
	}
}

/* The octants that hold nothing are cells too. */
static void division_fill(struct places *places, struct division *division, uint32_t *next_place)
{
	for (unsigned octant = 0; octant < 8; octant++) {
		uint32_t place = *next_place;
		uint32_t at[3];

		if (division->children[octant] != PLACE_NONE)
			continue;
		for (unsigned k = 0; k < 3; k++)
			at[k] = 2 * division->coordinates[k] + (octant >> k & 1);
		division->children[octant] = place;
		places->cubes[place] = cube_at(places->superblock, division->level + 1, at);
		places->division_of[place] = PLACE_NONE;
		++*next_place;
	}
}

static void places_number(struct places *places, const struct store_node *nodes)
{
	uint32_t node_count = (uint32_t)places->superblock->node_count;
	uint32_t next_place = node_count;

	for (uint32_t i = 0; i < node_count; i++) {
		places->cubes[i] = cube_at(places->superblock, nodes[i].level, nodes[i].cell);
		places->division_of[i] = PLACE_NONE;
		if (!node_is_leaf(&nodes[i]))
			(void)place_divide(places, i, nodes[i].level, nodes[i].cell);
	}
	for (uint32_t i = 1; i < node_count; i++)
		node_attach(places, nodes, i, &next_place);
	for (uint32_t i = 0; i < places->division_count; i++)
		division_fill(places, &places->divisions[i], &next_place);
	CHECK(next_place == places->place_count);
}

/* ---- neighbours: both sides of every shared face are descended at the same time ---- */

/*
 * Called twice for each pair: first to count (adjacent is NULL), then to fill.  While filling,
 * first_adjacent[c + 1] is the end of what cell c has so far.
 */
static void pair_emit(struct places *places, uint32_t a, uint32_t b)
{
	if (places->adjacent) {
		places->adjacent[places->first_adjacent[a + 1]] = b;
		places->adjacent[places->first_adjacent[b + 1]] = a;
	}
	places->first_adjacent[a + 1]++;
	places->first_adjacent[b + 1]++;
}

/* `low` and `high` touch across `axis`, and a face of one of them covers that of the other. */
static void face_descend(struct places *places, uint32_t low, uint32_t high, unsigned axis)
{
	bool low_is_cell = place_is_cell(places, low);
	bool high_is_cell = place_is_cell(places, high);
	unsigned u = 1u << (axis + 1) % 3;
	unsigned v = 1u << (axis + 2) % 3;

	if (low_is_cell && high_is_cell) {
		pair_emit(places, low, high);
		return;
	}
	for (unsigned i = 0; i < 4; i++) {
		unsigned quarter = (i & 1 ? u : 0) | (i & 2 ? v : 0);
		uint32_t below = low;
		uint32_t above = high;

		if (!low_is_cell)
			below = place_child(places, low, quarter | 1u << axis);
		if (!high_is_cell)
			above = place_child(places, high, quarter);
		face_descend(places, below, above, axis);
	}
}

/* All pairs of cells: those that touch across one of the middle planes of a division. */
static void pairs_emit(struct places *places)
{
	for (uint32_t i = 0; i < places->division_count; i++) {
		const uint32_t *children = places->divisions[i].children;

		for (unsigned octant = 0; octant < 8; octant++)
			for (unsigned axis = 0; axis < 3; axis++)
				if (!(octant >> axis & 1))
					face_descend(places, children[octant],
						     children[octant | 1u << axis], axis);
	}
}

static int places_connect(struct places *places)
{
	uint32_t *first = places->first_adjacent;
	uint64_t sum = 0;

	pairs_emit(places);
	for (uint32_t place = 0; place < places->place_count; place++) {
		uint32_t count = first[place + 1];

		/* Where its list begins; filling moves it to the end, where the next one begins. */
		first[place + 1] = (uint32_t)sum;
		sum += count;
		if (sum > UINT32_MAX)
			return -ENOMEM;
	}
	places->adjacent = malloc((sum + 1) * sizeof(*places->adjacent));
	if (!places->adjacent)
		return -ENOMEM;
	pairs_emit(places);
	return 0;
}

int places_init(struct places *places, const struct store_superblock *superblock,
		const struct store_node *nodes)
{
	int r;

	*places = (struct places){ .superblock = superblock };
	r = places_allocate(places, nodes);
	if (r < 0)
		return r;
	places_number(places, nodes);
	return places_connect(places);
}

void places_done(struct places *places)
{
	free(places->cubes);
	free(places->division_of);
	free(places->divisions);
	free(places->first_adjacent);
	free(places->adjacent);
}

uint32_t places_find_cell(const struct places *places, const double point[3])
{
	double edge = places->superblock->root_size;
	double corner[3];
	uint32_t place = 0;

	if (places->place_count == 0)
		return PLACE_NONE;
	for (int i = 0; i < 3; i++) {
		corner[i] = places->superblock->root_min[i];
		if (!(point[i] >= corner[i] && point[i] < corner[i] + edge))
			return PLACE_NONE;
	}
	while (!place_is_cell(places, place)) {
		unsigned octant = 0;

		edge *= 0.5;
		for (unsigned i = 0; i < 3; i++) {
			if (point[i] < corner[i] + edge)
				continue;
			corner[i] += edge;
			octant |= 1u << i;
		}
		place = place_child(places, place, octant);
	}
	return place;
}
