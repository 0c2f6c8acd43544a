/* SPDX-License-Identifier: MIT */
/**
 * frame_conservative.h - what frame_conservative.c (a frame) and frame_tester.c (what it draws and
 * tests for libclient/select/conservative.h) share.
 *
 * Threads: the GL thread.
 */
#ifndef VIEWER_FRAME_CONSERVATIVE_H
#define VIEWER_FRAME_CONSERVATIVE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "libclient/select/conservative.h"
#include "libclient/select/occlusion.h"
#include "viewer/box_test.h"
#include "viewer/frame_private.h"

/** A pixel of the item buffer that shows no node. */
#define FRAME_NOTHING_SEEN UINT32_MAX

struct frame_conservative {
	struct frame *frame;
	struct box_test *boxes;
	struct conservative *stores[WORLD_STORE_COUNT_MAX];
	struct conservative_result results[WORLD_STORE_COUNT_MAX]; /* of the frame in hand */
	uint64_t turn;                                             /* frames so far */

	/* The target's own buffers, and beside them which node each pixel shows. */
	GLuint framebuffer;
	GLuint seen;
	uint32_t width;
	uint32_t height;
	uint32_t *seen_pixels;
	bool *is_seen; /* a node, numbered through all stores */
	size_t node_count;

	struct occlusion *occlusion; /* NULL: not used yet; as large as the picture */
	bool is_software_exact;

	/* The frame in hand. */
	const struct frame_picture *picture;
	struct frame_report *report;
	struct why *why;
	enum frame_visibility visibility;
	bool is_settled;
	uint64_t patience_ns; /* that a live one has left to wait */
	uint32_t store;       /* that is worked out */
	bool is_tested;       /* it: what is drawn now was found by a test */
	/*
	 * OpenGL gives faces at the same depth to the first drawn.  What showed before is drawn first, so
	 * the others come late; if a query says that one ties, the picture is drawn again in order.
	 */
	GLuint tie_query;
	bool is_out_of_order; /* what is drawn next may come before what was drawn */
	bool has_tied;
	uint32_t view_of; /* the store whose view OpenGL has */
	struct occlusion_store software;
	struct conservative_tester software_tester;
};

/** Begins with a store: what conservative_begin() takes.  The tester is good until the next call. */
struct conservative_tester frame_tester_begin(struct frame_conservative *self, uint32_t store);

/**
 * Draws nodes of the store in hand into a live picture, as far as they come in time.
 *
 * ret_drawn:  a node: false where it is missing.
 *
 * Returns: 0 or -errno.
 */
int frame_tester_draw_live(struct frame_conservative *self, frame_draw_fn draw,
			   const uint32_t *nodes, size_t node_count, bool *ret_drawn);

#endif /* VIEWER_FRAME_CONSERVATIVE_H */
