/* SPDX-License-Identifier: MIT */
/**
 * normals.h - a corner's normal from the faces around it.
 *
 * A corner's normal is the sum of the normals of all faces of the same section that share the
 * corner's position and differ from its own face by no more than the crease angle, each weighted by
 * its angle there.  Faces may be turned either way: light is two-sided, and files are careless.
 * Everything that is summed is a whole number, so that the order of the faces does not matter and
 * two buckets, or two machines, come to the same bits.
 *
 * Threads: any; pure functions.
 * Source: Thuermer & Wuethrich 1998, "Computing Vertex Normals from Polygonal Facets": the weights.
 */
#ifndef TOOLS_BUILD_NORMALS_H
#define TOOLS_BUILD_NORMALS_H

#include <stdint.h>

/** How normals are stored: a dial between size, time and looks. */
enum normals_mode {
	NORMALS_FLAT,   /* none: derived per triangle when drawing */
	NORMALS_STORED, /* those that the files have, 16 bit; none are computed */
	NORMALS_OCT8,   /* 2 x 8 bit; computed where a file has none */
	NORMALS_OCT16,  /* 2 x 16 bit; computed where a file has none */
};

/** A face as its neighbours see it. */
struct face_normal {
	int16_t normal[3];   /* unit length is 32767 */
	uint16_t weights[3]; /* angle at each corner: 65535 is 180 degrees; at least 1 */
};

/** A face that has a corner at the position in question. */
struct normal_share {
	int16_t normal[3];
	uint16_t weight; /* 0: it asks for a normal and gives none */
	uint32_t section;
};

/** Normal and angles of a triangle that has an area; corners in any unit. */
void face_normal_of(const double corners[9], struct face_normal *ret);

/** Least product of two face normals that are not creased; degrees 0 .. 90. */
int32_t normals_threshold(double crease_degrees);

/** A normal as it is stored: the code's bytes in the low bits. */
uint32_t normals_encode(enum normals_mode mode, const int64_t normal[3]);
/** The same from a file's 16-bit code. */
uint32_t normals_convert(enum normals_mode mode, uint32_t oct16);

/**
 * Finds the normals of all corners that meet at one position.
 *
 * shares:  of every face there, in any order; may be reordered
 * ret:     one code for each, in the order given
 *
 * Returns: 0 or -ENOMEM.
 * Cost: O(n^2) for up to 64 faces; above, faces that are nearly parallel are taken together.
 */
int normals_solve(enum normals_mode mode, int32_t threshold, const struct normal_share *shares,
		  uint32_t share_count, uint32_t *ret);

#endif /* TOOLS_BUILD_NORMALS_H */
