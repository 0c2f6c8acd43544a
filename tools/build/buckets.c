/* SPDX-License-Identifier: MIT */
#include "tools/build/buckets.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/check.h"
#include "tools/build/overlap.h"

#define COUNTERS_NONE      UINT32_MAX
#define FIRST_LEVELS       6u
#define NEXT_LEVELS        3u
#define TABLE_LEVEL        6u
#define TABLE_COUNT        (UINT32_C(1) << (3 * TABLE_LEVEL))
#define OPEN_CELLS_A_ROUND 4096u
/** Cells of depth 1 .. n below a cell: 8 + 64 + ... */
#define CELLS_BELOW(n) (((UINT32_C(1) << (3 * ((n) + 1))) - 8) / 7)
/** Index of the first of those at depth n. */
#define FIRST_AT_DEPTH(n) CELLS_BELOW((n)-1)
/** Deepest stack of a walk: seven siblings wait at each level. */
#define WALK_STACK_MAX (7 * STORE_LEVEL_MAX + 8)

int buckets_init(struct buckets *buckets, const struct grid *grid, enum store_layout layout,
		 uint64_t bucket_triangles)
{
	*buckets = (struct buckets){ .grid = grid,
				     .layout = layout,
				     .bucket_triangles = bucket_triangles };
	buckets->cell_max = 1024;
	buckets->cells = calloc(buckets->cell_max, sizeof(*buckets->cells));
	buckets->table = calloc(TABLE_COUNT, sizeof(*buckets->table));
	if (!buckets->cells || !buckets->table) {
		buckets_done(buckets);
		return -ENOMEM;
	}
	/* Nobody has counted yet: as if too many were in it. */
	buckets->cells[0] = (struct bucket_cell){ .triangle_count = UINT64_MAX,
						  .counters = COUNTERS_NONE,
						  .spread = 1 };
	buckets->cell_count = 1;
	return 0;
}

void buckets_done(struct buckets *buckets)
{
	free(buckets->cells);
	free(buckets->buckets);
	free(buckets->leaf_cells);
	free(buckets->table);
	free(buckets->counters);
	*buckets = (struct buckets){ 0 };
}

uint64_t buckets_table_bytes(const struct buckets *buckets)
{
	return buckets->cell_max * sizeof(*buckets->cells) + TABLE_COUNT * sizeof(uint32_t) +
	       buckets->bucket_count * sizeof(*buckets->buckets);
}

/* ---- rounds ---- */

static bool is_open(const struct buckets *buckets, const struct bucket_cell *cell)
{
	return cell->first_child == 0 && !cell->whole &&
	       cell->triangle_count > buckets->bucket_triangles;
}

int buckets_round_begin(struct buckets *buckets)
{
	uint32_t open_count = 0;
	bool first = buckets->cells[0].triangle_count == UINT64_MAX;

	buckets->counters_levels =
		first && buckets->layout == STORE_LAYOUT_UNIQUE ? FIRST_LEVELS : NEXT_LEVELS;
	buckets->counters_words = CELLS_BELOW(buckets->counters_levels);
	for (uint32_t i = 0; i < buckets->cell_count && open_count < OPEN_CELLS_A_ROUND; i++)
		if (is_open(buckets, &buckets->cells[i]))
			buckets->cells[i].counters = open_count++;
	if (open_count == 0)
		return 0;
	/* The last word counts what the root has in all. */
	buckets->counters =
		calloc((size_t)open_count * buckets->counters_words + 1, sizeof(uint64_t));
	return buckets->counters ? 1 : -ENOMEM;
}

static void counter_add(uint64_t *counter, uint64_t count)
{
	(void)__atomic_fetch_add(counter, count, __ATOMIC_RELAXED);
}

/* Unique: only the deepest cells are counted, the others are their sums. */
static void count_centre(struct buckets *buckets, struct buckets_tally *tally,
			 const double corners[9])
{
	const struct bucket_cell *at = &buckets->cells[0];
	uint32_t levels = buckets->counters_levels;
	uint64_t *counter;
	uint32_t cell[3];
	uint64_t code;
	uint32_t depth;

	grid_centre_cell(buckets->grid, corners, cell);
	code = grid_morton(cell);
	while (at->first_child != 0)
		at = &buckets->cells[at->first_child +
				     (code >> 3 * (STORE_LEVEL_MAX - 1 - at->level) & 7)];
	if (at->counters == COUNTERS_NONE)
		return;
	/* Cells of GRID_LEVEL_MAX are not cut: what is counted below them never counts. */
	depth = at->level + levels;
	code = depth <= STORE_LEVEL_MAX ? code >> 3 * (STORE_LEVEL_MAX - depth)
					: code << 3 * (depth - STORE_LEVEL_MAX);
	counter = buckets->counters + (size_t)at->counters * buckets->counters_words +
		  FIRST_AT_DEPTH(levels) + (code & ((UINT64_C(1) << 3 * levels) - 1));
	if (counter != tally->counter) {
		if (tally->count > 0)
			counter_add(tally->counter, tally->count);
		tally->counter = counter;
		tally->count = 0;
	}
	tally->count++;
}

/** A cell on a walk: one that is there, or one that is only counted. */
struct walk_cell {
	uint32_t level;
	uint32_t cell[3];
	uint32_t index;    /* of the bucket cell that it is, or is below */
	uint32_t depth;    /* below it */
	uint32_t position; /* among those of that depth */
};

static void walk_child(const struct walk_cell *from, uint32_t octant, struct walk_cell *ret)
{
	*ret = *from;
	ret->level = from->level + 1;
	for (unsigned i = 0; i < 3; i++)
		ret->cell[i] = from->cell[i] << 1 | (octant >> i & 1);
}

/* Replicate: every cell that the triangle touches, at every depth. */
static void count_touched(struct buckets *buckets, const double corners[9])
{
	struct walk_cell stack[WALK_STACK_MAX];
	uint32_t stack_count = 1;

	/* Only the root: filling the whole stack would take longer than the walk. */
	stack[0] = (struct walk_cell){ 0 };
	while (stack_count > 0) {
		struct walk_cell at = stack[--stack_count];
		const struct bucket_cell *cell = &buckets->cells[at.index];
		uint32_t octants;
		uint64_t *counters =
			buckets->counters + (size_t)cell->counters * buckets->counters_words;

		if (at.depth > 0)
			counter_add(counters + FIRST_AT_DEPTH(at.depth) + at.position, 1);
		if (cell->first_child == 0 &&
		    (cell->counters == COUNTERS_NONE || at.depth == buckets->counters_levels ||
		     at.level == buckets->grid->level_max))
			continue;
		octants = overlap_octants(buckets->grid, corners, at.level, at.cell);
		for (uint32_t octant = 0; octant < 8; octant++) {
			struct walk_cell child;

			if (!(octants >> octant & 1))
				continue;
			walk_child(&at, octant, &child);
			if (cell->first_child != 0) {
				child.index = cell->first_child + octant;
			} else {
				child.depth = at.depth + 1;
				child.position = at.position << 3 | octant;
			}
			CHECK(stack_count < WALK_STACK_MAX);
			stack[stack_count++] = child;
		}
	}
}

void buckets_count(struct buckets *buckets, struct buckets_tally *tally, const double corners[9])
{
	tally->total++;
	if (buckets->layout == STORE_LAYOUT_UNIQUE)
		count_centre(buckets, tally, corners);
	else
		count_touched(buckets, corners);
}

void buckets_count_end(struct buckets *buckets, struct buckets_tally *tally)
{
	if (tally->count > 0)
		counter_add(tally->counter, tally->count);
	if (buckets->cells[0].triangle_count == UINT64_MAX)
		counter_add(buckets->counters + buckets->counters_words, tally->total);
	*tally = (struct buckets_tally){ 0 };
}

/* Eight children side by side.  Returns: the first one's index, or 0 without memory. */
static uint32_t add_children(struct buckets *buckets)
{
	uint32_t first = buckets->cell_count;

	if (first + 8 > buckets->cell_max) {
		uint32_t cell_max = buckets->cell_max * 2;
		struct bucket_cell *cells = reallocarray(buckets->cells, cell_max, sizeof(*cells));

		if (!cells)
			return 0;
		buckets->cells = cells;
		buckets->cell_max = cell_max;
	}
	buckets->cell_count += 8;
	return first;
}

/*
 * Makes the cells below one that has too many triangles, as far as they were counted.  The table of
 * cells may move, so that indices are used throughout.
 */
static int expand(struct buckets *buckets, uint32_t index, const uint64_t *counters, uint32_t depth,
		  uint32_t position)
{
	struct bucket_cell parent = buckets->cells[index];
	const uint64_t *children = counters + FIRST_AT_DEPTH(depth + 1) + ((size_t)position << 3);
	uint64_t sum = 0;
	double spread;
	uint32_t first;

	if (parent.triangle_count <= buckets->bucket_triangles || depth == buckets->counters_levels)
		return 0;
	for (unsigned i = 0; i < 8; i++)
		sum += children[i];
	spread = parent.spread * (double)sum / (double)parent.triangle_count;
	if (parent.level == buckets->grid->level_max || spread > BUCKETS_SPREAD_MAX) {
		buckets->cells[index].whole = true;
		return 0;
	}
	first = add_children(buckets);
	if (first == 0)
		return -ENOMEM;
	buckets->cells[index].first_child = first;
	for (uint32_t octant = 0; octant < 8; octant++) {
		struct bucket_cell *child = &buckets->cells[first + octant];
		int r;

		*child = (struct bucket_cell){
			.triangle_count = children[octant],
			.counters = COUNTERS_NONE,
			.spread = spread,
			.level = (uint8_t)(parent.level + 1),
		};
		for (unsigned i = 0; i < 3; i++)
			child->cell[i] = parent.cell[i] << 1 | (octant >> i & 1);
		r = expand(buckets, first + octant, counters, depth + 1, position << 3 | octant);
		if (r < 0)
			return r;
	}
	return 0;
}

static void sum_up(const struct buckets *buckets, uint64_t *counters)
{
	if (buckets->layout != STORE_LAYOUT_UNIQUE)
		return;
	for (uint32_t depth = buckets->counters_levels; depth > 1; depth--) {
		uint64_t *above = counters + FIRST_AT_DEPTH(depth - 1);
		const uint64_t *here = counters + FIRST_AT_DEPTH(depth);

		for (uint32_t i = 0; i < UINT32_C(1) << (3 * depth); i++)
			above[i >> 3] += here[i];
	}
}

int buckets_round_end(struct buckets *buckets)
{
	uint32_t cell_count = buckets->cell_count;
	int r = 0;

	if (buckets->cells[0].triangle_count == UINT64_MAX)
		buckets->cells[0].triangle_count = buckets->counters[buckets->counters_words];
	for (uint32_t i = 0; i < cell_count && r == 0; i++) {
		uint32_t number = buckets->cells[i].counters;
		uint64_t *counters;

		if (number == COUNTERS_NONE)
			continue;
		counters = buckets->counters + (size_t)number * buckets->counters_words;
		buckets->cells[i].counters = COUNTERS_NONE;
		sum_up(buckets, counters);
		r = expand(buckets, i, counters, 0, 0);
	}
	free(buckets->counters);
	buckets->counters = NULL;
	return r;
}

/* ---- buckets ---- */

static int bucket_add_cell(struct buckets *buckets, uint32_t index)
{
	struct bucket_cell *cell = &buckets->cells[index];
	struct bucket *bucket =
		buckets->bucket_count == 0 ? NULL : &buckets->buckets[buckets->bucket_count - 1];

	/* Points may lie in a cell that no triangle is in: it belongs to the bucket before it. */
	if (cell->triangle_count > 0 && (!bucket || bucket->triangle_count + cell->triangle_count >
							    buckets->bucket_triangles)) {
		/* Powers of two: the table grows when it is full. */
		if ((buckets->bucket_count & (buckets->bucket_count - 1)) == 0) {
			size_t bucket_max =
				buckets->bucket_count == 0 ? 1 : (size_t)buckets->bucket_count * 2;

			bucket = reallocarray(buckets->buckets, bucket_max, sizeof(*bucket));
			if (!bucket)
				return -ENOMEM;
			buckets->buckets = bucket;
		}
		bucket = &buckets->buckets[buckets->bucket_count++];
		*bucket =
			(struct bucket){ .first = buckets->leaf_cell_count, .whole = cell->whole };
	}
	cell->bucket = buckets->bucket_count == 0 ? 0 : buckets->bucket_count - 1;
	if (cell->triangle_count == 0)
		return 0;
	cell->ordinal = bucket->cell_count++;
	bucket->triangle_count += cell->triangle_count;
	buckets->leaf_cells[buckets->leaf_cell_count++] = index;
	return 0;
}

static void fill_table(struct buckets *buckets)
{
	for (uint32_t i = 0; i < TABLE_COUNT; i++) {
		uint32_t cell[3] = { i & 63, i >> 6 & 63, i >> 12 & 63 };
		uint32_t index = 0;

		while (buckets->cells[index].first_child != 0 &&
		       buckets->cells[index].level < TABLE_LEVEL) {
			uint32_t shift = TABLE_LEVEL - 1 - buckets->cells[index].level;

			index = buckets->cells[index].first_child + ((cell[0] >> shift & 1) |
								     (cell[1] >> shift & 1) << 1 |
								     (cell[2] >> shift & 1) << 2);
		}
		buckets->table[i] = index;
	}
}

int buckets_choose(struct buckets *buckets)
{
	uint32_t stack[WALK_STACK_MAX] = { 0 };
	uint32_t stack_count = 1;

	buckets->leaf_cells = calloc(buckets->cell_count, sizeof(*buckets->leaf_cells));
	if (!buckets->leaf_cells)
		return -ENOMEM;
	while (stack_count > 0) {
		uint32_t index = stack[--stack_count];
		uint32_t first = buckets->cells[index].first_child;
		int r;

		if (first == 0) {
			r = bucket_add_cell(buckets, index);
			if (r < 0)
				return r;
			continue;
		}
		/* The last is pushed first, so that the walk is in Morton order. */
		for (uint32_t octant = 8; octant-- > 0;)
			stack[stack_count++] = first + octant;
	}
	fill_table(buckets);
	return 0;
}

/** Told of a cell without children that a triangle touches. */
typedef void (*touched_fn)(void *arg, const struct bucket_cell *cell);

/* In Morton order, so that a bucket's cells come one after the other. */
static void walk_touched(const struct buckets *buckets, const double corners[9], touched_fn touched,
			 void *arg)
{
	struct walk_cell stack[WALK_STACK_MAX];
	uint32_t stack_count = 1;

	/* Only the root: filling the whole stack would take longer than the walk. */
	stack[0] = (struct walk_cell){ 0 };
	while (stack_count > 0) {
		struct walk_cell at = stack[--stack_count];
		const struct bucket_cell *cell = &buckets->cells[at.index];
		uint32_t octants;

		if (cell->first_child == 0) {
			if (cell->triangle_count > 0)
				touched(arg, cell);
			continue;
		}
		octants = overlap_octants(buckets->grid, corners, at.level, at.cell);
		for (uint32_t octant = 8; octant-- > 0;) {
			if (!(octants >> octant & 1))
				continue;
			walk_child(&at, octant, &stack[stack_count]);
			stack[stack_count++].index = cell->first_child + octant;
		}
	}
}

/** Numbers that are gathered on a walk. */
struct gathered {
	uint32_t *numbers;
	uint32_t count;
	uint32_t bucket;
};

static void gather_bucket(void *arg, const struct bucket_cell *cell)
{
	struct gathered *gathered = arg;

	if (gathered->count == 0 || gathered->numbers[gathered->count - 1] != cell->bucket)
		gathered->numbers[gathered->count++] = cell->bucket;
}

static void gather_ordinal(void *arg, const struct bucket_cell *cell)
{
	struct gathered *gathered = arg;

	if (cell->bucket == gathered->bucket)
		gathered->numbers[gathered->count++] = cell->ordinal;
}

uint32_t buckets_touched(const struct buckets *buckets, const double corners[9], uint32_t *ret)
{
	struct gathered gathered = { .numbers = ret };

	walk_touched(buckets, corners, gather_bucket, &gathered);
	return gathered.count;
}

uint32_t buckets_touched_cells(const struct buckets *buckets, uint32_t bucket,
			       const double corners[9], uint32_t *ret)
{
	struct gathered gathered = { .numbers = ret, .bucket = bucket };

	walk_touched(buckets, corners, gather_ordinal, &gathered);
	return gathered.count;
}
