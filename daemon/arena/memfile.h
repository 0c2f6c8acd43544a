/* SPDX-License-Identifier: MIT */
/**
 * memfile.h - memory that the daemon writes and clients may only read.
 *
 * A memory file, populated whole when it is made (a client that touched a hole would be charged for
 * the page), then published: sealed against resizing, mode 0400, with a second descriptor that is
 * open for reading only.  That one is what clients get.  With the mode and without the first
 * descriptor no other user can write to it, map it writable, truncate it or punch holes.
 *
 * Not F_SEAL_FUTURE_WRITE: the daemon could not punch holes, and a restarted daemon that is handed
 * the file could not fill it again.
 *
 * Threads: any; a struct memfile belongs to one thread at a time.
 */
#ifndef DAEMON_ARENA_MEMFILE_H
#define DAEMON_ARENA_MEMFILE_H

#include <stdbool.h>
#include <stdint.h>

#include "formats/base/why.h"

struct memfile {
	int fd;              /* -1: none; for the daemon alone */
	int read_fd;         /* -1 before memfile_publish(); for clients */
	void *base;          /* NULL: none */
	uint64_t bytes;      /* a multiple of the page size */
	uint64_t huge_bytes; /* of it in 2 MiB pages */
};

#define MEMFILE_NONE ((struct memfile){ .fd = -1, .read_fd = -1 })

/** How a memory file's content may change once it is published. */
enum memfile_content {
	MEMFILE_CHANGING, /* by the daemon */
	MEMFILE_FIXED,    /* by nobody: the daemon's map becomes read-only too */
};

/**
 * Makes a memory file of zeros, mapped for writing.
 *
 * name:   for people (/proc/PID/maps).
 * bytes:  rounded up to pages.
 * huge:   try to have it in 2 MiB pages.  What was got is in huge_bytes.
 *
 * Returns: 0, -ENOMEM, -ENOSPC or another -errno; *ret is MEMFILE_NONE then.
 * May block: for 0.1 to 0.5 s a GiB.
 */
int memfile_create(const char *name, uint64_t bytes, bool huge, struct memfile *ret,
		   struct why *why);

/** Seals it and opens read_fd.  Returns: 0 or -errno; still to be ended by memfile_done(). */
int memfile_publish(struct memfile *memfile, enum memfile_content content, struct why *why);

/**
 * Takes over one that a predecessor of this process has published for changing, and maps it.
 *
 * fd:  open for reading and writing; taken over, whatever happens.
 *
 * Returns: 0, -EUCLEAN (it is none, can be resized, or has holes), -EACCES (it is another user's) or
 *	-errno; *ret is MEMFILE_NONE then.  huge_bytes is 0: the kernel does not tell.
 */
int memfile_adopt(int fd, struct memfile *ret, struct why *why);

/** Closes it.  Clients that map it keep it as it is. */
void memfile_done(struct memfile *memfile);

/**
 * Gives the memory back although clients may still map it: they read zeros.  No registered buffer
 * may lie over it: reads would succeed into pages that nobody sees.  To be followed by memfile_done().
 */
void memfile_reclaim(struct memfile *memfile);

#endif /* DAEMON_ARENA_MEMFILE_H */
