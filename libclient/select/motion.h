/* SPDX-License-Identifier: MIT */
/**
 * motion.h - where a camera will be, from where it has been.
 *
 * Velocity and turning are medians of the last three steps, component by component, so that one
 * jump (a teleport, a dropped frame) does not send the prediction anywhere.  A camera goes on as it
 * goes: it keeps its speed, keeps turning, and its way turns with it.  README.md has what that was
 * measured against.
 *
 * Threads: a struct motion belongs to one; pure functions, no clock.
 */
#ifndef LIBCLIENT_SELECT_MOTION_H
#define LIBCLIENT_SELECT_MOTION_H

#include <stdint.h>

#include "libclient/select/camera.h"

#define MOTION_STEP_COUNT 3u

struct motion {
	struct camera newest;
	uint32_t camera_count; /* seen since it began, at most MOTION_STEP_COUNT + 1 */
	/* Of the last steps, in turn: units a second, and radians a second about an axis. */
	double velocities[MOTION_STEP_COUNT][3];
	double turns[MOTION_STEP_COUNT][3];
	uint32_t next;
};

/** Begins; no camera has been seen. */
void motion_init(struct motion *motion);

/**
 * Sees the next camera.  One that is not later than the one before replaces it; after a pause of
 * more than half a second the motion begins anew.
 */
void motion_note(struct motion *motion, const struct camera *camera);

/**
 * The camera at a time to come.  Before two cameras have been seen it is the newest.
 *
 * seconds:  after the newest camera, >= 0.
 *
 * Returns: 0, or -ENODATA (no camera has been seen).
 */
int motion_predict(const struct motion *motion, double seconds, struct camera *ret);

#endif /* LIBCLIENT_SELECT_MOTION_H */
