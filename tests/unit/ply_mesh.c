/* SPDX-License-Identifier: MIT */
#include "tests/unit/ply_mesh.h"

#include <inttypes.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "tests/helper.h"

static const char end_of_header[] = "end_header\n";

struct ply_mesh ply_mesh_read(const char *path)
{
	size_t file_bytes;
	char *file = test_file_read(path, &file_bytes);
	char *end = memmem(file, file_bytes, end_of_header, strlen(end_of_header));
	struct ply_mesh mesh = { 0 };
	size_t position_bytes, stride;
	const char *at;

	assert_non_null(end);
	*end = '\0';
	assert_int_equal(sscanf(strstr(file, "element vertex"), "element vertex %" SCNu32,
				&mesh.vertex_count),
			 1);
	assert_int_equal(
		sscanf(strstr(file, "element face"), "element face %" SCNu32, &mesh.triangle_count),
		1);
	mesh.doubles = strstr(file, "double x") != NULL;
	position_bytes = mesh.doubles ? sizeof(double) : sizeof(float);
	stride = 3 * position_bytes + (strstr(file, "uchar red") ? 3 : 0);
	at = end + strlen(end_of_header);
	assert_int_equal((size_t)(at - file) + stride * mesh.vertex_count +
				 13 * (size_t)mesh.triangle_count,
			 file_bytes);

	mesh.positions = calloc(mesh.vertex_count, sizeof(*mesh.positions));
	mesh.corners = calloc(mesh.triangle_count, sizeof(*mesh.corners));
	assert_true(mesh.positions && mesh.corners);
	for (uint32_t i = 0; i < mesh.vertex_count; i++, at += stride) {
		float floats[3];

		memcpy(mesh.doubles ? (void *)mesh.positions[i] : (void *)floats, at,
		       3 * position_bytes);
		for (int k = 0; k < 3 && !mesh.doubles; k++)
			mesh.positions[i][k] = (double)floats[k];
	}
	for (uint32_t i = 0; i < mesh.triangle_count; i++, at += 13) {
		assert_int_equal(*at, 3);
		memcpy(mesh.corners[i], at + 1, sizeof(mesh.corners[i]));
		for (int k = 0; k < 3; k++)
			assert_true(mesh.corners[i][k] < mesh.vertex_count);
	}
	free(file);
	return mesh;
}

void ply_mesh_done(struct ply_mesh *mesh)
{
	free(mesh->positions);
	free(mesh->corners);
	*mesh = (struct ply_mesh){ 0 };
}

/* Twice the area, as a vector. */
static void cross_product(const struct ply_mesh *mesh, uint32_t triangle, double ret[3])
{
	const uint32_t *c = mesh->corners[triangle];
	double u[3], v[3];

	for (int k = 0; k < 3; k++) {
		u[k] = mesh->positions[c[1]][k] - mesh->positions[c[0]][k];
		v[k] = mesh->positions[c[2]][k] - mesh->positions[c[0]][k];
	}
	for (int k = 0; k < 3; k++)
		ret[k] = u[(k + 1) % 3] * v[(k + 2) % 3] - u[(k + 2) % 3] * v[(k + 1) % 3];
}

static int compare_edges(const void *a, const void *b)
{
	uint64_t x = *(const uint64_t *)a;
	uint64_t y = *(const uint64_t *)b;

	return (x > y) - (x < y);
}

/* Every directed edge once, and its opposite once: two equal sorted lists without repetitions. */
static uint32_t count_open_edges(const struct ply_mesh *mesh)
{
	size_t count = 3 * (size_t)mesh->triangle_count;
	uint64_t *edges = calloc(count, sizeof(*edges));
	uint64_t *opposite = calloc(count, sizeof(*opposite));
	uint32_t open = 0;

	assert_true(edges && opposite);
	for (size_t i = 0; i < count; i++) {
		const uint32_t *c = mesh->corners[i / 3];
		uint64_t from = c[i % 3], to = c[(i + 1) % 3];

		edges[i] = from << 32 | to;
		opposite[i] = to << 32 | from;
	}
	qsort(edges, count, sizeof(*edges), compare_edges);
	qsort(opposite, count, sizeof(*opposite), compare_edges);
	for (size_t i = 0; i < count; i++)
		open += edges[i] != opposite[i] || (i > 0 && edges[i] == edges[i - 1]);
	free(edges);
	free(opposite);
	return open;
}

static int compare_points(const void *a, const void *b)
{
	return memcmp(a, b, 3 * sizeof(double));
}

/* A triangle by its places, in an order of its own. */
struct placed {
	double points[3][3];
};

static int compare_placed(const void *a, const void *b)
{
	return memcmp(a, b, sizeof(struct placed));
}

static uint32_t count_duplicates(const struct ply_mesh *mesh)
{
	struct placed *placed = calloc(mesh->triangle_count, sizeof(*placed));
	uint32_t duplicates = 0;

	assert_non_null(placed);
	for (uint32_t i = 0; i < mesh->triangle_count; i++) {
		for (int corner = 0; corner < 3; corner++)
			for (int k = 0; k < 3; k++)
				/* + 0.0: so that -0 and 0 are one place. */
				placed[i].points[corner][k] =
					mesh->positions[mesh->corners[i][corner]][k] + 0.0;
		qsort(placed[i].points, 3, sizeof(placed[i].points[0]), compare_points);
	}
	qsort(placed, mesh->triangle_count, sizeof(*placed), compare_placed);
	for (uint32_t i = 1; i < mesh->triangle_count; i++)
		duplicates += compare_placed(&placed[i - 1], &placed[i]) == 0;
	free(placed);
	return duplicates;
}

struct ply_mesh_faults ply_mesh_judge(const struct ply_mesh *mesh)
{
	struct ply_mesh_faults faults = { .open_edges = count_open_edges(mesh),
					  .duplicates = count_duplicates(mesh) };
	bool *used = calloc(mesh->vertex_count, sizeof(*used));

	assert_non_null(used);
	for (uint32_t i = 0; i < mesh->triangle_count; i++) {
		double cross[3];

		cross_product(mesh, i, cross);
		faults.degenerate += cross[0] == 0 && cross[1] == 0 && cross[2] == 0;
		for (int k = 0; k < 3; k++)
			used[mesh->corners[i][k]] = true;
	}
	for (uint32_t i = 0; i < mesh->vertex_count; i++)
		faults.unused += !used[i];
	free(used);
	return faults;
}

double ply_mesh_volume(const struct ply_mesh *mesh)
{
	double volume = 0;

	for (uint32_t i = 0; i < mesh->triangle_count; i++) {
		const double *corner = mesh->positions[mesh->corners[i][0]];
		double cross[3];

		cross_product(mesh, i, cross);
		volume += (corner[0] * cross[0] + corner[1] * cross[1] + corner[2] * cross[2]) / 6;
	}
	return volume;
}
