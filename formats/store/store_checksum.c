/* SPDX-License-Identifier: MIT */
#include "formats/store/store_checksum.h"

#include <xxhash.h>

uint64_t store_checksum(const void *data, size_t size_bytes, uint64_t seed)
{
	return XXH3_64bits_withSeed(data, size_bytes, seed);
}
