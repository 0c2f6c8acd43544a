/* SPDX-License-Identifier: MIT */
/**
 * histogram.h - how long things took: counts in buckets of powers of two, which are enough to tell a
 * millisecond from ten, cost two increments, and add up over any number of histograms.
 *
 * Bucket i counts what took less than histogram_bound_ns(i) and was too long for the one before; the
 * last one counts the rest.
 *
 * Threads: one at a time.
 */
#ifndef FORMATS_BASE_HISTOGRAM_H
#define FORMATS_BASE_HISTOGRAM_H

#include <stdint.h>

/** 1 us, 2 us, ... 17 s, and the rest. */
#define HISTOGRAM_BUCKET_COUNT 26u

/** Zeroed: empty. */
struct histogram {
	uint64_t counts[HISTOGRAM_BUCKET_COUNT];
	uint64_t count;
	uint64_t sum_ns;
};

/** Upper bound of a bucket; UINT64_MAX for the last. */
static inline uint64_t histogram_bound_ns(uint32_t bucket)
{
	return bucket + 1 < HISTOGRAM_BUCKET_COUNT ? UINT64_C(1024) << bucket : UINT64_MAX;
}

static inline void histogram_add(struct histogram *histogram, uint64_t ns)
{
	/* Bits above the ten that are below the first bound. */
	uint32_t bucket = ns >> 10 == 0 ? 0 : 64 - (uint32_t)__builtin_clzll(ns >> 10);

	if (bucket >= HISTOGRAM_BUCKET_COUNT)
		bucket = HISTOGRAM_BUCKET_COUNT - 1;
	histogram->counts[bucket]++;
	histogram->count++;
	histogram->sum_ns += ns;
}

/**
 * Bound of the bucket below which a share of what was counted lies.
 *
 * share:  0 .. 1; 0.5 is the median.
 *
 * Returns: it, 0 when nothing was counted, UINT64_MAX when it lies in the last bucket.
 */
static inline uint64_t histogram_quantile_ns(const struct histogram *histogram, double share)
{
	uint64_t seen = 0;
	uint32_t bucket = 0;

	if (histogram->count == 0)
		return 0;
	for (; bucket + 1 < HISTOGRAM_BUCKET_COUNT; bucket++) {
		seen += histogram->counts[bucket];
		if ((double)seen >= share * (double)histogram->count)
			break;
	}
	return histogram_bound_ns(bucket);
}

#endif /* FORMATS_BASE_HISTOGRAM_H */
