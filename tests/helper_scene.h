/* SPDX-License-Identifier: MIT */
/**
 * helper_scene.h - small models in memory as selection sees them: HS records and payloads, without a file.
 *
 * Include it after <cmocka.h>.
 */
#ifndef TESTS_HELPER_SCENE_H
#define TESTS_HELPER_SCENE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "formats/store/layout.h"
#include "libclient/select/raster.h"

/** Positions are multiples of it. */
#define SCENE_STEP 0x1p-10

/** Triangles to come, model units. */
struct scene_model {
	double (*triangles)[3][3];
	uint32_t count;
	uint32_t room;
};

void scene_triangle(struct scene_model *model, const double a[3], const double b[3],
		    const double c[3]);

/** A parallelogram from `corner` along two edges, in across x along squares of two triangles. */
void scene_plate(struct scene_model *model, const double corner[3], const double across_edge[3],
		 const double along_edge[3], uint32_t across, uint32_t along);

/** The six faces of a box, each side x side squares. */
void scene_box(struct scene_model *model, const double box_min[3], const double box_max[3],
	       uint32_t side);

struct scene {
	struct store_superblock superblock;
	struct store_node *nodes;
	void **payloads; /* a node; NULL: nothing to draw */
};

/**
 * Divides a model into an octree whose leaves have at most leaf_triangles (or the least size).
 *
 * layout:  STORE_LAYOUT_UNIQUE: a triangle is in the leaf of its middle; STORE_LAYOUT_REPLICATE: in
 *	each whose cell its box touches.
 *
 * Takes the model's triangles.  Ownership: ends with scene_done().
 */
void scene_make(struct scene *scene, struct scene_model *model, const double origin[3],
		uint32_t leaf_triangles, enum store_layout layout);
void scene_done(struct scene *scene);

/** Draws all nodes, or those marked; an item is a node's number. */
void scene_draw(const struct scene *scene, const struct camera_view *view, const bool *marks,
		struct raster *raster);

#endif /* TESTS_HELPER_SCENE_H */
