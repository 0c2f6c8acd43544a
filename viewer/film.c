/* SPDX-License-Identifier: MIT */
#include "viewer/film.h"

#include <errno.h>
#include <stdlib.h>

#include "viewer/stop.h"

/* Takes one picture and counts it.  path: where it is written, or NULL. */
static int take(struct show *show, const struct camera *camera, const char *path, struct why *why)
{
	const struct options *options = show->options;
	struct frame_style style = options->style;
	struct frame_report report;
	int r;

	if (stop_requested())
		return why_set(why, -ECANCELED, "interrupted");
	show_set_budget(show, options->size.width, options->size.height, &style);
	r = picture_take(&show->picture, show->frame, &show->world, camera, &style, options->size,
			 options->is_settled, path, &report, why);
	if (r < 0)
		return r;
	return show_add(show,
			&(struct show_frame){ camera,
					      (double)options->size.width / options->size.height,
					      &style, &report },
			why);
}

static int take_frame(struct show *show, const struct camera *camera, size_t frame, struct why *why)
{
	char *path = NULL;
	int r = 0;

	if (show->options->frames_folder)
		r = show_frame_path(show->options->frames_folder, frame, &path, why);
	if (r == 0)
		r = take(show, camera, path, why);
	free(path);
	return r;
}

int film_run(struct show *show, struct why *why)
{
	const struct options *options = show->options;
	const double aspect = (double)options->size.width / options->size.height;
	const size_t row_count = options->path_count > 0 ? options->path_count : 1;
	const size_t frame_count = row_count * options->repeat_count;
	struct camera camera;

	show_first_camera(show, aspect, &camera);
	for (size_t frame = 0; frame < frame_count; frame++) {
		bool is_last = frame + 1 == frame_count;
		int r;

		if (options->path)
			camera = options->path[frame % row_count];
		/* The last frame is the screenshot; where it is in the folder too, it is taken twice. */
		if (is_last && options->screenshot_path && !options->frames_folder)
			r = take(show, &camera, options->screenshot_path, why);
		else
			r = take_frame(show, &camera, frame, why);
		if (r == 0 && is_last && options->screenshot_path && options->frames_folder) {
			struct frame_style style = options->style;
			struct frame_report report;

			show_set_budget(show, options->size.width, options->size.height, &style);
			r = picture_take(&show->picture, show->frame, &show->world, &camera, &style,
					 options->size, options->is_settled,
					 options->screenshot_path, &report, why);
		}
		if (r < 0)
			return r;
	}
	if (options->is_settled && show->statistics.sum.nodes_missing > 0)
		return why_set(why, -EIO, "the pictures are not whole: some nodes cannot be drawn");
	return 0;
}
