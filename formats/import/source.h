/* SPDX-License-Identifier: MIT */
/**
 * source.h - the bytes of a model file, from front to back, plain or gzipped.
 *
 * A source shows a window of bytes, [at, end), that its user advances; source_more() reads further
 * bytes behind it.  It does not seek, and it does not know what the bytes mean.
 *
 * The byte at end is always a zero that may be read: text can be scanned for the end of a number or
 * a word without asking for the end of the window.
 *
 * Threads: one a source.
 */
#ifndef FORMATS_IMPORT_SOURCE_H
#define FORMATS_IMPORT_SOURCE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"

/** Told of each piece that is read; a negative return ends the reading with that error. */
typedef int (*source_progress_fn)(void *arg, uint64_t read_bytes, uint64_t total_bytes);

struct source {
	const uint8_t *at;   /* the user's: may be moved up to end */
	const uint8_t *end;  /* read-only for users, like all that follows */
	uint64_t end_offset; /* of end, in decoded bytes from the start */
	uint64_t file_bytes;
	uint64_t line; /* line ends passed by the functions for text */
	struct source_reader *reader;
};

/**
 * Opens a file; it is gzip when it begins with gzip's magic.  The window is filled.
 *
 * window_bytes_max: how large the window may grow for one line or one record
 * progress:         may be NULL
 *
 * Returns: 0, -ENOENT, -EINVAL when it is no regular file, -ENOMEM or -errno.
 * Ownership: ends with source_close().
 */
int source_open(const char *path, uint64_t window_bytes_max, source_progress_fn progress, void *arg,
		struct source **ret, struct why *why);
struct source *source_close(struct source *source);

/**
 * Makes the window longer.  The window moves: pointers into it are void, source->at is not.
 *
 * Returns: 1 when it is longer now, 0 at the end of the file, or
 *	-ENODATA  a gzip file that is cut off
 *	-EUCLEAN  damaged gzip data, or a window that would be larger than allowed
 *	-ENOMEM, -errno, what the progress function returned
 */
int source_more(struct source *source, struct why *why);

/** Makes at least size_bytes visible.  Returns: 0, -ENODATA at the end, or as source_more(). */
int source_need(struct source *source, size_t size_bytes, struct why *why);

/** Passes over size_bytes.  Returns: as source_need(). */
int source_skip(struct source *source, uint64_t size_bytes, struct why *why);

/** Copies size_bytes out, in pieces.  Returns: as source_need(). */
int source_copy(struct source *source, void *data, uint64_t size_bytes, struct why *why);

/**
 * Takes a line; it ends with "\n" or the end of the file ("\r" before it is left to the caller).
 *
 * ret_line: followed by a byte that is "\n" or zero; valid until the next call
 *
 * Returns: 1, 0 at the end of the file, or as source_more().
 */
int source_line(struct source *source, const char **ret_line, size_t *ret_length, struct why *why);

static inline bool source_is_blank(uint8_t byte)
{
	return byte == ' ' || (byte >= '\t' && byte <= '\r');
}

/** Passes over blanks and line ends.  Returns: 1 at something else, 0 at the end, or an error. */
static inline int source_blanks(struct source *source, struct why *why)
{
	for (;;) {
		int r;

		while (source_is_blank(*source->at))
			source->line += *source->at++ == '\n';
		if (source->at < source->end)
			return 1;
		r = source_more(source, why);
		if (r <= 0)
			return r;
	}
}

/**
 * Takes the number behind blanks and line ends.
 *
 * Returns: 0, -ENODATA at the end, -EUCLEAN with the line when it is something else, or as
 * source_more().
 */
int source_double(struct source *source, double *ret, struct why *why);
int source_float(struct source *source, float *ret, struct why *why);
int source_i64(struct source *source, int64_t *ret, struct why *why);

/** Decoded bytes before source->at. */
static inline uint64_t source_offset(const struct source *source)
{
	return source->end_offset - (uint64_t)(source->end - source->at);
}

/**
 * The most decoded bytes that can still come: exact for a plain file; for gzip what its format
 * could hold at best.  What claims more than this is a lie.
 */
uint64_t source_rest_max(const struct source *source);

/** Is source_rest_max() exact? */
bool source_is_plain(const struct source *source);

#endif /* FORMATS_IMPORT_SOURCE_H */
