/* SPDX-License-Identifier: MIT */
/**
 * mapping.h - memory that another process shares with us, mapped for reading.
 *
 * The other side is believed nothing: a file that could be truncated under us would be a SIGBUS, so
 * one that is not sealed against it is refused.
 *
 * Threads: any.
 */
#ifndef LIBCLIENT_MAPPING_H
#define LIBCLIENT_MAPPING_H

#include <stdint.h>

#include "formats/base/why.h"

/** All zero: maps nothing. */
struct mapping {
	const void *base;
	uint64_t bytes;
};

/**
 * Maps the first `bytes` of a memory file.
 *
 * fd:    stays the caller's; not needed afterwards.
 *
 * Returns: 0, -EPROTO (no memory file, shorter than `bytes`, or may still shrink), -ENOMEM.
 * Ownership: ends with mapping_done().
 */
int mapping_init(int fd, uint64_t bytes, struct mapping *ret, struct why *why);

/** Unmaps, and leaves a mapping of nothing. */
void mapping_done(struct mapping *mapping);

#endif /* LIBCLIENT_MAPPING_H */
