/* SPDX-License-Identifier: MIT */
/**
 * tight_boxes.h - boxes that fit the triangles of a node closer than the one of its record.
 *
 * A leaf's box is mostly air, so that it shows where nothing in it does.  Once the payload has been
 * there, its two longest sides are divided by four and each column gets the box of what is in it.
 * They are worth their tests only where the whole box shows.  Where these boxes, too, were seen and
 * nothing in them was, the columns are halved the next time: only nodes that deceive are known well.
 *
 * Threads: one.  Memory: 24 bytes a box, for nodes that were learnt.
 * Source: tight bounding volumes of Mattausch, Bittner & Wimmer, "CHC++", 2008, which takes them from
 *	the hierarchy below; a leaf has none.
 */
#ifndef LIBCLIENT_SELECT_TIGHT_BOXES_H
#define LIBCLIENT_SELECT_TIGHT_BOXES_H

#include <stddef.h>
#include <stdint.h>

#include "libclient/select/conservative.h"

/** Columns along a side: at first, and after two disappointments. */
#define TIGHT_BOXES_SIDE_MIN 4u
#define TIGHT_BOXES_SIDE_MAX 16u
#define TIGHT_BOXES_MAX      (TIGHT_BOXES_SIDE_MAX * TIGHT_BOXES_SIDE_MAX)

struct tight_boxes;

/** Nodes whose boxes are learnt in one frame, so that no frame learns a whole model: a few ms. */
#define TIGHT_BOXES_LEARNT_MAX 256u

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
 * Learns them from the node's payload, decoded and validated: for the first time, or finer where
 * tight_boxes_were_wrong().  Each triangle counts as its own box.
 *
 * box:  of the whole node.
 *
 * Returns: 0 or -ENOMEM.  Cost: O(triangles), about 10 ns each.
 */
int tight_boxes_learn(struct tight_boxes *tight, const struct conservative_box *box,
		      const void *payload);

/** A node was drawn for its boxes, and nothing of it shows: from now on they are not good enough. */
void tight_boxes_were_wrong(struct tight_boxes *tight, uint32_t node);

/** Begins a frame: TIGHT_BOXES_LEARNT_MAX are learnt in it at most. */
void tight_boxes_begin(struct tight_boxes *tight);

/**
 * Of nodes that show as a whole, hides again those that have no part that shows.  Boxes that are not
 * known are learnt from the payload.
 *
 * boxes:      of whole nodes, box_count.
 * shows:      a box; set to false where none of its parts shows.
 * ret_count:  boxes of parts that were tested.
 *
 * Returns: 0, -ENOMEM, or what the tester's test() returned.
 */
int tight_boxes_test(struct tight_boxes *tight, const struct conservative_tester *tester,
		     const struct conservative_box *boxes, size_t box_count, bool *shows,
		     size_t *ret_count);

#endif /* LIBCLIENT_SELECT_TIGHT_BOXES_H */
