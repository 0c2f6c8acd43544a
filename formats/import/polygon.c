/* SPDX-License-Identifier: MIT */
#include "formats/import/polygon.h"

#include <errno.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"

/* Looks at corners for one polygon: enough for 4,000 corners at their worst. */
#define LOOKS_MAX (UINT64_C(1) << 24)

void polygon_done(struct polygon *polygon)
{
	free(polygon->positions);
	free(polygon->triangles);
	free(polygon->flat);
	free(polygon->next);
	free(polygon->previous);
	free(polygon->reflex);
	*polygon = (struct polygon){ 0 };
}

int polygon_reserve(struct polygon *polygon, uint32_t corner_count)
{
	size_t count = 64;

	CHECK(corner_count <= POLYGON_CORNERS_MAX);
	if (corner_count <= polygon->corner_max)
		return 0;
	while (count < corner_count)
		count *= 2;
	polygon_done(polygon);
	polygon->positions = malloc(count * 3 * sizeof(double));
	polygon->triangles = malloc(count * 3 * sizeof(uint32_t));
	polygon->flat = malloc(count * sizeof(*polygon->flat));
	polygon->next = malloc(count * sizeof(uint32_t));
	polygon->previous = malloc(count * sizeof(uint32_t));
	polygon->reflex = malloc(count * sizeof(uint32_t));
	if (!polygon->positions || !polygon->triangles || !polygon->flat || !polygon->next ||
	    !polygon->previous || !polygon->reflex) {
		polygon_done(polygon);
		return -ENOMEM;
	}
	polygon->corner_max = (uint32_t)count;
	return 0;
}

static void fan(uint32_t *out, uint32_t corner_count)
{
	for (uint32_t i = 1; i + 1 < corner_count; i++) {
		*out++ = 0;
		*out++ = i;
		*out++ = i + 1;
	}
}

/*
 * Projects along the largest axis of the Newell normal, keeping the sense of rotation: the polygon
 * runs counter-clockwise.  False when it has no area.
 */
static bool polygon_flatten(struct polygon *polygon, uint32_t corner_count)
{
	const double *positions = polygon->positions;
	double normal[3] = { 0.0, 0.0, 0.0 };
	int axis = 0, u, v;

	for (uint32_t i = 0; i < corner_count; i++) {
		const double *a = positions + 3 * (size_t)i;
		const double *b = positions + 3 * (size_t)(i + 1 < corner_count ? i + 1 : 0);

		/* Relative to the first corner: far from the origin the products would cancel. */
		for (int k = 0; k < 3; k++) {
			int k1 = (k + 1) % 3, k2 = (k + 2) % 3;

			normal[k] += (a[k1] - b[k1]) *
				     ((a[k2] - positions[k2]) + (b[k2] - positions[k2]));
		}
	}
	for (int k = 1; k < 3; k++)
		if (fabs(normal[k]) > fabs(normal[axis]))
			axis = k;
	if (!(fabs(normal[axis]) > 0.0) || !isfinite(normal[axis]))
		return false;
	u = (axis + 1) % 3;
	v = (axis + 2) % 3;
	if (normal[axis] < 0.0) {
		int swap = u;

		u = v;
		v = swap;
	}
	for (uint32_t i = 0; i < corner_count; i++) {
		polygon->flat[i][0] = positions[3 * (size_t)i + (size_t)u];
		polygon->flat[i][1] = positions[3 * (size_t)i + (size_t)v];
	}
	return true;
}

/* Twice the signed area. */
static double turn(const double *a, const double *b, const double *c)
{
	return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

static bool same(const double *a, const double *b)
{
	return a[0] == b[0] && a[1] == b[1];
}

static double corner_turn(const struct polygon *polygon, uint32_t corner)
{
	return turn(polygon->flat[polygon->previous[corner]], polygon->flat[corner],
		    polygon->flat[polygon->next[corner]]);
}

/* What is left of the polygon while it is clipped. */
struct clipping {
	struct polygon *polygon;
	uint32_t left_count;
	uint32_t
		reflex_count; /* entries in polygon->reflex, some of them clipped or convex by now */
	uint64_t looks_left;
	uint32_t *out;
};

/* Pays for looking at so many corners; what cannot be paid for leaves nothing. */
static void spend(struct clipping *clipping, uint64_t look_count)
{
	clipping->looks_left -= u64_min(look_count, clipping->looks_left);
}

/* Convex, and no reflex corner in the triangle?  One that stands on its corners is outside. */
static bool is_ear(struct clipping *clipping, uint32_t corner)
{
	const struct polygon *polygon = clipping->polygon;
	const double *a = polygon->flat[polygon->previous[corner]];
	const double *b = polygon->flat[corner];
	const double *c = polygon->flat[polygon->next[corner]];

	spend(clipping, 1);
	if (!(turn(a, b, c) > 0.0))
		return false;
	spend(clipping, clipping->reflex_count);
	for (uint32_t i = 0; i < clipping->reflex_count; i++) {
		const double *p = polygon->flat[polygon->reflex[i]];

		if (turn(a, b, p) >= 0.0 && turn(b, c, p) >= 0.0 && turn(c, a, p) >= 0.0 &&
		    !same(p, a) && !same(p, b) && !same(p, c))
			return false;
	}
	return true;
}

/* Forgets reflex corners that were clipped (next is itself) or have become convex. */
static void reflex_refresh(struct clipping *clipping)
{
	struct polygon *polygon = clipping->polygon;
	uint32_t kept_count = 0;

	spend(clipping, clipping->reflex_count);
	for (uint32_t i = 0; i < clipping->reflex_count; i++) {
		uint32_t corner = polygon->reflex[i];

		if (polygon->next[corner] != corner && !(corner_turn(polygon, corner) > 0.0))
			polygon->reflex[kept_count++] = corner;
	}
	clipping->reflex_count = kept_count;
}

static uint32_t clip(struct clipping *clipping, uint32_t corner)
{
	struct polygon *polygon = clipping->polygon;
	uint32_t previous = polygon->previous[corner], next = polygon->next[corner];

	*clipping->out++ = previous;
	*clipping->out++ = corner;
	*clipping->out++ = next;
	polygon->next[previous] = next;
	polygon->previous[next] = previous;
	polygon->next[corner] = corner;
	clipping->left_count--;
	return next;
}

/*
 * When a whole turn finds no ear, the polygon touches or crosses itself: a flat corner goes first,
 * since it covers nothing, else a convex one, else any.
 */
static uint32_t least_harm(struct clipping *clipping, uint32_t corner)
{
	const struct polygon *polygon = clipping->polygon;
	uint32_t best = corner;
	int best_rank = -1;

	spend(clipping, clipping->left_count);
	for (uint32_t i = 0; i < clipping->left_count; i++) {
		double area = corner_turn(polygon, corner);
		int rank = area == 0.0 ? 2 : area > 0.0 ? 1 : 0;

		if (rank > best_rank) {
			best_rank = rank;
			best = corner;
		}
		corner = polygon->next[corner];
	}
	return best;
}

static void polygon_clip(struct polygon *polygon, uint32_t corner_count, uint32_t reflex_count)
{
	struct clipping clipping = {
		.polygon = polygon,
		.left_count = corner_count,
		.reflex_count = reflex_count,
		.looks_left = LOOKS_MAX,
		.out = polygon->triangles,
	};
	uint32_t corner = 0, refused_count = 0;

	while (clipping.left_count > 3 && clipping.looks_left > 0) {
		if (is_ear(&clipping, corner)) {
			corner = clip(&clipping, corner);
			/* Skipping one gives rounder triangles than a fan from one corner. */
			corner = polygon->next[corner];
			refused_count = 0;
			if ((clipping.left_count & 15) == 0 || clipping.reflex_count < 16)
				reflex_refresh(&clipping);
			continue;
		}
		corner = polygon->next[corner];
		if (++refused_count < clipping.left_count)
			continue;
		corner = clip(&clipping, least_harm(&clipping, corner));
		refused_count = 0;
		reflex_refresh(&clipping);
	}
	/* One triangle is left, or the looks are spent. */
	while (clipping.left_count >= 3)
		corner = clip(&clipping, corner);
}

const uint32_t *polygon_cut(struct polygon *polygon, uint32_t corner_count)
{
	uint32_t reflex_count = 0;

	CHECK(corner_count >= 3);
	CHECK(corner_count <= polygon->corner_max);
	if (corner_count == 3 || !polygon_flatten(polygon, corner_count)) {
		fan(polygon->triangles, corner_count);
		return polygon->triangles;
	}
	for (uint32_t i = 0; i < corner_count; i++) {
		polygon->previous[i] = i > 0 ? i - 1 : corner_count - 1;
		polygon->next[i] = i + 1 < corner_count ? i + 1 : 0;
	}
	for (uint32_t i = 0; i < corner_count; i++)
		if (!(corner_turn(polygon, i) > 0.0))
			polygon->reflex[reflex_count++] = i;
	if (reflex_count == 0)
		fan(polygon->triangles, corner_count);
	else
		polygon_clip(polygon, corner_count, reflex_count);
	return polygon->triangles;
}
