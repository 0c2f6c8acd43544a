/* SPDX-License-Identifier: MIT */
#include "viewer/show.h"

#include <errno.h>
#include <stdlib.h>

#define FOV_Y_DEGREES_DEFAULT 45.0

int show_record(struct show *show, const struct camera *camera, struct why *why)
{
	char row[CAMERA_ROW_BYTES];

	if (!show->record)
		return 0;
	errno = 0;
	if (fprintf(show->record, "%s\n", camera_to_row(camera, row)) < 0)
		return why_errno(why, errno ? -errno : -EIO, "%s", show->options->record_path);
	return 0;
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
