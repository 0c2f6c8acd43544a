/* SPDX-License-Identifier: MIT */
#include "libclient/select/coverage.h"

#include <math.h>

/**
 * Triangles that lie in a box at random would catch the light with 1.  Surfaces do not overlap as
 * chance would have it; 2 was best or close to it in three models (README.md).
 */
#define CATCHES 2.0f
/** A box is close where its farthest corner is so much farther than its nearest. */
#define CLOSE_RATIO 2.0f
/** Rays through the part of the picture that a close box covers, along each axis. */
#define CLOSE_RAYS 4
/** What divides is not less, so that nothing flat or far becomes infinite. */
#define LEAST 1e-30f

/* fminf() and fmaxf() are calls, for the sake of values that are not numbers; there are none here. */
static inline float lesser(float a, float b)
{
	return a < b ? a : b;
}

static inline float greater(float a, float b)
{
	return a > b ? a : b;
}

/* The direction from the eye to a place of the picture, in squares; along the view it has length 1. */
static void direction_of(const struct coverage *coverage, float x, float y, double ret[3])
{
	const struct camera_view *view = coverage->view;
	double right = (x - 0.5 * COVERAGE_WIDTH) / coverage->scale[0];
	double up = (y - 0.5 * COVERAGE_HEIGHT) / coverage->scale[1];

	for (unsigned k = 0; k < 3; k++)
		ret[k] = view->forward[k] + right * view->right[k] + up * view->up[k];
}

void coverage_begin(struct coverage *coverage, const struct camera_view *view)
{
	coverage->view = view;
	coverage->scale[0] = 0.5f * COVERAGE_WIDTH / (float)view->tan_half_x;
	coverage->scale[1] = 0.5f * COVERAGE_HEIGHT / (float)view->tan_half_y;
	for (unsigned y = 0; y < COVERAGE_HEIGHT; y++)
		for (unsigned x = 0; x < COVERAGE_WIDTH; x++)
			coverage->through[y][x] = 1.0f;
	for (unsigned y = 0; y < COVERAGE_HEIGHT / COVERAGE_PART; y++)
		for (unsigned x = 0; x < COVERAGE_WIDTH / COVERAGE_PART; x++) {
			double direction[3];

			direction_of(coverage, ((float)x + 0.5f) * COVERAGE_PART,
				     ((float)y + 0.5f) * COVERAGE_PART, direction);
			hiding_direction_set(&coverage->along[y][x], direction);
		}
}

/* ---- boxes in the picture ---- */

/* The range of a box in the picture, in squares from its middle. */
struct range {
	float low[2];
	float high[2];
};

static void range_add(struct range *range, const struct coverage *coverage, const float at[3])
{
	float reciprocal = 1.0f / at[2];

	for (unsigned axis = 0; axis < 2; axis++) {
		float place = at[axis] * reciprocal * coverage->scale[axis];

		range->low[axis] = lesser(range->low[axis], place);
		range->high[axis] = greater(range->high[axis], place);
	}
}

/* The corners of a box along the axes of the camera, counted from the eye. */
static void corners_set(const struct camera_view *view, const struct bounds *bounds,
			float ret[8][3])
{
	const double *const axes[3] = { view->right, view->up, view->forward };

	for (unsigned axis = 0; axis < 3; axis++) {
		double middle = 0.0;
		float reach[3];

		for (unsigned k = 0; k < 3; k++) {
			middle += axes[axis][k] * (bounds->centre[k] - view->eye[k]);
			reach[k] = (float)axes[axis][k] * bounds->half[k];
		}
		for (unsigned corner = 0; corner < 8; corner++)
			ret[corner][axis] = (float)middle + (corner & 1 ? reach[0] : -reach[0]) +
					    (corner & 2 ? reach[1] : -reach[1]) +
					    (corner & 4 ? reach[2] : -reach[2]);
	}
}

/* Where the edges of a box between corners behind the near plane and others meet it. */
static void range_add_cut(struct range *range, const struct coverage *coverage,
			  const float corners[8][3], unsigned behind)
{
	float near = (float)coverage->view->near;

	for (unsigned from = 0; from < 8; from++)
		for (unsigned axis = 0; axis < 3; axis++) {
			unsigned to = from ^ 1u << axis;
			float at[3] = { 0.0f, 0.0f, near };
			float t;

			if (!(behind >> from & 1) || behind >> to & 1)
				continue;
			t = (near - corners[from][2]) / (corners[to][2] - corners[from][2]);
			for (unsigned k = 0; k < 2; k++)
				at[k] = corners[from][k] + t * (corners[to][k] - corners[from][k]);
			range_add(range, coverage, at);
		}
}

/*
 * Returns: is the box so close that its near side looks much larger than its far one, or the near
 * plane cuts it?
 */
static bool range_of(const struct coverage *coverage, const struct bounds *bounds,
		     struct range *ret)
{
	float corners[8][3];
	float nearest = INFINITY;
	float farthest = 0.0f;
	unsigned behind = 0;

	*ret = (struct range){ { INFINITY, INFINITY }, { -INFINITY, -INFINITY } };
	corners_set(coverage->view, bounds, corners);
	for (unsigned corner = 0; corner < 8; corner++) {
		nearest = lesser(nearest, corners[corner][2]);
		farthest = greater(farthest, corners[corner][2]);
		if (corners[corner][2] > (float)coverage->view->near)
			range_add(ret, coverage, corners[corner]);
		else
			behind |= 1u << corner;
	}
	if (behind != 0)
		range_add_cut(ret, coverage, (const float(*)[3])corners, behind);
	return behind != 0 || farthest > CLOSE_RATIO * nearest;
}

/* The squares that a range touches, and the area of its part in the picture. */
struct footprint {
	unsigned x0, y0, x1, y1; /* inclusive */
	float square_count;
	float area;
	float whole_area; /* with what is beside the picture */
};

static float clamped(float value, float most)
{
	return lesser(greater(value, 0.0f), most);
}

static void footprint_set(struct footprint *ret, const struct range *range)
{
	const float most[2] = { COVERAGE_WIDTH, COVERAGE_HEIGHT };
	float low[2];
	float high[2];

	for (unsigned axis = 0; axis < 2; axis++) {
		low[axis] = clamped(range->low[axis] + 0.5f * most[axis], most[axis]);
		high[axis] = clamped(range->high[axis] + 0.5f * most[axis], most[axis]);
	}
	ret->x0 = (unsigned)lesser(low[0], most[0] - 1.0f);
	ret->y0 = (unsigned)lesser(low[1], most[1] - 1.0f);
	ret->x1 = (unsigned)lesser(high[0], most[0] - 1.0f);
	ret->y1 = (unsigned)lesser(high[1], most[1] - 1.0f);
	ret->square_count = (float)((ret->x1 + 1 - ret->x0) * (ret->y1 + 1 - ret->y0));
	ret->area = (high[0] - low[0]) * (high[1] - low[1]);
	ret->whole_area =
		(range->high[0] - range->low[0]) * (range->high[1] - range->low[1]) + LEAST;
}

/* ---- what a box catches ---- */

/*
 * 1 - exp(-depth) to 1e-3, by the four operations alone: what the library's exp() rounds to is not
 * the same on all machines, and the order of nodes has to be.
 */
static float caught(float depth)
{
	return 1.0f - 1.0f / (1.0f + depth * (1.0f + depth * (0.48f + depth * 0.235f)));
}

/* The way of a ray inside a box. */
static float way_inside(const struct coverage *coverage, const struct bounds *bounds, float x,
			float y)
{
	const struct camera_view *view = coverage->view;
	double direction[3];
	double length2 = 0.0;
	double begin = 0.0;
	double end = INFINITY;

	direction_of(coverage, x, y, direction);
	for (unsigned k = 0; k < 3; k++) {
		double middle = bounds->centre[k] - view->eye[k];
		double t0 = (middle - bounds->half[k]) / direction[k];
		double t1 = (middle + bounds->half[k]) / direction[k];

		length2 += direction[k] * direction[k];

		begin = fmax(begin, fmin(t0, t1));
		end = fmin(end, fmax(t0, t1));
	}
	return end > begin ? (float)((end - begin) * sqrt(length2)) : 0.0f;
}

/*
 * The share of the light in the squares of a footprint that a box around the eye, or close to it,
 * catches: the area is spread in it evenly, and rays say how long their way through it is.
 */
static float share_of_close(const struct coverage *coverage, const struct bounds *bounds,
			    const struct footprint *footprint, float area)
{
	float volume = 8.0f * bounds->half[0] * bounds->half[1] * bounds->half[2] + LEAST;
	float width = (float)(footprint->x1 + 1 - footprint->x0) / CLOSE_RAYS;
	float height = (float)(footprint->y1 + 1 - footprint->y0) / CLOSE_RAYS;
	float sum = 0.0f;

	for (unsigned i = 0; i < CLOSE_RAYS * CLOSE_RAYS; i++) {
		float x = (float)footprint->x0 + ((float)(i % CLOSE_RAYS) + 0.5f) * width;
		float y = (float)footprint->y0 + ((float)(i / CLOSE_RAYS) + 0.5f) * height;
		float way = way_inside(coverage, bounds, x, y);

		sum += caught(CATCHES * area * way / volume);
	}
	return sum / (CLOSE_RAYS * CLOSE_RAYS);
}

/* The same of a box before the eye, of the light in its rectangle; its section fills a part of that. */
static float share_of_distant(const struct coverage *coverage, const struct bounds *bounds,
			      const struct footprint *footprint, float area)
{
	double distance2 = 0.0;
	double section = 0.0;
	float squares;

	for (unsigned k = 0; k < 3; k++) {
		double from_eye = bounds->centre[k] - coverage->view->eye[k];

		distance2 += from_eye * from_eye;
		section += fabs(from_eye) * bounds->half[(k + 1) % 3] * bounds->half[(k + 2) % 3];
	}
	section = 4.0 * section / sqrt(distance2) + (double)LEAST;
	squares = (float)(section / distance2) * coverage->scale[0] * coverage->scale[1];
	return caught(CATCHES * area / (float)section) *
	       lesser(1.0f, squares / footprint->whole_area);
}

float coverage_add(struct coverage *coverage, const struct hiding *hiding,
		   const struct bounds *bounds, uint32_t leaf)
{
	double edge = ldexp(hiding->places->superblock->root_size, -hiding->nodes[leaf].level);
	struct footprint footprint;
	struct range range;
	bool is_close = range_of(coverage, bounds, &range);
	float sum = 0.0f;
	float share;
	float stays;
	float area;

	footprint_set(&footprint, &range);
	area = (float)(edge * edge) *
	       hiding_depth(hiding, leaf,
			    &coverage->along[(footprint.y0 + footprint.y1) / (2 * COVERAGE_PART)]
					    [(footprint.x0 + footprint.x1) / (2 * COVERAGE_PART)]);
	if (is_close) {
		footprint.area = footprint.square_count;
		share = share_of_close(coverage, bounds, &footprint, area);
	} else {
		share = share_of_distant(coverage, bounds, &footprint, area);
	}
	stays = 1.0f - share * lesser(1.0f, footprint.area / footprint.square_count);
	for (unsigned y = footprint.y0; y <= footprint.y1; y++)
		for (unsigned x = footprint.x0; x <= footprint.x1; x++) {
			sum += coverage->through[y][x];
			coverage->through[y][x] *= stays;
		}
	return share * footprint.area * sum / footprint.square_count;
}
