/* SPDX-License-Identifier: MIT */
/**
 * box_test.h - which boxes show against the depth that is bound, by OpenGL.
 *
 * A box is drawn with nothing written, at every sample of the picture, and either says itself that a
 * sample passed (flags in a buffer, which an item buffer of the nearest box alone could not say) or
 * is counted by an occlusion query of its own.  Both give the same answers, for any number of boxes.
 *
 * Conservative: a box is drawn larger by a quarter of a pixel where it is farthest, so that neither the
 * snapping of its corners nor a rounding of its depth can hide what lies in it, and a box at the same
 * depth as a surface shows.  That no triangle is drawn nearer than its corners is the polygon offset's
 * doing (libclient/select/raster.h), which boxes go without.  A box may reach behind the eye; one that the eye is in shows.
 *
 * Threads: the GL thread.
 */
#ifndef VIEWER_BOX_TEST_H
#define VIEWER_BOX_TEST_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "libclient/select/camera.h"
#include "libclient/select/conservative.h"
#include "viewer/renderer.h"

struct box_test;

/** Returns: 0, -EUCLEAN with what the driver says, or -ENOMEM. */
int box_test_create(struct box_test **ret, struct why *why);
struct box_test *box_test_destroy(struct box_test *test);

/** What is tested against: the framebuffer that is bound, its view, and which part it is. */
struct box_test_view {
	const struct camera_view *view;
	const struct render_tile *tile;
	uint32_t width; /* of the part */
	uint32_t height;
};

/**
 * Tests by flags.  Leaves another program and vertex array bound, and waits for the answer.
 *
 * Returns: 0 or -ENOMEM.
 */
int box_test_flags(struct box_test *test, const struct box_test_view *view,
		   const struct conservative_box *boxes, size_t box_count, bool *ret_shows);

/**
 * Tests by queries, all begun before the first is asked.
 *
 * latency_ns:  no answer is looked at sooner after the last was begun: a pipeline as deep as that of
 *              a GPU where the driver has none.  0: none.
 *
 * Returns: 0 or -ENOMEM.
 */
int box_test_queries(struct box_test *test, const struct box_test_view *view,
		     const struct conservative_box *boxes, size_t box_count, uint64_t latency_ns,
		     bool *ret_shows);

#endif /* VIEWER_BOX_TEST_H */
