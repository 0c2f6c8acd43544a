/* SPDX-License-Identifier: MIT */
/**
 * cut.h - buckets into leaves, and leaves into the store.
 *
 * Workers take buckets in Morton order and work on them side by side.  Ids are given, and payloads
 * written, in Morton order, by two turnstiles: so what waits is at most one bucket a worker.
 *
 * Threads: cut_run() runs its own.
 */
#ifndef TOOLS_BUILD_CUT_H
#define TOOLS_BUILD_CUT_H

#include <stdint.h>

#include "formats/base/why.h"
#include "formats/store/store_writer.h"
#include "tools/build/borders.h"
#include "tools/build/budget.h"
#include "tools/build/crew.h"
#include "tools/build/exchange.h"
#include "tools/build/labels.h"
#include "tools/build/leaf.h"

struct cut {
	const struct borders *borders; /* grid, shape, buckets, labels, triangles, ... */
	struct labels *labels;
	struct store_writer *writer;
	struct budget *budget;
	uint32_t leaf_triangles;
	uint32_t leaf_vertices;
	enum store_codec codec;
	struct crew *crew;
	struct progress *progress;

	uint32_t patch_triangles; /* of the largest bucket */

	/* All leaves, in Morton order. */
	struct leaf *leaves;
	uint64_t leaf_count;
	uint64_t leaf_max;
	uint64_t limited_count;
	uint64_t id_next;
	struct turnstile numbering;
	struct turnstile writing;
};

/** Memory that each worker takes. */
uint64_t cut_worker_bytes(const struct record_shape *shape, uint32_t bucket_triangles,
			  uint32_t leaf_triangles, enum store_codec codec);

/** Returns: 0, -ENOMEM, -EOVERFLOW (a payload above the format's limit), -ECANCELED, -errno. */
int cut_run(struct cut *cut, uint32_t worker_count, struct why *why);
void cut_done(struct cut *cut);

#endif /* TOOLS_BUILD_CUT_H */
