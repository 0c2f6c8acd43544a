/* SPDX-License-Identifier: MIT */
/**
 * payload_layout.h - the bytes of a decoded payload, drawable as they lie.
 *
 * A payload is one header, a table of runs, then arrays ("streams") as the GPU takes them.  All
 * offsets are from the payload's first byte, which lies on a page border in the arena.
 * formats/STORE.md, "Payloads", is the specification.
 *
 *	header | runs | INDEX | POSITION | NORMAL | COLOUR | TRIANGLE_ID | zeros to the end
 *
 * World position of vertex v:
 *	superblock.origin + header.origin + header.scale * POSITION[v]        (in double: exact)
 * scale is a power of two, so scale * POSITION is exact in float as well.
 *
 * This header is installed: viewers draw from it.
 */
#ifndef FORMATS_STORE_PAYLOAD_LAYOUT_H
#define FORMATS_STORE_PAYLOAD_LAYOUT_H

#include <assert.h>
#include <stdint.h>

#define PAYLOAD_MAGIC      UINT32_C(0x31504f4f) /* "OOP1" */
#define PAYLOAD_STREAM_MAX 8u
/** Runs and streams begin at multiples of it: what GL asks of a buffer binding. */
#define PAYLOAD_ALIGN_BYTES 256u

enum payload_semantic {
	PAYLOAD_INDEX = 1,       /* three a triangle, each < vertex_count */
	PAYLOAD_POSITION = 2,    /* and the vertex's run, which all its triangles share */
	PAYLOAD_NORMAL = 3,      /* absent: derived per triangle when drawing */
	PAYLOAD_COLOUR = 4,      /* absent: the run's colour */
	PAYLOAD_TRIANGLE_ID = 5, /* ordinal in the model, counting from 0; only with --keep-ids */
	PAYLOAD_SEMANTIC_COUNT_
};

enum payload_format {
	PAYLOAD_U16 = 1,       /* INDEX:       uint16_t, 2 bytes */
	PAYLOAD_U32 = 2,       /* INDEX:       uint32_t, 4 bytes */
	PAYLOAD_U16X3_RUN = 3, /* POSITION:    uint16_t x, y, z, run; 8 bytes */
	PAYLOAD_F32X3_RUN = 4, /* POSITION:    float x, y, z, uint32_t run; 16 bytes */
	PAYLOAD_OCT8 = 5,      /* NORMAL:      int8_t u, v, octahedral; 2 bytes */
	PAYLOAD_OCT16 = 6,     /* NORMAL:      int16_t u, v, octahedral; 4 bytes */
	PAYLOAD_RGBA8 = 7,     /* COLOUR:      uint8_t r, g, b, a, sRGB; 4 bytes */
	PAYLOAD_U64 = 8,       /* TRIANGLE_ID: uint64_t, 8 bytes */
	PAYLOAD_FORMAT_COUNT_
};

/** One array.  Its length is element_bytes times the triangles' corners, vertices or triangles. */
struct payload_stream {
	uint8_t semantic; /* enum payload_semantic; each at most once, in ascending order */
	uint8_t format;   /* enum payload_format */
	uint16_t element_bytes;
	uint32_t offset_bytes; /* the first multiple of PAYLOAD_ALIGN_BYTES behind what is before */
};

/**
 * Triangles first_triangle .. the next run's first_triangle - 1 belong to one part.  No vertex is
 * shared by two runs, and the vertices lie in the order of their runs.
 */
struct payload_run {
	uint32_t part; /* index into the names block */
	uint32_t section;
	uint32_t first_triangle; /* strictly ascending; the first run's is 0 */
	uint32_t colour;         /* of its triangles where there is no COLOUR, 0xAABBGGRR */
};

struct payload_header {
	uint32_t magic;
	uint8_t kind; /* enum store_kind, as in the HS record */
	uint8_t stream_count;
	uint16_t reserved0;
	uint64_t payload_id; /* as in the HS record */
	uint32_t payload_bytes;
	uint32_t vertex_count;
	uint32_t triangle_count;
	uint32_t run_count;
	uint32_t runs_offset_bytes;
	uint32_t reserved1;
	double origin[3]; /* from superblock.origin, model units */
	double scale;     /* a power of two, model units */
	struct payload_stream streams[PAYLOAD_STREAM_MAX];
	uint8_t reserved[120];
};

static_assert(sizeof(struct payload_stream) == 8, "a stream has 8 bytes");
static_assert(sizeof(struct payload_run) == 16, "a run is one vec4 to a shader");
static_assert(sizeof(struct payload_header) == PAYLOAD_ALIGN_BYTES, "runs follow the header");

#endif /* FORMATS_STORE_PAYLOAD_LAYOUT_H */
