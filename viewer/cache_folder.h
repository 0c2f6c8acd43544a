/* SPDX-License-Identifier: MIT */
/**
 * cache_folder.h - where the viewer keeps what it can make again.
 *
 * Threads: any.
 */
#ifndef VIEWER_CACHE_FOLDER_H
#define VIEWER_CACHE_FOLDER_H

#include <limits.h>

#include "formats/base/why.h"

/**
 * Makes $XDG_CACHE_HOME/oocd, else ~/.cache/oocd, where it is not there yet.
 *
 * Returns: 0, -ENOENT (neither variable is set) or -errno.
 */
int cache_folder_make(char path[PATH_MAX], struct why *why);

#endif /* VIEWER_CACHE_FOLDER_H */
