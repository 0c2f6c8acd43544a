/* SPDX-License-Identifier: MIT */
/**
 * layout.h - the bytes of a store: superblocks, HS records, names.
 *
 * formats/STORE.md is the specification and says what each field means; this header is the same in
 * C, and tests/unit/test_store_layout.c holds the two together.  Everything is little-endian, every
 * pad is zero, there are no pointers.  Payloads have a header of their own (payload_layout.h).
 *
 * This header is installed: viewers read HS records straight out of a mapping.
 */
#ifndef FORMATS_STORE_LAYOUT_H
#define FORMATS_STORE_LAYOUT_H

#include <assert.h>
#include <stdint.h>

#define STORE_MAGIC   "OOCSTORE"
#define STORE_VERSION 1u

/** Superblocks, extents and the HS begin at multiples of it, so that O_DIRECT can read them. */
#define STORE_BLOCK_BYTES         4096u
#define STORE_SUPERBLOCK_COUNT    2u
#define STORE_FIRST_EXTENT_OFFSET ((uint64_t)STORE_SUPERBLOCK_COUNT * STORE_BLOCK_BYTES)

#define STORE_NODE_NONE      UINT32_MAX
#define STORE_NODE_COUNT_MAX (UINT32_MAX - 1u)
/** Cells are subdivided at most this often: a cell coordinate has as many bits. */
#define STORE_LEVEL_MAX 21u
/** No decoded payload is larger, so that an arena's segment can hold any. */
#define STORE_PAYLOAD_BYTES_MAX (UINT32_C(64) << 20)
#define STORE_STEP_NONE         INT32_MIN
#define STORE_NAMES_BYTES_MAX   (UINT64_C(1) << 32)
/** HS records covered by one checksum: 64 KiB of them. */
#define STORE_HS_BLOCK_NODES 512u

enum store_codec {
	STORE_CODEC_NONE = 0,         /* the payload as it is drawn */
	STORE_CODEC_ZSTD = 1,         /* one zstd frame of it */
	STORE_CODEC_MESHOPT = 2,      /* vertex and index streams coded (codec.h) */
	STORE_CODEC_MESHOPT_ZSTD = 3, /* the same, then one zstd frame */
	STORE_CODEC_COUNT_
};

enum store_kind {
	STORE_KIND_NONE = 0, /* an inner node that has nothing of its own to draw */
	STORE_KIND_TRIANGLES = 1,
	STORE_KIND_TEXTURED = 2, /* reserved: triangles and an image */
	STORE_KIND_FACES = 3,    /* reserved: tetrahedra's faces, a scalar per vertex */
	STORE_KIND_VOXELS = 4,   /* reserved: splats */
	STORE_KIND_COUNT_
};

enum store_layout {
	STORE_LAYOUT_UNIQUE = 0,    /* each triangle in the one leaf whose cell holds its centre */
	STORE_LAYOUT_REPLICATE = 1, /* each triangle in every leaf whose cell it touches */
	STORE_LAYOUT_COUNT_
};

enum store_axis {
	STORE_AXIS_UNKNOWN = 0, /* viewers then take +Z */
	STORE_AXIS_X = 1,
	STORE_AXIS_Y = 2,
	STORE_AXIS_Z = 3,
	STORE_AXIS_COUNT_
};

/** A checksummed run of bytes in the file. */
struct store_extent {
	uint64_t file_offset;  /* a multiple of STORE_BLOCK_BYTES */
	uint64_t stored_bytes; /* length in the file; the rest of the last block is zero */
	uint64_t raw_bytes;    /* length once decoded */
	uint64_t checksum;     /* XXH3-64 of the stored bytes; the seed is the block's identity */
};

/** One of the two blocks at the head of the file.  The valid one with the higher generation counts. */
struct store_superblock {
	uint8_t magic[8];
	uint32_t version;
	uint32_t superblock_bytes; /* STORE_BLOCK_BYTES */
	uint8_t uuid[16];          /* made of the content: identical builds have identical uuids */
	uint64_t generation;       /* >= 1 */
	uint64_t file_bytes;       /* the file is at least this long */
	struct store_extent hs;    /* records, then one checksum for each STORE_HS_BLOCK_NODES */
	struct store_extent names; /* zstd frame; identity: the generation */

	uint64_t node_count;
	uint64_t leaf_count;
	uint64_t triangle_count; /* of all leaves: replicas count each */
	uint64_t vertex_count;   /* of all leaves */
	uint64_t part_count;
	uint64_t section_count;
	uint64_t payload_stored_bytes; /* of all extents of nodes */
	uint64_t payload_raw_bytes;    /* of all payloads decoded */
	uint64_t payload_id_next;      /* above every id in use or used before */
	uint64_t triangles_in;         /* of the model, before anything was dropped */
	uint32_t payload_bytes_max;    /* the largest decoded payload */
	uint32_t level_max;            /* of any node */

	double origin[3];      /* of the store's coordinates, in model units */
	double unit_metres;    /* one model unit in metres; 0: unknown */
	double error;          /* the bound asked for, model units; 0: positions are exact */
	double error_measured; /* the largest distance that a vertex was moved, model units */
	double root_min[3];    /* least corner of the root cell, model units from origin */
	double root_size;      /* edge of the root cell, a power of two, model units */
	double box_min[3];     /* of all vertices, model units from origin */
	double box_max[3];
	double crease_degrees; /* for the normals computed; negative: none were */
	int32_t step_exponent; /* positions are multiples of 2^it; STORE_STEP_NONE: raw floats */
	uint32_t up_axis;      /* enum store_axis */
	uint32_t layout;       /* enum store_layout */
	uint32_t leaf_triangles_max;
	uint32_t leaf_vertices_max;
	uint32_t reserved0;
	uint8_t producer[32]; /* program and version, NUL-padded */
	uint8_t reserved[STORE_BLOCK_BYTES - 400];
	uint64_t checksum; /* XXH3-64 of all bytes before; the seed is the slot, 0 or 1 */
};

/**
 * Directions of store_node.solidity, the six axes of an icosahedron, each over sqrt(1 + g * g):
 * (0,1,g) (0,-1,g) (1,g,0) (-1,g,0) (g,0,1) (g,0,-1).
 */
#define STORE_SOLIDITY_DIRECTIONS 6u
#define STORE_GOLDEN_RATIO        1.6180339887498949

/**
 * One node: what selection needs to know without the geometry.  Records lie breadth first, children
 * of a node side by side in Morton order, so a parent's index is less than its children's.  A store
 * has at least its root; only the root of a model without triangles has neither children nor payload.
 */
struct store_node {
	uint64_t payload_id;       /* stable across generations; 0: nothing to draw */
	uint64_t file_offset;      /* of the extent; 0 without payload */
	uint64_t payload_checksum; /* XXH3-64 of the stored bytes; the seed is payload_id */
	uint32_t stored_bytes;
	uint32_t payload_bytes; /* decoded */

	uint32_t parent;      /* STORE_NODE_NONE for the root, which is record 0 */
	uint32_t first_child; /* STORE_NODE_NONE for a leaf */
	uint8_t child_count;  /* 0..8; a cell without triangles has no record */
	uint8_t level;        /* of the cell: its edge is root_size / 2^level */
	uint8_t kind;         /* enum store_kind */
	uint8_t codec;        /* enum store_codec */
	uint32_t cell[3];     /* of the cell, in edges from root_min; < 2^level */

	uint32_t triangle_count;
	uint32_t vertex_count;
	float box_min[3]; /* tight, model units from origin, rounded outwards */
	float box_max[3];
	float error;        /* world distance from the original; 0 for a leaf */
	float parent_error; /* of the node drawn in its stead; infinity for the root */
	float sphere[4];    /* centre from origin and radius; holds all spheres below */
	float longest_edge; /* of its triangles */
	float area;         /* of its triangles */
	union {
		struct {
			int8_t mean_normal[2]; /* octahedral; 0,0 with area 0: none */
			/*
			 * 0..255: share of the cell's section that its triangles would cover, seen along
			 * each direction: 1 - exp(-projected area / edge^2).
			 */
			uint8_t solidity[STORE_SOLIDITY_DIRECTIONS];
		};
		float scalar_range[2]; /* STORE_KIND_FACES */
	};
};

/** Head of the decoded names block.  Tables follow in this order, then the strings. */
struct store_names_header {
	uint64_t section_count;
	uint64_t source_count;
	uint64_t part_count;
	uint64_t string_bytes; /* NUL-terminated UTF-8; offset 0 is the empty string */
};

/** One model file, or one row of a scene list. */
struct store_section {
	uint64_t name;   /* offsets into the strings */
	uint64_t source; /* index into the sources */
	uint64_t first_part;
	uint64_t part_count;
	double placement[12]; /* row-major 3x4, model to world; identity where there is none */
};

/** One model file. */
struct store_source {
	uint64_t path; /* as it was given */
};

/** What can be picked, hidden and searched by name: one material of one object of one section. */
struct store_part {
	uint64_t name;
	uint64_t scene_path; /* "a/b/c" in the file's scene graph; "" where it has none */
	uint64_t material;   /* its name */
	uint32_t section;
	uint32_t colour; /* 0xAABBGGRR: bytes r, g, b, a */
	uint64_t triangle_count;
};

static_assert(sizeof(struct store_extent) == 32, "an extent has 32 bytes");
static_assert(sizeof(struct store_superblock) == STORE_BLOCK_BYTES, "a superblock is one block");
static_assert(sizeof(struct store_node) == 128, "an HS record has 128 bytes");
static_assert(sizeof(struct store_names_header) == 32, "no hidden padding");
static_assert(sizeof(struct store_section) == 128, "no hidden padding");
static_assert(sizeof(struct store_part) == 40, "no hidden padding");

/**
 * Position of a cell on the Morton curve of its level: bit 3i is bit i of x, 3i+1 of y, 3i+2 of z.
 * Each coordinate has at most STORE_LEVEL_MAX bits.
 */
uint64_t store_morton(uint32_t x, uint32_t y, uint32_t z);

#endif /* FORMATS_STORE_LAYOUT_H */
