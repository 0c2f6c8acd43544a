/* SPDX-License-Identifier: MIT */
/**
 * summary.h - what a build did, for people and for programs.
 *
 * Threads: none of its own.
 */
#ifndef TOOLS_BUILD_SUMMARY_H
#define TOOLS_BUILD_SUMMARY_H

#include <stdio.h>

#include "tools/build/build.h"

/** A few lines for people. */
void summary_print(const struct build_options *options, const struct build_report *report,
		   FILE *out);

/** One JSON object and a newline. */
void summary_print_json(const struct build_options *options, const struct build_report *report,
			FILE *out);

#endif /* TOOLS_BUILD_SUMMARY_H */
