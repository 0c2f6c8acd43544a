/* SPDX-License-Identifier: MIT */
/**
 * deal.h - the two passes over the soup: counting its triangles, and dealing them out to buckets.
 *
 * Both see the same: placed, on the grid, without those that are not finite or have no area.  When
 * triangles are dealt, a corner whose position belongs to another bucket than its triangle sends
 * that bucket a border record (borders.h), if normals are to be computed.
 *
 * Threads: the functions run their own.
 */
#ifndef TOOLS_BUILD_DEAL_H
#define TOOLS_BUILD_DEAL_H

#include <pthread.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "tools/build/buckets.h"
#include "tools/build/crew.h"
#include "tools/build/exchange.h"
#include "tools/build/grid.h"
#include "tools/build/labels.h"
#include "tools/build/progress.h"
#include "tools/build/record.h"
#include "tools/build/soup.h"

struct deal {
	struct soup *soup; /* its blocks are released as they are dealt */
	const struct grid *grid;
	const struct record_shape *shape;
	const struct labels *labels;
	struct buckets *buckets;
	struct exchange *triangles;
	struct exchange *borders; /* NULL: no normals are computed */
	struct crew *crew;
	struct progress *progress;

	/* What was found. */
	uint64_t degenerate_count;
	double moved_max; /* largest distance that a corner was moved, model units */
	pthread_mutex_t lock;
};

/** Memory that each worker takes. */
uint64_t deal_worker_bytes(const struct record_shape *shape);

/** Counts until the buckets are known.  Returns: 0, -ENOMEM, -ECANCELED or -errno of scratch. */
int deal_count(struct deal *deal, uint32_t worker_count, struct why *why);

/** Deals all triangles out and seals the exchanges.  Returns: as deal_count(). */
int deal_out(struct deal *deal, uint32_t worker_count, struct why *why);

#endif /* TOOLS_BUILD_DEAL_H */
