/* SPDX-License-Identifier: MIT */
#include "formats/store/store_writer.h"

#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <xxhash.h>
#include <zstd.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/base/file.h"
#include "formats/store/new_file.h"
#include "formats/store/store_checksum.h"
#include "formats/store/store_hs.h"
#include "formats/store/store_judge.h"
#include "formats/store/write_stream.h"

#define NAMES_ZSTD_LEVEL  9
#define NAMES_CHUNK_BYTES (128 * KIB)

struct store_writer {
	struct new_file *file;
	struct write_stream *stream;
	bool is_over; /* a commit was tried: only destroying it is left */
};

int store_writer_create(const char *path, struct store_writer **ret, struct why *why)
{
	struct store_writer *writer = calloc(1, sizeof(*writer));
	int r;

	if (!writer)
		return why_set(why, -ENOMEM, "%s: no memory", path);
	r = new_file_create(path, &writer->file, why);
	if (r < 0)
		goto err_destroy;
	r = write_stream_create(new_file_fd(writer->file), STORE_FIRST_EXTENT_OFFSET,
				&writer->stream);
	if (r < 0) {
		why_set(why, r, "%s: no memory", path);
		goto err_destroy;
	}
	*ret = writer;
	return 0;

err_destroy:
	store_writer_destroy(writer);
	return r;
}

struct store_writer *store_writer_destroy(struct store_writer *writer)
{
	if (!writer)
		return NULL;
	writer->stream = write_stream_destroy(writer->stream);
	writer->file = new_file_destroy(writer->file);
	free(writer);
	return NULL;
}

uint64_t store_writer_bytes(const struct store_writer *writer)
{
	return write_stream_offset(writer->stream);
}

static int write_failed(const struct store_writer *writer, int error, struct why *why)
{
	return why_errno(why, error, "%s: cannot be written", new_file_path(writer->file));
}

int store_writer_payload(struct store_writer *writer, uint64_t payload_id, uint32_t codec,
			 const void *stored, uint32_t stored_bytes, struct store_node *record,
			 struct why *why)
{
	uint64_t file_offset = write_stream_offset(writer->stream);
	int r;

	CHECK(!writer->is_over);
	CHECK(payload_id > 0 && stored_bytes > 0 && codec < STORE_CODEC_COUNT_);
	r = write_stream_append(writer->stream, stored, stored_bytes);
	if (r == 0)
		r = write_stream_align(writer->stream);
	if (r < 0)
		return write_failed(writer, r, why);
	record->payload_id = payload_id;
	record->file_offset = file_offset;
	record->payload_checksum = store_checksum(stored, stored_bytes, payload_id);
	record->stored_bytes = stored_bytes;
	record->codec = (uint8_t)codec;
	return 0;
}

/* ---- HS ---- */

static int write_hs(struct store_writer *writer, struct store_superblock *superblock,
		    const struct store_node *nodes)
{
	uint64_t block_count = store_hs_block_count(superblock->node_count);
	size_t table_bytes = block_count * sizeof(uint64_t);
	uint64_t *table = malloc(table_bytes);
	int r;

	if (!table)
		return -ENOMEM;
	for (uint64_t block = 0; block < block_count; block++)
		table[block] = store_hs_block_checksum(superblock, nodes, block);
	superblock->hs = (struct store_extent){
		.file_offset = write_stream_offset(writer->stream),
		.stored_bytes = store_hs_bytes(superblock->node_count),
		.raw_bytes = store_hs_bytes(superblock->node_count),
		.checksum = store_checksum(table, table_bytes, superblock->generation),
	};
	r = write_stream_append(writer->stream, nodes, superblock->node_count * sizeof(*nodes));
	if (r == 0)
		r = write_stream_append(writer->stream, table, table_bytes);
	if (r == 0)
		r = write_stream_align(writer->stream);
	free(table);
	return r;
}

/* ---- names ---- */

/** The names on their way to the file: compressed, counted and checksummed. */
struct names_output {
	struct write_stream *stream;
	ZSTD_CCtx *context;
	XXH3_state_t *checksum;
	uint8_t *chunk; /* NAMES_CHUNK_BYTES */
	uint64_t stored_bytes;
};

static int names_put(struct names_output *output, const void *data, size_t size_bytes,
		     ZSTD_EndDirective directive)
{
	ZSTD_inBuffer in = { data, size_bytes, 0 };
	size_t left;

	do {
		ZSTD_outBuffer out = { output->chunk, NAMES_CHUNK_BYTES, 0 };
		int r;

		left = ZSTD_compressStream2(output->context, &out, &in, directive);
		/* Its input cannot be wrong. */
		if (ZSTD_isError(left))
			return -ENOMEM;
		(void)XXH3_64bits_update(output->checksum, out.dst, out.pos);
		output->stored_bytes += out.pos;
		r = write_stream_append(output->stream, out.dst, out.pos);
		if (r < 0)
			return r;
	} while (in.pos < in.size || (directive == ZSTD_e_end && left > 0));
	return 0;
}

static int names_put_all(struct names_output *output, const struct store_names_content *names)
{
	const struct store_names_header header = {
		.section_count = names->section_count,
		.source_count = names->source_count,
		.part_count = names->part_count,
		.string_bytes = names->string_bytes,
	};
	const struct {
		const void *data;
		size_t size_bytes;
	} tables[] = {
		{ &header, sizeof(header) },
		{ names->sections, names->section_count * sizeof(*names->sections) },
		{ names->sources, names->source_count * sizeof(*names->sources) },
		{ names->parts, names->part_count * sizeof(*names->parts) },
		{ names->strings, names->string_bytes },
	};
	int r = 0;

	for (size_t i = 0; i < ARRAY_LENGTH(tables) && r == 0; i++)
		r = names_put(output, tables[i].data, tables[i].size_bytes,
			      i + 1 < ARRAY_LENGTH(tables) ? ZSTD_e_continue : ZSTD_e_end);
	return r;
}

/* -EOVERFLOW above STORE_NAMES_BYTES_MAX. */
static int names_raw_bytes(const struct store_names_content *names, uint64_t *ret)
{
	if (names->section_count > UINT32_MAX || names->source_count > UINT32_MAX ||
	    names->part_count > UINT32_MAX || names->string_bytes > STORE_NAMES_BYTES_MAX)
		return -EOVERFLOW;
	*ret = sizeof(struct store_names_header) +
	       names->section_count * sizeof(struct store_section) +
	       names->source_count * sizeof(struct store_source) +
	       names->part_count * sizeof(struct store_part) + names->string_bytes;
	return *ret > STORE_NAMES_BYTES_MAX ? -EOVERFLOW : 0;
}

static int write_names(struct store_writer *writer, struct store_superblock *superblock,
		       const struct store_names_content *names)
{
	struct names_output output = { .stream = writer->stream };
	uint64_t file_offset = write_stream_offset(writer->stream);
	uint64_t raw_bytes;
	int r;

	r = names_raw_bytes(names, &raw_bytes);
	if (r < 0)
		return r;
	output.context = ZSTD_createCCtx();
	output.checksum = XXH3_createState();
	output.chunk = malloc(NAMES_CHUNK_BYTES);
	r = -ENOMEM;
	if (!output.context || !output.checksum || !output.chunk)
		goto done;
	if (ZSTD_isError(ZSTD_CCtx_setParameter(output.context, ZSTD_c_compressionLevel,
						NAMES_ZSTD_LEVEL)) ||
	    ZSTD_isError(ZSTD_CCtx_setPledgedSrcSize(output.context, raw_bytes)))
		goto done;
	(void)XXH3_64bits_reset_withSeed(output.checksum, superblock->generation);
	r = names_put_all(&output, names);
	if (r == 0)
		r = write_stream_align(writer->stream);
	superblock->names = (struct store_extent){
		.file_offset = file_offset,
		.stored_bytes = output.stored_bytes,
		.raw_bytes = raw_bytes,
		.checksum = XXH3_64bits_digest(output.checksum),
	};
done:
	free(output.chunk);
	(void)XXH3_freeState(output.checksum);
	(void)ZSTD_freeCCtx(output.context);
	return r;
}

/* ---- commit ---- */

/* The content's name: of the superblock, whose checksums stand for everything else. */
static void set_uuid(struct store_superblock *superblock)
{
	XXH128_hash_t hash = XXH3_128bits(superblock, sizeof(*superblock));

	static_assert(sizeof(hash) == sizeof(superblock->uuid), "a uuid is one hash");
	memcpy(superblock->uuid, &hash.low64, sizeof(hash.low64));
	memcpy(superblock->uuid + sizeof(hash.low64), &hash.high64, sizeof(hash.high64));
}

static int write_superblock(struct store_writer *writer, struct store_superblock *superblock,
			    struct why *why)
{
	struct store_superblock slots[STORE_SUPERBLOCK_COUNT] = { 0 };
	int r;

	set_uuid(superblock);
	superblock->checksum =
		store_checksum(superblock, offsetof(struct store_superblock, checksum), 0);
	slots[0] = *superblock;
	r = write_stream_put(writer->stream, slots, sizeof(slots), 0);
	return r < 0 ? write_failed(writer, r, why) : 0;
}

static int flush(const struct store_writer *writer, struct why *why)
{
	if (fsync(new_file_fd(writer->file)) < 0)
		return write_failed(writer, -errno, why);
	return 0;
}

int store_writer_commit(struct store_writer *writer, struct store_superblock *superblock,
			const struct store_node *nodes, const struct store_names_content *names,
			struct why *why)
{
	struct store_superblock block = *superblock;
	int r;

	CHECK(!writer->is_over);
	writer->is_over = true;
	if (block.node_count == 0)
		return why_set(why, -EINVAL, "a store has at least its root");
	memcpy(block.magic, STORE_MAGIC, sizeof(block.magic));
	block.version = STORE_VERSION;
	block.superblock_bytes = STORE_BLOCK_BYTES;
	block.generation = 1;
	block.checksum = 0;
	block.section_count = names->section_count;
	block.part_count = names->part_count;
	memset(block.uuid, 0, sizeof(block.uuid));
	r = write_hs(writer, &block, nodes);
	if (r == 0)
		r = write_names(writer, &block, names);
	if (r == 0)
		r = write_stream_flush(writer->stream);
	if (r < 0)
		return write_failed(writer, r, why);
	block.file_bytes = write_stream_offset(writer->stream);
	/* What no reader would open is not committed; the judges are those of store_open(). */
	r = store_judge_superblock(&block, why);
	if (r == 0)
		r = store_judge_hs(&block, nodes, why);
	if (r < 0)
		return r;
	/* Everything is on the device before the superblock says so. */
	r = flush(writer, why);
	if (r == 0)
		r = write_superblock(writer, &block, why);
	if (r == 0)
		r = flush(writer, why);
	if (r == 0)
		r = new_file_commit(writer->file, why);
	if (r == 0)
		*superblock = block;
	return r;
}
