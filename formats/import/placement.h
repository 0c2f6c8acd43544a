/* SPDX-License-Identifier: MIT */
/** placement.h - where something stands: an affine map of positions and normals.  Threads: any. */
#ifndef FORMATS_IMPORT_PLACEMENT_H
#define FORMATS_IMPORT_PLACEMENT_H

/** Row-major, 3x4. */
struct placement {
	double m[12];
};

extern const struct placement placement_identity;

/** What b does first and a then. */
struct placement placement_multiply(const struct placement *a, const struct placement *b);

/**
 * The cofactors of the 3x3 part, row-major: they turn normals as the placement turns planes, up to
 * length, and also where it mirrors.
 *
 * Returns: the determinant, negative when it mirrors.
 */
double placement_cofactors(const struct placement *placement, double ret[9]);

/** Where a position goes. */
static inline void placement_move(const struct placement *placement, const double position[3],
				  double ret[3])
{
	const double *m = placement->m;

	for (int row = 0; row < 3; row++, m += 4)
		ret[row] = m[0] * position[0] + m[1] * position[1] + m[2] * position[2] + m[3];
}

/** Where a normal goes, by the cofactors; its length changes. */
static inline void placement_turn(const double cofactors[9], const double normal[3], float ret[3])
{
	for (int row = 0; row < 3; row++, cofactors += 3)
		ret[row] = (float)(cofactors[0] * normal[0] + cofactors[1] * normal[1] +
				   cofactors[2] * normal[2]);
}

#endif /* FORMATS_IMPORT_PLACEMENT_H */
