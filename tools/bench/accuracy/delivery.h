/* SPDX-License-Identifier: MIT */
/**
 * delivery.h - the dials of fetching: what a smaller cache and less looking ahead cost in what live
 * pictures lack, and in bytes.
 *
 * Threads: the main thread.
 */
#ifndef TOOLS_BENCH_ACCURACY_DELIVERY_H
#define TOOLS_BENCH_ACCURACY_DELIVERY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "tools/bench/base/page.h"
#include "tools/bench/path/path.h"

struct delivery_options {
	const char *store;
	const char *disk;
	const struct path *path;
	uint32_t width;
	uint32_t height;
	bool is_quick;
};

/** One tour. */
struct delivery_point {
	uint64_t cache_bytes;
	uint64_t ahead_bytes; /* a frame; 0: not looking ahead */
	double unsettled;     /* share of covered pixels that differ from settled pictures, mean */
	double ready;         /* share of nodes that were there before they were wanted */
	double used;          /* share of bytes read ahead that were wanted within 60 frames */
	double read_mb;       /* for sets and ahead */
};

#define DELIVERY_POINT_COUNT_MAX 32u

struct delivery {
	char disk[32];
	struct delivery_point points[DELIVERY_POINT_COUNT_MAX];
	size_t point_count;
};

/** Goes along the path once for each position of the dials.  Returns: 0 or what went wrong. */
int delivery_measure(struct delivery *delivery, const struct delivery_options *options,
		     struct why *why);

/** Its part of the page, and FOLDER/delivery.csv.  Returns: 0 or -errno. */
int delivery_report(const struct delivery *delivery, struct page *page, const char *folder,
		    struct why *why);

#endif /* TOOLS_BENCH_ACCURACY_DELIVERY_H */
