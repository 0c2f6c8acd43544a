/* SPDX-License-Identifier: MIT */
#include "tools/gen/machine.h"

#include <math.h>

#define RGB(red, green, blue) ((red) | (uint32_t)(green) << 8 | (uint32_t)(blue) << 16)

static const uint32_t paint_colours[PAINT_COUNT_] = {
	[PAINT_CONCRETE] = RGB(150, 148, 142),  [PAINT_WALL] = RGB(206, 203, 190),
	[PAINT_OUTER_WALL] = RGB(176, 122, 96), [PAINT_FRAME] = RGB(84, 92, 100),
	[PAINT_STRUCTURE] = RGB(94, 108, 124),  [PAINT_GRATING] = RGB(120, 124, 126),
	[PAINT_RAILING] = RGB(236, 186, 38),    [PAINT_WATER] = RGB(58, 150, 88),
	[PAINT_STEAM] = RGB(188, 192, 198),     [PAINT_OIL] = RGB(140, 92, 52),
	[PAINT_GAS] = RGB(214, 176, 74),        [PAINT_VESSEL] = RGB(168, 184, 196),
	[PAINT_PUMP] = RGB(44, 96, 168),        [PAINT_MOTOR] = RGB(70, 130, 140),
	[PAINT_VALVE] = RGB(190, 44, 40),       [PAINT_BOLT] = RGB(88, 88, 92),
	[PAINT_TRAY] = RGB(172, 176, 178),      [PAINT_CABLE] = RGB(44, 46, 52),
	[PAINT_CABINET] = RGB(208, 206, 196),   [PAINT_LAMP] = RGB(250, 246, 222),
	[PAINT_DUCT] = RGB(186, 196, 204),      [PAINT_STACK] = RGB(204, 196, 188),
	[PAINT_GROUND] = RGB(112, 116, 100),    [PAINT_COAL] = RGB(40, 38, 38),
};

void machine_paint(struct mesh *mesh, enum paint paint)
{
	mesh->colour = paint_colours[paint];
}

enum paint machine_random_medium(struct random *random)
{
	static const enum paint media[] = { PAINT_WATER, PAINT_STEAM, PAINT_STEAM, PAINT_OIL,
					    PAINT_GAS };

	return media[random_below(random, sizeof(media) / sizeof(media[0]))];
}

static struct vec3 at(double x, double y, double z)
{
	return (struct vec3){ x, y, z };
}

/* ---- small parts ---- */

void machine_flange(struct mesh *mesh, const struct frame *frame, double pipe_radius)
{
	double radius = 1.5 * pipe_radius + 0.015;
	double half = 0.012 + 0.12 * pipe_radius;
	const struct lathe_point points[] = { { radius, -half }, { radius, half } };
	unsigned bolt_count = 4 + 4 * (mesh->level / 4 > 3 ? 3 : mesh->level / 4);
	uint32_t colour = mesh->colour;

	solid_lathe(mesh, frame, points, 2, mesh_segments(mesh, radius));
	if (mesh->level < 2)
		return;
	machine_paint(mesh, PAINT_BOLT);
	for (unsigned k = 0; k < bolt_count; k++) {
		const struct turn turn = mesh_circle(mesh, bolt_count)[k];
		double centre = (radius + pipe_radius) / 2;
		struct frame bolt =
			frame_at(frame, centre * turn.cosine, centre * turn.sine, -1.35 * half);

		solid_bolt(mesh, &bolt, 0.18 * (radius - pipe_radius) + 0.002, 2.7 * half);
	}
	mesh->colour = colour;
}

void machine_valve(struct mesh *mesh, const struct frame *frame, double pipe_radius)
{
	double r = pipe_radius;
	const struct lathe_point body[] = { { 1.3 * r, -2.2 * r },
					    { 1.7 * r, -1.1 * r },
					    { 1.9 * r, 0 },
					    { 1.7 * r, 1.1 * r },
					    { 1.3 * r, 2.2 * r } };
	struct frame along = frame_along_x(frame);
	struct frame part;
	uint32_t colour = mesh->colour;

	machine_paint(mesh, PAINT_VALVE);
	solid_lathe(mesh, &along, body, 5, mesh_segments(mesh, 1.9 * r));
	solid_rod(mesh, frame, at(0, 0, r), at(0, 0, 5 * r), 0.25 * r);
	part = frame_at(frame, 0, 0, 5 * r);
	solid_torus(mesh, &part, 1.8 * r, 0.18 * r);
	solid_rod(mesh, &part, at(-1.8 * r, 0, 0), at(1.8 * r, 0, 0), 0.12 * r);
	solid_rod(mesh, &part, at(0, -1.8 * r, 0), at(0, 1.8 * r, 0), 0.12 * r);
	mesh->colour = colour;
	part = frame_at(&along, 0, 0, -2.4 * r);
	machine_flange(mesh, &part, r);
	part = frame_at(&along, 0, 0, 2.4 * r);
	machine_flange(mesh, &part, r);
}

/* A short pipe along z with a flange at its end. */
static void nozzle(struct mesh *mesh, const struct frame *frame, double radius, double length)
{
	struct frame end = frame_at(frame, 0, 0, length);

	solid_cylinder(mesh, frame, radius, length);
	machine_flange(mesh, &end, radius);
}

void machine_beam(struct mesh *mesh, const struct frame *frame, struct vec3 from, struct vec3 to,
		  double height)
{
	const struct vec3 path[2] = { from, to };
	struct outline outline;

	outline_beam(0.6 * height, height, 0.08 * height, &outline);
	solid_sweep(mesh, frame, &outline, path, 2, 0);
}

/* Adds a rounded end: a quarter of an ellipse from the radius to the axis, going up or down. */
static unsigned add_dome(const struct mesh *mesh, struct lathe_point *points, double radius,
			 double base, double rise)
{
	unsigned steps = 2 + mesh->level / 2 > 40 ? 40 : 2 + mesh->level / 2;
	const struct turn *circle = mesh_circle(mesh, 4 * steps);

	for (unsigned k = 0; k <= steps; k++) {
		/* Domes below are listed from the pole to the edge, domes above from the edge on. */
		unsigned step = rise < 0 ? steps - k : k;

		points[k].radius = step == steps ? 0 : radius * circle[step].cosine;
		points[k].height = base + rise * circle[step].sine;
	}
	return steps + 1;
}

/* A pressure vessel along z with two domes. */
static void vessel(struct mesh *mesh, const struct frame *frame, double radius, double length)
{
	struct lathe_point points[LATHE_POINTS_MAX];
	unsigned count = add_dome(mesh, points, radius, 0.5 * radius, -0.5 * radius);

	count += add_dome(mesh, points + count, radius, length - 0.5 * radius, 0.5 * radius);
	solid_lathe(mesh, frame, points, count, mesh_segments(mesh, radius));
}

/* ---- machines of a room ---- */

void machine_tank(struct mesh *mesh, const struct frame *frame, struct random *random,
		  double height)
{
	double radius = random_between(random, 0.45, 0.8);
	double length = random_between(random, 0.39, 0.56) * height;
	struct frame body = frame_at(frame, 0, 0, 0.35);
	struct frame part;

	machine_paint(mesh, PAINT_VESSEL);
	vessel(mesh, &body, radius, length);
	machine_paint(mesh, PAINT_STRUCTURE);
	for (int k = 0; k < 4; k++) {
		const struct turn turn = mesh_circle(mesh, 4)[k];
		struct frame leg = frame_turned(frame, turn);

		machine_beam(mesh, &leg, at(0.85 * radius, 0, 0), at(0.85 * radius, 0, 0.8), 0.12);
	}
	machine_paint(mesh, PAINT_VESSEL);
	part = frame_at(&body, 0, 0, length - 0.1);
	nozzle(mesh, &part, 0.09, 0.3);
	for (int k = 0; k < 3; k++) {
		struct frame side = frame_turned(&body, turn_random(random));

		side = frame_at(&side, 0.9 * radius, 0, random_between(random, 0.4, 0.7 * length));
		side = frame_along_x(&side);
		nozzle(mesh, &side, random_between(random, 0.04, 0.12), 0.1 * radius + 0.18);
	}
	if (random_chance(random, 0.5)) {
		part = frame_at(frame, radius + 0.12, 0, 0);
		machine_ladder(mesh, &part, length);
	}
}

void machine_drum(struct mesh *mesh, const struct frame *frame, struct random *random,
		  double height)
{
	double radius = random_between(random, 0.4, 0.65);
	double length = MACHINE_SLOT + 0.3;
	struct frame body = frame_at(frame, -length / 2, 0, radius + 0.45);
	struct frame along = frame_along_x(&body);
	struct frame part;

	machine_paint(mesh, machine_random_medium(random));
	vessel(mesh, &along, radius, length);
	for (int k = 0; k < 3; k++) {
		part = frame_at(&body, length * (0.25 + 0.25 * k), 0, 0.9 * radius);
		nozzle(mesh, &part, random_between(random, 0.05, 0.1), 0.15 + 0.1 * radius);
	}
	for (int k = -1; k <= 1; k += 2) {
		machine_paint(mesh, PAINT_CONCRETE);
		part = frame_at(frame, 0.3 * k * length, 0, 0);
		solid_block(mesh, &part, 0.2, 1.7 * radius, 0.25);
		machine_paint(mesh, PAINT_STRUCTURE);
		part = frame_at(&part, 0, 0, 0.25 - MACHINE_SUNK);
		solid_block(mesh, &part, 0.12, 1.4 * radius, 0.2 + 0.4 * radius);
	}
	if (height > 2.5 && random_chance(random, 0.6)) {
		part = frame_at(&body, length / 2, 0, radius + 0.25);
		machine_paint(mesh, PAINT_STEAM);
		solid_cylinder(mesh, &part, 0.07, height - 2 * radius - 0.7);
	}
}

/* A motor along x with cooling ribs and a terminal box. */
static void motor(struct mesh *mesh, const struct frame *frame, double radius, double length)
{
	struct lathe_point points[LATHE_POINTS_MAX];
	unsigned rib_count = 3 + (mesh->level > 30 ? 30 : mesh->level);
	struct frame along = frame_along_x(frame);
	struct frame part = frame_at(frame, length / 2, 0, 0.95 * radius);
	unsigned count = 0;

	machine_paint(mesh, PAINT_MOTOR);
	points[count++] = (struct lathe_point){ 0.6 * radius, 0 };
	for (unsigned k = 0; k < rib_count; k++) {
		double pitch = length / rib_count;

		points[count++] = (struct lathe_point){ radius, (k + 0.2) * pitch };
		points[count++] = (struct lathe_point){ radius, (k + 0.5) * pitch };
		points[count++] = (struct lathe_point){ 0.88 * radius, (k + 0.6) * pitch };
		points[count++] = (struct lathe_point){ 0.88 * radius, (k + 0.9) * pitch };
	}
	points[count++] = (struct lathe_point){ 0.6 * radius, length };
	solid_lathe(mesh, &along, points, count, mesh_segments(mesh, radius));
	solid_block(mesh, &part, 0.4 * length, 0.8 * radius, 0.35 * radius);
}

void machine_pump(struct mesh *mesh, const struct frame *frame, struct random *random,
		  double height)
{
	double radius = random_between(random, 0.16, 0.3);
	double axis = 0.3 + radius;
	enum paint medium = machine_random_medium(random);
	const struct lathe_point casing[] = { { 0.5 * radius, 0 },    { 1.2 * radius, 0.05 },
					      { 1.5 * radius, 0.15 }, { 1.5 * radius, 0.3 },
					      { 1.2 * radius, 0.4 },  { 0.6 * radius, 0.48 },
					      { 0.6 * radius, 0.6 } };
	struct outline pipe;
	struct frame part;
	struct frame along;
	const struct vec3 rise[] = { { 0.75, 0, axis + 1.2 * radius },
				     { 0.75, 0, 0.55 * height },
				     { 0.75, 0.7, 0.55 * height },
				     { 0.75, 0.7, height } };

	machine_paint(mesh, PAINT_CONCRETE);
	solid_block(mesh, frame, 1.9, 0.9, 0.22);
	machine_paint(mesh, PAINT_STRUCTURE);
	part = frame_at(frame, 0, 0, 0.22 - MACHINE_SUNK);
	solid_block(mesh, &part, 1.75, 0.7, 0.08 + 0.3 * radius);
	part = frame_at(frame, -0.85, 0, axis);
	motor(mesh, &part, radius, 0.9);
	machine_paint(mesh, PAINT_BOLT);
	solid_rod(mesh, frame, at(0.04, 0, axis), at(0.52, 0, axis), 0.2 * radius);
	machine_paint(mesh, PAINT_PUMP);
	part = frame_at(frame, 0.5, 0, axis);
	along = frame_along_x(&part);
	solid_lathe(mesh, &along, casing, 7, mesh_segments(mesh, 1.5 * radius));
	machine_paint(mesh, medium);
	outline_circle(mesh, 0.3 * radius, &pipe);
	solid_sweep(mesh, frame, &pipe, rise, 4, 0.25);
	part = frame_at(frame, 0.75, 0, axis + 1.6 * radius);
	machine_flange(mesh, &part, 0.3 * radius);
	/* Turned so that the pipe's direction, up, is the valve's x. */
	part = frame_at(frame, 0.75, 0, axis + 1.6 * radius + 0.4);
	part = (struct frame){ part.z, part.x, part.y, part.origin };
	machine_valve(mesh, &part, 0.3 * radius);
}

void machine_exchanger(struct mesh *mesh, const struct frame *frame, struct random *random,
		       double height)
{
	unsigned rows = 3 + random_below(random, 4);
	unsigned layers = 3 + random_below(random, 4);
	double length = MACHINE_SLOT;
	double pitch = 0.16;
	double header_height = layers * pitch + 0.1;
	struct frame base = frame_at(frame, 0, 0, 0.5);
	struct frame part;

	machine_paint(mesh, PAINT_STRUCTURE);
	for (int k = 0; k < 4; k++) {
		double x = (k & 1 ? 0.4 : -0.4) * length;
		double y = (k & 2 ? 0.5 : -0.5) * rows * pitch;

		machine_beam(mesh, frame, at(x, y, 0), at(x, y, 0.55), 0.1);
	}
	machine_paint(mesh, machine_random_medium(random));
	for (int k = -1; k <= 1; k += 2) {
		part = frame_at(&base, 0.5 * k * length, 0, 0);
		solid_block(mesh, &part, 0.14, rows * pitch + 0.1, header_height);
		part = frame_at(&part, 0, 0, header_height - 0.02);
		nozzle(mesh, &part, 0.05, fmin(height - header_height - 0.6, 0.4));
	}
	machine_paint(mesh, PAINT_STEAM);
	for (unsigned j = 0; j < layers; j++) {
		for (unsigned i = 0; i < rows; i++) {
			double y = (i - 0.5 * (rows - 1)) * pitch;
			double z = 0.1 + j * pitch;

			solid_rod(mesh, &base, at(-length / 2, y, z), at(length / 2, y, z), 0.045);
		}
	}
}

void machine_cabinets(struct mesh *mesh, const struct frame *frame, struct random *random,
		      double height)
{
	double tall = fmin(height - 0.3, 2.1);

	for (int k = 0; k < 3; k++) {
		struct frame cabinet = frame_at(frame, 0.6 * (k - 1), 0, 0);
		struct frame front = frame_at(&cabinet, -0.25, -0.33, 0.12 + 0.1 * tall);
		struct frame part;

		machine_paint(mesh, PAINT_CABINET);
		solid_block(mesh, &cabinet, 0.58, 0.6, tall);
		/* The door stands a little in front; its frame lies in x and z. */
		front = (struct frame){ front.x, front.z, at(-front.y.x, -front.y.y, -front.y.z),
					front.origin };
		machine_paint(mesh, PAINT_FRAME);
		part = frame_at(&front, 0.03, 0.02, -0.04);
		if (random_chance(random, 0.6))
			solid_grating(mesh, &part, at(0.44, 0.35, 0.05), 2,
				      3 + (mesh->level > 15 ? 15 : mesh->level));
		else
			solid_box(mesh, &part, at(0, 0, 0), at(0.44, 0.35, 0.05));
		solid_rod(mesh, &front, at(0.44, 0.8, 0.03), at(0.44, 1.0, 0.03), 0.012);
		for (unsigned i = 0; i < 4; i++) {
			machine_paint(mesh, i & 1 ? PAINT_VALVE : PAINT_WATER);
			part = frame_at(&front, 0.08 + 0.1 * i, 0.72 * tall, -0.04);
			solid_cylinder(mesh, &part, 0.02, 0.06);
		}
	}
}

void machine_manifold(struct mesh *mesh, const struct frame *frame, struct random *random,
		      double height)
{
	unsigned count = 3 + random_below(random, 3);
	double radius = random_between(random, 0.04, 0.07);
	double pitch = MACHINE_SLOT / count;
	struct outline pipe;
	struct frame part;

	machine_paint(mesh, machine_random_medium(random));
	part = frame_at(frame, -MACHINE_SLOT / 2, 0, 0.45);
	part = frame_along_x(&part);
	solid_cylinder(mesh, &part, 2 * radius, MACHINE_SLOT);
	machine_flange(mesh, &part, 2 * radius);
	outline_circle(mesh, radius, &pipe);
	for (unsigned i = 0; i < count; i++) {
		double x = (i + 0.5) * pitch - MACHINE_SLOT / 2;
		double turn_height = random_between(random, 1.6, 2.1);
		const struct vec3 path[] = { { x, 0, 0.45 },
					     { x, 0, turn_height },
					     { x, 0.5, turn_height },
					     { x, 0.5, height } };

		solid_sweep(mesh, frame, &pipe, path, 4, 3 * radius);
		part = frame_at(frame, x, 0, 1.1);
		part = (struct frame){ part.z, part.x, part.y, part.origin };
		part = (struct frame){ part.x, at(-part.y.x, -part.y.y, -part.y.z),
				       at(-part.z.x, -part.z.y, -part.z.z), part.origin };
		machine_valve(mesh, &part, radius);
	}
	machine_paint(mesh, PAINT_STRUCTURE);
	for (int k = -1; k <= 1; k += 2) {
		part = frame_at(frame, 0.4 * k * MACHINE_SLOT, 0, 0);
		solid_block(mesh, &part, 0.08, 0.2, 0.4);
	}
}
