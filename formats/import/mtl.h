/* SPDX-License-Identifier: MIT */
/**
 * mtl.h - the material libraries of OBJ files: names and diffuse colours.
 *
 * Threads: one a struct mtl.
 */
#ifndef FORMATS_IMPORT_MTL_H
#define FORMATS_IMPORT_MTL_H

#include "formats/import/names.h"

struct mtl {
	struct names names;
	uint32_t *colours; /* by number; 0xAABBGGRR */
	uint32_t capacity;
};

void mtl_init(struct mtl *mtl, uint64_t bytes_max);
void mtl_done(struct mtl *mtl);

/**
 * Adds the materials of a library.  What is said twice counts as said last.
 *
 * Returns: 0, -ENOENT when there is no such file, -ENOMEM, -EUCLEAN or -errno.
 */
int mtl_read(struct mtl *mtl, const char *path, struct why *why);

/** The colour of a material; grey for one that no library had. */
uint32_t mtl_colour(const struct mtl *mtl, const char *name);

#endif /* FORMATS_IMPORT_MTL_H */
