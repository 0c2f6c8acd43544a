/* SPDX-License-Identifier: MIT */
#include "formats/store/layout.h"

/* Moves bit i to bit 3i, for 21 bits, by halving the distance that groups of bits have to go. */
static uint64_t spread(uint32_t value)
{
	uint64_t bits = value & ((UINT32_C(1) << STORE_LEVEL_MAX) - 1);

	bits = (bits | bits << 32) & UINT64_C(0x001f00000000ffff);
	bits = (bits | bits << 16) & UINT64_C(0x001f0000ff0000ff);
	bits = (bits | bits << 8) & UINT64_C(0x100f00f00f00f00f);
	bits = (bits | bits << 4) & UINT64_C(0x10c30c30c30c30c3);
	bits = (bits | bits << 2) & UINT64_C(0x1249249249249249);
	return bits;
}

uint64_t store_morton(uint32_t x, uint32_t y, uint32_t z)
{
	return spread(x) | spread(y) << 1 | spread(z) << 2;
}
