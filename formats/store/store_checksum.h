/* SPDX-License-Identifier: MIT */
/**
 * store_checksum.h - XXH3-64 of a block of the store, seeded with the block's identity.
 *
 * The seed says which block it is, so that a right block in the wrong place has a wrong checksum.
 *
 *	block               seed
 *	superblock          its slot, 0 or 1
 *	payload             its payload_id
 *	block k of HS       store_hs_seed(generation, k)
 *	table of HS         the generation
 *	names               the generation
 *
 * Threads: any.
 */
#ifndef FORMATS_STORE_STORE_CHECKSUM_H
#define FORMATS_STORE_STORE_CHECKSUM_H

#include <stddef.h>
#include <stdint.h>

uint64_t store_checksum(const void *data, size_t size_bytes, uint64_t seed);

/** The seed of a block of HS records.  The factor is odd: no two blocks of a generation share one. */
static inline uint64_t store_hs_seed(uint64_t generation, uint64_t block)
{
	return generation * UINT64_C(0x9e3779b97f4a7c15) + block;
}

#endif /* FORMATS_STORE_STORE_CHECKSUM_H */
