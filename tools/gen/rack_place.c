/* SPDX-License-Identifier: MIT */
#include "tools/gen/rack_place.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>

#include "formats/base/check.h"

/* The largest model, in units: a room is wider than this. */
#define LARGEST_UNITS 5.0
/* Free height above a thing, as a share of its own: between these, as the rooms have room. */
#define CLEARANCE_MIN 0.3
#define CLEARANCE_MAX 1.5
/* Height of the lowest boards, in units: nobody is to step onto a shelf. */
#define LOWEST_UNITS 0.2
#define DECK_UNITS   0.07
#define SEARCH_STEPS 24

static struct rack_sizes sizes_of(double unit, double deck_depth)
{
	struct rack_sizes sizes = {
		.unit = unit,
		.height = 2.2 * unit,
		.board = 0.02 * unit,
		.gap = 0.015 * unit,
		.aisle = 0.85 * unit,
		.wall = 0.08 * unit,
		.room_height = 2.6 * unit,
		.corridor = 0.5 * unit,
	};
	double row_width = RACK_ROW_BAYS * (2 * unit + sizes.board) + sizes.board;

	sizes.room_width = 2 * sizes.wall + 2 * sizes.aisle + row_width;
	sizes.widths[RACK_DEEP] = 2 * unit;
	sizes.widths[RACK_SHALLOW] = 2 * unit;
	sizes.widths[RACK_DECK] = sizes.room_width - 2 * sizes.wall - 2 * sizes.gap;
	/* A hair more than needed, for rounding. */
	sizes.depths[RACK_DEEP] = 1.001 * unit + 2 * sizes.gap;
	sizes.depths[RACK_SHALLOW] = 0.55 * unit;
	sizes.depths[RACK_DECK] = deck_depth > 0 ? 1.001 * deck_depth + 2 * sizes.gap : 0;
	sizes.row_depth = sizes.depths[RACK_DEEP] + sizes.board + sizes.depths[RACK_SHALLOW];
	sizes.room_depth = 2 * sizes.wall + sizes.aisle +
			   RACK_ROWS * (sizes.row_depth + sizes.aisle) + sizes.depths[RACK_DECK];
	return sizes;
}

struct rack_bay_corner rack_bay_corner(const struct rack_sizes *sizes, unsigned bay)
{
	unsigned row = bay / (2 * RACK_ROW_BAYS);
	bool deck = row == RACK_ROWS;
	bool behind = !deck && bay / RACK_ROW_BAYS % 2 == 1;
	double row_y = sizes->wall + sizes->aisle + row * (sizes->row_depth + sizes->aisle);

	return (struct rack_bay_corner){
		.kind = deck     ? RACK_DECK
			: behind ? RACK_SHALLOW
				 : RACK_DEEP,
		.x = deck ? sizes->wall + sizes->gap
			  : sizes->wall + sizes->aisle + sizes->board +
				     bay % RACK_ROW_BAYS * (2 * sizes->unit + sizes->board),
		.y = behind ? row_y + sizes->row_depth : row_y,
		.inward = behind ? -1 : 1,
	};
}

/* ---- order ---- */

struct order {
	size_t index;
	bool is_large; /* no shelf takes it */
	double key;
};

struct plan {
	struct rack_item *items;
	size_t item_count;
	struct order *orders;
	size_t large_count;
	struct rack_sizes sizes;
	double shallow_side; /* up to this a thing lies on a shallow shelf */
	struct rack_layout layout;
};

static double larger_side(const struct rack_item *item)
{
	return fmax(item->size.x, item->size.y);
}

static int compare_numbers(const void *a, const void *b)
{
	double x = *(const double *)a;
	double y = *(const double *)b;

	return (x > y) - (x < y);
}

/* The 98th of 100 edges, so that the deck takes few; models of no extent are no measure. */
static int find_unit(const struct plan *plan, double *ret)
{
	double *edges = malloc(plan->item_count * sizeof(*edges));
	size_t count = 0;

	if (!edges)
		return -ENOMEM;
	for (size_t i = 0; i < plan->item_count; i++) {
		double edge = fmax(larger_side(&plan->items[i]), plan->items[i].size.z);

		if (edge > 0)
			edges[count++] = edge;
	}
	qsort(edges, count, sizeof(*edges), compare_numbers);
	*ret = count > 0 ? fmax(edges[count - 1 - count / 50], edges[count - 1] / LARGEST_UNITS)
			 : 1;
	free(edges);
	return 0;
}

/* Large ones first, the deepest of them first; then the highest. */
static int compare_orders(const void *a, const void *b)
{
	const struct order *x = a;
	const struct order *y = b;

	if (x->is_large != y->is_large)
		return x->is_large ? -1 : 1;
	if (x->key != y->key)
		return x->key > y->key ? -1 : 1;
	return x->index < y->index ? -1 : 1;
}

static int make_order(struct plan *plan)
{
	double deck_depth = 0;
	double unit;
	int r = find_unit(plan, &unit);

	if (r < 0)
		return r;
	for (size_t i = 0; i < plan->item_count; i++) {
		const struct rack_item *item = &plan->items[i];
		bool is_large = fmax(larger_side(item), item->size.z) > unit;

		plan->orders[i] =
			(struct order){ i, is_large, is_large ? item->size.y : item->size.z };
		plan->large_count += is_large;
		if (is_large)
			deck_depth = fmax(deck_depth, item->size.y);
	}
	qsort(plan->orders, plan->item_count, sizeof(*plan->orders), compare_orders);
	plan->sizes = sizes_of(unit, deck_depth);
	return 0;
}

/* ---- filling ---- */

/* Where the next item goes: lines from front to back on a board, boards up a bay, bay after bay. */
struct filling {
	struct plan *plan;
	enum rack_kind kind;
	double clearance;
	size_t bay_items_max;
	bool is_trial; /* bays are only counted */

	size_t bay_count; /* so far */
	size_t bay_items; /* of the last bay, as all that follows */
	unsigned board_count;
	double board;      /* height of its upper side */
	double next_board; /* the least height of the next one */
	double depth;      /* where the line begins */
	double line_depth; /* of the deepest item in it */
	double width;      /* where the next item of the line begins */
};

static enum rack_kind item_kind(const struct plan *plan, const struct order *order)
{
	if (order->is_large)
		return RACK_DECK;
	return larger_side(&plan->items[order->index]) <= plan->shallow_side ? RACK_SHALLOW
									     : RACK_DEEP;
}

/* Bays are dealt to the rooms in turn, and in each room to the next place, so that rooms differ. */
static struct rack_bay *dealt_bay(const struct filling *filling, struct rack_room **ret_room,
				  unsigned *ret_bay)
{
	struct rack_layout *layout = &filling->plan->layout;
	size_t dealt = filling->bay_count - 1;
	size_t room = dealt % layout->room_count;
	unsigned place = (unsigned)((dealt / layout->room_count + room) % RACK_SIDE_BAYS);

	*ret_room = &layout->rooms[room];
	*ret_bay = filling->kind == RACK_DECK
			   ? RACK_ROOM_BAYS - 1
			   : (2 * (place / RACK_ROW_BAYS) + filling->kind) * RACK_ROW_BAYS +
				     place % RACK_ROW_BAYS;
	return &(*ret_room)->bays[*ret_bay];
}

/* Opens a board for an item that is at least as high as all that follow on it. */
static void open_board(struct filling *filling, double item_height)
{
	const struct rack_sizes *sizes = &filling->plan->sizes;
	unsigned board_max = filling->kind == RACK_DECK ? 1 : RACK_BOARDS_MAX;

	if (filling->bay_count == 0 || filling->bay_items == filling->bay_items_max ||
	    filling->board_count == board_max ||
	    filling->next_board + item_height > sizes->height) {
		filling->bay_count++;
		filling->bay_items = 0;
		filling->board_count = 0;
		filling->next_board = filling->kind == RACK_DECK ? DECK_UNITS * sizes->unit
								 : LOWEST_UNITS * sizes->unit;
	}
	filling->board = filling->next_board;
	filling->next_board +=
		fmax(sizes->height / RACK_BOARDS_MAX,
		     item_height * (1 + filling->clearance) + 2 * sizes->gap + sizes->board);
	filling->board_count++;
	filling->depth = sizes->gap;
	filling->line_depth = 0;
	filling->width = sizes->gap;
}

static void put_item(const struct filling *filling, struct rack_item *item)
{
	const struct rack_sizes *sizes = &filling->plan->sizes;
	struct rack_room *room;
	unsigned index;
	struct rack_bay *bay = dealt_bay(filling, &room, &index);
	struct rack_bay_corner corner = rack_bay_corner(sizes, index);

	bay->board_count = filling->board_count;
	bay->boards[filling->board_count - 1] = filling->board;
	/* The gap keeps undersides out of the board's plane. */
	item->place = frame_point(
		&room->frame,
		(struct vec3){ corner.x + filling->width + item->size.x / 2,
			       corner.y + corner.inward * (filling->depth + item->size.y / 2),
			       filling->board + 0.1 * sizes->gap });
}

static void add_item(struct filling *filling, struct rack_item *item)
{
	const struct rack_sizes *sizes = &filling->plan->sizes;

	if (filling->width + item->size.x + sizes->gap > sizes->widths[filling->kind]) {
		filling->depth += filling->line_depth + sizes->gap;
		filling->line_depth = 0;
		filling->width = sizes->gap;
	}
	if (filling->bay_count == 0 || filling->bay_items == filling->bay_items_max ||
	    filling->depth + item->size.y + sizes->gap > sizes->depths[filling->kind])
		open_board(filling, item->size.z);
	if (!filling->is_trial)
		put_item(filling, item);
	filling->bay_items++;
	filling->width += item->size.x + sizes->gap;
	filling->line_depth = fmax(filling->line_depth, item->size.y);
}

/* Returns: how many bays of the kind are filled. */
static size_t fill(struct plan *plan, enum rack_kind kind, double clearance, size_t bay_items_max,
		   bool is_trial)
{
	struct filling filling = { .plan = plan,
				   .kind = kind,
				   .clearance = clearance,
				   .bay_items_max = bay_items_max,
				   .is_trial = is_trial };

	for (size_t i = 0; i < plan->item_count; i++) {
		if (item_kind(plan, &plan->orders[i]) == kind)
			add_item(&filling, &plan->items[plan->orders[i].index]);
	}
	return filling.bay_count;
}

/* ---- rooms ---- */

/* Chooses what is small, so that both sides of the rows fill equally.  Returns: bays of a side. */
static size_t balance_sides(struct plan *plan)
{
	double low = 0;
	double high = plan->sizes.depths[RACK_SHALLOW] - 2.1 * plan->sizes.gap;
	size_t shallow;
	size_t deep;

	for (int step = 0; step < SEARCH_STEPS; step++) {
		/* The upper end itself comes first: there may be few large things. */
		plan->shallow_side = step == 0 ? high : (low + high) / 2;
		shallow = fill(plan, RACK_SHALLOW, CLEARANCE_MIN, SIZE_MAX, true);
		deep = fill(plan, RACK_DEEP, CLEARANCE_MIN, SIZE_MAX, true);
		if (shallow <= deep)
			low = plan->shallow_side;
		else
			high = plan->shallow_side;
	}
	plan->shallow_side = low;
	shallow = fill(plan, RACK_SHALLOW, CLEARANCE_MIN, SIZE_MAX, true);
	deep = fill(plan, RACK_DEEP, CLEARANCE_MIN, SIZE_MAX, true);
	return shallow > deep ? shallow : deep;
}

/* Even rooms stand north of the corridor, odd ones south, turned around. */
static int make_rooms(struct plan *plan, size_t room_count)
{
	const struct rack_sizes *sizes = &plan->sizes;
	struct rack_room *rooms = calloc(room_count, sizeof(*rooms));

	if (!rooms)
		return -ENOMEM;
	for (size_t i = 0; i < room_count; i++) {
		bool south = i % 2 == 1;
		bool first = i < 2;
		bool last = i + 2 >= room_count;

		rooms[i] = (struct rack_room){ .sizes = *sizes,
					       .number = i,
					       .frame = FRAME_WORLD,
					       .neighbour_low_x = south ? !last : !first,
					       .neighbour_high_x = south ? !first : !last };
		/* Walls stand a hair apart, so that no two faces lie in one plane. */
		rooms[i].frame.origin.x = (double)(i / 2) * 1.001 * sizes->room_width;
		rooms[i].frame.origin.y = sizes->corridor;
		if (south) {
			rooms[i].frame.origin.x += sizes->room_width;
			rooms[i].frame.origin.y *= -1;
			rooms[i].frame.x.x = -1;
			rooms[i].frame.y.y = -1;
		}
	}
	plan->layout = (struct rack_layout){ rooms, room_count };
	return 0;
}

/* The most air above things with which they still fit in the rooms. */
static void fill_sides(struct plan *plan, enum rack_kind kind)
{
	double low = CLEARANCE_MIN;
	double high = CLEARANCE_MAX;

	for (int step = 0; step < SEARCH_STEPS; step++) {
		double middle = (low + high) / 2;

		if (fill(plan, kind, middle, SIZE_MAX, true) <=
		    RACK_SIDE_BAYS * plan->layout.room_count)
			low = middle;
		else
			high = middle;
	}
	(void)fill(plan, kind, low, SIZE_MAX, false);
}

/* As few on each deck as all decks together allow. */
static void fill_decks(struct plan *plan)
{
	size_t room_count = plan->layout.room_count;
	size_t items_max = (plan->large_count + room_count - 1) / room_count;

	while (fill(plan, RACK_DECK, 0, items_max, true) > room_count)
		items_max++;
	(void)fill(plan, RACK_DECK, 0, items_max, false);
}

int rack_place(struct rack_item *items, size_t item_count, struct rack_layout *ret)
{
	struct plan plan = { .items = items, .item_count = item_count };
	size_t room_count;
	size_t deck_count;
	int r = -ENOMEM;

	CHECK(item_count > 0);
	plan.orders = malloc(item_count * sizeof(*plan.orders));
	if (plan.orders)
		r = make_order(&plan);
	if (r == 0) {
		room_count = (balance_sides(&plan) + RACK_SIDE_BAYS - 1) / RACK_SIDE_BAYS;
		deck_count = fill(&plan, RACK_DECK, 0, SIZE_MAX, true);
		room_count = deck_count > room_count ? deck_count : room_count;
		r = make_rooms(&plan, room_count + room_count % 2);
	}
	if (r == 0) {
		fill_sides(&plan, RACK_DEEP);
		fill_sides(&plan, RACK_SHALLOW);
		if (plan.large_count > 0)
			fill_decks(&plan);
		*ret = plan.layout;
	}
	free(plan.orders);
	return r;
}

void rack_layout_done(struct rack_layout *layout)
{
	free(layout->rooms);
	*layout = (struct rack_layout){ 0 };
}
