/* SPDX-License-Identifier: MIT */
/**
 * text.h - numbers and sizes, from and to text, the same in every program.
 *
 * Threads: any.
 */
#ifndef FORMATS_BASE_TEXT_H
#define FORMATS_BASE_TEXT_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

/** Cuts blanks and line ends off both ends, in place.  Returns: where it begins then. */
char *text_trim(char *text);

/**
 * Reads a whole text as a size: digits, then K, M, G or T (powers of 1024) or nothing.
 *
 * Returns: 0, -EINVAL when it is something else, -ERANGE when it does not fit.
 */
int text_to_size(const char *text, uint64_t *ret_bytes);

/** Reads a whole text as a decimal number.  Returns: 0, -EINVAL or -ERANGE. */
int text_to_u64(const char *text, uint64_t *ret);

/** Reads a whole text as a finite number, in the C locale's form.  Returns: 0, -EINVAL or -ERANGE. */
int text_to_double(const char *text, double *ret);

#define TEXT_SIZE_BYTES 32

/** "12.3 MiB".  Returns: buffer, which has TEXT_SIZE_BYTES. */
const char *text_from_size(uint64_t bytes, char *buffer);

/** Writes text as a JSON string with its quotes; bytes that are no UTF-8 become U+FFFD. */
void text_write_json(FILE *out, const char *text);

#endif /* FORMATS_BASE_TEXT_H */
