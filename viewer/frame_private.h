/* SPDX-License-Identifier: MIT */
/**
 * frame_private.h - what the files of frame.h share: frame.c (live frames, and what all have),
 * frame_settled.c, frame_conservative.c with frame_tester.c.
 *
 * Threads: the GL thread.
 */
#ifndef VIEWER_FRAME_PRIVATE_H
#define VIEWER_FRAME_PRIVATE_H

#include "viewer/frame.h"

/* A node drawn in place. */
struct drawn {
	uint32_t store;
	uint32_t node;
	struct ooc_place place;
};

struct frame_conservative; /* of frame_conservative.c */

struct frame {
	struct world *world;
	struct renderer *renderer;
	struct residency *residency;
	GLsync fence; /* of the draws since the last frame_finish(); NULL: none */

	struct drawn *drawn; /* since the last frame_finish() */
	size_t drawn_count;
	size_t drawn_room;

	struct ooc_counters counters; /* at the report before */

	struct frame_conservative *conservative; /* NULL: there was no such frame yet */
};

/** What is drawn, and where to. */
struct frame_picture {
	const struct camera *camera;
	double aspect;
	const struct frame_style *style;
	const struct render_tile *tile; /* the part that the target is */
	const struct target *target;
};

/* ---- frame.c ---- */

/** Begins to draw into the framebuffer that is bound. */
void frame_begin_drawing(struct frame *frame, const struct frame_style *style,
			 const struct render_tile *tile);

/** Draws one wanted node.  Returns: 0, or why not, as residency_find() says it. */
int frame_draw_want(struct frame *frame, const struct world_want *want, uint32_t *view_of,
		    struct frame_report *report);
void frame_end_drawing(struct frame *frame);

double frame_ms_since(uint64_t begin_ns);

/** Finds the nodes, and says in the report how. */
int frame_look(struct frame *frame, const struct camera *camera, double aspect,
	       const struct frame_style *style, struct frame_report *report, struct why *why);

/** Completes a report by what is counted elsewhere. */
void frame_finish_report(struct frame *frame, uint64_t begin_ns, struct frame_report *report);

/* ---- frame_settled.c ---- */

/** How nodes of the world's list are drawn, one after the other: frame_draw_want(), or like it. */
typedef int (*frame_draw_fn)(struct frame *frame, const struct world_want *want, uint32_t *view_of,
			     struct frame_report *report);

/**
 * Draws the world's list into the framebuffer that is bound, in its order, in as many portions as it
 * takes.  Drawing has begun.
 *
 * is_quiet:  says nothing of nodes that never come.
 *
 * Returns: 0, -ESTALE when what was drawn was overwritten meanwhile and all must be begun again, or as
 *	frame_draw_settled().
 */
int frame_settle(struct frame *frame, frame_draw_fn draw, bool is_quiet,
		 struct frame_report *report, struct why *why);

/** Has the daemon said that a node of the set will not come, whatever is waited for? */
bool frame_never_comes(const struct frame *frame, uint32_t store, uint32_t node);

/* ---- frame_conservative.c ---- */

/** As frame_draw_live(). */
int frame_draw_shown(struct frame *frame, const struct frame_picture *picture,
		     struct frame_report *ret, struct why *why);

/**
 * Finds what shows and makes it the world's list, in the order of the whole frustum's.  Draws into
 * the target, which is of no use afterwards.
 *
 * Returns: as frame_settle().
 */
int frame_find_shown(struct frame *frame, const struct frame_picture *picture,
		     struct frame_report *report, struct why *why);

struct frame_conservative *frame_conservative_destroy(struct frame_conservative *conservative);

#endif /* VIEWER_FRAME_PRIVATE_H */
