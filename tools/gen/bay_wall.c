/* SPDX-License-Identifier: MIT */
#include "formats/base/check.h"
#include "tools/gen/bay.h"

/* How far a wall reaches into the slabs above and below. */
#define WALL_SUNK 0.03
/* From a column's middle to where a wall begins, inside the column. */
#define WALL_END    0.15
#define DOOR_HEIGHT 2.2

#define STREAM_WALL (UINT64_C(1) << 60)

static struct vec3 at(double x, double y, double z)
{
	return (struct vec3){ x, y, z };
}

static void door_frame(struct mesh *mesh, const struct frame *wall, const struct opening *o,
		       double thickness, struct random *random)
{
	double front = thickness + 0.03;
	double foot = WALL_SUNK - MACHINE_SUNK;
	struct frame leaf = frame_at(wall, o->low_x + 0.05, 0, thickness);

	machine_paint(mesh, PAINT_FRAME);
	solid_box(mesh, wall, at(o->low_x - 0.06, foot, -0.03),
		  at(o->low_x + 0.04, o->high_y + 0.05, front));
	solid_box(mesh, wall, at(o->high_x - 0.04, foot, -0.03),
		  at(o->high_x + 0.06, o->high_y + 0.05, front));
	solid_box(mesh, wall, at(o->low_x + 0.03, o->high_y - 0.04, -0.025),
		  at(o->high_x - 0.03, o->high_y + 0.06, front - 0.005));
	if (random_chance(random, 0.35))
		return;
	/* The leaf turns about the wall's upright, which is the frame's y. */
	leaf = (struct frame){ leaf.z, leaf.x, leaf.y, leaf.origin };
	leaf = frame_turned(&leaf, turn_of(random_below(random, 200) + 20, 1000));
	machine_paint(mesh, PAINT_CABINET);
	solid_box(mesh, &leaf, at(0, 0, WALL_SUNK + 0.02),
		  at(0.04, o->high_x - o->low_x - 0.12, o->high_y - 0.06));
	machine_paint(mesh, PAINT_BOLT);
	solid_rod(mesh, &leaf, at(-0.06, o->high_x - o->low_x - 0.25, 1.05),
		  at(0.1, o->high_x - o->low_x - 0.25, 1.05), 0.02);
}

static void window_frame(struct mesh *mesh, const struct frame *wall, const struct opening *o,
			 double thickness)
{
	const double bar = 0.06;
	double width = o->high_x - o->low_x + 0.1;
	double height = o->high_y - o->low_y + 0.1;
	struct frame corner =
		frame_at(wall, o->low_x - 0.05, o->low_y - 0.05, thickness / 2 - 0.04);
	struct plate frame = { .width = width, .height = height, .thickness = 0.08 };

	if (mesh->level == 0)
		return;
	for (unsigned i = 0; i < 4; i++) {
		double x = i & 1 ? width / 2 + bar / 2 : bar + 0.04;
		double y = i & 2 ? height / 2 + bar / 2 : bar + 0.04;

		frame.openings[frame.opening_count++] =
			(struct opening){ x, y, x + width / 2 - 1.5 * bar - 0.04,
					  y + height / 2 - 1.5 * bar - 0.04 };
	}
	machine_paint(mesh, PAINT_FRAME);
	solid_plate(mesh, &corner, &frame);
}

/* The chances of what stands in each third of a wall, in hundredths. */
static const struct wall_style {
	unsigned door;
	unsigned passage; /* a wide opening without a frame */
	unsigned window;
	double thickness;
	enum paint paint;
} wall_styles[] = {
	[WALL_OUTER] = { 0, 0, 80, 0.3, PAINT_OUTER_WALL },
	[WALL_OUTER_GROUND] = { 15, 0, 60, 0.3, PAINT_OUTER_WALL },
	[WALL_CORRIDOR] = { 40, 8, 27, 0.2, PAINT_WALL },
	[WALL_ROOM] = { 20, 10, 20, 0.2, PAINT_WALL },
	[WALL_HALL] = { 25, 5, 50, 0.3, PAINT_WALL },
};

void bay_wall(struct mesh *mesh, const struct frame *frame, struct random *random,
	      enum wall_kind kind, double length, double height)
{
	const struct wall_style *style = &wall_styles[kind];
	struct frame corner = frame_at(frame, WALL_END, -WALL_SUNK, -style->thickness / 2);
	struct plate plate = { .width = length - 2 * WALL_END,
			       .height = height + 2 * WALL_SUNK,
			       .thickness = style->thickness };
	bool is_door[PLATE_OPENINGS_MAX];
	bool is_window[PLATE_OPENINGS_MAX];
	unsigned third_count = length > 5 ? 3 : 1;
	double third = (plate.width - 0.8) / third_count;

	for (unsigned i = 0; i < third_count; i++) {
		double middle = 0.4 + (i + 0.5) * third + random_between(random, -0.2, 0.2);
		double share = random_between(random, 0, 100);
		double half = random_between(random, 0.5, 0.75);
		struct opening o = { middle - half, 0, middle + half, WALL_SUNK + DOOR_HEIGHT };
		bool window = false;

		if (share >= style->door + style->passage + style->window)
			continue;
		if (share >= style->door + style->passage) {
			window = true;
			half = random_between(random, 0.6, 0.9);
			o = (struct opening){ middle - half, 1.0, middle + half,
					      random_between(random, 2.0, 2.9) };
		} else if (share >= style->door) {
			o = (struct opening){ middle - 0.95, 0, middle + 0.95, 3.0 };
		}
		is_door[plate.opening_count] = share < style->door;
		is_window[plate.opening_count] = window;
		plate.openings[plate.opening_count++] = o;
	}
	machine_paint(mesh, style->paint);
	solid_plate(mesh, &corner, &plate);
	for (unsigned i = 0; i < plate.opening_count; i++) {
		if (is_door[i])
			door_frame(mesh, &corner, &plate.openings[i], style->thickness, random);
		else if (is_window[i])
			window_frame(mesh, &corner, &plate.openings[i], style->thickness);
	}
}

/* Walls have streams of their own: bay number, then which of its four sides. */
static struct random wall_random(const struct bay *bay, unsigned side)
{
	const struct plant *plant = bay->plant;
	uint64_t number = bay->floor;

	number = number * plant->row_count + bay->row;
	number = number * plant->column_count + bay->column;
	return random_stream(plant->seed, STREAM_WALL | (number * 4 + side));
}

/* A wall along x at so far north in the bay. */
static void wall_along_x(struct mesh *mesh, const struct bay *bay, enum wall_kind kind, double y)
{
	struct random random = wall_random(bay, y > 0);
	struct frame wall = frame_at(&bay->frame, 0, y, 0);

	/* Upright: x along the wall, y up. */
	wall = (struct frame){ wall.x, wall.z, at(-wall.y.x, -wall.y.y, -wall.y.z), wall.origin };
	bay_wall(mesh, &wall, &random, kind, bay->width, bay->height);
}

static void wall_along_y(struct mesh *mesh, const struct bay *bay, enum wall_kind kind, double x)
{
	struct random random = wall_random(bay, 2 + (x > 0));
	struct frame wall = frame_at(&bay->frame, x, 0, 0);

	wall = (struct frame){ wall.y, wall.z, wall.x, wall.origin };
	bay_wall(mesh, &wall, &random, kind, bay->depth, bay->height);
}

void bay_walls(struct mesh *mesh, const struct bay *bay)
{
	const struct plant *plant = bay->plant;
	enum wall_kind outer = bay->floor == 0 ? WALL_OUTER_GROUND : WALL_OUTER;
	bool corridor = bay_is_corridor(bay->row);
	double top = (bay->floor + 1) * BAY_FLOOR_HEIGHT;

	if (bay->row == 0)
		wall_along_x(mesh, bay, top <= plant->hall_height ? WALL_HALL : WALL_OUTER, 0);
	else
		wall_along_x(mesh, bay,
			     corridor || bay_is_corridor(bay->row - 1) ? WALL_CORRIDOR : WALL_ROOM,
			     0);
	if (bay->row + 1 == plant->row_count)
		wall_along_x(mesh, bay, outer, bay->depth);

	if (bay->column == 0)
		wall_along_y(mesh, bay, outer, 0);
	else if (!corridor)
		wall_along_y(mesh, bay, WALL_ROOM, 0);
	if (bay->column + 1 == plant->column_count)
		wall_along_y(mesh, bay, outer, bay->width);
}
