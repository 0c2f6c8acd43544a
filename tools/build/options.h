/* SPDX-License-Identifier: MIT */
/**
 * options.h - the command line of oocbuild.
 *
 * Threads: none of its own.
 */
#ifndef TOOLS_BUILD_OPTIONS_H
#define TOOLS_BUILD_OPTIONS_H

#include <stdbool.h>

#include "formats/base/why.h"
#include "tools/build/build.h"

struct options {
	struct build_options build;
	bool json;
	bool quiet;
	bool help;
	bool version;
};

/**
 * Reads the command line; texts point into argv.
 *
 * Returns: 0, or -EINVAL with what is wrong.
 */
int options_parse(int argc, char **argv, struct options *ret, struct why *why);

/** The text of --help. */
void options_print_help(void);

#endif /* TOOLS_BUILD_OPTIONS_H */
