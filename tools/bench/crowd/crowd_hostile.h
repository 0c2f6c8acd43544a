/* SPDX-License-Identifier: MIT */
/**
 * crowd_hostile.h - clients that do what they may not: see the list in crowd_hostile.c.
 *
 * As root they are another user than the honest ones.
 */
#ifndef TOOLS_BENCH_CROWD_CROWD_HOSTILE_H
#define TOOLS_BENCH_CROWD_CROWD_HOSTILE_H

#include <stdint.h>

#include "formats/base/why.h"

struct hostiles;

/** Starts one of each.  Returns: 0, -ENOMEM or -errno. */
int hostiles_start(const char *store, const char *socket_path, uint64_t seed, struct hostiles **ret,
		   struct why *why);
/** Kills them.  NULL is allowed.  Returns: NULL. */
struct hostiles *hostiles_stop(struct hostiles *hostiles);

#endif /* TOOLS_BENCH_CROWD_CROWD_HOSTILE_H */
