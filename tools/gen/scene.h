/* SPDX-License-Identifier: MIT */
/**
 * scene.h - small scenes, each of which walks into the weak spot of some method.
 */
#ifndef TOOLS_GEN_SCENE_H
#define TOOLS_GEN_SCENE_H

#include "tools/gen/mesh.h"

#define SCENE_TRIANGLES_MIN UINT64_C(100)

struct scene;

struct scene_kind {
	const char *name;
	const char *summary;
	void (*make)(struct mesh *mesh, const struct scene *scene, struct random *random);
};

struct scene {
	const struct scene_kind *kind;
	uint64_t triangle_count; /* at least SCENE_TRIANGLES_MIN */
	uint64_t seed;
};

/** All kinds; the last one has no name. */
extern const struct scene_kind scene_kinds[];

/** Returns: the kind of that name, or NULL. */
const struct scene_kind *scene_find(const char *name);

/**
 * A mesh_scene_fn.  Makes exactly the wanted triangles; the sphere the most that a grid of its
 * fineness can have, fewer than N by less than 2 sqrt(N).
 *
 * arg: a struct scene
 */
void scene_make(struct mesh *mesh, void *arg);

#endif /* TOOLS_GEN_SCENE_H */
