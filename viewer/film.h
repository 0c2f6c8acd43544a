/* SPDX-License-Identifier: MIT */
/**
 * film.h - pictures without anybody watching: one, or one for each row of a path.
 *
 * Threads: the GL thread.
 */
#ifndef VIEWER_FILM_H
#define VIEWER_FILM_H

#include "formats/base/why.h"
#include "viewer/show.h"

/** Takes all pictures that the options ask for.  Returns: 0, -ECANCELED, or as picture_take(). */
int film_run(struct show *show, struct why *why);

#endif /* VIEWER_FILM_H */
