/* SPDX-License-Identifier: MIT */
/**
 * cache_view.h - the first store from above, beside the picture: what the cache has of it, what the
 * view wants and what it is expected to want (libclient/select/birds_eye.h).
 *
 * Threads: the GL thread, which is also the client's.
 */
#ifndef VIEWER_CACHE_VIEW_H
#define VIEWER_CACHE_VIEW_H

#include <stdbool.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "libclient/select/birds_eye.h"
#include "viewer/foresight.h"
#include "viewer/world.h"

struct cache_view;

/** Of a world that outlives it.  Returns: 0 or -ENOMEM. */
int cache_view_create(const struct world *world, struct cache_view **ret, struct why *why);
struct cache_view *cache_view_destroy(struct cache_view *cache_view);

/**
 * Paints it anew and puts it into the window's upper right corner, a third as wide.
 *
 * foresight:  NULL: nothing is expected.
 */
void cache_view_draw(struct cache_view *cache_view, const struct camera *camera,
		     struct foresight *foresight, enum birds_eye_colouring colouring,
		     uint32_t window_width, uint32_t window_height);

#endif /* VIEWER_CACHE_VIEW_H */
