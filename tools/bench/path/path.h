/* SPDX-License-Identifier: MIT */
/**
 * path.h - camera paths through and around a store, a camera a frame at 30 frames a second.
 *
 * The same store, kind, seed and length give the same path.
 *
 * Threads: the main thread.
 */
#ifndef TOOLS_BENCH_PATH_PATH_H
#define TOOLS_BENCH_PATH_PATH_H

#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "libclient/select/camera.h"

enum path_kind {
	PATH_WALK,     /* on the floors, from room to room */
	PATH_ORBIT,    /* once around the whole, looking at it */
	PATH_FLY,      /* over it in a curve, looking ahead and down */
	PATH_TELEPORT, /* a walk in pieces of a second, in any order */
	PATH_REVERSAL, /* a walk that turns on its heel, three seconds on and two back */
	PATH_KIND_COUNT_
};

/** Names of the kinds, NULL-terminated. */
extern const char *const path_kinds[];

struct path {
	struct camera *cameras;
	size_t camera_count;
	double storey; /* model units; 0: nobody walked */
};

/**
 * Makes a path.
 *
 * Returns: 0, -ENODATA (a walk, and nothing to walk on), -ENOMEM, -ECANCELED, or what opening the
 *	store said.
 * Ownership: ends with path_done().
 */
int path_make(const char *store, enum path_kind kind, size_t frame_count, uint64_t seed,
	      struct path *ret, struct why *why);
void path_done(struct path *path);

/** Writes cameras as CSV to a file, or to standard output where it is NULL.  Returns: 0, -EIO or -errno. */
int path_write(const char *name, const struct camera *cameras, size_t count, struct why *why);

#endif /* TOOLS_BENCH_PATH_PATH_H */
