/* SPDX-License-Identifier: MIT */
/**
 * image.h - pictures as files, written row by row: PNG for people, raw for programs.
 *
 * The name's end decides: ".png" or ".raw".  A picture appears under its name when it is whole.
 *
 * PNG: colours and normals as r, g, b; parts, nodes and triangles in a colour of their own; depth in
 * 16 bits of grey, 65535 at the near end of the range given and 1 at its far end, linear in the
 * distance along the view; what shows nothing is black.
 * Raw: struct image_raw_header, then the pixels as channel.h says, top row first, little-endian.
 *
 * Threads: any; a writer belongs to one.
 */
#ifndef VIEWER_IMAGE_H
#define VIEWER_IMAGE_H

#include <assert.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "viewer/channel.h"

#define IMAGE_RAW_MAGIC   "OOCIMAGE"
#define IMAGE_RAW_VERSION 1u

struct image_raw_header {
	uint8_t magic[8];
	uint32_t version;
	uint32_t channel; /* enum channel */
	uint32_t width;
	uint32_t height;
	uint32_t pixel_bytes;
	uint32_t reserved0;
	double near; /* world units: the distance along the view of a pixel is near / depth */
	uint8_t reserved[24];
};

static_assert(sizeof(struct image_raw_header) == 64, "no hidden padding");

struct image_form {
	uint32_t width;
	uint32_t height;
	enum channel channel;
	double near;
	double depth_range[2]; /* CHANNEL_DEPTH in PNG: distances of white and of black */
};

struct image_writer;

/** Does the name end in a way that is known?  Returns: 0, or -EINVAL with what is. */
int image_check_name(const char *path, struct why *why);

/** Returns: 0, -EINVAL (the name), -ENOMEM or -errno. */
int image_create(const char *path, const struct image_form *form, struct image_writer **ret,
		 struct why *why);

/** Writes the next rows, as target_read() gives them.  Returns: 0 or -errno. */
int image_write_rows(struct image_writer *writer, const void *pixels, uint32_t row_count,
		     struct why *why);

/** All rows are written: gives the file its name.  Ends the writer.  Returns: 0 or -errno. */
int image_commit(struct image_writer *writer, struct why *why);

/** Ends the writer without a picture.  NULL is allowed.  Returns: NULL. */
struct image_writer *image_abandon(struct image_writer *writer);

#endif /* VIEWER_IMAGE_H */
