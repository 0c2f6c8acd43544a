/* SPDX-License-Identifier: MIT */
/**
 * tight_boxes.h - boxes that fit the triangles of a node closer than the one of its record.
 *
 * A leaf's box is mostly air, so that it shows where nothing in it does.  Once the payload has been
 * there, its two longest sides are divided by four and each column gets the box of what is in it.
 * They are worth their tests only where the whole box shows.
 *
 * Threads: one.  Memory: 24 bytes a box, for nodes that were learnt.
 * Source: tight bounding volumes of Mattausch, Bittner & Wimmer, "CHC++", 2008, which takes them from
 *	the hierarchy below; a leaf has none.
 */
#ifndef VIEWER_TIGHT_BOXES_H
#define VIEWER_TIGHT_BOXES_H

#include <stddef.h>
#include <stdint.h>

#include "libclient/select/conservative.h"

#define TIGHT_BOXES_SIDE 4u
#define TIGHT_BOXES_MAX  (TIGHT_BOXES_SIDE * TIGHT_BOXES_SIDE)

struct tight_boxes;

/** Of one store.  Returns: 0 or -ENOMEM. */
int tight_boxes_create(uint64_t node_count, struct tight_boxes **ret);
struct tight_boxes *tight_boxes_destroy(struct tight_boxes *tight);

/**
 * The boxes of a node, model units from the store's origin, rounded outwards.
 *
 * Returns: how many, at most TIGHT_BOXES_MAX; 0 while they are not known.
 */
uint32_t tight_boxes_find(const struct tight_boxes *tight, uint32_t node,
			  const struct conservative_box **ret);

/**
 * Learns them from the node's payload, decoded and validated.  Each triangle counts as its own box.
 *
 * box:  of the whole node.
 *
 * Returns: 0 or -ENOMEM.  Cost: O(triangles), about 10 ns each.
 */
int tight_boxes_learn(struct tight_boxes *tight, const struct conservative_box *box,
		      const void *payload);

#endif /* VIEWER_TIGHT_BOXES_H */
