/* SPDX-License-Identifier: MIT */
#include "tools/bench/accuracy/viewer_image.h"

#include <assert.h>
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <string.h>

#include "formats/base/file.h"

#define RAW_MAGIC   "OOCIMAGE"
#define RAW_VERSION 1u

/** As viewer/image.h has it; tools do not include the viewer. */
struct raw_header {
	uint8_t magic[8];
	uint32_t version;
	uint32_t channel;
	uint32_t width;
	uint32_t height;
	uint32_t pixel_bytes;
	uint32_t reserved0;
	double near;
	uint8_t reserved[24];
};

static_assert(sizeof(struct raw_header) == 64, "no hidden padding");

int viewer_image_read(const char *path, uint32_t width, uint32_t height, uint64_t *ret_items,
		      double *ret_near, struct why *why)
{
	AUTO_FD fd = open(path, O_RDONLY | O_CLOEXEC);
	struct raw_header header;
	int r;

	if (fd < 0)
		return why_errno(why, -errno, "%s", path);
	r = file_read_at(fd, &header, sizeof(header), 0);
	if (r == 0 && (memcmp(header.magic, RAW_MAGIC, sizeof(header.magic)) != 0 ||
		       header.version != RAW_VERSION || header.width != width ||
		       header.height != height || header.pixel_bytes != sizeof(*ret_items) ||
		       !(header.near > 0.0) || !isfinite(header.near)))
		return why_set(why, -EUCLEAN, "%s: not the raw picture that oocview was to write",
			       path);
	if (r == 0)
		r = file_read_at(fd, ret_items, (size_t)width * height * sizeof(*ret_items),
				 sizeof(header));
	if (r < 0)
		return why_errno(why, r, "%s", path);
	*ret_near = header.near;
	return 0;
}
