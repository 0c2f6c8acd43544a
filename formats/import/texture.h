/* SPDX-License-Identifier: MIT */
/**
 * texture.h - the images on a model's surface, and their colour at a triangle's corners.
 *
 * An image is kept as a pyramid: its finest level has at most TEXTURE_SIDE_MAX texels a side, each
 * next one half as many, each texel the mean of what it covers, in linear light.  A triangle takes
 * its corners' colours from the level whose texels are as large as the triangle, so that a corner
 * stands for its share of the surface and not for a speck of it; a triangle that covers no area of
 * the image (a palette) takes the finest level.
 *
 * The pyramids that were used last stay in memory, the others are read again.  What a corner gets
 * depends on the image, the triangle and the map alone, never on how much memory there is.
 *
 * Source: L. Williams, "Pyramidal parametrics", 1983.
 * Memory: bytes_max, told at the start.  Threads: one a struct textures.
 */
#ifndef FORMATS_IMPORT_TEXTURE_H
#define FORMATS_IMPORT_TEXTURE_H

#include <stdbool.h>

#include "formats/import/names.h"

#define TEXTURE_NONE     UINT32_MAX
#define TEXTURE_SIDE_MAX 512u
/* 512, 256, ... 1. */
#define TEXTURE_LEVELS_MAX 10u

/** How a material lays an image on a surface. */
struct texture_map {
	uint32_t texture; /* its number; TEXTURE_NONE: there is none */
	float scale[2];
	float offset[2];
	bool clamped; /* else it repeats */
};

struct texture {
	const char *path;
	uint8_t *texels; /* red, green, blue of all levels, finest first; NULL: not in memory */
	uint32_t image_width;
	uint32_t image_height;
	uint32_t factor; /* pixels of the image along the side of a texel of the finest level */
	uint32_t level_count;
	uint64_t size_bytes;
	uint64_t last_use;
	bool seen;       /* it was read before */
	bool unreadable; /* there is no such image, or it is damaged or too large */
};

struct textures {
	struct names paths;
	struct texture *textures; /* by number */
	uint32_t capacity;
	uint32_t unreadable_count;
	uint64_t bytes;
	uint64_t bytes_max;
	uint64_t use_count;
	uint64_t pixels_again; /* pixels of images that were read a second time */
	uint16_t linear[256];  /* light of a byte of sRGB */
};

void textures_init(struct textures *textures, uint64_t bytes_max);
void textures_done(struct textures *textures);

/** The number of an image file; nothing is read yet.  Returns: 0 or -ENOMEM. */
int textures_add(struct textures *textures, const char *path, uint32_t *ret_number,
		 struct why *why);

/**
 * Has an image in memory until the next call.
 *
 * Returns: 1, 0 when it is unreadable (the first answer is the last), -EIO when it was readable
 * before, or -ENOMEM.
 */
int textures_need(struct textures *textures, uint32_t number, struct why *why);

/** The opaque colours, 0xAABBGGRR, of a triangle's corners; the map's image must be in memory. */
void textures_triangle(const struct textures *textures, const struct texture_map *map,
		       const float corners[3][2], uint32_t ret_colours[3]);

#endif /* FORMATS_IMPORT_TEXTURE_H */
