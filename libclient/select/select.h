/* SPDX-License-Identifier: MIT */
/**
 * select.h - which nodes a camera wants, from the HS alone.
 *
 * Pure functions of HS and camera: they read no geometry, no disk and no clock, and the same
 * arguments give the same list, in the same order, on every machine.
 *
 * Threads: a struct selector belongs to one thread; any number may share one HS.
 */
#ifndef LIBCLIENT_SELECT_SELECT_H
#define LIBCLIENT_SELECT_SELECT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "formats/store/layout.h"
#include "libclient/select/camera.h"

struct selector;

/** A selected node; most important first. */
struct selection_entry {
	uint32_t node;
	float importance;
};

struct selection {
	const struct selection_entry *entries; /* the selector's, until its next call */
	size_t entry_count;
	uint64_t triangle_count;
	uint64_t nodes_visited; /* the work done */
	bool budget_reached;    /* candidates were left out */
};

/** What goes first where a budget cannot hold all that is in view. */
enum select_order {
	SELECT_ORDER_LAYER,      /* fewest cells between the eye and the node */
	SELECT_ORDER_SOLIDITY,   /* least hidden by what lies on the best way through the cells */
	SELECT_ORDER_EXTINCTION, /* the same, as solid as the cells are along the view */
	SELECT_ORDER_TRANSMITTANCE, /* least hidden along the straight ray */
	SELECT_ORDER_COVERAGE,      /* most pixels that probably show, a triangle; no walk */
	SELECT_ORDER_DISTANCE,      /* nearest tight box; no walk */
	SELECT_ORDER_AUTO,          /* whichever README.md found best for such a view */
	SELECT_ORDER_COUNT_
};

/** "layer", "solidity", ... */
const char *select_order_name(enum select_order order);

/** Returns: 0, or -EINVAL when there is no order of that name. */
int select_order_find(const char *name, enum select_order *ret);

struct select_options {
	enum select_order order;
	uint64_t budget_triangles; /* 0: no limit */
};

/**
 * Makes a selector over an HS that outlives it.
 *
 * Returns: 0 or -ENOMEM.  Takes O(nodes) memory; later calls allocate nothing.
 */
int selector_create(const struct store_superblock *superblock, const struct store_node *nodes,
		    struct selector **ret);
struct selector *selector_destroy(struct selector *selector);

/**
 * Every leaf whose tight box is in the frustum, nearest first (hierarchical test).  Nothing that
 * could cover a pixel is left out.
 */
void select_frustum(struct selector *selector, const struct camera_view *view,
		    struct selection *ret);

/**
 * Prioritized-layered projection: from the cell of the eye (or the nearest one) through face
 * neighbours, empty cells included, in the order that is asked for, until the budget of triangles is
 * spent; candidates that the walk does not reach follow by distance.  The node that exhausts the
 * budget is the last one in: at least one is returned where any is in view.
 *
 * Source: Klosowski & Silva, "The Prioritized-Layered Projection Algorithm", TVCG 6(2), 2000;
 *	layers as shipped with iWalk.  README.md says how each order is keyed.
 */
void select_approximate(struct selector *selector, const struct camera_view *view,
			const struct select_options *options, struct selection *ret);

/** The leaf whose cell holds a point (from the store's origin), or STORE_NODE_NONE (empty, outside). */
uint32_t select_find_leaf(const struct selector *selector, const double point[3]);

#endif /* LIBCLIENT_SELECT_SELECT_H */
