/* SPDX-License-Identifier: MIT */
/**
 * file.h - descriptors: closed once, read whole, written whole.
 *
 * Threads: any.
 */
#ifndef FORMATS_BASE_FILE_H
#define FORMATS_BASE_FILE_H

#include <stddef.h>
#include <stdint.h>
#include <unistd.h>

/** Closes fd if it is one.  Returns -1, for `fd = fd_close(fd);`.  Keeps errno. */
int fd_close(int fd);

static inline void fd_close_auto(int *fd)
{
	*fd = fd_close(*fd);
}

/** A local descriptor that is closed when it goes out of scope. */
#define AUTO_FD __attribute__((cleanup(fd_close_auto))) int

/**
 * Reads exactly size_bytes at an offset.
 *
 * Returns: 0, -ENODATA when the file ends before, or -errno.
 */
int file_read_at(int fd, void *data, size_t size_bytes, uint64_t file_offset);

/** Writes exactly size_bytes at an offset.  Returns: 0 or -errno. */
int file_write_at(int fd, const void *data, size_t size_bytes, uint64_t file_offset);

#endif /* FORMATS_BASE_FILE_H */
