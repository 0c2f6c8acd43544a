/* SPDX-License-Identifier: MIT */
/**
 * judge.h - how much of a picture is wrong that was drawn of some nodes and not of others.
 *
 * A picture is drawn once with all nodes that it could have; a pixel is right if the node that wins
 * it there was drawn.  (Ties in depth go to the lower item whatever is drawn, so no second picture is
 * needed.)
 *
 * Threads: one thread.  Memory: the whole store, decoded.
 */
#ifndef TOOLS_BENCH_ACCURACY_JUDGE_H
#define TOOLS_BENCH_ACCURACY_JUDGE_H

#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "libclient/select/camera.h"
#include "libclient/select/select.h"

struct judge;

/** Returns: 0 or -errno.  Ownership: ends with judge_destroy(). */
int judge_create(const char *store, uint32_t width, uint32_t height, struct judge **ret,
		 struct why *why);
/** NULL is allowed.  Returns: NULL. */
struct judge *judge_destroy(struct judge *judge);

/** Pixels of one picture. */
struct verdict {
	uint64_t covered; /* of the picture that it is compared with */
	uint64_t wrong;
	uint64_t all;
};

/**
 * Against the settled picture: the same set, all of it drawn.
 *
 * selection:  how the set was chosen; a budget of 0: all that is in the frustum.
 * missing:    nodes of the set that were not drawn.
 *
 * Returns: 0, -EINVAL (the camera looks nowhere) or -ENOMEM.
 */
int judge_settled(struct judge *judge, const struct camera *camera,
		  const struct select_options *selection, const uint32_t *missing,
		  size_t missing_count, struct verdict *ret);

/** Against the exact picture: everything that is in the frustum. */
int judge_exact(struct judge *judge, const struct camera *camera,
		const struct select_options *selection, const uint32_t *missing,
		size_t missing_count, struct verdict *ret);

#endif /* TOOLS_BENCH_ACCURACY_JUDGE_H */
