/* SPDX-License-Identifier: MIT */
#include "tools/build/leaf.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "tools/build/vertex_order.h"

#define NONE UINT32_MAX
/**
 * Runs by colour pay from here on: a run takes 16 bytes, a colour 4 of each of at least half as many
 * vertices as triangles; below, many short runs also spoil the vertex order.
 */
#define COLOUR_RUN_TRIANGLES 8
/** 1 and the golden ratio, over the length of (0, 1, golden ratio). */
#define SHORT 0.52573111211913359
#define LONG  0.85065080835203988

const double leaf_directions[STORE_SOLIDITY_DIRECTIONS][3] = {
	{ 0, SHORT, LONG },  { 0, -SHORT, LONG }, { SHORT, LONG, 0 },
	{ -SHORT, LONG, 0 }, { LONG, 0, SHORT },  { LONG, 0, -SHORT },
};

/* ---- memory ---- */

void leaf_maker_done(struct leaf_maker *maker)
{
	free(maker->keys);
	free(maker->keys_sorted);
	free(maker->triangles);
	free(maker->order);
	free(maker->indices);
	free(maker->indices_ordered);
	free(maker->corners);
	free(maker->runs_of);
	free(maker->places);
	free(maker->local);
	free(maker->scratch);
	free(maker->runs);
	free(maker->positions);
	free(maker->normals);
	free(maker->colours);
	free(maker->ordinals);
	maker->keys = NULL;
	maker->keys_sorted = NULL;
	maker->triangles = NULL;
	maker->order = NULL;
	maker->indices = NULL;
	maker->indices_ordered = NULL;
	maker->corners = NULL;
	maker->runs_of = NULL;
	maker->places = NULL;
	maker->local = NULL;
	maker->scratch = NULL;
	maker->runs = NULL;
	maker->positions = NULL;
	maker->normals = NULL;
	maker->colours = NULL;
	maker->ordinals = NULL;
	maker->triangle_max = 0;
	maker->local_max = 0;
}

uint64_t leaf_maker_bytes(uint32_t leaf_triangles, uint32_t patch_triangles)
{
	uint64_t a_triangle =
		2 * 8 + 2 * 4 + 6 * 4 + 6 * 4 + 9 * 8 + 19 * 4 + 16 + 3 * (16 + 4 + 4) + 8;

	return a_triangle * leaf_triangles + UINT64_C(12) * patch_triangles;
}

static int maker_reserve(struct leaf_maker *maker, uint32_t triangle_count)
{
	size_t max = triangle_count;

	if (maker->patch->vertex_count > maker->local_max) {
		free(maker->local);
		maker->local_max = 0;
		maker->local = malloc(maker->patch->vertex_count * sizeof(uint32_t));
		if (!maker->local)
			return -ENOMEM;
		maker->local_max = maker->patch->vertex_count;
		memset(maker->local, 0xff, maker->local_max * sizeof(uint32_t));
	}
	if (triangle_count <= maker->triangle_max)
		return 0;
	leaf_maker_done(maker);
	maker->keys = malloc(max * sizeof(uint64_t));
	maker->keys_sorted = malloc(max * sizeof(uint64_t));
	maker->triangles = malloc(max * sizeof(uint32_t));
	maker->order = malloc(max * sizeof(uint32_t));
	maker->indices = malloc(max * 3 * sizeof(uint32_t));
	maker->indices_ordered = malloc(max * 3 * sizeof(uint32_t));
	maker->corners = malloc(max * 3 * sizeof(uint32_t));
	maker->runs_of = malloc(max * 3 * sizeof(uint32_t));
	maker->places = malloc(max * 9 * sizeof(double));
	maker->scratch =
		malloc(vertex_order_scratch(triangle_count, triangle_count * 3) * sizeof(uint32_t));
	maker->runs = malloc(max * sizeof(*maker->runs));
	maker->positions = malloc(max * 3 * 16);
	maker->normals = malloc(max * 3 * 4);
	maker->colours = malloc(max * 3 * sizeof(uint32_t));
	maker->ordinals = malloc(max * sizeof(uint64_t));
	if (!maker->keys || !maker->keys_sorted || !maker->triangles || !maker->order ||
	    !maker->indices || !maker->indices_ordered || !maker->corners || !maker->runs_of ||
	    !maker->places || !maker->scratch || !maker->runs || !maker->positions ||
	    !maker->normals || !maker->colours || !maker->ordinals) {
		leaf_maker_done(maker);
		return -ENOMEM;
	}
	maker->triangle_max = triangle_count;
	return maker_reserve(maker, triangle_count);
}

/* ---- runs ---- */

/*
 * Sorts keys by their upper half, a byte at a time; bytes that are all the same cost nothing.  Equal
 * ones keep their order.  Returns: which of the two arrays has the result.
 */
static uint64_t *sort_by_upper_half(uint64_t *keys, uint64_t *spare, uint32_t count)
{
	uint64_t *from = keys;
	uint64_t *to = spare;

	for (unsigned shift = 32; shift < 64; shift += 8) {
		uint32_t counts[256] = { 0 };
		uint32_t begin = 0;
		uint64_t *swapped;

		for (uint32_t i = 0; i < count; i++)
			counts[from[i] >> shift & 255]++;
		if (counts[from[0] >> shift & 255] == count)
			continue;
		for (unsigned i = 0; i < 256; i++) {
			uint32_t here = counts[i];

			counts[i] = begin;
			begin += here;
		}
		for (uint32_t i = 0; i < count; i++)
			to[counts[from[i] >> shift & 255]++] = from[i];
		swapped = from;
		from = to;
		to = swapped;
	}
	return from;
}

/* Orders maker->triangles by a key of each, part or colour. */
static void order_by(struct leaf_maker *maker, uint32_t count,
		     uint32_t (*key_of)(const struct leaf_maker *maker, uint32_t triangle))
{
	const uint64_t *sorted = maker->keys;
	uint32_t before = 0;
	bool ascending = true;

	for (uint32_t i = 0; i < count; i++) {
		uint32_t key = key_of(maker, maker->triangles[i]);

		ascending = ascending && key >= before;
		before = key;
		maker->keys[i] = (uint64_t)key << 32 | maker->triangles[i];
	}
	/* Most leaves need no sorting: they are of one part, or of one file after the other. */
	if (ascending)
		return;
	sorted = sort_by_upper_half(maker->keys, maker->keys_sorted, count);
	for (uint32_t i = 0; i < count; i++)
		maker->triangles[i] = (uint32_t)sorted[i];
}

static uint32_t part_of(const struct leaf_maker *maker, uint32_t triangle)
{
	return patch_part(maker->patch, triangle);
}

static uint32_t colour_of(const struct leaf_maker *maker, uint32_t triangle)
{
	return patch_record(maker->patch, triangle)[maker->shape->colours_at];
}

/* Has each triangle one colour? */
static bool colours_are_flat(const struct leaf_maker *maker, const struct octree_leaf *from)
{
	if (maker->shape->colours_at == 0)
		return false;
	for (uint32_t i = 0; i < from->triangle_count; i++) {
		const uint32_t *colours =
			patch_record(maker->patch, from->triangles[i]) + maker->shape->colours_at;

		if (colours[0] != colours[1] || colours[0] != colours[2])
			return false;
	}
	return true;
}

/* A run for each part, or for each colour of each part.  Returns: how many. */
static uint32_t cut_runs(struct leaf_maker *maker, uint32_t triangle_count, bool by_colour)
{
	const struct store_part *parts = maker->labels->parts;
	uint32_t run_count = 0;

	for (uint32_t i = 0; i < triangle_count; i++) {
		uint32_t part = part_of(maker, maker->triangles[i]);
		uint32_t colour =
			by_colour ? colour_of(maker, maker->triangles[i]) : parts[part].colour;

		if (run_count == 0 || maker->runs[run_count - 1].part != part ||
		    maker->runs[run_count - 1].colour != colour)
			maker->runs[run_count++] = (struct payload_run){
				.part = part,
				.section = parts[part].section,
				.first_triangle = i,
				.colour = colour,
			};
	}
	return run_count;
}

/*
 * Triangles in the order of their parts, and the runs.  Models often give each vertex a colour where
 * each object has one: runs by colour then say the same in a fifth of the bytes.
 */
static uint32_t make_runs(struct leaf_maker *maker, const struct octree_leaf *from)
{
	uint32_t count = from->triangle_count;
	bool by_colour = colours_are_flat(maker, from);
	uint32_t run_count;

	for (;;) {
		memcpy(maker->triangles, from->triangles, count * sizeof(*maker->triangles));
		if (by_colour)
			order_by(maker, count, colour_of);
		order_by(maker, count, part_of);
		run_count = cut_runs(maker, count, by_colour);
		if (!by_colour || run_count <= count / COLOUR_RUN_TRIANGLES)
			return run_count;
		by_colour = false;
	}
}

static uint32_t run_end(const struct leaf_maker *maker, uint32_t run, uint32_t run_count,
			uint32_t triangle_count)
{
	return run + 1 < run_count ? maker->runs[run + 1].first_triangle : triangle_count;
}

/* ---- vertices ---- */

/*
 * Gives the vertices their numbers in the order of first use, and takes each run's triangles into an
 * order that suits a vertex cache.  Runs share no vertices, for a vertex has a part.
 */
static uint32_t make_indices(struct leaf_maker *maker, uint32_t triangle_count, uint32_t run_count)
{
	const struct patch *patch = maker->patch;
	uint32_t vertex_count = 0;

	for (uint32_t run = 0; run < run_count; run++) {
		uint32_t begin = maker->runs[run].first_triangle;
		uint32_t end = run_end(maker, run, run_count, triangle_count);
		uint32_t first_vertex = vertex_count;
		uint32_t run_vertices = 0;

		for (uint32_t i = begin; i < end; i++) {
			for (uint32_t k = 0; k < 3; k++) {
				uint32_t vertex = patch->vertices[maker->triangles[i] * 3 + k];

				if (maker->local[vertex] == NONE)
					maker->local[vertex] = run_vertices++;
				maker->indices[3 * i + k] = maker->local[vertex];
			}
		}
		vertex_order(maker->indices + (size_t)3 * begin, end - begin, run_vertices,
			     maker->scratch, maker->order + begin);
		for (uint32_t i = begin; i < end; i++) {
			maker->order[i] = maker->triangles[begin + maker->order[i]];
			for (uint32_t k = 0; k < 3; k++)
				maker->local[patch->vertices[maker->order[i] * 3 + k]] = NONE;
		}
		for (uint32_t i = begin; i < end; i++) {
			for (uint32_t k = 0; k < 3; k++) {
				uint32_t corner = maker->order[i] * 3 + k;
				uint32_t *local = &maker->local[patch->vertices[corner]];

				if (*local == NONE) {
					maker->corners[vertex_count] = corner;
					maker->runs_of[vertex_count] = run;
					*local = vertex_count++;
				}
				maker->indices_ordered[3 * i + k] = *local;
			}
		}
		for (uint32_t i = first_vertex; i < vertex_count; i++)
			maker->local[patch->vertices[maker->corners[i]]] = NONE;
	}
	return vertex_count;
}

/** Where the positions of a leaf are, in grid_load()'s unit. */
struct extent_box {
	double low[3];
	double high[3];
};

/* Brings the positions together, and finds the box that they are in. */
static void find_places(const struct leaf_maker *maker, uint32_t vertex_count,
			struct extent_box *ret)
{
	for (unsigned k = 0; k < 3; k++) {
		ret->low[k] = INFINITY;
		ret->high[k] = -INFINITY;
	}
	for (uint32_t i = 0; i < vertex_count; i++) {
		double *at = maker->places + (size_t)3 * i;

		grid_load(maker->grid, patch_position(maker->patch, maker->corners[i]), at);
		for (unsigned k = 0; k < 3; k++) {
			ret->low[k] = at[k] < ret->low[k] ? at[k] : ret->low[k];
			ret->high[k] = at[k] > ret->high[k] ? at[k] : ret->high[k];
		}
	}
}

/* 16-bit offsets from the box's least corner, shifted by what all of them have in common. */
static bool write_small_positions(struct leaf_maker *maker, uint32_t vertex_count,
				  uint32_t run_count, const struct extent_box *box,
				  struct payload_content *content)
{
	uint16_t *to = (uint16_t *)(void *)maker->positions;
	uint32_t bits = 0;
	uint32_t largest = 0;
	int32_t low[3];
	unsigned shift;

	for (unsigned k = 0; k < 3; k++) {
		low[k] = (int32_t)box->low[k];
		largest |= (uint32_t)(box->high[k] - box->low[k]);
	}
	if (run_count > UINT16_MAX)
		return false;
	for (uint32_t i = 0; i < vertex_count * 3; i++)
		bits |= (uint32_t)((int32_t)maker->places[i] - low[i % 3]);
	shift = bits == 0 ? 0 : (unsigned)__builtin_ctz(bits);
	if (largest >> shift > UINT16_MAX)
		return false;
	for (uint32_t i = 0; i < vertex_count; i++, to += 4) {
		const double *at = maker->places + (size_t)3 * i;

		for (unsigned k = 0; k < 3; k++)
			to[k] = (uint16_t)((uint32_t)((int32_t)at[k] - low[k]) >> shift);
		to[3] = (uint16_t)maker->runs_of[i];
	}
	content->position_format = PAYLOAD_U16X3_RUN;
	content->scale = ldexp(maker->grid->step, (int)shift);
	for (unsigned k = 0; k < 3; k++)
		content->origin[k] = (double)low[k] * maker->grid->step;
	return true;
}

/* Is each position a float as it is? */
static bool all_floats(const struct leaf_maker *maker, uint32_t vertex_count)
{
	for (uint32_t i = 0; i < vertex_count * 3; i++)
		if ((double)(float)maker->places[i] != maker->places[i])
			return false;
	return true;
}

/*
 * Floats: of the lattice, offsets from the box's middle, which are exact; of exact positions, the
 * numbers themselves if they are floats, else offsets from the middle, rounded.
 */
static void write_float_positions(struct leaf_maker *maker, uint32_t vertex_count,
				  const struct extent_box *box, struct payload_content *content,
				  double *ret_moved)
{
	bool lattice = maker->grid->form == GRID_LATTICE;
	bool verbatim = !lattice && all_floats(maker, vertex_count);
	double middle[3] = { 0, 0, 0 };

	content->position_format = PAYLOAD_F32X3_RUN;
	content->scale = lattice ? maker->grid->step : 1.0;
	*ret_moved = 0;
	for (unsigned k = 0; k < 3 && !verbatim; k++) {
		middle[k] = box->low[k] + (box->high[k] - box->low[k]) / 2;
		if (lattice)
			middle[k] = floor(middle[k]);
		/* A float is near enough, and an offset from it loses the least. */
		else
			middle[k] = (double)(float)middle[k];
	}
	for (unsigned k = 0; k < 3; k++)
		content->origin[k] = grid_to_model(maker->grid, middle[k]);
	for (uint32_t i = 0; i < vertex_count; i++) {
		const double *at = maker->places + (size_t)3 * i;
		uint8_t *to = maker->positions + (size_t)16 * i;
		double moved = 0;

		for (unsigned k = 0; k < 3; k++) {
			/* Verbatim keeps the sign of a zero: nothing is subtracted. */
			double offset = verbatim ? at[k] : at[k] - middle[k];
			float value = (float)offset;

			memcpy(to + 4 * k, &value, sizeof(value));
			moved += ((double)value - offset) * ((double)value - offset);
		}
		memcpy(to + 12, &maker->runs_of[i], sizeof(uint32_t));
		*ret_moved = fmax(*ret_moved, sqrt(moved));
	}
	*ret_moved = lattice ? 0 : *ret_moved;
}

static void write_normals(struct leaf_maker *maker, uint32_t vertex_count,
			  struct payload_content *content)
{
	if (maker->mode == NORMALS_FLAT)
		return;
	content->normal_format = maker->mode == NORMALS_OCT8 ? PAYLOAD_OCT8 : PAYLOAD_OCT16;
	for (uint32_t i = 0; i < vertex_count; i++) {
		uint32_t code = maker->patch->normals[maker->corners[i]];

		if (maker->mode == NORMALS_OCT8)
			memcpy(maker->normals + (size_t)2 * i, &code, 2);
		else
			memcpy(maker->normals + (size_t)4 * i, &code, 4);
	}
	content->normals = maker->normals;
}

/* Vertex colours, unless all are those of their runs. */
static void write_colours(struct leaf_maker *maker, uint32_t vertex_count,
			  struct payload_content *content)
{
	const struct record_shape *shape = maker->shape;
	bool differ = false;

	if (shape->colours_at == 0)
		return;
	for (uint32_t i = 0; i < vertex_count; i++) {
		uint32_t corner = maker->corners[i];

		maker->colours[i] =
			patch_record(maker->patch, corner / 3)[shape->colours_at + corner % 3];
		differ |= maker->colours[i] != maker->runs[maker->runs_of[i]].colour;
	}
	if (differ)
		content->colours = maker->colours;
}

static void write_ordinals(struct leaf_maker *maker, uint32_t triangle_count,
			   struct payload_content *content)
{
	if (maker->shape->ordinal_at == 0)
		return;
	for (uint32_t i = 0; i < triangle_count; i++)
		maker->ordinals[i] =
			record_ordinal(maker->shape, patch_record(maker->patch, maker->order[i]));
	content->triangle_ids = maker->ordinals;
}

/* ---- record ---- */

static float float_below(double value)
{
	float rounded = (float)value;

	return (double)rounded > value ? nextafterf(rounded, -INFINITY) : rounded;
}

static float float_above(double value)
{
	return -float_below(-value);
}

/* What is summed over triangles: longest edge, area, mean normal, what is seen from each side. */
static void measure_triangles(const struct leaf_maker *maker, uint32_t triangle_count,
			      struct leaf *ret)
{
	double unit = grid_to_model(maker->grid, 1.0);
	double longest = 0;

	for (uint32_t i = 0; i < triangle_count; i++) {
		const uint32_t *indices = maker->indices_ordered + (size_t)3 * i;
		double e[3][3];
		double cross[3];

		for (unsigned a = 0; a < 3; a++) {
			const double *from = maker->places + (size_t)3 * indices[a];
			const double *to = maker->places + (size_t)3 * indices[(a + 1) % 3];
			double squared = 0;

			for (unsigned k = 0; k < 3; k++) {
				e[a][k] = to[k] - from[k];
				squared += e[a][k] * e[a][k];
			}
			longest = squared > longest ? squared : longest;
		}
		for (unsigned k = 0; k < 3; k++) {
			cross[k] = e[0][(k + 1) % 3] * e[1][(k + 2) % 3] -
				   e[0][(k + 2) % 3] * e[1][(k + 1) % 3];
			ret->normal_sum[k] += cross[k];
		}
		ret->area += sqrt(cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2]);
		for (unsigned d = 0; d < STORE_SOLIDITY_DIRECTIONS; d++)
			ret->projected[d] += fabs(cross[0] * leaf_directions[d][0] +
						  cross[1] * leaf_directions[d][1] +
						  cross[2] * leaf_directions[d][2]);
	}
	ret->record.longest_edge = float_above(sqrt(longest) * unit);
	/* A cross product is twice the triangle. */
	ret->area *= unit * unit / 2;
	for (unsigned k = 0; k < 3; k++)
		ret->normal_sum[k] *= unit * unit / 2;
	for (unsigned d = 0; d < STORE_SOLIDITY_DIRECTIONS; d++)
		ret->projected[d] *= unit * unit / 2;
}

static void measure_extent(const struct leaf_maker *maker, uint32_t vertex_count,
			   const struct extent_box *box, double margin, struct store_node *record)
{
	double middle[3];
	double radius_squared = 0;
	double slack = 0;

	for (unsigned k = 0; k < 3; k++) {
		record->box_min[k] = float_below(grid_to_model(maker->grid, box->low[k]) - margin);
		record->box_max[k] = float_above(grid_to_model(maker->grid, box->high[k]) + margin);
		middle[k] = box->low[k] + (box->high[k] - box->low[k]) / 2;
		record->sphere[k] = (float)grid_to_model(maker->grid, middle[k]);
		slack += fabs((double)record->sphere[k] - grid_to_model(maker->grid, middle[k]));
	}
	for (uint32_t i = 0; i < vertex_count; i++) {
		const double *at = maker->places + (size_t)3 * i;
		double squared = 0;

		for (unsigned k = 0; k < 3; k++)
			squared += (at[k] - middle[k]) * (at[k] - middle[k]);
		radius_squared = squared > radius_squared ? squared : radius_squared;
	}
	record->sphere[3] = float_above(
		grid_to_model(maker->grid, sqrt(radius_squared)) * (1 + 0x1p-40) + slack + margin);
}

/* Only one of several replicas counts: the one whose leaf holds the centre. */
static bool is_primary(const struct leaf_maker *maker, uint32_t triangle)
{
	return maker->layout == STORE_LAYOUT_UNIQUE ||
	       maker->patch->codes[triangle] - maker->cell_begin < maker->cell_length;
}

/* Triangles of the leaf with the same three points as an earlier one. */
static uint64_t count_duplicates(struct leaf_maker *maker, uint32_t triangle_count)
{
	const struct patch *patch = maker->patch;
	uint32_t *slots = maker->scratch; /* ten words a triangle: room enough */
	uint32_t slot_count = 16;
	uint64_t duplicate_count = 0;

	while (slot_count < triangle_count * 2)
		slot_count *= 2;
	memset(slots, 0xff, slot_count * sizeof(uint32_t));
	for (uint32_t i = 0; i < triangle_count; i++) {
		const uint32_t *points = patch->points + (size_t)maker->order[i] * 3;
		uint32_t low = (uint32_t)u64_min(points[0], u64_min(points[1], points[2]));
		uint32_t high = (uint32_t)u64_max(points[0], u64_max(points[1], points[2]));
		uint32_t middle = points[0] ^ points[1] ^ points[2] ^ low ^ high;
		uint64_t hash = (((uint64_t)low << 32 | high) * UINT64_C(0x9e3779b97f4a7c15)) ^
				(middle * UINT64_C(0xc2b2ae3d27d4eb4f));
		uint32_t slot = (uint32_t)(hash >> 40) & (slot_count - 1);

		if (!is_primary(maker, maker->order[i]))
			continue;
		for (; slots[slot] != NONE; slot = (slot + 1) & (slot_count - 1)) {
			const uint32_t *other = patch->points + (size_t)slots[slot] * 3;
			uint32_t other_low =
				(uint32_t)u64_min(other[0], u64_min(other[1], other[2]));
			uint32_t other_high =
				(uint32_t)u64_max(other[0], u64_max(other[1], other[2]));

			if (low == other_low && high == other_high &&
			    middle == (other[0] ^ other[1] ^ other[2] ^ low ^ high))
				break;
		}
		if (slots[slot] == NONE)
			slots[slot] = maker->order[i];
		else
			duplicate_count++;
	}
	return duplicate_count;
}

static void count_parts(struct leaf_maker *maker, uint32_t triangle_count, uint32_t run_count,
			struct leaf *ret)
{
	for (uint32_t run = 0; run < run_count; run++) {
		uint32_t end = run_end(maker, run, run_count, triangle_count);
		uint64_t count = 0;

		for (uint32_t i = maker->runs[run].first_triangle; i < end; i++)
			count += is_primary(maker, maker->order[i]);
		labels_count(maker->labels, maker->runs[run].part, count);
		ret->primary_count += count;
	}
}

int leaf_make(struct leaf_maker *maker, const struct octree_leaf *from,
	      struct payload_content *ret_content, struct leaf *ret, struct why *why)
{
	uint32_t triangle_count = from->triangle_count;
	struct payload_content content = { .kind = STORE_KIND_TRIANGLES,
					   .triangle_count = triangle_count };
	struct extent_box box;
	uint32_t run_count;
	uint32_t cell[3];
	uint32_t level;

	CHECK(triangle_count > 0);
	*ret = (struct leaf){ 0 };
	if (maker_reserve(maker, triangle_count) < 0)
		return why_set(why, -ENOMEM, "no memory for a leaf of %u triangles",
			       triangle_count);
	for (unsigned k = 0; k < 3; k++)
		cell[k] = from->cell[k] >> from->piece_levels;
	level = from->level - from->piece_levels;
	maker->cell_begin = grid_morton(cell) << 3 * (STORE_LEVEL_MAX - level);
	maker->cell_length = UINT64_C(1) << 3 * (STORE_LEVEL_MAX - level);
	run_count = make_runs(maker, from);
	content.vertex_count = make_indices(maker, triangle_count, run_count);
	content.run_count = run_count;
	content.runs = maker->runs;
	content.indices = maker->indices_ordered;
	content.positions = maker->positions;
	find_places(maker, content.vertex_count, &box);
	ret->small = maker->grid->form == GRID_LATTICE &&
		     write_small_positions(maker, content.vertex_count, run_count, &box, &content);
	if (!ret->small)
		write_float_positions(maker, content.vertex_count, &box, &content, &ret->moved_max);
	write_normals(maker, content.vertex_count, &content);
	write_colours(maker, content.vertex_count, &content);
	write_ordinals(maker, triangle_count, &content);

	ret->record.level = (uint8_t)from->level;
	memcpy(ret->record.cell, from->cell, sizeof(ret->record.cell));
	ret->record.kind = STORE_KIND_TRIANGLES;
	ret->record.triangle_count = triangle_count;
	ret->record.vertex_count = content.vertex_count;
	measure_extent(maker, content.vertex_count, &box, ret->moved_max, &ret->record);
	measure_triangles(maker, triangle_count, ret);
	count_parts(maker, triangle_count, run_count, ret);
	ret->duplicate_count = count_duplicates(maker, triangle_count);
	*ret_content = content;
	return 0;
}
