/* SPDX-License-Identifier: MIT */
/**
 * cache_folder.h - where programs keep for their user what they can make again.
 *
 * Threads: any.
 */
#ifndef FORMATS_BASE_CACHE_FOLDER_H
#define FORMATS_BASE_CACHE_FOLDER_H

#include <limits.h>

#include "formats/base/why.h"

/**
 * Makes $XDG_CACHE_HOME/oocd, else ~/.cache/oocd, where it is not there yet.
 *
 * Returns: 0, -ENOENT (neither variable is set) or -errno.
 */
int cache_folder_make(char path[PATH_MAX], struct why *why);

#endif /* FORMATS_BASE_CACHE_FOLDER_H */
