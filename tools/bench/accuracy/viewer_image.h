/* SPDX-License-Identifier: MIT */
/**
 * viewer_image.h - the raw pictures that oocview writes, read.
 *
 * Outside data: the header is judged, the length has to be exact.
 */
#ifndef TOOLS_BENCH_ACCURACY_VIEWER_IMAGE_H
#define TOOLS_BENCH_ACCURACY_VIEWER_IMAGE_H

#include <stdint.h>

#include "formats/base/why.h"

/**
 * Reads a picture of 64-bit items.
 *
 * ret_items:  width x height, top row first; UINT64_MAX: nothing.
 * ret_near:   the near plane that the viewer chose, model units.
 *
 * Returns: 0, -EUCLEAN (not such a picture, or of another size), -ENODATA or -errno.
 */
int viewer_image_read(const char *path, uint32_t width, uint32_t height, uint64_t *ret_items,
		      double *ret_near, struct why *why);

#endif /* TOOLS_BENCH_ACCURACY_VIEWER_IMAGE_H */
