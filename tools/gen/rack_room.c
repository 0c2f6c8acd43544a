/* SPDX-License-Identifier: MIT */
#include "tools/gen/rack_room.h"

#include "tools/gen/machine.h"

static struct vec3 at(double x, double y, double z)
{
	return (struct vec3){ x, y, z };
}

/* ---- racks ---- */

/* The box between two points in any order of x. */
static void box_between(struct mesh *mesh, struct vec3 low, struct vec3 high)
{
	const struct frame frame = FRAME_WORLD;

	if (low.x > high.x) {
		double x = low.x;

		low.x = high.x;
		high.x = x;
	}
	solid_box(mesh, &frame, low, high);
}

static void make_bay(struct mesh *mesh, const struct rack_room *room, unsigned bay)
{
	const struct rack_scale *scale = &room->scale;
	const struct rack_bay *boards = &room->bays[bay];
	struct rack_bay_corner corner = rack_bay_corner(scale, bay);
	double post = 0.6 * scale->board;
	double back = corner.x + corner.inward * (scale->bay_depth - 0.02 * scale->board);

	machine_paint(mesh, PAINT_STRUCTURE);
	for (unsigned i = 0; i < 2; i++) {
		double x = i ? back - corner.inward * post : corner.x + corner.inward * post;
		double y = corner.y - 0.8 * scale->board;

		box_between(mesh, at(x - corner.inward * post, y, 0),
			    at(x, y + post, scale->height));
		if (bay % scale->row_bays + 1 == scale->row_bays) {
			y = corner.y + scale->bay_width + 0.2 * scale->board;
			box_between(mesh, at(x - corner.inward * post, y, 0),
				    at(x, y + post, scale->height));
		}
	}
	machine_paint(mesh, PAINT_CABINET);
	for (unsigned i = 0; i < boards->board_count; i++)
		box_between(mesh,
			    at(corner.x, corner.y - 0.1 * scale->board,
			       boards->boards[i] - scale->board),
			    at(back, corner.y + scale->bay_width + 0.1 * scale->board,
			       boards->boards[i]));
}

static bool row_is_used(const struct rack_room *room, unsigned row)
{
	unsigned bay_count = 2 * room->scale.row_bays;

	for (unsigned i = 0; i < bay_count; i++) {
		if (room->bays[row * bay_count + i].board_count > 0)
			return true;
	}
	return false;
}

static void make_row(struct mesh *mesh, const struct rack_room *room, unsigned row)
{
	const struct rack_scale *scale = &room->scale;
	unsigned bay_count = 2 * scale->row_bays;
	struct rack_bay_corner corner = rack_bay_corner(scale, row * bay_count);
	double length = scale->row_bays * (scale->bay_width + scale->board);
	double back = corner.x + scale->bay_depth;

	if (!row_is_used(room, row))
		return;
	machine_paint(mesh, PAINT_TRAY);
	box_between(mesh, at(back, corner.y - 0.5 * scale->board, 0.01 * scale->height),
		    at(back + scale->board, corner.y + length - 0.5 * scale->board,
		       0.99 * scale->height));
	for (unsigned i = 0; i < bay_count; i++)
		make_bay(mesh, room, row * bay_count + i);
}

/* ---- walls ---- */

/* A wall from a place along x or y; height from the floor. */
static void make_wall(struct mesh *mesh, const struct rack_scale *scale, struct vec3 from,
		      bool along_y, struct plate plate)
{
	struct frame frame = FRAME_WORLD;

	/* Upright: the plate's y up, its thickness towards +x or -y. */
	frame = along_y ? (struct frame){ frame.y, frame.z, frame.x, from }
			: (struct frame){ frame.x, frame.z, at(0, -1, 0), from };
	plate.height = scale->room_height;
	plate.thickness = scale->wall;
	machine_paint(mesh, PAINT_WALL);
	solid_plate(mesh, &frame, &plate);
}

static void add_opening(struct plate *plate, double middle, double width, double low, double high)
{
	plate->openings[plate->opening_count++] =
		(struct opening){ middle - width / 2, low, middle + width / 2, high };
}

/* Doors at the first and last aisle, windows between. */
static void make_long_walls(struct mesh *mesh, const struct rack_scale *scale)
{
	double door = 0.7 * scale->aisle;
	struct plate plate = { .width = scale->room_width - 0.02 * scale->wall };
	double pitch = 2 * scale->bay_depth + scale->board + scale->aisle;

	for (unsigned row = 0; row <= scale->row_count; row++) {
		double middle = scale->wall + scale->aisle / 2 + row * pitch;

		if (row % 2 == 0)
			add_opening(&plate, middle, door, 0, 0.85 * scale->height);
		else
			add_opening(&plate, middle, door, 0.4 * scale->height,
				    0.85 * scale->height);
	}
	make_wall(mesh, scale, at(0.01 * scale->wall, scale->wall, 0), false, plate);
	for (unsigned i = 0; i < plate.opening_count; i++)
		plate.openings[i].low_y = 0.55 * scale->height;
	make_wall(mesh, scale, at(0.01 * scale->wall, scale->room_depth, 0), false, plate);
}

static void make_side_wall(struct mesh *mesh, const struct rack_scale *scale, double x,
			   bool passage)
{
	double begin = 1.01 * scale->wall;
	struct plate plate = { .width = scale->room_depth - 2 * begin };

	if (passage)
		add_opening(&plate, plate.width - scale->aisle / 2, 0.6 * scale->aisle, 0,
			    0.85 * scale->height);
	make_wall(mesh, scale, at(x, begin, 0), true, plate);
}

/* Half of a corridor's end wall, with half a door. */
static void make_corridor_end(struct mesh *mesh, const struct rack_scale *scale, double x)
{
	struct plate plate = { .width = 0.99 * scale->corridor };

	plate.openings[plate.opening_count++] =
		(struct opening){ 0, 0, 0.35 * scale->aisle, 0.85 * scale->height };
	make_wall(mesh, scale, at(x, -scale->corridor, 0), true, plate);
}

void rack_room_make(struct mesh *mesh, void *arg)
{
	const struct rack_room *room = arg;
	const struct rack_scale *scale = &room->scale;

	machine_paint(mesh, PAINT_CONCRETE);
	box_between(mesh, at(0, -scale->corridor, -scale->wall),
		    at(scale->room_width, scale->room_depth, 0));
	make_long_walls(mesh, scale);
	make_side_wall(mesh, scale, 0.01 * scale->wall, room->passage_low_x);
	make_side_wall(mesh, scale, scale->room_width - 1.01 * scale->wall, room->passage_high_x);
	if (room->corridor_ends_low_x)
		make_corridor_end(mesh, scale, 0.01 * scale->wall);
	if (room->corridor_ends_high_x)
		make_corridor_end(mesh, scale, scale->room_width - 1.01 * scale->wall);
	for (unsigned row = 0; row < scale->row_count; row++)
		make_row(mesh, room, row);
}
