/* SPDX-License-Identifier: MIT */
/**
 * bytes.h - arithmetic on sizes and little-endian bytes.
 *
 * Sizes that come from outside are combined with __builtin_*_overflow(); the helpers here are for
 * sizes that are already known to be bounded.
 *
 * Threads: any.
 */
#ifndef FORMATS_BASE_BYTES_H
#define FORMATS_BASE_BYTES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#if __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "The store and the protocol are little-endian and mapped as they lie: big-endian is unsupported."
#endif

#define KIB (UINT64_C(1) << 10)
#define MIB (UINT64_C(1) << 20)
#define GIB (UINT64_C(1) << 30)

#define ARRAY_LENGTH(array) (sizeof(array) / sizeof((array)[0]))

/** Rounds up to a multiple of a power of two.  value + alignment must not overflow. */
static inline uint64_t bytes_round_up(uint64_t value, uint64_t alignment)
{
	return (value + alignment - 1) & ~(alignment - 1);
}

static inline bool bytes_is_aligned(uint64_t value, uint64_t alignment)
{
	return (value & (alignment - 1)) == 0;
}

/** Are all bytes zero?  Reserved fields must be. */
static inline bool bytes_are_zero(const void *data, size_t size_bytes)
{
	const uint8_t *bytes = data;

	return size_bytes == 0 || (bytes[0] == 0 && memcmp(bytes, bytes + 1, size_bytes - 1) == 0);
}

static inline uint64_t u64_min(uint64_t a, uint64_t b)
{
	return a < b ? a : b;
}

static inline uint64_t u64_max(uint64_t a, uint64_t b)
{
	return a > b ? a : b;
}

#endif /* FORMATS_BASE_BYTES_H */
