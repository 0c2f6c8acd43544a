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

/* Shares the triangles of a cell that cannot be cut out among leaves, in the order they came. */
static int chop(struct octree *octree, const struct octree_cell *cell, uint32_t *pieces,
		struct why *why)
{
	uint32_t piece_max =
		(uint32_t)u64_min(octree->leaf_triangles, u64_max(octree->leaf_vertices / 3, 1));

	for (uint32_t begin = 0; begin < cell->count; begin += piece_max) {
		struct octree_leaf leaf = {
			.level = cell->level,
			.cell = { cell->cell[0], cell->cell[1], cell->cell[2] },
			.piece = ++*pieces,
			.triangles = octree->lists + cell->first + begin,
			.triangle_count = (uint32_t)u64_min(cell->count - begin, piece_max),
		};
		int r = octree->leaf(octree->arg, &leaf, why);

		if (r < 0)
			return r;
		octree->chopped_count++;
	}
	return 0;
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

/* Appends those of a list that touch a cell at `end`.  Returns: how many, or -ENOMEM. */
static int64_t append_touching(struct octree *octree, size_t first, uint32_t count, uint32_t level,
			       const uint32_t cell[3], size_t end)
{
	const struct patch *patch = octree->patch;
	double cell_min[3];
	double size;
	uint32_t kept = 0;

	if (lists_reserve(octree, end + count) < 0)
		return -ENOMEM;
	overlap_cell_box(patch->grid, level, cell, cell_min, &size);
	for (uint32_t i = 0; i < count; i++) {
		uint32_t triangle = octree->lists[first + i];
		double corners[9];

		patch_corners(patch, triangle, corners);
		if (overlap_touches(patch->grid, corners, cell_min, size))
			octree->lists[end + kept++] = triangle;
	}
	return kept;
}

static int share_by_touch(struct octree *octree, const struct octree_cell *cell, uint32_t counts[8])
{
	size_t end = cell->first + cell->count;

	for (uint32_t octant = 0; octant < 8; octant++) {
		struct octree_cell child;
		int64_t count;

		child_of(cell, octant, &child);
		count = append_touching(octree, cell->first, cell->count, child.level, child.cell,
					end);
		if (count < 0)
			return -ENOMEM;
		counts[octant] = (uint32_t)count;
		end += counts[octant];
	}
	return 0;
}

static int cut(struct octree *octree, const struct octree_cell *cell, struct why *why)
{
	bool unique = octree->buckets->layout == STORE_LAYOUT_UNIQUE;
	uint32_t counts[8];
	uint32_t pieces = 0;
	uint64_t sum = 0;
	size_t first = cell->first + cell->count;
	double spread;
	int r = 0;

	if (cell->count == 0)
		return 0;
	if (cell->count <= octree->leaf_triangles && !has_many_vertices(octree, cell))
		return tell_leaf(octree, cell, why);
	if (cell->level == octree->patch->grid->level_max)
		return chop(octree, cell, &pieces, why);
	r = unique ? share_by_centre(octree, cell, counts) : share_by_touch(octree, cell, counts);
	if (r < 0)
		return why_set(why, r, "no memory to cut a cell");
	for (unsigned octant = 0; octant < 8; octant++)
		sum += counts[octant];
	spread = cell->spread * (double)sum / (double)cell->count;
	if (spread > BUCKETS_SPREAD_MAX)
		return chop(octree, cell, &pieces, why);
	for (uint32_t octant = 0; octant < 8 && r == 0; octant++) {
		struct octree_cell child;

		child_of(cell, octant, &child);
		child.first = first;
		child.count = counts[octant];
		child.spread = spread;
		first += counts[octant];
		/* Its own children's lists would lie on those of its brothers: it moves behind them. */
		if (child.count > 0) {
			size_t behind = cell->first + cell->count + sum;

			if (lists_reserve(octree, behind + child.count) < 0)
				return why_set(why, -ENOMEM, "no memory to cut a cell");
			memcpy(octree->lists + behind, octree->lists + child.first,
			       child.count * sizeof(uint32_t));
			child.first = behind;
		}
		r = cut(octree, &child, why);
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

int octree_cut(struct octree *octree, uint32_t bucket, struct why *why)
{
	const struct buckets *buckets = octree->buckets;
	const struct bucket *here = &buckets->buckets[bucket];
	uint32_t count = octree->patch->triangle_count;
	int r = list_all(octree, why);

	for (uint32_t i = 0; i < here->cell_count && r == 0; i++) {
		const struct bucket_cell *from =
			&buckets->cells[buckets->leaf_cells[here->first + i]];
		struct octree_cell cell = {
			.level = from->level,
			.cell = { from->cell[0], from->cell[1], from->cell[2] },
			.first = count,
			.spread = from->spread,
		};

		if (buckets->layout == STORE_LAYOUT_UNIQUE) {
			uint64_t begin = grid_morton(cell.cell)
					 << 3 * (STORE_LEVEL_MAX - cell.level);
			uint64_t length = UINT64_C(1) << 3 * (STORE_LEVEL_MAX - cell.level);

			for (uint32_t k = 0; k < count; k++)
				if (octree->patch->codes[k] - begin < length)
					octree->lists[cell.first + cell.count++] = k;
		} else {
			int64_t kept = append_touching(octree, 0, count, cell.level, cell.cell,
						       cell.first);

			if (kept < 0)
				return why_set(why, -ENOMEM, "no memory to cut a cell");
			cell.count = (uint32_t)kept;
		}
		r = cut(octree, &cell, why);
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
