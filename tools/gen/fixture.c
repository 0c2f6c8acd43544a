/* SPDX-License-Identifier: MIT */
/* What joins the machines of machine.h: ways for people, pipes, cables, air and light. */
#include <math.h>

#include "tools/gen/machine.h"

#define RAILING_HEIGHT 1.1
/* What goes on in the next bay ends this far before it: two ends in one plane would be twins. */
#define JOINT 0.005

static struct vec3 at(double x, double y, double z)
{
	return (struct vec3){ x, y, z };
}

/* ---- ways ---- */

void machine_railing(struct mesh *mesh, const struct frame *frame, double length)
{
	unsigned post_count = 2 + (unsigned)(length / 1.4);

	machine_paint(mesh, PAINT_RAILING);
	for (unsigned i = 0; i < post_count; i++) {
		double x = 0.02 + (length - 0.04) * i / (post_count - 1);

		solid_rod(mesh, frame, at(x, 0, -MACHINE_SUNK), at(x, 0, RAILING_HEIGHT), 0.021);
	}
	solid_rod(mesh, frame, at(JOINT, 0, RAILING_HEIGHT), at(length - JOINT, 0, RAILING_HEIGHT),
		  0.025);
	solid_rod(mesh, frame, at(JOINT, 0, 0.55), at(length - JOINT, 0, 0.55), 0.018);
}

void machine_stairs(struct mesh *mesh, const struct frame *frame, double length, double height,
		    double width)
{
	unsigned step_count = (unsigned)(height / 0.19);
	double run = length / step_count;
	double rise = height / step_count;
	struct outline stringer;

	outline_rectangle(0.04, 0.28, &stringer);
	for (int side = -1; side <= 1; side += 2) {
		double y = 0.5 * side * width;
		const struct vec3 path[2] = { { -0.05, y, 0.08 }, { length, y, height - 0.02 } };

		machine_paint(mesh, PAINT_STRUCTURE);
		solid_sweep(mesh, frame, &stringer, path, 2, 0);
		machine_paint(mesh, PAINT_RAILING);
		solid_rod(mesh, frame, at(0, y, RAILING_HEIGHT),
			  at(length, y, height + RAILING_HEIGHT), 0.025);
		for (unsigned i = 0; i <= step_count; i += 4)
			solid_rod(mesh, frame, at(i * run, y, i * rise - MACHINE_SUNK),
				  at(i * run, y, i * rise + RAILING_HEIGHT), 0.021);
	}
	machine_paint(mesh, PAINT_GRATING);
	for (unsigned i = 0; i + 1 < step_count; i++) {
		struct frame tread =
			frame_at(frame, i * run, -width / 2 + 0.03, (i + 1) * rise - 0.04);

		if (mesh->level >= 4)
			solid_grating(mesh, &tread, at(run + 0.02, width - 0.06, 0.04), 2,
				      mesh->level < 12 ? mesh->level : 12);
		else
			solid_box(mesh, &tread, at(0, 0, 0), at(run + 0.02, width - 0.06, 0.04));
	}
}

void machine_ladder(struct mesh *mesh, const struct frame *frame, double height)
{
	machine_paint(mesh, PAINT_RAILING);
	for (int side = -1; side <= 1; side += 2)
		solid_rod(mesh, frame, at(0, 0.22 * side, 0), at(0, 0.22 * side, height), 0.02);
	for (double z = 0.25; z < height - 0.05; z += 0.28)
		solid_rod(mesh, frame, at(0, -0.22, z), at(0, 0.22, z), 0.012);
	for (double z = 2.2; z < height; z += 0.9) {
		struct frame hoop = frame_at(frame, 0.35, 0, z);

		solid_torus(mesh, &hoop, 0.36, 0.015);
	}
}

void machine_platform(struct mesh *mesh, const struct frame *frame, double length, double width)
{
	unsigned panel_count = 1 + (unsigned)(length / 2.5);
	double panel = length / panel_count;
	unsigned holes = 3 + 2 * mesh->level > 18 ? 18 : 3 + 2 * mesh->level;

	machine_paint(mesh, PAINT_GRATING);
	for (unsigned i = 0; i < panel_count; i++) {
		struct frame corner = frame_at(frame, i * panel + 0.005, 0, -0.04);

		if (mesh->level > 0)
			solid_grating(mesh, &corner, at(panel - 0.01, width, 0.04), holes, holes);
		else
			solid_box(mesh, &corner, at(0, 0, 0), at(panel - 0.01, width, 0.04));
	}
	machine_paint(mesh, PAINT_STRUCTURE);
	for (int side = 0; side <= 1; side++) {
		double y = side ? width - 0.07 : 0.07;

		machine_beam(mesh, frame, at(2 * JOINT, y, -0.13), at(length - 2 * JOINT, y, -0.13),
			     0.2);
	}
}

/* ---- pipes, cables, air and light ---- */

void machine_tray(struct mesh *mesh, const struct frame *frame, struct random *random,
		  double length, double hanger_height)
{
	const struct vec3 path[2] = { { JOINT, 0, 0 }, { length - JOINT, 0, 0 } };
	double width = random_between(random, 0.25, 0.5);
	unsigned cable_count = 4 + random_below(random, 5);
	struct outline channel;

	machine_paint(mesh, PAINT_TRAY);
	outline_channel(width, 0.1, 0.01, &channel);
	solid_sweep(mesh, frame, &channel, path, 2, 0);
	for (double x = 0.6; x < length; x += 2.2) {
		for (int side = -1; side <= 1; side += 2) {
			double y = side * (width / 2 + 0.015);

			solid_rod(mesh, frame, at(x, y, -0.05),
				  at(x, y, hanger_height + MACHINE_SUNK), 0.008);
		}
		solid_box(mesh, frame, at(x - 0.02, -width / 2 - 0.03, -0.045),
			  at(x + 0.02, width / 2 + 0.03, -0.005));
	}
	machine_paint(mesh, PAINT_CABLE);
	for (unsigned i = 0; i < cable_count; i++) {
		double radius = random_between(random, 0.008, 0.016);
		double y = (width - 0.1) * ((i + 0.5) / cable_count - 0.5);
		double z = 0.012 + radius;
		double sway = random_between(random, 0.2, 0.8) * length;

		/* Cables cross over: two pieces that meet at another height. */
		solid_rod(mesh, frame, at(0.01, y, z), at(sway, -y * 0.5, z + 0.03), radius);
		solid_rod(mesh, frame, at(sway - 0.01, -y * 0.5, z + 0.03), at(length - 0.01, y, z),
			  radius);
	}
}

void machine_pipe_rack(struct mesh *mesh, const struct frame *frame, struct random *random,
		       double length, double hanger_height)
{
	unsigned pipe_count = 3 + random_below(random, 4);
	/* Racks may cross. */
	double first = random_between(random, 0.9, 1.1);
	double y = 0;
	double width;

	for (unsigned i = 0; i < pipe_count; i++) {
		double radius = random_between(random, 0.03, 0.13);
		double flange_at = random_between(random, 0.15, 0.85) * length;
		struct frame pipe = frame_at(frame, 0, y + radius, radius);
		struct frame along;

		machine_paint(mesh, machine_random_medium(random));
		solid_rod(mesh, &pipe, at(0, 0, 0), at(length, 0, 0), radius);
		pipe = frame_at(&pipe, flange_at, 0, 0);
		along = frame_along_x(&pipe);
		if (random_chance(random, 0.4))
			machine_valve(mesh, &pipe, radius);
		else
			machine_flange(mesh, &along, radius);
		y += 2 * radius + random_between(random, 0.08, 0.16);
	}
	width = y;
	machine_paint(mesh, PAINT_STRUCTURE);
	for (double x = first; x < length; x += 3) {
		machine_beam(mesh, frame, at(x, -0.15, -0.06), at(x, width + 0.05, -0.06), 0.12);
		for (int side = 0; side <= 1; side++) {
			double hanger_y = side ? width : -0.1;

			solid_rod(mesh, frame, at(x, hanger_y, -0.05),
				  at(x, hanger_y, hanger_height + MACHINE_SUNK), 0.02);
		}
	}
}

void machine_duct(struct mesh *mesh, const struct frame *frame, double length, double width)
{
	const struct vec3 path[2] = { { JOINT, 0, 0 }, { length - JOINT, 0, 0 } };
	struct outline outline;

	machine_paint(mesh, PAINT_DUCT);
	outline_rectangle(width, 0.6 * width, &outline);
	solid_sweep(mesh, frame, &outline, path, 2, 0);
	outline_rectangle(width + 0.06, 0.6 * width + 0.06, &outline);
	for (double x = 0.8; x < length; x += 1.6) {
		const struct vec3 joint[2] = { { x, 0, 0 }, { x + 0.03, 0, 0 } };
		struct frame outlet = frame_at(frame, x + 0.5, -0.15, -0.3 * width - 0.08);

		solid_sweep(mesh, frame, &outline, joint, 2, 0);
		if (x + 1.2 < length && mesh->level > 0)
			solid_grating(mesh, &outlet, at(0.4, 0.3, 0.09), 2,
				      2 + (mesh->level > 10 ? 10 : mesh->level));
	}
}

void machine_lamp(struct mesh *mesh, const struct frame *frame)
{
	struct frame body = frame_at(frame, 0, 0, -0.45);

	machine_paint(mesh, PAINT_FRAME);
	for (int side = -1; side <= 1; side += 2)
		solid_rod(mesh, frame, at(0.5 * side, 0, -0.4), at(0.5 * side, 0, MACHINE_SUNK),
			  0.006);
	solid_block(mesh, &body, 1.25, 0.2, 0.06);
	machine_paint(mesh, PAINT_LAMP);
	for (int side = -1; side <= 1; side += 2)
		solid_rod(mesh, &body, at(-0.58, 0.05 * side, -0.02), at(0.58, 0.05 * side, -0.02),
			  0.014);
}

/* ---- big things ---- */

void machine_storage(struct mesh *mesh, const struct frame *frame, double radius, double height)
{
	unsigned steps = 2 + mesh->level / 2 > 40 ? 40 : 2 + mesh->level / 2;
	unsigned post_count = 12 + 2 * mesh->level > 80 ? 80 : 12 + 2 * mesh->level;
	struct lathe_point points[LATHE_POINTS_MAX];
	unsigned count = 0;
	struct frame part;

	points[count++] = (struct lathe_point){ radius, 0 };
	for (unsigned k = 1; k <= 4; k++) {
		points[count++] = (struct lathe_point){ radius, height * k / 4 - 0.15 };
		points[count++] = (struct lathe_point){ radius + 0.08, height * k / 4 - 0.12 };
		points[count++] = (struct lathe_point){ radius + 0.08, height * k / 4 - 0.05 };
		points[count++] = (struct lathe_point){ radius, height * k / 4 };
	}
	for (unsigned k = 1; k <= steps; k++) {
		struct turn turn = mesh_circle(mesh, 4 * steps)[k];

		points[count++] = (struct lathe_point){ k == steps ? 0 : radius * turn.cosine,
							height + 0.25 * radius * turn.sine };
	}
	machine_paint(mesh, PAINT_VESSEL);
	solid_lathe(mesh, frame, points, count, mesh_segments(mesh, radius));
	part = frame_at(frame, radius + 0.15, 0, 0);
	machine_ladder(mesh, &part, height);
	part = frame_at(frame, 0, 0, height + RAILING_HEIGHT);
	machine_paint(mesh, PAINT_RAILING);
	solid_torus(mesh, &part, radius - 0.1, 0.03);
	for (unsigned k = 0; k < post_count; k++) {
		struct turn turn = mesh_circle(mesh, post_count)[k];
		double x = (radius - 0.1) * turn.cosine;
		double y = (radius - 0.1) * turn.sine;

		solid_rod(mesh, frame, at(x, y, height - 0.05), at(x, y, height + RAILING_HEIGHT),
			  0.025);
	}
}

void machine_stack(struct mesh *mesh, const struct frame *frame, double radius, double height)
{
	struct lathe_point points[LATHE_POINTS_MAX];
	unsigned ring_count = 4 + mesh->level > 24 ? 24 : 4 + mesh->level;
	unsigned count = 0;
	struct frame part = frame_at(frame, radius + 0.1, 0, 0);

	for (unsigned k = 0; k <= ring_count; k++)
		points[count++] = (struct lathe_point){ radius * (1 - 0.35 * k / ring_count),
							height * k / ring_count };
	/* The flue is open: down inside, to a floor. */
	points[count++] = (struct lathe_point){ 0.55 * radius, height };
	points[count++] = (struct lathe_point){ 0.55 * radius, 0.5 * height };
	points[count++] = (struct lathe_point){ 0, 0.5 * height };
	machine_paint(mesh, PAINT_STACK);
	solid_lathe(mesh, frame, points, count, mesh_segments(mesh, radius));
	machine_ladder(mesh, &part, 0.3 * height);
	machine_paint(mesh, PAINT_VALVE);
	for (unsigned k = 1; k <= 2; k++) {
		double up = 1 - 0.1 * k;

		part = frame_at(frame, 0, 0, up * height);
		solid_torus(mesh, &part, radius * (1 - 0.35 * up) + 0.05, 0.15);
	}
}

/* One casing of a turbine along x: wide in the middle, with flanges at its ends. */
static void casing(struct mesh *mesh, const struct frame *frame, double radius, double length)
{
	struct lathe_point points[LATHE_POINTS_MAX];
	struct frame along = frame_along_x(frame);
	unsigned steps = 4 + mesh->level > 60 ? 60 : 4 + mesh->level;
	unsigned count = 0;

	points[count++] = (struct lathe_point){ 0.75 * radius, 0 };
	points[count++] = (struct lathe_point){ 0.75 * radius, 0.05 * length };
	for (unsigned k = 0; k <= steps; k++) {
		double s = mesh_circle(mesh, 2 * steps)[k].sine;

		points[count++] = (struct lathe_point){ radius * (0.6 + 0.4 * s),
							length * (0.06 + 0.88 * k / steps) };
	}
	points[count++] = (struct lathe_point){ 0.75 * radius, 0.95 * length };
	points[count++] = (struct lathe_point){ 0.75 * radius, length };
	solid_lathe(mesh, &along, points, count, mesh_segments(mesh, radius));
}

void machine_turbine(struct mesh *mesh, const struct frame *frame, struct random *random)
{
	static const double lengths[] = { 2.2, 2.8, 3.6 };
	static const double radii[] = { 0.9, 1.2, 1.7 };
	const double axis = 2.4;
	double x = -7;
	struct outline pipe;
	struct frame part;

	machine_paint(mesh, PAINT_CONCRETE);
	solid_block(mesh, frame, 14.4, 4.4, 0.9);
	outline_circle(mesh, 0.28, &pipe);
	for (int k = 0; k < 3; k++) {
		double middle = x + lengths[k] / 2;
		double y = random_between(random, 2.4, 2.8);
		const struct vec3 path[] = { { middle, 0, axis + 0.8 * radii[k] },
					     { middle, 0, axis + radii[k] + 0.9 },
					     { middle, y, axis + radii[k] + 0.9 },
					     { middle, y, 0.2 } };

		machine_paint(mesh, PAINT_VESSEL);
		part = frame_at(frame, x, 0, axis);
		casing(mesh, &part, radii[k], lengths[k]);
		machine_paint(mesh, PAINT_STEAM);
		solid_sweep(mesh, frame, &pipe, path, 4, 0.6);
		machine_paint(mesh, PAINT_STRUCTURE);
		x += lengths[k];
		part = frame_at(frame, x + 0.2, 0, 0.85);
		solid_block(mesh, &part, 0.5, 2.2, axis - 0.6);
		x += 0.4;
	}
	machine_paint(mesh, PAINT_BOLT);
	solid_rod(mesh, frame, at(-7.2, 0, axis), at(6.8, 0, axis), 0.22);
	machine_paint(mesh, PAINT_MOTOR);
	part = frame_at(frame, x + 0.3, 0, axis);
	casing(mesh, &part, 1.5, 6.6 - x);
	part = frame_at(frame, 0.5 * (x + 6.9), 0, 0.85);
	solid_block(mesh, &part, 3, 2.6, 0.8);
	part = frame_at(frame, -7.2, 2.6, 0);
	machine_railing(mesh, &part, 14.4);
}
