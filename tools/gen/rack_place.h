/* SPDX-License-Identifier: MIT */
/**
 * rack_place.h - which model lies where in a store of shelves.
 *
 * All sizes are multiples of one unit: the edge of the cube that 98 of 100 models fit in as they
 * lie, or more where the largest would not fit in a room.  All rooms are of one size, and are full:
 * their number follows from the models.  They stand in pairs on both sides of a corridor along x.
 *
 * A room has rows of racks along x, back to back: shallow shelves for small models on one side,
 * deep ones on the other.  What counts as small is chosen so that both sides fill equally.  Models
 * are sorted by height, so that a board carries what is about equally high and boards lie as close
 * together as that allows; from the same height on they keep their order.  Bays are dealt to the
 * rooms in turn, so that each room has models of all sizes.  What no shelf takes lies on a low deck
 * along the outer wall.
 *
 * A pure function of sizes; no files.
 */
#ifndef TOOLS_GEN_RACK_PLACE_H
#define TOOLS_GEN_RACK_PLACE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "tools/gen/mesh.h"

#define RACK_ROWS       2u
#define RACK_ROW_BAYS   2u                          /* bays of one side of a row */
#define RACK_SIDE_BAYS  (RACK_ROWS * RACK_ROW_BAYS) /* deep ones of a room; as many shallow ones */
#define RACK_ROOM_BAYS  (2 * RACK_SIDE_BAYS + 1)
#define RACK_BOARDS_MAX 24u

enum rack_kind {
	RACK_DEEP,
	RACK_SHALLOW,
	RACK_DECK, /* the last bay of a room: one board near the floor */
};

/** What is the same in all rooms of a layout: lengths in model units. */
struct rack_sizes {
	double unit;
	double widths[3]; /* of a bay between uprights, by rack_kind */
	double depths[3];
	double height; /* of the racks */
	double board;  /* thickness of boards, uprights and panels */
	double gap;    /* between things */
	double aisle;
	double row_depth;  /* both sides and the panel between them */
	double wall;       /* thickness */
	double room_width; /* along the corridor */
	double room_depth;
	double room_height;
	double corridor; /* half its width */
};

/** One side of a row between two uprights, or the deck. */
struct rack_bay {
	unsigned board_count;
	double boards[RACK_BOARDS_MAX]; /* height of their upper sides */
};

struct rack_room {
	struct rack_sizes sizes;
	size_t number;
	struct frame frame; /* x along the corridor, y away from it; origin in its wall's corner */
	bool neighbour_low_x; /* on the side of x = 0; else the corridor ends there */
	bool neighbour_high_x;
	struct rack_bay bays[RACK_ROOM_BAYS];
};

/** What is to be placed: the size of a model's box as it lies. */
struct rack_item {
	struct vec3 size;
	struct vec3 place; /* set: the middle of the underside of the box, in the world */
};

struct rack_layout {
	struct rack_room *rooms;
	size_t room_count; /* even */
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

/** A bay's corner in its room: where its width (x) and depth (y) begin, and where depth leads. */
struct rack_bay_corner {
	enum rack_kind kind;
	double x;
	double y;
	double inward; /* +1 or -1: y from the aisle to the back panel */
};

struct rack_bay_corner rack_bay_corner(const struct rack_sizes *sizes, unsigned bay);

#endif /* TOOLS_GEN_RACK_PLACE_H */
