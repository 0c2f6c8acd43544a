/* SPDX-License-Identifier: MIT */
/**
 * mesh.h - a scene on its way to a PLY or OBJ file, in memory that does not depend on its size.
 *
 * PLY wants the counts first, then all vertices, then all faces.  So a scene is a function that is
 * called three times and says the same each time: once to be counted, once for its vertices, once
 * for its faces.  Nothing of the scene is kept.
 *
 * Rules for what a scene makes:
 *  - it must not depend on the pass, and takes its chances from struct random alone;
 *  - solids are closed, their faces turn counterclockwise seen from outside, vertices are shared
 *    within a solid, and no face has zero area.
 *
 * Threads: one a mesh.  Memory: one out_file buffer and the table of circles, under 1 MiB.
 */
#ifndef TOOLS_GEN_MESH_H
#define TOOLS_GEN_MESH_H

#include <stdbool.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "tools/gen/interrupt.h"
#include "tools/gen/out_file.h"
#include "tools/gen/turn.h"

struct vec3 {
	double x;
	double y;
	double z;
};

/** Where a solid stands: its three axes, perpendicular, of length 1, right-handed. */
struct frame {
	struct vec3 x;
	struct vec3 y;
	struct vec3 z;
	struct vec3 origin;
};

#define FRAME_WORLD ((struct frame){ { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 }, { 0, 0, 0 } })

static inline struct vec3 vec3_add_scaled(struct vec3 a, struct vec3 b, double factor)
{
	return (struct vec3){ a.x + b.x * factor, a.y + b.y * factor, a.z + b.z * factor };
}

static inline struct vec3 frame_point(const struct frame *frame, struct vec3 p)
{
	struct vec3 world = vec3_add_scaled(frame->origin, frame->x, p.x);

	world = vec3_add_scaled(world, frame->y, p.y);
	return vec3_add_scaled(world, frame->z, p.z);
}

/** The frame moved along its own axes. */
struct frame frame_at(const struct frame *frame, double x, double y, double z);
/** The frame turned about its own z axis. */
struct frame frame_turned(const struct frame *frame, struct turn turn);
/** The frame whose z axis is the given one's x (or y) axis: for what lies along it. */
struct frame frame_along_x(const struct frame *frame);
struct frame frame_along_y(const struct frame *frame);

enum mesh_pass {
	MESH_COUNT,
	MESH_VERTICES,
	MESH_FACES,
};

/** Most segments of a circle. */
#define MESH_CIRCLE_MAX 256u

struct mesh {
	enum mesh_pass pass;
	uint64_t vertex_count;   /* so far in this pass */
	uint64_t triangle_count; /* so far in this pass */
	uint64_t first_vertex;   /* of the solid that was begun last */
	uint32_t colour;         /* 0x00BBGGRR of the vertices that follow */
	unsigned level;          /* fineness of what follows, from 0 */
	struct vec3 shift;       /* added to every vertex: where the scene's origin is to lie */
	bool doubles;
	bool colours;
	bool is_obj;
	const struct turn *circles; /* see mesh_circle() */
	struct out_file *out;       /* NULL while counting */
};

/** Did writing fail, or a signal come?  The scene may then end early; nobody will look at it. */
static inline bool mesh_stopped(const struct mesh *mesh)
{
	return interrupted || (mesh->out && mesh->out->error != 0);
}

/** A copy that only counts; what it is told leaves no trace in the file. */
struct mesh mesh_counter(const struct mesh *mesh);

/** The points of a circle of count <= MESH_CIRCLE_MAX segments, from angle 0 on. */
static inline const struct turn *mesh_circle(const struct mesh *mesh, unsigned count)
{
	return mesh->circles + count * (count - 1) / 2;
}

/** Segments that suit a circle of this radius in metres at the mesh's level: even, 4 or more. */
unsigned mesh_segments(const struct mesh *mesh, double radius);

/**
 * Begins a solid of so many vertices and triangles.
 *
 * Returns: whether the caller has to say them; false while counting.
 */
static inline bool mesh_begin(struct mesh *mesh, uint64_t vertex_count, uint64_t triangle_count)
{
	mesh->first_vertex = mesh->vertex_count;
	mesh->vertex_count += vertex_count;
	mesh->triangle_count += triangle_count;
	return mesh->pass != MESH_COUNT;
}

/* Behind the two that follow. */
void mesh_write_vertex(struct mesh *mesh, struct vec3 position);
void mesh_write_triangle(struct mesh *mesh, uint32_t a, uint32_t b, uint32_t c);

static inline void mesh_vertex(struct mesh *mesh, struct vec3 position)
{
	if (mesh->pass == MESH_VERTICES)
		mesh_write_vertex(mesh, position);
}

/** Corners are numbers of vertices within the solid. */
static inline void mesh_triangle(struct mesh *mesh, uint32_t a, uint32_t b, uint32_t c)
{
	if (mesh->pass == MESH_FACES)
		mesh_write_triangle(mesh, a, b, c);
}

/** Four corners, counterclockwise; cut from a to c. */
static inline void mesh_quad(struct mesh *mesh, uint32_t a, uint32_t b, uint32_t c, uint32_t d)
{
	mesh_triangle(mesh, a, b, c);
	mesh_triangle(mesh, a, c, d);
}

/** What follows belongs to a group and is of a material; only OBJ keeps that. */
void mesh_group(struct mesh *mesh, const char *group, const char *material);

/** Says the scene, once a pass. */
typedef void (*mesh_scene_fn)(struct mesh *mesh, void *arg);

struct mesh_file {
	const char *path;        /* "-": standard output */
	const char *description; /* one line for the file's header */
	bool metres;             /* the file says so; else it says nothing of units */
	struct vec3 shift;
	bool doubles;
	bool colours;
	const char *materials; /* an MTL file's name: writes OBJ, always doubles; NULL: PLY */
};

/** What was written. */
struct mesh_count {
	uint64_t vertices;
	uint64_t triangles;
};

/**
 * Writes a scene to a binary little-endian PLY file, or to an OBJ file.
 *
 * ret: may be NULL
 *
 * Returns: 0, -EOVERFLOW when it has more vertices than PLY can number, -ENOMEM, -ECANCELED or
 * -errno; then there is no file, or the one that was there before.
 */
int mesh_write_file(const struct mesh_file *file, mesh_scene_fn scene, void *arg,
		    struct mesh_count *ret, struct why *why);

#endif /* TOOLS_GEN_MESH_H */
