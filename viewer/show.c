/* SPDX-License-Identifier: MIT */
#include "viewer/show.h"

#include <errno.h>
#include <stdlib.h>

#define FOV_Y_DEGREES_DEFAULT 45.0

int show_begin_pace(struct show *show, struct why *why)
{
	const struct options *options = show->options;
	int r;

	if (options->fps == 0.0)
		return 0;
	r = frame_costs(show->frame, &show->costs, why);
	if (r == 0)
		pace_init(&show->pace, &show->costs, options->fps,
			  (double)options->size.width * options->size.height);
	return r;
}

void show_set_budget(struct show *show, uint32_t width, uint32_t height, struct frame_style *style)
{
	double pixels = (double)width * height;

	if (show->pace.fps == 0.0)
		return;
	if (show->pace.pixels != pixels)
		pace_resize(&show->pace, &show->costs, pixels);
	style->choice.budget_triangles = show->pace.budget_triangles;
}

/* Writes the camera of a frame to the recording, if there is one. */
static int record(struct show *show, const struct camera *camera, struct why *why)
{
	char row[CAMERA_ROW_BYTES];

	if (!show->record)
		return 0;
	errno = 0;
	if (fprintf(show->record, "%s\n", camera_to_row(camera, row)) < 0)
		return why_errno(why, errno ? -errno : -EIO, "%s", show->options->record_path);
	return 0;
}

int show_add(struct show *show, const struct camera *camera, const struct frame_report *report,
	     struct why *why)
{
	int r = statistics_add(&show->statistics, camera->time_s, report, why);

	if (show->pace.fps > 0.0 && report->budget_triangles > 0)
		pace_add(&show->pace, report->ms - report->waited_ms, (double)report->triangles);
	return r < 0 ? r : record(show, camera, why);
}

void show_first_camera(const struct show *show, double aspect, struct camera *ret)
{
	if (show->options->path)
		*ret = show->options->path[0];
	else
		world_frame_all(&show->world, aspect, FOV_Y_DEGREES_DEFAULT, ret);
}

int show_frame_path(const char *folder, size_t frame, char **ret, struct why *why)
{
	if (asprintf(ret, "%s/frame_%06zu.png", folder, frame) < 0)
		return why_errno(why, -ENOMEM, "%s", folder);
	return 0;
}
