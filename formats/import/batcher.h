/* SPDX-License-Identifier: MIT */
/**
 * batcher.h - triangles on their way to the sink, in batches of one part and one set of attributes.
 *
 * Threads: one a batcher.
 */
#ifndef FORMATS_IMPORT_BATCHER_H
#define FORMATS_IMPORT_BATCHER_H

#include "formats/import/import.h"

struct batcher {
	const struct import_options *options;
	const struct import_sink *sink;
	struct import_info *info;

	/* The batch that is being filled; the kind changes only when it is empty. */
	uint32_t triangle_count;
	uint32_t part;
	bool positions_double;
	bool normals_set;
	bool colours_set;

	/* Room for a full batch each; positions are one or the other, the rest is made when used. */
	union {
		float *positions32;
		double *positions64;
	};
	float *normals;
	uint32_t *colours;
};

/** What the triangles that follow have. */
struct batch_kind {
	uint32_t part;
	bool normals;
	bool colours;
};

/**
 * Makes room for batches.  positions_double says which positions all of them have.
 *
 * Returns: 0 or -ENOMEM.  Ownership: ends with batcher_done(), which also takes a zeroed one.
 */
int batcher_init(struct batcher *batcher, bool positions_double,
		 const struct import_options *options, const struct import_sink *sink,
		 struct import_info *info, struct why *why);
void batcher_done(struct batcher *batcher);

/**
 * Tells the sink of a part.  Its strings may be NULL, which is "".  The colour is taken as the
 * part's material, or left out if the options say so.
 *
 * Returns: 0, -EOVERFLOW when there are too many, or what the sink returned.
 */
int batcher_part(struct batcher *batcher, const struct import_part *part, uint32_t *ret_number,
		 struct why *why);

/** Hands on what there is, and begins a batch of that kind.  Returns: as batcher_flush(), -ENOMEM. */
int batcher_begin(struct batcher *batcher, const struct batch_kind *kind, struct why *why);

/** Hands on what there is.  Returns: 0, -ECANCELED, or what the sink returned. */
int batcher_flush(struct batcher *batcher, struct why *why);

/** Do vertex colours count? */
static inline bool batcher_wants_colours(const struct batcher *batcher)
{
	return batcher->options->colour <= IMPORT_COLOUR_VERTEX;
}

/** Opens the next triangle; its corners go to [3 * *ret_index, 3 * *ret_index + 3). */
static inline int batcher_next(struct batcher *batcher, const struct batch_kind *kind,
			       uint32_t *ret_index, struct why *why)
{
	if (batcher->triangle_count == IMPORT_BATCH_TRIANGLES || batcher->part != kind->part ||
	    batcher->normals_set != kind->normals || batcher->colours_set != kind->colours) {
		int r = batcher_begin(batcher, kind, why);

		if (r < 0)
			return r;
	}
	*ret_index = batcher->triangle_count++;
	return 0;
}

#endif /* FORMATS_IMPORT_BATCHER_H */
