/* SPDX-License-Identifier: MIT */
#include "libclient/select/tight_boxes.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/store/payload.h"

struct tight_node {
	uint32_t side; /* columns along each of two sides of the node */
	bool is_wrong; /* they are to be halved */
	uint32_t count;
	struct conservative_box boxes[];
};

struct tight_boxes {
	uint64_t node_count;
	struct tight_node **nodes; /* NULL: not learnt */
	unsigned learnt;           /* in this frame */

	/* Boxes of parts in a test, and which of the whole ones each is of. */
	struct conservative_box *parts;
	size_t *of;
	bool *answers;
	size_t part_room;
	size_t part_count;
};

int tight_boxes_create(uint64_t node_count, struct tight_boxes **ret)
{
	struct tight_boxes *tight = calloc(1, sizeof(*tight));

	if (!tight)
		return -ENOMEM;
	tight->node_count = node_count;
	tight->nodes = calloc(node_count + 1, sizeof(struct tight_node *));
	if (!tight->nodes) {
		tight_boxes_destroy(tight);
		return -ENOMEM;
	}
	*ret = tight;
	return 0;
}

struct tight_boxes *tight_boxes_destroy(struct tight_boxes *tight)
{
	if (!tight)
		return NULL;
	for (uint64_t i = 0; tight->nodes && i < tight->node_count; i++)
		free(tight->nodes[i]);
	free(tight->nodes);
	free(tight->parts);
	free(tight->of);
	free(tight->answers);
	free(tight);
	return NULL;
}

uint32_t tight_boxes_find(const struct tight_boxes *tight, uint32_t node,
			  const struct conservative_box **ret)
{
	const struct tight_node *found = tight->nodes[node];

	if (!found)
		return 0;
	*ret = found->boxes;
	return found->count;
}

/* ---- learning ---- */

struct bounds3 {
	double low[3];
	double high[3];
};

/* The columns of a node: which sides are divided, and what lies in each. */
struct columns {
	uint32_t side;
	int axes[2];
	double first[2]; /* where the first column begins */
	double width[2]; /* of a column */
	struct bounds3 in[TIGHT_BOXES_MAX];
};

/* The two longest sides are divided. */
static void columns_init(struct columns *columns, const struct conservative_box *box, uint32_t side)
{
	int shortest = 0;

	columns->side = side;
	for (int k = 1; k < 3; k++)
		if (box->box_max[k] - box->box_min[k] <
		    box->box_max[shortest] - box->box_min[shortest])
			shortest = k;
	for (int i = 0; i < 2; i++) {
		int axis = (shortest + 1 + i) % 3;

		columns->axes[i] = axis;
		columns->first[i] = box->box_min[axis];
		columns->width[i] = ((double)box->box_max[axis] - box->box_min[axis]) / side;
	}
	for (size_t i = 0; i < (size_t)side * side; i++)
		columns->in[i] = (struct bounds3){ { INFINITY, INFINITY, INFINITY },
						   { -INFINITY, -INFINITY, -INFINITY } };
}

/* Which column a coordinate lies in; what is a little outside belongs to the outermost. */
static uint32_t column_of(const struct columns *columns, int side, double at)
{
	double column = floor((at - columns->first[side]) / columns->width[side]);

	return (uint32_t)fmin(fmax(column, 0.0), columns->side - 1.0);
}

/* Adds the part of a triangle's box that lies in a column. */
static void column_add(struct columns *columns, const uint32_t at[2],
		       const struct bounds3 *triangle)
{
	struct bounds3 *in = &columns->in[at[0] * columns->side + at[1]];
	struct bounds3 part = *triangle;

	for (int side = 0; side < 2; side++) {
		int axis = columns->axes[side];
		double begin = columns->first[side] + at[side] * columns->width[side];

		/* The outermost columns reach as far as what is in them. */
		if (at[side] > 0)
			part.low[axis] = fmax(part.low[axis], begin);
		if (at[side] + 1 < columns->side)
			part.high[axis] = fmin(part.high[axis], begin + columns->width[side]);
	}
	for (int k = 0; k < 3; k++) {
		in->low[k] = fmin(in->low[k], part.low[k]);
		in->high[k] = fmax(in->high[k], part.high[k]);
	}
}

static void columns_add(struct columns *columns, const struct bounds3 *triangle)
{
	uint32_t from[2];
	uint32_t to[2];
	uint32_t at[2];

	for (int side = 0; side < 2; side++) {
		from[side] = column_of(columns, side, triangle->low[columns->axes[side]]);
		to[side] = column_of(columns, side, triangle->high[columns->axes[side]]);
	}
	for (at[0] = from[0]; at[0] <= to[0]; at[0]++)
		for (at[1] = from[1]; at[1] <= to[1]; at[1]++)
			column_add(columns, at, triangle);
}

static struct bounds3 triangle_bounds(const struct payload_view *view, uint32_t triangle)
{
	const struct payload_header *header = view->header;
	struct bounds3 bounds = { { INFINITY, INFINITY, INFINITY },
				  { -INFINITY, -INFINITY, -INFINITY } };

	for (uint32_t corner = 0; corner < 3; corner++) {
		size_t vertex = payload_index(view, triangle, corner);
		const uint16_t *shorts = (const uint16_t *)view->positions + 4 * vertex;
		const float *floats = (const float *)view->positions + 4 * vertex;

		for (int k = 0; k < 3; k++) {
			double q = view->position_format == PAYLOAD_U16X3_RUN ? shorts[k]
									      : (double)floats[k];
			double p = header->origin[k] + header->scale * q;

			bounds.low[k] = fmin(bounds.low[k], p);
			bounds.high[k] = fmax(bounds.high[k], p);
		}
	}
	return bounds;
}

int tight_boxes_learn(struct tight_boxes *tight, const struct conservative_box *box,
		      const void *payload)
{
	const struct tight_node *known = tight->nodes[box->node];
	struct columns columns;
	struct payload_view view;
	struct tight_node *node;
	size_t count = 0;

	CHECK(box->node < tight->node_count && (!known || known->is_wrong));
	payload_view(payload, &view);
	columns_init(&columns, box, known ? 2 * known->side : TIGHT_BOXES_SIDE_MIN);
	for (uint32_t i = 0; i < view.header->triangle_count; i++) {
		struct bounds3 triangle = triangle_bounds(&view, i);

		columns_add(&columns, &triangle);
	}
	for (size_t i = 0; i < (size_t)columns.side * columns.side; i++)
		count += columns.in[i].low[0] <= columns.in[i].high[0];
	node = malloc(sizeof(*node) + count * sizeof(node->boxes[0]));
	if (!node)
		return -ENOMEM;
	*node = (struct tight_node){ .side = columns.side };
	for (size_t i = 0; i < (size_t)columns.side * columns.side; i++) {
		struct conservative_box *tightest = &node->boxes[node->count];

		if (!(columns.in[i].low[0] <= columns.in[i].high[0]))
			continue;
		tightest->node = box->node;
		for (int k = 0; k < 3; k++) {
			tightest->box_min[k] = nextafterf((float)columns.in[i].low[k], -INFINITY);
			tightest->box_max[k] = nextafterf((float)columns.in[i].high[k], INFINITY);
		}
		node->count++;
	}
	free(tight->nodes[box->node]);
	tight->nodes[box->node] = node;
	return 0;
}

void tight_boxes_were_wrong(struct tight_boxes *tight, uint32_t node)
{
	struct tight_node *known = tight->nodes[node];

	if (known && known->side < TIGHT_BOXES_SIDE_MAX)
		known->is_wrong = true;
}

/* ---- testing ---- */

void tight_boxes_begin(struct tight_boxes *tight)
{
	tight->learnt = 0;
}

static int parts_reserve(struct tight_boxes *tight, size_t count)
{
	size_t room = count + count / 2;
	void *grown;

	if (count <= tight->part_room)
		return 0;
	grown = reallocarray(tight->parts, room, sizeof(*tight->parts));
	if (!grown)
		return -ENOMEM;
	tight->parts = grown;
	grown = reallocarray(tight->of, room, sizeof(*tight->of));
	if (!grown)
		return -ENOMEM;
	tight->of = grown;
	grown = reallocarray(tight->answers, room, sizeof(*tight->answers));
	if (!grown)
		return -ENOMEM;
	tight->answers = grown;
	tight->part_room = room;
	return 0;
}

/* Adds the boxes of a node's parts to those that are tested, if they are known or can be learnt. */
static int parts_take(struct tight_boxes *tight, const struct conservative_tester *tester,
		      const struct conservative_box *box, size_t number)
{
	const struct tight_node *known = tight->nodes[box->node];
	const struct conservative_box *parts;
	const void *payload = NULL;
	uint32_t count;
	int r;

	if ((!known || known->is_wrong) && tight->learnt < TIGHT_BOXES_LEARNT_MAX)
		payload = tester->payload(tester->context, box->node);
	if (payload) {
		r = tight_boxes_learn(tight, box, payload);
		if (r < 0)
			return r;
		tight->learnt++;
	}
	count = tight_boxes_find(tight, box->node, &parts);
	r = parts_reserve(tight, tight->part_count + count);
	if (r < 0)
		return r;
	for (uint32_t i = 0; i < count; i++) {
		tight->parts[tight->part_count] = parts[i];
		tight->of[tight->part_count++] = number;
	}
	return 0;
}

int tight_boxes_test(struct tight_boxes *tight, const struct conservative_tester *tester,
		     const struct conservative_box *boxes, size_t box_count, bool *shows,
		     size_t *ret_count)
{
	int r = 0;

	tight->part_count = 0;
	for (size_t i = 0; i < box_count && r == 0 && tester->payload; i++)
		if (shows[i])
			r = parts_take(tight, tester, &boxes[i], i);
	if (r == 0 && tight->part_count > 0)
		r = tester->test(tester->context, tight->parts, tight->part_count, tight->answers);
	if (r < 0)
		return r;
	for (size_t i = 0; i < tight->part_count; i++)
		shows[tight->of[i]] = false;
	for (size_t i = 0; i < tight->part_count; i++)
		shows[tight->of[i]] = shows[tight->of[i]] || tight->answers[i];
	*ret_count = tight->part_count;
	return 0;
}
