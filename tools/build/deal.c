/* SPDX-License-Identifier: MIT */
#include "tools/build/deal.h"

#include <errno.h>
#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "tools/build/borders.h"

/** Triangles that are placed and put on the grid at a time: they stay in the nearest cache. */
#define CHUNK_TRIANGLES 256u
/** A worker takes blocks until they have so many triangles, and deals them out together. */
#define UNIT_TRIANGLES 32768u

/** Triangles on the grid, without those that are dropped. */
struct chunk {
	uint32_t count;
	uint32_t index[CHUNK_TRIANGLES];     /* in the block */
	double corners[CHUNK_TRIANGLES * 9]; /* as grid_load() gives them */
	double placed[CHUNK_TRIANGLES * 9];
};

/** A record and where it goes. */
struct delivery {
	uint32_t record;
	uint32_t bucket;
	bool primary;
};

/** What each worker has of its own. */
struct dealer {
	struct deal *deal;
	uint8_t *block_buffer;
	struct chunk *chunk;
	uint64_t degenerate_count;
	double moved_squared_max; /* in grid_load()'s unit */
	struct buckets_tally tally;

	/* Only for dealing out. */
	uint64_t unit;
	uint32_t put_count; /* of this unit */
	uint32_t *records;
	uint32_t record_count;
	struct delivery *deliveries;
	uint32_t delivery_count;
	uint32_t *sorted; /* records in the order of their buckets */
	uint32_t *touched;
	uint32_t *starts; /* per bucket */
	uint32_t *used;   /* buckets that something goes to */
	struct exchange_fragment *fragments;
	uint32_t *borders; /* border records as they come; the owner in front of each */
	uint32_t *borders_sorted;
	uint32_t border_count;
};

/** Room for deliveries of one put: their bytes have to fit in one piece of a spool. */
static uint32_t delivery_max(const struct record_shape *shape)
{
	return (uint32_t)u64_min(UNIT_TRIANGLES,
				 SPOOL_SEGMENT_BYTES / (shape->words * sizeof(uint32_t)));
}

static uint32_t border_max(const struct record_shape *shape)
{
	uint32_t words = shape->position_words + (uint32_t)(sizeof(struct border_record) / 4);

	return SPOOL_SEGMENT_BYTES / ((words + 1) * (uint32_t)sizeof(uint32_t));
}

uint64_t deal_worker_bytes(const struct record_shape *shape)
{
	return SOUP_BLOCK_BYTES_MAX + sizeof(struct chunk) +
	       delivery_max(shape) * (shape->words * 8 + sizeof(struct delivery)) +
	       2 * (uint64_t)SPOOL_SEGMENT_BYTES;
}

/* ---- both passes ---- */

/** One pass over the soup. */
struct pass {
	struct deal *deal;
	const size_t *unit_blocks; /* first block of each unit, and one past the last */
	uint64_t unit_count;
	_Atomic uint64_t next_unit;
	bool dealing;
};

/* Puts the chunk's corners on the lattice, or takes them as they are.  Returns: largest move, squared. */
static double chunk_to_grid(const struct grid *grid, struct chunk *chunk, uint32_t count)
{
	double moved_max = 0;

	if (grid->form != GRID_LATTICE) {
		memcpy(chunk->corners, chunk->placed, count * 9 * sizeof(double));
		return 0;
	}
	for (uint32_t i = 0; i < count * 3; i++) {
		double moved = 0;

		for (unsigned k = 0; k < 3; k++) {
			double at =
				(chunk->placed[3 * i + k] - grid->origin[k]) * grid->step_inverse;
			double snapped = (double)grid_round(at);

			chunk->corners[3 * i + k] = snapped;
			moved += (at - snapped) * (at - snapped);
		}
		moved_max = moved > moved_max ? moved : moved_max;
	}
	return moved_max;
}

static bool is_finite(const double corners[9])
{
	double sum = 0;

	for (unsigned k = 0; k < 9; k++)
		sum += corners[k] * 0.0;
	return sum == 0;
}

/* Fills the chunk with the triangles of a block from `begin`. */
static void chunk_fill(struct dealer *dealer, const struct soup_block *block,
		       const struct soup_view *view, uint32_t begin, uint32_t count)
{
	const struct soup *soup = dealer->deal->soup;
	const struct grid *grid = dealer->deal->grid;
	struct chunk *chunk = dealer->chunk;
	uint32_t kept = 0;
	double moved;

	soup_place(soup, block, view, begin, count, chunk->placed);
	/* What is not finite must not come near the largest move. */
	if (soup->non_finite_count > 0) {
		for (uint32_t i = 0; i < count; i++) {
			if (!is_finite(&chunk->placed[9 * i]))
				continue;
			memmove(&chunk->placed[9 * kept], &chunk->placed[9 * i],
				9 * sizeof(double));
			chunk->index[kept++] = begin + i;
		}
		count = kept;
	} else {
		for (uint32_t i = 0; i < count; i++)
			chunk->index[i] = begin + i;
	}
	moved = chunk_to_grid(grid, chunk, count);
	dealer->moved_squared_max = fmax(dealer->moved_squared_max, moved);
	kept = 0;
	for (uint32_t i = 0; i < count; i++) {
		if (grid_is_degenerate(grid, &chunk->corners[9 * i]))
			continue;
		if (kept < i)
			memcpy(&chunk->corners[9 * kept], &chunk->corners[9 * i],
			       9 * sizeof(double));
		chunk->index[kept++] = chunk->index[i];
	}
	dealer->degenerate_count += count - kept;
	chunk->count = kept;
}

/* ---- dealing out ---- */

static void store_position(const struct grid *grid, const double point[3], uint32_t *ret)
{
	if (grid->form == GRID_LATTICE) {
		for (unsigned i = 0; i < 3; i++)
			ret[i] = (uint32_t)(int32_t)point[i];
	} else if (grid->form == GRID_FLOAT) {
		for (unsigned i = 0; i < 3; i++) {
			float value = (float)point[i];

			memcpy(&ret[i], &value, sizeof(value));
		}
	} else {
		memcpy(ret, point, 3 * sizeof(double));
	}
}

static void make_record(const struct dealer *dealer, const struct soup_block *block,
			const struct soup_view *view, uint32_t index, const double corners[9],
			uint32_t *record)
{
	const struct deal *deal = dealer->deal;
	const struct record_shape *shape = deal->shape;
	const struct labels *labels = deal->labels;
	uint32_t part = (uint32_t)labels->sections[block->section].first_part +
			(view->parts ? view->parts[index] : block->part);

	for (unsigned i = 0; i < 3; i++)
		store_position(deal->grid, &corners[3 * i], record + i * shape->position_words);
	record[shape->part_at] = part;
	for (unsigned i = 0; i < 3 && shape->normals_at != 0; i++)
		record[shape->normals_at + i] =
			view->normals ? view->normals[3 * (size_t)index + i] : SOUP_NORMAL_NONE;
	for (unsigned i = 0; i < 3 && shape->colours_at != 0; i++)
		record[shape->colours_at + i] = view->colours ? view->colours[3 * (size_t)index + i]
							      : labels->parts[part].colour;
	if (shape->ordinal_at != 0) {
		uint64_t ordinal = deal->soup->sections[block->section].first_triangle +
				   block->first_triangle + index;

		memcpy(record + shape->ordinal_at, &ordinal, sizeof(ordinal));
	}
}

/*
 * Sorts rows of words by the bucket in `bucket_of(i)`, keeping their order otherwise.  What it makes
 * is the order on disk, so it must not depend on anything but the rows.
 */
static uint32_t starts_of(struct dealer *dealer, uint32_t count, uint32_t row_bytes)
{
	uint32_t begin = 0;

	for (uint32_t i = 0; i < count; i++) {
		uint32_t bucket = dealer->used[i];
		uint32_t rows = dealer->starts[bucket];

		dealer->fragments[i] =
			(struct exchange_fragment){ .destination = bucket,
						    .bytes = (uint64_t)rows * row_bytes };
		dealer->starts[bucket] = begin;
		begin += rows;
	}
	return begin;
}

static uint64_t next_origin(struct dealer *dealer)
{
	return dealer->unit << 24 | dealer->put_count++;
}

static int put_borders(struct dealer *dealer, struct why *why)
{
	const struct deal *deal = dealer->deal;
	uint32_t words = border_words(deal->grid);
	uint32_t used_count = 0;
	int r;

	if (dealer->border_count == 0)
		return 0;
	for (uint32_t i = 0; i < dealer->border_count; i++) {
		uint32_t owner = dealer->borders[(size_t)i * (words + 1)];

		if (dealer->starts[owner]++ == 0)
			dealer->used[used_count++] = owner;
	}
	(void)starts_of(dealer, used_count, words * 4);
	for (uint32_t i = 0; i < dealer->border_count; i++) {
		const uint32_t *row = dealer->borders + (size_t)i * (words + 1);

		memcpy(dealer->borders_sorted + (size_t)dealer->starts[row[0]]++ * words, row + 1,
		       words * sizeof(uint32_t));
	}
	r = exchange_put(deal->borders, next_origin(dealer), dealer->borders_sorted,
			 dealer->fragments, used_count, why);
	for (uint32_t i = 0; i < used_count; i++)
		dealer->starts[dealer->used[i]] = 0;
	dealer->border_count = 0;
	return r;
}

/* Tells the owners of a record's positions, where they are others. */
static int make_borders(struct dealer *dealer, const struct delivery *delivery,
			const uint32_t *record, uint64_t origin, uint32_t row, struct why *why)
{
	const struct deal *deal = dealer->deal;
	uint32_t position_words = deal->shape->position_words;
	uint32_t words = border_words(deal->grid);
	struct face_normal face;
	bool measured = false;
	double corners[9];

	record_corners(deal->grid, deal->shape, record, corners);
	for (unsigned i = 0; i < 3; i++) {
		uint32_t owner = buckets_find_point(deal->buckets, &corners[3 * i]);
		struct border_record border;
		uint32_t *to;

		if (owner == delivery->bucket)
			continue;
		if (dealer->border_count == border_max(deal->shape)) {
			int r = put_borders(dealer, why);

			if (r < 0)
				return r;
		}
		if (!measured)
			face_normal_of(corners, &face);
		measured = true;
		border = (struct border_record){
			.section = deal->labels->parts[record[deal->shape->part_at]].section,
			.bucket = delivery->bucket,
			.origin = origin,
			.corner = row * 3 + i,
			.weight = delivery->primary ? face.weights[i] : 0,
			.normal = { face.normal[0], face.normal[1], face.normal[2] },
		};
		to = dealer->borders + (size_t)dealer->border_count++ * (words + 1);
		to[0] = owner;
		memcpy(to + 1, record + i * position_words, position_words * sizeof(uint32_t));
		memcpy(to + 1 + position_words, &border, sizeof(border));
	}
	return 0;
}

/* Sends what has been gathered to the buckets. */
static int put_deliveries(struct dealer *dealer, struct why *why)
{
	const struct deal *deal = dealer->deal;
	uint32_t words = deal->shape->words;
	uint64_t origin = next_origin(dealer);
	uint32_t used_count = 0;
	int r;

	for (uint32_t i = 0; i < dealer->delivery_count; i++)
		if (dealer->starts[dealer->deliveries[i].bucket]++ == 0)
			dealer->used[used_count++] = dealer->deliveries[i].bucket;
	(void)starts_of(dealer, used_count, words * 4);
	for (uint32_t i = 0; i < dealer->delivery_count; i++) {
		struct delivery *delivery = &dealer->deliveries[i];

		memcpy(dealer->sorted + (size_t)dealer->starts[delivery->bucket]++ * words,
		       dealer->records + (size_t)delivery->record * words,
		       words * sizeof(uint32_t));
	}
	r = exchange_put(deal->triangles, origin, dealer->sorted, dealer->fragments, used_count,
			 why);
	for (uint32_t i = 0; i < used_count; i++)
		dealer->starts[dealer->used[i]] = 0;
	if (r == 0 && deal->borders) {
		uint32_t *rows = dealer->sorted; /* no longer needed: rows given out a bucket */

		/* A border record names its triangle by its row in the fragment. */
		for (uint32_t i = 0; i < used_count; i++)
			dealer->touched[dealer->used[i]] = 0;
		for (uint32_t i = 0; i < dealer->delivery_count; i++)
			rows[i] = dealer->touched[dealer->deliveries[i].bucket]++;
		for (uint32_t i = 0; i < dealer->delivery_count && r == 0; i++) {
			const struct delivery *delivery = &dealer->deliveries[i];

			if (deal->buckets->buckets[delivery->bucket].whole)
				continue;
			r = make_borders(dealer, delivery,
					 dealer->records + (size_t)delivery->record * words, origin,
					 rows[i], why);
		}
		if (r == 0)
			r = put_borders(dealer, why);
	}
	dealer->record_count = 0;
	dealer->delivery_count = 0;
	return r;
}

/* Finds the buckets of one triangle and notes its deliveries. */
static int deliver(struct dealer *dealer, const double corners[9], uint32_t record, struct why *why)
{
	const struct deal *deal = dealer->deal;
	uint32_t count = 1;
	uint32_t primary;
	uint32_t cell[3];

	grid_centre_cell(deal->grid, corners, cell);
	primary = buckets_find(deal->buckets, cell);
	dealer->touched[0] = primary;
	if (deal->buckets->layout == STORE_LAYOUT_REPLICATE)
		count = buckets_touched(deal->buckets, corners, dealer->touched);
	CHECK(count <= deal->buckets->bucket_count);
	for (uint32_t i = 0; i < count; i++) {
		uint32_t bucket = dealer->touched[i];

		if (dealer->delivery_count == delivery_max(deal->shape)) {
			const uint32_t words = deal->shape->words;
			uint32_t kept[RECORD_WORDS_MAX];
			uint32_t rest_count = count - i;
			uint32_t *rest = dealer->touched + deal->buckets->bucket_count;
			int r;

			/* The triangle that is being dealt goes into the next put as well. */
			memcpy(kept, dealer->records + (size_t)record * words, words * 4);
			memcpy(rest, dealer->touched + i, rest_count * sizeof(uint32_t));
			r = put_deliveries(dealer, why);
			if (r < 0)
				return r;
			memcpy(dealer->touched + i, rest, rest_count * sizeof(uint32_t));
			memcpy(dealer->records, kept, words * 4);
			record = 0;
			dealer->record_count = 1;
		}
		dealer->deliveries[dealer->delivery_count++] = (struct delivery){
			.record = record, .bucket = bucket, .primary = bucket == primary
		};
	}
	return 0;
}

static int deal_chunk(struct dealer *dealer, const struct soup_block *block,
		      const struct soup_view *view, struct why *why)
{
	const struct chunk *chunk = dealer->chunk;
	uint32_t words = dealer->deal->shape->words;
	int r = 0;

	for (uint32_t i = 0; i < chunk->count && r == 0; i++) {
		if (dealer->record_count == delivery_max(dealer->deal->shape)) {
			r = put_deliveries(dealer, why);
			if (r < 0)
				break;
		}
		make_record(dealer, block, view, chunk->index[i], &chunk->corners[9 * i],
			    dealer->records + (size_t)dealer->record_count * words);
		r = deliver(dealer, &chunk->corners[9 * i], dealer->record_count++, why);
	}
	return r;
}

/* ---- units ---- */

static int work_on_block(struct pass *pass, struct dealer *dealer, struct soup_block *block,
			 struct why *why)
{
	struct deal *deal = pass->deal;
	struct soup_view view;
	int r = soup_view(deal->soup, block, dealer->block_buffer, &view, why);

	for (uint32_t begin = 0; begin < block->triangle_count && r == 0;
	     begin += CHUNK_TRIANGLES) {
		uint32_t count = (uint32_t)u64_min(block->triangle_count - begin, CHUNK_TRIANGLES);

		chunk_fill(dealer, block, &view, begin, count);
		if (pass->dealing)
			r = deal_chunk(dealer, block, &view, why);
		else
			for (uint32_t i = 0; i < dealer->chunk->count; i++)
				buckets_count(deal->buckets, &dealer->tally,
					      &dealer->chunk->corners[9 * i]);
	}
	if (r == 0 && pass->dealing)
		spool_release(deal->soup->spool, block->address, soup_block_bytes(block));
	progress_add_triangles(deal->progress, block->triangle_count);
	progress_add_done(deal->progress, block->triangle_count);
	return r;
}

static int dealer_init(struct dealer *dealer, struct pass *pass, struct why *why)
{
	const struct deal *deal = pass->deal;
	const struct record_shape *shape = deal->shape;
	size_t bucket_count = (size_t)deal->buckets->bucket_count + 1;

	*dealer = (struct dealer){ .deal = pass->deal };
	dealer->block_buffer = malloc(SOUP_BLOCK_BYTES_MAX);
	dealer->chunk = malloc(sizeof(*dealer->chunk));
	if (!dealer->block_buffer || !dealer->chunk)
		return why_set(why, -ENOMEM, "no memory to read triangles again");
	if (!pass->dealing)
		return 0;
	dealer->records = malloc((size_t)delivery_max(shape) * shape->words * 4);
	dealer->sorted = malloc((size_t)delivery_max(shape) * shape->words * 4);
	dealer->deliveries = malloc(delivery_max(shape) * sizeof(*dealer->deliveries));
	dealer->touched = malloc(2 * bucket_count * sizeof(uint32_t));
	dealer->starts = calloc(bucket_count, sizeof(uint32_t));
	dealer->used = malloc(bucket_count * sizeof(uint32_t));
	dealer->fragments = malloc(bucket_count * sizeof(*dealer->fragments));
	if (deal->borders) {
		dealer->borders = malloc(SPOOL_SEGMENT_BYTES);
		dealer->borders_sorted = malloc(SPOOL_SEGMENT_BYTES);
	}
	if (!dealer->records || !dealer->sorted || !dealer->deliveries || !dealer->touched ||
	    !dealer->starts || !dealer->used || !dealer->fragments ||
	    (deal->borders && (!dealer->borders || !dealer->borders_sorted)))
		return why_set(why, -ENOMEM, "no memory to deal triangles out");
	return 0;
}

static void dealer_done(struct dealer *dealer)
{
	struct deal *deal = dealer->deal;

	(void)pthread_mutex_lock(&deal->lock);
	deal->degenerate_count += dealer->degenerate_count;
	deal->moved_max =
		fmax(deal->moved_max, grid_to_model(deal->grid, sqrt(dealer->moved_squared_max)));
	(void)pthread_mutex_unlock(&deal->lock);
	free(dealer->block_buffer);
	free(dealer->chunk);
	free(dealer->records);
	free(dealer->sorted);
	free(dealer->deliveries);
	free(dealer->touched);
	free(dealer->starts);
	free(dealer->used);
	free(dealer->fragments);
	free(dealer->borders);
	free(dealer->borders_sorted);
}

static int pass_work(void *arg, uint32_t worker, struct why *why)
{
	struct pass *pass = arg;
	struct dealer dealer;
	int r = dealer_init(&dealer, pass, why);

	(void)worker;
	while (r == 0 && !crew_stopped(pass->deal->crew)) {
		uint64_t unit = atomic_fetch_add(&pass->next_unit, 1);

		if (unit >= pass->unit_count)
			break;
		dealer.unit = unit;
		dealer.put_count = 0;
		for (size_t i = pass->unit_blocks[unit]; i < pass->unit_blocks[unit + 1] && r == 0;
		     i++)
			r = work_on_block(pass, &dealer, &pass->deal->soup->blocks[i], why);
		if (r == 0 && pass->dealing)
			r = put_deliveries(&dealer, why);
	}
	if (!pass->dealing)
		buckets_count_end(pass->deal->buckets, &dealer.tally);
	dealer_done(&dealer);
	return r;
}

static int run_pass(struct deal *deal, uint32_t worker_count, bool dealing, struct why *why)
{
	const struct soup *soup = deal->soup;
	size_t *unit_blocks = calloc(soup->block_count + 1, sizeof(*unit_blocks));
	struct pass pass = { .deal = deal, .unit_blocks = unit_blocks, .dealing = dealing };
	uint64_t in_unit = 0;
	int r;

	if (!unit_blocks)
		return why_set(why, -ENOMEM, "no memory for the table of blocks");
	for (size_t i = 0; i < soup->block_count; i++) {
		uint32_t count = soup->blocks[i].triangle_count;

		if (i > 0 && in_unit + count > UNIT_TRIANGLES) {
			unit_blocks[++pass.unit_count] = i;
			in_unit = 0;
		}
		in_unit += count;
	}
	if (soup->block_count > 0)
		unit_blocks[++pass.unit_count] = soup->block_count;
	deal->degenerate_count = 0;
	r = crew_run(deal->crew, worker_count, pass_work, &pass, why);
	free(unit_blocks);
	return r;
}

int deal_count(struct deal *deal, uint32_t worker_count, struct why *why)
{
	int more;

	while ((more = buckets_round_begin(deal->buckets)) > 0) {
		int r = run_pass(deal, worker_count, false, why);

		if (r < 0)
			return r;
		more = buckets_round_end(deal->buckets);
		if (more < 0)
			break;
	}
	if (more == 0)
		more = buckets_choose(deal->buckets);
	return more == 0 ? 0 : why_set(why, more, "no memory for the upper octree");
}

int deal_out(struct deal *deal, uint32_t worker_count, struct why *why)
{
	int r = run_pass(deal, worker_count, true, why);

	if (r == 0)
		r = exchange_seal(deal->triangles, why);
	if (r == 0 && deal->borders)
		r = exchange_seal(deal->borders, why);
	return r;
}
