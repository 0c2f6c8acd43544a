/* SPDX-License-Identifier: MIT */
#include "formats/codec/codec.h"

#include <errno.h>
#include <meshoptimizer.h>
#include <stdlib.h>
#include <string.h>
#include <threads.h>
#include <zstd.h>
#include <zstd_errors.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/store/payload.h"
#include "formats/store/payload_layout.h"

/** The vertex codec takes elements of whole words; streams of smaller ones are coded as words. */
#define WORD_BYTES 4u

/** Memory that grows and is kept. */
struct room {
	void *memory;
	size_t size_bytes;
};

struct codec_scratch {
	ZSTD_CCtx *compress;
	ZSTD_DCtx *decompress;
	struct room coded;   /* between the two halves of MESHOPT_ZSTD */
	struct room indices; /* widened to 32 bits, which the index coder wants */
};

static const char *const codec_names[STORE_CODEC_COUNT_] = {
	[STORE_CODEC_NONE] = "none",
	[STORE_CODEC_ZSTD] = "zstd",
	[STORE_CODEC_MESHOPT] = "meshopt",
	[STORE_CODEC_MESHOPT_ZSTD] = "meshopt+zstd",
};

const char *codec_name(uint32_t codec)
{
	return codec < STORE_CODEC_COUNT_ ? codec_names[codec] : NULL;
}

int codec_find(const char *name)
{
	for (int codec = 0; codec < STORE_CODEC_COUNT_; codec++)
		if (strcmp(name, codec_names[codec]) == 0)
			return codec;
	return -EINVAL;
}

/* The library's newest version of its own format may change; the store's does not. */
static void fix_meshopt_versions(void)
{
	meshopt_encodeVertexVersion(0);
	meshopt_encodeIndexVersion(1);
}

int codec_scratch_create(struct codec_scratch **ret)
{
	static once_flag versions_are_fixed = ONCE_FLAG_INIT;
	struct codec_scratch *scratch;

	call_once(&versions_are_fixed, fix_meshopt_versions);
	scratch = calloc(1, sizeof(*scratch));
	if (!scratch)
		return -ENOMEM;
	*ret = scratch;
	return 0;
}

struct codec_scratch *codec_scratch_destroy(struct codec_scratch *scratch)
{
	if (!scratch)
		return NULL;
	(void)ZSTD_freeCCtx(scratch->compress);
	(void)ZSTD_freeDCtx(scratch->decompress);
	free(scratch->coded.memory);
	free(scratch->indices.memory);
	free(scratch);
	return NULL;
}

static int room_reserve(struct room *room, size_t size_bytes)
{
	void *memory;

	if (size_bytes <= room->size_bytes)
		return 0;
	memory = malloc(size_bytes);
	if (!memory)
		return -ENOMEM;
	free(room->memory);
	room->memory = memory;
	room->size_bytes = size_bytes;
	return 0;
}

/* ---- zstd ---- */

static int zstd_encode(struct codec_scratch *scratch, int level, const void *data,
		       size_t data_bytes, void *stored, size_t stored_bytes_max,
		       size_t *ret_stored_bytes)
{
	size_t stored_bytes;

	if (!scratch->compress)
		scratch->compress = ZSTD_createCCtx();
	if (!scratch->compress)
		return -ENOMEM;
	stored_bytes = ZSTD_compressCCtx(scratch->compress, stored, stored_bytes_max, data,
					 data_bytes, level);
	if (ZSTD_isError(stored_bytes))
		return ZSTD_getErrorCode(stored_bytes) == ZSTD_error_memory_allocation ? -ENOMEM
										       : -ENOBUFS;
	*ret_stored_bytes = stored_bytes;
	return 0;
}

/* One frame and nothing behind it, of exactly data_bytes. */
static int zstd_decode(struct codec_scratch *scratch, const void *stored, size_t stored_bytes,
		       void *data, size_t data_bytes, struct why *why)
{
	size_t n;

	if (!scratch->decompress)
		scratch->decompress = ZSTD_createDCtx();
	if (!scratch->decompress)
		return why_set(why, -ENOMEM, "no memory for a zstd context");
	if (ZSTD_findFrameCompressedSize(stored, stored_bytes) != stored_bytes)
		return why_set(why, -EUCLEAN, "zstd: not one whole frame");
	n = ZSTD_decompressDCtx(scratch->decompress, data, data_bytes, stored, stored_bytes);
	if (ZSTD_isError(n))
		return why_set(why, -EUCLEAN, "zstd: %s", ZSTD_getErrorName(n));
	if (n != data_bytes)
		return why_set(why, -EUCLEAN, "zstd: %zu bytes, not %zu", n, data_bytes);
	return 0;
}

/* ---- meshopt: header and runs as they are, then each stream as its length and its code ---- */

static size_t words_of(const struct payload_header *header, const struct payload_stream *stream)
{
	uint64_t bytes = payload_stream_elements(header, stream->semantic) * stream->element_bytes;

	return bytes_round_up(bytes, WORD_BYTES) / WORD_BYTES;
}

/* A stream as the vertex codec sees it: elements of whole words. */
static void coded_shape(const struct payload_header *header, const struct payload_stream *stream,
			size_t *ret_count, size_t *ret_element_bytes)
{
	if (stream->element_bytes % WORD_BYTES == 0) {
		*ret_count = payload_stream_elements(header, stream->semantic);
		*ret_element_bytes = stream->element_bytes;
	} else {
		/* The payload's end is aligned further than a word, so the last one is inside it. */
		*ret_count = words_of(header, stream);
		*ret_element_bytes = WORD_BYTES;
	}
}

static size_t verbatim_bytes(const struct payload_header *header)
{
	return sizeof(*header) + (size_t)header->run_count * sizeof(struct payload_run);
}

size_t codec_bound(enum store_codec codec, size_t payload_bytes)
{
	/*
	 * The coders' own bounds without knowing the streams: at most 11 bytes for three 16-bit
	 * indices, 17 for three of 32 bits; vertices grow by a 64th and are rounded up to a block.
	 */
	size_t coded = payload_bytes * 2 + PAYLOAD_STREAM_MAX * 8192;

	switch (codec) {
	case STORE_CODEC_NONE:
		return payload_bytes;
	case STORE_CODEC_ZSTD:
		return ZSTD_compressBound(payload_bytes);
	case STORE_CODEC_MESHOPT:
		return coded;
	case STORE_CODEC_MESHOPT_ZSTD:
		return ZSTD_compressBound(coded);
	case STORE_CODEC_COUNT_:
		break;
	}
	return 0;
}

static int encode_indices(struct codec_scratch *scratch, const struct payload_header *header,
			  const struct payload_stream *stream, const void *array, uint8_t *out,
			  size_t out_bytes, size_t *ret_bytes)
{
	size_t count = (size_t)header->triangle_count * 3;
	const uint16_t *narrow = array;
	uint32_t *wide;
	int r;

	if (stream->format == PAYLOAD_U32) {
		*ret_bytes = meshopt_encodeIndexBuffer(out, out_bytes, array, count);
		return 0;
	}
	r = room_reserve(&scratch->indices, count * sizeof(*wide));
	if (r < 0)
		return r;
	wide = scratch->indices.memory;
	for (size_t i = 0; i < count; i++)
		wide[i] = narrow[i];
	*ret_bytes = meshopt_encodeIndexBuffer(out, out_bytes, wide, count);
	return 0;
}

static int encode_stream(struct codec_scratch *scratch, const struct payload_header *header,
			 const struct payload_stream *stream, uint8_t *out, size_t out_bytes,
			 size_t *ret_bytes)
{
	const void *array = (const uint8_t *)header + stream->offset_bytes;
	uint32_t coded_bytes;
	size_t count;
	size_t element_bytes;
	size_t n;
	int r;

	if (out_bytes <= sizeof(coded_bytes))
		return -ENOBUFS;
	if (stream->semantic == PAYLOAD_INDEX) {
		r = encode_indices(scratch, header, stream, array, out + sizeof(coded_bytes),
				   out_bytes - sizeof(coded_bytes), &n);
		if (r < 0)
			return r;
	} else {
		coded_shape(header, stream, &count, &element_bytes);
		n = meshopt_encodeVertexBuffer(out + sizeof(coded_bytes),
					       out_bytes - sizeof(coded_bytes), array, count,
					       element_bytes);
	}
	if (n == 0)
		return -ENOBUFS;
	CHECK(n <= UINT32_MAX);
	coded_bytes = (uint32_t)n;
	memcpy(out, &coded_bytes, sizeof(coded_bytes));
	*ret_bytes = sizeof(coded_bytes) + n;
	return 0;
}

static int meshopt_encode(struct codec_scratch *scratch, const struct payload_header *header,
			  uint8_t *out, size_t out_bytes, size_t *ret_bytes)
{
	size_t used = verbatim_bytes(header);
	int r;

	if (out_bytes < used)
		return -ENOBUFS;
	memcpy(out, header, used);
	for (unsigned i = 0; i < header->stream_count; i++) {
		size_t n;

		r = encode_stream(scratch, header, &header->streams[i], out + used,
				  out_bytes - used, &n);
		if (r < 0)
			return r;
		used += n;
	}
	*ret_bytes = used;
	return 0;
}

static int decode_stream(const struct payload_header *header, const struct payload_stream *stream,
			 uint8_t *payload, const uint8_t *coded, size_t coded_bytes)
{
	void *array = payload + stream->offset_bytes;
	size_t count;
	size_t element_bytes;

	if (stream->semantic == PAYLOAD_INDEX)
		return meshopt_decodeIndexBuffer(array, (size_t)header->triangle_count * 3,
						 stream->element_bytes, coded, coded_bytes);
	coded_shape(header, stream, &count, &element_bytes);
	return meshopt_decodeVertexBuffer(array, count, element_bytes, coded, coded_bytes);
}

/* Decoders write streams only, so that what lies between them has to be made zero. */
static void zero_pads(const struct payload_header *header, uint8_t *payload)
{
	size_t end = verbatim_bytes(header);

	for (unsigned i = 0; i < header->stream_count; i++) {
		const struct payload_stream *stream = &header->streams[i];

		memset(payload + end, 0, stream->offset_bytes - end);
		end = stream->offset_bytes +
		      payload_stream_elements(header, stream->semantic) * stream->element_bytes;
	}
	memset(payload + end, 0, header->payload_bytes - end);
}

static int meshopt_decode(const uint8_t *coded, size_t coded_bytes, uint8_t *payload,
			  size_t payload_bytes, struct why *why)
{
	struct payload_header header;
	size_t used;
	int r;

	if (coded_bytes < sizeof(header) || payload_bytes < sizeof(header))
		return why_set(why, -EUCLEAN, "meshopt: %zu bytes are too few", coded_bytes);
	memcpy(&header, coded, sizeof(header));
	/* The streams' places and lengths are all that the decoders below rely on. */
	r = payload_validate_header(&header, payload_bytes, why);
	if (r < 0)
		return r;
	used = verbatim_bytes(&header);
	if (coded_bytes < used)
		return why_set(why, -EUCLEAN, "meshopt: the runs are cut off");
	memcpy(payload, coded, used);
	for (unsigned i = 0; i < header.stream_count; i++) {
		uint32_t n;

		if (coded_bytes - used < sizeof(n))
			return why_set(why, -EUCLEAN, "meshopt: stream %u is cut off", i);
		memcpy(&n, coded + used, sizeof(n));
		used += sizeof(n);
		if (n > coded_bytes - used)
			return why_set(why, -EUCLEAN, "meshopt: stream %u is cut off", i);
		if (decode_stream(&header, &header.streams[i], payload, coded + used, n) != 0)
			return why_set(why, -EUCLEAN, "meshopt: stream %u is no code", i);
		used += n;
	}
	if (used != coded_bytes)
		return why_set(why, -EUCLEAN, "meshopt: %zu bytes too many", coded_bytes - used);
	zero_pads(&header, payload);
	return 0;
}

/* ---- all of them ---- */

int codec_encode(struct codec_scratch *scratch, enum store_codec codec, int level,
		 const void *payload, size_t payload_bytes, void *stored, size_t stored_bytes_max,
		 size_t *ret_stored_bytes)
{
	size_t coded_bytes;
	int r;

	switch (codec) {
	case STORE_CODEC_NONE:
		if (stored_bytes_max < payload_bytes)
			return -ENOBUFS;
		memcpy(stored, payload, payload_bytes);
		*ret_stored_bytes = payload_bytes;
		return 0;
	case STORE_CODEC_ZSTD:
		return zstd_encode(scratch, level, payload, payload_bytes, stored, stored_bytes_max,
				   ret_stored_bytes);
	case STORE_CODEC_MESHOPT:
		return meshopt_encode(scratch, payload, stored, stored_bytes_max, ret_stored_bytes);
	case STORE_CODEC_MESHOPT_ZSTD:
		r = room_reserve(&scratch->coded, codec_bound(STORE_CODEC_MESHOPT, payload_bytes));
		if (r == 0)
			r = meshopt_encode(scratch, payload, scratch->coded.memory,
					   scratch->coded.size_bytes, &coded_bytes);
		if (r == 0)
			r = zstd_encode(scratch, level, scratch->coded.memory, coded_bytes, stored,
					stored_bytes_max, ret_stored_bytes);
		return r;
	case STORE_CODEC_COUNT_:
		break;
	}
	CHECK(codec < STORE_CODEC_COUNT_);
	return -EINVAL;
}

static int meshopt_zstd_decode(struct codec_scratch *scratch, const void *stored,
			       size_t stored_bytes, void *payload, size_t payload_bytes,
			       struct why *why)
{
	unsigned long long coded_bytes = ZSTD_getFrameContentSize(stored, stored_bytes);
	int r;

	/* Also true for the two values that say "unknown" and "error". */
	if (coded_bytes > codec_bound(STORE_CODEC_MESHOPT, payload_bytes))
		return why_set(why, -EUCLEAN, "zstd: the frame's length cannot be");
	r = room_reserve(&scratch->coded, coded_bytes);
	if (r < 0)
		return why_set(why, r, "no memory to decode %llu bytes", coded_bytes);
	r = zstd_decode(scratch, stored, stored_bytes, scratch->coded.memory, coded_bytes, why);
	if (r < 0)
		return r;
	return meshopt_decode(scratch->coded.memory, coded_bytes, payload, payload_bytes, why);
}

int codec_decode(struct codec_scratch *scratch, enum store_codec codec, const void *stored,
		 size_t stored_bytes, void *payload, size_t payload_bytes, struct why *why)
{
	switch (codec) {
	case STORE_CODEC_ZSTD:
		return zstd_decode(scratch, stored, stored_bytes, payload, payload_bytes, why);
	case STORE_CODEC_MESHOPT:
		return meshopt_decode(stored, stored_bytes, payload, payload_bytes, why);
	case STORE_CODEC_MESHOPT_ZSTD:
		return meshopt_zstd_decode(scratch, stored, stored_bytes, payload, payload_bytes,
					   why);
	case STORE_CODEC_NONE:
	case STORE_CODEC_COUNT_:
		break;
	}
	return why_set(why, -EUCLEAN, "codec %u is unknown", codec);
}
