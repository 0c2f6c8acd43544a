/* SPDX-License-Identifier: MIT */
/**
 * camera_path.h - a path walked faster or slower.
 *
 * Threads: any; pure functions.
 */
#ifndef VIEWER_CAMERA_PATH_H
#define VIEWER_CAMERA_PATH_H

#include <stdint.h>

#include "libclient/select/camera.h"

#define CAMERA_PATH_SPEED_MIN (1.0 / 1024.0)
#define CAMERA_PATH_SPEED_MAX 1024.0

/** Reads "4", "0.25" or "1/4".  Returns: 0, -EINVAL, or -ERANGE outside of the limits. */
int camera_path_speed(const char *text, double *ret);

/**
 * The frames of whoever walks a path at another speed: frame k is at row k x speed, between rows by
 * linear interpolation.  The frames come as often as the rows did, so that their times are those of
 * the path divided by the speed, and at whole speeds each is a row of the path, to the bit.
 *
 * rows:  count of them, > 0, as camera_from_row() accepts them; so are those of ret.
 *
 * Returns: 0, or -E2BIG (more than 2^24 frames) or -ENOMEM.  Ownership: free(*ret).
 */
int camera_path_at_speed(const struct camera *rows, uint32_t count, double speed,
			 struct camera **ret, uint32_t *ret_count);

#endif /* VIEWER_CAMERA_PATH_H */
