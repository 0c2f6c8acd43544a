/* SPDX-License-Identifier: MIT */
/**
 * frame.h - one picture of a world: which nodes, ask for them, draw what is there.
 *
 * A live frame waits for nothing: nodes that are not drawable are missing in it.  A settled frame
 * waits until each of its nodes has come, and draws sets larger than the daemon's cache in portions
 * into the same target: hold, draw, finish, let go, next.  It draws the nodes in the order of the
 * list whatever the portions are, so that equal depths fall out the same.
 *
 * A conservative frame (WORLD_MODE_CONSERVATIVE) finds out while it draws: what showed in the frame
 * before is drawn first, then the boxes of all other candidates are tested and what shows is drawn
 * (libclient/select/conservative.h).  A live one waits for what shows and is not there, in all
 * no longer than its deadline.  A settled one draws what was found once more, in the order of the list, so that it is the
 * picture of the whole frustum to the last tie in depth.
 *
 * Rules:
 *   1. The daemon may overwrite what the newest set does not hold, and segments may go, with the next
 *      set, dispatch or wait.  So OpenGL finishes all draws before any of these (frame_finish()).
 *   2. A daemon that was lost and came back may have overwritten what was held: what was drawn in
 *      place is looked at once more after the draws (ooc_still_valid()), and drawn again if need be.
 *
 * Threads: the GL thread, which is also the client's.
 */
#ifndef VIEWER_FRAME_H
#define VIEWER_FRAME_H

#include <stdbool.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "libclient/select/select.h"
#include "viewer/cost_model.h"
#include "viewer/renderer.h"
#include "viewer/residency.h"
#include "viewer/target.h"
#include "viewer/world.h"

struct frame;

/** How a conservative frame tests what shows. */
enum frame_visibility {
	FRAME_VISIBILITY_ITEMS,    /* full-resolution item buffer: boxes flag themselves */
	FRAME_VISIBILITY_QUERIES,  /* an occlusion query a box */
	FRAME_VISIBILITY_SOFTWARE, /* libclient/select/occlusion.h */
	FRAME_VISIBILITY_COUNT_
};

/** "items", "queries" or "software". */
const char *frame_visibility_name(enum frame_visibility visibility);

/** How a picture is to be. */
struct frame_style {
	struct world_choice choice;
	/* WORLD_MODE_CONSERVATIVE: */
	enum frame_visibility visibility;
	double query_latency_ms; /* FRAME_VISIBILITY_QUERIES: as if OpenGL answered so late */
	double deadline_ms;      /* how long a live frame waits, in all, for what shows */
	enum channel channel;
	bool unlit;
	uint8_t background[3];
};

/** How a frame's nodes were found. */
enum frame_way {
	FRAME_WAY_FULL,       /* all that is in the frustum, as was asked for */
	FRAME_WAY_EVERYTHING, /* likewise: the whole world fits the budget */
	FRAME_WAY_BUDGET,     /* what most likely shows, up to the budget */
	FRAME_WAY_EXACT,      /* what shows: the picture is that of FRAME_WAY_FULL */
	FRAME_WAY_NEARLY,     /* likewise, by a test that is not known to be exact here */
	FRAME_WAY_UNTESTED, /* all that is in the frustum, for so much shows that testing would cost */
	FRAME_WAY_COUNT_
};

/** "full", "everything", ... */
const char *frame_way_name(enum frame_way way);

/** What a frame was. */
struct frame_report {
	enum frame_way way;
	double ms; /* from the choice of nodes until they are drawn; a live one's until handed over */
	double waited_ms;          /* of it, for the daemon */
	double selection_ms;       /* of it, to find the nodes */
	uint64_t budget_triangles; /* 0: none */
	enum select_order order;   /* FRAME_WAY_BUDGET */
	uint64_t nodes_visited;    /* of the HS, to find the nodes */
	/* FRAME_WAY_EXACT and _NEARLY; in a settled picture what it took to find the nodes: */
	uint64_t nodes_shown;  /* that have a pixel in the end, as far as the test says */
	uint64_t rounds;       /* of tests and draws */
	uint64_t boxes_tested; /* in them, by whatever way */
	uint64_t queries;      /* occlusion queries begun */
	bool is_incomplete;    /* live, and some of what shows had not come by the deadline */
	uint64_t nodes_wanted;
	uint64_t nodes_drawn;
	uint64_t nodes_missing;
	uint64_t triangles;     /* drawn */
	uint64_t bytes_fetched; /* payload bytes that the daemon read for this viewer since the */
	uint64_t bytes_prefetched; /* report before */
	uint32_t portions;
	bool is_unfinished; /* nodes are drawable that a live frame had no time to copy */
};

/**
 * Prepares to draw a world that outlives it.
 *
 * gpu_cache_bytes:  as residency_create() takes it.
 *
 * Returns: 0, -EUCLEAN or -ENOMEM.
 */
int frame_create(struct world *world, uint64_t gpu_cache_bytes, struct frame **ret,
		 struct why *why);
struct frame *frame_destroy(struct frame *frame);

bool frame_is_in_place(const struct frame *frame);

/** What drawing costs here, measured or remembered.  Returns: 0 or -ENOMEM. */
int frame_costs(struct frame *frame, struct cost_model *ret, struct why *why);

/**
 * Draws what is there.
 *
 * aspect:  of the picture: width / height.
 *
 * Returns: 0, -EINVAL (the camera looks nowhere) or -ENOMEM.  A daemon that is away is no error:
 *	the nodes that it held are drawn, the others are missing.
 */
int frame_draw_live(struct frame *frame, const struct camera *camera, double aspect,
		    const struct frame_style *style, const struct target *target,
		    struct frame_report *ret, struct why *why);

/**
 * Draws all of it, however long it takes; then it is drawn, not only handed over.
 *
 * tile:  the part of the picture that the target is.
 *
 * Returns: 0; nodes that are damaged are missing then.  Else as above, -ETIMEDOUT or -ENOBUFS when
 *	a node does not come for half a minute, -ENOTCONN when the daemon stays away, or -ECANCELED
 *	when the program is to stop.
 */
int frame_draw_settled(struct frame *frame, const struct camera *camera, double aspect,
		       const struct frame_style *style, const struct render_tile *tile,
		       const struct target *target, struct frame_report *ret, struct why *why);

/**
 * Waits until all draws are done.
 *
 * Returns: false when something was overwritten while it was drawn: the picture must be drawn again.
 */
bool frame_finish(struct frame *frame);

/** The item at a pixel of a live picture, drawn with the nodes of the last frame. */
uint64_t frame_pick(struct frame *frame, const struct target *shown, enum channel channel, int x,
		    int y);

#endif /* VIEWER_FRAME_H */
