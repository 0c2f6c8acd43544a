/* SPDX-License-Identifier: MIT */
#include "formats/store/store_checksum.h"

#include <xxhash.h>

#ifdef OOCD_HAS_XXHASH_DISPATCH
/*
 * XXH3_64bits_withSeed() of the library is built for the least processor of its distribution; this one
 * takes the widest vectors that the processor has.  Same sums: 0.12 and 0.03 s a GB with AVX2.
 */
#include <xxh_x86dispatch.h>
#endif

uint64_t store_checksum(const void *data, size_t size_bytes, uint64_t seed)
{
	return XXH3_64bits_withSeed(data, size_bytes, seed);
}
