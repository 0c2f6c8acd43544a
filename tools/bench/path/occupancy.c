/* SPDX-License-Identifier: MIT */
#include "tools/bench/path/occupancy.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/store/payload.h"
#include "tools/bench/base/measure.h"

/** Voxels around the region. */
#define BORDER_VOXELS 3
/** Voxels along an edge of a region whose voxel is not given. */
#define SIDE_MAX 2000.0
/** Points of a triangle are this far apart, in voxels. */
#define SAMPLE_DISTANCE 0.5
/** Of a triangle with fewer, looking for what lies outside costs more than it saves. */
#define CLIPPED_STEPS 16u

static void region_whole(const struct occupancy *occupancy,
			 const struct store_superblock *superblock, struct occupancy_region *ret)
{
	*ret = (struct occupancy_region){ .voxel = 0.0 };
	for (unsigned i = 0; i < 3; i++) {
		ret->low[i] = superblock->box_min[occupancy->world[i]];
		ret->high[i] = superblock->box_max[occupancy->world[i]];
	}
}

/* The wanted voxel, or the finest that the memory allows. */
static void grid_choose(struct occupancy *occupancy, const struct occupancy_region *region)
{
	double largest = 0.0;

	for (unsigned i = 0; i < 3; i++)
		largest = fmax(largest, region->high[i] - region->low[i]);
	/* A model that is a point still has a voxel. */
	occupancy->voxel = fmax(fmax(region->voxel, largest / SIDE_MAX), 1e-9);
	for (;; occupancy->voxel *= 1.02) {
		uint64_t voxels = 1;

		for (unsigned i = 0; i < 3; i++) {
			double extent = region->high[i] - region->low[i];

			occupancy->size[i] =
				(uint32_t)(extent / occupancy->voxel) + 1 + 2 * BORDER_VOXELS;
			voxels *= occupancy->size[i];
		}
		if (voxels <= OCCUPANCY_VOXELS_MAX)
			break;
	}
	for (unsigned i = 0; i < 3; i++)
		occupancy->corner[i] = region->low[i] - BORDER_VOXELS * occupancy->voxel;
}

/* Is all of a box, given in the model's axes, outside of the grid? */
static bool box_is_outside(const struct occupancy *occupancy, const double low[3],
			   const double high[3])
{
	for (unsigned i = 0; i < 3; i++) {
		unsigned axis = occupancy->world[i];

		if (high[axis] < occupancy->corner[i] ||
		    low[axis] > occupancy->corner[i] + occupancy->size[i] * occupancy->voxel)
			return true;
	}
	return false;
}

/* The voxel of a point.  Returns: is it in the grid? */
static bool point_find(const struct occupancy *occupancy, const double point[3], uint32_t ret[3])
{
	for (unsigned i = 0; i < 3; i++) {
		double voxels =
			(point[occupancy->world[i]] - occupancy->corner[i]) / occupancy->voxel;

		if (!(voxels >= 0.0 && voxels < occupancy->size[i]))
			return false;
		ret[i] = (uint32_t)voxels;
	}
	return true;
}

/*
 * The part of a row of points, from + v * along, that may be in the grid: v in [*low, *high], which is
 * narrowed.  Returns: is there one?
 */
static bool row_clip(const struct occupancy *occupancy, const double from[3], const double along[3],
		     double *low, double *high)
{
	for (unsigned i = 0; i < 3; i++) {
		unsigned axis = occupancy->world[i];
		double near = occupancy->corner[i] - from[axis];
		double far = near + occupancy->size[i] * occupancy->voxel;

		if (along[axis] == 0.0) {
			if (near > 0.0 || far < 0.0)
				return false;
			continue;
		}
		*low = fmax(*low, fmin(near / along[axis], far / along[axis]));
		*high = fmin(*high, fmax(near / along[axis], far / along[axis]));
	}
	return *low <= *high;
}

/*
 * Marks the voxels of a triangle by points all over it, in rows.  Of a triangle that is far larger than
 * the grid (the ground that a building stands on) nearly all rows and points lie outside.
 */
static void points_mark(struct occupancy *occupancy, const double corners[3][3], uint32_t steps)
{
	double along[3];

	for (unsigned k = 0; k < 3; k++)
		along[k] = corners[2][k] - corners[0][k];
	for (uint32_t i = 0; i <= steps; i++) {
		double u = (double)i / steps;
		double low = 0.0;
		double high = 1.0 - u;
		double from[3];
		uint32_t at[3];

		for (unsigned k = 0; k < 3; k++)
			from[k] = corners[0][k] + u * (corners[1][k] - corners[0][k]);
		if (steps > CLIPPED_STEPS && !row_clip(occupancy, from, along, &low, &high))
			continue;
		/* A point more at either end: rounding takes none that is inside. */
		for (uint32_t j = (uint32_t)fmax(0.0, floor(low * steps) - 1.0);
		     j <= steps - i && j <= high * steps + 1.0; j++) {
			double v = (double)j / steps;
			double point[3];

			for (unsigned k = 0; k < 3; k++)
				point[k] = from[k] + v * along[k];
			if (point_find(occupancy, point, at))
				occupancy->full[occupancy_index(occupancy, at[0], at[1], at[2])] =
					1;
		}
	}
}

static void triangle_mark(struct occupancy *occupancy, const double corners[3][3])
{
	double longest = 0.0;
	double low[3];
	double high[3];
	uint32_t steps;
	uint32_t at[3];

	for (unsigned k = 0; k < 3; k++) {
		low[k] = fmin(corners[0][k], fmin(corners[1][k], corners[2][k]));
		high[k] = fmax(corners[0][k], fmax(corners[1][k], corners[2][k]));
	}
	if (box_is_outside(occupancy, low, high))
		return;
	for (unsigned c = 0; c < 3; c++) {
		const double *a = corners[c];
		const double *b = corners[(c + 1) % 3];
		double squared = 0.0;

		for (unsigned k = 0; k < 3; k++)
			squared += (b[k] - a[k]) * (b[k] - a[k]);
		longest = fmax(longest, sqrt(squared));
	}
	if (point_find(occupancy, corners[0], at))
		occupancy->detail[(size_t)at[1] * occupancy->size[0] + at[0]]++;
	steps = (uint32_t)ceil(longest / (SAMPLE_DISTANCE * occupancy->voxel));
	points_mark(occupancy, corners, steps > 0 ? steps : 1);
}

static void payload_mark(struct occupancy *occupancy, const void *payload)
{
	struct payload_view view;

	payload_view(payload, &view);
	for (uint32_t i = 0; i < view.header->triangle_count; i++) {
		double corners[3][3];

		for (uint32_t c = 0; c < 3; c++)
			payload_position(&view, payload_index(&view, i, c), corners[c]);
		triangle_mark(occupancy, corners);
	}
}

static bool is_needed(const struct occupancy *occupancy, const struct store_node *node)
{
	double low[3];
	double high[3];

	for (unsigned k = 0; k < 3; k++) {
		low[k] = node->box_min[k];
		high[k] = node->box_max[k];
	}
	return node->first_child == STORE_NODE_NONE && node->payload_id != 0 &&
	       !box_is_outside(occupancy, low, high);
}

static int leaves_mark(struct occupancy *occupancy, const struct store_file *store,
		       const struct store_node *nodes, struct why *why)
{
	const struct store_superblock *superblock = store_superblock(store);
	void *payload = malloc(superblock->payload_bytes_max + 1);
	void *scratch = malloc(STORE_PAYLOAD_BYTES_MAX);
	int r = 0;

	if (!payload || !scratch)
		r = why_set(why, -ENOMEM, "out of memory");
	for (uint64_t i = 0; r == 0 && i < superblock->node_count; i++) {
		const struct store_node *node = &nodes[i];

		if (measure_was_cancelled())
			r = why_set(why, -ECANCELED, "interrupted");
		if (r < 0 || !is_needed(occupancy, node))
			continue;
		r = store_read_payload(store, node, payload, scratch, why);
		if (r == 0)
			payload_mark(occupancy, payload);
	}
	free(payload);
	free(scratch);
	return r;
}

int occupancy_make(const struct store_file *store, const struct store_node *nodes,
		   const struct occupancy_region *region, struct occupancy *ret, struct why *why)
{
	const struct store_superblock *superblock = store_superblock(store);
	unsigned up = superblock->up_axis == STORE_AXIS_UNKNOWN ? 2 : superblock->up_axis - 1;
	struct occupancy occupancy = { .full = NULL };
	struct occupancy_region whole;
	int r;

	if (superblock->triangle_count == 0)
		return why_set(why, -ENODATA, "the store has no triangles");
	for (unsigned i = 0; i < 3; i++)
		occupancy.world[i] = (up + 1 + i) % 3;
	if (!region) {
		region_whole(&occupancy, superblock, &whole);
		region = &whole;
	}
	grid_choose(&occupancy, region);
	occupancy.full = calloc((size_t)occupancy.size[0] * occupancy.size[1], occupancy.size[2]);
	occupancy.detail =
		calloc((size_t)occupancy.size[0] * occupancy.size[1], sizeof(*occupancy.detail));
	r = occupancy.full && occupancy.detail ? leaves_mark(&occupancy, store, nodes, why)
					       : why_set(why, -ENOMEM, "out of memory");
	if (r < 0) {
		occupancy_done(&occupancy);
		return r;
	}
	*ret = occupancy;
	return 0;
}

void occupancy_done(struct occupancy *occupancy)
{
	free(occupancy->full);
	free(occupancy->detail);
	occupancy->full = NULL;
	occupancy->detail = NULL;
}

void occupancy_to_world(const struct occupancy *occupancy,
			const struct store_superblock *superblock, const double point[3],
			double ret[3])
{
	for (unsigned i = 0; i < 3; i++) {
		unsigned axis = occupancy->world[i];

		ret[axis] = superblock->origin[axis] + occupancy->corner[i] +
			    point[i] * occupancy->voxel;
	}
}
