/* SPDX-License-Identifier: MIT */
#include "viewer/frame_conservative.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/base/clock.h"
#include "viewer/stop.h"

/*
 * Boxes tested at once by OpenGL.  Each round costs a wait for its answer; in a larger one more is
 * drawn that others of the same round hide.
 */
#define ROUND_MAX 64u
/* What a box costs OpenGL: its own twelve, and fragments. */
#define TRIANGLES_A_BOX 16u
/* Queries look at so large a share of what was drawn, in turn, whether it still shows. */
#define REMAIN_SHARE 8u
/* How often a live frame that waits looks whether the program is to stop. */
#define WAIT_STEP_MS 2

/* ---- drawing nodes ---- */

static struct world_store *store_of(const struct frame_conservative *self)
{
	return &self->frame->world->stores[self->store];
}

static const void *payload_of(void *context, uint32_t node)
{
	return ooc_map(context, node);
}

/* A frame_draw_fn for the software rasteriser. */
static int draw_in_software(struct frame *frame, const struct world_want *want, uint32_t *view_of,
			    struct frame_report *report)
{
	struct frame_conservative *self = frame->conservative;
	bool is_drawn = false;
	int r = self->software_tester.draw(self->software_tester.context, &want->node, 1,
					   &is_drawn);

	(void)view_of;
	(void)report;
	if (r < 0)
		return r;
	return is_drawn ? 0 : -EAGAIN;
}

static bool is_here(const struct frame_conservative *self, uint32_t node)
{
	const struct ooc_store *store = store_of(self)->store;

	return self->visibility == FRAME_VISIBILITY_SOFTWARE
		       ? ooc_map(store, node) != NULL
		       : residency_has(self->frame->residency, self->store, store, node);
}

/* Waits until all of these are here, or nothing more is waited for. */
static void wait_for(struct frame_conservative *self, const uint32_t *nodes, size_t node_count)
{
	uint64_t begin_ns = clock_now_ns();
	uint64_t waited_ns;
	size_t next = 0;

	while (!stop_requested()) {
		int r;

		while (next < node_count && is_here(self, nodes[next]))
			next++;
		if (next == node_count || clock_now_ns() - begin_ns >= self->patience_ns)
			break;
		r = ooc_wait(self->frame->world->client, WAIT_STEP_MS);
		/* It is settled: what is not here was refused.  Or the daemon is away. */
		if (r != -ETIMEDOUT) {
			if (r < 0)
				self->patience_ns = 0;
			break;
		}
	}
	waited_ns = clock_now_ns() - begin_ns;
	self->patience_ns -= u64_min(waited_ns, self->patience_ns);
	self->report->waited_ms += (double)waited_ns / (double)NS_PER_MS;
}

/*
 * Asks for nodes of the store in hand that are not here, beside all that was asked for before: what
 * has been drawn stays where it is.
 */
static int fetch(struct frame_conservative *self, const uint32_t *nodes, size_t node_count)
{
	struct world *world = self->frame->world;
	size_t count_was = world->want_count;
	int r;

	if (self->patience_ns == 0)
		return 0;
	for (size_t i = 0; i < node_count; i++) {
		if (is_here(self, nodes[i]) ||
		    frame_never_comes(self->frame, self->store, nodes[i]))
			continue;
		r = world_want(world, &(struct world_want){ .store = self->store,
							    .node = nodes[i],
							    .importance = 1.0f });
		if (r < 0)
			return r;
	}
	if (world->want_count == count_was)
		return 0;
	/* Rule 1 of frame.h. */
	glFinish();
	world_want_sort(world);
	r = world_ask(world, 0, world->want_count, self->why);
	if (r < 0)
		return r;
	wait_for(self, nodes, node_count);
	return 0;
}

/* Does a node that comes late have a sample at the same depth as what is drawn? */
static void look_for_ties(struct frame_conservative *self, const uint32_t *nodes, size_t node_count)
{
	struct frame_report uncounted = { 0 };
	uint32_t view_of = UINT32_MAX;
	GLuint is_tied = 0;

	glDepthFunc(GL_EQUAL);
	glDepthMask(GL_FALSE);
	glColorMask(GL_FALSE, GL_FALSE, GL_FALSE, GL_FALSE);
	glBeginQuery(GL_ANY_SAMPLES_PASSED, self->tie_query);
	for (size_t i = 0; i < node_count; i++) {
		const struct world_want want = { .store = self->store, .node = nodes[i] };

		(void)frame_draw_want(self->frame, &want, &view_of, &uncounted);
	}
	glEndQuery(GL_ANY_SAMPLES_PASSED);
	glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
	glDepthMask(GL_TRUE);
	glDepthFunc(GL_GREATER);
	glGetQueryObjectuiv(self->tie_query, GL_QUERY_RESULT, &is_tied);
	self->has_tied = is_tied != 0;
}

int frame_tester_draw_live(struct frame_conservative *self, frame_draw_fn draw,
			   const uint32_t *nodes, size_t node_count, bool *ret_drawn)
{
	int r = fetch(self, nodes, node_count);

	if (r < 0)
		return r;
	frame_begin_drawing(self->frame, self->picture->style, self->picture->tile);
	if (draw == frame_draw_want && self->is_out_of_order && !self->has_tied)
		look_for_ties(self, nodes, node_count);
	self->view_of = UINT32_MAX;
	for (size_t i = 0; i < node_count; i++) {
		const struct world_want want = { .store = self->store, .node = nodes[i] };

		r = draw(self->frame, &want, &self->view_of, self->report);
		if (r == -ENOBUFS)
			self->report->is_unfinished = residency_has_copied(self->frame->residency);
		ret_drawn[i] = r == 0;
	}
	return 0;
}

/* In portions, if need be: each set is of these nodes alone. */
static int draw_settled(struct frame_conservative *self, frame_draw_fn draw, const uint32_t *nodes,
			size_t node_count, bool *ret_drawn)
{
	struct world *world = self->frame->world;
	int r;

	world_want_none(world);
	for (size_t i = 0; i < node_count; i++) {
		r = world_want(world, &(struct world_want){ .store = self->store,
							    .node = nodes[i],
							    .importance = 1.0f / (float)(i + 1) });
		if (r < 0)
			return r;
	}
	frame_begin_drawing(self->frame, self->picture->style, self->picture->tile);
	r = frame_settle(self->frame, draw, true, self->report, self->why);
	for (size_t i = 0; i < node_count; i++)
		ret_drawn[i] = !frame_never_comes(self->frame, self->store, nodes[i]);
	return r;
}

/* ---- the tester ---- */

static int on_draw(void *context, const uint32_t *nodes, size_t node_count, bool *ret_drawn)
{
	struct frame_conservative *self = context;
	frame_draw_fn draw =
		self->visibility == FRAME_VISIBILITY_SOFTWARE ? draw_in_software : frame_draw_want;
	int r;

	if (self->is_settled)
		return draw_settled(self, draw, nodes, node_count, ret_drawn);
	r = frame_tester_draw_live(self, draw, nodes, node_count, ret_drawn);
	/* Before a test: what showed in the frame before. */
	if (!self->is_tested)
		self->is_out_of_order = true;
	return r;
}

static struct box_test_view test_view(const struct frame_conservative *self)
{
	return (struct box_test_view){ .view = &store_of(self)->view,
				       .tile = self->picture->tile,
				       .width = self->width,
				       .height = self->height };
}

static int test_queries(struct frame_conservative *self, const struct conservative_box *boxes,
			size_t box_count, bool *ret_shows)
{
	const struct box_test_view view = test_view(self);
	double latency_ns = self->picture->style->query_latency_ms * (double)NS_PER_MS;

	self->report->queries += box_count;
	return box_test_queries(self->boxes, &view, boxes, box_count, (uint64_t)latency_ns,
				ret_shows);
}

static int test_boxes(struct frame_conservative *self, const struct conservative_box *boxes,
		      size_t box_count, bool *ret_shows)
{
	const struct box_test_view view = test_view(self);

	switch (self->visibility) {
	case FRAME_VISIBILITY_ITEMS:
		return box_test_flags(self->boxes, &view, boxes, box_count, ret_shows);
	case FRAME_VISIBILITY_QUERIES:
		return test_queries(self, boxes, box_count, ret_shows);
	case FRAME_VISIBILITY_SOFTWARE:
		return self->software_tester.test(self->software_tester.context, boxes, box_count,
						  ret_shows);
	case FRAME_VISIBILITY_COUNT_:
		break;
	}
	CHECK(!"a way to test");
	return -EINVAL;
}

static const void *on_payload(void *context, uint32_t node)
{
	const struct frame_conservative *self = context;

	return payload_of(store_of(self)->store, node);
}

static int on_test(void *context, const struct conservative_box *boxes, size_t box_count,
		   bool *ret_shows)
{
	struct frame_conservative *self = context;
	uint64_t begin_ns = clock_now_ns();
	int r = test_boxes(self, boxes, box_count, ret_shows);

	self->is_tested = true;
	self->report->selection_ms += frame_ms_since(begin_ns);
	return r;
}

/* The item buffer tells for each pixel. */
static void remain_items(struct frame_conservative *self, const uint32_t *nodes, size_t node_count,
			 bool *ret_remains)
{
	const size_t pixel_count = (size_t)self->width * self->height;
	const uint32_t first = store_of(self)->first_seen;
	uint32_t before = FRAME_NOTHING_SEEN;

	glBindFramebuffer(GL_READ_FRAMEBUFFER, self->framebuffer);
	glReadBuffer(GL_COLOR_ATTACHMENT1);
	glReadPixels(0, 0, (GLsizei)self->width, (GLsizei)self->height, GL_RED_INTEGER,
		     GL_UNSIGNED_INT, self->seen_pixels);
	memset(self->is_seen, 0, self->node_count * sizeof(*self->is_seen));
	for (size_t i = 0; i < pixel_count; i++) {
		uint32_t seen = self->seen_pixels[i];

		if (seen == before)
			continue;
		before = seen;
		if (seen < self->node_count)
			self->is_seen[seen] = true;
	}
	for (size_t i = 0; i < node_count; i++)
		ret_remains[i] = self->is_seen[first + nodes[i]];
}

/* Queries ask again for a share of the boxes each frame, so that what is covered is found in turn. */
static int remain_queries(struct frame_conservative *self, const uint32_t *nodes, size_t node_count,
			  bool *ret_remains)
{
	const struct store_node *records = store_of(self)->nodes;
	struct conservative_box *boxes = calloc(node_count + 1, sizeof(*boxes));
	bool *shows = calloc(node_count + 1, sizeof(*shows));
	size_t box_count = 0;
	int r = -ENOMEM;

	if (!boxes || !shows)
		goto out;
	for (size_t i = 0; i < node_count; i++) {
		struct conservative_box *box = &boxes[box_count];

		ret_remains[i] = true;
		if ((nodes[i] + self->turn) % REMAIN_SHARE != 0)
			continue;
		box->node = (uint32_t)i;
		memcpy(box->box_min, records[nodes[i]].box_min, sizeof(box->box_min));
		memcpy(box->box_max, records[nodes[i]].box_max, sizeof(box->box_max));
		box_count++;
	}
	r = test_queries(self, boxes, box_count, shows);
	for (size_t i = 0; i < box_count && r == 0; i++)
		ret_remains[boxes[i].node] = shows[i];
out:
	free(boxes);
	free(shows);
	return r;
}

static int on_remain(void *context, const uint32_t *nodes, size_t node_count, bool *ret_remains)
{
	struct frame_conservative *self = context;
	uint64_t begin_ns = clock_now_ns();
	int r = 0;

	switch (self->visibility) {
	case FRAME_VISIBILITY_ITEMS:
		remain_items(self, nodes, node_count, ret_remains);
		break;
	case FRAME_VISIBILITY_QUERIES:
		r = remain_queries(self, nodes, node_count, ret_remains);
		break;
	case FRAME_VISIBILITY_SOFTWARE:
		r = self->software_tester.remain(self->software_tester.context, nodes, node_count,
						 ret_remains);
		break;
	case FRAME_VISIBILITY_COUNT_:
		CHECK(!"a way to test");
	}
	self->report->selection_ms += frame_ms_since(begin_ns);
	return r;
}

struct conservative_tester frame_tester_begin(struct frame_conservative *self, uint32_t store_index)
{
	struct conservative_tester tester = { .draw = on_draw,
					      .test = on_test,
					      .remain = on_remain,
					      .payload = on_payload,
					      .context = self,
					      .round_max = ROUND_MAX,
					      .box_triangles = TRIANGLES_A_BOX };
	const struct world_store *store;

	self->store = store_index;
	self->is_tested = false;
	self->is_out_of_order = self->report->nodes_drawn > 0;
	store = store_of(self);
	if (self->visibility == FRAME_VISIBILITY_SOFTWARE) {
		self->software = (struct occlusion_store){ .occlusion = self->occlusion,
							   .view = &store->view,
							   .payload_of = payload_of,
							   .context = store->store,
							   .item_first = store->first_seen };
		self->software_tester = occlusion_tester(&self->software);
		tester.round_max = self->software_tester.round_max;
		tester.draws_twice = self->software_tester.draws_twice;
		tester.box_triangles = self->software_tester.box_triangles;
	}
	return tester;
}
