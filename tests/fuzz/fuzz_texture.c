/* SPDX-License-Identifier: MIT */
/* Images: what they claim, and their pixels; triangles of every size are laid on them. */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <sys/mman.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/base/file.h"
#include "formats/import/texture.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size_bytes);

static void lay_triangles(const struct textures *textures, struct texture_map map)
{
	static const float sizes[] = { 0.0f, 1e-3f, 0.5f, 3.0f, 1e9f, INFINITY, NAN };

	for (size_t i = 0; i < ARRAY_LENGTH(sizes); i++) {
		const float corners[3][2] = { { 0.3f, -0.7f },
					      { sizes[i], 0.1f },
					      { -0.2f, sizes[i] } };
		uint32_t colours[3];

		map.clamped = i % 2;
		textures_triangle(textures, &map, corners, colours);
		for (int k = 0; k < 3; k++)
			CHECK(colours[k] >> 24 == 255);
	}
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size_bytes)
{
	AUTO_FD fd = memfd_create("fuzz", MFD_CLOEXEC);
	struct texture_map map = { .scale = { 1, 1 } };
	struct why why = { .text = "" };
	struct textures textures;
	char path[64];
	int r;

	CHECK(fd >= 0);
	CHECK(file_write_at(fd, data, size_bytes, 0) == 0);
	(void)snprintf(path, sizeof(path), "/proc/self/fd/%d", fd);
	textures_init(&textures, 8 * MIB);
	CHECK(textures_add(&textures, path, &map.texture, &why) == 0);
	r = textures_need(&textures, map.texture, &why);
	CHECK(r > 0 || why.text[0] != '\0');
	if (r > 0)
		lay_triangles(&textures, map);
	textures_done(&textures);
	return 0;
}
