/* SPDX-License-Identifier: MIT */
/**
 * number.h - decimal numbers in model files: right to the last bit, fast, in no locale.
 *
 * Each function reads a number that begins exactly at text, stores it, and returns where it ends,
 * or NULL where there is none.  The text must be followed by some byte that belongs to no number
 * (sources end with a zero); blanks before it are not skipped.  "nan", "inf" and "infinity" in any
 * case are numbers: judging them is the builder's.
 *
 * Threads: any.
 */
#ifndef FORMATS_IMPORT_NUMBER_H
#define FORMATS_IMPORT_NUMBER_H

#include <stdint.h>

/** The nearest double, ties to even; infinity and zero where the range ends. */
const char *number_to_double(const char *text, double *ret);

/** The nearest float of the decimal itself, not of a double of it. */
const char *number_to_float(const char *text, float *ret);

/** NULL also for what does not fit. */
const char *number_to_i64(const char *text, int64_t *ret);

#endif /* FORMATS_IMPORT_NUMBER_H */
