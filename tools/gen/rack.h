/* SPDX-License-Identifier: MIT */
/**
 * rack.h - a scene list that stores the models of folders on shelves.
 *
 * Writes LIST.csv, and a folder LIST.d with the rooms that it names; the folder first, so that a
 * list that is there can be read.
 */
#ifndef TOOLS_GEN_RACK_H
#define TOOLS_GEN_RACK_H

#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "formats/store/layout.h"

struct rack_wish {
	char *const *arguments; /* as of import_inputs_expand() */
	size_t argument_count;
	const char *list_path;
	uint64_t seed;
	uint64_t copy_count;
	enum store_axis up_axis; /* of all models; unknown: as each file says, else z */
	unsigned jobs;
};

struct rack_report {
	uint64_t models;     /* that were found */
	uint64_t empty;      /* left out: without triangles */
	uint64_t unreadable; /* left out, and logged */
	uint64_t placed;     /* lines of the list that are models */
	uint64_t triangles;  /* of the placed models */
	uint64_t rooms;
};

/**
 * Writes the list.
 *
 * Returns: 0, -ENODATA when there is nothing to place, -EINVAL for names that a list cannot hold,
 * -ECANCELED, -ENOMEM or what reading and writing said.
 */
int rack_write(const struct rack_wish *wish, struct rack_report *ret, struct why *why);

#endif /* TOOLS_GEN_RACK_H */
