/* SPDX-License-Identifier: MIT */
#include "viewer/frame_private.h"

#include <errno.h>

#include "formats/base/clock.h"
#include "formats/base/log.h"
#include "viewer/stop.h"

/* How long a settled frame waits without anything new. */
#define PATIENCE_NS (30 * NS_PER_S)
/* How often it looks whether the program is to stop. */
#define WAIT_STEP_MS 100
/* How often a picture is begun again after a daemon was lost in the midst of it. */
#define ATTEMPT_MAX 5

/* A settled picture on its way. */
struct settling {
	size_t first;        /* wants before it are drawn, or will never come */
	uint64_t news_ns;    /* when something came last */
	size_t drawable_was; /* ooc_progress() then */
	frame_draw_fn draw;
	bool is_quiet;
	bool ask_for_less; /* nothing came of asking for all: ask for the first alone */
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

bool frame_never_comes(const struct frame *frame, uint32_t store, uint32_t node)
{
	switch (ooc_not_now(frame->world->stores[store].store, node)) {
	case OOC_REASON_DAMAGED:
	case OOC_REASON_UNREADABLE:
	case OOC_REASON_LOST:
		return true;
	case OOC_REASON_NONE:
	case OOC_REASON_FULL:
	case OOC_REASON_NO_MEMORY:
		break;
	}
	return false;
}

/* Says what is wrong with a node that never comes. */
static void say_what_is_wrong(const struct frame *frame, const struct world_want *want)
{
	const struct world_store *store = &frame->world->stores[want->store];
	enum ooc_reason reason = ooc_not_now(store->store, want->node);

	if (reason == OOC_REASON_DAMAGED)
		log_warning("%s: node %u is damaged and not drawn; `oocctl verify` tells more",
			    store->path, want->node);
	else if (reason == OOC_REASON_UNREADABLE)
		log_warning("%s: node %u cannot be read and is not drawn; the daemon's log has "
			    "the reason",
			    store->path, want->node);
	else
		log_warning("%s: the daemon serves it no longer; node %u is not drawn", store->path,
			    want->node);
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

		r = settling->draw(frame, want, &view_of, report);
		if (r == -EAGAIN && frame_never_comes(frame, want->store, want->node)) {
			if (!settling->is_quiet)
				say_what_is_wrong(frame, want);
			r = 0;
		}
		if (r < 0)
			break;
		settling->first++;
	}
	frame_end_drawing(frame);
	report->portions++;
	if (!frame_finish(frame))
		return -ESTALE;
	return r == -ENOMEM ? r : 0;
}

/* Nothing of a portion could be drawn: others hold what there is.  Waits a little. */
static int be_patient(struct frame *frame, struct settling *settling, struct why *why)
{
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
	clock_pause_ns(20 * NS_PER_MS);
	return 0;
}

int frame_settle(struct frame *frame, frame_draw_fn draw, bool is_quiet,
		 struct frame_report *report, struct why *why)
{
	struct settling settling = { .news_ns = clock_now_ns(),
				     .draw = draw,
				     .is_quiet = is_quiet };
	struct world *world = frame->world;
	uint64_t waiting_ns;
	int r;

	do {
		size_t first_was = settling.first;
		size_t count = world->want_count - settling.first;

		if (settling.ask_for_less)
			count = count > 1 ? 1 : 0;
		r = world_ask(world, settling.first, count, why);
		if (r < 0)
			return r;
		waiting_ns = clock_now_ns();
		r = wait_until_settled(frame, &settling, why);
		report->waited_ms += frame_ms_since(waiting_ns);
		if (r < 0)
			return r;
		r = draw_portion(frame, &settling, report);
		if (r == -ENOMEM)
			return why_errno(why, r, "OpenGL's buffers");
		if (r < 0)
			return r;
		if (settling.first > first_was) {
			settling.news_ns = clock_now_ns();
			settling.ask_for_less = false;
		} else if (settling.first < world->want_count) {
			waiting_ns = clock_now_ns();
			r = be_patient(frame, &settling, why);
			report->waited_ms += frame_ms_since(waiting_ns);
			if (r < 0)
				return r;
		}
	} while (settling.first < world->want_count);
	return 0;
}

/* Finds the nodes, where that takes drawing, and draws them. */
static int attempt(struct frame *frame, const struct frame_picture *picture,
		   struct frame_report *report, struct why *why)
{
	if (picture->style->choice.mode == WORLD_MODE_CONSERVATIVE) {
		int r = frame_find_shown(frame, picture, report, why);

		if (r < 0)
			return r;
	}
	target_begin(picture->target, picture->style->background);
	frame_begin_drawing(frame, picture->style, picture->tile);
	return frame_settle(frame, frame_draw_want, false, report, why);
}

int frame_draw_settled(struct frame *frame, const struct camera *camera, double aspect,
		       const struct frame_style *style, const struct render_tile *tile,
		       const struct target *target, struct frame_report *ret, struct why *why)
{
	const struct frame_picture picture = { camera, aspect, style, tile, target };
	struct frame_report found = { 0 };
	struct frame_report report;
	uint64_t begin_ns = clock_now_ns();
	int r = 0;

	if (style->choice.mode != WORLD_MODE_CONSERVATIVE)
		r = frame_look(frame, camera, aspect, style, &found, why);
	if (r < 0)
		return r;
	(void)frame_finish(frame);
	for (int attempts = 1;; attempts++) {
		report = found;
		r = attempt(frame, &picture, &report, why);
		if (r != -ESTALE)
			break;
		if (attempts == ATTEMPT_MAX)
			return why_set(why, -ENOTCONN,
				       "the daemon was lost %d times during one picture",
				       ATTEMPT_MAX);
	}
	if (r < 0)
		return r;
	frame_finish_report(frame, begin_ns, &report);
	*ret = report;
	return 0;
}
