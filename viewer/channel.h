/* SPDX-License-Identifier: MIT */
/**
 * channel.h - what a pixel of a picture says.
 *
 * Threads: any.
 */
#ifndef VIEWER_CHANNEL_H
#define VIEWER_CHANNEL_H

#include <stddef.h>
#include <stdint.h>

/** The values are written into raw images and known to item.frag. */
enum channel {
	CHANNEL_COLOUR = 0,   /* uint8_t r, g, b, a; sRGB */
	CHANNEL_PART = 1,     /* uint64_t: store << 32 | part */
	CHANNEL_NODE = 2,     /* uint64_t: store << 32 | node */
	CHANNEL_TRIANGLE = 3, /* uint64_t: its ordinal in the model, or node << 32 | triangle */
	CHANNEL_DEPTH = 4,    /* float: near plane / distance along the view; 0: nothing */
	CHANNEL_NORMAL = 5,   /* float x, y, z: unit, towards the eye; 0: nothing */
	CHANNEL_COUNT_
};

/** Pixels of PART, NODE and TRIANGLE that show nothing. */
#define CHANNEL_ITEM_NONE UINT64_MAX

/** "triangle"; never NULL. */
const char *channel_name(enum channel channel);

/** Returns: the channel of a name, or -EINVAL. */
int channel_from_name(const char *name);

/** Size of a pixel as read back and as raw images have it. */
size_t channel_pixel_bytes(enum channel channel);

/** A colour that tells an item from its neighbours, the same in every picture.  r, g, b. */
void channel_item_colour(uint64_t item, uint8_t ret[3]);

#endif /* VIEWER_CHANNEL_H */
