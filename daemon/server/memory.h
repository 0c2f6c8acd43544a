/* SPDX-License-Identifier: MIT */
/**
 * memory.h - how much memory the daemon may use, so that it is refused at the start and not killed
 * later.
 *
 * Threads: any.
 */
#ifndef DAEMON_SERVER_MEMORY_H
#define DAEMON_SERVER_MEMORY_H

#include <stdint.h>

/** The least of what is available, as it was read. */
struct memory {
	uint64_t bytes;
	char limited_by[256]; /* for people: "memory.max of /system.slice", "available memory" */
};

/**
 * Reads the memory that is available on the machine and in every cgroup above this process.  What
 * cannot be read does not limit.
 */
void memory_read(struct memory *ret);

/** The same, of files below `root` and not of the machine's own.  For tests. */
void memory_read_below(const char *root, struct memory *ret);

#endif /* DAEMON_SERVER_MEMORY_H */
