/* SPDX-License-Identifier: MIT */
/**
 * rack_place.h - which model lies where in a store of shelves.
 *
 * All sizes are multiples of one: the median of the models' larger sides as they lie, which is
 * about what a hand would hold.  Models that are too large for such shelves go to rooms with shelves
 * of twice, four times, ... the size: a class is such a power of two.  Within a class they
 * are sorted by height, so that a board carries what is about equally high; from the same height on
 * they keep their order.
 *
 * Rooms stand in pairs on both sides of a corridor along x, the smallest class first.  A room has
 * rows of two-sided racks with a back panel, aisles between them and a way around.
 *
 * A pure function of sizes; no files.
 */
#ifndef TOOLS_GEN_RACK_PLACE_H
#define TOOLS_GEN_RACK_PLACE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "tools/gen/mesh.h"

#define RACK_ROWS_MAX     2u /* two-sided racks of a room */
#define RACK_ROW_BAYS_MAX 4u /* bays of one side of a rack */
#define RACK_ROOM_BAYS    (2 * RACK_ROWS_MAX * RACK_ROW_BAYS_MAX)
#define RACK_BOARDS_MAX   24u

/** Lengths of a room's class, in model units. */
struct rack_scale {
	unsigned row_count;
	unsigned row_bays; /* bays of one side of a rack, fewer of larger ones */
	double bay_width;  /* between uprights */
	double bay_depth;
	double height; /* of the racks */
	double board;  /* thickness of boards, uprights and panels */
	double gap;    /* between things */
	double aisle;
	double wall;       /* thickness */
	double room_width; /* along the corridor */
	double room_depth;
	double room_height;
	double corridor; /* half its width */
};

/** For models of the class: its bays are 2^class as wide and deep, aisles grow more slowly. */
struct rack_scale rack_scale(double unit, unsigned class);

/** One side of a rack between two uprights. */
struct rack_bay {
	unsigned board_count;
	double boards[RACK_BOARDS_MAX]; /* height of their upper sides */
};

struct rack_room {
	struct rack_scale scale;
	struct frame frame; /* x along the corridor, y away from it; origin in its wall's corner */
	bool passage_low_x; /* a way to the next room of its class on the side of x = 0 */
	bool passage_high_x;
	bool corridor_ends_low_x; /* the corridor has an end wall there */
	bool corridor_ends_high_x;
	struct rack_bay bays[RACK_ROOM_BAYS];
};

/** What is to be placed: the size of a model's box as it lies. */
struct rack_item {
	struct vec3 size;
	struct vec3 place; /* set: the middle of the underside of the box, in the world */
};

struct rack_layout {
	struct rack_room *rooms;
	size_t room_count;
};

/**
 * Places all items.
 *
 * items: sizes finite and >= 0; item_count > 0
 *
 * Returns: 0 or -ENOMEM.  Ownership: ends with rack_layout_done().
 */
int rack_place(struct rack_item *items, size_t item_count, struct rack_layout *ret);
void rack_layout_done(struct rack_layout *layout);

/** A bay's corner in its room: where its width (y) and depth (x) begin, and where depth leads. */
struct rack_bay_corner {
	double x;
	double y;
	double inward; /* +1 or -1: x from the aisle to the back panel */
};

struct rack_bay_corner rack_bay_corner(const struct rack_scale *scale, unsigned bay);

#endif /* TOOLS_GEN_RACK_PLACE_H */
