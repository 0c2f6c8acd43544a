/* SPDX-License-Identifier: MIT */
/**
 * resident.h - a whole store in memory, decoded, for measurements that shall not wait for a disk.
 *
 * Threads: one thread.
 * Memory: all payloads, decoded (store_superblock.payload_raw_bytes).
 */
#ifndef TOOLS_BENCH_ACCURACY_RESIDENT_H
#define TOOLS_BENCH_ACCURACY_RESIDENT_H

#include <stdint.h>

#include "formats/base/why.h"
#include "formats/store/store_file.h"

struct resident {
	struct store_file *file;
	const struct store_superblock *superblock;
	struct store_node *nodes;
	void **payloads; /* a node; NULL: nothing to draw */
};

/**
 * Opens, reads and judges all of a store.
 *
 * Returns: 0, -ENOMEM, -ECANCELED or what the store said.
 * Ownership: ends with resident_close(), which copes with half-open ones.
 */
int resident_open(struct resident *resident, const char *path, struct why *why);
void resident_close(struct resident *resident);

#endif /* TOOLS_BENCH_ACCURACY_RESIDENT_H */
