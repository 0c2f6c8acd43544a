/* SPDX-License-Identifier: MIT */
/**
 * world.h - the stores that are looked at, as one world.
 *
 * The world's coordinates are model units of the first store.  Stores whose file says how long its
 * unit is are scaled to that; the others are taken to use the same unit.
 *
 * The module knows which nodes a camera wants; it draws nothing (frame.h).
 *
 * Threads: the thread of its client.
 */
#ifndef VIEWER_WORLD_H
#define VIEWER_WORLD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "libclient/ooc/client.h"
#include "libclient/select/camera.h"
#include "libclient/select/select.h"

#define WORLD_STORE_COUNT_MAX 64u

struct world_store {
	char *path;
	struct ooc_store *store;
	const struct store_superblock *superblock;
	const struct store_node *nodes;
	struct selector *selector;
	double scale;            /* world units a unit of the store */
	uint32_t first_seen;     /* number of its node 0 among the nodes of all stores */
	bool is_lost;            /* has been said */
	struct camera_view view; /* of the newest world_look() */
};

enum world_mode {
	WORLD_MODE_FULL,         /* all that is in the frustum */
	WORLD_MODE_APPROXIMATE,  /* what most likely shows, up to a budget of triangles */
	WORLD_MODE_CONSERVATIVE, /* what shows; found while it is drawn (frame.h) */
};

/** Which nodes a camera is to want. */
struct world_choice {
	enum world_mode mode;
	/* WORLD_MODE_APPROXIMATE: */
	enum select_order order;
	uint64_t budget_triangles; /* over all stores; 0: no limit */
};

/** A wanted node. */
struct world_want {
	uint32_t store; /* index into world.stores */
	uint32_t node;
	float importance;
};

struct world {
	struct ooc_client *client;
	struct world_store stores[WORLD_STORE_COUNT_MAX];
	uint32_t store_count;

	/* Of the newest world_look(), most important first. */
	struct world_want *wants;
	size_t want_count;
	uint64_t want_triangles;
	uint64_t nodes_visited; /* to find them, by world_look() */
	bool fits_budget;       /* all of the world does: nothing had to be chosen */

	size_t want_room;
	struct ooc_want *ooc_wants; /* as many as wants: scratch of world_ask() */
};

/**
 * Connects and opens all stores.
 *
 * socket_path:     NULL: the usual places.
 * daemon_options:  for a daemon that has to be started, as ooc_connect_or_start() takes them.
 *
 * Returns: 0, or a negative errno with the store and the reason.
 * Ownership: ended with world_done(), which accepts one that is all zero.
 */
int world_init(struct world *ret, const char *socket_path, const char *const *daemon_options,
	       char *const *paths, uint32_t path_count, struct why *why);
void world_done(struct world *world);

/** The whole world, well framed. */
void world_frame_all(const struct world *world, double aspect, double fov_y_degrees,
		     struct camera *ret);

/** Up of the first store that knows, else +Z: a unit vector. */
void world_up(const struct world *world, double ret[3]);

/** The box of all stores in the world.  Returns: false when there is nothing in it. */
bool world_box(const struct world *world, double ret_min[3], double ret_max[3]);

/**
 * The views of all stores, store_count of them, with one near plane.
 *
 * Returns: 0, or -EINVAL when the camera has no direction.
 * Threads: any: it reads what never changes.
 */
int world_views(const struct world *world, const struct camera *camera, double aspect,
		struct camera_view *ret);

/** Points the camera: makes each store's view.  Returns: 0, or -EINVAL when it has no direction. */
int world_point(struct world *world, const struct camera *camera, double aspect, struct why *why);

/**
 * Points the camera and makes the list of wanted nodes.  A world that has no more triangles than the
 * budget is not chosen from: all that is in the frustum is wanted.
 *
 * choice:  not of WORLD_MODE_CONSERVATIVE.
 *
 * Returns: 0, -EINVAL when the camera has no direction, or -ENOMEM.
 */
int world_look(struct world *world, const struct camera *camera, double aspect,
	       const struct world_choice *choice, struct why *why);

/** Makes the list by hand: empties it, adds to its end, and sorts it by importance. */
void world_want_none(struct world *world);
int world_want(struct world *world, const struct world_want *want);
void world_want_sort(struct world *world);

/** Asks the daemon for `count` wants from wants[first] on.  Returns: 0 or -errno with the reason. */
int world_ask(struct world *world, size_t first, size_t count, struct why *why);

/**
 * Takes what the daemon has sent, and warns, once each, of stores that it serves no longer.  A daemon
 * that is away is tried again with the next call.
 */
void world_dispatch(struct world *world);

/** Distance of the near plane in the world, of the newest world_look(). */
double world_near(const struct world *world);

#endif /* VIEWER_WORLD_H */
