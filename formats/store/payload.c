/* SPDX-License-Identifier: MIT */
#include "formats/store/payload.h"

#include <errno.h>
#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"

/** A payload ends at a multiple of it, so that the last element can be read as a whole vector. */
#define PAYLOAD_END_ALIGN_BYTES 16u
/** Vertices judged with one branch, so that the compiler takes several at a time. */
#define JUDGED_AT_ONCE 32u
/** A run's number has 16 bits in the small position format. */
#define PAYLOAD_U16_RUN_MAX          65536u
#define PAYLOAD_U16_INDEX_VERTEX_MAX 65536u

/** What a format is: its semantic, the length of an element. */
struct format_info {
	uint8_t semantic;
	uint8_t element_bytes;
};

static const struct format_info format_infos[PAYLOAD_FORMAT_COUNT_] = {
	[PAYLOAD_U16] = { PAYLOAD_INDEX, 2 },
	[PAYLOAD_U32] = { PAYLOAD_INDEX, 4 },
	[PAYLOAD_U16X3_RUN] = { PAYLOAD_POSITION, 8 },
	[PAYLOAD_F32X3_RUN] = { PAYLOAD_POSITION, 16 },
	[PAYLOAD_OCT8] = { PAYLOAD_NORMAL, 2 },
	[PAYLOAD_OCT16] = { PAYLOAD_NORMAL, 4 },
	[PAYLOAD_RGBA8] = { PAYLOAD_COLOUR, 4 },
	[PAYLOAD_U64] = { PAYLOAD_TRIANGLE_ID, 8 },
};

/** An element of each position format, as it lies. */
struct position_u16 {
	uint16_t xyz[3];
	uint16_t run;
};

struct position_f32 {
	float xyz[3];
	uint32_t run;
};

uint64_t payload_stream_elements(const struct payload_header *header, unsigned semantic)
{
	switch ((enum payload_semantic)semantic) {
	case PAYLOAD_INDEX:
		return (uint64_t)header->triangle_count * 3;
	case PAYLOAD_POSITION:
	case PAYLOAD_NORMAL:
	case PAYLOAD_COLOUR:
		return header->vertex_count;
	case PAYLOAD_TRIANGLE_ID:
		return header->triangle_count;
	case PAYLOAD_SEMANTIC_COUNT_:
		break;
	}
	return 0;
}

/* Where the run table ends; the counts are 32-bit, so that nothing here can overflow 64 bits. */
static uint64_t runs_end(const struct payload_header *header)
{
	return sizeof(*header) + (uint64_t)header->run_count * sizeof(struct payload_run);
}

static uint64_t stream_bytes(const struct payload_header *header,
			     const struct payload_stream *stream)
{
	return payload_stream_elements(header, stream->semantic) * stream->element_bytes;
}

/* ---- making ---- */

/* Fills the table of streams and returns where the last one ends. */
static uint64_t place_streams(const struct payload_content *content, struct payload_header *header)
{
	uint32_t index_format =
		content->vertex_count <= PAYLOAD_U16_INDEX_VERTEX_MAX ? PAYLOAD_U16 : PAYLOAD_U32;
	const uint32_t formats[] = {
		index_format,
		content->position_format,
		content->normals ? content->normal_format : 0,
		content->colours ? PAYLOAD_RGBA8 : 0,
		content->triangle_ids ? PAYLOAD_U64 : 0,
	};
	uint64_t end = runs_end(header);

	for (size_t i = 0; i < ARRAY_LENGTH(formats); i++) {
		const struct format_info *info = &format_infos[formats[i]];
		struct payload_stream *stream = &header->streams[header->stream_count];
		uint64_t begin = bytes_round_up(end, PAYLOAD_ALIGN_BYTES);

		if (formats[i] == 0)
			continue;
		stream->semantic = info->semantic;
		stream->format = (uint8_t)formats[i];
		stream->element_bytes = info->element_bytes;
		/* Beyond 32 bits the payload is refused as a whole, and this offset never read. */
		stream->offset_bytes = (uint32_t)begin;
		end = begin + stream_bytes(header, stream);
		header->stream_count++;
	}
	return end;
}

/* Returns the payload's length, which may be above the limit. */
static uint64_t make_header(const struct payload_content *content, struct payload_header *ret)
{
	uint64_t payload_bytes;

	CHECK(content->position_format == PAYLOAD_U16X3_RUN ||
	      content->position_format == PAYLOAD_F32X3_RUN);
	CHECK(!content->normals || content->normal_format == PAYLOAD_OCT8 ||
	      content->normal_format == PAYLOAD_OCT16);
	memset(ret, 0, sizeof(*ret));
	ret->magic = PAYLOAD_MAGIC;
	ret->kind = (uint8_t)content->kind;
	ret->payload_id = content->payload_id;
	ret->vertex_count = content->vertex_count;
	ret->triangle_count = content->triangle_count;
	ret->run_count = content->run_count;
	ret->runs_offset_bytes = sizeof(*ret);
	memcpy(ret->origin, content->origin, sizeof(ret->origin));
	ret->scale = content->scale;
	payload_bytes = bytes_round_up(place_streams(content, ret), PAYLOAD_END_ALIGN_BYTES);
	ret->payload_bytes = (uint32_t)payload_bytes;
	return payload_bytes;
}

int payload_size(const struct payload_content *content, uint32_t *ret_bytes)
{
	struct payload_header header;
	uint64_t payload_bytes = make_header(content, &header);

	if (payload_bytes > STORE_PAYLOAD_BYTES_MAX)
		return -EOVERFLOW;
	*ret_bytes = (uint32_t)payload_bytes;
	return 0;
}

static void write_indices(const struct payload_content *content, uint8_t format, void *out)
{
	size_t count = (size_t)content->triangle_count * 3;
	uint16_t *narrow = out;

	if (format == PAYLOAD_U32) {
		memcpy(out, content->indices, count * sizeof(uint32_t));
		return;
	}
	for (size_t i = 0; i < count; i++)
		narrow[i] = (uint16_t)content->indices[i];
}

void payload_write(const struct payload_content *content, void *payload)
{
	struct payload_header header;
	uint64_t payload_bytes = make_header(content, &header);
	uint8_t *bytes = payload;

	CHECK(payload_bytes <= STORE_PAYLOAD_BYTES_MAX);
	memset(bytes, 0, payload_bytes);
	memcpy(bytes, &header, sizeof(header));
	memcpy(bytes + header.runs_offset_bytes, content->runs,
	       content->run_count * sizeof(struct payload_run));
	for (unsigned i = 0; i < header.stream_count; i++) {
		const struct payload_stream *stream = &header.streams[i];
		const void *const sources[PAYLOAD_SEMANTIC_COUNT_] = {
			[PAYLOAD_POSITION] = content->positions,
			[PAYLOAD_NORMAL] = content->normals,
			[PAYLOAD_COLOUR] = content->colours,
			[PAYLOAD_TRIANGLE_ID] = content->triangle_ids,
		};
		uint8_t *out = bytes + stream->offset_bytes;

		if (stream->semantic == PAYLOAD_INDEX)
			write_indices(content, stream->format, out);
		else
			memcpy(out, sources[stream->semantic], stream_bytes(&header, stream));
	}
}

/* ---- judging ---- */

static bool is_power_of_two(double value)
{
	int exponent;

	return isfinite(value) && value > 0 && frexp(value, &exponent) == 0.5;
}

static int judge_fields(const struct payload_header *header, size_t payload_bytes, struct why *why)
{
	if (header->magic != PAYLOAD_MAGIC)
		return why_set(why, -EUCLEAN, "payload: magic is %08x", header->magic);
	if (header->kind != STORE_KIND_TRIANGLES)
		return why_set(why, -EUCLEAN, "payload: kind %u is unknown", header->kind);
	if (header->payload_id == 0)
		return why_set(why, -EUCLEAN, "payload: id is 0");
	if (header->payload_bytes != payload_bytes)
		return why_set(why, -EUCLEAN, "payload: says %u bytes and has %zu",
			       header->payload_bytes, payload_bytes);
	if (header->vertex_count == 0 || header->triangle_count == 0 || header->run_count == 0 ||
	    header->run_count > header->triangle_count)
		return why_set(why, -EUCLEAN, "payload: %u vertices, %u triangles in %u runs",
			       header->vertex_count, header->triangle_count, header->run_count);
	if (header->runs_offset_bytes != sizeof(*header))
		return why_set(why, -EUCLEAN, "payload: runs at byte %u, not behind the header",
			       header->runs_offset_bytes);
	for (unsigned axis = 0; axis < 3; axis++)
		if (!isfinite(header->origin[axis]))
			return why_set(why, -EUCLEAN, "payload: origin is not finite");
	if (!is_power_of_two(header->scale))
		return why_set(why, -EUCLEAN, "payload: scale is no power of two");
	if (header->reserved0 != 0 || header->reserved1 != 0 ||
	    !bytes_are_zero(header->reserved, sizeof(header->reserved)))
		return why_set(why, -EUCLEAN, "payload: reserved bytes are not zero");
	return 0;
}

static int judge_stream(const struct payload_header *header, const struct payload_stream *stream,
			unsigned semantic_before, struct why *why)
{
	const struct format_info *info;

	if (stream->format == 0 || stream->format >= PAYLOAD_FORMAT_COUNT_)
		return why_set(why, -EUCLEAN, "payload: stream format %u is unknown",
			       stream->format);
	info = &format_infos[stream->format];
	if (stream->semantic != info->semantic || stream->element_bytes != info->element_bytes)
		return why_set(why, -EUCLEAN, "payload: format %u cannot be of stream %u",
			       stream->format, stream->semantic);
	if (stream->semantic <= semantic_before)
		return why_set(why, -EUCLEAN, "payload: streams are not in order");
	if (stream->format == PAYLOAD_U16 && header->vertex_count > PAYLOAD_U16_INDEX_VERTEX_MAX)
		return why_set(why, -EUCLEAN, "payload: 16-bit indices of %u vertices",
			       header->vertex_count);
	if (stream->format == PAYLOAD_U16X3_RUN && header->run_count > PAYLOAD_U16_RUN_MAX)
		return why_set(why, -EUCLEAN, "payload: 16-bit run numbers of %u runs",
			       header->run_count);
	return 0;
}

int payload_validate_header(const struct payload_header *header, size_t payload_bytes,
			    struct why *why)
{
	unsigned semantics_seen = 0;
	unsigned semantic_before = 0;
	uint64_t end;
	int r;

	r = judge_fields(header, payload_bytes, why);
	if (r < 0)
		return r;
	if (header->stream_count > PAYLOAD_STREAM_MAX)
		return why_set(why, -EUCLEAN, "payload: %u streams", header->stream_count);
	end = runs_end(header);
	for (unsigned i = 0; i < header->stream_count; i++) {
		const struct payload_stream *stream = &header->streams[i];
		uint64_t begin = bytes_round_up(end, PAYLOAD_ALIGN_BYTES);

		r = judge_stream(header, stream, semantic_before, why);
		if (r < 0)
			return r;
		/* One place only, so that streams can neither overlap nor leave the payload. */
		if (stream->offset_bytes != begin)
			return why_set(why, -EUCLEAN, "payload: stream %u at byte %u, not %llu",
				       stream->semantic, stream->offset_bytes,
				       (unsigned long long)begin);
		end = begin + stream_bytes(header, stream);
		semantic_before = stream->semantic;
		semantics_seen |= 1u << stream->semantic;
	}
	if ((semantics_seen & 1u << PAYLOAD_INDEX) == 0 ||
	    (semantics_seen & 1u << PAYLOAD_POSITION) == 0)
		return why_set(why, -EUCLEAN, "payload: no indices or no positions");
	if (!bytes_are_zero(&header->streams[header->stream_count],
			    (PAYLOAD_STREAM_MAX - header->stream_count) *
				    sizeof(struct payload_stream)))
		return why_set(why, -EUCLEAN, "payload: unused streams are not zero");
	if (bytes_round_up(end, PAYLOAD_END_ALIGN_BYTES) != payload_bytes)
		return why_set(why, -EUCLEAN, "payload: streams end at byte %llu of %zu",
			       (unsigned long long)end, payload_bytes);
	return 0;
}

static int judge_pads(const uint8_t *bytes, const struct payload_header *header, struct why *why)
{
	uint64_t end = runs_end(header);

	for (unsigned i = 0; i <= header->stream_count; i++) {
		const struct payload_stream *stream = &header->streams[i];
		bool is_last = i == header->stream_count;
		uint64_t begin = is_last ? header->payload_bytes : stream->offset_bytes;

		if (!bytes_are_zero(bytes + end, begin - end))
			return why_set(why, -EUCLEAN, "payload: pad at byte %llu is not zero",
				       (unsigned long long)end);
		if (!is_last)
			end = begin + stream_bytes(header, stream);
	}
	return 0;
}

static int judge_runs(const struct payload_view *view, struct why *why)
{
	const struct payload_header *header = view->header;

	for (uint32_t i = 0; i < header->run_count; i++) {
		uint32_t first = view->runs[i].first_triangle;

		if (i == 0 ? first != 0
			   : first <= view->runs[i - 1].first_triangle ||
				     first >= header->triangle_count)
			return why_set(why, -EUCLEAN, "payload: run %u begins at triangle %u of %u",
				       i, first, header->triangle_count);
	}
	return 0;
}

uint32_t payload_vertex_run(const struct payload_view *view, uint32_t vertex)
{
	if (view->position_format == PAYLOAD_U16X3_RUN)
		return ((const struct position_u16 *)view->positions)[vertex].run;
	return ((const struct position_f32 *)view->positions)[vertex].run;
}

static int judge_positions(const struct payload_view *view, struct why *why)
{
	const struct position_f32 *positions = view->positions;
	uint32_t vertex_count = view->header->vertex_count;

	if (view->position_format != PAYLOAD_F32X3_RUN)
		return 0;
	for (uint32_t begin = 0; begin < vertex_count; begin += JUDGED_AT_ONCE) {
		uint32_t end = (uint32_t)u64_min((uint64_t)begin + JUDGED_AT_ONCE, vertex_count);
		bool finite = true;

		for (uint32_t i = begin; i < end; i++)
			for (unsigned axis = 0; axis < 3; axis++)
				finite &= fabsf(positions[i].xyz[axis]) <= FLT_MAX;
		if (!finite)
			return why_set(why, -EUCLEAN,
				       "payload: a vertex from %u to %u is not finite", begin,
				       end - 1);
	}
	return 0;
}

/*
 * The two loops that see most of a payload's bytes are compiled twice, for every processor and for
 * those with AVX2, which takes twice as many numbers at a time: see JUDGE_WIDE below.
 */
#define JUDGE_INLINE static inline __attribute__((always_inline))

/* The first vertex from `vertex` on, below vertex_count, that is not of this run. */
JUDGE_INLINE uint32_t vertices_end_u16(const struct position_u16 *positions, uint32_t vertex,
				       uint32_t vertex_count, uint32_t run)
{
	while (vertex_count - vertex >= JUDGED_AT_ONCE) {
		const struct position_u16 *some = positions + vertex;
		uint64_t differ = 0;

		/* A size_t, that cannot wrap round: else the compiler gathers them one by one. */
		for (size_t i = 0; i < JUDGED_AT_ONCE; i++) {
			uint64_t word;

			/* The run is the upper quarter. */
			memcpy(&word, &some[i], sizeof(word));
			differ |= word ^ (uint64_t)run << 48;
		}
		if (differ >> 48 != 0)
			break;
		vertex += JUDGED_AT_ONCE;
	}
	while (vertex < vertex_count && positions[vertex].run == run)
		vertex++;
	return vertex;
}

/* The least and the largest of count > 0 indices. */
JUDGE_INLINE void index_range_u16(const uint16_t *indices, size_t count, uint32_t *ret_min,
				  uint32_t *ret_max)
{
	int16_t least = INT16_MAX;
	int16_t largest = INT16_MIN;

	/* Moved to signed numbers, for which SSE2 has a minimum and a maximum. */
	for (size_t i = 0; i < count; i++) {
		int16_t index = (int16_t)(indices[i] ^ 0x8000);

		least = index < least ? index : least;
		largest = index > largest ? index : largest;
	}
	*ret_min = (uint16_t)least ^ 0x8000u;
	*ret_max = (uint16_t)largest ^ 0x8000u;
}

#ifdef __x86_64__
#define JUDGE_WIDE __attribute__((target("avx2")))

JUDGE_WIDE static uint32_t vertices_end_wide(const struct position_u16 *positions, uint32_t vertex,
					     uint32_t vertex_count, uint32_t run)
{
	return vertices_end_u16(positions, vertex, vertex_count, run);
}

JUDGE_WIDE static void index_range_wide(const uint16_t *indices, size_t count, uint32_t *ret_min,
					uint32_t *ret_max)
{
	index_range_u16(indices, count, ret_min, ret_max);
}

static bool is_wide(void)
{
	return __builtin_cpu_supports("avx2");
}
#else
#define vertices_end_wide vertices_end_u16
#define index_range_wide  index_range_u16

static bool is_wide(void)
{
	return false;
}
#endif

static uint32_t vertices_end(const struct payload_view *view, uint32_t vertex, uint32_t run)
{
	uint32_t vertex_count = view->header->vertex_count;
	const struct position_f32 *positions = view->positions;

	/* It has 16 bits there. */
	if (view->position_format == PAYLOAD_U16X3_RUN)
		return is_wide() ? vertices_end_wide(view->positions, vertex, vertex_count, run)
				 : vertices_end_u16(view->positions, vertex, vertex_count, run);
	while (vertex < vertex_count && positions[vertex].run == run)
		vertex++;
	return vertex;
}

/* The least and the largest index of triangles [first, end), of which there is one at least. */
static void index_range(const struct payload_view *view, uint32_t first, uint32_t end,
			uint32_t *ret_min, uint32_t *ret_max)
{
	size_t begin = (size_t)first * 3;
	size_t count = (size_t)(end - first) * 3;
	const uint32_t *indices = (const uint32_t *)view->indices + begin;
	uint32_t least = UINT32_MAX;
	uint32_t largest = 0;

	if (view->index_format == PAYLOAD_U16) {
		const uint16_t *narrow = (const uint16_t *)view->indices + begin;

		if (is_wide())
			index_range_wide(narrow, count, ret_min, ret_max);
		else
			index_range_u16(narrow, count, ret_min, ret_max);
		return;
	}
	for (size_t i = 0; i < count; i++) {
		least = indices[i] < least ? indices[i] : least;
		largest = indices[i] > largest ? indices[i] : largest;
	}
	*ret_min = least;
	*ret_max = largest;
}

/*
 * Vertices lie run after run, so that "each corner is a vertex of its triangle's run" is one
 * comparison of ranges for each run, and not a look-up for each corner.
 */
static int judge_indices(const struct payload_view *view, struct why *why)
{
	const struct payload_header *header = view->header;
	uint32_t vertex = 0;

	for (uint32_t run = 0; run < header->run_count; run++) {
		uint32_t triangle_end = run + 1 < header->run_count
						? view->runs[run + 1].first_triangle
						: header->triangle_count;
		uint32_t vertex_first = vertex;
		uint32_t least;
		uint32_t largest;

		vertex = vertices_end(view, vertex, run);
		index_range(view, view->runs[run].first_triangle, triangle_end, &least, &largest);
		if (least < vertex_first || largest >= vertex)
			return why_set(
				why, -EUCLEAN,
				"payload: run %u has vertices from %u, below %u, and indices %u to %u",
				run, vertex_first, vertex, least, largest);
	}
	if (vertex != header->vertex_count)
		return why_set(why, -EUCLEAN,
			       "payload: vertex %u is of run %u, which is out of order", vertex,
			       payload_vertex_run(view, vertex));
	return 0;
}

static int judge_node(const struct payload_header *header, const struct store_node *node,
		      struct why *why)
{
	if (header->payload_id != node->payload_id)
		return why_set(why, -EUCLEAN, "payload: is %llu, not %llu",
			       (unsigned long long)header->payload_id,
			       (unsigned long long)node->payload_id);
	if (header->kind != node->kind || header->payload_bytes != node->payload_bytes ||
	    header->triangle_count != node->triangle_count ||
	    header->vertex_count != node->vertex_count)
		return why_set(
			why, -EUCLEAN,
			"payload: %u bytes, %u triangles, %u vertices; its record says %u, %u, %u",
			header->payload_bytes, header->triangle_count, header->vertex_count,
			node->payload_bytes, node->triangle_count, node->vertex_count);
	return 0;
}

int payload_validate(const void *payload, size_t payload_bytes, const struct store_node *node,
		     struct why *why)
{
	struct payload_view view;
	int r;

	if (payload_bytes < sizeof(struct payload_header) ||
	    payload_bytes > STORE_PAYLOAD_BYTES_MAX)
		return why_set(why, -EUCLEAN, "payload: %zu bytes", payload_bytes);
	r = payload_validate_header(payload, payload_bytes, why);
	if (r == 0 && node)
		r = judge_node(payload, node, why);
	if (r < 0)
		return r;
	payload_view(payload, &view);
	r = judge_pads(payload, view.header, why);
	if (r == 0)
		r = judge_runs(&view, why);
	if (r == 0)
		r = judge_positions(&view, why);
	if (r == 0)
		r = judge_indices(&view, why);
	return r;
}

/* ---- reading ---- */

void payload_view(const void *payload, struct payload_view *ret)
{
	const struct payload_header *header = payload;
	const uint8_t *bytes = payload;

	memset(ret, 0, sizeof(*ret));
	ret->header = header;
	ret->runs = (const void *)(bytes + header->runs_offset_bytes);
	for (unsigned i = 0; i < header->stream_count; i++) {
		const struct payload_stream *stream = &header->streams[i];
		const void *array = bytes + stream->offset_bytes;

		switch ((enum payload_semantic)stream->semantic) {
		case PAYLOAD_INDEX:
			ret->indices = array;
			ret->index_format = stream->format;
			break;
		case PAYLOAD_POSITION:
			ret->positions = array;
			ret->position_format = stream->format;
			break;
		case PAYLOAD_NORMAL:
			ret->normals = array;
			ret->normal_format = stream->format;
			break;
		case PAYLOAD_COLOUR:
			ret->colours = array;
			break;
		case PAYLOAD_TRIANGLE_ID:
			ret->triangle_ids = array;
			break;
		case PAYLOAD_SEMANTIC_COUNT_:
			break;
		}
	}
}

uint32_t payload_index(const struct payload_view *view, uint32_t triangle, uint32_t corner)
{
	size_t at = (size_t)triangle * 3 + corner;

	if (view->index_format == PAYLOAD_U16)
		return ((const uint16_t *)view->indices)[at];
	return ((const uint32_t *)view->indices)[at];
}

/* An origin of 0 is not added: -0 stays -0, and a float comes back with all its bits. */
static double from_origin(double origin, double offset)
{
	return origin == 0 ? offset : origin + offset;
}

void payload_position(const struct payload_view *view, uint32_t vertex, double ret[3])
{
	const struct payload_header *header = view->header;

	for (unsigned axis = 0; axis < 3; axis++) {
		double coordinate =
			view->position_format == PAYLOAD_U16X3_RUN
				? ((const struct position_u16 *)view->positions)[vertex].xyz[axis]
				: (double)((const struct position_f32 *)view->positions)[vertex]
					  .xyz[axis];

		ret[axis] = from_origin(header->origin[axis], header->scale * coordinate);
	}
}
