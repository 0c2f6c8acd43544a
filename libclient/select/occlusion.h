/* SPDX-License-Identifier: MIT */
/**
 * occlusion.h - the tester of conservative.h without GL: the software rasteriser draws the nodes, and
 * boxes are tested against the pyramid of its depth.
 *
 * The answer is exact for pictures of the size of the image, drawn with raster.h's rules: a box
 * counts with all samples that it touches, a quarter of a pixel larger on each side, and with its
 * nearest depth there, which RASTER_DEPTH_OFFSET lets nothing in it pass (but for the rounding of needles thinner
 * than about 1/100,000 pixel, of which none was met; README.md).  An image that is smaller than the
 * picture is quicker, and an approximation.
 *
 * Threads: a struct occlusion belongs to one thread.
 */
#ifndef LIBCLIENT_SELECT_OCCLUSION_H
#define LIBCLIENT_SELECT_OCCLUSION_H

#include <stddef.h>
#include <stdint.h>

#include "libclient/select/camera.h"
#include "libclient/select/conservative.h"

struct occlusion;

/** The decoded, validated payload of a node, or NULL where it is not there. */
typedef const void *(*occlusion_payload_fn)(void *context, uint32_t node);

/** Returns: 0, -EINVAL (a side is 0 or above 16384) or -ENOMEM. */
int occlusion_create(uint32_t width, uint32_t height, struct occlusion **ret);
struct occlusion *occlusion_destroy(struct occlusion *occlusion);

/** Begins a frame with an empty image. */
void occlusion_clear(struct occlusion *occlusion);

/**
 * What conservative_begin() and conservative_resume() take, for one store in one view.  Stores that
 * are seen together are worked out one after the other, each with an item_first of its own: what one
 * has drawn hides what the next has.
 *
 * payload_of:  is asked while nodes are drawn; what it returns is read before it is asked again.
 * item_first:  the store's node 0 in the image; as many items follow as it has nodes.
 * view:        outlives the tester, as do payload_of and context.
 */
struct occlusion_store {
	struct occlusion *occlusion;
	const struct camera_view *view;
	occlusion_payload_fn payload_of;
	void *context;
	uint64_t item_first;
};

/** store:  stays in place as long as the tester is used. */
struct conservative_tester occlusion_tester(struct occlusion_store *store);

#endif /* LIBCLIENT_SELECT_OCCLUSION_H */
