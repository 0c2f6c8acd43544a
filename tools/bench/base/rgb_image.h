/* SPDX-License-Identifier: MIT */
/**
 * rgb_image.h - small colour pictures in memory: read from PNG, compared, and written as PNG.
 *
 * Threads: any.
 */
#ifndef TOOLS_BENCH_BASE_RGB_IMAGE_H
#define TOOLS_BENCH_BASE_RGB_IMAGE_H

#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"

/** 8 bits each of r, g, b, sRGB; rows from the top. */
struct rgb_image {
	uint32_t width;
	uint32_t height;
	uint8_t *pixels; /* width x height x 3 */
};

/** Returns: 0, -EUCLEAN (no PNG, or damaged), -ENOMEM or -errno.  Ownership: rgb_image_done(). */
int rgb_image_read(const char *path, struct rgb_image *ret, struct why *why);
void rgb_image_done(struct rgb_image *image);

/** PNG in memory.  Returns: 0 or -ENOMEM.  Ownership: free(*ret). */
int rgb_image_encode(const struct rgb_image *image, uint8_t **ret, size_t *ret_bytes);

/**
 * The same picture in another size: larger by the nearest pixel (what a screen shows of a picture
 * that is too small), smaller by means over whole pixels.
 *
 * Returns: 0 or -ENOMEM.
 */
int rgb_image_scale(const struct rgb_image *image, uint32_t width, uint32_t height,
		    struct rgb_image *ret);

/** Pixels in which a channel differs by more than `threshold`.  Both are of one size. */
uint64_t rgb_image_differing(const struct rgb_image *a, const struct rgb_image *b,
			     uint8_t threshold);

/**
 * A picture of errors between 0 and 1: black, red, yellow, white.
 *
 * errors:  width x height.
 *
 * Returns: 0 or -ENOMEM.
 */
int rgb_image_of_errors(const float *errors, uint32_t width, uint32_t height,
			struct rgb_image *ret);

#endif /* TOOLS_BENCH_BASE_RGB_IMAGE_H */
