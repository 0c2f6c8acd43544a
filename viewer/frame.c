/* SPDX-License-Identifier: MIT */
#include "viewer/frame.h"

#include <errno.h>
#include <stdlib.h>
#include <time.h>

#include "formats/base/check.h"
#include "formats/base/clock.h"
#include "formats/base/log.h"
#include "viewer/cost_probe.h"
#include "viewer/stop.h"

/* How long a settled frame waits without anything new. */
#define PATIENCE_NS (30 * NS_PER_S)
/* How often it looks whether the program is to stop. */
#define WAIT_STEP_MS 100
/* How often a picture is begun again after a daemon was lost in the midst of it. */
#define ATTEMPT_MAX 5

/* A node drawn in place. */
struct drawn {
	uint32_t store;
	uint32_t node;
	struct ooc_place place;
};

struct frame {
	struct world *world;
	struct renderer *renderer;
	struct residency *residency;
	GLsync fence; /* of the draws since the last frame_finish(); NULL: none */

	struct drawn *drawn; /* since the last frame_finish() */
	size_t drawn_count;
	size_t drawn_room;

	struct ooc_counters counters; /* at the report before */
};

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
	residency_destroy(frame->residency);
	renderer_destroy(frame->renderer);
	free(frame->drawn);
	free(frame);
	return NULL;
}

const char *frame_way_name(enum frame_way way)
{
	static const char *const names[FRAME_WAY_COUNT_] = {
		[FRAME_WAY_FULL] = "full",
		[FRAME_WAY_EVERYTHING] = "everything",
		[FRAME_WAY_BUDGET] = "budget",
	};

	return names[way];
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

static void begin_drawing(struct frame *frame, const struct frame_style *style,
			  const struct render_tile *tile)
{
	struct render_style render = { .channel = style->channel,
				       .unlit = style->unlit,
				       .tile = *tile };

	world_up(frame->world, render.up);
	renderer_begin(frame->renderer, &render);
}

/* Draws one wanted node.  Returns: 0, or why not, as residency_find() says it. */
static int draw_want(struct frame *frame, const struct world_want *want, uint32_t *view_of,
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
		renderer_set_view(frame->renderer, &store->view, want->store);
		*view_of = want->store;
	}
	renderer_draw(frame->renderer, &resident.payload, want->node);
	report->nodes_drawn++;
	report->triangles += store->nodes[want->node].triangle_count;
	return 0;
}

static void end_drawing(struct frame *frame)
{
	glBindVertexArray(0);
	frame->fence = glFenceSync(GL_SYNC_GPU_COMMANDS_COMPLETE, 0);
	glFlush();
}

/* ---- reports ---- */

static double ms_since(uint64_t begin_ns)
{
	return (double)(clock_now_ns() - begin_ns) / (double)NS_PER_MS;
}

static uint64_t grown_by(uint64_t before, uint64_t now)
{
	/* A new session counts from 0. */
	return now >= before ? now - before : now;
}

static void finish_report(struct frame *frame, uint64_t begin_ns, struct frame_report *report)
{
	struct ooc_counters now;

	ooc_counters(frame->world->client, &now);
	report->bytes_fetched = grown_by(frame->counters.fetched_bytes, now.fetched_bytes);
	report->bytes_prefetched = grown_by(frame->counters.prefetched_bytes, now.prefetched_bytes);
	frame->counters = now;
	report->nodes_missing = report->nodes_wanted - report->nodes_drawn;
	report->ms = ms_since(begin_ns);
}

/* Finds the nodes, and says in the report how. */
static int look(struct frame *frame, const struct camera *camera, double aspect,
		const struct frame_style *style, struct frame_report *report, struct why *why)
{
	struct world *world = frame->world;
	uint64_t begin_ns = clock_now_ns();
	int r = world_look(world, camera, aspect, style->mode, style->budget_triangles, why);

	if (r < 0)
		return r;
	report->selection_ms = ms_since(begin_ns);
	report->nodes_visited = world->nodes_visited;
	report->nodes_wanted = world->want_count;
	if (style->mode == WORLD_MODE_FULL)
		return 0;
	report->way = world->fits_budget ? FRAME_WAY_EVERYTHING : FRAME_WAY_BUDGET;
	report->budget_triangles = style->budget_triangles;
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

	/* The choice needs the HS alone: OpenGL may go on with the frame before. */
	r = look(frame, camera, aspect, style, &report, why);
	if (r < 0)
		return r;
	(void)frame_finish(frame);
	world_dispatch(world);
	r = world_ask(world, 0, world->want_count, why);
	if (r < 0)
		return r;
	residency_begin(frame->residency, true);
	target_begin(target, style->background);
	begin_drawing(frame, style, &render_tile_whole);
	for (size_t i = 0; i < world->want_count; i++) {
		if (draw_want(frame, &world->wants[i], &view_of, &report) == -ENOBUFS)
			report.is_unfinished = residency_has_copied(frame->residency);
	}
	end_drawing(frame);
	finish_report(frame, begin_ns, &report);
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
	begin_drawing(frame, &style, &render_tile_whole);
	for (size_t i = 0; i < frame->world->want_count; i++)
		(void)draw_want(frame, &frame->world->wants[i], &view_of, &report);
	end_drawing(frame);
	glDisable(GL_SCISSOR_TEST);
	item = target_read_item(&target, x, y);
	(void)frame_finish(frame);
	target_done(&target);
	return item;
}

/* ---- settled ---- */

/* A settled picture on its way. */
struct settling {
	size_t first;        /* wants before it are drawn, or will never come */
	uint64_t missing;    /* of these: will never come */
	uint64_t news_ns;    /* when something came last */
	size_t drawable_was; /* ooc_progress() then */
	bool ask_for_less;   /* nothing came of asking for all: ask for the first alone */
};

/* Waits until the set that was asked for is settled. */
static int wait_until_settled(struct frame *frame, struct settling *settling, struct why *why)
{
	for (;;) {
		struct ooc_progress progress;
		int r = ooc_wait(frame->world->client, WAIT_STEP_MS);

		if (stop_requested())
			return why_set(why, -ECANCELED, "interrupted");
		if (r == 0)
			return 0;
		if (r != -ETIMEDOUT && r != -ENOTCONN)
			return why_set(why, r, "waiting for nodes: %s",
				       ooc_error_text(frame->world->client));
		ooc_progress(frame->world->client, &progress);
		if (progress.drawable_count != settling->drawable_was) {
			settling->drawable_was = progress.drawable_count;
			settling->news_ns = clock_now_ns();
		}
		if (clock_now_ns() - settling->news_ns < PATIENCE_NS)
			continue;
		if (r == -ENOTCONN)
			return why_set(why, r,
				       "the daemon is gone and does not come back: start "
				       "it again (oocd), or look at its log");
		return why_set(why, r, "%zu of %zu nodes have not come for %d seconds",
			       progress.want_count - progress.drawable_count, progress.want_count,
			       (int)(PATIENCE_NS / NS_PER_S));
	}
}

/* Says once what is wrong with a node.  Returns: false when it may yet come. */
static bool never_comes(const struct frame *frame, const struct world_want *want)
{
	const struct world_store *store = &frame->world->stores[want->store];

	switch (ooc_not_now(store->store, want->node)) {
	case OOC_REASON_DAMAGED:
		log_warning("%s: node %u is damaged and not drawn; `oocctl verify` tells more",
			    store->path, want->node);
		return true;
	case OOC_REASON_UNREADABLE:
		log_warning("%s: node %u cannot be read and is not drawn; the daemon's log has "
			    "the reason",
			    store->path, want->node);
		return true;
	case OOC_REASON_LOST:
		log_warning("%s: the daemon serves it no longer; node %u is not drawn", store->path,
			    want->node);
		return true;
	case OOC_REASON_NONE:
	case OOC_REASON_FULL:
	case OOC_REASON_NO_MEMORY:
		break;
	}
	return false;
}

/*
 * Draws from the first node on as far as they have come without a gap.  Returns: 0, -ESTALE when
 * what was drawn was overwritten meanwhile, or -ENOMEM.
 */
static int draw_portion(struct frame *frame, struct settling *settling, struct frame_report *report)
{
	const struct world *world = frame->world;
	uint32_t view_of = UINT32_MAX;
	int r = 0;

	residency_begin(frame->residency, false);
	while (settling->first < world->want_count) {
		const struct world_want *want = &world->wants[settling->first];

		r = draw_want(frame, want, &view_of, report);
		if (r == -EAGAIN && never_comes(frame, want)) {
			settling->missing++;
			r = 0;
		}
		if (r < 0)
			break;
		settling->first++;
	}
	end_drawing(frame);
	report->portions++;
	if (!frame_finish(frame))
		return -ESTALE;
	return r == -ENOMEM ? r : 0;
}

/* Nothing of a portion could be drawn: others hold what there is.  Waits a little. */
static int be_patient(struct frame *frame, struct settling *settling, struct why *why)
{
	const struct timespec pause = { .tv_nsec = (long)(20 * NS_PER_MS) };
	const struct world_want *want = &frame->world->wants[settling->first];
	const struct world_store *store = &frame->world->stores[want->store];

	if (stop_requested())
		return why_set(why, -ECANCELED, "interrupted");
	if (clock_now_ns() - settling->news_ns > PATIENCE_NS)
		return why_set(why, -ENOBUFS,
			       "%s: node %u needs %u bytes, and the daemon's cache has had no room "
			       "for them for %d seconds: give it a larger --cache-size",
			       store->path, want->node, store->nodes[want->node].payload_bytes,
			       (int)(PATIENCE_NS / NS_PER_S));
	/* A set that has not changed says nothing: take turns. */
	settling->ask_for_less = !settling->ask_for_less;
	(void)nanosleep(&pause, NULL);
	return 0;
}

/* One attempt at the whole list.  Returns: 0, -ESTALE when it must be begun again, or -errno. */
static int draw_all(struct frame *frame, struct settling *settling, struct frame_report *report,
		    struct why *why)
{
	struct world *world = frame->world;
	uint64_t waiting_ns;
	int r;

	do {
		size_t first_was = settling->first;
		size_t count = world->want_count - settling->first;

		if (settling->ask_for_less)
			count = count > 1 ? 1 : 0;
		r = world_ask(world, settling->first, count, why);
		if (r < 0)
			return r;
		waiting_ns = clock_now_ns();
		r = wait_until_settled(frame, settling, why);
		report->waited_ms += ms_since(waiting_ns);
		if (r < 0)
			return r;
		r = draw_portion(frame, settling, report);
		if (r == -ENOMEM)
			return why_errno(why, r, "OpenGL's buffers");
		if (r < 0)
			return r;
		if (settling->first > first_was) {
			settling->news_ns = clock_now_ns();
			settling->ask_for_less = false;
		} else if (settling->first < world->want_count) {
			waiting_ns = clock_now_ns();
			r = be_patient(frame, settling, why);
			report->waited_ms += ms_since(waiting_ns);
			if (r < 0)
				return r;
		}
	} while (settling->first < world->want_count);
	return 0;
}

int frame_draw_settled(struct frame *frame, const struct camera *camera, double aspect,
		       const struct frame_style *style, const struct render_tile *tile,
		       const struct target *target, struct frame_report *ret, struct why *why)
{
	struct frame_report found = { 0 };
	struct frame_report report;
	uint64_t begin_ns = clock_now_ns();
	int r;

	r = look(frame, camera, aspect, style, &found, why);
	if (r < 0)
		return r;
	(void)frame_finish(frame);
	for (int attempt = 1;; attempt++) {
		struct settling settling = { .news_ns = clock_now_ns() };

		report = found;
		target_begin(target, style->background);
		begin_drawing(frame, style, tile);
		r = draw_all(frame, &settling, &report, why);
		if (r != -ESTALE)
			break;
		if (attempt == ATTEMPT_MAX)
			return why_set(why, -ENOTCONN,
				       "the daemon was lost %d times during one picture",
				       ATTEMPT_MAX);
	}
	if (r < 0)
		return r;
	finish_report(frame, begin_ns, &report);
	*ret = report;
	return 0;
}
