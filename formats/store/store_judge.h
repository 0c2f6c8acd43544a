/* SPDX-License-Identifier: MIT */
/**
 * store_judge.h - is what a store says of itself possible?
 *
 * Right checksums say only that the bytes are those that were written, which a hostile writer can
 * do as well.  These functions judge what they mean, as wholes: whoever comes after them checks
 * nothing again.  They read no file.
 *
 * Threads: any; pure functions, but for store_judge_hs(), which may allocate.
 */
#ifndef FORMATS_STORE_STORE_JUDGE_H
#define FORMATS_STORE_STORE_JUDGE_H

#include <stdint.h>

#include "formats/base/why.h"
#include "formats/store/layout.h"

/** Bytes of the HS: the records, then one checksum for each STORE_HS_BLOCK_NODES of them. */
static inline uint64_t store_hs_block_count(uint64_t node_count)
{
	return (node_count + STORE_HS_BLOCK_NODES - 1) / STORE_HS_BLOCK_NODES;
}

static inline uint64_t store_hs_bytes(uint64_t node_count)
{
	return node_count * sizeof(struct store_node) +
	       store_hs_block_count(node_count) * sizeof(uint64_t);
}

/**
 * Judges a superblock whose magic, version and checksum are right.
 *
 * Returns: 0, or -EUCLEAN with the reason.
 */
int store_judge_superblock(const struct store_superblock *superblock, struct why *why);

/**
 * Judges one record by itself: ranges, numbers, its extent inside the file.
 *
 * Returns: 0, or -EUCLEAN with the reason.
 */
int store_judge_record(const struct store_superblock *superblock, const struct store_node *nodes,
		       uint32_t node_index, struct why *why);

/**
 * Judges the whole HS: each record, links, order, cells, what children inherit, extents apart,
 * ids used once, and that the superblock's counts are the sums.
 *
 * Returns: 0, -EUCLEAN with the reason, or -ENOMEM.
 * Cost: O(n), and O(n log n) and memory where extents are not in the order of the records.
 */
int store_judge_hs(const struct store_superblock *superblock, const struct store_node *nodes,
		   struct why *why);

/**
 * Judges a decoded names block of names_bytes against the superblock's counts.
 *
 * Returns: 0, or -EUCLEAN with the reason.
 */
int store_judge_names(const struct store_superblock *superblock, const void *names,
		      uint64_t names_bytes, struct why *why);

#endif /* FORMATS_STORE_STORE_JUDGE_H */
