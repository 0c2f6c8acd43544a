/* SPDX-License-Identifier: MIT */
/**
 * plant.h - a procedural power plant of any size.
 *
 * A plan says where the walls stand; the plant is then made cell by cell (a bay of a floor, of the
 * turbine hall, of the yard), each from a random stream of its own, so that nothing has to be kept.
 * With the wanted count grow first the number of rooms and then the fineness of everything round.
 */
#ifndef TOOLS_GEN_PLANT_H
#define TOOLS_GEN_PLANT_H

#include "tools/gen/mesh.h"

#define PLANT_TRIANGLES_MIN UINT64_C(10000)

#define PLANT_COLUMNS_MAX 512u
#define PLANT_LINES_MAX   512u

struct plant {
	uint64_t seed;
	uint64_t triangle_count; /* as asked, made even */
	unsigned floor_count;
	unsigned column_count; /* bays along x */
	unsigned row_count;    /* bays along y: room, corridor, room, and so on */
	double x[PLANT_COLUMNS_MAX + 1];
	double y[PLANT_LINES_MAX + 1];
	double hall_height;
	double furnishing;    /* share of the machines that stand, 1 but in the smallest plants */
	unsigned level;       /* of the coarser cells; the others have the next */
	uint64_t spare_count; /* triangles to be had by making cells finer */
};

/**
 * Plans a plant.
 *
 * triangle_count: at least PLANT_TRIANGLES_MIN
 */
void plant_init(struct plant *plant, uint64_t triangle_count, uint64_t seed);

/**
 * A mesh_scene_fn.  Makes exactly plant->triangle_count triangles: what the cells leave over lies
 * on the coal heap.  Solids are closed and so have an even number of triangles each; an odd wish
 * is met but for one.
 *
 * arg: a struct plant
 */
void plant_scene(struct mesh *mesh, void *arg);

#endif /* TOOLS_GEN_PLANT_H */
