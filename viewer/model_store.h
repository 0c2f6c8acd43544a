/* SPDX-License-Identifier: MIT */
/**
 * model_store.h - the store of a model: built into the user's cache folder when there is none.
 *
 * The folder is $XDG_CACHE_HOME/oocd, else ~/.cache/oocd.  A store's name says the model's name, its
 * path, and the state that it was built from: the size and time of change of every file (of a
 * folder, all in it; of a scene list, those that it names) and the builder's version.  A model that
 * has changed gets a new store, and the old one is removed.
 *
 * Threads: main().
 */
#ifndef VIEWER_MODEL_STORE_H
#define VIEWER_MODEL_STORE_H

#include <stdbool.h>

#include "formats/base/why.h"

/** Does a file begin as a store does?  Returns: 1, 0, or -errno with the reason. */
int model_store_is_store(const char *path, struct why *why);

/**
 * Finds or builds the store of a model.  oocbuild lies beside this program and tells its progress
 * on standard error.  Two programs that want the same store build it once.
 *
 * Returns: 0; -ECANCELED when the program is to stop; -ECHILD when the builder failed, which has
 *	said why; else -errno.
 * Ownership: free(*ret).
 */
int model_store_get(const char *model, char **ret, struct why *why);

#endif /* VIEWER_MODEL_STORE_H */
