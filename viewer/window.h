/* SPDX-License-Identifier: MIT */
/**
 * window.h - a person at a window: gestures, keys, the head-up display.
 *
 * It draws what is there and never waits for disk or socket, but where the options ask for settled
 * frames of a path.  Where nothing moves and nothing is missing, it sleeps.
 *
 * Threads: the GL thread.
 */
#ifndef VIEWER_WINDOW_H
#define VIEWER_WINDOW_H

#include "formats/base/why.h"
#include "viewer/show.h"

/**
 * Shows the world until the window is closed; with a path, plays it first, and ends after it where
 * the options ask for something to be written.
 *
 * Returns: 0, -ECANCELED, or as picture_take() says.
 */
int window_run(struct show *show, struct why *why);

#endif /* VIEWER_WINDOW_H */
