/* SPDX-License-Identifier: MIT */
/**
 * charted.h - what drawing a store in some way was measured to cost, and to get wrong.
 *
 * `oocbench chart` leaves this in the user's cache folder, by the store's uuid, and `oocview --error`
 * takes the cheapest way that is right enough.
 *
 * Threads: any.
 */
#ifndef LIBCLIENT_CHARTED_H
#define LIBCLIENT_CHARTED_H

#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"

#define CHARTED_OPTIONS_BYTES 128u
#define CHARTED_COUNT_MAX     64u

struct charted {
	double error;                        /* share of covered pixels that are wrong, mean */
	double ms;                           /* a frame, 95th percentile */
	char options[CHARTED_OPTIONS_BYTES]; /* of oocview, apart by blanks; no comma, no newline */
};

/**
 * Keeps a store's chart, in the place of an older one.
 *
 * Returns: 0, -ENOENT (there is no place for it), -ENOMEM or -errno.
 */
int charted_write(const uint8_t uuid[16], const struct charted *charted, size_t count,
		  struct why *why);

/**
 * The cheapest way with an error of at most error_max.
 *
 * Returns: 0, -ENOENT (the store was never charted), -ERANGE (no way is so right), -EUCLEAN (the file
 *	is none of ours) or -errno; with what to do.
 */
int charted_find(const uint8_t uuid[16], double error_max, struct charted *ret, struct why *why);

#endif /* LIBCLIENT_CHARTED_H */
