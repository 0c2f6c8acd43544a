/* SPDX-License-Identifier: MIT */
/**
 * random.h - numbers at random that are the same on every machine for the same seed.  Not for secrets.
 *
 * Threads: any; a struct random belongs to one caller.
 * Source: the generator is SplitMix64 (Steele, Lea & Flood, "Fast splittable pseudorandom number
 * generators", 2014).
 */
#ifndef FORMATS_BASE_RANDOM_H
#define FORMATS_BASE_RANDOM_H

#include <stdbool.h>
#include <stdint.h>

struct random {
	uint64_t state; /* at the beginning the seed: any number */
};

static inline uint64_t random_next(struct random *random)
{
	uint64_t z = random->state += UINT64_C(0x9e3779b97f4a7c15);

	z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
	z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
	return z ^ (z >> 31);
}

/** A stream of its own for each pair of seed and number. */
static inline struct random random_stream(uint64_t seed, uint64_t number)
{
	struct random random = { seed };

	random.state = random_next(&random) ^ (number * UINT64_C(0xd6e8feb86659fd93));
	(void)random_next(&random);
	return random;
}

/** In [0, 1). */
static inline double random_unit(struct random *random)
{
	return (double)(random_next(random) >> 11) * 0x1p-53;
}

/** In [low, high). */
static inline double random_between(struct random *random, double low, double high)
{
	return low + (high - low) * random_unit(random);
}

/** In [0, count); count > 0. */
static inline uint32_t random_below(struct random *random, uint32_t count)
{
	return (uint32_t)(((random_next(random) >> 32) * count) >> 32);
}

static inline bool random_chance(struct random *random, double probability)
{
	return random_unit(random) < probability;
}

#endif /* FORMATS_BASE_RANDOM_H */
