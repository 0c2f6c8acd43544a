/* SPDX-License-Identifier: MIT */
#include "libclient/select/occlusion.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "libclient/select/raster.h"

/** An answer takes less than a microsecond, and the sooner a node is drawn the more it hides. */
#define ROUND_MAX 4u
/** Clearing the image and looking through it costs as much as a triangle for so many pixels. */
#define PIXELS_A_TRIANGLE 8u
/** A box is projected and compared in the time of so many triangles. */
#define TRIANGLES_A_BOX 8u

struct occlusion {
	uint32_t width;
	uint32_t height;
	struct raster *raster;
	bool is_to_clear; /* before it is looked at: a frame that is not tested is spared it */
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
	occlusion->is_to_clear = true;
}

static struct raster *image(struct occlusion *occlusion)
{
	if (occlusion->is_to_clear)
		raster_clear(occlusion->raster);
	occlusion->is_to_clear = false;
	return occlusion->raster;
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
			r = raster_draw_payload(image(store->occlusion), store->view, payload,
						store->item_first + nodes[i], 0);
		if (r < 0)
			return r;
	}
	return 0;
}

static const void *tester_payload(void *context, uint32_t node)
{
	const struct occlusion_store *store = context;

	return store->payload_of(store->context, node);
}

static int tester_test(void *context, const struct conservative_box *boxes, size_t box_count,
		       bool *ret_shows)
{
	const struct occlusion_store *store = context;

	const uint32_t side[2] = { store->occlusion->width, store->occlusion->height };

	for (size_t i = 0; i < box_count; i++) {
		struct screen_box box;

		ret_shows[i] = screen_box_set(&box, store->view, side, boxes[i].box_min,
					      boxes[i].box_max) &&
			       raster_shows(image(store->occlusion), &box);
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
	const uint64_t *items = raster_items(image(occlusion));
	uint32_t node_end = 0;

	for (size_t i = 0; i < node_count; i++)
		node_end = nodes[i] >= node_end ? nodes[i] + 1 : node_end;
	if (node_count == 0)
		return 0;
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
	const struct occlusion *occlusion = store->occlusion;
	uint64_t pixel_count = (uint64_t)occlusion->width * occlusion->height;

	return (struct conservative_tester){ .draw = tester_draw,
					     .test = tester_test,
					     .remain = tester_remain,
					     .payload = tester_payload,
					     .context = store,
					     .draws_twice = true,
					     .round_max = ROUND_MAX,
					     .overhead_triangles = pixel_count / PIXELS_A_TRIANGLE,
					     .box_triangles = TRIANGLES_A_BOX };
}
