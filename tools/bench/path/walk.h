/* SPDX-License-Identifier: MIT */
/**
 * walk.h - a way for a walker through a model: on floors, through doors, out of the walls.
 *
 * Nothing says how large a model is, so the walker's size comes from the model: its storeys are the
 * heights between a floor and what is above it, and the walker fits them as a person fits a storey
 * of 3.8 metres.  Where units are known and a person fits, it is one.
 *
 * The same occupancy, seed and length give the same way.
 */
#ifndef TOOLS_BENCH_PATH_WALK_H
#define TOOLS_BENCH_PATH_WALK_H

#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "tools/bench/path/occupancy.h"

/** Where to walk: found on a coarse grid of the whole, to be looked at on a fine one. */
struct walk_site {
	struct occupancy_region region; /* what the fine grid is to hold */
	double storey;                  /* model units */
};

/**
 * Finds the storeys of a model and the part of it that has them.
 *
 * unit_metres:  of a model unit; 0: unknown.
 * seed:         chooses the part where there is too much for a fine grid.
 *
 * Returns: 0, -ENODATA (nothing stands on or under anything) or -ENOMEM.
 */
int walk_survey(const struct occupancy *coarse, double unit_metres, uint64_t seed,
		struct walk_site *ret, struct why *why);

struct walk_point {
	double at[3]; /* the eye, in voxels of the grid */
};

struct walk {
	struct walk_point *points; /* at equal distances */
	size_t point_count;
	double storey;  /* voxels */
	double spacing; /* voxels */
};

/**
 * Finds a way of point_count points.
 *
 * storey:  model units, from the survey.
 *
 * Returns: 0, -ENODATA (there is no floor to walk on), -ENOMEM or -ECANCELED.
 * Ownership: ends with walk_done().
 */
int walk_make(const struct occupancy *fine, double storey, uint64_t seed, size_t point_count,
	      struct walk *ret, struct why *why);
void walk_done(struct walk *walk);

#endif /* TOOLS_BENCH_PATH_WALK_H */
