/* SPDX-License-Identifier: MIT */
#include "libclient/select/conservative.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/types.h>

#include "formats/base/check.h"
#include "libclient/select/selector.h"
#include "libclient/select/tight_boxes.h"

/** Boxes of the first round: little is drawn yet, so most of them show. */
#define ROUND_FIRST 16u
/** Testing pays if it saves at least one triangle in as many. */
#define PAYS_ONE_IN 8u
/** Frames without a test, when it did not pay: twice as many each time, up to this. */
#define UNTESTED_FRAMES_MAX 32u

struct candidate {
	uint32_t node;
	uint8_t state; /* enum conservative_state */
	bool is_decided;
};

struct conservative {
	struct selector *selector;
	uint32_t frame;
	uint32_t *shown; /* a node: the frame in which it showed last */
	struct tight_boxes *tight;

	/* Of the frame in hand. */
	struct candidate *candidates; /* nearest first */
	size_t candidate_count;
	struct conservative_result result;

	/* Whether testing pays. */
	unsigned untested_frames; /* to go */
	unsigned untested_length; /* how many it were the last time */

	/* Scratch of a round; as many as there are nodes. */
	uint32_t *round; /* candidates */
	uint32_t *nodes;
	struct conservative_box *boxes;
	bool *answers;
	struct conservative_entry *entries;
};

int conservative_create(struct selector *selector, struct conservative **ret)
{
	struct conservative *conservative = calloc(1, sizeof(*conservative));
	/* At least one, so that an empty store has arrays too. */
	size_t room = (size_t)selector->node_count + 1;

	if (!conservative)
		return -ENOMEM;
	conservative->selector = selector;
	if (tight_boxes_create(selector->node_count, &conservative->tight) < 0) {
		free(conservative);
		return -ENOMEM;
	}
	conservative->shown = calloc(room, sizeof(*conservative->shown));
	conservative->candidates = calloc(room, sizeof(*conservative->candidates));
	conservative->round = calloc(room, sizeof(*conservative->round));
	conservative->nodes = calloc(room, sizeof(*conservative->nodes));
	conservative->boxes = calloc(room, sizeof(*conservative->boxes));
	conservative->answers = calloc(room, sizeof(*conservative->answers));
	conservative->entries = calloc(room, sizeof(*conservative->entries));
	if (!conservative->shown || !conservative->candidates || !conservative->round ||
	    !conservative->nodes || !conservative->boxes || !conservative->answers ||
	    !conservative->entries) {
		conservative_destroy(conservative);
		return -ENOMEM;
	}
	conservative_forget(conservative);
	*ret = conservative;
	return 0;
}

struct conservative *conservative_destroy(struct conservative *conservative)
{
	if (!conservative)
		return NULL;
	tight_boxes_destroy(conservative->tight);
	free(conservative->shown);
	free(conservative->candidates);
	free(conservative->round);
	free(conservative->nodes);
	free(conservative->boxes);
	free(conservative->answers);
	free(conservative->entries);
	free(conservative);
	return NULL;
}

void conservative_forget(struct conservative *conservative)
{
	memset(conservative->shown, 0,
	       conservative->selector->node_count * sizeof(*conservative->shown));
	/* No node showed in the frame before. */
	conservative->frame = 1;
	conservative->untested_frames = 0;
	conservative->untested_length = 0;
}

/* ---- boxes ---- */

/*
 * In a store that repeats triangles, what is seen of one inside a cell is in that cell's node, so
 * the rest of the tight box need not be tested.
 */
static struct conservative_box box_of(const struct selector *selector, uint32_t node)
{
	const struct bounds *bounds = &selector->bounds[node];
	const struct cube *cube = &selector->places.cubes[node];
	bool is_in_cell = selector->places.superblock->layout == STORE_LAYOUT_REPLICATE;
	struct conservative_box box = { .node = node };

	for (int k = 0; k < 3; k++) {
		/* The bounds are rounded outwards by more than a float's last bit. */
		box.box_min[k] = nextafterf(bounds->centre[k] - bounds->half[k], -INFINITY);
		box.box_max[k] = nextafterf(bounds->centre[k] + bounds->half[k], INFINITY);
		if (!is_in_cell)
			continue;
		box.box_min[k] = fmaxf(box.box_min[k], cube->centre[k] - cube->half);
		box.box_max[k] = fminf(box.box_max[k], cube->centre[k] + cube->half);
	}
	return box;
}

/* ---- rounds ---- */

/* Draws the candidates in round[0 .. count - 1]. */
static int round_draw(struct conservative *conservative, const struct conservative_tester *tester,
		      size_t count)
{
	struct conservative_result *result = &conservative->result;
	int r;

	if (count == 0)
		return 0;
	for (size_t i = 0; i < count; i++)
		conservative->nodes[i] = conservative->candidates[conservative->round[i]].node;
	r = tester->draw(tester->context, conservative->nodes, count, conservative->answers);
	if (r < 0)
		return r;
	for (size_t i = 0; i < count; i++) {
		struct candidate *candidate = &conservative->candidates[conservative->round[i]];
		const struct store_node *node = &conservative->selector->nodes[candidate->node];

		candidate->is_decided = conservative->answers[i];
		candidate->state =
			conservative->answers[i] ? CONSERVATIVE_SHOWS : CONSERVATIVE_MISSING;
		if (!conservative->answers[i])
			continue;
		result->nodes_drawn++;
		result->triangles_drawn += node->triangle_count;
	}
	return 0;
}

/* Tests the candidates in round[0 .. count - 1].  Returns: how many show and now stand there. */
static ssize_t round_test(struct conservative *conservative,
			  const struct conservative_tester *tester, size_t count)
{
	size_t shown_count = 0;
	size_t fine_count = 0;
	int r;

	if (count == 0)
		return 0;
	for (size_t i = 0; i < count; i++)
		conservative->boxes[i] =
			box_of(conservative->selector,
			       conservative->candidates[conservative->round[i]].node);
	r = tester->test(tester->context, conservative->boxes, count, conservative->answers);
	if (r == 0)
		r = tight_boxes_test(conservative->tight, tester, conservative->boxes, count,
				     conservative->answers, &fine_count);
	if (r < 0)
		return r;
	for (size_t i = 0; i < count; i++) {
		uint32_t index = conservative->round[i];

		if (conservative->answers[i]) {
			conservative->round[shown_count++] = index;
			continue;
		}
		conservative->candidates[index].state = CONSERVATIVE_HIDDEN;
		conservative->candidates[index].is_decided = true;
	}
	conservative->result.rounds++;
	conservative->result.boxes_tested += count + fine_count;
	return (ssize_t)shown_count;
}

/* Goes through what is not decided, from near to far. */
static int rounds_run(struct conservative *conservative, const struct conservative_tester *tester)
{
	size_t round_size = tester->round_max < ROUND_FIRST ? tester->round_max : ROUND_FIRST;
	size_t next = 0;

	CHECK(tester->round_max > 0);
	while (next < conservative->candidate_count) {
		size_t count = 0;
		ssize_t shown_count;
		int r;

		for (; next < conservative->candidate_count && count < round_size; next++)
			if (!conservative->candidates[next].is_decided)
				conservative->round[count++] = (uint32_t)next;
		shown_count = round_test(conservative, tester, count);
		if (shown_count < 0)
			return (int)shown_count;
		r = round_draw(conservative, tester, (size_t)shown_count);
		if (r < 0)
			return r;
		round_size =
			2 * round_size < tester->round_max ? 2 * round_size : tester->round_max;
	}
	return 0;
}

/* ---- a frame ---- */

static void candidates_take(struct conservative *conservative, const struct selection *selection)
{
	for (size_t i = 0; i < selection->entry_count; i++)
		conservative->candidates[i] =
			(struct candidate){ .node = selection->entries[i].node };
	conservative->candidate_count = selection->entry_count;
	conservative->result = (struct conservative_result){
		.candidate_count = selection->entry_count,
		.candidate_triangles = selection->triangle_count,
	};
}

/* Draws what showed in the frame before; what it hides is then known before anything is tested. */
static int start_draw(struct conservative *conservative, const struct conservative_tester *tester)
{
	size_t count = 0;

	for (size_t i = 0; i < conservative->candidate_count; i++)
		if (conservative->shown[conservative->candidates[i].node] ==
		    conservative->frame - 1)
			conservative->round[count++] = (uint32_t)i;
	return round_draw(conservative, tester, count);
}

/* Without a frame before, an approximate set counts as what it showed. */
static void start_guess(struct conservative *conservative, const struct camera_view *view,
			const struct select_options *start)
{
	struct selection selection;

	select_approximate(conservative->selector, view, start, &selection);
	for (size_t i = 0; i < selection.entry_count; i++)
		conservative->shown[selection.entries[i].node] = conservative->frame - 1;
}

/* Whether what was drawn is still in front.  Nodes that are found covered do not start a frame. */
static int remain_ask(struct conservative *conservative, const struct conservative_tester *tester)
{
	size_t count = 0;
	int r;

	if (!tester->remain)
		return 0;
	for (size_t i = 0; i < conservative->candidate_count; i++) {
		if (conservative->candidates[i].state != CONSERVATIVE_SHOWS)
			continue;
		conservative->round[count] = (uint32_t)i;
		conservative->nodes[count++] = conservative->candidates[i].node;
	}
	r = tester->remain(tester->context, conservative->nodes, count, conservative->answers);
	for (size_t i = 0; r == 0 && i < count; i++) {
		uint32_t node = conservative->nodes[i];

		if (conservative->answers[i])
			continue;
		conservative->candidates[conservative->round[i]].state = CONSERVATIVE_COVERED;
		/* What was drawn because it had shown before says nothing about its boxes. */
		if (conservative->shown[node] != conservative->frame - 1)
			tight_boxes_were_wrong(conservative->tight, node);
	}
	return r;
}

static void result_make(struct conservative *conservative, struct conservative_result *ret)
{
	struct conservative_result *result = &conservative->result;

	result->entries = conservative->entries;
	result->entry_count = 0;
	result->shown_count = 0;
	result->missing_count = 0;
	result->shown_triangles = 0;
	for (size_t i = 0; i < conservative->candidate_count; i++) {
		const struct candidate *candidate = &conservative->candidates[i];
		struct conservative_entry *entry = &conservative->entries[result->entry_count];

		if (candidate->state == CONSERVATIVE_HIDDEN)
			continue;
		result->entry_count++;
		entry->node = candidate->node;
		entry->importance = 1.0f / (float)(i + 1);
		entry->state = (enum conservative_state)candidate->state;
		if (candidate->state == CONSERVATIVE_MISSING)
			result->missing_count++;
		if (candidate->state != CONSERVATIVE_SHOWS)
			continue;
		result->shown_count++;
		result->shown_triangles +=
			conservative->selector->nodes[candidate->node].triangle_count;
		conservative->shown[candidate->node] = conservative->frame;
	}
	result->is_complete = result->missing_count == 0;
	*ret = *result;
}

/* Is this frame to be tested? */
static bool testing_pays(struct conservative *conservative,
			 const struct conservative_tester *tester)
{
	if (conservative->result.candidate_triangles < tester->overhead_triangles)
		return false;
	if (conservative->untested_frames == 0)
		return true;
	conservative->untested_frames--;
	return false;
}

/* A view in which little is saved is likely followed by others. */
static void judge_testing(struct conservative *conservative,
			  const struct conservative_tester *tester)
{
	const struct conservative_result *result = &conservative->result;
	uint64_t worth = result->candidate_triangles - result->candidate_triangles / PAYS_ONE_IN;
	uint64_t spent = result->triangles_drawn + result->boxes_tested * tester->box_triangles;
	unsigned length = 2 * conservative->untested_length;

	if (tester->draws_twice)
		spent += result->shown_triangles;
	if (!result->is_complete || spent <= worth) {
		conservative->untested_length = 0;
		return;
	}
	length = length > UNTESTED_FRAMES_MAX ? UNTESTED_FRAMES_MAX : length;
	conservative->untested_length = length > 0 ? length : 1;
	conservative->untested_frames = conservative->untested_length;
}

int conservative_begin(struct conservative *conservative, const struct camera_view *view,
		       const struct select_options *start, const struct conservative_tester *tester,
		       struct conservative_result *ret)
{
	struct selection selection;
	int r;

	tight_boxes_begin(conservative->tight);
	if (++conservative->frame == 2 && start)
		start_guess(conservative, view, start);
	select_frustum(conservative->selector, view, &selection);
	candidates_take(conservative, &selection);
	if (!testing_pays(conservative, tester)) {
		conservative->result.is_untested = true;
		for (size_t i = 0; i < conservative->candidate_count; i++)
			conservative->candidates[i].is_decided = true;
		result_make(conservative, ret);
		return 0;
	}
	r = start_draw(conservative, tester);
	if (r == 0)
		r = rounds_run(conservative, tester);
	if (r == 0)
		r = remain_ask(conservative, tester);
	if (r < 0)
		return r;
	result_make(conservative, ret);
	judge_testing(conservative, tester);
	return 0;
}

int conservative_resume(struct conservative *conservative, const struct conservative_tester *tester,
			struct conservative_result *ret)
{
	int r = rounds_run(conservative, tester);

	if (r == 0)
		r = remain_ask(conservative, tester);
	if (r < 0)
		return r;
	result_make(conservative, ret);
	return 0;
}
