/* SPDX-License-Identifier: MIT */
/**
 * polygon.h - polygons cut into triangles, concave ones too.
 *
 * A polygon of n corners always becomes n - 2 triangles, so that counts can be foretold; repeated
 * or collinear corners make some of them degenerate, which are the builder's to drop.  A polygon
 * that crosses itself is cut somehow.
 *
 * Method: ear clipping in the plane of the two axes most parallel to the polygon, by its Newell
 * normal.  Source: G. H. Meisters, "Polygons have ears", 1975; M. E. Newell's normal after I. E.
 * Sutherland, R. F. Sproull, R. A. Schumacker, "A characterization of ten hidden-surface
 * algorithms", 1974.
 *
 * Threads: one a struct polygon.
 */
#ifndef FORMATS_IMPORT_POLYGON_H
#define FORMATS_IMPORT_POLYGON_H

#include <stdint.h>

/** More corners than any exporter writes in one face, few enough to clip in a moment. */
#define POLYGON_CORNERS_MAX UINT32_C(65536)

/** Room that is used again for each polygon; all zero at first. */
struct polygon {
	double *positions; /* corner_max x 3: the caller's, after polygon_reserve() */
	uint32_t *triangles;
	double (*flat)[2];
	uint32_t *next;
	uint32_t *previous;
	uint32_t *reflex;
	uint32_t corner_max;
};

void polygon_done(struct polygon *polygon);

/** Makes room for corner_count <= POLYGON_CORNERS_MAX corners.  Returns: 0 or -ENOMEM. */
int polygon_reserve(struct polygon *polygon, uint32_t corner_count);

/**
 * Cuts the polygon whose corners stand in polygon->positions.
 *
 * corner_count: 3 to corner_max
 *
 * Returns: (corner_count - 2) x 3 corner numbers, counted from 0; valid until the next call.
 * Cost: O(n) when convex; else O(n x reflex corners), bounded: what is left then is fanned.
 */
const uint32_t *polygon_cut(struct polygon *polygon, uint32_t corner_count);

#endif /* FORMATS_IMPORT_POLYGON_H */
