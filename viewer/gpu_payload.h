/* SPDX-License-Identifier: MIT */
/** gpu_payload.h - a payload where OpenGL can draw it.  Threads: the GL thread. */
#ifndef VIEWER_GPU_PAYLOAD_H
#define VIEWER_GPU_PAYLOAD_H

#include <stdint.h>

#include <epoxy/gl.h>

#include "formats/store/payload_layout.h"

struct gpu_payload {
	GLuint buffer;
	uint64_t offset_bytes;               /* of the payload in the buffer; page-aligned */
	const struct payload_header *header; /* readable until the frame is finished */
};

#endif /* VIEWER_GPU_PAYLOAD_H */
