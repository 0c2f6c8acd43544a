/* SPDX-License-Identifier: MIT */
#include "tools/gen/bay.h"

#include <math.h>

#define HALL_DEPTH    20.0
#define YARD_DEPTH    26.0
#define GROUND_MARGIN 30.0
#define GROUND_TOP    (-0.35)
#define COLUMN_WIDTH  0.5
/* Half the gap between two slabs, hidden by the beam below it. */
#define SLAB_JOINT 0.01

#define STREAM_ROOF (UINT64_C(4) << 60)
#define STREAM_HALL (UINT64_C(5) << 60)
#define STREAM_YARD (UINT64_C(6) << 60)

static struct vec3 at(double x, double y, double z)
{
	return (struct vec3){ x, y, z };
}

void bay_paint_coal(struct mesh *mesh)
{
	machine_paint(mesh, PAINT_COAL);
}

/* Cells in order: the ground, the floors and the roof bay by bay, the hall, the yard. */
static uint64_t floor_bays(const struct plant *plant)
{
	return (uint64_t)plant->row_count * plant->column_count;
}

uint64_t bay_cell_count(const struct plant *plant)
{
	return 1 + (plant->floor_count + 1) * floor_bays(plant) + 2 * (uint64_t)plant->column_count;
}

static struct bay bay_at(const struct plant *plant, unsigned floor, unsigned row, unsigned column)
{
	struct frame world = FRAME_WORLD;

	return (struct bay){
		.plant = plant,
		.floor = floor,
		.row = row,
		.column = column,
		.frame =
			frame_at(&world, plant->x[column], plant->y[row], floor * BAY_FLOOR_HEIGHT),
		.width = plant->x[column + 1] - plant->x[column],
		.depth = plant->y[row + 1] - plant->y[row],
		.height = BAY_FLOOR_HEIGHT - BAY_SLAB,
	};
}

static void make_ground(struct mesh *mesh, const struct plant *plant)
{
	const struct frame world = FRAME_WORLD;

	machine_paint(mesh, PAINT_GROUND);
	solid_box(mesh, &world, at(-GROUND_MARGIN, -HALL_DEPTH - GROUND_MARGIN, -0.8),
		  at(plant->x[plant->column_count] + 2 * GROUND_MARGIN,
		     plant->y[plant->row_count] + YARD_DEPTH + GROUND_MARGIN, GROUND_TOP));
}

/* ---- bays of the floors ---- */

static void make_slab(struct mesh *mesh, const struct bay *bay)
{
	struct frame corner = frame_at(&bay->frame, SLAB_JOINT, SLAB_JOINT, -BAY_SLAB);
	struct plate slab = { .width = bay->width - 2 * SLAB_JOINT,
			      .height = bay->depth - 2 * SLAB_JOINT,
			      .thickness = BAY_SLAB };

	if (bay->floor > 0) {
		struct bay below = bay_at(bay->plant, bay->floor - 1, bay->row, bay->column);

		if (bay_shaft(&below) != BAY_SHAFT_NONE)
			slab.openings[slab.opening_count++] = bay_shaft_opening(&below);
	}
	machine_paint(mesh, PAINT_CONCRETE);
	solid_plate(mesh, &corner, &slab);
}

/* The column at the bay's south-west corner, and those on the far side of the last bays. */
static void make_columns(struct mesh *mesh, const struct bay *bay)
{
	bool last_column = bay->column + 1 == bay->plant->column_count;
	bool last_row = bay->row + 1 == bay->plant->row_count;

	machine_paint(mesh, PAINT_CONCRETE);
	for (unsigned i = 0; i < 4; i++) {
		struct frame foot = frame_at(&bay->frame, i & 1 ? bay->width : 0,
					     i & 2 ? bay->depth : 0, -0.02);

		if ((!(i & 1) || last_column) && (!(i & 2) || last_row))
			solid_block(mesh, &foot, COLUMN_WIDTH, COLUMN_WIDTH, bay->height + 0.045);
	}
}

static void make_beams(struct mesh *mesh, const struct bay *bay)
{
	/* Their tops are in the slab, each at another height, all under those of walls and columns. */
	double high = bay->height + 0.018;
	double low = bay->height + 0.006;

	machine_paint(mesh, PAINT_STRUCTURE);
	machine_beam(mesh, &bay->frame, at(0, 0.1, high - 0.2), at(0, bay->depth - 0.1, high - 0.2),
		     0.4);
	machine_beam(mesh, &bay->frame, at(0.1, 0, low - 0.18), at(bay->width - 0.1, 0, low - 0.18),
		     0.36);
	machine_beam(mesh, &bay->frame, at(0.05, bay->depth / 2, low - 0.15),
		     at(bay->width - 0.05, bay->depth / 2, low - 0.15), 0.3);
}

static void make_roof(struct mesh *mesh, const struct bay *bay)
{
	const struct plant *plant = bay->plant;
	struct random random =
		random_stream(plant->seed, STREAM_ROOF | ((uint64_t)bay->row * plant->column_count +
							  bay->column));
	struct frame part;

	if (bay->row == 0)
		machine_railing(mesh, &bay->frame, bay->width);
	if (bay->row + 1 == plant->row_count) {
		part = frame_at(&bay->frame, 0, bay->depth, 0);
		machine_railing(mesh, &part, bay->width);
	}
	if (bay->column == 0 || bay->column + 1 == plant->column_count) {
		part = frame_at(&bay->frame, bay->column == 0 ? 0 : bay->width, 0, 0);
		part = frame_turned(&part, turn_of(1, 4));
		machine_railing(mesh, &part, bay->depth);
	}
	if (bay_is_corridor(bay->row)) {
		part = frame_at(&bay->frame, 0, bay->depth / 2, 0.9);
		machine_duct(mesh, &part, bay->width, 1.1);
		return;
	}
	part = frame_at(&bay->frame, bay->width / 2, bay->depth / 2, -MACHINE_SUNK);
	if (random_chance(&random, 0.3)) {
		machine_paint(mesh, PAINT_DUCT);
		solid_block(mesh, &part, 3.2, 2.2, 1.9);
		part = frame_at(&part, -1.4, -0.9, 1.95);
		machine_platform(mesh, &part, 2.8, 1.8);
	} else if (random_chance(&random, 0.3)) {
		machine_stack(mesh, &part, random_between(&random, 0.3, 0.5), 5);
	}
}

static void make_bay(struct mesh *mesh, const struct bay *bay)
{
	make_slab(mesh, bay);
	if (bay->floor == bay->plant->floor_count) {
		make_roof(mesh, bay);
		return;
	}
	make_columns(mesh, bay);
	make_beams(mesh, bay);
	bay_walls(mesh, bay);
	if (bay_is_corridor(bay->row))
		bay_corridor(mesh, bay);
	else
		bay_room(mesh, bay);
}

/* ---- the turbine hall, south of the floors ---- */

static void make_hall_shell(struct mesh *mesh, const struct plant *plant, unsigned column,
			    const struct frame *corner, double width, struct random *random)
{
	double height = plant->hall_height;
	struct frame part = frame_at(corner, SLAB_JOINT, SLAB_JOINT, -BAY_SLAB);
	struct plate floor = { .width = width - 2 * SLAB_JOINT,
			       .height = HALL_DEPTH - 0.2,
			       .thickness = BAY_SLAB };
	struct plate roof = floor;

	machine_paint(mesh, PAINT_CONCRETE);
	solid_plate(mesh, &part, &floor);
	roof.openings[roof.opening_count++] =
		(struct opening){ 0.25 * width, 0.3 * HALL_DEPTH, 0.75 * width, 0.45 * HALL_DEPTH };
	roof.openings[roof.opening_count++] =
		(struct opening){ 0.25 * width, 0.6 * HALL_DEPTH, 0.75 * width, 0.75 * HALL_DEPTH };
	part = frame_at(corner, SLAB_JOINT, SLAB_JOINT, height);
	solid_plate(mesh, &part, &roof);

	part = (struct frame){ corner->x, corner->z, at(0, -1, 0), corner->origin };
	for (double z = 0; z + 4 < height; z += BAY_FLOOR_HEIGHT) {
		struct frame wall = frame_at(&part, 0, z, 0);

		bay_wall(mesh, &wall, random, z > 0 ? WALL_OUTER : WALL_OUTER_GROUND, width,
			 fmin(BAY_FLOOR_HEIGHT - 0.07, height - z));
		/* Behind the joint of two walls. */
		machine_paint(mesh, PAINT_STRUCTURE);
		if (z > 0)
			machine_beam(mesh, corner, at(0.3, 0.2, z - 0.03),
				     at(width - 0.3, 0.2, z - 0.03), 0.2);
	}
	machine_paint(mesh, PAINT_STRUCTURE);
	for (unsigned i = 0; i <= (column + 1 == plant->column_count); i++) {
		double x = i * width;

		machine_beam(mesh, corner, at(x, 0.3, -0.1), at(x, 0.3, height + 0.05), 0.7);
		machine_beam(mesh, corner, at(x, HALL_DEPTH - 0.8, -0.1),
			     at(x, HALL_DEPTH - 0.8, height + 0.05), 0.7);
		machine_beam(mesh, corner, at(x, 0.13, height - 0.35),
			     at(x, HALL_DEPTH - 0.33, height - 0.35), 0.74);
	}
	for (unsigned i = 1; i < 6; i++)
		machine_beam(mesh, corner, at(0.05, i * HALL_DEPTH / 6, height - 0.15),
			     at(width - 0.05, i * HALL_DEPTH / 6, height - 0.15), 0.32);
}

/* Galleries along the wall of the building, the rails of the crane, and now and then its bridge. */
static void make_hall_ways(struct mesh *mesh, const struct plant *plant, unsigned column,
			   const struct frame *corner, double width)
{
	double rail = plant->hall_height - 2;
	struct frame part;

	for (unsigned floor = 1; floor * BAY_FLOOR_HEIGHT + 3 < plant->hall_height; floor++) {
		part = frame_at(corner, 0, HALL_DEPTH - 2, floor * BAY_FLOOR_HEIGHT - 0.03);
		machine_platform(mesh, &part, width, 1.8);
		part = frame_at(&part, 0, 0.05, 0);
		machine_railing(mesh, &part, width);
	}
	machine_paint(mesh, PAINT_RAILING);
	machine_beam(mesh, corner, at(0.01, 0.9, rail), at(width - 0.01, 0.9, rail), 0.5);
	machine_beam(mesh, corner, at(0.01, HALL_DEPTH - 2.6, rail),
		     at(width - 0.01, HALL_DEPTH - 2.6, rail), 0.5);
	if (column % 5 != 1)
		return;
	for (unsigned i = 0; i < 2; i++)
		machine_beam(mesh, corner, at(2 + 1.6 * i, 0.7, rail + 0.6),
			     at(2 + 1.6 * i, HALL_DEPTH - 2.4, rail + 0.6), 0.8);
	part = frame_at(corner, 2.8, HALL_DEPTH / 2, rail + 0.8);
	solid_block(mesh, &part, 1.9, 1.6, 0.8);
	machine_paint(mesh, PAINT_BOLT);
	solid_rod(mesh, &part, at(0, 0, -3.5), at(0, 0, 0.1), 0.03);
}

static void make_hall_end(struct mesh *mesh, const struct plant *plant, const struct frame *corner,
			  double x)
{
	struct frame wall = frame_at(corner, x, 0.1, -0.04);
	double height = plant->hall_height;
	struct plate plate = { .width = HALL_DEPTH - 0.4,
			       .height = height + 0.08,
			       .thickness = 0.32 };

	plate.openings[plate.opening_count++] = (struct opening){ 7.5, 0, 12.5, 5 };
	for (unsigned i = 0; i < 4; i++)
		plate.openings[plate.opening_count++] =
			(struct opening){ 1.5 + 4.4 * i, 0.62 * height, 4.5 + 4.4 * i,
					  0.85 * height };
	wall = (struct frame){ wall.y, wall.z, wall.x, wall.origin };
	wall = frame_at(&wall, 0, 0, -plate.thickness / 2);
	machine_paint(mesh, PAINT_OUTER_WALL);
	solid_plate(mesh, &wall, &plate);
}

static void make_hall(struct mesh *mesh, const struct plant *plant, unsigned column)
{
	struct random random = random_stream(plant->seed, STREAM_HALL | column);
	struct frame world = FRAME_WORLD;
	struct frame corner = frame_at(&world, plant->x[column], -HALL_DEPTH, 0);
	double width = plant->x[column + 1] - plant->x[column];
	struct frame part;

	make_hall_shell(mesh, plant, column, &corner, width, &random);
	make_hall_ways(mesh, plant, column, &corner, width);
	if (column == 0)
		make_hall_end(mesh, plant, &corner, 0);
	if (column + 1 == plant->column_count)
		make_hall_end(mesh, plant, &corner, width);
	if (column % 2 == 0 && column + 1 < plant->column_count) {
		part = frame_at(&corner, width, 0.42 * HALL_DEPTH, -MACHINE_SUNK);
		machine_turbine(mesh, &part, &random);
	}
	part = frame_at(&corner, 0, HALL_DEPTH - 4.5, 3.2);
	if (bay_furnished(plant, &random, 1))
		machine_pipe_rack(mesh, &part, &random, width, plant->hall_height - 3.2);
	part = frame_at(&corner, width / 2, HALL_DEPTH - 4.8, -MACHINE_SUNK);
	if (bay_furnished(plant, &random, 1))
		machine_pump(mesh, &part, &random, 3.4);
	for (unsigned i = 0; i < 2; i++) {
		part = frame_at(&corner, width / 2, HALL_DEPTH * (0.3 + 0.4 * i),
				plant->hall_height);
		machine_lamp(mesh, &part);
	}
}

/* ---- the yard, north of the floors ---- */

static void make_yard(struct mesh *mesh, const struct plant *plant, unsigned column)
{
	struct random random = random_stream(plant->seed, STREAM_YARD | column);
	struct frame world = FRAME_WORLD;
	double width = plant->x[column + 1] - plant->x[column];
	struct frame corner = frame_at(&world, plant->x[column], plant->y[plant->row_count],
				       GROUND_TOP - MACHINE_SUNK);
	double building = plant->floor_count * BAY_FLOOR_HEIGHT;
	struct frame part;

	/* The pipe bridge: portals with two decks of pipes. */
	machine_paint(mesh, PAINT_STRUCTURE);
	for (unsigned side = 0; side < 2; side++) {
		double y = 3 + 4 * side;

		machine_beam(mesh, &corner, at(0.3, y, -0.1), at(0.3, y, 7.6), 0.4);
	}
	for (unsigned deck = 0; deck < 2; deck++) {
		for (unsigned side = 0; side < 2; side++) {
			/* Wide ones reach into each other. */
			part = frame_at(&corner, 0, 3.6 + 1.8 * side, 5 + 2 * deck + 0.015 * side);
			if (bay_furnished(plant, &random, 1))
				machine_pipe_rack(mesh, &part, &random, width, 0.1);
		}
		machine_paint(mesh, PAINT_STRUCTURE);
		machine_beam(mesh, &corner, at(0.3, 2.77, 4.72 + 2 * deck),
			     at(0.3, 7.23, 4.72 + 2 * deck), 0.3);
	}
	part = frame_at(&corner, width / 2, 17, 0);
	if (column % 6 == 1) {
		machine_stack(mesh, &part, 2.6, 1.4 * building + 28);
	} else if (random_chance(&random, 0.7)) {
		double radius = random_between(&random, 2.4, 3.4);

		machine_storage(mesh, &part, radius, random_between(&random, 4, 9));
		/* Its pipe ends in the lower deck of the bridge. */
		part = frame_at(&corner, 1.2, 3.5, 0);
		machine_pump(mesh, &part, &random, 5.1);
	} else {
		part = frame_at(&corner, 0.4, 14, 3);
		machine_platform(mesh, &part, width - 0.8, 5);
		machine_railing(mesh, &part, width - 0.8);
		part = frame_at(&corner, width / 2, 16.5, 2.98);
		machine_tank(mesh, &part, &random, 7);
	}
}

void bay_make(struct mesh *mesh, const struct plant *plant, uint64_t cell)
{
	uint64_t bays = floor_bays(plant);

	if (cell == 0) {
		make_ground(mesh, plant);
		return;
	}
	cell--;
	if (cell < (plant->floor_count + 1) * bays) {
		unsigned in_floor = (unsigned)(cell % bays);
		struct bay bay =
			bay_at(plant, (unsigned)(cell / bays), in_floor / plant->column_count,
			       in_floor % plant->column_count);

		make_bay(mesh, &bay);
		return;
	}
	cell -= (plant->floor_count + 1) * bays;
	if (cell < plant->column_count)
		make_hall(mesh, plant, (unsigned)cell);
	else
		make_yard(mesh, plant, (unsigned)(cell - plant->column_count));
}
