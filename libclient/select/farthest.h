/* SPDX-License-Identifier: MIT */
/**
 * farthest.h - the pyramid of a depth image: the farthest depth of each square of 8 x 8 pixels, and
 * of each square of 64 x 64, so that what is hidden is found hidden at a glance.
 *
 * Squares that were drawn to since are looked at again when they are asked about, not before.
 *
 * Threads: a struct farthest belongs to the thread of its image.
 * Source: Greene, Kass & Miller, "Hierarchical Z-Buffer Visibility", SIGGRAPH 1993; two levels.
 */
#ifndef LIBCLIENT_SELECT_FARTHEST_H
#define LIBCLIENT_SELECT_FARTHEST_H

#include <stdbool.h>
#include <stdint.h>

#include "libclient/select/screen_box.h"

#define FARTHEST_SMALL_BITS 3 /* a small square has 8 x 8 pixels */
#define FARTHEST_LARGE_BITS 6 /* a large one 64 x 64 */

struct farthest {
	uint32_t width;
	uint32_t height;
	const float *depths; /* the image, rows of width */
	uint32_t small_width;
	uint32_t large_width;
	uint32_t small_count;
	uint32_t large_count;
	float *small;
	float *large;
	uint8_t *small_stale; /* drawn to since it was looked at */
	uint8_t *large_stale;
};

/** Returns: 0 or -ENOMEM.  The image outlives it. */
int farthest_create(uint32_t width, uint32_t height, const float *depths, struct farthest **ret);
struct farthest *farthest_destroy(struct farthest *farthest);

/** The image is depth 0 all over. */
void farthest_clear(struct farthest *farthest);

/** Something may have been drawn to the pixels x0 .. x1, y0 .. y1, inclusive. */
static inline void farthest_touch(struct farthest *farthest, uint32_t x0, uint32_t y0, uint32_t x1,
				  uint32_t y1)
{
	for (uint32_t y = y0 >> FARTHEST_SMALL_BITS; y <= y1 >> FARTHEST_SMALL_BITS; y++)
		for (uint32_t x = x0 >> FARTHEST_SMALL_BITS; x <= x1 >> FARTHEST_SMALL_BITS; x++)
			farthest->small_stale[y * farthest->small_width + x] = 1;
	for (uint32_t y = y0 >> FARTHEST_LARGE_BITS; y <= y1 >> FARTHEST_LARGE_BITS; y++)
		for (uint32_t x = x0 >> FARTHEST_LARGE_BITS; x <= x1 >> FARTHEST_LARGE_BITS; x++)
			farthest->large_stale[y * farthest->large_width + x] = 1;
}

/** Has a pixel that the box touches the depth that the box has there, or a farther one? */
bool farthest_shows(struct farthest *farthest, const struct screen_box *box);

#endif /* LIBCLIENT_SELECT_FARTHEST_H */
