/* SPDX-License-Identifier: MIT */
/**
 * mtl.h - the material libraries of OBJ files: names, diffuse colours and their images.
 *
 * Threads: one a struct mtl.
 */
#ifndef FORMATS_IMPORT_MTL_H
#define FORMATS_IMPORT_MTL_H

#include "formats/import/names.h"
#include "formats/import/texture.h"

struct mtl_material {
	uint32_t colour; /* 0xAABBGGRR */
	struct texture_map map;
};

struct mtl {
	struct textures *textures; /* NULL: images do not count */
	struct names names;
	struct mtl_material *materials; /* by number */
	uint32_t capacity;
};

void mtl_init(struct mtl *mtl, struct textures *textures, uint64_t bytes_max);
void mtl_done(struct mtl *mtl);

/**
 * Adds the materials of a library.  What is said twice counts as said last.
 *
 * Returns: 0, -ENOENT when there is no such file, -ENOMEM, -EUCLEAN or -errno.
 */
int mtl_read(struct mtl *mtl, const char *path, struct why *why);

/** A material; grey for one that no library had. */
struct mtl_material mtl_material(const struct mtl *mtl, const char *name);

#endif /* FORMATS_IMPORT_MTL_H */
