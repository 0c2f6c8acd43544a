/* SPDX-License-Identifier: MIT */
/**
 * machine.h - what stands, lies and hangs in a power plant.
 *
 * Things stand on the origin of their frame, z up, and are about as wide as MACHINE_SLOT unless
 * they say otherwise.  Where they stand never depends on the mesh's level, only how finely they are
 * made; at level 0 small parts are left out.
 */
#ifndef TOOLS_GEN_MACHINE_H
#define TOOLS_GEN_MACHINE_H

#include "tools/gen/solid.h"

/** Faces never lie in one plane: what stands on another thing begins this far inside it. */
#define MACHINE_SUNK 0.01

/** Metres of floor that a machine may fill in x and y. */
#define MACHINE_SLOT 1.8

/** What a thing belongs to; each has its colour. */
enum paint {
	PAINT_CONCRETE,
	PAINT_WALL,
	PAINT_OUTER_WALL,
	PAINT_FRAME, /* of doors and windows */
	PAINT_STRUCTURE,
	PAINT_GRATING,
	PAINT_RAILING,
	PAINT_WATER,
	PAINT_STEAM,
	PAINT_OIL,
	PAINT_GAS,
	PAINT_VESSEL,
	PAINT_PUMP,
	PAINT_MOTOR,
	PAINT_VALVE,
	PAINT_BOLT,
	PAINT_TRAY,
	PAINT_CABLE,
	PAINT_CABINET,
	PAINT_LAMP,
	PAINT_DUCT,
	PAINT_STACK,
	PAINT_GROUND,
	PAINT_COAL,
	PAINT_COUNT_
};

void machine_paint(struct mesh *mesh, enum paint paint);
/** Of pipes: water, steam, oil or gas. */
enum paint machine_random_medium(struct random *random);

/** A machine for the floor of a room; height: where its pipes end, in the slab above or a rack. */
typedef void (*machine_fn)(struct mesh *mesh, const struct frame *frame, struct random *random,
			   double height);

void machine_tank(struct mesh *mesh, const struct frame *frame, struct random *random,
		  double height);
void machine_drum(struct mesh *mesh, const struct frame *frame, struct random *random,
		  double height);
void machine_pump(struct mesh *mesh, const struct frame *frame, struct random *random,
		  double height);
void machine_exchanger(struct mesh *mesh, const struct frame *frame, struct random *random,
		       double height);
void machine_cabinets(struct mesh *mesh, const struct frame *frame, struct random *random,
		      double height);
void machine_manifold(struct mesh *mesh, const struct frame *frame, struct random *random,
		      double height);

/** A turbine set along x, 14 m long. */
void machine_turbine(struct mesh *mesh, const struct frame *frame, struct random *random);

/** A tank outside: radius, height to the edge of its dome. */
void machine_storage(struct mesh *mesh, const struct frame *frame, double radius, double height);

/** A chimney. */
void machine_stack(struct mesh *mesh, const struct frame *frame, double radius, double height);

/** A pipe flange about z, centred on the origin, with its bolts. */
void machine_flange(struct mesh *mesh, const struct frame *frame, double pipe_radius);

/** A valve on a pipe along x, its wheel on the side of z. */
void machine_valve(struct mesh *mesh, const struct frame *frame, double pipe_radius);

/** Stairs along x that rise to a height over a length, with railings. */
void machine_stairs(struct mesh *mesh, const struct frame *frame, double length, double height,
		    double width);

/** A ladder in the plane of y and z, with hoops on the side of x where it is high. */
void machine_ladder(struct mesh *mesh, const struct frame *frame, double height);

/** A railing along x. */
void machine_railing(struct mesh *mesh, const struct frame *frame, double length);

/** A floor of gratings along x and y, its top at z = 0, on beams. */
void machine_platform(struct mesh *mesh, const struct frame *frame, double length, double width);

/** A cable tray along x with its cables; hangers go up by hanger_height. */
void machine_tray(struct mesh *mesh, const struct frame *frame, struct random *random,
		  double length, double hanger_height);

/** Pipes side by side along x, over supports that hang from hanger_height above. */
void machine_pipe_rack(struct mesh *mesh, const struct frame *frame, struct random *random,
		       double length, double hanger_height);

/** An air duct along x with outlets. */
void machine_duct(struct mesh *mesh, const struct frame *frame, double length, double width);

/** A lamp along x, hanging from its frame's origin. */
void machine_lamp(struct mesh *mesh, const struct frame *frame);

/** A steel beam between two points; horizontal, or a column. */
void machine_beam(struct mesh *mesh, const struct frame *frame, struct vec3 from, struct vec3 to,
		  double height);

#endif /* TOOLS_GEN_MACHINE_H */
