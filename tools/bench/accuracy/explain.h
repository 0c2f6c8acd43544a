/* SPDX-License-Identifier: MIT */
/**
 * explain.h - may two pictures differ in a pixel?
 *
 * Two pictures of the same triangles show different ones in a pixel for two reasons that are no
 * fault: the pixel's centre is as near to an edge as positions may be off, or the two are as deep as
 * each other within what depths may be off.
 *
 * Threads: any; pure functions in double precision.
 */
#ifndef TOOLS_BENCH_ACCURACY_EXPLAIN_H
#define TOOLS_BENCH_ACCURACY_EXPLAIN_H

#include <stdbool.h>
#include <stdint.h>

#include "libclient/select/camera.h"

struct explain {
	const struct camera_view *view;
	uint32_t width, height;
	double pixels; /* how far edges may be off on the screen */
	double error;  /* how far vertices may be off in the world */
};

enum explain_reason {
	EXPLAIN_NONE, /* a fault */
	EXPLAIN_EDGE, /* or depths that may be off by as much as they differ */
	EXPLAIN_TIE,  /* both have the same depth there, to a float's precision: coplanar faces */
};

/**
 * a, b:  the triangles that the two pictures show, from the store's origin; NULL: nothing.
 * x, y:  the pixel, from the upper left corner.
 */
enum explain_reason explain_difference(const struct explain *explain, const double (*a)[3],
				       const double (*b)[3], uint32_t x, uint32_t y);

#endif /* TOOLS_BENCH_ACCURACY_EXPLAIN_H */
