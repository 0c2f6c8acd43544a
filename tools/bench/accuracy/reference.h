/* SPDX-License-Identifier: MIT */
/**
 * reference.h - the triangles of a store's input, read again from the model files, all in memory.
 *
 * Nothing of the store is used but its grid: what comes out is what the store has to show.
 *
 * Memory: 72 bytes a triangle, 8 more where positions are doubles and exact.
 */
#ifndef TOOLS_BENCH_ACCURACY_REFERENCE_H
#define TOOLS_BENCH_ACCURACY_REFERENCE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "formats/store/store_file.h"
#include "libclient/select/raster.h"

/** Triangles whose positions a store keeps as floats from a point of their own. */
struct reference_group {
	double origin[3];    /* from the store's origin */
	uint64_t *triangles; /* ordinals */
	uint64_t triangle_count;
};

struct reference {
	struct store_superblock superblock;
	double (*corners)[3][3]; /* a triangle: placed, model units, from the store's origin */
	uint64_t triangle_count;
	uint64_t room;
	double moved_max;               /* farthest that the grid moves a vertex */
	double step;                    /* of the grid; 0: raw floats */
	double steps_a_unit;            /* its inverse */
	struct reference_group *groups; /* NULL: all are counted from the store's origin */
	size_t group_count;
};

/**
 * Reads the model files of a command line, as oocbuild would.
 *
 * Returns: 0, -ENOMEM, -ECANCELED, or what import said.  Ownership: ends with reference_done().
 */
int reference_read(struct reference *reference, const struct store_superblock *superblock,
		   char *const *inputs, size_t input_count, struct why *why);
void reference_done(struct reference *reference);

/**
 * Where a store has exact positions of doubles, each node counts them from a point of its own: takes
 * these points and which triangles are counted from them over from the store.  Elsewhere it does
 * nothing.
 *
 * Returns: 0, -EINVAL (no triangle ids, or of other triangles), -ENOMEM, -ECANCELED or what reading
 * said.
 */
int reference_adopt_origins(struct reference *reference, const struct store_file *store,
			    const struct store_node *nodes, struct why *why);

enum reference_form {
	REFERENCE_SNAPPED,  /* on the store's grid: what a store has to be equal to */
	REFERENCE_ORIGINAL, /* as read */
};

/** The corners of a triangle in a form, from the store's origin. */
void reference_corners(const struct reference *reference, uint64_t triangle,
		       enum reference_form form, double ret[3][3]);

/** Draws all of them; items are ordinals in the input.  Returns: 0, -ENOMEM or -ECANCELED. */
int reference_draw(const struct reference *reference, enum reference_form form,
		   const struct camera_view *view, struct raster *raster);

#endif /* TOOLS_BENCH_ACCURACY_REFERENCE_H */
