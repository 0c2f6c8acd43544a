/* SPDX-License-Identifier: MIT */
/**
 * why.h - the reason of a failure, in words, beside its errno.
 *
 * A function that can fail for a reason that a person has to read takes a `struct why *` as its
 * last parameter.  The function that finds the fault writes it, once; callers may put a place in
 * front of it (why_prefix).  Whoever handles the failure shows it.
 *
 * Threads: any; a struct why belongs to one caller.
 */
#ifndef FORMATS_BASE_WHY_H
#define FORMATS_BASE_WHY_H

#define WHY_TEXT_BYTES 512

struct why {
	char text[WHY_TEXT_BYTES]; /* one line, no full stop, never unterminated */
};

/**
 * Writes the reason.
 *
 * why:    NULL is allowed: nobody wants to know.
 * error:  a negative errno.
 *
 * Returns: error, for `return why_set(why, -EINVAL, "...", ...);`
 */
int why_set(struct why *why, int error, const char *format, ...)
	__attribute__((format(printf, 3, 4)));

/** The same, followed by ": " and strerror(-error).  For system calls. */
int why_errno(struct why *why, int error, const char *format, ...)
	__attribute__((format(printf, 3, 4)));

/** Puts "prefix: " in front of a reason that is there. */
void why_prefix(struct why *why, const char *format, ...) __attribute__((format(printf, 2, 3)));

#endif /* FORMATS_BASE_WHY_H */
