/* SPDX-License-Identifier: MIT */
#include "libclient/select/occlusion.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/** An answer takes less than a microsecond, and the sooner a node is drawn the more it hides. */
#define ROUND_MAX 8u
/** A depth is computed with a relative error of a few of a float's last bits. */
#define DEPTH_SLACK 1e-5

struct occlusion {
	uint32_t width;
	uint32_t height;
	struct raster *raster;
	/* Scratch of remain(): a bit an item, of one store at a time. */
	uint8_t *seen;
	size_t seen_room;
};

int occlusion_create(uint32_t width, uint32_t height, struct occlusion **ret)
{
	struct occlusion *occlusion = calloc(1, sizeof(*occlusion));
	int r;

	if (!occlusion)
		return -ENOMEM;
	occlusion->width = width;
	occlusion->height = height;
	r = raster_create(width, height, &occlusion->raster);
	if (r == 0)
		r = raster_keep_farthest(occlusion->raster);
	if (r < 0) {
		occlusion_destroy(occlusion);
		return r;
	}
	*ret = occlusion;
	return 0;
}

struct occlusion *occlusion_destroy(struct occlusion *occlusion)
{
	if (!occlusion)
		return NULL;
	raster_destroy(occlusion->raster);
	free(occlusion->seen);
	free(occlusion);
	return NULL;
}

void occlusion_clear(struct occlusion *occlusion)
{
	raster_clear(occlusion->raster);
}

const struct raster *occlusion_image(const struct occlusion *occlusion)
{
	return occlusion->raster;
}

/* ---- boxes on the screen ---- */

/* A side of a rectangle: pixels, kept where they can be cast. */
static uint32_t pixel_of(double value, uint32_t side)
{
	return (uint32_t)fmin(fmax(value, 0.0), (double)side - 1.0);
}

/*
 * The pixels that a box may touch and the nearest depth it has there; it lies in front of the eye.
 * Returns: false when it is beside the picture.
 */
static bool box_project(const struct occlusion *occlusion, const struct camera_view *view,
			const struct conservative_box *box, struct raster_rectangle *ret,
			float *ret_depth)
{
	double low[2] = { INFINITY, INFINITY };
	double high[2] = { -INFINITY, -INFINITY };
	double nearest = INFINITY;

	for (unsigned corner = 0; corner < 8; corner++) {
		double x = 0.0;
		double y = 0.0;
		double w = 0.0;

		for (unsigned k = 0; k < 3; k++) {
			double from_eye = (corner >> k & 1 ? box->box_max[k] : box->box_min[k]) -
					  view->eye[k];

			x += view->right[k] * from_eye;
			y += view->up[k] * from_eye;
			w += view->forward[k] * from_eye;
		}
		nearest = fmin(nearest, w);
		x /= w * view->tan_half_x;
		y /= w * view->tan_half_y;
		low[0] = fmin(low[0], x);
		low[1] = fmin(low[1], y);
		high[0] = fmax(high[0], x);
		high[1] = fmax(high[1], y);
	}
	/* From -1 .. 1, y upwards, to pixels, rows from the top; one more on each side. */
	low[0] = (0.5 + 0.5 * low[0]) * occlusion->width - 1.0;
	high[0] = (0.5 + 0.5 * high[0]) * occlusion->width + 1.0;
	low[1] = (0.5 + 0.5 * low[1]) * occlusion->height - 1.0;
	high[1] = (0.5 + 0.5 * high[1]) * occlusion->height + 1.0;
	if (high[0] < 0.0 || high[1] < 0.0 || low[0] >= occlusion->width ||
	    low[1] >= occlusion->height)
		return false;
	*ret = (struct raster_rectangle){
		pixel_of(low[0], occlusion->width),
		occlusion->height - 1 - pixel_of(high[1], occlusion->height),
		pixel_of(high[0], occlusion->width),
		occlusion->height - 1 - pixel_of(low[1], occlusion->height),
	};
	*ret_depth = (float)(view->near / nearest * (1.0 + DEPTH_SLACK));
	return true;
}

/* ---- the tester ---- */

static int tester_draw(void *context, const uint32_t *nodes, size_t node_count, bool *ret_drawn)
{
	const struct occlusion_store *store = context;

	for (size_t i = 0; i < node_count; i++) {
		const void *payload = store->payload_of(store->context, nodes[i]);
		int r = 0;

		ret_drawn[i] = payload != NULL;
		if (payload)
			r = raster_draw_payload(store->occlusion->raster, store->view, payload,
						store->item_first + nodes[i], 0);
		if (r < 0)
			return r;
	}
	return 0;
}

static int tester_test(void *context, const struct conservative_box *boxes, size_t box_count,
		       bool *ret_shows)
{
	const struct occlusion_store *store = context;

	for (size_t i = 0; i < box_count; i++) {
		struct raster_rectangle rectangle;
		float depth;

		ret_shows[i] =
			box_project(store->occlusion, store->view, &boxes[i], &rectangle, &depth) &&
			raster_shows(store->occlusion->raster, &rectangle, depth);
	}
	return 0;
}

static int seen_reserve(struct occlusion *occlusion, size_t room)
{
	uint8_t *seen;

	if (room <= occlusion->seen_room)
		return 0;
	seen = realloc(occlusion->seen, room);
	if (!seen)
		return -ENOMEM;
	occlusion->seen = seen;
	occlusion->seen_room = room;
	return 0;
}

static int tester_remain(void *context, const uint32_t *nodes, size_t node_count, bool *ret_remains)
{
	const struct occlusion_store *store = context;
	struct occlusion *occlusion = store->occlusion;
	const uint64_t *items = raster_items(occlusion->raster);
	uint32_t node_end = 0;

	for (size_t i = 0; i < node_count; i++)
		node_end = nodes[i] >= node_end ? nodes[i] + 1 : node_end;
	if (seen_reserve(occlusion, node_end) < 0)
		return -ENOMEM;
	memset(occlusion->seen, 0, node_end);
	for (size_t i = 0; i < (size_t)occlusion->width * occlusion->height; i++)
		if (items[i] - store->item_first < node_end)
			occlusion->seen[items[i] - store->item_first] = 1;
	for (size_t i = 0; i < node_count; i++)
		ret_remains[i] = occlusion->seen[nodes[i]];
	return 0;
}

struct conservative_tester occlusion_tester(struct occlusion_store *store)
{
	return (struct conservative_tester){ .draw = tester_draw,
					     .test = tester_test,
					     .remain = tester_remain,
					     .context = store,
					     .round_max = ROUND_MAX };
}
