/* SPDX-License-Identifier: MIT */
/**
 * vector.h - products and turns of vectors of three numbers.
 *
 * Threads: any.
 */
#ifndef LIBCLIENT_SELECT_VECTOR_H
#define LIBCLIENT_SELECT_VECTOR_H

#include <math.h>

static inline double vector_dot(const double a[3], const double b[3])
{
	return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/** ret is neither of them. */
static inline void vector_cross(const double a[3], const double b[3], double ret[3])
{
	ret[0] = a[1] * b[2] - a[2] * b[1];
	ret[1] = a[2] * b[0] - a[0] * b[2];
	ret[2] = a[0] * b[1] - a[1] * b[0];
}

/** Turns v about a unit axis, by radians (Rodrigues).  ret may be v. */
static inline void vector_turn(const double v[3], const double axis[3], double angle, double ret[3])
{
	double cosine = cos(angle);
	double sine = sin(angle);
	double along = vector_dot(axis, v) * (1.0 - cosine);
	double side[3];

	vector_cross(axis, v, side);
	for (unsigned k = 0; k < 3; k++)
		ret[k] = v[k] * cosine + side[k] * sine + axis[k] * along;
}

#endif /* LIBCLIENT_SELECT_VECTOR_H */
