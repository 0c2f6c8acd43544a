/* SPDX-License-Identifier: MIT */
/**
 * part_names.h - the names of a store's parts, read from its file when they are first asked for.
 *
 * Threads: one.
 */
#ifndef VIEWER_PART_NAMES_H
#define VIEWER_PART_NAMES_H

#include <stdint.h>

#include "formats/base/why.h"
#include "formats/store/store_file.h"

struct part_names {
	struct store_names store_names; /* memory is NULL until they are read */
};

void part_names_done(struct part_names *names);

/**
 * One line about a part: its name, where it comes from, its material.
 *
 * Returns: 0, -ENOENT (no such part), or as store_open_path() and store_load_names() say.
 */
int part_names_describe(struct part_names *names, const char *store_path, uint32_t part,
			char *ret_line, size_t line_bytes, struct why *why);

#endif /* VIEWER_PART_NAMES_H */
