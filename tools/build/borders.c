/* SPDX-License-Identifier: MIT */
#include "tools/build/borders.h"

#include <errno.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "tools/build/soup.h"

/** Triangles of a bucket that are read at a time to look for border positions. */
#define SCAN_TRIANGLES 8192u
/** 16 KiB: it stays in the nearest cache while a bucket's triangles pass by. */
#define FILTER_BITS  17
#define FILTER_WORDS ((UINT32_C(1) << FILTER_BITS) / 64)

static void load_border(const struct grid *grid, const uint32_t *row, struct border_record *ret)
{
	memcpy(ret, row + grid_position_words(grid), sizeof(*ret));
}

/* ---- answering ---- */

/** A face with a corner at a border position, of either kind. */
struct border_share {
	struct normal_share share;
	uint32_t next;   /* of the same position */
	uint32_t record; /* that asked; PATCH_NONE: a face of the bucket itself */
};

/** What one worker of the answering has. */
struct answerer {
	const struct borders *borders;
	uint32_t bucket;
	uint32_t *rows; /* the records */
	uint32_t row_count;
	uint64_t filter[FILTER_WORDS]; /* a bit for the hash of each position: most have none */
	uint32_t *slots;               /* of a hash table of positions: position + 1 */
	uint32_t slot_count;
	uint32_t *position_row; /* per position: a row that has it */
	uint32_t *position_head;
	uint32_t position_count;
	struct border_share *shares;
	uint32_t share_count;
	uint32_t share_max;
	struct normal_share *gathered;
	uint32_t *codes;
	uint32_t gathered_max;
	struct border_answer *answers; /* per row */
	uint32_t *triangles;           /* SCAN_TRIANGLES records */
};

uint64_t borders_worker_bytes(const struct borders *borders)
{
	uint64_t row_bytes = border_words(borders->grid) * 4;
	uint64_t row_count = 0;

	for (uint32_t i = 0; i < borders->buckets->bucket_count; i++) {
		uint64_t here = exchange_bytes(borders->records, i) / row_bytes;

		if (here <= BORDER_RECORDS_MAX)
			row_count = u64_max(row_count, here);
	}
	/* Row, slots, two tables of positions, shares of as many own faces, answers twice, addresses. */
	return row_count * (row_bytes + 4 * 4 + 2 * 4 + 2 * sizeof(struct border_share) +
			    2 * sizeof(struct border_answer) + 8) +
	       (uint64_t)SCAN_TRIANGLES * borders->shape->words * 4 + SPOOL_SEGMENT_BYTES;
}

static int grow(void *array, uint32_t *max, uint32_t needed, size_t element_bytes)
{
	void **at = array;
	uint32_t wanted = (uint32_t)u64_max(needed, *max * UINT64_C(3) / 2);
	void *grown;

	if (needed <= *max)
		return 0;
	grown = reallocarray(*at, wanted, element_bytes);
	if (!grown)
		return -ENOMEM;
	*at = grown;
	*max = wanted;
	return 0;
}

static const uint32_t *row_of(const struct answerer *answerer, uint32_t row)
{
	return answerer->rows + (size_t)row * border_words(answerer->borders->grid);
}

static void filter_add(struct answerer *answerer, uint32_t hash)
{
	uint32_t bit = hash >> (32 - FILTER_BITS);

	answerer->filter[bit / 64] |= UINT64_C(1) << bit % 64;
}

static bool filter_has(const struct answerer *answerer, uint32_t hash)
{
	uint32_t bit = hash >> (32 - FILTER_BITS);

	return answerer->filter[bit / 64] >> bit % 64 & 1;
}

/* The slot where a key is, or belongs. */
static uint32_t slot_of(const struct answerer *answerer, const uint32_t key[6], uint32_t hash)
{
	const struct grid *grid = answerer->borders->grid;
	uint32_t slot = hash & (answerer->slot_count - 1);

	while (answerer->slots[slot] != 0) {
		uint32_t row = answerer->position_row[answerer->slots[slot] - 1];
		uint32_t other[6];

		record_position_key(grid, row_of(answerer, row), other);
		if (record_keys_equal(key, other))
			break;
		slot = (slot + 1) & (answerer->slot_count - 1);
	}
	return slot;
}

static int add_share(struct answerer *answerer, uint32_t position, const struct normal_share *share,
		     uint32_t record)
{
	int r = grow(&answerer->shares, &answerer->share_max, answerer->share_count + 1,
		     sizeof(*answerer->shares));

	if (r < 0)
		return r;
	answerer->shares[answerer->share_count] = (struct border_share){
		.share = *share, .next = answerer->position_head[position], .record = record
	};
	answerer->position_head[position] = answerer->share_count++;
	return 0;
}

/* Loads the records and finds the positions that they speak of. */
static int load_rows(struct answerer *answerer, struct why *why)
{
	const struct borders *borders = answerer->borders;
	uint32_t row_bytes = border_words(borders->grid) * 4;
	uint64_t bytes = exchange_bytes(borders->records, answerer->bucket);
	int r;

	answerer->row_count = (uint32_t)(bytes / row_bytes);
	answerer->slot_count = 1024;
	while (answerer->slot_count < answerer->row_count * UINT64_C(2))
		answerer->slot_count *= 2;
	answerer->rows = malloc(bytes);
	answerer->slots = calloc(answerer->slot_count, sizeof(uint32_t));
	answerer->position_row = malloc(answerer->row_count * sizeof(uint32_t));
	answerer->position_head = malloc(answerer->row_count * sizeof(uint32_t));
	answerer->answers = malloc(answerer->row_count * sizeof(*answerer->answers));
	if (!answerer->rows || !answerer->slots || !answerer->position_row ||
	    !answerer->position_head || !answerer->answers)
		return why_set(why, -ENOMEM, "no memory for %u border records",
			       answerer->row_count);
	r = exchange_read(borders->records, answerer->bucket, 0, answerer->rows, bytes, why);
	answerer->position_count = 0;
	answerer->share_count = 0;
	memset(answerer->filter, 0, sizeof(answerer->filter));
	for (uint32_t row = 0; row < answerer->row_count && r == 0; row++) {
		struct border_record record;
		struct normal_share share;
		uint32_t key[6];
		uint32_t hash;
		uint32_t slot;

		load_border(borders->grid, row_of(answerer, row), &record);
		record_position_key(borders->grid, row_of(answerer, row), key);
		hash = record_key_hash(key);
		filter_add(answerer, hash);
		slot = slot_of(answerer, key, hash);
		if (answerer->slots[slot] == 0) {
			answerer->position_row[answerer->position_count] = row;
			answerer->position_head[answerer->position_count] = PATCH_NONE;
			answerer->slots[slot] = ++answerer->position_count;
		}
		share = (struct normal_share){ .weight = record.weight, .section = record.section };
		memcpy(share.normal, record.normal, sizeof(share.normal));
		r = add_share(answerer, answerer->slots[slot] - 1, &share, row);
		if (r < 0)
			return why_set(why, r, "no memory for border records");
	}
	return r;
}

static void rows_done(struct answerer *answerer)
{
	free(answerer->rows);
	free(answerer->slots);
	free(answerer->position_row);
	free(answerer->position_head);
	free(answerer->answers);
	answerer->rows = NULL;
	answerer->slots = NULL;
	answerer->position_row = NULL;
	answerer->position_head = NULL;
	answerer->answers = NULL;
}

/* Adds one of the bucket's own faces wherever it has a corner at a border position. */
static int add_own(struct answerer *answerer, const uint32_t *record)
{
	const struct borders *borders = answerer->borders;
	const struct record_shape *shape = borders->shape;
	struct face_normal face;
	bool measured = false;

	for (unsigned i = 0; i < 3; i++) {
		struct normal_share share;
		uint32_t key[6];
		uint32_t hash;
		uint32_t slot;
		int r;

		record_position_key(borders->grid, record + i * shape->position_words, key);
		hash = record_key_hash(key);
		if (!filter_has(answerer, hash))
			continue;
		slot = slot_of(answerer, key, hash);
		if (answerer->slots[slot] == 0)
			continue;
		if (!measured) {
			double corners[9];
			uint32_t cell[3];

			record_corners(borders->grid, shape, record, corners);
			grid_centre_cell(borders->grid, corners, cell);
			/* The bucket that has the centre speaks for a replica. */
			if (buckets_find(borders->buckets, cell) != answerer->bucket)
				return 0;
			face_normal_of(corners, &face);
			measured = true;
		}
		share = (struct normal_share){
			.weight = face.weights[i],
			.section = borders->labels->parts[record[shape->part_at]].section,
		};
		memcpy(share.normal, face.normal, sizeof(share.normal));
		r = add_share(answerer, answerer->slots[slot] - 1, &share, PATCH_NONE);
		if (r < 0)
			return r;
	}
	return 0;
}

static int scan_own(struct answerer *answerer, struct why *why)
{
	const struct borders *borders = answerer->borders;
	uint32_t words = borders->shape->words;
	uint64_t triangle_count =
		exchange_bytes(borders->triangles, answerer->bucket) / (words * 4);

	for (uint64_t begin = 0; begin < triangle_count; begin += SCAN_TRIANGLES) {
		uint64_t count = u64_min(triangle_count - begin, SCAN_TRIANGLES);
		int r = exchange_read(borders->triangles, answerer->bucket, begin * words * 4,
				      answerer->triangles, count * words * 4, why);

		if (r < 0)
			return r;
		for (uint64_t i = 0; i < count; i++) {
			r = add_own(answerer, answerer->triangles + i * words);
			if (r < 0)
				return why_set(why, r, "no memory for border faces");
		}
	}
	return 0;
}

/* Solves each position and writes the answers of those who asked. */
static int solve(struct answerer *answerer, struct why *why)
{
	const struct borders *borders = answerer->borders;

	for (uint32_t position = 0; position < answerer->position_count; position++) {
		uint32_t count = 0;
		uint32_t max = answerer->gathered_max;
		int r;

		for (uint32_t at = answerer->position_head[position]; at != PATCH_NONE;
		     at = answerer->shares[at].next) {
			r = grow(&answerer->gathered, &answerer->gathered_max, count + 1,
				 sizeof(*answerer->gathered));
			if (r == 0)
				r = grow(&answerer->codes, &max, count + 1,
					 sizeof(*answerer->codes));
			if (r < 0)
				return why_set(why, r, "no memory for border faces");
			answerer->gathered[count++] = answerer->shares[at].share;
		}
		r = normals_solve(borders->mode, borders->threshold, answerer->gathered, count,
				  answerer->codes);
		if (r < 0)
			return why_set(why, r, "no memory for border faces");
		count = 0;
		for (uint32_t at = answerer->position_head[position]; at != PATCH_NONE;
		     at = answerer->shares[at].next, count++) {
			uint32_t row = answerer->shares[at].record;
			struct border_record record;

			if (row == PATCH_NONE)
				continue;
			load_border(borders->grid, row_of(answerer, row), &record);
			answerer->answers[row] = (struct border_answer){
				.origin = record.origin,
				.corner = record.corner,
				.normal = answerer->codes[count],
			};
		}
	}
	return 0;
}

/** An answer and to whom. */
struct addressed {
	uint32_t bucket;
	uint32_t row;
};

static int compare_addressed(const void *a, const void *b)
{
	const struct addressed *left = a;
	const struct addressed *right = b;

	if (left->bucket != right->bucket)
		return left->bucket < right->bucket ? -1 : 1;
	return (left->row > right->row) - (left->row < right->row);
}

/* Sends the answers, in pieces that fit in a spool. */
static int put_answers(struct answerer *answerer, struct why *why)
{
	const struct borders *borders = answerer->borders;
	const uint32_t piece_max = (uint32_t)u64_min(
		SPOOL_SEGMENT_BYTES / sizeof(struct border_answer), answerer->row_count);
	struct addressed *addressed = malloc(answerer->row_count * sizeof(*addressed));
	struct border_answer *sorted = malloc(piece_max * sizeof(*sorted));
	struct exchange_fragment *fragments =
		malloc(u64_min(piece_max, borders->buckets->bucket_count) * sizeof(*fragments));
	int r = addressed && sorted && fragments ? 0 : -ENOMEM;

	if (r < 0)
		(void)why_set(why, r, "no memory for border answers");
	for (uint32_t row = 0; row < answerer->row_count && r == 0; row++) {
		struct border_record record;

		load_border(borders->grid, row_of(answerer, row), &record);
		addressed[row] = (struct addressed){ .bucket = record.bucket, .row = row };
	}
	if (r == 0)
		qsort(addressed, answerer->row_count, sizeof(*addressed), compare_addressed);
	for (uint32_t begin = 0; begin < answerer->row_count && r == 0; begin += piece_max) {
		uint32_t count = (uint32_t)u64_min(answerer->row_count - begin, piece_max);
		uint32_t fragment_count = 0;

		for (uint32_t i = 0; i < count; i++) {
			uint32_t bucket = addressed[begin + i].bucket;

			sorted[i] = answerer->answers[addressed[begin + i].row];
			if (fragment_count == 0 ||
			    fragments[fragment_count - 1].destination != bucket)
				fragments[fragment_count++] =
					(struct exchange_fragment){ .destination = bucket };
			fragments[fragment_count - 1].bytes += sizeof(*sorted);
		}
		r = exchange_put(borders->answers, answerer->bucket, sorted, fragments,
				 fragment_count, why);
	}
	free(addressed);
	free(sorted);
	free(fragments);
	return r;
}

static int answer_bucket(struct answerer *answerer, struct why *why)
{
	const struct borders *borders = answerer->borders;
	uint64_t bytes = exchange_bytes(borders->records, answerer->bucket);
	int r;

	if (bytes == 0 || bytes / (border_words(borders->grid) * 4) > BORDER_RECORDS_MAX)
		return 0;
	r = load_rows(answerer, why);
	if (r == 0 && !borders->buckets->buckets[answerer->bucket].whole)
		r = scan_own(answerer, why);
	if (r == 0)
		r = solve(answerer, why);
	if (r == 0)
		r = put_answers(answerer, why);
	rows_done(answerer);
	return r;
}

/** What the workers share. */
struct answering {
	const struct borders *borders;
	_Atomic uint32_t next_bucket;
};

static int answer_work(void *arg, uint32_t worker, struct why *why)
{
	struct answering *answering = arg;
	const struct borders *borders = answering->borders;
	struct answerer answerer = { .borders = borders };
	int r = 0;

	(void)worker;
	answerer.triangles = malloc((size_t)SCAN_TRIANGLES * borders->shape->words * 4);
	if (!answerer.triangles)
		r = why_set(why, -ENOMEM, "no memory to read triangles again");
	while (r == 0 && !crew_stopped(borders->crew)) {
		uint32_t bucket = atomic_fetch_add(&answering->next_bucket, 1);

		if (bucket >= borders->buckets->bucket_count)
			break;
		answerer.bucket = bucket;
		r = answer_bucket(&answerer, why);
		progress_add_done(borders->progress,
				  borders->buckets->buckets[bucket].triangle_count);
		progress_add_triangles(borders->progress,
				       borders->buckets->buckets[bucket].triangle_count);
	}
	free(answerer.triangles);
	free(answerer.shares);
	free(answerer.gathered);
	free(answerer.codes);
	return r;
}

int borders_answer(const struct borders *borders, uint32_t worker_count, struct why *why)
{
	struct answering answering = { .borders = borders };
	int r = crew_run(borders->crew, worker_count, answer_work, &answering, why);

	return r < 0 ? r : exchange_seal(borders->answers, why);
}

/* ---- using ---- */

void borders_scratch_done(struct borders_scratch *scratch)
{
	free(scratch->records);
	free(scratch->shares);
	free(scratch->codes);
	free(scratch->next);
	free(scratch->head);
	*scratch = (struct borders_scratch){ 0 };
}

static int reserve_bytes(struct borders_scratch *scratch, uint64_t bytes)
{
	uint8_t *records;

	if (bytes <= scratch->records_max_bytes)
		return 0;
	records = realloc(scratch->records, bytes);
	if (!records)
		return -ENOMEM;
	scratch->records = records;
	scratch->records_max_bytes = bytes;
	return 0;
}

/* A normal of the file's own, if the corner has one. */
static bool has_own_normal(const struct patch *patch, uint32_t corner, uint32_t *ret)
{
	if (patch->shape->normals_at == 0)
		return false;
	*ret = patch_record(patch, corner / 3)[patch->shape->normals_at + corner % 3];
	return *ret != SOUP_NORMAL_NONE;
}

/* The normals of their faces for corners that have none yet. */
static void fill_flat(const struct borders *borders, struct patch *patch)
{
	for (uint32_t i = 0; i < patch->triangle_count; i++) {
		uint32_t code = SOUP_NORMAL_NONE;

		for (uint32_t corner = 3 * i; corner < 3 * i + 3; corner++) {
			if (patch->normals[corner] != SOUP_NORMAL_NONE)
				continue;
			if (code == SOUP_NORMAL_NONE) {
				const int16_t *normal = patch->faces[i].normal;

				code = normals_encode(
					borders->mode,
					(const int64_t[]){ normal[0], normal[1], normal[2] });
			}
			patch->normals[corner] = code;
		}
	}
}

/* Reads the bucket's border records and hangs each on its point. */
static int hang_records(const struct borders *borders, uint32_t bucket, const struct patch *patch,
			struct borders_scratch *scratch, struct why *why)
{
	uint32_t words = border_words(borders->grid);
	uint64_t bytes = borders->records ? exchange_bytes(borders->records, bucket) : 0;
	uint32_t row_count = (uint32_t)(bytes / (words * 4));
	int r = grow(&scratch->head, &scratch->head_max, patch->point_count + 1, 4);

	if (row_count > BORDER_RECORDS_MAX)
		row_count = 0;
	bytes = (uint64_t)row_count * words * 4;
	if (r == 0)
		r = grow(&scratch->next, &scratch->next_max, row_count + 1, 4);
	if (r == 0)
		r = reserve_bytes(scratch, bytes);
	if (r < 0)
		return why_set(why, r, "no memory for border records");
	memset(scratch->head, 0xff, patch->point_count * sizeof(uint32_t));
	if (row_count == 0)
		return 0;
	r = exchange_read(borders->records, bucket, 0, scratch->records, bytes, why);
	if (r < 0)
		return r;
	for (uint32_t row = 0; row < row_count; row++) {
		const uint32_t *at =
			(const uint32_t *)(const void *)scratch->records + (size_t)row * words;
		uint32_t point = patch_point_at(patch, at);

		if (point == PATCH_NONE)
			continue;
		scratch->next[row] = scratch->head[point];
		scratch->head[point] = row;
	}
	return 0;
}

/* Gathers all faces around a point: the bucket's own first, then those of the records. */
static int gather(const struct borders *borders, const struct patch *patch, uint32_t point,
		  struct borders_scratch *scratch, uint32_t *ret_count)
{
	uint32_t words = border_words(borders->grid);
	uint32_t begin = patch->point_first[point];
	uint32_t end = patch->point_first[point + 1];
	uint32_t count = end - begin;
	uint32_t max = scratch->share_max;
	int r;

	for (uint32_t row = scratch->head[point]; row != PATCH_NONE; row = scratch->next[row])
		count++;
	r = grow(&scratch->shares, &max, count, sizeof(*scratch->shares));
	if (r == 0)
		r = grow(&scratch->codes, &scratch->share_max, count, sizeof(*scratch->codes));
	if (r < 0)
		return r;
	count = 0;
	for (uint32_t i = begin; i < end; i++) {
		uint32_t corner = patch->point_list[i];
		const struct face_normal *face = &patch->faces[corner / 3];

		scratch->shares[count++] = (struct normal_share){
			.normal = { face->normal[0], face->normal[1], face->normal[2] },
			.weight = patch->primary[corner / 3] ? face->weights[corner % 3] : 0,
			.section = borders->labels->parts[patch_part(patch, corner / 3)].section,
		};
	}
	for (uint32_t row = scratch->head[point]; row != PATCH_NONE; row = scratch->next[row]) {
		struct border_record record;

		load_border(borders->grid,
			    (const uint32_t *)(const void *)scratch->records + (size_t)row * words,
			    &record);
		scratch->shares[count++] = (struct normal_share){
			.normal = { record.normal[0], record.normal[1], record.normal[2] },
			.weight = record.weight,
			.section = record.section,
		};
	}
	*ret_count = count;
	return 0;
}

static int fill_own_points(const struct borders *borders, uint32_t bucket, struct patch *patch,
			   struct borders_scratch *scratch, struct why *why)
{
	for (uint32_t point = 0; point < patch->point_count; point++) {
		uint32_t begin = patch->point_first[point];
		uint32_t end = patch->point_first[point + 1];
		uint32_t count;
		int r;

		if (borders->buckets->bucket_count > 1) {
			double at[3];

			grid_load(borders->grid, patch_position(patch, patch->point_list[begin]),
				  at);
			if (buckets_find_point(borders->buckets, at) != bucket)
				continue;
		}
		r = gather(borders, patch, point, scratch, &count);
		if (r == 0)
			r = normals_solve(borders->mode, borders->threshold, scratch->shares, count,
					  scratch->codes);
		if (r < 0)
			return why_set(why, r, "no memory for normals");
		for (uint32_t i = begin; i < end; i++)
			patch->normals[patch->point_list[i]] = scratch->codes[i - begin];
	}
	return 0;
}

static int compare_origins(const void *a, const void *b)
{
	const uint64_t *wanted = a;
	const struct exchange_fragment *fragment = b;

	return (*wanted > fragment->origin) - (*wanted < fragment->origin);
}

/* Puts the answers of other buckets where they belong. */
static int fill_answers(const struct borders *borders, uint32_t bucket, struct patch *patch,
			struct borders_scratch *scratch, struct why *why)
{
	uint64_t bytes = exchange_bytes(borders->answers, bucket);
	uint32_t triangle_bytes = borders->shape->words * 4;
	const struct exchange_fragment *fragments;
	size_t fragment_count;
	uint64_t *firsts;
	uint64_t first = 0;
	int r;

	if (bytes == 0)
		return 0;
	fragments = exchange_fragments(borders->triangles, bucket, &fragment_count);
	firsts = malloc(fragment_count * sizeof(*firsts));
	r = firsts ? reserve_bytes(scratch, bytes) : -ENOMEM;
	if (r < 0) {
		free(firsts);
		return why_set(why, r, "no memory for border answers");
	}
	for (size_t i = 0; i < fragment_count; i++) {
		firsts[i] = first;
		first += fragments[i].bytes / triangle_bytes;
	}
	r = exchange_read(borders->answers, bucket, 0, scratch->records, bytes, why);
	for (uint64_t at = 0; at < bytes && r == 0; at += sizeof(struct border_answer)) {
		struct border_answer answer;
		const struct exchange_fragment *found;

		memcpy(&answer, scratch->records + at, sizeof(answer));
		found = bsearch(&answer.origin, fragments, fragment_count, sizeof(*fragments),
				compare_origins);
		CHECK(found);
		patch->normals[firsts[found - fragments] * 3 + answer.corner] = answer.normal;
	}
	free(firsts);
	return r;
}

int borders_fill_normals(const struct borders *borders, uint32_t bucket, struct patch *patch,
			 struct borders_scratch *scratch, struct why *why)
{
	bool computed = borders->mode == NORMALS_OCT8 || borders->mode == NORMALS_OCT16;
	uint32_t corner_count = patch->triangle_count * 3;
	int r = 0;

	for (uint32_t corner = 0; corner < corner_count; corner++)
		patch->normals[corner] = SOUP_NORMAL_NONE;
	if (borders->mode == NORMALS_FLAT)
		return 0;
	if (computed && !borders->buckets->buckets[bucket].whole) {
		r = hang_records(borders, bucket, patch, scratch, why);
		if (r == 0)
			r = fill_own_points(borders, bucket, patch, scratch, why);
		if (r == 0 && borders->answers)
			r = fill_answers(borders, bucket, patch, scratch, why);
	}
	for (uint32_t corner = 0; corner < corner_count && r == 0; corner++) {
		uint32_t own;

		if (has_own_normal(patch, corner, &own))
			patch->normals[corner] = normals_convert(borders->mode, own);
	}
	fill_flat(borders, patch);
	return r;
}
