/* SPDX-License-Identifier: MIT */
#include "formats/import/batcher.h"

#include <errno.h>
#include <stdlib.h>

#define CORNERS_MAX (3 * (size_t)IMPORT_BATCH_TRIANGLES)

int batcher_init(struct batcher *batcher, bool positions_double,
		 const struct import_options *options, const struct import_sink *sink,
		 struct import_info *info, struct why *why)
{
	*batcher = (struct batcher){
		.options = options,
		.sink = sink,
		.info = info,
		.positions_double = positions_double,
	};
	if (positions_double)
		batcher->positions64 = malloc(CORNERS_MAX * 3 * sizeof(double));
	else
		batcher->positions32 = malloc(CORNERS_MAX * 3 * sizeof(float));
	if (!batcher->positions32)
		return why_set(why, -ENOMEM, "no memory for a batch of triangles");
	return 0;
}

void batcher_done(struct batcher *batcher)
{
	free(batcher->positions32);
	free(batcher->normals);
	free(batcher->colours);
	*batcher = (struct batcher){ 0 };
}

int batcher_part(struct batcher *batcher, const struct import_part *part, uint32_t *ret_number,
		 struct why *why)
{
	struct import_part told = {
		.name = part->name ? part->name : "",
		.scene_path = part->scene_path ? part->scene_path : "",
		.material = part->material ? part->material : "",
		.colour = batcher->options->colour == IMPORT_COLOUR_NONE ? IMPORT_COLOUR_DEFAULT
									 : part->colour,
	};
	int r;

	if (batcher->info->part_count >= UINT32_MAX)
		return why_set(why, -EOVERFLOW, "more than 2^32 parts");
	r = batcher->sink->part(batcher->sink->arg, &told, why);
	if (r < 0)
		return r;
	*ret_number = (uint32_t)batcher->info->part_count++;
	return 0;
}

int batcher_begin(struct batcher *batcher, const struct batch_kind *kind, struct why *why)
{
	int r = batcher_flush(batcher, why);

	if (r < 0)
		return r;
	if (kind->normals && !batcher->normals)
		batcher->normals = malloc(CORNERS_MAX * 3 * sizeof(float));
	if (kind->colours && !batcher->colours)
		batcher->colours = malloc(CORNERS_MAX * sizeof(uint32_t));
	if ((kind->normals && !batcher->normals) || (kind->colours && !batcher->colours))
		return why_set(why, -ENOMEM, "no memory for a batch of triangles");
	batcher->part = kind->part;
	batcher->normals_set = kind->normals;
	batcher->colours_set = kind->colours;
	return 0;
}

int batcher_flush(struct batcher *batcher, struct why *why)
{
	struct import_batch batch = {
		.triangle_count = batcher->triangle_count,
		.part = batcher->part,
		.positions_double = batcher->positions_double,
		.normals = batcher->normals_set ? batcher->normals : NULL,
		.colours = batcher->colours_set ? batcher->colours : NULL,
	};

	if (batcher->options->cancelled && *batcher->options->cancelled)
		return why_set(why, -ECANCELED, "cancelled");
	if (batcher->triangle_count == 0)
		return 0;
	if (batcher->positions_double)
		batch.positions64 = batcher->positions64;
	else
		batch.positions32 = batcher->positions32;
	batcher->info->triangle_count += batcher->triangle_count;
	batcher->triangle_count = 0;
	return batcher->sink->batch(batcher->sink->arg, &batch, why);
}
