/* SPDX-License-Identifier: MIT */
/**
 * write_stream.h - bytes appended to a file as few, large, aligned writes.
 *
 * It flushes nothing to the device and knows no format.
 *
 * Threads: one at a time.
 */
#ifndef FORMATS_STORE_WRITE_STREAM_H
#define FORMATS_STORE_WRITE_STREAM_H

#include <stddef.h>
#include <stdint.h>

struct write_stream;

/**
 * Begins to append at an offset.
 *
 * fd:           open for writing, the caller's; O_DIRECT is set on it where the file system can.
 * file_offset:  a multiple of STORE_BLOCK_BYTES.
 *
 * Returns: 0 or -ENOMEM.
 */
int write_stream_create(int fd, uint64_t file_offset, struct write_stream **ret);

/** Forgets what was not written.  NULL is allowed.  Returns: NULL. */
struct write_stream *write_stream_destroy(struct write_stream *stream);

/** Where the next byte goes. */
uint64_t write_stream_offset(const struct write_stream *stream);

/** Returns: 0 or -errno; after a failure every call fails in the same way. */
int write_stream_append(struct write_stream *stream, const void *data, size_t size_bytes);

/** Appends zeros up to a multiple of STORE_BLOCK_BYTES.  Returns: as above. */
int write_stream_align(struct write_stream *stream);

/** Writes what was gathered.  The offset must be aligned.  Returns: as above. */
int write_stream_flush(struct write_stream *stream);

/** Writes whole blocks elsewhere, at once.  Nothing may be gathered.  Returns: as above. */
int write_stream_put(struct write_stream *stream, const void *data, size_t size_bytes,
		     uint64_t file_offset);

#endif /* FORMATS_STORE_WRITE_STREAM_H */
