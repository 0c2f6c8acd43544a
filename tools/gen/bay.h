/* SPDX-License-Identifier: MIT */
/**
 * bay.h - the cells of a plant: rooms and corridors on their floors, the roof, the turbine hall,
 * the yard.
 *
 * A cell makes its own floor, the walls on its west and south side, and what stands between them;
 * the last ones in a row make the east and north walls too.  Walls end inside columns and reach
 * a little into the slabs above and below, so that no two faces lie in one plane.
 */
#ifndef TOOLS_GEN_BAY_H
#define TOOLS_GEN_BAY_H

#include "tools/gen/machine.h"
#include "tools/gen/plant.h"

/** From floor to floor. */
#define BAY_FLOOR_HEIGHT 4.5
#define BAY_SLAB         0.3

/** Every third row of bays is a corridor. */
static inline bool bay_is_corridor(unsigned row)
{
	return row % 3 == 1;
}

/** The chance that a machine stands where it could; the smallest plants have fewer. */
static inline bool bay_furnished(const struct plant *plant, struct random *random,
				 double probability)
{
	return random_chance(random, probability * plant->furnishing);
}

uint64_t bay_cell_count(const struct plant *plant);

/** Makes a cell at the mesh's level. */
void bay_make(struct mesh *mesh, const struct plant *plant, uint64_t cell);

void bay_paint_coal(struct mesh *mesh);

/* ---- the parts that a bay is made of; bay_wall.c, bay_room.c ---- */

/** A bay of a floor. */
struct bay {
	const struct plant *plant;
	unsigned floor; /* floor_count: the roof */
	unsigned row;
	unsigned column;
	struct frame frame; /* its south-west corner, on the floor; x east, y north */
	double width;       /* along x, between the column lines */
	double depth;       /* along y */
	double height;      /* free, up to the slab above */
};

/** What a bay has to do with the floor above it. */
enum bay_shaft {
	BAY_SHAFT_NONE,
	BAY_SHAFT_STAIRS,
	BAY_SHAFT_VESSEL, /* too high for one floor */
};

enum bay_shaft bay_shaft(const struct bay *bay);

/** The hole that a bay's shaft makes in the slab above it, in the bay's x and y. */
struct opening bay_shaft_opening(const struct bay *bay);

/** The walls, with doors and windows. */
void bay_walls(struct mesh *mesh, const struct bay *bay);

/** One wall in the frame's x and y (up), with random openings. */
enum wall_kind {
	WALL_OUTER,
	WALL_OUTER_GROUND, /* may have doors */
	WALL_CORRIDOR,
	WALL_ROOM,
	WALL_HALL,
};

void bay_wall(struct mesh *mesh, const struct frame *frame, struct random *random,
	      enum wall_kind kind, double length, double height);

/** What stands and hangs in a room or a corridor. */
void bay_room(struct mesh *mesh, const struct bay *bay);
void bay_corridor(struct mesh *mesh, const struct bay *bay);

/** Stairs, or a high vessel, with railings around the hole above. */
void bay_shaft_contents(struct mesh *mesh, const struct bay *bay, struct random *random);

#endif /* TOOLS_GEN_BAY_H */
