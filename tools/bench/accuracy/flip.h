/* SPDX-License-Identifier: MIT */
/**
 * flip.h - how different two pictures look to a person who flips between them: 0 not at all .. 1.
 *
 * A picture is prepared once, then compared with any number of others of its size.
 *
 * Threads: any; a prepared picture is only read.
 * Memory: seven floats a pixel.
 * Source: Andersson, Nilsson, Akenine-Moller, Oskarsson, Astrom, Fairchild, "FLIP: A Difference
 *	Evaluator for Alternating Images", HPG 2020, with its erratum (lightness is divided by 116).
 */
#ifndef TOOLS_BENCH_ACCURACY_FLIP_H
#define TOOLS_BENCH_ACCURACY_FLIP_H

#include <stdint.h>

#include "formats/base/why.h"

/** Pixels a degree where a 4K monitor 0.7 m wide is 0.7 m away: the authors' default. */
#define FLIP_PIXELS_A_DEGREE 67.0206432765822881

struct flip;

/**
 * rgb:               width x height x 3 bytes of sRGB, top row first.
 * pixels_a_degree:   of the viewer's field of view, > 0; equal in pictures that are compared.
 *
 * Returns: 0 or -ENOMEM.
 */
int flip_prepare(const uint8_t *rgb, uint32_t width, uint32_t height, double pixels_a_degree,
		 struct flip **ret);
/** NULL is allowed.  Returns: NULL. */
struct flip *flip_done(struct flip *flip);

/**
 * ret_map:  width x height errors, or NULL.
 *
 * Returns: their mean.  Both pictures are of one size.
 */
double flip_compare(const struct flip *reference, const struct flip *test, float *ret_map);

#endif /* TOOLS_BENCH_ACCURACY_FLIP_H */
