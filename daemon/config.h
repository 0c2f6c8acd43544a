/* SPDX-License-Identifier: MIT */
/**
 * config.h - what the daemon is told to do: the usual, then a file, then the command line.
 *
 * The file has one "key = value" a line; "[user NAME]" begins what is said of one user; a line that
 * begins with "#" is a comment.  Keys are the names of the command line's options.
 *
 * A configuration is judged as a whole: it is right, or nothing of it is used and the first fault is
 * named with its line and what is allowed there.  What only a running daemon can know (is there so
 * much memory, does a store open) is not judged here.
 *
 * Threads: any; a struct config belongs to one thread.  May block: names of users and groups are
 *	looked up.
 */
#ifndef DAEMON_CONFIG_H
#define DAEMON_CONFIG_H

#include <stdbool.h>
#include <stddef.h>

#include "daemon/server/server.h"
#include "formats/base/why.h"

/** What is said on the command line: an option's name without dashes, and "yes" where it takes no value. */
struct config_option {
	const char *key;
	const char *value;
};

struct config {
	struct server_config server; /* its texts and arrays belong to this object */
	bool verbose;
};

/**
 * Reads a configuration.
 *
 * path:     NULL: no file.
 * options:  said over the file, in this order; what may be said several times adds to it.
 *
 * Returns: 0; -EINVAL (an option is wrong), -EBADMSG (the file is wrong), -E2BIG (it is longer than
 *	a configuration can be), -ENOMEM, or another -errno (the file cannot be read).
 * Ownership: config_destroy().
 */
int config_load(const char *path, const struct config_option *options, size_t option_count,
		struct config **ret, struct why *why);

/** NULL is allowed.  Returns: NULL. */
struct config *config_destroy(struct config *config);

#endif /* DAEMON_CONFIG_H */
