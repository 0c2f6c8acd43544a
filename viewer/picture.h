/* SPDX-License-Identifier: MIT */
/**
 * picture.h - a picture of any size as a file, tile by tile where OpenGL has no room for the whole.
 *
 * Threads: the GL thread.
 */
#ifndef VIEWER_PICTURE_H
#define VIEWER_PICTURE_H

#include <stdbool.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "viewer/frame.h"
#include "viewer/target.h"

#define PICTURE_SIDE_MAX 65536u

struct picture_size {
	uint32_t width;
	uint32_t height;
};

/** Keeps its target from picture to picture.  All zero to begin with. */
struct picture {
	struct target target;
	uint8_t *pixels; /* of the target */
};

void picture_done(struct picture *picture);

/**
 * Draws a picture and, where there is a path, writes it.
 *
 * is_settled:  wait until it is whole; a picture that needs tiles always is.
 * path:        NULL: only draw.
 *
 * Returns: 0, or as frame_draw_settled() and image_create() say.
 */
int picture_take(struct picture *picture, struct frame *frame, const struct world *world,
		 const struct camera *camera, const struct frame_style *style,
		 struct picture_size size, bool is_settled, const char *path,
		 struct frame_report *ret, struct why *why);

#endif /* VIEWER_PICTURE_H */
