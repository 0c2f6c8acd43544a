/* SPDX-License-Identifier: MIT */
#include "viewer/frame_private.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/base/clock.h"
#include "formats/base/log.h"
#include "libclient/select/conservative.h"
#include "libclient/select/occlusion.h"
#include "viewer/box_test.h"
#include "viewer/raster_check.h"
#include "viewer/stop.h"
#include "viewer/tight_boxes.h"

/*
 * Boxes tested at once by OpenGL.  Each round costs a wait for its answer; in a larger one more is
 * drawn that others of the same round hide.
 */
#define ROUND_MAX 64u
/* Queries look at so large a share of what was drawn, in turn, whether it still shows. */
#define REMAIN_SHARE 8u
/* Nodes whose boxes are learnt in one frame, so that no frame learns a whole model: about a ms. */
#define LEARNT_MAX 64u
/* How often a live frame that waits looks whether the program is to stop. */
#define WAIT_STEP_MS 2

/* As libclient/select/conservative.c has it: covers what the float transform rounds. */
#define NEAR_MARGIN 1.01

#define NOTHING_SEEN UINT32_MAX

struct frame_conservative {
	struct frame *frame;
	struct box_test *boxes;
	struct conservative *stores[WORLD_STORE_COUNT_MAX];
	struct tight_boxes *tight[WORLD_STORE_COUNT_MAX];
	struct conservative_result results[WORLD_STORE_COUNT_MAX]; /* of the frame in hand */
	uint64_t turn;                                             /* frames so far */

	/* The target's own buffers, and beside them which node each pixel shows. */
	GLuint framebuffer;
	GLuint seen;
	uint32_t width;
	uint32_t height;
	uint32_t *seen_pixels;
	bool *is_seen; /* a node, numbered through all stores */
	size_t node_count;

	struct occlusion *occlusion; /* NULL: not used yet; as large as the picture */
	bool is_software_exact;

	/* Tight boxes of a round, and which box of the round each is of. */
	struct {
		struct conservative_box *boxes;
		size_t *of;
		bool *shows;
		size_t room;
		size_t count;
	} fine;

	/* The frame in hand. */
	uint32_t learnt; /* nodes whose tight boxes are new */
	const struct frame_picture *picture;
	struct frame_report *report;
	struct why *why;
	enum frame_visibility visibility;
	bool is_settled;
	uint64_t patience_ns; /* that a live one has left to wait */
	uint32_t store;       /* that is worked out */
	uint32_t view_of;     /* the store whose view OpenGL has */
	struct occlusion_store software;
	struct conservative_tester software_tester;
};

/* ---- making it ---- */

struct frame_conservative *frame_conservative_destroy(struct frame_conservative *self)
{
	if (!self)
		return NULL;
	for (uint32_t i = 0; i < WORLD_STORE_COUNT_MAX; i++) {
		conservative_destroy(self->stores[i]);
		tight_boxes_destroy(self->tight[i]);
	}
	free(self->fine.boxes);
	free(self->fine.of);
	free(self->fine.shows);
	glDeleteFramebuffers(1, &self->framebuffer);
	glDeleteRenderbuffers(1, &self->seen);
	box_test_destroy(self->boxes);
	occlusion_destroy(self->occlusion);
	free(self->seen_pixels);
	free(self->is_seen);
	free(self);
	return NULL;
}

static int create(struct frame *frame, struct frame_conservative **ret, struct why *why)
{
	const struct world *world = frame->world;
	struct frame_conservative *self = calloc(1, sizeof(*self));
	int r = -ENOMEM;

	if (!self)
		return why_errno(why, -ENOMEM, "a conservative frame");
	self->frame = frame;
	for (uint32_t i = 0; i < world->store_count; i++) {
		self->node_count += world->stores[i].superblock->node_count;
		r = conservative_create(world->stores[i].selector, &self->stores[i]);
		if (r == 0)
			r = tight_boxes_create(world->stores[i].superblock->node_count,
					       &self->tight[i]);
		if (r < 0)
			goto err_destroy;
	}
	self->is_seen = calloc(self->node_count + 1, sizeof(*self->is_seen));
	if (!self->is_seen) {
		r = -ENOMEM;
		goto err_destroy;
	}
	r = box_test_create(&self->boxes, why);
	if (r < 0) {
		frame_conservative_destroy(self);
		return r;
	}
	*ret = self;
	return 0;

err_destroy:
	frame_conservative_destroy(self);
	return why_errno(why, r, "a conservative frame");
}

/* Makes the item buffer as large as the target, and puts it beside the target's buffers. */
static int fit_target(struct frame_conservative *self, const struct target *target)
{
	const GLenum buffers[] = { GL_COLOR_ATTACHMENT0, GL_COLOR_ATTACHMENT1 };

	if (self->width != target->width || self->height != target->height) {
		glDeleteRenderbuffers(1, &self->seen);
		free(self->seen_pixels);
		self->width = 0;
		self->seen_pixels =
			calloc((size_t)target->width * target->height, sizeof(*self->seen_pixels));
		if (!self->seen_pixels)
			return -ENOMEM;
		while (glGetError() != GL_NO_ERROR)
			;
		glCreateRenderbuffers(1, &self->seen);
		glNamedRenderbufferStorage(self->seen, GL_R32UI, (GLsizei)target->width,
					   (GLsizei)target->height);
		if (glGetError() != GL_NO_ERROR)
			return -ENOMEM;
		self->width = target->width;
		self->height = target->height;
	}
	/* A target of the same size may be another one, under the same name. */
	glDeleteFramebuffers(1, &self->framebuffer);
	glCreateFramebuffers(1, &self->framebuffer);
	glNamedFramebufferRenderbuffer(self->framebuffer, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER,
				       target->pixels);
	glNamedFramebufferRenderbuffer(self->framebuffer, GL_COLOR_ATTACHMENT1, GL_RENDERBUFFER,
				       self->seen);
	glNamedFramebufferRenderbuffer(self->framebuffer, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER,
				       target->depth);
	glNamedFramebufferDrawBuffers(self->framebuffer, ARRAY_LENGTH(buffers), buffers);
	return 0;
}

static bool is_whole(const struct render_tile *tile)
{
	return memcmp(tile, &render_tile_whole, sizeof(*tile)) == 0;
}

/* Makes the software's image as large as the picture; says once whether it is exact here. */
static int fit_occlusion(struct frame_conservative *self, const struct target *target)
{
	uint32_t wrong = 0;
	int r;

	if (self->occlusion && self->width == target->width && self->height == target->height)
		return 0;
	if (!self->occlusion) {
		r = raster_check(self->frame->renderer, &wrong, self->why);
		if (r < 0)
			return r;
		self->is_software_exact = wrong == 0;
		if (wrong > 0)
			log_warning("the software rasteriser differs from %s in %u pixels: what it "
				    "finds is approximate; --visibility items is exact",
				    (const char *)glGetString(GL_RENDERER), wrong);
	}
	self->occlusion = occlusion_destroy(self->occlusion);
	r = occlusion_create(target->width, target->height, &self->occlusion);
	return r < 0 ? why_errno(self->why, r, "the software rasteriser") : 0;
}

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

static int draw_live(struct frame_conservative *self, frame_draw_fn draw, const uint32_t *nodes,
		     size_t node_count, bool *ret_drawn)
{
	int r = fetch(self, nodes, node_count);

	if (r < 0)
		return r;
	frame_begin_drawing(self->frame, self->picture->style, self->picture->tile);
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

	return self->is_settled ? draw_settled(self, draw, nodes, node_count, ret_drawn)
				: draw_live(self, draw, nodes, node_count, ret_drawn);
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

/* Does a box reach to where the software cannot project it? */
static bool reaches_near(const struct camera_view *view, const struct conservative_box *box)
{
	double least = 0.0;

	for (int k = 0; k < 3; k++)
		least += fmin((box->box_min[k] - view->eye[k]) * view->forward[k],
			      (box->box_max[k] - view->eye[k]) * view->forward[k]);
	return least <= view->near * NEAR_MARGIN;
}

/* The software tests what lies behind the near plane; the rest shows. */
static int test_in_software(struct frame_conservative *self, const struct conservative_box *boxes,
			    size_t box_count, bool *ret_shows)
{
	const struct camera_view *view = &store_of(self)->view;

	for (size_t i = 0; i < box_count; i++) {
		int r = 0;

		ret_shows[i] = reaches_near(view, &boxes[i]);
		if (!ret_shows[i])
			r = self->software_tester.test(self->software_tester.context, &boxes[i], 1,
						       &ret_shows[i]);
		if (r < 0)
			return r;
	}
	return 0;
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
		return test_in_software(self, boxes, box_count, ret_shows);
	case FRAME_VISIBILITY_COUNT_:
		break;
	}
	CHECK(!"a way to test");
	return -EINVAL;
}

static int reserve_fine(struct frame_conservative *self, size_t count)
{
	size_t room = count + count / 2;
	void *grown;

	if (count <= self->fine.room)
		return 0;
	grown = reallocarray(self->fine.boxes, room, sizeof(*self->fine.boxes));
	if (!grown)
		return -ENOMEM;
	self->fine.boxes = grown;
	grown = reallocarray(self->fine.of, room, sizeof(*self->fine.of));
	if (!grown)
		return -ENOMEM;
	self->fine.of = grown;
	grown = reallocarray(self->fine.shows, room, sizeof(*self->fine.shows));
	if (!grown)
		return -ENOMEM;
	self->fine.shows = grown;
	self->fine.room = room;
	return 0;
}

/* Adds the tight boxes of a box to those that are tested, if they are known or can be learnt. */
static int take_fine(struct frame_conservative *self, const struct conservative_box *box,
		     size_t number)
{
	struct tight_boxes *tight = self->tight[self->store];
	const struct conservative_box *fine;
	uint32_t count = tight_boxes_find(tight, box->node, &fine);
	const void *payload = NULL;
	int r;

	if (count == 0 && self->learnt < LEARNT_MAX)
		payload = ooc_map(store_of(self)->store, box->node);
	if (payload) {
		r = tight_boxes_learn(tight, box, payload);
		if (r < 0)
			return r;
		self->learnt++;
		count = tight_boxes_find(tight, box->node, &fine);
	}
	r = reserve_fine(self, self->fine.count + count);
	if (r < 0)
		return r;
	for (uint32_t i = 0; i < count; i++) {
		self->fine.boxes[self->fine.count] = fine[i];
		self->fine.of[self->fine.count++] = number;
	}
	return 0;
}

/* Of what shows as a whole, hides again what has no part that shows. */
static int test_fine(struct frame_conservative *self, const struct conservative_box *boxes,
		     size_t box_count, bool *shows)
{
	int r = 0;

	self->fine.count = 0;
	for (size_t i = 0; i < box_count && r == 0; i++)
		if (shows[i])
			r = take_fine(self, &boxes[i], i);
	if (r == 0 && self->fine.count > 0)
		r = test_boxes(self, self->fine.boxes, self->fine.count, self->fine.shows);
	if (r < 0)
		return r;
	for (size_t i = 0; i < self->fine.count; i++)
		shows[self->fine.of[i]] = false;
	for (size_t i = 0; i < self->fine.count; i++)
		shows[self->fine.of[i]] = shows[self->fine.of[i]] || self->fine.shows[i];
	self->report->boxes_tested += self->fine.count;
	return 0;
}

static int on_test(void *context, const struct conservative_box *boxes, size_t box_count,
		   bool *ret_shows)
{
	struct frame_conservative *self = context;
	uint64_t begin_ns = clock_now_ns();
	int r = test_boxes(self, boxes, box_count, ret_shows);

	if (r == 0)
		r = test_fine(self, boxes, box_count, ret_shows);
	self->report->selection_ms += frame_ms_since(begin_ns);
	return r;
}

/* The item buffer tells for each pixel. */
static void remain_items(struct frame_conservative *self, const uint32_t *nodes, size_t node_count,
			 bool *ret_remains)
{
	const size_t pixel_count = (size_t)self->width * self->height;
	const uint32_t first = store_of(self)->first_seen;
	uint32_t before = NOTHING_SEEN;

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

/* ---- a frame ---- */

/* Makes ready for a picture: everything but the world's views. */
static int begin(struct frame *frame, const struct frame_picture *picture, bool is_settled,
		 struct frame_report *report, struct why *why)
{
	const GLuint nothing[4] = { NOTHING_SEEN, 0, 0, 0 };
	struct frame_conservative *self;
	int r = 0;

	if (!frame->conservative)
		r = create(frame, &frame->conservative, why);
	if (r < 0)
		return r;
	self = frame->conservative;
	self->picture = picture;
	self->report = report;
	self->why = why;
	self->is_settled = is_settled;
	self->turn++;
	self->learnt = 0;
	self->visibility = picture->style->visibility;
	/* The software's image is of the whole picture. */
	if (!is_whole(picture->tile))
		self->visibility = FRAME_VISIBILITY_ITEMS;
	if (self->visibility == FRAME_VISIBILITY_SOFTWARE) {
		r = fit_occlusion(self, picture->target);
		if (r < 0)
			return r;
		occlusion_clear(self->occlusion);
	}
	r = fit_target(self, picture->target);
	if (r < 0)
		return why_errno(why, r, "an item buffer of %ux%u", picture->target->width,
				 picture->target->height);
	target_begin(picture->target, picture->style->background);
	glBindFramebuffer(GL_FRAMEBUFFER, self->framebuffer);
	glClearBufferuiv(GL_COLOR, 1, nothing);
	return 0;
}

/* Works out what shows of each store, each against what the ones before it hide. */
static int find(struct frame_conservative *self)
{
	const struct world *world = self->frame->world;
	const struct conservative_tester tester = { .draw = on_draw,
						    .test = on_test,
						    .remain = on_remain,
						    .context = self,
						    .tests_near = true,
						    .round_max = ROUND_MAX };
	struct frame_report *report = self->report;
	size_t untested_count = 0;

	for (uint32_t i = 0; i < world->store_count; i++) {
		const struct world_store *store = &world->stores[i];
		struct conservative_result *result = &self->results[i];
		struct conservative_tester used = tester;
		int r;

		self->store = i;
		if (self->visibility == FRAME_VISIBILITY_SOFTWARE) {
			self->software =
				(struct occlusion_store){ .occlusion = self->occlusion,
							  .view = &store->view,
							  .payload_of = payload_of,
							  .context = store->store,
							  .item_first = store->first_seen };
			self->software_tester = occlusion_tester(&self->software);
			used.round_max = self->software_tester.round_max;
		}
		r = conservative_begin(self->stores[i], &store->view, NULL, &used, result);
		if (r < 0)
			return r;
		untested_count += result->is_untested;
		report->nodes_visited += result->candidate_count;
		report->nodes_wanted += result->entry_count;
		report->nodes_shown += result->shown_count;
		report->rounds += result->rounds;
		report->boxes_tested += result->boxes_tested;
	}
	if (untested_count == world->store_count)
		report->way = FRAME_WAY_UNTESTED;
	else if (self->visibility == FRAME_VISIBILITY_SOFTWARE && !self->is_software_exact)
		report->way = FRAME_WAY_NEARLY;
	else
		report->way = FRAME_WAY_EXACT;
	return 0;
}

/* Makes what is not hidden the world's list. */
static int want_found(struct frame_conservative *self)
{
	struct world *world = self->frame->world;

	world_want_none(world);
	for (uint32_t i = 0; i < world->store_count; i++) {
		const struct conservative_result *result = &self->results[i];

		for (size_t k = 0; k < result->entry_count; k++) {
			const struct conservative_entry *entry = &result->entries[k];
			int r = world_want(world,
					   &(struct world_want){ .store = i,
								 .node = entry->node,
								 .importance = entry->importance });

			if (r < 0)
				return r;
		}
	}
	if (world->store_count > 1)
		world_want_sort(world);
	return 0;
}

/* Draws in the order of the list what the search has not drawn into the picture. */
static int draw_rest(struct frame_conservative *self)
{
	struct world *world = self->frame->world;

	for (uint32_t i = 0; i < world->store_count; i++) {
		const struct conservative_result *result = &self->results[i];
		const bool is_drawn =
			self->visibility != FRAME_VISIBILITY_SOFTWARE && !result->is_untested;
		uint32_t *nodes;
		bool *drawn;
		int r;

		if (is_drawn || result->entry_count == 0)
			continue;
		nodes = calloc(result->entry_count, sizeof(*nodes));
		drawn = calloc(result->entry_count, sizeof(*drawn));
		for (size_t k = 0; nodes && k < result->entry_count; k++)
			nodes[k] = result->entries[k].node;
		self->store = i;
		r = nodes && drawn
			    ? draw_live(self, frame_draw_want, nodes, result->entry_count, drawn)
			    : -ENOMEM;
		free(nodes);
		free(drawn);
		if (r < 0)
			return r;
	}
	return 0;
}

int frame_draw_shown(struct frame *frame, const struct frame_picture *picture,
		     struct frame_report *ret, struct why *why)
{
	struct frame_report report = { .portions = 1 };
	struct world *world = frame->world;
	uint64_t begin_ns = clock_now_ns();
	int r;

	r = world_point(world, picture->camera, picture->aspect, why);
	if (r < 0)
		return r;
	(void)frame_finish(frame);
	world_dispatch(world);
	residency_begin(frame->residency, true);
	r = begin(frame, picture, false, &report, why);
	if (r < 0)
		return r;
	frame->conservative->patience_ns =
		(uint64_t)(picture->style->deadline_ms * (double)NS_PER_MS);
	r = find(frame->conservative);
	if (r == 0)
		r = draw_rest(frame->conservative);
	if (r == 0)
		r = want_found(frame->conservative);
	if (r == 0)
		r = world_ask(world, 0, world->want_count, why);
	frame_end_drawing(frame);
	if (r < 0)
		return r == -ENOMEM ? why_errno(why, r, "a conservative frame") : r;
	frame_finish_report(frame, begin_ns, &report);
	report.is_incomplete = report.nodes_missing > 0;
	*ret = report;
	return 0;
}

int frame_find_shown(struct frame *frame, const struct frame_picture *picture,
		     struct frame_report *report, struct why *why)
{
	/* What is drawn to find out is not what the picture is drawn of. */
	struct frame_report finding = { 0 };
	int r = world_point(frame->world, picture->camera, picture->aspect, why);

	if (r == 0)
		r = begin(frame, picture, true, &finding, why);
	if (r == 0)
		r = find(frame->conservative);
	if (r == 0)
		r = want_found(frame->conservative);
	if (r < 0)
		return r;
	finding.nodes_drawn = 0;
	finding.triangles = 0;
	finding.portions = 0;
	*report = finding;
	return 0;
}
