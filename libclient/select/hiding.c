/* SPDX-License-Identifier: MIT */
#include "libclient/select/hiding.h"

#include <math.h>
#include <stdbool.h>

/** A ray is given up after as many cells, and what it has met counts: a bound on the work. */
#define RAY_CELLS_MAX 256u
/** A solidity of 1 would have no finite depth; it stands for all that round to it. */
#define SOLIDITY_MOST 254.75

void hiding_init(struct hiding *ret, const struct places *places, const struct store_node *nodes,
		 uint32_t node_count)
{
	*ret = (struct hiding){ .places = places, .nodes = nodes, .node_count = node_count };
	for (unsigned i = 0; i < 256; i++)
		ret->depth_of[i] = (float)-log(1.0 - fmin(i, SOLIDITY_MOST) / 255.0);
}

void hiding_direction_set(struct hiding_direction *ret, const double direction[3])
{
	static const double axes[STORE_SOLIDITY_DIRECTIONS][3] = {
		{ 0, 1, STORE_GOLDEN_RATIO }, { 0, -1, STORE_GOLDEN_RATIO },
		{ 1, STORE_GOLDEN_RATIO, 0 }, { -1, STORE_GOLDEN_RATIO, 0 },
		{ STORE_GOLDEN_RATIO, 0, 1 }, { STORE_GOLDEN_RATIO, 0, -1 },
	};
	/* The cosine between two corners of a face of an icosahedron. */
	const double cosine = 0.44721359549995794;
	double along[STORE_SOLIDITY_DIRECTIONS];
	double sum = 0.0;

	for (unsigned i = 0; i < STORE_SOLIDITY_DIRECTIONS; i++)
		along[i] = fabs(axes[i][0] * direction[0] + axes[i][1] * direction[1] +
				axes[i][2] * direction[2]);
	for (unsigned k = 0; k < 3; k++) {
		unsigned best = 0;

		for (unsigned i = 1; i < STORE_SOLIDITY_DIRECTIONS; i++)
			if (along[i] > along[best])
				best = i;
		ret->axis[k] = (uint8_t)best;
		ret->weight[k] = (float)along[best];
		sum += along[best];
		along[best] = -1.0;
	}
	/*
	 * The direction is sum(w d) of the face's corners d, so its cosine with one of them is
	 * (1 - cosine) w + cosine sum(w), and sum(w) is the sum of them over 1 + 2 cosine.
	 */
	sum /= 1.0 + 2.0 * cosine;
	for (unsigned k = 0; k < 3; k++) {
		double weight = (ret->weight[k] / sum - cosine) / (1.0 - cosine);

		ret->weight[k] = sum > 0.0 ? (float)fmax(weight, 0.0) : (float)(1.0 / 3.0);
	}
}

float hiding_depth(const struct hiding *hiding, uint32_t cell,
		   const struct hiding_direction *direction)
{
	const uint8_t *solidity;
	float depth = 0.0f;

	if (cell >= hiding->node_count || hiding->nodes[cell].payload_id == 0)
		return 0.0f;
	solidity = hiding->nodes[cell].solidity;
	for (unsigned k = 0; k < 3; k++)
		depth += direction->weight[k] * hiding->depth_of[solidity[direction->axis[k]]];
	return depth;
}

float hiding_mean_depth(const struct hiding *hiding, uint32_t cell)
{
	float sum = 0.0f;

	if (cell >= hiding->node_count || hiding->nodes[cell].payload_id == 0)
		return 0.0f;
	for (unsigned i = 0; i < STORE_SOLIDITY_DIRECTIONS; i++)
		sum += hiding->depth_of[hiding->nodes[cell].solidity[i]];
	return sum * (1.0f / STORE_SOLIDITY_DIRECTIONS);
}

/* ---- rays: from cell to cell, in coordinates where the finest cube has edge 1 ---- */

struct ray {
	double from[3];
	double direction[3]; /* to the end: the ray's parameter runs from 0 to 1 */
	int64_t at[3];       /* the finest cube that the ray is in */
	double edges;        /* the root's edge */
	double t;
};

/* The cell around ray->at, and the least corner and edge of its cube. */
static uint32_t ray_cell(const struct places *places, const struct ray *ray, int64_t low[3],
			 int64_t *ret_edge)
{
	int64_t edge = (int64_t)1 << STORE_LEVEL_MAX;
	uint32_t place = 0;

	while (!place_is_cell(places, place)) {
		unsigned octant = 0;

		edge >>= 1;
		for (unsigned k = 0; k < 3; k++)
			octant |= ray->at[k] & edge ? 1u << k : 0;
		place = place_child(places, place, octant);
	}
	for (unsigned k = 0; k < 3; k++)
		low[k] = ray->at[k] & ~(edge - 1);
	*ret_edge = edge;
	return place;
}

static int64_t clamped(int64_t value, int64_t low, int64_t high)
{
	return value < low ? low : value > high ? high : value;
}

/* To where the ray leaves a cube, and over the face.  Returns: the parameter's way inside. */
static double ray_cross(struct ray *ray, const int64_t low[3], int64_t edge)
{
	double leave = 1.0;
	double from_t = ray->t;
	unsigned axis = 3;

	for (unsigned k = 0; k < 3; k++) {
		int64_t face = ray->direction[k] > 0.0 ? low[k] + edge : low[k];
		double t;

		if (ray->direction[k] == 0.0)
			continue;
		t = ((double)face - ray->from[k]) / ray->direction[k];
		if (t < leave) {
			leave = t;
			axis = k;
		}
	}
	/* Rounding may put a face a little behind. */
	ray->t = fmax(leave, from_t);
	for (unsigned k = 0; k < 3; k++) {
		double position = ray->from[k] + ray->t * ray->direction[k];

		ray->at[k] = clamped((int64_t)floor(position), low[k], low[k] + edge - 1);
	}
	if (axis < 3)
		ray->at[axis] = ray->direction[axis] > 0.0 ? low[axis] + edge : low[axis] - 1;
	return ray->t - from_t;
}

/* From the eye, or from where the ray enters the root.  Returns: false when it misses it. */
static bool ray_begin(struct ray *ray)
{
	double leave = 1.0;

	ray->t = 0.0;
	for (unsigned k = 0; k < 3; k++) {
		double t0 = -ray->from[k] / ray->direction[k];
		double t1 = (ray->edges - ray->from[k]) / ray->direction[k];

		if (ray->direction[k] == 0.0)
			continue;
		ray->t = fmax(ray->t, fmin(t0, t1));
		leave = fmin(leave, fmax(t0, t1));
	}
	for (unsigned k = 0; k < 3; k++) {
		double position = ray->from[k] + ray->t * ray->direction[k];

		ray->at[k] = clamped((int64_t)floor(position), 0, (int64_t)ray->edges - 1);
	}
	return ray->t < leave;
}

float hiding_along_ray(const struct hiding *hiding, const double eye[3], uint32_t cell,
		       uint64_t *ret_steps)
{
	const struct store_superblock *superblock = hiding->places->superblock;
	const struct cube *cube = &hiding->places->cubes[cell];
	struct ray ray = { .edges = (double)((int64_t)1 << STORE_LEVEL_MAX) };
	double per_unit = ray.edges / superblock->root_size;
	struct hiding_direction direction;
	double length2 = 0.0;
	double length;
	float depth = 0.0f;

	for (unsigned k = 0; k < 3; k++) {
		ray.from[k] = (eye[k] - superblock->root_min[k]) * per_unit;
		ray.direction[k] = ((double)cube->centre[k] - eye[k]) * per_unit;
		length2 += ray.direction[k] * ray.direction[k];
	}
	length = sqrt(length2);
	if (length == 0.0 || !ray_begin(&ray))
		return 0.0f;
	hiding_direction_set(&direction, ray.direction);
	for (unsigned step = 0; step < RAY_CELLS_MAX && depth < HIDING_DEPTH_MAX; step++) {
		int64_t low[3];
		int64_t edge;
		uint32_t crossed = ray_cell(hiding->places, &ray, low, &edge);

		++*ret_steps;
		if (crossed == cell)
			break;
		depth += hiding_depth(hiding, crossed, &direction) *
			 (float)(ray_cross(&ray, low, edge) * length / (double)edge);
		for (unsigned k = 0; k < 3; k++)
			if (ray.at[k] < 0 || ray.at[k] >= (int64_t)ray.edges)
				return fminf(depth, HIDING_DEPTH_MAX);
	}
	return fminf(depth, HIDING_DEPTH_MAX);
}
