/* SPDX-License-Identifier: MIT */
/**
 * payload.h - a decoded payload as arrays: made, judged and read.
 *
 * It does no I/O, decodes nothing (codec.h) and draws nothing.
 *
 * Threads: any; pure functions of their arguments.
 */
#ifndef FORMATS_STORE_PAYLOAD_H
#define FORMATS_STORE_PAYLOAD_H

#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "formats/store/layout.h"
#include "formats/store/payload_layout.h"

/** What a payload is made of.  Pointers to streams that it shall not have are NULL. */
struct payload_content {
	uint64_t payload_id;
	uint32_t kind;
	uint32_t vertex_count;
	uint32_t triangle_count;
	uint32_t run_count;
	uint32_t position_format; /* PAYLOAD_U16X3_RUN or PAYLOAD_F32X3_RUN */
	uint32_t normal_format;   /* PAYLOAD_OCT8 or PAYLOAD_OCT16, if normals */
	double origin[3];
	double scale;
	const struct payload_run *runs; /* run_count; vertices lie in the order of their runs */
	const uint32_t *indices;        /* triangle_count x 3, stored as 16 bits where they fit */
	const void *positions;          /* vertex_count x 8 or 16 bytes */
	const void *normals;            /* vertex_count x 2 or 4 bytes */
	const uint32_t *colours;        /* vertex_count */
	const uint64_t *triangle_ids;   /* triangle_count */
};

/** Length of the payload, a multiple of 16 bytes; -EOVERFLOW above STORE_PAYLOAD_BYTES_MAX. */
int payload_size(const struct payload_content *content, uint32_t *ret_bytes);

/** Writes the payload into payload_size() bytes; every pad is zero. */
void payload_write(const struct payload_content *content, void *payload);

/** A payload's arrays, found once.  Pointers point into the payload; absent streams are NULL. */
struct payload_view {
	const struct payload_header *header;
	const struct payload_run *runs;
	const void *indices;
	const void *positions;
	const void *normals;
	const uint8_t *colours;
	const uint64_t *triangle_ids;
	uint8_t index_format;
	uint8_t position_format;
	uint8_t normal_format;
};

/**
 * Judges a decoded payload as a whole, so that whoever draws it needs no check: header, streams
 * at their places, pads zero, runs ascending, vertices in the order of their runs, indices inside
 * their run's vertices, floats finite, counts and id as the HS record says.  Part and section of a
 * run are numbers of the names block, which is not known here: whoever looks them up compares.
 *
 * payload:  16-byte aligned, payload_bytes long.
 * node:     its record, or NULL to judge the payload alone.
 *
 * Returns: 0, or -EUCLEAN with the reason.
 * Cost: one pass over indices and positions.
 */
int payload_validate(const void *payload, size_t payload_bytes, const struct store_node *node,
		     struct why *why);

/**
 * The part of payload_validate() that looks at the header alone: whoever has judged it may write
 * the streams at their places in payload_bytes.  For decoders.
 *
 * header:  8-byte aligned, with the whole header's bytes.
 *
 * Returns: 0, or -EUCLEAN with the reason.
 */
int payload_validate_header(const struct payload_header *header, size_t payload_bytes,
			    struct why *why);

/** How many elements a stream of this semantic has: corners, vertices or triangles. */
uint64_t payload_stream_elements(const struct payload_header *header, unsigned semantic);

/** Finds the arrays of a payload that payload_validate() has passed. */
void payload_view(const void *payload, struct payload_view *ret);

/** Corner 0..2 of a triangle: the vertex's index. */
uint32_t payload_index(const struct payload_view *view, uint32_t triangle, uint32_t corner);

/** Position of a vertex, model units from the store's origin, exact; -0 stays -0. */
void payload_position(const struct payload_view *view, uint32_t vertex, double ret[3]);

/** The run that a vertex belongs to. */
uint32_t payload_vertex_run(const struct payload_view *view, uint32_t vertex);

/** Octahedral unit vectors (Cigolle et al. 2014, "A Survey of Efficient Representations"). */
void payload_encode_oct16(const float normal[3], int16_t ret[2]);
void payload_encode_oct8(const float normal[3], int8_t ret[2]);
void payload_decode_oct16(const int16_t coded[2], float ret[3]);
void payload_decode_oct8(const int8_t coded[2], float ret[3]);

#endif /* FORMATS_STORE_PAYLOAD_H */
