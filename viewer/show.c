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

int show_begin_foresight(struct show *show, struct why *why)
{
	if (show->options->prefetch_bytes == 0)
		return 0;
	return foresight_create(&show->world, show->options->prefetch_bytes, &show->foresight, why);
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

/* How the next frames will choose; what shows can only be guessed: twice as much as showed here. */
static struct world_choice choice_ahead(const struct show_frame *frame)
{
	struct world_choice choice = frame->style->choice;

	if (choice.mode != WORLD_MODE_CONSERVATIVE)
		return choice;
	choice.mode = WORLD_MODE_APPROXIMATE;
	choice.order = SELECT_ORDER_AUTO;
	choice.budget_triangles = 2 * frame->report->triangles + 1;
	return choice;
}

int show_add(struct show *show, const struct show_frame *frame, struct why *why)
{
	const struct frame_report *report = frame->report;
	int r = statistics_add(&show->statistics, frame->camera->time_s, report, why);

	if (show->pace.fps > 0.0 && report->budget_triangles > 0)
		pace_add(&show->pace, report->ms - report->waited_ms, (double)report->triangles);
	if (show->foresight) {
		const struct world_choice choice = choice_ahead(frame);

		foresight_frame(show->foresight, frame->camera, frame->aspect, &choice);
	}
	return r < 0 ? r : record(show, frame->camera, why);
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
