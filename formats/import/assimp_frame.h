/* SPDX-License-Identifier: MIT */
/**
 * assimp_frame.h - what oocimport-assimp writes on its standard output.
 *
 * Frames, each a header and a body: INFO once, PART and BATCH in any mixture, then END; or ERROR at
 * any place, which is the last.  The process may die at any byte, and what it says may be wrong:
 * the reader checks lengths, numbers, order and sums.
 */
#ifndef FORMATS_IMPORT_ASSIMP_FRAME_H
#define FORMATS_IMPORT_ASSIMP_FRAME_H

#include <stdint.h>

#include "formats/import/import.h"

#define ASSIMP_FRAME_MAGIC    UINT32_C(0x46504d49)
#define ASSIMP_TEXT_BYTES_MAX 1024u

enum assimp_frame_kind {
	ASSIMP_FRAME_INFO = 1,
	ASSIMP_FRAME_PART = 2,
	ASSIMP_FRAME_BATCH = 3,
	ASSIMP_FRAME_END = 4,
	ASSIMP_FRAME_ERROR = 5,
};

struct assimp_frame_header {
	uint32_t magic;
	uint32_t kind;
	uint32_t number; /* of the frame, from 0 */
	uint32_t body_bytes;
};

struct assimp_info {
	double unit_metres;
	uint32_t up_axis;
	uint32_t positions_double; /* 0 or 1, for all batches */
};

/** Followed by the three texts, without zeros. */
struct assimp_part {
	uint32_t colour;
	uint32_t name_bytes;
	uint32_t scene_path_bytes;
	uint32_t material_bytes;
};

#define ASSIMP_BATCH_NORMALS 1u
#define ASSIMP_BATCH_COLOURS 2u

/** Followed by positions, normals if any, colours if any, as in struct import_batch. */
struct assimp_batch {
	uint32_t triangle_count;
	uint32_t part;
	uint32_t flags;
	uint32_t reserved;
};

struct assimp_end {
	uint64_t triangle_count;
	uint64_t part_count;
	uint64_t face_count;
	uint64_t dropped_faces;
};

/** Followed by the reason, without a zero. */
struct assimp_error {
	int32_t error; /* a negative errno */
	uint32_t text_bytes;
};

/** No frame has a larger body. */
#define ASSIMP_BODY_BYTES_MAX                                                                      \
	(sizeof(struct assimp_batch) + (size_t)IMPORT_BATCH_TRIANGLES * 3 * (24 + 12 + 4))

_Static_assert(sizeof(struct assimp_part) + 3 * ASSIMP_TEXT_BYTES_MAX < ASSIMP_BODY_BYTES_MAX,
	       "a part is no larger than a batch");

#endif /* FORMATS_IMPORT_ASSIMP_FRAME_H */
