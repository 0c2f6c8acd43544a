/* SPDX-License-Identifier: MIT */
/* Material libraries: names, colours, images' names and their options. */
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/base/file.h"
#include "formats/import/mtl.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size_bytes);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size_bytes)
{
	AUTO_FD fd = memfd_create("fuzz", MFD_CLOEXEC);
	struct why why = { .text = "" };
	struct textures textures;
	struct mtl mtl;
	char path[64];

	CHECK(fd >= 0);
	CHECK(file_write_at(fd, data, size_bytes, 0) == 0);
	(void)snprintf(path, sizeof(path), "/proc/self/fd/%d", fd);
	textures_init(&textures, MIB);
	mtl_init(&mtl, &textures, MIB);
	if (mtl_read(&mtl, path, &why) < 0)
		CHECK(why.text[0] != '\0');
	for (uint32_t i = 0; i < mtl.names.count; i++)
		CHECK(mtl.materials[i].map.texture == TEXTURE_NONE ||
		      mtl.materials[i].map.texture < textures.paths.count);
	mtl_done(&mtl);
	textures_done(&textures);
	return 0;
}
