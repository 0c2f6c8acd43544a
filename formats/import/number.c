/* SPDX-License-Identifier: MIT */
#include "formats/import/number.h"

#include <locale.h>
#include <math.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

/* 10^19 - 1 < 2^64: so many digits fit in the mantissa. */
#define DIGITS_MAX 19
/* 5^27 < 2^64. */
#define FIVES_MAX 27

__extension__ typedef unsigned __int128 u128;

/* A decimal as written: (-1)^negative x digits x 10^exponent. */
struct decimal {
	uint64_t digits;
	int32_t exponent;
	bool negative;
	bool inexact; /* more digits than fit: the value is only near */
};

static const uint64_t fives[FIVES_MAX + 1] = {
	1u,
	5u,
	25u,
	125u,
	625u,
	3125u,
	15625u,
	78125u,
	390625u,
	1953125u,
	9765625u,
	48828125u,
	244140625u,
	1220703125u,
	6103515625u,
	30517578125u,
	152587890625u,
	762939453125u,
	3814697265625u,
	19073486328125u,
	95367431640625u,
	476837158203125u,
	2384185791015625u,
	11920928955078125u,
	59604644775390625u,
	298023223876953125u,
	1490116119384765625u,
	7450580596923828125u,
};

static const double tens[] = { 1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,
			       1e8,  1e9,  1e10, 1e11, 1e12, 1e13, 1e14, 1e15,
			       1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22 };
#define EXACT_TENS_MAX       22
#define EXACT_TENS_FLOAT_MAX 10

static inline bool is_digit(char c)
{
	return (unsigned)(c - '0') < 10u;
}

/* Reads the digits of one side of the point.  Leading zeros cost none of the 19 places. */
static const char *scan_digits(const char *at, struct decimal *decimal, bool after_point)
{
	for (; is_digit(*at); at++) {
		unsigned digit = (unsigned)(*at - '0');

		if (decimal->digits <= (UINT64_MAX - 9) / 10) {
			decimal->digits = decimal->digits * 10 + digit;
			decimal->exponent -= after_point;
		} else {
			decimal->inexact |= digit != 0;
			decimal->exponent += !after_point;
		}
	}
	return at;
}

/* "e+12"; an "e" without digits belongs to what follows. */
static const char *scan_exponent(const char *at, struct decimal *decimal)
{
	const char *digits = at + 1;
	bool negative = false;
	int32_t exponent = 0;

	if (*digits == '+' || *digits == '-')
		negative = *digits++ == '-';
	if (!is_digit(*digits))
		return at;
	for (; is_digit(*digits); digits++)
		if (exponent < 100000)
			exponent = exponent * 10 + (*digits - '0');
	decimal->exponent += negative ? -exponent : exponent;
	return digits;
}

static const char *scan_decimal(const char *text, struct decimal *decimal)
{
	const char *at = text, *begin;
	size_t digit_count;

	*decimal = (struct decimal){ 0 };
	if (*at == '-' || *at == '+')
		decimal->negative = *at++ == '-';
	begin = at;
	at = scan_digits(at, decimal, false);
	digit_count = (size_t)(at - begin);
	if (*at == '.') {
		begin = at + 1;
		at = scan_digits(begin, decimal, true);
		digit_count += (size_t)(at - begin);
	}
	if (digit_count == 0)
		return NULL;
	if (*at == 'e' || *at == 'E')
		at = scan_exponent(at, decimal);
	return at;
}

/* "nan", "inf", "infinity". */
static const char *scan_special(const char *text, double *ret)
{
	const char *at = text;
	bool negative = false;
	double value;

	if (*at == '-' || *at == '+')
		negative = *at++ == '-';
	if (strncasecmp(at, "nan", 3) == 0) {
		value = NAN;
		at += 3;
	} else if (strncasecmp(at, "infinity", 8) == 0) {
		value = HUGE_VAL;
		at += 8;
	} else if (strncasecmp(at, "inf", 3) == 0) {
		value = HUGE_VAL;
		at += 3;
	} else {
		return NULL;
	}
	*ret = negative ? -value : value;
	return at;
}

/*
 * Rounds value x 2^exponent, plus something less than one unit of value where rest is true, to
 * bit_count bits, ties to even.  value is at least 2^64, so the rest is far below the last bit.
 */
static double round_to_bits(u128 value, bool rest, int exponent, int bit_count)
{
	uint64_t high = (uint64_t)(value >> 64);
	int width = 128 - __builtin_clzll(high);
	int shift = width - bit_count;
	uint64_t kept = (uint64_t)(value >> shift);
	u128 half = (u128)1 << (shift - 1);
	u128 cut = value & ((half << 1) - 1);

	if (cut > half || (cut == half && (rest || (kept & 1))))
		kept++;
	return ldexp((double)kept, exponent + shift);
}

/*
 * The nearest binary number of bit_count bits, by integer arithmetic alone.  Powers of ten are
 * split in powers of five, which are multiplied or divided exactly, and powers of two.
 */
static double decimal_round(const struct decimal *decimal, int bit_count)
{
	int shift = __builtin_clzll(decimal->digits);
	uint64_t digits = decimal->digits << shift;

	if (decimal->exponent >= 0) {
		u128 value = (u128)digits * fives[decimal->exponent];
		int up = (value >> 64) == 0 ? 64 : 0;

		return round_to_bits(value << up, false, decimal->exponent - shift - up, bit_count);
	} else {
		uint64_t divisor = fives[-decimal->exponent];
		/* The quotient is at least 2^127 / 2^63: it fills more than 64 bits. */
		u128 value = (u128)digits << 64;
		u128 quotient = value / divisor;

		return round_to_bits(quotient, quotient * divisor != value,
				     decimal->exponent - shift - 64, bit_count);
	}
}

static bool decimal_is_small(const struct decimal *decimal)
{
	return !decimal->inexact && decimal->exponent >= -FIVES_MAX &&
	       decimal->exponent <= FIVES_MAX;
}

static locale_t c_locale;
static pthread_once_t c_locale_once = PTHREAD_ONCE_INIT;

static void c_locale_make(void)
{
	c_locale = newlocale(LC_ALL_MASK, "C", (locale_t)0);
}

const char *number_to_double(const char *text, double *ret)
{
	struct decimal decimal;
	const char *end = scan_decimal(text, &decimal);
	double value;

	if (!end)
		return scan_special(text, ret);
	if (decimal.digits == 0) {
		value = 0.0;
	} else if (!decimal.inexact && decimal.digits <= UINT64_C(1) << 53 &&
		   decimal.exponent >= -EXACT_TENS_MAX && decimal.exponent <= EXACT_TENS_MAX) {
		/* Both operands are exact, so one rounding gives the nearest double. */
		value = (double)decimal.digits;
		value = decimal.exponent < 0 ? value / tens[-decimal.exponent]
					     : value * tens[decimal.exponent];
	} else if (decimal_is_small(&decimal)) {
		value = decimal_round(&decimal, 53);
	} else {
		(void)pthread_once(&c_locale_once, c_locale_make);
		*ret = strtod_l(text, NULL, c_locale);
		return end;
	}
	*ret = decimal.negative ? -value : value;
	return end;
}

const char *number_to_float(const char *text, float *ret)
{
	struct decimal decimal;
	const char *end = scan_decimal(text, &decimal);
	float value;

	if (!end) {
		double special;

		end = scan_special(text, &special);
		if (end)
			*ret = (float)special;
		return end;
	}
	if (decimal.digits == 0) {
		value = 0.0f;
	} else if (!decimal.inexact && decimal.digits <= UINT64_C(1) << 24 &&
		   decimal.exponent >= -EXACT_TENS_FLOAT_MAX &&
		   decimal.exponent <= EXACT_TENS_FLOAT_MAX) {
		value = (float)decimal.digits;
		value = decimal.exponent < 0 ? value / (float)tens[-decimal.exponent]
					     : value * (float)tens[decimal.exponent];
	} else if (decimal_is_small(&decimal)) {
		/* 10^-27 to 10^46: what is too large for a float must become infinity. */
		value = (float)decimal_round(&decimal, 24);
	} else {
		(void)pthread_once(&c_locale_once, c_locale_make);
		*ret = strtof_l(text, NULL, c_locale);
		return end;
	}
	*ret = decimal.negative ? -value : value;
	return end;
}

const char *number_to_i64(const char *text, int64_t *ret)
{
	const char *at = text;
	bool negative = false;
	uint64_t value = 0;

	if (*at == '-' || *at == '+')
		negative = *at++ == '-';
	if (!is_digit(*at))
		return NULL;
	for (; is_digit(*at); at++) {
		if (value > (uint64_t)INT64_MAX / 10 - 1)
			return NULL;
		value = value * 10 + (uint64_t)(*at - '0');
	}
	*ret = negative ? -(int64_t)value : (int64_t)value;
	return at;
}
