/* SPDX-License-Identifier: MIT */
#include "tools/bench/occupancy.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/store/payload.h"
#include "tools/bench/measure.h"

/** Free voxels around the model. */
#define BORDER_VOXELS 3
/** Points of a triangle are this far apart, in voxels. */
#define SAMPLE_DISTANCE 0.5

/* Chooses axes and the finest voxel that the memory allows. */
static void grid_choose(struct occupancy *occupancy, const struct store_superblock *superblock)
{
	unsigned up = superblock->up_axis == STORE_AXIS_UNKNOWN ? 2 : superblock->up_axis - 1;
	double extent[3];
	double largest = 0.0;

	for (unsigned i = 0; i < 3; i++) {
		unsigned axis = (up + 1 + i) % 3;

		occupancy->world[i] = axis;
		extent[i] = superblock->box_max[axis] - superblock->box_min[axis];
		largest = fmax(largest, extent[i]);
	}
	/* A model that is a point still has a voxel. */
	occupancy->voxel = fmax(largest / 2000.0, 1e-9);
	for (;; occupancy->voxel *= 1.02) {
		uint64_t voxels = 1;

		for (unsigned i = 0; i < 3; i++) {
			occupancy->size[i] =
				(uint32_t)(extent[i] / occupancy->voxel) + 1 + 2 * BORDER_VOXELS;
			voxels *= occupancy->size[i];
		}
		if (voxels <= OCCUPANCY_VOXELS_MAX)
			break;
	}
	for (unsigned i = 0; i < 3; i++)
		occupancy->corner[i] =
			superblock->box_min[occupancy->world[i]] - BORDER_VOXELS * occupancy->voxel;
}

static void point_mark(struct occupancy *occupancy, const double point[3])
{
	uint32_t at[3];

	for (unsigned i = 0; i < 3; i++) {
		double voxels =
			(point[occupancy->world[i]] - occupancy->corner[i]) / occupancy->voxel;

		if (!(voxels >= 0.0 && voxels < occupancy->size[i]))
			return;
		at[i] = (uint32_t)voxels;
	}
	occupancy->full[occupancy_index(occupancy, at[0], at[1], at[2])] = 1;
}

static void triangle_mark(struct occupancy *occupancy, const double corners[3][3])
{
	double longest = 0.0;
	uint32_t steps;

	for (unsigned c = 0; c < 3; c++) {
		const double *a = corners[c];
		const double *b = corners[(c + 1) % 3];
		double squared = 0.0;

		for (unsigned k = 0; k < 3; k++)
			squared += (b[k] - a[k]) * (b[k] - a[k]);
		longest = fmax(longest, sqrt(squared));
	}
	steps = (uint32_t)ceil(longest / (SAMPLE_DISTANCE * occupancy->voxel));
	steps = steps > 0 ? steps : 1;
	for (uint32_t i = 0; i <= steps; i++)
		for (uint32_t j = 0; j <= steps - i; j++) {
			double u = (double)i / steps;
			double v = (double)j / steps;
			double point[3];

			for (unsigned k = 0; k < 3; k++)
				point[k] = corners[0][k] + u * (corners[1][k] - corners[0][k]) +
					   v * (corners[2][k] - corners[0][k]);
			point_mark(occupancy, point);
		}
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
		if (r < 0 || node->first_child != STORE_NODE_NONE || node->payload_id == 0)
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
		   struct occupancy *ret, struct why *why)
{
	const struct store_superblock *superblock = store_superblock(store);
	struct occupancy occupancy = { .full = NULL };
	int r;

	if (superblock->triangle_count == 0)
		return why_set(why, -ENODATA, "the store has no triangles");
	grid_choose(&occupancy, superblock);
	occupancy.full = calloc((size_t)occupancy.size[0] * occupancy.size[1], occupancy.size[2]);
	if (!occupancy.full)
		return why_set(why, -ENOMEM, "out of memory");
	r = leaves_mark(&occupancy, store, nodes, why);
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
	occupancy->full = NULL;
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
