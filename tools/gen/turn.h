/* SPDX-License-Identifier: MIT */
/**
 * turn.h - angles whose cosine and sine are the same on every machine.
 *
 * Nothing here calls the C library's sin() or cos(), whose last bit differs between releases.
 *
 * Threads: any.
 */
#ifndef TOOLS_GEN_TURN_H
#define TOOLS_GEN_TURN_H

#include <stdint.h>

#include "formats/base/random.h"

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

#endif /* TOOLS_GEN_TURN_H */
