/* SPDX-License-Identifier: MIT */
#include "viewer/picture.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/clock.h"
#include "viewer/image.h"

/* Larger ones would need more memory than the viewer itself. */
#define TILE_SIDE_MAX 4096u

void picture_done(struct picture *picture)
{
	target_done(&picture->target);
	free(picture->pixels);
	picture->pixels = NULL;
}

static uint32_t tile_side(uint32_t side)
{
	uint32_t side_max = target_side_max();

	if (side_max > TILE_SIDE_MAX)
		side_max = TILE_SIDE_MAX;
	return side < side_max ? side : side_max;
}

/* Makes a target of the right size and kind, unless it is there. */
static int prepare_target(struct picture *picture, uint32_t width, uint32_t height,
			  enum channel channel, struct why *why)
{
	struct target *target = &picture->target;

	if (target->framebuffer && target->width == width && target->height == height &&
	    target->channel == channel)
		return 0;
	picture_done(picture);
	picture->pixels = malloc((size_t)width * height * channel_pixel_bytes(channel));
	if (!picture->pixels)
		return why_errno(why, -ENOMEM, "a picture of %ux%u", width, height);
	return target_init(target, width, height, channel, why);
}

/* How far away the world's box begins and ends, along the view. */
static void depth_range(const struct world *world, double near, double ret[2])
{
	const struct camera_view *view = &world->stores[0].view;
	const double scale = world->stores[0].scale;
	double box[2][3];

	ret[0] = near;
	ret[1] = 2.0 * near;
	if (!world_box(world, box[0], box[1]))
		return;
	ret[0] = INFINITY;
	ret[1] = -INFINITY;
	for (unsigned corner = 0; corner < 8; corner++) {
		double distance = 0.0;

		for (unsigned k = 0; k < 3; k++) {
			double origin = world->stores[0].superblock->origin[k];
			double eye = (view->eye[k] + origin) * scale;

			distance += (box[corner >> k & 1][k] - eye) * view->forward[k];
		}
		ret[0] = fmin(ret[0], distance);
		ret[1] = fmax(ret[1], distance);
	}
	ret[0] = fmax(ret[0], near);
}

/* The part of a picture from (x, y), counted from its upper left corner. */
static struct render_tile tile_at(struct picture_size size, uint32_t x, uint32_t y, uint32_t width,
				  uint32_t height)
{
	return (struct render_tile){
		.scale_x = (float)size.width / (float)width,
		.scale_y = (float)size.height / (float)height,
		.shift_x = (float)(((double)size.width - 2.0 * x) / width - 1.0),
		.shift_y = (float)((2.0 * y - (double)size.height) / height + 1.0),
	};
}

static void add_report(struct frame_report *sum, const struct frame_report *tile)
{
	sum->way = tile->way;
	sum->ms += tile->ms;
	sum->waited_ms += tile->waited_ms;
	sum->selection_ms += tile->selection_ms;
	sum->budget_triangles = tile->budget_triangles;
	sum->order = tile->order;
	sum->nodes_visited += tile->nodes_visited;
	sum->nodes_shown += tile->nodes_shown;
	sum->rounds += tile->rounds;
	sum->boxes_tested += tile->boxes_tested;
	sum->queries += tile->queries;
	sum->nodes_wanted = tile->nodes_wanted;
	sum->nodes_drawn = tile->nodes_drawn;
	sum->nodes_missing = tile->nodes_missing;
	sum->triangles += tile->triangles;
	sum->bytes_fetched += tile->bytes_fetched;
	sum->bytes_prefetched += tile->bytes_prefetched;
	sum->portions += tile->portions;
}

/* A picture on its way: whole, or row of tiles by row of tiles. */
struct taking {
	struct picture *picture;
	struct frame *frame;
	const struct world *world;
	const struct camera *camera;
	const struct frame_style *style;
	struct picture_size size;
	const char *path;            /* NULL: it is only drawn */
	struct image_writer *writer; /* from the first rows on */
	uint8_t *strip;              /* one row of tiles; NULL when it is taken whole */
};

/* Rows are drawn.  The file begins with the first ones: now the near plane is known. */
static int put_rows(struct taking *taking, const void *pixels, uint32_t row_count, struct why *why)
{
	int r;

	if (!taking->path)
		return 0;
	if (!taking->writer) {
		struct image_form form = { .width = taking->size.width,
					   .height = taking->size.height,
					   .channel = taking->style->channel,
					   .near = world_near(taking->world) };

		depth_range(taking->world, form.near, form.depth_range);
		r = image_create(taking->path, &form, &taking->writer, why);
		if (r < 0)
			return r;
	}
	return image_write_rows(taking->writer, pixels, row_count, why);
}

static int take_strip(struct taking *taking, uint32_t y, uint32_t height,
		      struct frame_report *report, struct why *why)
{
	const struct picture_size size = taking->size;
	const size_t pixel_bytes = channel_pixel_bytes(taking->style->channel);

	for (uint32_t x = 0; x < size.width;) {
		uint32_t width = tile_side(size.width - x);
		struct render_tile tile = tile_at(size, x, y, width, height);
		struct frame_report tile_report;
		int r = prepare_target(taking->picture, width, height, taking->style->channel, why);

		if (r < 0)
			return r;
		r = frame_draw_settled(taking->frame, taking->camera,
				       (double)size.width / size.height, taking->style, &tile,
				       &taking->picture->target, &tile_report, why);
		if (r < 0)
			return r;
		add_report(report, &tile_report);
		target_read(&taking->picture->target, taking->picture->pixels);
		for (uint32_t row = 0; row < height; row++)
			memcpy(taking->strip + ((size_t)row * size.width + x) * pixel_bytes,
			       taking->picture->pixels + (size_t)row * width * pixel_bytes,
			       width * pixel_bytes);
		x += width;
	}
	return 0;
}

static int take_tiles(struct taking *taking, struct frame_report *report, struct why *why)
{
	int r = 0;

	for (uint32_t y = 0; y < taking->size.height && r == 0;) {
		uint32_t height = tile_side(taking->size.height - y);

		r = take_strip(taking, y, height, report, why);
		if (r == 0)
			r = put_rows(taking, taking->strip, height, why);
		y += height;
	}
	return r;
}

static int take_whole(struct taking *taking, bool is_settled, struct frame_report *report,
		      struct why *why)
{
	const struct picture_size size = taking->size;
	const double aspect = (double)size.width / size.height;
	struct target *target = &taking->picture->target;
	uint64_t begin_ns = clock_now_ns();
	int r;

	r = prepare_target(taking->picture, size.width, size.height, taking->style->channel, why);
	if (r < 0)
		return r;
	if (is_settled) {
		r = frame_draw_settled(taking->frame, taking->camera, aspect, taking->style,
				       &render_tile_whole, target, report, why);
	} else {
		r = frame_draw_live(taking->frame, taking->camera, aspect, taking->style, target,
				    report, why);
		(void)frame_finish(taking->frame);
		report->ms = (double)(clock_now_ns() - begin_ns) / (double)NS_PER_MS;
	}
	if (r < 0 || !taking->path)
		return r;
	target_read(target, taking->picture->pixels);
	return put_rows(taking, taking->picture->pixels, size.height, why);
}

int picture_take(struct picture *picture, struct frame *frame, const struct world *world,
		 const struct camera *camera, const struct frame_style *style,
		 struct picture_size size, bool is_settled, const char *path,
		 struct frame_report *ret, struct why *why)
{
	struct taking taking = { .picture = picture,
				 .frame = frame,
				 .world = world,
				 .camera = camera,
				 .style = style,
				 .size = size,
				 .path = path };
	struct frame_report report = { 0 };
	int r;

	if (tile_side(size.width) == size.width && tile_side(size.height) == size.height) {
		r = take_whole(&taking, is_settled, &report, why);
	} else {
		taking.strip = malloc((size_t)size.width * tile_side(size.height) *
				      channel_pixel_bytes(style->channel));
		r = taking.strip ? take_tiles(&taking, &report, why)
				 : why_errno(why, -ENOMEM, "a picture of %ux%u", size.width,
					     size.height);
	}
	if (r == 0 && taking.writer) {
		r = image_commit(taking.writer, why);
		taking.writer = NULL;
	}
	image_abandon(taking.writer);
	free(taking.strip);
	if (r == 0)
		*ret = report;
	return r;
}
