/* SPDX-License-Identifier: MIT */
/**
 * raster_check.h - do OpenGL and the software rasteriser agree here?
 *
 * What software finds hidden is hidden in OpenGL's picture only where both take the same samples for
 * covered and compute the same depth.  GL leaves that to the implementation, so it is looked at.
 *
 * Threads: the GL thread.
 */
#ifndef VIEWER_RASTER_CHECK_H
#define VIEWER_RASTER_CHECK_H

#include <stdint.h>

#include "formats/base/why.h"
#include "viewer/renderer.h"

/**
 * Draws a known set of triangles by both, large ones and small ones, some through the near plane.
 *
 * ret_wrong:  pixels that show another triangle, or it at another depth.
 *
 * Returns: 0 or -ENOMEM.
 */
int raster_check(struct renderer *renderer, uint32_t *ret_wrong, struct why *why);

#endif /* VIEWER_RASTER_CHECK_H */
