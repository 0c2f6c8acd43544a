/* SPDX-License-Identifier: MIT */
/**
 * solid.h - the closed solids that everything is made of: boxes, plates with openings, turned
 * bodies, and outlines swept along a path.
 *
 * Sizes are metres in the axes of a frame.  How round is round follows the mesh's level; at level
 * 0 rods and rings thinner than SOLID_THIN_RADIUS are left out, so that small scenes are possible.
 */
#ifndef TOOLS_GEN_SOLID_H
#define TOOLS_GEN_SOLID_H

#include "tools/gen/mesh.h"

#define SOLID_THIN_RADIUS 0.03

/** A box from low to high in the frame's axes; low < high in each. */
void solid_box(struct mesh *mesh, const struct frame *frame, struct vec3 low, struct vec3 high);

/** A box that stands on the frame's origin, centred in x and y. */
void solid_block(struct mesh *mesh, const struct frame *frame, double x, double y, double height);

/** A point of a turned body: its distance from the axis and its place on it. */
struct lathe_point {
	double radius;
	double height;
};

#define LATHE_POINTS_MAX 160u

/**
 * A body turned about the frame's z axis.
 *
 * points: from bottom to top; a radius of 0 is allowed at the two ends; neighbours differ
 */
void solid_lathe(struct mesh *mesh, const struct frame *frame, const struct lathe_point *points,
		 unsigned point_count, unsigned segments);

/** A cylinder along z, from 0 to height. */
void solid_cylinder(struct mesh *mesh, const struct frame *frame, double radius, double height);

/** A hexagonal bolt head or nut along z. */
void solid_bolt(struct mesh *mesh, const struct frame *frame, double radius, double height);

/** A ring about z: a handwheel, the hoop of a ladder. */
void solid_torus(struct mesh *mesh, const struct frame *frame, double radius, double tube_radius);

/** A closed outline without holes, counterclockwise, with the triangles that fill it. */
#define OUTLINE_POINTS_MAX MESH_CIRCLE_MAX

struct outline_point {
	double x;
	double y;
};

struct outline {
	unsigned point_count;
	struct outline_point points[OUTLINE_POINTS_MAX];
	const uint8_t (*cap)[3]; /* point_count - 2 triangles; NULL: a fan from point 0 */
};

void outline_circle(const struct mesh *mesh, double radius, struct outline *ret);
void outline_rectangle(double width, double height, struct outline *ret);
/** An I-profile: flanges above and below a web. */
void outline_beam(double width, double height, double thickness, struct outline *ret);
/** A channel that is open above, its bottom at y = 0: a cable tray. */
void outline_channel(double width, double height, double thickness, struct outline *ret);

/**
 * An outline swept along a path that is straight or turns at right angles; the outline's y points
 * up where the path is not vertical.
 *
 * bend_radius: of the path at its turns; made smaller where two turns are near; > 0 with turns
 */
void solid_sweep(struct mesh *mesh, const struct frame *frame, const struct outline *outline,
		 const struct vec3 *path, unsigned point_count, double bend_radius);

/** A round bar between two points. */
void solid_rod(struct mesh *mesh, const struct frame *frame, struct vec3 from, struct vec3 to,
	       double radius);

/** An opening in a plate, in the plate's x and y. */
struct opening {
	double low_x;
	double low_y;
	double high_x;
	double high_y;
};

#define PLATE_OPENINGS_MAX 12u

/** A plate in the frame's x and y, from 0 to width and height, and from 0 to thickness in z. */
struct plate {
	double width;
	double height;
	double thickness;
	unsigned opening_count;
	struct opening
		openings[PLATE_OPENINGS_MAX]; /* do not touch each other; may touch the rim */
};

void solid_plate(struct mesh *mesh, const struct frame *frame, const struct plate *plate);

/** A plate full of holes: columns x rows of them. */
void solid_grating(struct mesh *mesh, const struct frame *frame, struct vec3 size, unsigned columns,
		   unsigned rows);

#endif /* TOOLS_GEN_SOLID_H */
