/* SPDX-License-Identifier: MIT */
/**
 * parts_kit.h - the daemon's parts below sessions with one store, driven by hand: cache, workers, fills, and
 * the simulated back end.
 *
 * What goes wrong fails the test.
 */
#ifndef TESTS_UNIT_PARTS_KIT_H
#define TESTS_UNIT_PARTS_KIT_H

#include <stdint.h>

#include "daemon/cache/cache.h"
#include "daemon/fetch/fetch.h"
#include "daemon/fetch/fills.h"
#include "daemon/fetch/workers.h"
#include "tests/helper.h"

#define PARTS_NODES_MAX 4096u
#define PARTS_DEPTH     4u /* of the queue */

struct parts {
	char *folder;
	struct cache cache;
	struct workers *workers;
	struct fills *fills;
	struct fetch *fetch;
	struct served *served;
	uint32_t nodes[PARTS_NODES_MAX]; /* with payload */
	uint32_t node_count;
};

/**
 * Segments are made at once.
 *
 * ended:  is told of each fill.
 */
void parts_begin(struct parts *parts, uint64_t budget_bytes, const struct test_grid *grid,
		 const struct fetch_sim *sim, fills_ended_fn ended, void *ended_arg);
/** Nothing may be held or in flight. */
void parts_end(struct parts *parts);

/** Waits until something has come back, and takes it. */
void parts_take_reads(struct parts *parts);

#endif /* TESTS_UNIT_PARTS_KIT_H */
