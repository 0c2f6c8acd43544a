/* SPDX-License-Identifier: MIT */
/** ply_mesh.h - for tests of oocgen: its PLY files as arrays, and what is wrong with a mesh. */
#ifndef TESTS_UNIT_PLY_MESH_H
#define TESTS_UNIT_PLY_MESH_H

#include <stdbool.h>
#include <stdint.h>

struct ply_mesh {
	uint32_t vertex_count;
	uint32_t triangle_count;
	bool doubles;
	double (*positions)[3];
	uint32_t (*corners)[3];
};

/** Reads a file of mesh_write_file() to its last byte.  Fails the test on anything else. */
struct ply_mesh ply_mesh_read(const char *path);
void ply_mesh_done(struct ply_mesh *mesh);

/** Faults of a mesh that is to be made of closed solids. */
struct ply_mesh_faults {
	uint32_t open_edges; /* directed edges that are not met by exactly one opposite one */
	uint32_t degenerate; /* triangles of zero area */
	uint32_t duplicates; /* triangles at the same three places as another */
	uint32_t unused;     /* vertices of no triangle */
};

struct ply_mesh_faults ply_mesh_judge(const struct ply_mesh *mesh);

/** The volume that the faces enclose; negative where they are turned inside out. */
double ply_mesh_volume(const struct ply_mesh *mesh);

#endif /* TESTS_UNIT_PLY_MESH_H */
