/* SPDX-License-Identifier: MIT */
/**
 * hiding.h - how much the cells of an HS hide of what lies behind them, by their records alone.
 *
 * A cell whose triangles have the projected area A along a direction lets exp(-A / edge^2) of the
 * light through, seen across one edge: A / edge^2 is its *depth*, and depths along a way add up.
 *
 * Threads: any number may read.
 * Source: Sillion, Drettakis & Soler 1995, eq. 6 (extinction by projected area).
 */
#ifndef LIBCLIENT_SELECT_HIDING_H
#define LIBCLIENT_SELECT_HIDING_H

#include <stdint.h>

#include "formats/store/layout.h"
#include "libclient/select/places.h"

/** What lies behind as much is as good as hidden: 6 in a million get through. */
#define HIDING_DEPTH_MAX 12.0f

/** All but the places belongs to others, and outlives this. */
struct hiding {
	const struct places *places;
	const struct store_node *nodes;
	uint32_t node_count;
	float depth_of[256]; /* of a solidity as it is stored */
};

/** A direction among those of store_node.solidity: the three nearest, and their weights. */
struct hiding_direction {
	uint8_t axis[3];
	float weight[3]; /* barycentric: they add up to 1 */
};

void hiding_init(struct hiding *ret, const struct places *places, const struct store_node *nodes,
		 uint32_t node_count);

/** direction:  of any length, 0 too (an eye in the middle of a cell); either sign gives the same. */
void hiding_direction_set(struct hiding_direction *ret, const double direction[3]);

/** Depth of a cell along a direction, across one edge; 0 of air. */
float hiding_depth(const struct hiding *hiding, uint32_t cell,
		   const struct hiding_direction *direction);

/** Depth of a cell, the mean of all directions. */
float hiding_mean_depth(const struct hiding *hiding, uint32_t cell);

/**
 * Depth of what lies between an eye and the middle of a cell, each cell on the way by the length of
 * the ray in it, but for the last one; at most HIDING_DEPTH_MAX, where the ray is not followed
 * farther.
 *
 * ret_steps:  how many cells were crossed is added to it.
 */
float hiding_along_ray(const struct hiding *hiding, const double eye[3], uint32_t cell,
		       uint64_t *ret_steps);

#endif /* LIBCLIENT_SELECT_HIDING_H */
