/* SPDX-License-Identifier: MIT */
#include "viewer/frame_private.h"

#include <errno.h>
#include <stdlib.h>
#include <time.h>

#include "formats/base/check.h"
#include "formats/base/clock.h"
#include "formats/base/log.h"
#include "viewer/cost_probe.h"

int frame_create(struct world *world, uint64_t gpu_cache_bytes, struct frame **ret, struct why *why)
{
	struct frame *frame = calloc(1, sizeof(*frame));
	int r;

	if (!frame)
		return why_errno(why, -ENOMEM, "a frame");
	frame->world = world;
	r = renderer_create(&frame->renderer, why);
	if (r >= 0)
		r = residency_create(frame->renderer, gpu_cache_bytes, &frame->residency, why);
	if (r < 0) {
		frame_destroy(frame);
		return r;
	}
	*ret = frame;
	return 0;
}

struct frame *frame_destroy(struct frame *frame)
{
	if (!frame)
		return NULL;
	(void)frame_finish(frame);
	frame_conservative_destroy(frame->conservative);
	residency_destroy(frame->residency);
	renderer_destroy(frame->renderer);
	free(frame->drawn);
	free(frame);
	return NULL;
}

const char *frame_way_name(enum frame_way way)
{
	static const char *const names[FRAME_WAY_COUNT_] = {
		[FRAME_WAY_FULL] = "full",          [FRAME_WAY_EVERYTHING] = "everything",
		[FRAME_WAY_BUDGET] = "budget",      [FRAME_WAY_EXACT] = "exact",
		[FRAME_WAY_NEARLY] = "approximate", [FRAME_WAY_UNTESTED] = "untested",
	};

	return names[way];
}

const char *frame_visibility_name(enum frame_visibility visibility)
{
	static const char *const names[FRAME_VISIBILITY_COUNT_] = {
		[FRAME_VISIBILITY_ITEMS] = "items",
		[FRAME_VISIBILITY_QUERIES] = "queries",
		[FRAME_VISIBILITY_SOFTWARE] = "software",
	};

	return names[visibility];
}

int frame_costs(struct frame *frame, struct cost_model *ret, struct why *why)
{
	return cost_probe_get(frame->renderer, ret, why);
}

bool frame_is_in_place(const struct frame *frame)
{
	return residency_is_in_place(frame->residency);
}

/* ---- drawing ---- */

static int remember(struct frame *frame, const struct world_want *want,
		    const struct ooc_place *place)
{
	if (frame->drawn_count == frame->drawn_room) {
		size_t room = frame->drawn_room == 0 ? 256 : 2 * frame->drawn_room;
		struct drawn *drawn = reallocarray(frame->drawn, room, sizeof(*drawn));

		if (!drawn)
			return -ENOMEM;
		frame->drawn = drawn;
		frame->drawn_room = room;
	}
	frame->drawn[frame->drawn_count++] =
		(struct drawn){ .store = want->store, .node = want->node, .place = *place };
	return 0;
}

bool frame_finish(struct frame *frame)
{
	bool is_right = true;

	if (frame->fence) {
		while (glClientWaitSync(frame->fence, GL_SYNC_FLUSH_COMMANDS_BIT, NS_PER_S) ==
		       GL_TIMEOUT_EXPIRED)
			;
		glDeleteSync(frame->fence);
		frame->fence = NULL;
	}
	for (size_t i = 0; i < frame->drawn_count; i++) {
		const struct drawn *drawn = &frame->drawn[i];

		is_right = is_right && ooc_still_valid(frame->world->stores[drawn->store].store,
						       drawn->node, &drawn->place);
	}
	frame->drawn_count = 0;
	return is_right;
}

void frame_begin_drawing(struct frame *frame, const struct frame_style *style,
			 const struct render_tile *tile)
{
	struct render_style render = { .channel = style->channel,
				       .unlit = style->unlit,
				       .tile = *tile };

	world_up(frame->world, render.up);
	renderer_begin(frame->renderer, &render);
}

/* Draws one wanted node.  Returns: 0, or why not, as residency_find() says it. */
int frame_draw_want(struct frame *frame, const struct world_want *want, uint32_t *view_of,
		    struct frame_report *report)
{
	struct world_store *store = &frame->world->stores[want->store];
	struct resident resident;
	int r = residency_find(frame->residency, want->store, store->store, want->node, &resident);

	if (r == 0 && resident.is_in_place)
		r = remember(frame, want, &resident.place);
	if (r < 0)
		return r;
	if (*view_of != want->store) {
		renderer_set_view(frame->renderer, &store->view, want->store, store->first_seen);
		*view_of = want->store;
	}
	renderer_draw(frame->renderer, &resident.payload, want->node);
	report->nodes_drawn++;
	report->triangles += store->nodes[want->node].triangle_count;
	return 0;
}

void frame_end_drawing(struct frame *frame)
{
	glBindVertexArray(0);
	frame->fence = glFenceSync(GL_SYNC_GPU_COMMANDS_COMPLETE, 0);
	glFlush();
}

/* ---- reports ---- */

double frame_ms_since(uint64_t begin_ns)
{
	return (double)(clock_now_ns() - begin_ns) / (double)NS_PER_MS;
}

static uint64_t grown_by(uint64_t before, uint64_t now)
{
	/* A new session counts from 0. */
	return now >= before ? now - before : now;
}

void frame_finish_report(struct frame *frame, uint64_t begin_ns, struct frame_report *report)
{
	struct ooc_counters now;

	ooc_counters(frame->world->client, &now);
	report->bytes_fetched = grown_by(frame->counters.fetched_bytes, now.fetched_bytes);
	report->bytes_prefetched = grown_by(frame->counters.prefetched_bytes, now.prefetched_bytes);
	frame->counters = now;
	report->nodes_missing = report->nodes_wanted - report->nodes_drawn;
	report->ms = frame_ms_since(begin_ns);
}

/* Finds the nodes, and says in the report how. */
int frame_look(struct frame *frame, const struct camera *camera, double aspect,
	       const struct frame_style *style, struct frame_report *report, struct why *why)
{
	struct world *world = frame->world;
	uint64_t begin_ns = clock_now_ns();
	int r = world_look(world, camera, aspect, &style->choice, why);

	if (r < 0)
		return r;
	report->selection_ms = frame_ms_since(begin_ns);
	report->nodes_visited = world->nodes_visited;
	report->nodes_wanted = world->want_count;
	if (style->choice.mode == WORLD_MODE_FULL)
		return 0;
	report->way = world->fits_budget ? FRAME_WAY_EVERYTHING : FRAME_WAY_BUDGET;
	report->budget_triangles = style->choice.budget_triangles;
	report->order = style->choice.order;
	return 0;
}

/* ---- live ---- */

int frame_draw_live(struct frame *frame, const struct camera *camera, double aspect,
		    const struct frame_style *style, const struct target *target,
		    struct frame_report *ret, struct why *why)
{
	struct world *world = frame->world;
	struct frame_report report = { .portions = 1 };
	uint64_t begin_ns = clock_now_ns();
	uint32_t view_of = UINT32_MAX;
	int r;

	if (style->choice.mode == WORLD_MODE_CONSERVATIVE)
		return frame_draw_shown(frame,
					&(struct frame_picture){ camera, aspect, style,
								 &render_tile_whole, target },
					ret, why);
	/* The choice needs the HS alone: OpenGL may go on with the frame before. */
	r = frame_look(frame, camera, aspect, style, &report, why);
	if (r < 0)
		return r;
	(void)frame_finish(frame);
	world_dispatch(world);
	r = world_ask(world, 0, world->want_count, why);
	if (r < 0)
		return r;
	residency_begin(frame->residency, true);
	target_begin(target, style->background);
	frame_begin_drawing(frame, style, &render_tile_whole);
	for (size_t i = 0; i < world->want_count; i++) {
		if (frame_draw_want(frame, &world->wants[i], &view_of, &report) == -ENOBUFS)
			report.is_unfinished = residency_has_copied(frame->residency);
	}
	frame_end_drawing(frame);
	frame_finish_report(frame, begin_ns, &report);
	*ret = report;
	return 0;
}

uint64_t frame_pick(struct frame *frame, const struct target *shown, enum channel channel, int x,
		    int y)
{
	const uint8_t background[3] = { 0, 0, 0 };
	struct frame_style style = { .channel = channel };
	struct frame_report report = { 0 };
	uint32_t view_of = UINT32_MAX;
	struct target target;
	uint64_t item;

	if (target_init(&target, shown->width, shown->height, channel, NULL) < 0)
		return CHANNEL_ITEM_NONE;
	(void)frame_finish(frame);
	target_begin(&target, background);
	/* Only the pixel is drawn. */
	glEnable(GL_SCISSOR_TEST);
	glScissor(x, (GLint)target.height - 1 - y, 1, 1);
	residency_begin(frame->residency, true);
	frame_begin_drawing(frame, &style, &render_tile_whole);
	for (size_t i = 0; i < frame->world->want_count; i++)
		(void)frame_draw_want(frame, &frame->world->wants[i], &view_of, &report);
	frame_end_drawing(frame);
	glDisable(GL_SCISSOR_TEST);
	item = target_read_item(&target, x, y);
	(void)frame_finish(frame);
	target_done(&target);
	return item;
}
