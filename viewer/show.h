/* SPDX-License-Identifier: MIT */
/**
 * show.h - what a run works on, whether it is a film or a window.
 *
 * Threads: the GL thread.
 */
#ifndef VIEWER_SHOW_H
#define VIEWER_SHOW_H

#include <stdio.h>

#include "viewer/frame.h"
#include "viewer/picture.h"
#include "viewer/statistics.h"
#include "viewer/surface.h"
#include "viewer/view_options.h"
#include "viewer/world.h"

struct show {
	const struct options *options;
	struct surface *surface;
	struct world world;
	struct frame *frame;
	struct picture picture;
	struct statistics statistics;
	FILE *record; /* NULL: none wanted */
};

/** Writes the camera of a frame to the recording, if there is one.  Returns: 0 or -errno. */
int show_record(struct show *show, const struct camera *camera, struct why *why);

/** The camera to begin with. */
void show_first_camera(const struct show *show, double aspect, struct camera *ret);

/** "FOLDER/frame_000017.png".  Ownership: free(*ret).  Returns: 0 or -ENOMEM. */
int show_frame_path(const char *folder, size_t frame, char **ret, struct why *why);

#endif /* VIEWER_SHOW_H */
