/* SPDX-License-Identifier: MIT */
#include "tools/bench/accuracy/judge.h"

#include <errno.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "libclient/select/raster.h"
#include "tools/bench/accuracy/resident.h"

struct judge {
	struct resident resident;
	struct selector *selector;
	struct raster *raster;
	uint32_t width;
	uint32_t height;
	uint32_t *pixels; /* a node: those that it wins */
	bool *drawn;      /* a node */
};

int judge_create(const char *store, uint32_t width, uint32_t height, struct judge **ret,
		 struct why *why)
{
	struct judge *judge = calloc(1, sizeof(*judge));
	size_t node_count;
	int r;

	if (!judge)
		return why_set(why, -ENOMEM, "out of memory");
	r = resident_open(&judge->resident, store, why);
	if (r < 0)
		goto err_destroy;
	node_count = judge->resident.superblock->node_count;
	judge->width = width;
	judge->height = height;
	judge->pixels = calloc(node_count + 1, sizeof(*judge->pixels));
	judge->drawn = calloc(node_count + 1, sizeof(*judge->drawn));
	if (!judge->pixels || !judge->drawn ||
	    selector_create(judge->resident.superblock, judge->resident.nodes, &judge->selector) <
		    0 ||
	    raster_create(width, height, &judge->raster) < 0) {
		r = why_set(why, -ENOMEM, "out of memory");
		goto err_destroy;
	}
	*ret = judge;
	return 0;

err_destroy:
	judge_destroy(judge);
	return r;
}

struct judge *judge_destroy(struct judge *judge)
{
	if (!judge)
		return NULL;
	raster_destroy(judge->raster);
	selector_destroy(judge->selector);
	free(judge->pixels);
	free(judge->drawn);
	resident_close(&judge->resident);
	free(judge);
	return NULL;
}

static int view_make(const struct judge *judge, const struct camera *camera,
		     struct camera_view *ret)
{
	const struct store_superblock *superblock = judge->resident.superblock;

	return camera_view_init(ret, camera, superblock, (double)judge->width / judge->height,
				camera_near(camera, superblock));
}

static void choose(struct judge *judge, const struct camera_view *view,
		   const struct select_options *options, struct selection *ret)
{
	if (options->budget_triangles == 0)
		select_frustum(judge->selector, view, ret);
	else
		select_approximate(judge->selector, view, options, ret);
}

/* Draws a selection whole, and counts whose pixels those are.  Returns: covered ones, or -ENOMEM. */
static int64_t draw(struct judge *judge, const struct camera_view *view,
		    const struct selection *selection)
{
	size_t pixel_count = (size_t)judge->width * judge->height;
	const uint64_t *items = raster_items(judge->raster);
	int64_t covered = 0;

	raster_clear(judge->raster);
	for (size_t i = 0; i < selection->entry_count; i++) {
		uint64_t node = selection->entries[i].node;

		if (raster_draw_payload(judge->raster, view, judge->resident.payloads[node],
					node << 32, 1) < 0)
			return -ENOMEM;
	}
	memset(judge->pixels, 0, judge->resident.superblock->node_count * sizeof(*judge->pixels));
	for (size_t i = 0; i < pixel_count; i++) {
		if (items[i] == RASTER_ITEM_NONE)
			continue;
		covered++;
		judge->pixels[items[i] >> 32]++;
	}
	return covered;
}

int judge_settled(struct judge *judge, const struct camera *camera,
		  const struct select_options *options, const uint32_t *missing,
		  size_t missing_count, struct verdict *ret)
{
	struct verdict verdict = { .all = (uint64_t)judge->width * judge->height };
	struct selection selection;
	struct camera_view view;
	int64_t covered;
	int r = view_make(judge, camera, &view);

	if (r < 0)
		return r;
	choose(judge, &view, options, &selection);
	covered = draw(judge, &view, &selection);
	if (covered < 0)
		return -ENOMEM;
	verdict.covered = (uint64_t)covered;
	for (size_t i = 0; i < missing_count; i++)
		verdict.wrong += judge->pixels[missing[i]];
	*ret = verdict;
	return 0;
}

int judge_exact(struct judge *judge, const struct camera *camera,
		const struct select_options *options, const uint32_t *missing, size_t missing_count,
		struct verdict *ret)
{
	uint32_t node_count = (uint32_t)judge->resident.superblock->node_count;
	struct verdict verdict = { .all = (uint64_t)judge->width * judge->height };
	struct selection selection;
	struct camera_view view;
	int64_t covered;
	int r = view_make(judge, camera, &view);

	if (r < 0)
		return r;
	memset(judge->drawn, 0, node_count * sizeof(*judge->drawn));
	choose(judge, &view, options, &selection);
	for (size_t i = 0; i < selection.entry_count; i++)
		judge->drawn[selection.entries[i].node] = true;
	for (size_t i = 0; i < missing_count; i++)
		judge->drawn[missing[i]] = false;
	select_frustum(judge->selector, &view, &selection);
	covered = draw(judge, &view, &selection);
	if (covered < 0)
		return -ENOMEM;
	verdict.covered = (uint64_t)covered;
	for (uint32_t i = 0; i < node_count; i++)
		verdict.wrong += judge->drawn[i] ? 0 : judge->pixels[i];
	*ret = verdict;
	return 0;
}
