/* SPDX-License-Identifier: MIT */
/**
 * spool.h - pieces of bytes that are kept until they are read again: in memory as long as the
 * budget lasts, then in a scratch file that has no name, so that nothing can be left behind.
 *
 * A piece is written once, whole, and may be read in parts.  A spool knows nothing of what it keeps.
 *
 * Threads: spool_append(), spool_read(), spool_peek() and spool_release() from any.
 */
#ifndef TOOLS_BUILD_SPOOL_H
#define TOOLS_BUILD_SPOOL_H

#include <stddef.h>
#include <stdint.h>
#include <sys/uio.h>

#include "formats/base/why.h"
#include "tools/build/budget.h"

struct spool;
struct spool_pool;

/** Memory comes in segments of this size, and no piece is larger. */
#define SPOOL_SEGMENT_BYTES (UINT32_C(4) << 20)

/**
 * Makes a pool of segments, from which several spools take and to which they give back.  The first
 * touch of fresh memory costs as much as what is then done with it: what one spool released serves
 * the next.
 *
 * Returns: 0 or -ENOMEM.  Ownership: ends with spool_pool_destroy(), after all spools of it; the
 * budget must outlive it.
 */
int spool_pool_create(struct budget *budget, struct spool_pool **ret);
/** NULL is allowed.  Returns: NULL. */
struct spool_pool *spool_pool_destroy(struct spool_pool *pool);
/**
 * Keeps a few segments ready from now on, touched by a thread of its own: worth a processor that has
 * nothing else to do.  Where no thread can be had, nothing changes.
 */
void spool_pool_warm(struct spool_pool *pool);
/** Ends that. */
void spool_pool_cool(struct spool_pool *pool);
/** Gives free segments back to the budget; from now on released ones go there at once. */
void spool_pool_drain(struct spool_pool *pool);

/**
 * scratch_directory:  copied; a file is made in it only when memory is spent.
 *
 * Returns: 0 or -ENOMEM.  Ownership: ends with spool_destroy(); the pool must outlive it.
 */
int spool_create(struct spool_pool *pool, const char *scratch_directory, struct spool **ret);

/** NULL is allowed.  Returns: NULL. */
struct spool *spool_destroy(struct spool *spool);

/**
 * Keeps a piece.
 *
 * bytes:        1 .. SPOOL_SEGMENT_BYTES
 * ret_address:  for reading it; address + n is the piece's n-th byte
 *
 * Returns: 0, or -ENOSPC or another -errno of the scratch file.
 */
int spool_append(struct spool *spool, const void *data, size_t bytes, uint64_t *ret_address,
		 struct why *why);

/** The same of a piece that lies in several places, one behind the other once it is kept. */
int spool_gather(struct spool *spool, const struct iovec *parts, size_t part_count,
		 uint64_t *ret_address, struct why *why);

/** Reads a part of a piece.  Returns: 0 or -errno of the scratch file. */
int spool_read(const struct spool *spool, uint64_t address, void *data, size_t bytes,
	       struct why *why);

/** Where a piece lies in memory, valid until it is released; NULL: it lies on disk. */
const void *spool_peek(const struct spool *spool, uint64_t address);

/** Gives up a piece of that length: its memory or disk is free for others. */
void spool_release(struct spool *spool, uint64_t address, size_t bytes);

/** Bytes that went to the scratch file so far. */
uint64_t spool_scratch_bytes(const struct spool *spool);

#endif /* TOOLS_BUILD_SPOOL_H */
