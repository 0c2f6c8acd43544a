/* SPDX-License-Identifier: MIT */
/**
 * out_file.h - a file that is there whole or not at all.
 *
 * Bytes go through one buffer into a temporary file beside the wanted one, which takes its name at
 * the end.  "-" is standard output, and what exists and is no regular file (a pipe, a device) is
 * written directly.  The first failure is kept, later bytes are thrown away, and out_file_commit()
 * tells it: writers need not look at every call.
 *
 * Threads: one an object.
 */
#ifndef TOOLS_GEN_OUT_FILE_H
#define TOOLS_GEN_OUT_FILE_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "formats/base/why.h"

#define OUT_FILE_BUFFER_BYTES (1u << 18)
/** Most bytes that out_file_room() gives at once. */
#define OUT_FILE_ROOM_BYTES 64u

struct out_file {
	char *path;
	char *temporary_path; /* NULL: written directly */
	uint8_t *buffer;
	size_t used_bytes;
	int fd;
	int error; /* the first failure, a negative errno; 0 */
};

/** Returns: 0, -ENOMEM or -errno.  Ownership: ends with out_file_done(), also after a commit. */
int out_file_open(struct out_file *out, const char *path, struct why *why);

/** Writes the buffer.  Failures are kept. */
void out_file_flush(struct out_file *out);

/** Room for the next size_bytes <= OUT_FILE_ROOM_BYTES, to be filled by the caller. */
static inline uint8_t *out_file_room(struct out_file *out, size_t size_bytes)
{
	uint8_t *room;

	if (out->used_bytes + size_bytes > OUT_FILE_BUFFER_BYTES)
		out_file_flush(out);
	room = out->buffer + out->used_bytes;
	out->used_bytes += size_bytes;
	return room;
}

/** Adds text of up to 1023 bytes. */
void out_file_printf(struct out_file *out, const char *format, ...)
	__attribute__((format(printf, 2, 3)));

/**
 * Writes what is left and gives the file its name.
 *
 * Returns: 0, -ECANCELED after a signal (interrupt.h), or the first -errno.
 */
int out_file_commit(struct out_file *out, struct why *why);

/** Frees all; a file that was not committed is removed. */
void out_file_done(struct out_file *out);

#endif /* TOOLS_GEN_OUT_FILE_H */
