/* SPDX-License-Identifier: MIT */
#include "tools/gen/rack_room.h"

#include <stdio.h>

#include "formats/base/bytes.h"
#include "tools/gen/solid.h"

static struct vec3 at(double x, double y, double z)
{
	return (struct vec3){ x, y, z };
}

/* ---- groups ---- */

enum material {
	MATERIAL_FLOOR,
	MATERIAL_WALL,
	MATERIAL_UPRIGHT,
	MATERIAL_SHELF,
	MATERIAL_PANEL,
	MATERIAL_DECK,
	MATERIAL_LAMP,
};

static const struct {
	const char *name;
	const char *colour; /* as MTL writes it */
} materials[] = {
	[MATERIAL_FLOOR] = { "floor", "0.55 0.55 0.53" },
	[MATERIAL_WALL] = { "wall", "0.86 0.84 0.78" },
	[MATERIAL_UPRIGHT] = { "upright", "0.20 0.35 0.60" },
	[MATERIAL_SHELF] = { "shelf", "0.72 0.75 0.78" },
	[MATERIAL_PANEL] = { "panel", "0.62 0.66 0.70" },
	[MATERIAL_DECK] = { "deck", "0.66 0.50 0.32" },
	[MATERIAL_LAMP] = { "lamp", "0.97 0.96 0.90" },
};

void rack_room_materials(struct out_file *out)
{
	for (size_t i = 0; i < ARRAY_LENGTH(materials); i++)
		out_file_printf(out, "newmtl %s\nKd %s\n", materials[i].name, materials[i].colour);
}

static void begin_group(struct mesh *mesh, const struct rack_room *room, enum material material)
{
	char group[64];

	(void)snprintf(group, sizeof(group), "room %zu / %s", room->number,
		       materials[material].name);
	mesh_group(mesh, group, materials[material].name);
}

/* ---- racks ---- */

/* The box between two points in any order of y. */
static void box_between(struct mesh *mesh, struct vec3 low, struct vec3 high)
{
	const struct frame frame = FRAME_WORLD;

	if (low.y > high.y) {
		double y = low.y;

		low.y = high.y;
		high.y = y;
	}
	solid_box(mesh, &frame, low, high);
}

/* Uprights in the corners of all bays of a side; neighbours share theirs. */
static void make_uprights(struct mesh *mesh, const struct rack_sizes *sizes, unsigned side)
{
	for (unsigned i = 0; i <= RACK_ROW_BAYS; i++) {
		struct rack_bay_corner corner = rack_bay_corner(sizes, side * RACK_ROW_BAYS);
		double x = corner.x - 0.9 * sizes->board + i * (2 * sizes->unit + sizes->board);
		double width = 0.8 * sizes->board;
		double back = corner.y + corner.inward * sizes->depths[corner.kind];

		box_between(mesh, at(x, corner.y + corner.inward * 0.1 * width, 0),
			    at(x + width, corner.y + corner.inward * width, sizes->height));
		box_between(mesh, at(x, back - corner.inward * width, 0),
			    at(x + width, back - corner.inward * 0.1 * width, sizes->height));
	}
}

static void make_boards(struct mesh *mesh, const struct rack_room *room, unsigned index)
{
	const struct rack_sizes *sizes = &room->sizes;
	const struct rack_bay *bay = &room->bays[index];
	struct rack_bay_corner corner = rack_bay_corner(sizes, index);
	double back = corner.y + corner.inward * (sizes->depths[corner.kind] - 0.02 * sizes->board);

	for (unsigned i = 0; i < bay->board_count; i++)
		box_between(
			mesh,
			at(corner.x - 0.2 * sizes->board, corner.y, bay->boards[i] - sizes->board),
			at(corner.x + sizes->widths[corner.kind] + 0.2 * sizes->board, back,
			   bay->boards[i]));
}

static void make_racks(struct mesh *mesh, const struct rack_room *room)
{
	const struct rack_sizes *sizes = &room->sizes;

	begin_group(mesh, room, MATERIAL_PANEL);
	for (unsigned row = 0; row < RACK_ROWS; row++) {
		struct rack_bay_corner corner = rack_bay_corner(sizes, row * 2 * RACK_ROW_BAYS);
		double y = corner.y + sizes->depths[RACK_DEEP];
		double x = sizes->room_width - corner.x;

		box_between(mesh, at(corner.x - 0.5 * sizes->board, y, 0.01 * sizes->height),
			    at(x + 0.5 * sizes->board, y + sizes->board, 0.99 * sizes->height));
	}
	begin_group(mesh, room, MATERIAL_UPRIGHT);
	for (unsigned side = 0; side < 2 * RACK_ROWS; side++)
		make_uprights(mesh, sizes, side);
	begin_group(mesh, room, MATERIAL_SHELF);
	for (unsigned bay = 0; bay + 1 < RACK_ROOM_BAYS; bay++)
		make_boards(mesh, room, bay);
	begin_group(mesh, room, MATERIAL_DECK);
	make_boards(mesh, room, RACK_ROOM_BAYS - 1);
}

/* ---- walls ---- */

/* A wall from a place along x or y; height from the floor. */
static void make_wall(struct mesh *mesh, const struct rack_sizes *sizes, struct vec3 from,
		      bool along_y, struct plate plate)
{
	struct frame frame = FRAME_WORLD;

	/* Upright: the plate's y up, its thickness towards +x or -y. */
	frame = along_y ? (struct frame){ frame.y, frame.z, frame.x, from }
			: (struct frame){ frame.x, frame.z, at(0, -1, 0), from };
	plate.height = sizes->room_height;
	plate.thickness = sizes->wall;
	solid_plate(mesh, &frame, &plate);
}

static void add_door(struct plate *plate, const struct rack_sizes *sizes, double middle)
{
	double half = 0.4 * sizes->aisle;

	plate->openings[plate->opening_count++] =
		(struct opening){ middle - half, 0, middle + half, 0.9 * sizes->height };
}

static void add_window(struct plate *plate, const struct rack_sizes *sizes, double low, double high)
{
	plate->openings[plate->opening_count++] =
		(struct opening){ low, 0.3 * sizes->height, high, 0.9 * sizes->height };
}

/* Doors where the ways around the rows are, a window before each bay. */
static void make_corridor_wall(struct mesh *mesh, const struct rack_sizes *sizes)
{
	struct plate plate = { .width = sizes->room_width - 0.02 * sizes->wall };
	double way = sizes->wall + sizes->aisle / 2;

	add_door(&plate, sizes, way);
	for (unsigned bay = 0; bay < RACK_ROW_BAYS; bay++) {
		double x = rack_bay_corner(sizes, bay).x;

		add_window(&plate, sizes, x + 0.1 * sizes->unit, x + 1.9 * sizes->unit);
	}
	add_door(&plate, sizes, sizes->room_width - way);
	make_wall(mesh, sizes, at(0.01 * sizes->wall, sizes->wall, 0), false, plate);
}

/* To a neighbour: a door at the end of each aisle, and windows, to see from room to room. */
static void make_side_wall(struct mesh *mesh, const struct rack_sizes *sizes, double x,
			   bool neighbour)
{
	double begin = 1.01 * sizes->wall;
	struct plate plate = { .width = sizes->room_depth - 2 * begin };

	for (unsigned row = 0; neighbour && row <= RACK_ROWS; row++) {
		double y = sizes->wall + row * (sizes->row_depth + sizes->aisle) - begin;
		double depth = row < RACK_ROWS ? sizes->row_depth : sizes->depths[RACK_DECK];

		add_door(&plate, sizes, y + sizes->aisle / 2);
		y += sizes->aisle;
		if (depth > 0)
			add_window(&plate, sizes, y + 0.06 * depth, y + 0.94 * depth);
	}
	make_wall(mesh, sizes, at(x, begin, 0), true, plate);
}

/* Half of a corridor's end wall, with half a door. */
static void make_corridor_end(struct mesh *mesh, const struct rack_sizes *sizes, double x)
{
	struct plate plate = { .width = 0.99 * sizes->corridor };

	plate.openings[plate.opening_count++] =
		(struct opening){ 0, 0, 0.35 * sizes->aisle, 0.9 * sizes->height };
	make_wall(mesh, sizes, at(x, -sizes->corridor, 0), true, plate);
}

static void make_walls(struct mesh *mesh, const struct rack_room *room)
{
	const struct rack_sizes *sizes = &room->sizes;
	struct plate outer = { .width = sizes->room_width - 0.02 * sizes->wall };
	double low_x = 0.01 * sizes->wall;
	double high_x = sizes->room_width - 1.01 * sizes->wall;

	begin_group(mesh, room, MATERIAL_WALL);
	make_corridor_wall(mesh, sizes);
	make_wall(mesh, sizes, at(low_x, sizes->room_depth, 0), false, outer);
	make_side_wall(mesh, sizes, low_x, room->neighbour_low_x);
	make_side_wall(mesh, sizes, high_x, room->neighbour_high_x);
	if (!room->neighbour_low_x)
		make_corridor_end(mesh, sizes, low_x);
	if (!room->neighbour_high_x)
		make_corridor_end(mesh, sizes, high_x);
}

/* ---- lamps ---- */

/*
 * Broad ones above all ways, so that these have a height that programs can measure, and the rest
 * is open to the sky.  Those across hang below those along the rows.
 */
static void make_lamps(struct mesh *mesh, const struct rack_room *room)
{
	const struct rack_sizes *sizes = &room->sizes;
	double margin = 0.2 * sizes->aisle;
	double width = sizes->aisle - 2 * margin;
	double thickness = 0.3 * sizes->wall;
	double top = sizes->room_height - 0.1 * thickness;
	double begin = 0.98 * sizes->wall;
	double end_x = sizes->room_width - begin;
	double end_y = begin;

	begin_group(mesh, room, MATERIAL_LAMP);
	for (unsigned row = 0; row <= RACK_ROWS; row++) {
		double y = sizes->wall + margin + row * (sizes->row_depth + sizes->aisle);

		box_between(mesh, at(begin, y, top - thickness), at(end_x, y + width, top));
		end_y = y + width;
	}
	top -= 1.1 * thickness;
	for (unsigned i = 0; i < 2; i++) {
		double way = sizes->wall + margin;
		double x = i == 0 ? way : sizes->room_width - way - width;

		box_between(mesh, at(x, begin, top - thickness), at(x + width, end_y, top));
	}
	box_between(mesh, at(begin, -0.99 * sizes->corridor, top - thickness),
		    at(end_x, -0.4 * sizes->corridor, top));
}

void rack_room_make(struct mesh *mesh, void *arg)
{
	const struct rack_room *room = arg;
	const struct rack_sizes *sizes = &room->sizes;

	begin_group(mesh, room, MATERIAL_FLOOR);
	box_between(mesh, at(0, -sizes->corridor, -sizes->wall),
		    at(sizes->room_width, sizes->room_depth, 0));
	make_walls(mesh, room);
	make_racks(mesh, room);
	make_lamps(mesh, room);
}
