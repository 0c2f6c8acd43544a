/* SPDX-License-Identifier: MIT */
/**
 * names.h - names that a file gives to things, each with a number, counted from 0.
 *
 * Memory: bounded; a file with too many names is refused.
 * Threads: one a struct names.
 */
#ifndef FORMATS_IMPORT_NAMES_H
#define FORMATS_IMPORT_NAMES_H

#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"

struct name_slot {
	char *name; /* NULL: free */
	uint32_t number;
};

struct names {
	struct name_slot *slots; /* slot_count, a power of two, at most half of them used */
	size_t slot_count;
	uint32_t count;
	uint64_t seed;
	uint64_t bytes;
	uint64_t bytes_max;
};

void names_init(struct names *names, uint64_t bytes_max);
void names_done(struct names *names);

/** The number of a name; it is given the next one when it is new.  Returns: 0 or -ENOMEM. */
int names_add(struct names *names, const char *name, uint32_t *ret_number, struct why *why);

/** The number of a name, or UINT32_MAX. */
uint32_t names_find(const struct names *names, const char *name);

/** A name that is there, as it is kept: valid until names_done().  NULL when it is not there. */
const char *names_text(const struct names *names, const char *name);

#endif /* FORMATS_IMPORT_NAMES_H */
