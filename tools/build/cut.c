/* SPDX-License-Identifier: MIT */
#include "tools/build/cut.h"

#include <errno.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/codec/codec.h"
#include "formats/store/payload.h"
#include "tools/build/octree.h"

/** zstd's level: where more costs much time and saves little. */
#define ZSTD_LEVEL 3

/** A leaf that is made and not yet written. */
struct pending {
	struct leaf leaf;
	size_t at; /* of its payload in cutter.bytes */
};

/** One worker. */
struct cutter {
	struct cut *cut;
	struct patch patch;
	struct octree octree;
	struct leaf_maker maker;
	struct borders_scratch borders;
	struct codec_scratch *codec;
	struct pending *pending;
	size_t pending_count;
	size_t pending_max;
	uint8_t *bytes; /* payloads, one after the other */
	size_t byte_count;
	size_t byte_max;
	uint8_t *stored; /* one encoded payload */
	size_t stored_max;
};

uint64_t cut_worker_bytes(const struct record_shape *shape, uint32_t bucket_triangles,
			  uint32_t leaf_triangles, enum store_codec codec)
{
	/* A payload takes up to this for each triangle: three corners of their own. */
	uint64_t payload = 3 * (16 + 4 + 4 + 4) + 16 + 8;

	return bucket_triangles * (patch_triangle_bytes(shape) + payload * 2 / 3 + 5 * 4) +
	       leaf_maker_bytes(leaf_triangles, bucket_triangles) +
	       (codec == STORE_CODEC_NONE ? 0 : leaf_triangles * payload + 4 * MIB);
}

static int reserve(void *array, size_t *max, size_t needed, size_t element_bytes)
{
	void **at = array;
	size_t wanted = u64_max(needed, *max * 3 / 2);
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

/* ---- making leaves ---- */

static int on_leaf(void *arg, const struct octree_leaf *from, struct why *why)
{
	struct cutter *cutter = arg;
	struct payload_content content;
	struct pending *pending;
	uint32_t payload_bytes;
	struct leaf leaf;
	int r;

	r = leaf_make(&cutter->maker, from, &content, &leaf, why);
	if (r < 0)
		return r;
	r = payload_size(&content, &payload_bytes);
	if (r < 0)
		return why_set(why, r,
			       "a leaf of %u triangles is too large for a payload: use fewer "
			       "--leaf-triangles",
			       from->triangle_count);
	r = reserve(&cutter->bytes, &cutter->byte_max, cutter->byte_count + payload_bytes, 1);
	if (r == 0)
		r = reserve(&cutter->pending, &cutter->pending_max, cutter->pending_count + 1,
			    sizeof(*cutter->pending));
	if (r < 0)
		return why_set(why, r, "no memory for payloads");
	leaf.record.payload_bytes = payload_bytes;
	pending = &cutter->pending[cutter->pending_count++];
	*pending = (struct pending){ .leaf = leaf, .at = cutter->byte_count };
	payload_write(&content, cutter->bytes + cutter->byte_count);
	/* Payloads begin aligned, as codec and checksum like it. */
	cutter->byte_count += bytes_round_up(payload_bytes, 64);
	return 0;
}

/* ---- writing ---- */

/* Gives the payloads their ids, when it is their turn.  Encoding needs them. */
static uint64_t give_ids(struct cutter *cutter)
{
	struct cut *cut = cutter->cut;
	uint64_t first_id = cut->id_next;

	cut->id_next += cutter->pending_count;
	for (size_t i = 0; i < cutter->pending_count; i++) {
		struct payload_header *header =
			(struct payload_header *)(void *)(cutter->bytes + cutter->pending[i].at);

		header->payload_id = first_id + i;
	}
	return first_id;
}

static int encode(struct cutter *cutter, struct why *why)
{
	struct cut *cut = cutter->cut;
	size_t to = 0;

	/* Encoded payloads take the place of the others: they are not longer, or stay as they are. */
	for (size_t i = 0; i < cutter->pending_count; i++) {
		struct pending *pending = &cutter->pending[i];
		uint32_t payload_bytes = pending->leaf.record.payload_bytes;
		size_t stored_bytes = payload_bytes;
		int r = 0;

		pending->leaf.record.codec = (uint8_t)cut->codec;
		if (cut->codec != STORE_CODEC_NONE) {
			r = reserve(&cutter->stored, &cutter->stored_max,
				    codec_bound(cut->codec, payload_bytes), 1);
			if (r == 0)
				r = codec_encode(cutter->codec, cut->codec, ZSTD_LEVEL,
						 cutter->bytes + pending->at, payload_bytes,
						 cutter->stored, cutter->stored_max, &stored_bytes);
			if (r < 0)
				return why_set(why, r, "no memory to encode a payload");
			if (stored_bytes < payload_bytes)
				memcpy(cutter->bytes + to, cutter->stored, stored_bytes);
			else
				pending->leaf.record.codec = STORE_CODEC_NONE;
		}
		if (pending->leaf.record.codec == STORE_CODEC_NONE) {
			stored_bytes = payload_bytes;
			memmove(cutter->bytes + to, cutter->bytes + pending->at, payload_bytes);
		}
		pending->leaf.record.stored_bytes = (uint32_t)stored_bytes;
		pending->at = to;
		to += bytes_round_up(stored_bytes, 64);
	}
	return 0;
}

static int leaves_reserve(struct cut *cut, size_t more)
{
	uint64_t leaf_max_before = cut->leaf_max;
	size_t leaf_max = cut->leaf_max;
	int r = reserve(&cut->leaves, &leaf_max, cut->leaf_count + more, sizeof(*cut->leaves));

	cut->leaf_max = leaf_max;
	budget_charge(cut->budget, (leaf_max - leaf_max_before) * sizeof(*cut->leaves));
	return r;
}

/* Writes the payloads, when it is their turn. */
static int write_all(struct cutter *cutter, uint64_t first_id, struct why *why)
{
	struct cut *cut = cutter->cut;
	int r = 0;

	if (leaves_reserve(cut, cutter->pending_count) < 0)
		return why_set(why, -ENOMEM, "no memory for the records of %llu leaves",
			       (unsigned long long)cut->leaf_count);
	for (size_t i = 0; i < cutter->pending_count && r == 0; i++) {
		struct leaf *leaf = &cut->leaves[cut->leaf_count];

		*leaf = cutter->pending[i].leaf;
		r = store_writer_payload(cut->writer, first_id + i, leaf->record.codec,
					 cutter->bytes + cutter->pending[i].at,
					 leaf->record.stored_bytes, &leaf->record, why);
		if (r == 0)
			cut->leaf_count++;
	}
	cutter->pending_count = 0;
	cutter->byte_count = 0;
	return r;
}

/* Ends a turn.  Who failed stops the crew before the next one finds that it is due. */
static void leave(struct cut *cut, struct turnstile *turnstile, int r)
{
	if (r < 0)
		crew_stop(cut->crew);
	turnstile_leave(turnstile);
}

/* ---- buckets ---- */

static int load(struct cutter *cutter, uint32_t bucket, uint64_t begin, uint32_t count,
		struct why *why)
{
	const struct borders *borders = cutter->cut->borders;
	uint64_t record_bytes = borders->shape->words * sizeof(uint32_t);
	struct patch *patch = &cutter->patch;
	int r = patch_reserve(patch, cutter->cut->patch_triangles, why);

	if (r < 0)
		return r;
	CHECK(count <= cutter->cut->patch_triangles);
	patch->triangle_count = count;
	r = exchange_read(borders->triangles, bucket, begin * record_bytes, patch->records,
			  count * record_bytes, why);
	if (r < 0)
		return r;
	patch_measure(patch, borders->mode != NORMALS_FLAT);
	for (uint32_t i = 0; i < count; i++) {
		double corners[9];
		uint32_t cell[3];

		patch->primary[i] = true;
		if (borders->buckets->layout == STORE_LAYOUT_UNIQUE)
			continue;
		patch_corners(patch, i, corners);
		grid_centre_cell(borders->grid, corners, cell);
		patch->primary[i] = buckets_find(borders->buckets, cell) == bucket;
	}
	r = patch_find_points(patch, why);
	if (r == 0)
		r = borders_fill_normals(borders, bucket, patch, &cutter->borders, why);
	if (r == 0)
		patch_find_vertices(patch);
	return r;
}

static uint64_t triangles_in(const struct borders *borders, uint32_t bucket)
{
	return exchange_bytes(borders->triangles, bucket) /
	       (borders->shape->words * sizeof(uint32_t));
}

static int cut_bucket(struct cutter *cutter, uint32_t bucket, struct why *why)
{
	struct cut *cut = cutter->cut;
	uint64_t first_id = 0;
	int r = load(cutter, bucket, 0, (uint32_t)triangles_in(cut->borders, bucket), why);

	if (r == 0)
		r = octree_cut(&cutter->octree, bucket, why);
	if (r == 0)
		r = turnstile_enter(&cut->numbering, bucket, cut->crew);
	if (r < 0)
		return r;
	first_id = give_ids(cutter);
	leave(cut, &cut->numbering, 0);
	r = encode(cutter, why);
	if (r == 0)
		r = turnstile_enter(&cut->writing, bucket, cut->crew);
	if (r < 0)
		return r;
	r = write_all(cutter, first_id, why);
	leave(cut, &cut->writing, r);
	return r;
}

/* A bucket that does not fit in memory: slice by slice, while all behind it wait. */
static int cut_whole_bucket(struct cutter *cutter, uint32_t bucket, struct why *why)
{
	struct cut *cut = cutter->cut;
	uint64_t triangle_count = triangles_in(cut->borders, bucket);
	uint64_t slice = cut->patch_triangles;
	uint32_t pieces = 0;
	int r = turnstile_enter(&cut->numbering, bucket, cut->crew);

	if (r < 0)
		return r;
	r = turnstile_enter(&cut->writing, bucket, cut->crew);
	if (r < 0) {
		leave(cut, &cut->numbering, r);
		return r;
	}
	for (uint64_t begin = 0; begin < triangle_count && r == 0; begin += slice) {
		r = load(cutter, bucket, begin, (uint32_t)u64_min(triangle_count - begin, slice),
			 why);
		if (r == 0)
			r = octree_chop(&cutter->octree, bucket, &pieces, why);
		if (r == 0) {
			uint64_t first_id = give_ids(cutter);

			r = encode(cutter, why);
			if (r == 0)
				r = write_all(cutter, first_id, why);
		}
		if (r == 0 && crew_stopped(cut->crew))
			r = -ECANCELED;
	}
	leave(cut, &cut->writing, r);
	leave(cut, &cut->numbering, r);
	return r;
}

/** What the workers share. */
struct cutting {
	struct cut *cut;
	_Atomic uint32_t next_bucket;
};

static int cut_work(void *arg, uint32_t worker, struct why *why)
{
	struct cutting *cutting = arg;
	struct cut *cut = cutting->cut;
	const struct borders *borders = cut->borders;
	struct cutter cutter = { .cut = cut };
	int r = 0;

	(void)worker;
	patch_init(&cutter.patch, borders->grid, borders->shape);
	cutter.octree = (struct octree){
		.buckets = borders->buckets,
		.patch = &cutter.patch,
		.leaf_triangles = cut->leaf_triangles,
		.leaf_vertices = cut->leaf_vertices,
		.leaf = on_leaf,
		.arg = &cutter,
	};
	cutter.maker = (struct leaf_maker){
		.grid = borders->grid,
		.shape = borders->shape,
		.patch = &cutter.patch,
		.labels = cut->labels,
		.mode = borders->mode,
		.layout = borders->buckets->layout,
	};
	if (cut->codec != STORE_CODEC_NONE)
		r = codec_scratch_create(&cutter.codec);
	if (r < 0)
		(void)why_set(why, r, "no memory to encode payloads");
	while (r == 0 && !crew_stopped(cut->crew)) {
		uint32_t bucket = atomic_fetch_add(&cutting->next_bucket, 1);

		if (bucket >= borders->buckets->bucket_count)
			break;
		r = borders->buckets->buckets[bucket].whole ? cut_whole_bucket(&cutter, bucket, why)
							    : cut_bucket(&cutter, bucket, why);
		progress_add_done(cut->progress, borders->buckets->buckets[bucket].triangle_count);
		progress_add_triangles(cut->progress,
				       borders->buckets->buckets[bucket].triangle_count);
	}
	(void)pthread_mutex_lock(&cut->crew->lock);
	cut->limited_count += cutter.octree.limited_count;
	(void)pthread_mutex_unlock(&cut->crew->lock);
	cutter.codec = codec_scratch_destroy(cutter.codec);
	leaf_maker_done(&cutter.maker);
	octree_done(&cutter.octree);
	borders_scratch_done(&cutter.borders);
	patch_done(&cutter.patch);
	free(cutter.pending);
	free(cutter.bytes);
	free(cutter.stored);
	return r;
}

int cut_run(struct cut *cut, uint32_t worker_count, struct why *why)
{
	const struct buckets *buckets = cut->borders->buckets;
	struct cutting cutting = { .cut = cut };
	int r;

	for (uint32_t i = 0; i < buckets->bucket_count; i++)
		cut->patch_triangles = (uint32_t)u64_max(
			cut->patch_triangles,
			u64_min(buckets->buckets[i].triangle_count, buckets->bucket_triangles));
	cut->id_next = 1;
	turnstile_init(&cut->numbering);
	turnstile_init(&cut->writing);
	r = crew_run(cut->crew, worker_count, cut_work, &cutting, why);
	turnstile_done(&cut->numbering);
	turnstile_done(&cut->writing);
	return r;
}

void cut_done(struct cut *cut)
{
	free(cut->leaves);
	cut->leaves = NULL;
	cut->leaf_count = 0;
	cut->leaf_max = 0;
}
