/* SPDX-License-Identifier: MIT */
/**
 * foresight.h - asks for what the view will want soon, while frames are drawn.
 *
 * It gives libclient/look_ahead.h the world's stores to choose from: as the frames choose, at cameras
 * that are predicted.  It never waits, and holds nothing.
 *
 * Threads: the client's; the choice runs on the look-ahead's own thread, with selectors of its own.
 */
#ifndef VIEWER_FORESIGHT_H
#define VIEWER_FORESIGHT_H

#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "viewer/world.h"

struct foresight;

/**
 * Starts it.
 *
 * frame_bytes:  that a frame may ask for.
 *
 * Returns: 0, -ENOMEM or -errno.
 * Ownership: ends with foresight_destroy(), before the world, which it reads.
 */
int foresight_create(const struct world *world, uint64_t frame_bytes, struct foresight **ret,
		     struct why *why);
struct foresight *foresight_destroy(struct foresight *foresight);

/**
 * A frame has been asked for: shows its camera, and asks for what is expected by now.
 *
 * choice:  how the frames to come will choose; not WORLD_MODE_CONSERVATIVE, which can only be guessed
 *          by what most likely shows.
 */
void foresight_frame(struct foresight *foresight, const struct camera *camera, double aspect,
		     const struct world_choice *choice);

/** See look_ahead_expected(). */
size_t foresight_expected(struct foresight *foresight, struct ooc_want *ret);

#endif /* VIEWER_FORESIGHT_H */
