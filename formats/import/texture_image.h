/* SPDX-License-Identifier: MIT */
/**
 * texture_image.h - image files (PNG, JPEG) as rows of pixels, from top to bottom.
 *
 * Nothing is kept but a row, so that an image costs no memory, but for the kinds that cannot be
 * decoded in order (interlaced PNG, progressive JPEG): what these hold is said beforehand.
 *
 * All bytes are hostile: sides, pixels and scans have limits, and only regular files are read.
 * Opacity is passed over, as are colour profiles: bytes are taken as sRGB.
 *
 * Threads: any.
 */
#ifndef FORMATS_IMPORT_TEXTURE_IMAGE_H
#define FORMATS_IMPORT_TEXTURE_IMAGE_H

#include <stdint.h>

#include "formats/base/why.h"

#define TEXTURE_IMAGE_SIDE_MAX   UINT32_C(65535)
#define TEXTURE_IMAGE_PIXELS_MAX (UINT64_C(64) << 20)

/** Where it goes. */
struct texture_image_sink {
	/* Before the first row.  held_bytes: what decoding will hold.  A negative return ends it. */
	int (*begin)(void *arg, uint32_t width, uint32_t height, uint64_t held_bytes,
		     struct why *why);
	/* width x red, green, blue. */
	void (*row)(void *arg, const uint8_t *rgb);
	void *arg;
};

/**
 * Reads one image.
 *
 * Returns: 0, -EUCLEAN when it is damaged, cut off or of another format, -EFBIG when it is too
 * large, -EINVAL when it is no regular file, -ENOMEM, what begin returned, or -errno.
 */
int texture_image_read(const char *path, const struct texture_image_sink *sink, struct why *why);

#endif /* FORMATS_IMPORT_TEXTURE_IMAGE_H */
