/* SPDX-License-Identifier: MIT */
#include "tools/build/octree.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "tools/build/overlap.h"

/** A cell and the triangles in it: a part of octree.lists. */
struct octree_cell {
	uint32_t level;
	uint32_t cell[3];
	size_t first;
	uint32_t count;
	double spread;
};

void octree_done(struct octree *octree)
{
	free(octree->lists);
	free(octree->seen);
	free(octree->starts);
	free(octree->touched);
	free(octree->begins);
	free(octree->octants);
	octree->octants = NULL;
	octree->octant_max = 0;
	octree->starts = NULL;
	octree->touched = NULL;
	octree->begins = NULL;
	octree->start_max = 0;
	octree->lists = NULL;
	octree->list_max = 0;
	octree->seen = NULL;
	octree->seen_max = 0;
}

static int lists_reserve(struct octree *octree, size_t count)
{
	size_t list_max = u64_max(count, octree->list_max * 3 / 2);
	uint32_t *lists;

	if (count <= octree->list_max)
		return 0;
	lists = reallocarray(octree->lists, list_max, sizeof(*lists));
	if (!lists)
		return -ENOMEM;
	octree->lists = lists;
	octree->list_max = list_max;
	return 0;
}

/* Has the cell more vertices than a leaf may have? */
static bool has_many_vertices(struct octree *octree, const struct octree_cell *cell)
{
	const struct patch *patch = octree->patch;
	uint32_t count = 0;

	if (cell->count * UINT64_C(3) <= octree->leaf_vertices)
		return false;
	octree->cell_number++;
	for (uint32_t i = 0; i < cell->count; i++) {
		uint32_t corner = octree->lists[cell->first + i] * 3;

		for (unsigned k = 0; k < 3; k++) {
			uint32_t vertex = patch->vertices[corner + k];

			count += octree->seen[vertex] != octree->cell_number;
			octree->seen[vertex] = octree->cell_number;
		}
		if (count > octree->leaf_vertices)
			return true;
	}
	return false;
}

static int tell_leaf(struct octree *octree, const struct octree_cell *cell, struct why *why)
{
	struct octree_leaf leaf = {
		.level = cell->level,
		.cell = { cell->cell[0], cell->cell[1], cell->cell[2] },
		.triangles = octree->lists + cell->first,
		.triangle_count = cell->count,
	};

	return octree->leaf(octree->arg, &leaf, why);
}

/* The cell of a piece: the piece's number is its place on the Morton curve. */
static void piece_cell(const struct octree_cell *cell, uint32_t piece, struct octree_leaf *ret)
{
	ret->level = cell->level + GRID_PIECE_LEVELS;
	ret->piece_levels = GRID_PIECE_LEVELS;
	for (unsigned axis = 0; axis < 3; axis++) {
		ret->cell[axis] = cell->cell[axis] << GRID_PIECE_LEVELS;
		for (unsigned bit = 0; bit < GRID_PIECE_LEVELS; bit++)
			ret->cell[axis] |= (piece >> (3 * bit + axis) & 1) << bit;
	}
}

/* Shares the triangles of a cell that cannot be cut out among leaves, in the order they came. */
static int chop(struct octree *octree, const struct octree_cell *cell, uint32_t *pieces,
		struct why *why)
{
	uint32_t piece_max =
		(uint32_t)u64_min(octree->leaf_triangles, u64_max(octree->leaf_vertices / 3, 1));

	for (uint32_t begin = 0; begin < cell->count; begin += piece_max) {
		struct octree_leaf leaf = {
			.triangles = octree->lists + cell->first + begin,
			.triangle_count = (uint32_t)u64_min(cell->count - begin, piece_max),
		};
		int r;

		if (*pieces == UINT32_C(1) << (3 * GRID_PIECE_LEVELS))
			return why_set(why, -EOVERFLOW,
				       "more than %u leaves' triangles at one point: use more "
				       "--leaf-triangles",
				       *pieces);
		piece_cell(cell, (*pieces)++, &leaf);
		octree->limited_count++;
		r = octree->leaf(octree->arg, &leaf, why);
		if (r < 0)
			return r;
	}
	return 0;
}

/* A cell that is a leaf although it has too much. */
static int tell_limited(struct octree *octree, const struct octree_cell *cell, struct why *why)
{
	octree->limited_count++;
	return tell_leaf(octree, cell, why);
}

/* The children's lists one after the other behind the parent's.  Returns: 0 or -ENOMEM. */
static int share_by_centre(struct octree *octree, const struct octree_cell *cell,
			   uint32_t counts[8])
{
	const uint64_t *codes = octree->patch->codes;
	unsigned shift = 3 * (STORE_LEVEL_MAX - 1 - cell->level);
	size_t end = cell->first + cell->count;
	size_t starts[8];
	const uint32_t *from;

	if (lists_reserve(octree, end + cell->count) < 0)
		return -ENOMEM;
	from = octree->lists + cell->first;
	memset(counts, 0, 8 * sizeof(*counts));
	for (uint32_t i = 0; i < cell->count; i++)
		counts[codes[from[i]] >> shift & 7]++;
	for (unsigned octant = 0; octant < 8; octant++) {
		starts[octant] = end;
		end += counts[octant];
	}
	for (uint32_t i = 0; i < cell->count; i++)
		octree->lists[starts[codes[from[i]] >> shift & 7]++] = from[i];
	return 0;
}

static void child_of(const struct octree_cell *parent, uint32_t octant, struct octree_cell *ret)
{
	*ret = (struct octree_cell){ .level = parent->level + 1, .spread = parent->spread };
	for (unsigned i = 0; i < 3; i++)
		ret->cell[i] = parent->cell[i] << 1 | (octant >> i & 1);
}

/* The same, but a triangle goes to all children that it touches. */
static int share_by_touch(struct octree *octree, const struct octree_cell *cell, uint32_t counts[8])
{
	const struct patch *patch = octree->patch;
	size_t end = cell->first + cell->count;
	size_t starts[8];

	if (octree->octant_max < cell->count) {
		free(octree->octants);
		octree->octants = malloc(cell->count);
		octree->octant_max = octree->octants ? cell->count : 0;
		if (!octree->octants)
			return -ENOMEM;
	}
	memset(counts, 0, 8 * sizeof(*counts));
	for (uint32_t i = 0; i < cell->count; i++) {
		double corners[9];

		patch_corners(patch, octree->lists[cell->first + i], corners);
		octree->octants[i] =
			(uint8_t)overlap_octants(patch->grid, corners, cell->level, cell->cell);
		for (unsigned octant = 0; octant < 8; octant++)
			counts[octant] += octree->octants[i] >> octant & 1;
	}
	for (unsigned octant = 0; octant < 8; octant++) {
		starts[octant] = end;
		end += counts[octant];
	}
	if (lists_reserve(octree, end) < 0)
		return -ENOMEM;
	for (uint32_t i = 0; i < cell->count; i++)
		for (unsigned octant = 0; octant < 8; octant++)
			if (octree->octants[i] >> octant & 1)
				octree->lists[starts[octant]++] = octree->lists[cell->first + i];
	return 0;
}

static int cut(struct octree *octree, const struct octree_cell *cell, struct why *why);

/* Cuts a cell whose list lies among others: what is behind `end` is free for its children's lists. */
static int cut_behind(struct octree *octree, const struct octree_cell *cell, size_t end,
		      struct why *why)
{
	struct octree_cell moved = *cell;

	if (lists_reserve(octree, end + cell->count) < 0)
		return why_set(why, -ENOMEM, "no memory to cut a cell");
	memcpy(octree->lists + end, octree->lists + cell->first, cell->count * sizeof(uint32_t));
	moved.first = end;
	return cut(octree, &moved, why);
}

static int cut(struct octree *octree, const struct octree_cell *cell, struct why *why)
{
	bool unique = octree->buckets->layout == STORE_LAYOUT_UNIQUE;
	uint32_t counts[8];
	uint32_t pieces = 0;
	uint64_t sum = 0;
	size_t first = cell->first + cell->count;
	double spread;
	int r;

	if (cell->count == 0)
		return 0;
	if (cell->count <= octree->leaf_triangles && !has_many_vertices(octree, cell))
		return tell_leaf(octree, cell, why);
	if (cell->level == octree->patch->grid->level_max)
		return unique ? chop(octree, cell, &pieces, why) : tell_limited(octree, cell, why);
	r = unique ? share_by_centre(octree, cell, counts) : share_by_touch(octree, cell, counts);
	if (r < 0)
		return why_set(why, r, "no memory to cut a cell");
	for (unsigned octant = 0; octant < 8; octant++)
		sum += counts[octant];
	spread = cell->spread * (double)sum / (double)cell->count;
	if (spread > BUCKETS_SPREAD_MAX)
		return tell_limited(octree, cell, why);
	for (uint32_t octant = 0; octant < 8 && r == 0; octant++) {
		struct octree_cell child;

		child_of(cell, octant, &child);
		child.first = first;
		child.count = counts[octant];
		child.spread = spread;
		first += counts[octant];
		r = cut_behind(octree, &child, cell->first + cell->count + sum, why);
	}
	return r;
}

static int seen_reserve(struct octree *octree)
{
	uint32_t *seen;

	if (octree->leaf_vertices == UINT32_MAX || octree->patch->vertex_count <= octree->seen_max)
		return 0;
	seen = calloc(octree->patch->vertex_count, sizeof(*seen));
	if (!seen)
		return -ENOMEM;
	free(octree->seen);
	octree->seen = seen;
	octree->seen_max = octree->patch->vertex_count;
	octree->cell_number = 0;
	return 0;
}

/* All triangles of the patch, as the first list. */
static int list_all(struct octree *octree, struct why *why)
{
	uint32_t count = octree->patch->triangle_count;

	if (lists_reserve(octree, (size_t)count * 3) < 0 || seen_reserve(octree) < 0)
		return why_set(why, -ENOMEM, "no memory to cut %u triangles", count);
	for (uint32_t i = 0; i < count; i++)
		octree->lists[i] = i;
	return 0;
}

static int starts_reserve(struct octree *octree, uint32_t cell_count)
{
	if (cell_count <= octree->start_max)
		return 0;
	free(octree->starts);
	free(octree->touched);
	free(octree->begins);
	octree->start_max = 0;
	octree->starts = malloc((cell_count + 1) * sizeof(*octree->starts));
	octree->touched = malloc(cell_count * sizeof(*octree->touched));
	octree->begins = malloc(cell_count * sizeof(*octree->begins));
	if (!octree->starts || !octree->touched || !octree->begins)
		return -ENOMEM;
	octree->start_max = cell_count;
	return 0;
}

static const struct bucket_cell *cell_of(const struct octree *octree, uint32_t bucket,
					 uint32_t ordinal)
{
	const struct buckets *buckets = octree->buckets;

	return &buckets->cells[buckets->leaf_cells[buckets->buckets[bucket].first + ordinal]];
}

/* Which cells of the bucket a triangle is in: octree->touched.  Returns: how many. */
static uint32_t cells_of_triangle(struct octree *octree, uint32_t bucket, uint32_t triangle)
{
	uint32_t low = 0;
	uint32_t high = octree->buckets->buckets[bucket].cell_count;

	if (octree->buckets->layout == STORE_LAYOUT_REPLICATE) {
		double corners[9];

		patch_corners(octree->patch, triangle, corners);
		return buckets_touched_cells(octree->buckets, bucket, corners, octree->touched);
	}
	/* The last cell that begins at or before the centre's place on the Morton curve. */
	while (high - low > 1) {
		uint32_t middle = low + (high - low) / 2;

		if (octree->begins[middle] <= octree->patch->codes[triangle])
			low = middle;
		else
			high = middle;
	}
	octree->touched[0] = low;
	return 1;
}

/* A list of triangles for each cell of the bucket, one after the other. */
static int share_among_cells(struct octree *octree, uint32_t bucket)
{
	uint32_t cell_count = octree->buckets->buckets[bucket].cell_count;
	uint32_t triangle_count = octree->patch->triangle_count;
	uint32_t total = 0;

	memset(octree->starts, 0, (cell_count + 1) * sizeof(*octree->starts));
	for (uint32_t i = 0; i < triangle_count; i++) {
		uint32_t count = cells_of_triangle(octree, bucket, i);

		for (uint32_t k = 0; k < count; k++)
			octree->starts[octree->touched[k]]++;
	}
	for (uint32_t i = 0; i < cell_count; i++)
		total += octree->starts[i];
	if (lists_reserve(octree, (size_t)total * 2) < 0)
		return -ENOMEM;
	/* Counts become ends; filling from the back turns ends into begins. */
	for (uint32_t i = 1; i < cell_count; i++)
		octree->starts[i] += octree->starts[i - 1];
	octree->starts[cell_count] = total;
	for (uint32_t i = triangle_count; i-- > 0;) {
		uint32_t count = cells_of_triangle(octree, bucket, i);

		for (uint32_t k = 0; k < count; k++)
			octree->lists[--octree->starts[octree->touched[k]]] = i;
	}
	return 0;
}

int octree_cut(struct octree *octree, uint32_t bucket, struct why *why)
{
	uint32_t cell_count = octree->buckets->buckets[bucket].cell_count;
	size_t total;
	int r = starts_reserve(octree, cell_count);

	for (uint32_t i = 0; i < cell_count && r == 0; i++) {
		const struct bucket_cell *cell = cell_of(octree, bucket, i);

		octree->begins[i] = grid_morton(cell->cell) << 3 * (STORE_LEVEL_MAX - cell->level);
	}
	if (r == 0)
		r = share_among_cells(octree, bucket);
	if (r == 0)
		r = seen_reserve(octree);
	if (r < 0)
		return why_set(why, r, "no memory to cut a bucket");
	total = octree->starts[cell_count];
	for (uint32_t i = 0; i < cell_count && r == 0; i++) {
		const struct bucket_cell *from = cell_of(octree, bucket, i);
		struct octree_cell cell = {
			.level = from->level,
			.cell = { from->cell[0], from->cell[1], from->cell[2] },
			.first = octree->starts[i],
			.count = octree->starts[i + 1] - octree->starts[i],
			.spread = from->spread,
		};

		r = cut_behind(octree, &cell, total, why);
	}
	return r;
}

int octree_chop(struct octree *octree, uint32_t bucket, uint32_t *ret_pieces, struct why *why)
{
	const struct buckets *buckets = octree->buckets;
	const struct bucket_cell *from =
		&buckets->cells[buckets->leaf_cells[buckets->buckets[bucket].first]];
	struct octree_cell cell = {
		.level = from->level,
		.cell = { from->cell[0], from->cell[1], from->cell[2] },
		.count = octree->patch->triangle_count,
	};
	int r = list_all(octree, why);

	return r < 0 ? r : chop(octree, &cell, ret_pieces, why);
}
