/* SPDX-License-Identifier: MIT */
/**
 * conservative.h - the exactly visible nodes of a frame, over any way of testing what shows.
 *
 * A frame draws what showed in the frame before, then goes through all other candidates from near
 * to far, in rounds: the boxes of a round are tested against the depth of what has been drawn, and
 * what shows is drawn.  Depth only comes nearer, so what does not show once never will: each box is
 * tested once, and afterwards every node is drawn, or hidden, or its payload is not there.
 *
 * The candidates are the nodes whose tight box is in the frustum; in stores where each triangle is
 * in every cell that it touches, the part of that box in the node's cell.  The walk through the
 * cells is not needed: without it no round is spent on air, and a triangle that reaches out of its
 * cell is not missed.
 *
 * A leaf's box is mostly air.  So what shows as a whole is tested again by the boxes of its parts, once
 * its payload has been there (tight_boxes.h).
 *
 * What draws and tests is the caller's: GL, queries, or occlusion.h.  It is handed over as a struct
 * of functions, and decides at which samples the answer is exact.
 *
 * Threads: a struct conservative belongs to the thread of its selector.
 * Source: Klosowski & Silva, "Efficient Conservative Visibility Culling Using the
 *	Prioritized-Layered Projection Algorithm", TVCG 7(4), 2001; README.md says how this differs.
 */
#ifndef LIBCLIENT_SELECT_CONSERVATIVE_H
#define LIBCLIENT_SELECT_CONSERVATIVE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "libclient/select/select.h"

struct conservative;

/** What is tested for a node, model units from the store's origin, rounded outwards. */
struct conservative_box {
	uint32_t node;
	float box_min[3];
	float box_max[3];
};

/** Functions return 0, or a negative errno that ends the frame and is handed through. */
struct conservative_tester {
	/**
	 * Draws nodes into the depth (and into the picture, if the caller likes).
	 *
	 * ret_drawn:  a node: false where its payload is not there, and nothing was drawn.
	 */
	int (*draw)(void *context, const uint32_t *nodes, size_t node_count, bool *ret_drawn);

	/**
	 * Says which boxes have a sample that is not behind the depth.  A box at the same depth shows.
	 * Boxes may reach to the near plane, and behind the eye.
	 */
	int (*test)(void *context, const struct conservative_box *boxes, size_t box_count,
		    bool *ret_shows);

	/**
	 * Says which of the nodes drawn have a sample that is not behind the depth now, at the end.
	 * NULL: all of them count as showing.
	 */
	int (*remain)(void *context, const uint32_t *nodes, size_t node_count, bool *ret_remains);

	/**
	 * The payload of a node, decoded and validated, from which the boxes of its parts are learnt;
	 * or NULL where it is not there.  It is read before it is asked again.  NULL: whole boxes alone.
	 */
	const void *(*payload)(void *context, uint32_t node);

	void *context;
	bool draws_twice; /* what is drawn to test is no part of the picture */
	size_t round_max; /* boxes tested at once, at least 1: few where an answer is quick */
	/** What testing costs in any case, in triangles: with fewer to draw it does not pay. */
	uint64_t overhead_triangles;
	uint64_t box_triangles; /* what a box costs, likewise */
};

enum conservative_state {
	CONSERVATIVE_SHOWS,   /* it belongs into the picture */
	CONSERVATIVE_COVERED, /* it was drawn, and then others were drawn before it */
	CONSERVATIVE_MISSING, /* it may show, but its payload is not there */
	CONSERVATIVE_HIDDEN,  /* not in the results */
};

/** A node that the frame asks for. */
struct conservative_entry {
	uint32_t node;
	float importance; /* as in the selection of all candidates */
	enum conservative_state state;
};

struct conservative_result {
	const struct conservative_entry *entries; /* nearest first; valid until the next call */
	size_t entry_count;
	size_t shown_count;
	size_t missing_count;
	uint64_t shown_triangles;
	/* Nothing is missing: what shows is what the frustum's nodes show, as exactly as boxes are tested. */
	bool is_complete;
	bool is_untested; /* testing does not pay at present: all candidates are said to show */
	/* The work done, since conservative_begin(). */
	size_t candidate_count;
	uint64_t candidate_triangles;
	uint64_t rounds;
	uint64_t boxes_tested; /* of nodes, and of their parts */
	uint64_t nodes_drawn;
	uint64_t triangles_drawn;
};

/** Returns: 0 or -ENOMEM.  The selector outlives it.  Later calls allocate nothing. */
int conservative_create(struct selector *selector, struct conservative **ret);
struct conservative *conservative_destroy(struct conservative *conservative);

/**
 * Works a frame out.  Nodes that are missing are left out, and the result says so.
 *
 * start:  what is drawn first when no frame went before; NULL: nothing, from near to far.
 *
 * Returns: 0, or what a function of the tester returned; then nothing is known of the frame.
 */
int conservative_begin(struct conservative *conservative, const struct camera_view *view,
		       const struct select_options *start, const struct conservative_tester *tester,
		       struct conservative_result *ret);

/**
 * Goes on with the same frame after payloads have come: what was missing is tested again, and drawn
 * where it still shows.  How long to wait is the caller's.
 *
 * Returns: as conservative_begin().
 */
int conservative_resume(struct conservative *conservative, const struct conservative_tester *tester,
			struct conservative_result *ret);

/** Forgets the frames before, and whether testing paid. */
void conservative_forget(struct conservative *conservative);

#endif /* LIBCLIENT_SELECT_CONSERVATIVE_H */
