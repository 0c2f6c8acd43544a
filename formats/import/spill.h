/* SPDX-License-Identifier: MIT */
/**
 * spill.h - what does not fit in memory, on disk: streams of bytes that are written side by side and
 * read one after the other.
 *
 * A spill is one file without a name, so that nothing of it is left whatever happens.  Its streams
 * are chains of chunks; a chunk is written whole, behind all others, and its room on disk is given
 * back once it is read.
 *
 * Threads: one a spill.  Memory: a chunk for each stream that was written to, and 8 bytes a chunk.
 */
#ifndef FORMATS_IMPORT_SPILL_H
#define FORMATS_IMPORT_SPILL_H

#include <stdbool.h>
#include <stdint.h>

#include "formats/base/why.h"

/** Where spills go, and what they took. */
struct scratch {
	const char *directory;
	const volatile bool *cancelled; /* looked at once a chunk; NULL: never */
	uint64_t live_bytes;
	uint64_t max_bytes;
};

struct spill_stream {
	uint8_t *buffer; /* the chunk that is being filled, then the one that is being read */
	uint32_t buffered_bytes;
	uint32_t read_bytes; /* of the buffer */
	uint32_t last_bytes; /* length of the last chunk, known once it is read */
	bool reading;
	uint64_t *chunks; /* their numbers in the file */
	uint64_t chunk_count;
	uint64_t chunk_capacity;
	uint64_t chunk_read; /* chunks that were read */
};

struct spill {
	struct scratch *scratch;
	int fd;
	uint32_t chunk_bytes;
	uint32_t stream_count;
	uint64_t chunk_count;
	struct spill_stream *streams;
};

/** Returns: 0, -ENOMEM or -errno of the folder.  Ownership: ends with spill_destroy(). */
int spill_create(struct scratch *scratch, uint32_t stream_count, uint32_t chunk_bytes,
		 struct spill **ret, struct why *why);
struct spill *spill_destroy(struct spill *spill);

/** Appends to a stream that was not read from.  Returns: 0, -ENOMEM, -ECANCELED or -errno. */
int spill_write(struct spill *spill, uint32_t stream, const void *data, uint32_t size_bytes,
		struct why *why);

/**
 * Takes the next bytes of a stream; it cannot be written to any more.
 *
 * Returns: 1, 0 when none are left, -EIO when only some are, -ECANCELED or -errno.
 */
int spill_read(struct spill *spill, uint32_t stream, void *data, uint32_t size_bytes,
	       struct why *why);

/** Frees the stream's buffer; it must not be used again. */
void spill_stream_done(struct spill *spill, uint32_t stream);

#endif /* FORMATS_IMPORT_SPILL_H */
