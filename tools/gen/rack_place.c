/* SPDX-License-Identifier: MIT */
#include "tools/gen/rack_place.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>

#include "formats/base/check.h"

/* Classes above are as good as infinite: the largest model is 2^60 times the median. */
#define CLASS_MAX 60

struct rack_scale rack_scale(double unit, unsigned class)
{
	double large = ldexp(unit, (int)class);
	/* People do not grow with what they store: ways do by the root. */
	double way = unit * sqrt(ldexp(1, (int)class));
	double height = sqrt(large * way);
	struct rack_scale scale = {
		.row_count = class < 2 ? RACK_ROWS_MAX : 1,
		.row_bays = class < 2 ? RACK_ROW_BAYS_MAX >> class : 1,
		.bay_width = 6 * large,
		.bay_depth = 2.4 * large,
		.height = 12 * height,
		.board = 0.12 * way,
		.gap = 0.12 * way,
		.aisle = 6 * way,
		.wall = 0.6 * way,
		.room_height = 14 * height,
		.corridor = 4.5 * way,
	};

	scale.room_width = 2 * scale.wall + scale.row_count * (2 * scale.bay_depth + scale.board) +
			   (scale.row_count + 1) * scale.aisle;
	scale.room_depth = 2 * scale.wall + 2 * scale.aisle +
			   scale.row_bays * (scale.bay_width + scale.board) + scale.board;
	return scale;
}

struct rack_bay_corner rack_bay_corner(const struct rack_scale *scale, unsigned bay)
{
	unsigned along = bay % scale->row_bays;
	unsigned side = bay / scale->row_bays % 2;
	unsigned row = bay / scale->row_bays / 2;
	double row_x = scale->wall + scale->aisle +
		       row * (2 * scale->bay_depth + scale->board + scale->aisle);

	return (struct rack_bay_corner){
		.x = row_x + (side ? 2 * scale->bay_depth + scale->board : 0),
		.y = scale->wall + scale->aisle + scale->board +
		     along * (scale->bay_width + scale->board),
		.inward = side ? -1 : 1,
	};
}

/* ---- order ---- */

struct order {
	const struct rack_item *items;
	size_t index;
	unsigned class;
};

static int order_by_width(const void *a, const void *b)
{
	double x = *(const double *)a;
	double y = *(const double *)b;

	return (x > y) - (x < y);
}

/* The median of the larger sides; models of no extent are no measure. */
static int find_unit(const struct rack_item *items, size_t item_count, double *ret)
{
	double *sides = malloc(item_count * sizeof(*sides));
	size_t count = 0;

	if (!sides)
		return -ENOMEM;
	for (size_t i = 0; i < item_count; i++) {
		double side = fmax(items[i].size.x, items[i].size.y);

		if (side > 0)
			sides[count++] = side;
	}
	qsort(sides, count, sizeof(*sides), order_by_width);
	*ret = count > 0 ? sides[count / 2] : 1;
	free(sides);
	return 0;
}

/* An item's depth is its x, its width its y: bays open along x. */
static unsigned item_class(const struct rack_item *item, double unit)
{
	unsigned class = 0;

	for (; class < CLASS_MAX; class ++) {
		const struct rack_scale scale = rack_scale(unit, class);

		if (item->size.y <= scale.bay_width - 2 * scale.gap &&
		    item->size.x <= scale.bay_depth - 2 * scale.gap &&
		    item->size.z <= 0.6 * scale.height)
			break;
	}
	return class;
}

static int order_compare(const void *a, const void *b)
{
	const struct order *x = a;
	const struct order *y = b;
	double height_x = x->items[x->index].size.z;
	double height_y = y->items[y->index].size.z;

	if (x->class != y->class)
		return x->class < y->class ? -1 : 1;
	if (height_x != height_y)
		return height_x > height_y ? -1 : 1;
	return x->index < y->index ? -1 : 1;
}

/* ---- filling ---- */

/* Where the next item goes: lines from front to back on a board, boards up a bay, bays of a room. */
struct cursor {
	struct rack_layout *layout;
	size_t room_capacity;
	double unit;
	unsigned class;
	bool in_room; /* else the next item opens one */
	struct rack_scale scale;
	unsigned bay;
	double depth;       /* where the line begins */
	double line_depth;  /* of the deepest item in it */
	double width;       /* where the next item of the line begins */
	double board_above; /* the least height of the next board */
};

static struct rack_room *last_room(const struct cursor *cursor)
{
	return &cursor->layout->rooms[cursor->layout->room_count - 1];
}

static int add_room(struct cursor *cursor)
{
	struct rack_layout *layout = cursor->layout;

	if (layout->room_count == cursor->room_capacity) {
		size_t capacity = 2 * cursor->room_capacity + 8;
		struct rack_room *rooms =
			reallocarray(layout->rooms, capacity, sizeof(*layout->rooms));

		if (!rooms)
			return -ENOMEM;
		layout->rooms = rooms;
		cursor->room_capacity = capacity;
	}
	cursor->scale = rack_scale(cursor->unit, cursor->class);
	layout->rooms[layout->room_count++] = (struct rack_room){ .scale = cursor->scale };
	return 0;
}

/* Rooms stand in pairs: where a class has an odd number, the last one of it is empty. */
static int end_class(struct cursor *cursor)
{
	cursor->in_room = false;
	return cursor->layout->room_count % 2 == 1 ? add_room(cursor) : 0;
}

static void open_bay(struct cursor *cursor, unsigned bay)
{
	cursor->bay = bay;
	cursor->board_above = 0.04 * cursor->scale.height;
}

static int next_bay(struct cursor *cursor)
{
	int r = 0;

	if (cursor->in_room &&
	    cursor->bay + 1 < 2 * cursor->scale.row_count * cursor->scale.row_bays) {
		open_bay(cursor, cursor->bay + 1);
	} else {
		r = add_room(cursor);
		cursor->in_room = true;
		open_bay(cursor, 0);
	}
	return r;
}

/* Opens a board for an item that is at least as high as all that follow on it. */
static int next_board(struct cursor *cursor, double item_height)
{
	struct rack_bay *bay = &last_room(cursor)->bays[cursor->bay];
	double top = cursor->board_above + cursor->scale.board + item_height;
	int r;

	if (top > cursor->scale.height || bay->board_count == RACK_BOARDS_MAX) {
		r = next_bay(cursor);
		if (r < 0)
			return r;
		bay = &last_room(cursor)->bays[cursor->bay];
		top = cursor->board_above + cursor->scale.board + item_height;
	}
	bay->boards[bay->board_count++] = cursor->board_above + cursor->scale.board;
	/* A hand fits between a thing and the board above it. */
	cursor->board_above = top + fmax(4 * cursor->scale.gap, 0.25 * item_height);
	cursor->depth = cursor->scale.gap;
	cursor->line_depth = 0;
	cursor->width = cursor->scale.gap;
	return 0;
}

static int place_item(struct cursor *cursor, struct rack_item *item)
{
	const struct rack_scale *scale = &cursor->scale;
	const struct rack_bay *bay;
	struct rack_bay_corner corner;
	int r;

	if (cursor->width + item->size.y + scale->gap > scale->bay_width) {
		cursor->depth += cursor->line_depth + scale->gap;
		cursor->line_depth = 0;
		cursor->width = scale->gap;
	}
	if (cursor->depth + item->size.x + scale->gap > scale->bay_depth) {
		r = next_board(cursor, item->size.z);
		if (r < 0)
			return r;
	}
	bay = &last_room(cursor)->bays[cursor->bay];
	corner = rack_bay_corner(scale, cursor->bay);
	/* In the room for now; the gap keeps undersides out of the board's plane. */
	item->place = (struct vec3){
		corner.x + corner.inward * (cursor->depth + item->size.x / 2),
		corner.y + cursor->width + item->size.y / 2,
		bay->boards[bay->board_count - 1] + 0.1 * scale->gap,
	};
	cursor->width += item->size.y + scale->gap;
	cursor->line_depth = fmax(cursor->line_depth, item->size.x);
	return 0;
}

/* Puts the rooms side by side: even ones north of the corridor, odd ones south, turned around. */
static void arrange_rooms(struct rack_layout *layout)
{
	double x = 0;

	for (size_t i = 0; i < layout->room_count; i++) {
		struct rack_room *room = &layout->rooms[i];
		double width = room->scale.room_width;
		bool south = i % 2 == 1;
		bool first = i < 2;
		bool last = i + 2 >= layout->room_count;
		bool like_before = !first && layout->rooms[i - 2].scale.room_width == width;
		bool like_after = !last && layout->rooms[i + 2].scale.room_width == width;

		room->frame = FRAME_WORLD;
		room->frame.origin =
			(struct vec3){ south ? x + width : x,
				       south ? -room->scale.corridor : room->scale.corridor, 0 };
		if (south) {
			room->frame.x.x = -1;
			room->frame.y.y = -1;
		}
		room->passage_low_x = south ? like_after : like_before;
		room->passage_high_x = south ? like_before : like_after;
		room->corridor_ends_low_x = south ? last : first;
		room->corridor_ends_high_x = south ? first : last;
		if (south)
			x += width + room->scale.gap;
	}
}

static int place_all(struct cursor *cursor, const struct order *orders, struct rack_item *items,
		     size_t *room_of, size_t item_count)
{
	int r;

	for (size_t i = 0; i < item_count; i++) {
		size_t index = orders[i].index;

		if (cursor->in_room && orders[i].class != cursor->class) {
			r = end_class(cursor);
			if (r < 0)
				return r;
		}
		cursor->class = orders[i].class;
		if (!cursor->in_room) {
			r = next_bay(cursor);
			if (r == 0)
				r = next_board(cursor, items[index].size.z);
			if (r < 0)
				return r;
		}
		r = place_item(cursor, &items[index]);
		if (r < 0)
			return r;
		room_of[index] = cursor->layout->room_count - 1;
	}
	return end_class(cursor);
}

int rack_place(struct rack_item *items, size_t item_count, struct rack_layout *ret)
{
	struct rack_layout layout = { 0 };
	struct cursor cursor = { .layout = &layout };
	struct order *orders = malloc(item_count * sizeof(*orders));
	size_t *room_of = malloc(item_count * sizeof(*room_of));
	int r = -ENOMEM;

	CHECK(item_count > 0);
	if (orders && room_of)
		r = find_unit(items, item_count, &cursor.unit);
	if (r == 0) {
		for (size_t i = 0; i < item_count; i++)
			orders[i] = (struct order){ items, i, item_class(&items[i], cursor.unit) };
		qsort(orders, item_count, sizeof(*orders), order_compare);
		r = place_all(&cursor, orders, items, room_of, item_count);
	}
	if (r == 0) {
		arrange_rooms(&layout);
		for (size_t i = 0; i < item_count; i++)
			items[i].place =
				frame_point(&layout.rooms[room_of[i]].frame, items[i].place);
		*ret = layout;
	} else {
		rack_layout_done(&layout);
	}
	free(orders);
	free(room_of);
	return r;
}

void rack_layout_done(struct rack_layout *layout)
{
	free(layout->rooms);
	*layout = (struct rack_layout){ 0 };
}
