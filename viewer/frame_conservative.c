/* SPDX-License-Identifier: MIT */
#include "viewer/frame_conservative.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "formats/base/log.h"
#include "viewer/raster_check.h"

/* ---- making it ---- */

struct frame_conservative *frame_conservative_destroy(struct frame_conservative *self)
{
	if (!self)
		return NULL;
	for (uint32_t i = 0; i < WORLD_STORE_COUNT_MAX; i++)
		conservative_destroy(self->stores[i]);
	glDeleteQueries(1, &self->tie_query);
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
	glGenQueries(1, &self->tie_query);
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

/* ---- a frame ---- */

/* Makes ready for a picture: everything but the world's views. */
static int begin(struct frame *frame, const struct frame_picture *picture, bool is_settled,
		 struct frame_report *report, struct why *why)
{
	const GLuint nothing[4] = { FRAME_NOTHING_SEEN, 0, 0, 0 };
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
	self->has_tied = false;
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
	struct frame_report *report = self->report;
	size_t untested_count = 0;

	for (uint32_t i = 0; i < world->store_count; i++) {
		const struct conservative_tester tester = frame_tester_begin(self, i);
		struct conservative_result *result = &self->results[i];
		int r = conservative_begin(self->stores[i], &world->stores[i].view, NULL, &tester,
					   result);

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
		self->is_out_of_order = self->report->nodes_drawn > 0;
		r = nodes && drawn ? frame_tester_draw_live(self, frame_draw_want, nodes,
							    result->entry_count, drawn)
				   : -ENOMEM;
		free(nodes);
		free(drawn);
		if (r < 0)
			return r;
	}
	return 0;
}

/* Draws the world's list from its beginning, so that ties go where a full picture has them. */
static void draw_again(struct frame_conservative *self)
{
	const struct frame_picture *picture = self->picture;
	const struct world *world = self->frame->world;
	uint32_t view_of = UINT32_MAX;

	self->report->nodes_drawn = 0;
	target_begin(picture->target, picture->style->background);
	frame_begin_drawing(self->frame, picture->style, picture->tile);
	for (size_t i = 0; i < world->want_count; i++)
		(void)frame_draw_want(self->frame, &world->wants[i], &view_of, self->report);
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
	if (r == 0 && frame->conservative->has_tied)
		draw_again(frame->conservative);
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
