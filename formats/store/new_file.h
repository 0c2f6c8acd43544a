/* SPDX-License-Identifier: MIT */
/**
 * new_file.h - a file that appears under its name whole, or not at all.
 *
 * Its bytes go to a file without a name in the same folder; where the file system has none
 * (O_TMPFILE), to one with a hidden name.  Hidden names are also needed for the moment of replacing
 * an older file.  A hidden file is locked (flock) as long as its maker lives, so that the next
 * new_file_create() of that name removes what a killed process left.
 *
 * Threads: one at a time.
 */
#ifndef FORMATS_STORE_NEW_FILE_H
#define FORMATS_STORE_NEW_FILE_H

#include "formats/base/why.h"

struct new_file;

/**
 * Begins a file; nothing is seen of it yet.
 *
 * path:  where it will be; what stands there is a regular file, or nothing.  Symbolic links are
 *        followed: what they point at is replaced.
 *
 * Returns: 0, -EINVAL (a folder or a device is there), -EBUSY (a hundred are being made), -ENOMEM
 *	or -errno.
 */
int new_file_create(const char *path, struct new_file **ret, struct why *why);

/** Removes what was not committed.  NULL is allowed.  Returns: NULL. */
struct new_file *new_file_destroy(struct new_file *file);

/** Open for reading and writing; the new_file's. */
int new_file_fd(const struct new_file *file);

/** As it was given. */
const char *new_file_path(const struct new_file *file);

/**
 * Gives the file its name, in the place of what is there, and flushes the folder.  The caller has
 * flushed the bytes.
 *
 * Returns: 0 or -errno.  On failure the old file stands; but when flushing the folder was all that
 *	failed, the new one does, and may be gone after a power cut.
 */
int new_file_commit(struct new_file *file, struct why *why);

#endif /* FORMATS_STORE_NEW_FILE_H */
