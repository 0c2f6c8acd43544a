/* SPDX-License-Identifier: MIT */
/**
 * chart.h - ways of drawing a store, each measured for what it costs and how wrong it is.
 *
 * A *setting* is a position of all dials, as a command line of oocview.  Its pictures of the views of
 * a scene are compared with those of the full mode: pixels that show another triangle, colours that
 * differ, FLIP, and how much the error flickers from a frame to the next.  These are the same every
 * time, and are found once.  Its times are of settled frames with everything in memory, of the piece of
 * the path that has most to draw, taken in turn with all other settings and with a control that
 * always does the same work; a setting that another beat every time is timed no more.
 *
 * Threads: the main thread.
 */
#ifndef TOOLS_BENCH_ACCURACY_CHART_H
#define TOOLS_BENCH_ACCURACY_CHART_H

#include <limits.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "libclient/select/camera.h"
#include "tools/bench/base/figures.h"
#include "tools/bench/base/rgb_image.h"

#define CHART_OPTION_COUNT_MAX  8u
#define CHART_SETTING_COUNT_MAX 64u
#define CHART_REPEAT_COUNT_MAX  64u

/** Each view's figures. */
struct chart_view {
	double wrong_of_covered; /* pixels that show another triangle, or none, or one where none is */
	double wrong_of_all;
	double colour_of_covered; /* a channel of the colour differs by more than 8 of 255 */
	double flip;              /* mean */
};

struct chart_setting {
	char name[48];
	const char *method; /* what the dials turn: settings of one method make a curve */
	char texts[CHART_OPTION_COUNT_MAX][24];
	unsigned text_count; /* options of oocview */
	double scale;        /* of the picture's sides */

	struct chart_view *views;
	double pop;       /* RMSE of the error's change from a frame to the next, of 255 */
	double triangles; /* drawn a frame, mean */
	double p95_ms[CHART_REPEAT_COUNT_MAX]; /* of each repeat */
	double p95_of_control[CHART_REPEAT_COUNT_MAX];
	size_t repeat_count; /* fewer than asked for where it was beaten */
	/* Over the views and repeats. */
	double wrong_of_covered_mean, wrong_of_covered_worst;
	double wrong_of_all_mean, wrong_of_all_worst;
	double colour_mean, flip_mean;
	struct spread ms;
	struct spread of_control;
};

/** The views of one scene: pieces of a path, of `burst` frames that follow each other. */
struct chart_scene {
	const char *title;
	struct camera *cameras;
	size_t camera_count;
	size_t burst;
};

struct chart_options {
	const char *store;
	uint32_t width;
	uint32_t height;
	unsigned repeat_count;
	const char *scratch;
	const char *socket_path; /* of a daemon in which all of the store is resident */
};

/** Everything measured of one scene. */
struct chart {
	const struct chart_options *options;
	const struct chart_scene *scene;
	struct chart_setting settings[CHART_SETTING_COUNT_MAX];
	size_t setting_count;
	struct rgb_image *items;   /* of the full mode, a view */
	struct rgb_image *colours; /* likewise */
	double full_triangles;     /* a frame of the full mode, mean */
	size_t timed_first;        /* the first view of the piece that is timed */
};

/**
 * Draws the full mode, which all others are compared with.
 *
 * Returns: 0, -ECANCELED, or what the viewer said.  Ownership: ends with chart_done().
 */
int chart_init(struct chart *chart, const struct chart_options *options,
	       const struct chart_scene *scene, struct why *why);
void chart_done(struct chart *chart);

/** Adds a setting; options: NULL-terminated, for oocview; scale: of the picture's sides. */
void chart_add(struct chart *chart, const char *method, const char *name, double scale,
	       const char *const *options);

/** Its options of oocview, apart by blanks.  Returns: buffer. */
const char *chart_options_text(const struct chart_setting *setting, char *buffer, size_t bytes);

/** Measures all settings.  Returns: 0, -ECANCELED, or what the viewer said. */
int chart_measure(struct chart *chart, struct why *why);

/**
 * The picture of a setting and its errors beside it, of one view.
 *
 * Returns: 0 or what drawing it said.  Ownership: both end with rgb_image_done().
 */
int chart_picture(const struct chart *chart, const struct chart_setting *setting, size_t view,
		  struct rgb_image *ret, struct rgb_image *ret_errors, struct why *why);

#endif /* TOOLS_BENCH_ACCURACY_CHART_H */
