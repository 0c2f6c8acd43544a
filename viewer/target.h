/* SPDX-License-Identifier: MIT */
/**
 * target.h - what is drawn into: colours, items or normals, and a depth buffer.
 *
 * Threads: the GL thread.
 */
#ifndef VIEWER_TARGET_H
#define VIEWER_TARGET_H

#include <stdint.h>

#include <epoxy/gl.h>

#include "formats/base/why.h"
#include "viewer/channel.h"

struct target {
	GLuint framebuffer;
	GLuint pixels;
	GLuint depth;
	uint32_t width;
	uint32_t height;
	enum channel channel;
};

/** The largest side that a target may have here. */
uint32_t target_side_max(void);

/**
 * Makes a target.
 *
 * width, height:  1 .. target_side_max().
 *
 * Returns: 0, or -ENOMEM.
 * Ownership: ended with target_done(), which accepts one that is all zero.
 */
int target_init(struct target *ret, uint32_t width, uint32_t height, enum channel channel,
		struct why *why);
void target_done(struct target *target);

/** Draws go here from now on.  background: r, g, b; for CHANNEL_COLOUR. */
void target_begin(const struct target *target, const uint8_t background[3]);

/**
 * Reads all pixels, top row first, without padding.
 *
 * ret:  width x height x channel_pixel_bytes(channel) bytes.
 */
void target_read(const struct target *target, void *ret);

/** Depth under a pixel, from the top left; 0 where nothing is, or outside. */
float target_read_depth(const struct target *target, int x, int y);

/** The item under a pixel.  CHANNEL_PART, _NODE and _TRIANGLE. */
uint64_t target_read_item(const struct target *target, int x, int y);

#endif /* VIEWER_TARGET_H */
