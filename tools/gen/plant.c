/* SPDX-License-Identifier: MIT */
#include "tools/gen/plant.h"

#include <math.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "tools/gen/bay.h"

/* Rooms = (triangles / ROOM_TRIANGLES) ^ ROOM_GROWTH: rooms become finer as they become more. */
#define ROOM_TRIANGLES     1500.0
#define ROOM_GROWTH        0.705
#define ROOMS_MIN          4.0
#define LEVEL_MAX          160u
#define HEAP_LUMP_MAX      22u
#define LUMP_TRIANGLES_MIN 6u
#define STREAM_PLAN        UINT64_C(1)
#define STREAM_HEAP        UINT64_C(2)

static void plan_lines(struct plant *plant)
{
	struct random random = random_stream(plant->seed, STREAM_PLAN);

	for (unsigned i = 0; i < plant->column_count; i++)
		plant->x[i + 1] = plant->x[i] + random_between(&random, 7.5, 11);
	for (unsigned j = 0; j < plant->row_count; j++)
		plant->y[j + 1] =
			plant->y[j] + (bay_is_corridor(j) ? random_between(&random, 2.8, 3.6)
							  : random_between(&random, 7, 11));
	plant->hall_height = fmax(10, fmin(plant->floor_count, 5) * BAY_FLOOR_HEIGHT + 1.5);
}

static void plan_size(struct plant *plant, double rooms)
{
	double floors = fmin(fmax(round(0.6 * cbrt(rooms)), 1), 40);
	double strips = fmin(fmax(round(sqrt(rooms / floors / 8.3)), 1), PLANT_LINES_MAX / 3);
	double columns = fmin(fmax(round(rooms / floors / strips / 2), 2), PLANT_COLUMNS_MAX);

	plant->floor_count = (unsigned)floors;
	plant->row_count = 3 * (unsigned)strips;
	plant->column_count = (unsigned)columns;
	plan_lines(plant);
}

static uint64_t cell_triangles(const struct mesh *mesh, const struct plant *plant, uint64_t cell,
			       unsigned level)
{
	struct mesh counter = mesh_counter(mesh);

	counter.level = level;
	bay_make(&counter, plant, cell);
	return counter.triangle_count;
}

static uint64_t cells_triangles(const struct mesh *mesh, const struct plant *plant, unsigned level)
{
	uint64_t sum = 0;

	for (uint64_t cell = 0; cell < bay_cell_count(plant) && !interrupted; cell++)
		sum += cell_triangles(mesh, plant, cell, level);
	return sum;
}

/*
 * Finds a plan that is not too big at the coarsest level: fewer rooms, then fewer things in them;
 * then the finest level at which all its cells together are not too many.
 */
static void plan(struct plant *plant, const struct mesh *mesh)
{
	uint64_t target = plant->triangle_count - LUMP_TRIANGLES_MIN;
	double rooms = pow((double)plant->triangle_count / ROOM_TRIANGLES, ROOM_GROWTH);
	unsigned low = 0;
	unsigned high = 1;

	plant->furnishing = 1;
	plan_size(plant, fmax(rooms, ROOMS_MIN));
	while (cells_triangles(mesh, plant, 0) > target) {
		if (rooms > ROOMS_MIN)
			rooms *= 0.8;
		else
			plant->furnishing *= 0.8;
		plan_size(plant, fmax(rooms, ROOMS_MIN));
	}
	while (high < LEVEL_MAX && cells_triangles(mesh, plant, high) <= target) {
		low = high;
		high = high * 2 < LEVEL_MAX ? high * 2 : LEVEL_MAX;
	}
	while (high - low > 1) {
		unsigned middle = (low + high) / 2;

		if (cells_triangles(mesh, plant, middle) <= target)
			low = middle;
		else
			high = middle;
	}
	plant->level = low;
	plant->spare_count = target - cells_triangles(mesh, plant, low);
	CHECK(plant->spare_count <= target || interrupted);
}

void plant_init(struct plant *plant, uint64_t triangle_count, uint64_t seed)
{
	CHECK(triangle_count >= PLANT_TRIANGLES_MIN);
	*plant = (struct plant){ .seed = seed, .triangle_count = triangle_count / 2 * 2 };
}

/* A cone of lumps beside the plant, of exactly so many triangles. */
static void make_heap(struct mesh *mesh, const struct plant *plant, uint64_t triangle_count)
{
	struct random random = random_stream(plant->seed, STREAM_HEAP);
	double radius = 1.5 + 0.3 * cbrt((double)triangle_count);
	struct frame world = FRAME_WORLD;
	struct frame middle = frame_at(&world, plant->x[plant->column_count] + radius + 12,
				       0.3 * plant->y[plant->row_count], -0.4);

	CHECK(triangle_count % 2 == 0 && triangle_count >= LUMP_TRIANGLES_MIN);
	bay_paint_coal(mesh);
	while (triangle_count > 0) {
		double out = sqrt(random_between(&random, 0, 1)) * radius;
		double size = random_between(&random, 0.25, 0.5);
		const struct lathe_point points[] = { { 0, 0 },
						      { size, 0.6 * size },
						      { 0, random_between(&random, 0.9, 1.3) *
								   size } };
		struct frame lump = frame_turned(&middle, turn_random(&random));
		unsigned segments = triangle_count > HEAP_LUMP_MAX ? 5 + random_below(&random, 4)
								   : (unsigned)triangle_count / 2;

		lump = frame_at(&lump, out, 0,
				0.6 * (radius - out) * random_between(&random, 0, 1));
		lump = frame_turned(&lump, turn_random(&random));
		solid_lathe(mesh, &lump, points, 3, segments);
		triangle_count -= 2 * segments;
	}
}

void plant_scene(struct mesh *mesh, void *arg)
{
	struct plant *plant = arg;
	uint64_t taken = 0;
	uint64_t cell_count;

	if (mesh->pass == MESH_COUNT)
		plan(plant, mesh);
	cell_count = bay_cell_count(plant);
	for (uint64_t cell = 0; cell < cell_count && !mesh_stopped(mesh); cell++) {
		uint64_t extra = cell_triangles(mesh, plant, cell, plant->level + 1) -
				 cell_triangles(mesh, plant, cell, plant->level);
		double share = (double)plant->spare_count * (double)(cell + 1) / (double)cell_count;

		mesh->level = plant->level;
		/* The finer cells are spread evenly. */
		if ((double)(taken + extra) <= share) {
			mesh->level++;
			taken += extra;
		}
		bay_make(mesh, plant, cell);
	}
	if (!mesh_stopped(mesh))
		make_heap(mesh, plant, plant->triangle_count - mesh->triangle_count);
}
