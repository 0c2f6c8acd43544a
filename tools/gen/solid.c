/* SPDX-License-Identifier: MIT */
#include "tools/gen/solid.h"

#include <math.h>

#include "formats/base/check.h"

/* Most cells of a plate's grid in each direction. */
#define GRID_CELLS_MAX 48u

static struct vec3 cross(struct vec3 a, struct vec3 b)
{
	return (struct vec3){ a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x };
}

static double dot(struct vec3 a, struct vec3 b)
{
	return a.x * b.x + a.y * b.y + a.z * b.z;
}

static struct vec3 scaled(struct vec3 a, double factor)
{
	return (struct vec3){ a.x * factor, a.y * factor, a.z * factor };
}

static bool too_thin(const struct mesh *mesh, double radius)
{
	return mesh->level == 0 && radius < SOLID_THIN_RADIUS;
}

/* ---- boxes ---- */

void solid_box(struct mesh *mesh, const struct frame *frame, struct vec3 low, struct vec3 high)
{
	/* Corner i has the high x, y, z where i has bit 0, 1, 2. */
	static const uint8_t quads[6][4] = { { 0, 2, 3, 1 }, { 4, 5, 7, 6 }, { 0, 1, 5, 4 },
					     { 2, 6, 7, 3 }, { 0, 4, 6, 2 }, { 1, 3, 7, 5 } };

	if (!mesh_begin(mesh, 8, 12))
		return;
	for (unsigned i = 0; i < 8; i++) {
		struct vec3 corner = { i & 1 ? high.x : low.x, i & 2 ? high.y : low.y,
				       i & 4 ? high.z : low.z };

		mesh_vertex(mesh, frame_point(frame, corner));
	}
	for (unsigned i = 0; i < 6; i++)
		mesh_quad(mesh, quads[i][0], quads[i][1], quads[i][2], quads[i][3]);
}

void solid_block(struct mesh *mesh, const struct frame *frame, double x, double y, double height)
{
	solid_box(mesh, frame, (struct vec3){ -x / 2, -y / 2, 0 },
		  (struct vec3){ x / 2, y / 2, height });
}

/* ---- rings of vertices and what joins them ---- */

static void fan(struct mesh *mesh, uint32_t first, uint32_t count, bool faces_back)
{
	for (uint32_t k = 1; k + 1 < count; k++) {
		if (faces_back)
			mesh_triangle(mesh, first, first + k + 1, first + k);
		else
			mesh_triangle(mesh, first, first + k, first + k + 1);
	}
}

static void join_rings(struct mesh *mesh, uint32_t lower, uint32_t upper, uint32_t count)
{
	for (uint32_t k = 0; k < count; k++) {
		uint32_t next = k + 1 < count ? k + 1 : 0;

		mesh_quad(mesh, lower + k, lower + next, upper + next, upper + k);
	}
}

static void join_pole(struct mesh *mesh, uint32_t pole, uint32_t ring, uint32_t count,
		      bool pole_below)
{
	for (uint32_t k = 0; k < count; k++) {
		uint32_t next = k + 1 < count ? k + 1 : 0;

		if (pole_below)
			mesh_triangle(mesh, pole, ring + next, ring + k);
		else
			mesh_triangle(mesh, pole, ring + k, ring + next);
	}
}

static void ring_vertices(struct mesh *mesh, const struct frame *frame, struct lathe_point point,
			  unsigned segments)
{
	const struct turn *circle = mesh_circle(mesh, segments);

	for (unsigned k = 0; k < segments; k++)
		mesh_vertex(mesh, frame_point(frame, (struct vec3){ point.radius * circle[k].cosine,
								    point.radius * circle[k].sine,
								    point.height }));
}

void solid_lathe(struct mesh *mesh, const struct frame *frame, const struct lathe_point *points,
		 unsigned point_count, unsigned segments)
{
	bool pole_below = points[0].radius == 0;
	bool pole_above = points[point_count - 1].radius == 0;
	uint32_t ring_count = point_count - pole_below - pole_above;
	uint32_t first_ring = pole_below;
	uint32_t last_ring = first_ring + (ring_count - 1) * segments;
	uint32_t cap_triangles =
		(pole_below ? segments : segments - 2) + (pole_above ? segments : segments - 2);

	CHECK(point_count >= 2 && point_count <= LATHE_POINTS_MAX && ring_count >= 1);
	if (!mesh_begin(mesh, ring_count * segments + pole_below + pole_above,
			2 * segments * (ring_count - 1) + cap_triangles))
		return;
	if (mesh->pass == MESH_VERTICES) {
		for (unsigned i = 0; i < point_count; i++)
			ring_vertices(mesh, frame, points[i], points[i].radius == 0 ? 1 : segments);
		return;
	}
	if (pole_below)
		join_pole(mesh, 0, first_ring, segments, true);
	else
		fan(mesh, first_ring, segments, true);
	for (uint32_t i = 0; i + 1 < ring_count; i++)
		join_rings(mesh, first_ring + i * segments, first_ring + (i + 1) * segments,
			   segments);
	if (pole_above)
		join_pole(mesh, last_ring + segments, last_ring, segments, false);
	else
		fan(mesh, last_ring, segments, false);
}

void solid_cylinder(struct mesh *mesh, const struct frame *frame, double radius, double height)
{
	const struct lathe_point points[] = { { radius, 0 }, { radius, height } };

	solid_lathe(mesh, frame, points, 2, mesh_segments(mesh, radius));
}

void solid_bolt(struct mesh *mesh, const struct frame *frame, double radius, double height)
{
	const struct lathe_point points[] = { { radius, 0 }, { radius, height } };

	solid_lathe(mesh, frame, points, 2, 6);
}

void solid_torus(struct mesh *mesh, const struct frame *frame, double radius, double tube_radius)
{
	unsigned around = mesh_segments(mesh, radius);
	unsigned across = mesh_segments(mesh, tube_radius);
	const struct turn *circle = mesh_circle(mesh, across);

	if (too_thin(mesh, tube_radius))
		return;
	if (!mesh_begin(mesh, (uint64_t)around * across, 2 * (uint64_t)around * across))
		return;
	for (unsigned i = 0; i < across; i++) {
		struct lathe_point point = { radius + tube_radius * circle[i].cosine,
					     tube_radius * circle[i].sine };

		ring_vertices(mesh, frame, point, around);
	}
	for (unsigned i = 0; i < across; i++)
		join_rings(mesh, i * around, (i + 1 < across ? i + 1 : 0) * around, around);
}

/* ---- outlines ---- */

void outline_circle(const struct mesh *mesh, double radius, struct outline *ret)
{
	const struct turn *circle;

	ret->point_count = mesh_segments(mesh, radius);
	ret->cap = NULL;
	circle = mesh_circle(mesh, ret->point_count);
	for (unsigned k = 0; k < ret->point_count; k++)
		ret->points[k] = (struct outline_point){ radius * circle[k].cosine,
							 radius * circle[k].sine };
}

void outline_rectangle(double width, double height, struct outline *ret)
{
	double x = width / 2;
	double y = height / 2;

	ret->point_count = 4;
	ret->cap = NULL;
	ret->points[0] = (struct outline_point){ -x, -y };
	ret->points[1] = (struct outline_point){ x, -y };
	ret->points[2] = (struct outline_point){ x, y };
	ret->points[3] = (struct outline_point){ -x, y };
}

void outline_beam(double width, double height, double thickness, struct outline *ret)
{
	static const uint8_t cap[10][3] = { { 0, 1, 2 }, { 0, 2, 3 },  { 0, 3, 10 }, { 0, 10, 11 },
					    { 3, 4, 9 }, { 3, 9, 10 }, { 6, 7, 8 },  { 6, 8, 9 },
					    { 6, 9, 4 }, { 6, 4, 5 } };
	const double x = width / 2;
	const double y = height / 2;
	const double flange = y - thickness;
	const double web = thickness / 2;
	const struct outline_point points[12] = {
		{ -x, -y },      { x, -y },        { x, -flange },    { web, -flange },
		{ web, flange }, { x, flange },    { x, y },          { -x, y },
		{ -x, flange },  { -web, flange }, { -web, -flange }, { -x, -flange },
	};

	ret->point_count = 12;
	ret->cap = cap;
	memcpy(ret->points, points, sizeof(points));
}

void outline_channel(double width, double height, double thickness, struct outline *ret)
{
	static const uint8_t cap[6][3] = { { 0, 1, 4 }, { 0, 4, 5 }, { 1, 2, 3 },
					   { 1, 3, 4 }, { 0, 5, 6 }, { 0, 6, 7 } };
	const double x = width / 2;
	const double inner = x - thickness;
	const struct outline_point points[8] = {
		{ -x, 0 },
		{ x, 0 },
		{ x, height },
		{ inner, height },
		{ inner, thickness },
		{ -inner, thickness },
		{ -inner, height },
		{ -x, height },
	};

	ret->point_count = 8;
	ret->cap = cap;
	memcpy(ret->points, points, sizeof(points));
}

/* ---- sweeps ---- */

/* A sweep at one place of its path: outline x and y lie along across and up. */
struct sweep {
	struct mesh *mesh;
	const struct frame *frame;
	const struct outline *outline;
	struct vec3 across;
	struct vec3 up;
};

static struct vec3 direction(struct vec3 from, struct vec3 to, double *ret_length)
{
	struct vec3 along = vec3_add_scaled(to, from, -1);
	double length = sqrt(dot(along, along));

	CHECK(length > 0);
	*ret_length = length;
	return scaled(along, 1 / length);
}

static void sweep_turn_upright(struct sweep *sweep, struct vec3 along)
{
	const struct vec3 z = { 0, 0, 1 };
	struct vec3 level = cross(z, along);
	double length = sqrt(dot(level, level));

	sweep->across = length > 1e-6 ? scaled(level, 1 / length) : (struct vec3){ 1, 0, 0 };
	sweep->up = cross(along, sweep->across);
}

static void sweep_ring(const struct sweep *sweep, struct vec3 centre)
{
	for (unsigned k = 0; k < sweep->outline->point_count; k++) {
		struct vec3 p = vec3_add_scaled(centre, sweep->across, sweep->outline->points[k].x);

		p = vec3_add_scaled(p, sweep->up, sweep->outline->points[k].y);
		mesh_vertex(sweep->mesh, frame_point(sweep->frame, p));
	}
}

/* The axis turned as far as one quarter turn's part takes `from` towards `to`. */
static struct vec3 turned(struct vec3 axis, struct vec3 from, struct vec3 to, struct turn turn)
{
	double a = dot(axis, from);
	double b = dot(axis, to);
	struct vec3 still = vec3_add_scaled(vec3_add_scaled(axis, from, -a), to, -b);

	still = vec3_add_scaled(still, from, a * turn.cosine - b * turn.sine);
	return vec3_add_scaled(still, to, a * turn.sine + b * turn.cosine);
}

static void sweep_bend(struct sweep *sweep, const struct vec3 *corner, double radius,
		       unsigned steps)
{
	struct vec3 before_across = sweep->across;
	struct vec3 before_up = sweep->up;
	double length_in;
	double length_out;
	struct vec3 in = direction(corner[-1], corner[0], &length_in);
	struct vec3 out = direction(corner[0], corner[1], &length_out);
	const struct turn *circle = mesh_circle(sweep->mesh, 4 * steps);
	struct vec3 centre;

	CHECK(fabs(dot(in, out)) < 1e-6);
	/* Bends at both ends of a leg must leave a piece of it straight. */
	radius = fmin(radius, 0.45 * fmin(length_in, length_out));
	centre = vec3_add_scaled(vec3_add_scaled(corner[0], in, -radius), out, radius);
	for (unsigned k = 0; k <= steps; k++) {
		struct vec3 p = vec3_add_scaled(centre, out, -radius * circle[k].cosine);

		sweep->across = turned(before_across, in, out, circle[k]);
		sweep->up = turned(before_up, in, out, circle[k]);
		sweep_ring(sweep, vec3_add_scaled(p, in, radius * circle[k].sine));
	}
}

static void sweep_cap(struct mesh *mesh, const struct outline *outline, uint32_t first, bool back)
{
	if (!outline->cap) {
		fan(mesh, first, outline->point_count, back);
		return;
	}
	for (unsigned i = 0; i + 2 < outline->point_count; i++) {
		const uint8_t *t = outline->cap[i];

		mesh_triangle(mesh, first + t[0], first + t[back ? 2 : 1], first + t[back ? 1 : 2]);
	}
}

void solid_sweep(struct mesh *mesh, const struct frame *frame, const struct outline *outline,
		 const struct vec3 *path, unsigned point_count, double bend_radius)
{
	struct sweep sweep = { .mesh = mesh, .frame = frame, .outline = outline };
	uint32_t points = outline->point_count;
	uint32_t corner_count = point_count - 2;
	unsigned steps = 1 + mesh->level / 3;
	uint32_t ring_count;
	double length;

	CHECK(point_count >= 2);
	if (steps > MESH_CIRCLE_MAX / 4)
		steps = MESH_CIRCLE_MAX / 4;
	ring_count = 2 + corner_count * (steps + 1);
	if (!mesh_begin(mesh, (uint64_t)ring_count * points,
			2 * (uint64_t)(ring_count - 1) * points + 2 * (points - 2)))
		return;
	if (mesh->pass == MESH_VERTICES) {
		sweep_turn_upright(&sweep, direction(path[0], path[1], &length));
		sweep_ring(&sweep, path[0]);
		for (unsigned i = 1; i + 1 < point_count; i++)
			sweep_bend(&sweep, &path[i], bend_radius, steps);
		sweep_ring(&sweep, path[point_count - 1]);
		return;
	}
	sweep_cap(mesh, outline, 0, true);
	for (uint32_t i = 0; i + 1 < ring_count; i++)
		join_rings(mesh, i * points, (i + 1) * points, points);
	sweep_cap(mesh, outline, (ring_count - 1) * points, false);
}

void solid_rod(struct mesh *mesh, const struct frame *frame, struct vec3 from, struct vec3 to,
	       double radius)
{
	const struct vec3 path[2] = { from, to };
	struct outline outline;

	if (too_thin(mesh, radius))
		return;
	outline_circle(mesh, radius, &outline);
	solid_sweep(mesh, frame, &outline, path, 2, 0);
}

/* ---- plates ---- */

/* A plate cut into cells, some of them empty. */
struct grid {
	unsigned columns;
	unsigned rows;
	double thickness;
	double x[GRID_CELLS_MAX + 1];
	double y[GRID_CELLS_MAX + 1];
	bool empty[GRID_CELLS_MAX][GRID_CELLS_MAX]; /* [row][column] */
};

static bool grid_full(const struct grid *grid, unsigned row, unsigned column)
{
	/* Numbers below 0 wrap and are out of range too. */
	return row < grid->rows && column < grid->columns && !grid->empty[row][column];
}

/* Numbers the corners that some full cell has; a corner's upper vertex follows its lower one. */
static uint32_t grid_number_corners(const struct grid *grid,
				    uint32_t corners[GRID_CELLS_MAX + 1][GRID_CELLS_MAX + 1])
{
	uint32_t count = 0;

	for (unsigned j = 0; j <= grid->rows; j++) {
		for (unsigned i = 0; i <= grid->columns; i++) {
			if (grid_full(grid, j, i) || grid_full(grid, j - 1, i) ||
			    grid_full(grid, j, i - 1) || grid_full(grid, j - 1, i - 1)) {
				corners[j][i] = count;
				count += 2;
			} else {
				corners[j][i] = UINT32_MAX;
			}
		}
	}
	return count;
}

static uint32_t grid_count_quads(const struct grid *grid)
{
	uint32_t count = 0;

	for (unsigned j = 0; j < grid->rows; j++) {
		for (unsigned i = 0; i < grid->columns; i++) {
			if (grid_full(grid, j, i))
				count += 2u + !grid_full(grid, j, i - 1) +
					 !grid_full(grid, j, i + 1) + !grid_full(grid, j - 1, i) +
					 !grid_full(grid, j + 1, i);
		}
	}
	return count;
}

static void grid_cell_faces(struct mesh *mesh, const struct grid *grid, unsigned j, unsigned i,
			    uint32_t corners[GRID_CELLS_MAX + 1][GRID_CELLS_MAX + 1])
{
	uint32_t a = corners[j][i];
	uint32_t b = corners[j][i + 1];
	uint32_t c = corners[j + 1][i + 1];
	uint32_t d = corners[j + 1][i];

	mesh_quad(mesh, a, d, c, b);
	mesh_quad(mesh, a + 1, b + 1, c + 1, d + 1);
	if (!grid_full(grid, j, i - 1))
		mesh_quad(mesh, a, a + 1, d + 1, d);
	if (!grid_full(grid, j, i + 1))
		mesh_quad(mesh, b, c, c + 1, b + 1);
	if (!grid_full(grid, j - 1, i))
		mesh_quad(mesh, a, b, b + 1, a + 1);
	if (!grid_full(grid, j + 1, i))
		mesh_quad(mesh, d, d + 1, c + 1, c);
}

static void grid_solid(struct mesh *mesh, const struct frame *frame, const struct grid *grid)
{
	uint32_t corners[GRID_CELLS_MAX + 1][GRID_CELLS_MAX + 1];
	uint32_t vertex_count = grid_number_corners(grid, corners);

	if (!mesh_begin(mesh, vertex_count, 2 * (uint64_t)grid_count_quads(grid)))
		return;
	for (unsigned j = 0; j <= grid->rows; j++) {
		for (unsigned i = 0; i <= grid->columns; i++) {
			struct vec3 p = { grid->x[i], grid->y[j], 0 };

			if (corners[j][i] == UINT32_MAX)
				continue;
			mesh_vertex(mesh, frame_point(frame, p));
			p.z = grid->thickness;
			mesh_vertex(mesh, frame_point(frame, p));
		}
	}
	for (unsigned j = 0; j < grid->rows; j++) {
		for (unsigned i = 0; i < grid->columns; i++) {
			if (grid_full(grid, j, i))
				grid_cell_faces(mesh, grid, j, i, corners);
		}
	}
}

/* Adds a cut between 0 and the last one, in order, unless it is there. */
static void add_cut(double *cuts, unsigned *cell_count, double cut)
{
	unsigned i = 0;

	while (cuts[i] < cut)
		i++;
	if (cuts[i] == cut)
		return;
	CHECK(*cell_count < GRID_CELLS_MAX);
	memmove(&cuts[i + 1], &cuts[i], (*cell_count - i + 1) * sizeof(*cuts));
	cuts[i] = cut;
	(*cell_count)++;
}

void solid_plate(struct mesh *mesh, const struct frame *frame, const struct plate *plate)
{
	struct grid grid = { .columns = 1, .rows = 1, .thickness = plate->thickness };

	grid.x[1] = plate->width;
	grid.y[1] = plate->height;
	for (unsigned i = 0; i < plate->opening_count; i++) {
		const struct opening *o = &plate->openings[i];

		CHECK(o->low_x >= 0 && o->low_y >= 0 && o->high_x <= plate->width &&
		      o->high_y <= plate->height);
		add_cut(grid.x, &grid.columns, o->low_x);
		add_cut(grid.x, &grid.columns, o->high_x);
		add_cut(grid.y, &grid.rows, o->low_y);
		add_cut(grid.y, &grid.rows, o->high_y);
	}
	for (unsigned i = 0; i < plate->opening_count; i++) {
		const struct opening *o = &plate->openings[i];

		for (unsigned row = 0; row < grid.rows; row++) {
			for (unsigned column = 0; column < grid.columns; column++)
				grid.empty[row][column] |=
					grid.x[column] >= o->low_x && grid.x[column] < o->high_x &&
					grid.y[row] >= o->low_y && grid.y[row] < o->high_y;
		}
	}
	grid_solid(mesh, frame, &grid);
}

/* Cuts a length into so many holes with bars between and around them. */
static void cut_bars(double *cuts, double length, unsigned hole_count)
{
	const double bar_share = 0.25;
	double pitch = length / (hole_count + bar_share);

	for (unsigned i = 0; i <= hole_count; i++) {
		cuts[2 * i] = i * pitch;
		cuts[2 * i + 1] = (i + bar_share) * pitch;
	}
}

void solid_grating(struct mesh *mesh, const struct frame *frame, struct vec3 size, unsigned columns,
		   unsigned rows)
{
	struct grid grid = { .columns = 2 * columns + 1,
			     .rows = 2 * rows + 1,
			     .thickness = size.z };

	CHECK(grid.columns <= GRID_CELLS_MAX && grid.rows <= GRID_CELLS_MAX);
	cut_bars(grid.x, size.x, columns);
	cut_bars(grid.y, size.y, rows);
	for (unsigned row = 1; row < grid.rows; row += 2) {
		for (unsigned column = 1; column < grid.columns; column += 2)
			grid.empty[row][column] = true;
	}
	grid_solid(mesh, frame, &grid);
}
