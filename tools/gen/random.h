/* SPDX-License-Identifier: MIT */
/**
 * random.h - random numbers and angles that are the same on every machine.
 *
 * Nothing here calls the C library's sin() or cos(), whose last bit differs between releases.
 *
 * Threads: any; a struct random belongs to one caller.
 * Source: the generator is SplitMix64 (Steele, Lea & Flood, "Fast splittable pseudorandom number
 * generators", 2014).
 */
#ifndef TOOLS_GEN_RANDOM_H
#define TOOLS_GEN_RANDOM_H

#include <stdbool.h>
#include <stdint.h>

struct random {
	uint64_t state;
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

/** In [low, high). */
static inline double random_between(struct random *random, double low, double high)
{
	return low + (high - low) * ((double)(random_next(random) >> 11) * 0x1p-53);
}

/** In [0, count); count > 0. */
static inline unsigned random_below(struct random *random, unsigned count)
{
	return (unsigned)(((random_next(random) >> 32) * count) >> 32);
}

static inline bool random_chance(struct random *random, double probability)
{
	return random_between(random, 0, 1) < probability;
}

/** Cosine and sine of an angle. */
struct turn {
	double cosine;
	double sine;
};

/** Of numerator / denominator of a full turn; numerator < denominator <= 2^32. */
struct turn turn_of(uint64_t numerator, uint64_t denominator);

/** Of a random angle. */
static inline struct turn turn_random(struct random *random)
{
	return turn_of(random_next(random) >> 32, UINT64_C(1) << 32);
}

#endif /* TOOLS_GEN_RANDOM_H */
