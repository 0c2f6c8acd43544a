/* SPDX-License-Identifier: MIT */
/**
 * store_hs.h - the HS as it lies: blocks of records, and one checksum for each.
 *
 * It says which blocks are damaged and does not judge what the records mean (store_judge.h).
 *
 * Threads: any.
 */
#ifndef FORMATS_STORE_STORE_HS_H
#define FORMATS_STORE_STORE_HS_H

#include <stdint.h>

#include "formats/base/why.h"
#include "formats/store/layout.h"

/** Told of each block whose checksum is wrong: its records are [first, first + count). */
typedef void (*store_hs_damage_fn)(void *arg, uint32_t first, uint32_t count);

/** Checksum of a block of records. */
uint64_t store_hs_block_checksum(const struct store_superblock *superblock,
				 const struct store_node *nodes, uint64_t block);

/**
 * Reads all records and compares each block with its checksum.
 *
 * fd:      of the store, whose superblock was judged.
 * nodes:   room for node_count records.
 * damage:  NULL: the first damaged block ends it.
 *
 * Returns: 0, -EBADMSG (a block, or the table of checksums), -ENODATA, -ENOMEM or -errno.
 */
int store_hs_read(int fd, const struct store_superblock *superblock, struct store_node *nodes,
		  store_hs_damage_fn damage, void *arg, struct why *why);

#endif /* FORMATS_STORE_STORE_HS_H */
