/* SPDX-License-Identifier: MIT */
/**
 * birds_eye.h - a store's cells from above, coloured by what the cache has of them.
 *
 * What lies higher is painted over what lies lower.  With a camera inside of the model, cells that
 * begin above its eye are left out, as if the roof had been taken off.
 *
 * Threads: any; a pure function.
 * Source: the view beside the user's in iWalk, Correa, Klosowski & Silva 2002, fig. 5b.
 */
#ifndef LIBCLIENT_SELECT_BIRDS_EYE_H
#define LIBCLIENT_SELECT_BIRDS_EYE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "formats/store/layout.h"
#include "libclient/select/camera.h"

/** What is known of a leaf. */
enum birds_eye_state {
	BIRDS_EYE_NOTHING, /* it has nothing to draw: not painted */
	BIRDS_EYE_ABSENT,
	BIRDS_EYE_BUSY,
	BIRDS_EYE_READY,
	BIRDS_EYE_HELD,
	BIRDS_EYE_DAMAGED,
	BIRDS_EYE_STATE_COUNT_
};

/** "absent"; never NULL. */
const char *birds_eye_state_name(enum birds_eye_state state);
/** r, g, b. */
void birds_eye_state_colour(enum birds_eye_state state, uint8_t ret[3]);

enum birds_eye_colouring {
	BIRDS_EYE_BY_STATE,
	BIRDS_EYE_BY_PRIORITY, /* from the first in the set to the last; what is not in it is dim */
	BIRDS_EYE_BY_LEVEL,    /* of the octree */
	BIRDS_EYE_COLOURING_COUNT_
};

/** "state", "priority", "level". */
extern const char *const birds_eye_colourings[];

struct birds_eye_node {
	uint8_t state;      /* enum birds_eye_state */
	bool is_wanted;     /* in the visible set: a white border */
	bool is_expected;   /* in the set that is expected: an orange one */
	uint32_t set_place; /* of a wanted one, from 0 on */
};

struct birds_eye {
	const struct store_superblock *superblock;
	const struct store_node *records;
	const struct birds_eye_node *nodes; /* a record */
	uint32_t want_count;
	const struct camera *camera; /* NULL: none is shown */
	double aspect;
	enum birds_eye_colouring colouring;
};

/**
 * Paints it.
 *
 * rgb:      width x height x 3 bytes, top row first; up is the way of the second horizontal axis.
 * scratch:  a uint32_t a record.
 */
void birds_eye_paint(const struct birds_eye *birds_eye, uint32_t width, uint32_t height,
		     uint32_t *scratch, uint8_t *rgb);

#endif /* LIBCLIENT_SELECT_BIRDS_EYE_H */
