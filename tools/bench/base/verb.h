/* SPDX-License-Identifier: MIT */
/**
 * verb.h - how a verb of oocbench ends: what it says of a failure, and its exit status.
 *
 * Threads: the main thread.
 */
#ifndef TOOLS_BENCH_BASE_VERB_H
#define TOOLS_BENCH_BASE_VERB_H

#include "formats/base/why.h"

/** Says "oocbench: VERB: ..." and that --help has more.  Returns: 2. */
int verb_usage_error(const char *verb, const char *format, ...)
	__attribute__((format(printf, 2, 3)));

/** Says why, where the work of a verb ended with an error, r < 0.  Returns: its exit status, 0 or 1. */
int verb_status(const char *verb, int r, const struct why *why);

#endif /* TOOLS_BENCH_BASE_VERB_H */
