/* SPDX-License-Identifier: MIT */
#include "tools/bench/accuracy/explain.h"

#include <math.h>

/** Depths this much apart, relative, are the same: a float has 24 bits, interpolation costs some. */
#define DEPTH_TIE 1e-6

/* A vertex as the eye sees it: to the right, up, and forward. */
struct seen {
	double x, y, w;
};

static struct seen see(const struct camera_view *view, const double point[3])
{
	struct seen seen = { 0.0, 0.0, 0.0 };

	for (int k = 0; k < 3; k++) {
		double from_eye = point[k] - view->eye[k];

		seen.x += view->right[k] * from_eye;
		seen.y += view->up[k] * from_eye;
		seen.w += view->forward[k] * from_eye;
	}
	return seen;
}

static double focal_pixels(const struct explain *explain)
{
	return 0.5 * explain->height / explain->view->tan_half_y;
}

/* Moves the end that is before the near plane onto it.  False: all of the edge is before it. */
static bool cut_near(struct seen *a, struct seen *b, double near)
{
	struct seen *out = a->w < b->w ? a : b;
	struct seen *in = a->w < b->w ? b : a;
	double t;

	if (in->w <= near)
		return false;
	if (out->w < near) {
		t = (near - out->w) / (in->w - out->w);
		out->x += t * (in->x - out->x);
		out->y += t * (in->y - out->y);
		out->w = near;
	}
	return true;
}

/* Is the pixel's centre, in pixels from the middle of the picture, near an edge? */
static bool is_near_edge(const struct explain *explain, struct seen a, struct seen b, double x,
			 double y)
{
	double focal = focal_pixels(explain);
	double dx;
	double dy;
	double t;
	double w;
	double slant;
	double allowed;

	if (!cut_near(&a, &b, 0.5 * explain->view->near))
		return false;
	a.x *= focal / a.w;
	a.y *= focal / a.w;
	b.x *= focal / b.w;
	b.y *= focal / b.w;
	dx = b.x - a.x;
	dy = b.y - a.y;
	t = dx * dx + dy * dy > 0.0 ? ((x - a.x) * dx + (y - a.y) * dy) / (dx * dx + dy * dy) : 0.0;
	t = fmin(1.0, fmax(0.0, t));
	/* The nearer of the depths around: a vertex there moves the edge most. */
	w = 1.0 / ((1.0 - t) / a.w + t / b.w);
	slant = 1.0 + (x * x + y * y) / (focal * focal);
	allowed = explain->pixels + explain->error / w * focal * slant;
	return hypot(a.x + t * dx - x, a.y + t * dy - y) <= allowed;
}

/* Depth along the view of a triangle's plane in a direction; not finite: edge-on. */
static double plane_depth(const struct seen v[3], double ray_x, double ray_y, double *ret_slope)
{
	double e1[3] = { v[1].x - v[0].x, v[1].y - v[0].y, v[1].w - v[0].w };
	double e2[3] = { v[2].x - v[0].x, v[2].y - v[0].y, v[2].w - v[0].w };
	double n[3] = { e1[1] * e2[2] - e1[2] * e2[1], e1[2] * e2[0] - e1[0] * e2[2],
			e1[0] * e2[1] - e1[1] * e2[0] };
	double along = n[0] * ray_x + n[1] * ray_y + n[2];

	/* How much depth a unit of the normal is worth. */
	*ret_slope = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]) / fabs(along);
	return (n[0] * v[0].x + n[1] * v[0].y + n[2] * v[0].w) / along;
}

/* Depth of a triangle in a pixel, and by how much it may be off. */
static double depth_with_doubt(const struct explain *explain, const struct seen v[3], double x,
			       double y, double *ret_doubt)
{
	double focal = focal_pixels(explain);
	double slope;
	double ignored;
	double depth = plane_depth(v, x / focal, y / focal, &slope);
	double doubt = DEPTH_TIE * fabs(depth) + explain->error * slope;

	for (int i = 0; i < 4; i++) {
		double moved_x = x + (i & 1 ? 1.0 : -1.0) * explain->pixels;
		double moved_y = y + (i & 2 ? 1.0 : -1.0) * explain->pixels;
		double moved = plane_depth(v, moved_x / focal, moved_y / focal, &ignored);

		doubt = fmax(doubt, fabs(moved - depth) + explain->error * slope);
	}
	*ret_doubt = doubt;
	return depth;
}

enum explain_reason explain_difference(const struct explain *explain, const double (*a)[3],
				       const double (*b)[3], uint32_t x, uint32_t y)
{
	const double(*triangles[2])[3] = { a, b };
	double centre_x = x + 0.5 - 0.5 * explain->width;
	double centre_y = 0.5 * explain->height - (y + 0.5);
	double depths[2] = { INFINITY, INFINITY };
	double doubts[2] = { 0.0, 0.0 };
	bool is_at_edge = false;

	for (int i = 0; i < 2; i++) {
		struct seen seen[3];

		if (!triangles[i])
			continue;
		for (int c = 0; c < 3; c++)
			seen[c] = see(explain->view, triangles[i][c]);
		for (int c = 0; c < 3; c++)
			is_at_edge = is_at_edge || is_near_edge(explain, seen[c], seen[(c + 1) % 3],
								centre_x, centre_y);
		depths[i] = depth_with_doubt(explain, seen, centre_x, centre_y, &doubts[i]);
		/* Where the near plane cuts it is an edge too; so is all of it, seen edge-on. */
		is_at_edge = is_at_edge || !isfinite(depths[i]) ||
			     fabs(depths[i] - explain->view->near) <= doubts[i];
	}
	if (a && b && fabs(depths[0] - depths[1]) <= DEPTH_TIE * fabs(depths[0]))
		return EXPLAIN_TIE;
	if (is_at_edge || (a && b && fabs(depths[0] - depths[1]) <= doubts[0] + doubts[1]))
		return EXPLAIN_EDGE;
	return EXPLAIN_NONE;
}
