/* SPDX-License-Identifier: MIT */
/**
 * view_options.h - the command line of oocview, read and judged as a whole.
 *
 * Threads: main(), once.
 */
#ifndef VIEWER_VIEW_OPTIONS_H
#define VIEWER_VIEW_OPTIONS_H

#include <stdbool.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "libclient/select/camera.h"
#include "viewer/frame.h"
#include "viewer/picture.h"
#include "viewer/preset.h"

struct options {
	char *const *inputs; /* stores and models: of argv */
	uint32_t input_count;
	const char *socket_path; /* NULL: the usual places */
	bool is_headless;
	bool is_settled;
	bool wants_json;
	const struct preset *preset; /* NULL: none */
	double error_percent;    /* take the charted way that is right enough; < 0: not asked for */
	double fps;              /* to be kept by the budget; 0: none */
	uint64_t prefetch_bytes; /* a frame may ask for so much ahead; 0: nothing */
	struct picture_size size;
	bool has_size;
	struct frame_style style;
	struct camera *path; /* of --camera or --path; NULL: the default view */
	uint32_t path_count;
	bool has_path; /* it is a film: --path */
	uint32_t repeat_count;
	const char *record_path; /* NULL: none; likewise the others */
	const char *screenshot_path;
	const char *frames_folder;
	const char *stats_path;
	uint64_t gpu_cache_bytes; /* 0: draw in place where that works */
};

enum options_verdict {
	OPTIONS_RUN,
	OPTIONS_DONE,  /* --help or --version has been answered: exit 0 */
	OPTIONS_WRONG, /* has been said: exit 2 */
	OPTIONS_FAILED /* a file that an option names cannot be read, which has been said: exit 1 */
};

enum options_verdict options_read(struct options *ret, int argc, char **argv);
void options_done(struct options *options);

/**
 * Takes options of drawing over from a text, "--mode approximate --budget 100000".
 *
 * Returns: 0, or -EINVAL: something else stands there.
 */
int options_take_drawing(struct options *options, const char *text);

/** Does the program end after the last picture of its own accord? */
bool options_is_bounded(const struct options *options);

#endif /* VIEWER_VIEW_OPTIONS_H */
