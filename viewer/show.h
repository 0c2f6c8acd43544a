/* SPDX-License-Identifier: MIT */
/**
 * show.h - what a run works on, whether it is a film or a window.
 *
 * Threads: the GL thread.
 */
#ifndef VIEWER_SHOW_H
#define VIEWER_SHOW_H

#include <stdio.h>

#include "viewer/foresight.h"
#include "viewer/frame.h"
#include "viewer/pace.h"
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
	struct cost_model costs;
	struct pace pace;            /* fps 0: none is to be kept */
	struct foresight *foresight; /* NULL: nothing is asked for ahead */
};

/** Prepares to keep the pace that the options ask for, if any.  Returns: 0 or -ENOMEM. */
int show_begin_pace(struct show *show, struct why *why);

/** Begins to look ahead, if the options ask for it.  Returns: 0, -ENOMEM or -errno. */
int show_begin_foresight(struct show *show, struct why *why);

/** Sets the budget of the next picture, of so many pixels, where a pace is kept. */
void show_set_budget(struct show *show, uint32_t width, uint32_t height, struct frame_style *style);

/** A frame that was drawn. */
struct show_frame {
	const struct camera *camera;
	double aspect;
	const struct frame_style *style;
	const struct frame_report *report;
};

/** Counts a frame: statistics, recording, pace, and what is ahead.  Returns: 0, -ENOMEM or -errno. */
int show_add(struct show *show, const struct show_frame *frame, struct why *why);

/** The camera to begin with. */
void show_first_camera(const struct show *show, double aspect, struct camera *ret);

/** "FOLDER/frame_000017.png".  Ownership: free(*ret).  Returns: 0 or -ENOMEM. */
int show_frame_path(const char *folder, size_t frame, char **ret, struct why *why);

#endif /* VIEWER_SHOW_H */
