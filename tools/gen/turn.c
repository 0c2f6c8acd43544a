/* SPDX-License-Identifier: MIT */
#include "tools/gen/turn.h"

#include "formats/base/check.h"

#define QUARTER_TURN_RADIANS 1.5707963267948966
/* x^23 / 23! is below 2e-18 for a quarter turn. */
#define SERIES_TERMS 11

struct turn turn_of(uint64_t numerator, uint64_t denominator)
{
	uint64_t quarter;
	double angle;
	double term_cosine = 1;
	double term_sine;
	struct turn turn = { 1, 0 };

	CHECK(numerator < denominator && denominator <= UINT64_C(1) << 32);
	quarter = 4 * numerator / denominator;
	angle = (double)(4 * numerator - quarter * denominator) / (double)denominator *
		QUARTER_TURN_RADIANS;

	term_sine = turn.sine = angle;
	for (int i = 1; i < SERIES_TERMS; i++) {
		term_cosine *= -angle * angle / (2 * i * (2 * i - 1));
		term_sine *= -angle * angle / (2 * i * (2 * i + 1));
		turn.cosine += term_cosine;
		turn.sine += term_sine;
	}
	switch (quarter) {
	case 1:
		return (struct turn){ -turn.sine, turn.cosine };
	case 2:
		return (struct turn){ -turn.cosine, -turn.sine };
	case 3:
		return (struct turn){ turn.sine, -turn.cosine };
	}
	return turn;
}
