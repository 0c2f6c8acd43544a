/* SPDX-License-Identifier: MIT */
/**
 * scene.h - the stores that are looked at, as one world.
 *
 * The world's coordinates are model units of the first store.  Stores whose file says how long its
 * unit is are scaled to that; the others are taken to use the same unit.
 *
 * The scene knows which nodes a camera wants; it draws nothing (frame.h).
 *
 * Threads: the thread of its client.
 */
#ifndef VIEWER_SCENE_H
#define VIEWER_SCENE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "libclient/ooc/client.h"
#include "libclient/select/camera.h"
#include "libclient/select/select.h"

#define SCENE_STORE_COUNT_MAX 64u

struct scene_store {
	char *path;
	struct ooc_store *store;
	const struct store_superblock *superblock;
	const struct store_node *nodes;
	struct selector *selector;
	double scale;            /* world units a unit of the store */
	bool is_lost;            /* has been said */
	struct camera_view view; /* of the newest scene_look() */
};

enum scene_mode {
	SCENE_MODE_FULL,        /* all that is in the frustum */
	SCENE_MODE_APPROXIMATE, /* what most likely shows, up to a budget of triangles */
};

/** A wanted node. */
struct scene_want {
	uint32_t store; /* index into scene.stores */
	uint32_t node;
	float importance;
};

struct scene {
	struct ooc_client *client;
	struct scene_store stores[SCENE_STORE_COUNT_MAX];
	uint32_t store_count;

	/* Of the newest scene_look(), most important first. */
	struct scene_want *wants;
	size_t want_count;
	uint64_t want_triangles;

	size_t want_room;
	struct ooc_want *ooc_wants; /* as many as wants: scratch of scene_ask() */
};

/**
 * Connects and opens all stores.
 *
 * socket_path:  NULL: the usual places.
 *
 * Returns: 0, or a negative errno with the store and the reason.
 * Ownership: ended with scene_done(), which accepts one that is all zero.
 */
int scene_init(struct scene *ret, const char *socket_path, char *const *paths, uint32_t path_count,
	       struct why *why);
void scene_done(struct scene *scene);

/** The whole world, well framed. */
void scene_frame_all(const struct scene *scene, double aspect, double fov_y_degrees,
		     struct camera *ret);

/** Up of the first store that knows, else +Z: a unit vector. */
void scene_up(const struct scene *scene, double ret[3]);

/** The box of all stores in the world.  Returns: false when there is nothing in it. */
bool scene_box(const struct scene *scene, double ret_min[3], double ret_max[3]);

/**
 * Points the camera: makes each store's view and the list of wanted nodes.
 *
 * budget_triangles:  for SCENE_MODE_APPROXIMATE; over all stores.
 *
 * Returns: 0, -EINVAL when the camera has no direction, or -ENOMEM.
 */
int scene_look(struct scene *scene, const struct camera *camera, double aspect,
	       enum scene_mode mode, uint64_t budget_triangles, struct why *why);

/** Asks the daemon for `count` wants from wants[first] on.  Returns: 0 or -errno with the reason. */
int scene_ask(struct scene *scene, size_t first, size_t count, struct why *why);

/**
 * Takes what the daemon has sent, and warns, once each, of stores that it serves no longer.  A daemon
 * that is away is tried again with the next call.
 */
void scene_dispatch(struct scene *scene);

/** Distance of the near plane in the world, of the newest scene_look(). */
double scene_near(const struct scene *scene);

#endif /* VIEWER_SCENE_H */
