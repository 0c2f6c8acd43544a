/* SPDX-License-Identifier: MIT */
/**
 * look_ahead.h - asks the daemon for what a camera will want soon, before it does.
 *
 * A thread predicts cameras (select/motion.h), or reads them from a path that is known, chooses
 * nodes for each, nearest in time first, and hands the list over.  Whoever owns the client sends of
 * it what is not in memory, within a budget, when it has sent its own set: the thread itself never
 * touches the client.
 *
 *	owner    look_ahead_see(camera) ----> look_ahead_send(): what the newest list still lacks
 *	              |                              ^
 *	thread        +--> predict, choose, merge ---+
 *
 * It refuses to hold anything, to delay the owner (a list that is not ready is sent next time), and to
 * say what is worth fetching: the choice of nodes is the caller's function.
 *
 * Threads: the owner's, but for the choose function, which runs on the look-ahead's own.
 * Source: look-ahead of Correa, Klosowski & Silva, "iWalk", 2002, sec. 4.
 */
#ifndef LIBCLIENT_LOOK_AHEAD_H
#define LIBCLIENT_LOOK_AHEAD_H

#include <stddef.h>
#include <stdint.h>

#include "libclient/ooc/client.h"
#include "libclient/select/camera.h"

struct look_ahead;

/** Nodes that are chosen at one time at most: what one request may name. */
#define LOOK_AHEAD_WANT_COUNT_MAX 5459u

/**
 * Chooses the nodes of a camera, most important first; their importances do not matter.
 *
 * ret:  room for LOOK_AHEAD_WANT_COUNT_MAX.
 *
 * Returns: how many.  Threads: the look-ahead's; it must read nothing that the owner changes.
 */
typedef size_t (*look_ahead_choose_fn)(void *arg, const struct camera *camera,
				       struct ooc_want *ret);

struct look_ahead_config {
	look_ahead_choose_fn choose;
	void *choose_arg;
	double horizon_s; /* how far it looks, > 0 */
	/* Of a path that is followed exactly, by time; NULL: the camera is predicted. */
	const struct camera *path;
	size_t path_count;
};

/**
 * Starts it.
 *
 * Returns: 0, -ENOMEM or -errno.
 * Ownership: ends with look_ahead_destroy(), before any store that it was given nodes of is closed.
 */
int look_ahead_create(const struct look_ahead_config *config, struct look_ahead **ret);
/** Waits for its thread.  NULL is allowed.  Returns: NULL. */
struct look_ahead *look_ahead_destroy(struct look_ahead *look_ahead);

/** Shows it the camera of a frame.  Does not wait. */
void look_ahead_see(struct look_ahead *look_ahead, const struct camera *camera);

/** What one frame may ask for. */
struct look_ahead_budget {
	uint64_t bytes;
	uint32_t requests; /* nodes */
};

/** What was asked for. */
struct look_ahead_report {
	uint32_t requests;
	uint64_t bytes;
	const struct ooc_want *wants; /* they; the look-ahead's, until the next report */
	double reach_s; /* how far ahead everything is there or asked for; 0: not known */
};

/**
 * Sends what of the newest list is neither in memory nor on its way, nearest in time first.  The list
 * replaces the one sent before, so that what is no longer expected is no longer fetched.
 *
 * Returns: 0, or what ooc_prefetch() returned; -EAGAIN and -ENOTCONN pass by themselves.
 */
int look_ahead_send(struct look_ahead *look_ahead, struct ooc_client *client,
		    const struct look_ahead_budget *budget, struct look_ahead_report *ret);

/**
 * What is expected to be wanted, nearest in time first, for looking at it.
 *
 * ret:  room for LOOK_AHEAD_WANT_COUNT_MAX.
 *
 * Returns: how many.
 */
size_t look_ahead_expected(struct look_ahead *look_ahead, struct ooc_want *ret);

#endif /* LIBCLIENT_LOOK_AHEAD_H */
