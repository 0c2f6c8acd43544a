/* SPDX-License-Identifier: MIT */
/**
 * exchange.h - records dealt out to numbered destinations, each of which gets its own together.
 *
 * Writers put pieces that are sorted by destination; each piece comes from a numbered origin.  A
 * destination reads what came to it in the order of the origins, whichever thread was first: so the
 * order does not depend on threads.  The table of fragments is in memory, the bytes are in a spool.
 *
 * Threads: exchange_put() from any; after exchange_seal() everything may be read from any.
 */
#ifndef TOOLS_BUILD_EXCHANGE_H
#define TOOLS_BUILD_EXCHANGE_H

#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "tools/build/spool.h"

struct exchange;

/** What one destination got from one origin. */
struct exchange_fragment {
	uint32_t destination;
	uint64_t origin;
	uint64_t address;
	uint64_t bytes;
};

/** Returns: 0 or -ENOMEM.  Ownership: ends with exchange_destroy(); the spool is the caller's. */
int exchange_create(struct spool *spool, struct budget *budget, uint32_t destination_count,
		    struct exchange **ret);
/** NULL is allowed.  Returns: NULL. */
struct exchange *exchange_destroy(struct exchange *exchange);

/**
 * Puts one piece.
 *
 * data:       the fragments' bytes, one after the other
 * fragments:  destination and bytes are set; the rest is filled here
 *
 * Returns: 0, -ENOMEM, or what the spool said.
 */
int exchange_put(struct exchange *exchange, uint64_t origin, const void *data,
		 struct exchange_fragment *fragments, size_t fragment_count, struct why *why);

/** Ends the putting.  Returns: 0 or -ENOMEM. */
int exchange_seal(struct exchange *exchange, struct why *why);

/** The fragments of a destination, in the order of their origins. */
const struct exchange_fragment *exchange_fragments(const struct exchange *exchange,
						   uint32_t destination, size_t *ret_count);
/** Their bytes together. */
uint64_t exchange_bytes(const struct exchange *exchange, uint32_t destination);

/** Reads part of what came to a destination: bytes from byte `begin`.  Returns: 0 or -errno. */
int exchange_read(const struct exchange *exchange, uint32_t destination, uint64_t begin, void *data,
		  uint64_t bytes, struct why *why);

#endif /* TOOLS_BUILD_EXCHANGE_H */
