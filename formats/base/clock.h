/* SPDX-License-Identifier: MIT */
/** clock.h - monotonic time, and waiting for it.  Threads: any. */
#ifndef FORMATS_BASE_CLOCK_H
#define FORMATS_BASE_CLOCK_H

#include <stdint.h>
#include <time.h>

#define NS_PER_US UINT64_C(1000)
#define NS_PER_MS UINT64_C(1000000)
#define NS_PER_S  UINT64_C(1000000000)

static inline uint64_t clock_now_ns(void)
{
	struct timespec now;

	(void)clock_gettime(CLOCK_MONOTONIC, &now);
	return (uint64_t)now.tv_sec * NS_PER_S + (uint64_t)now.tv_nsec;
}

/** What the calling thread has spent of a processor, ever. */
static inline uint64_t clock_spent_ns(void)
{
	struct timespec spent;

	(void)clock_gettime(CLOCK_THREAD_CPUTIME_ID, &spent);
	return (uint64_t)spent.tv_sec * NS_PER_S + (uint64_t)spent.tv_nsec;
}

/** The monotonic time in tenths of a second: 13 years in four bytes, for stamps of which there are millions. */
static inline uint32_t clock_now_ds(void)
{
	return (uint32_t)(clock_now_ns() / (NS_PER_S / 10));
}

/** Sleeps so long, or until a signal is handled. */
static inline void clock_pause_ns(uint64_t ns)
{
	const struct timespec time = { (time_t)(ns / NS_PER_S), (long)(ns % NS_PER_S) };

	(void)nanosleep(&time, NULL);
}

#endif /* FORMATS_BASE_CLOCK_H */
