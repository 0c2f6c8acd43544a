/* SPDX-License-Identifier: MIT */
#include "tools/gen/mesh.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>

#include "formats/base/check.h"

struct frame frame_at(const struct frame *frame, double x, double y, double z)
{
	struct frame moved = *frame;

	moved.origin = frame_point(frame, (struct vec3){ x, y, z });
	return moved;
}

struct frame frame_turned(const struct frame *frame, struct turn turn)
{
	const struct vec3 zero = { 0, 0, 0 };
	struct frame turned = *frame;

	turned.x = vec3_add_scaled(zero, frame->x, turn.cosine);
	turned.x = vec3_add_scaled(turned.x, frame->y, turn.sine);
	turned.y = vec3_add_scaled(zero, frame->x, -turn.sine);
	turned.y = vec3_add_scaled(turned.y, frame->y, turn.cosine);
	return turned;
}

struct frame frame_along_x(const struct frame *frame)
{
	return (struct frame){ frame->y, frame->z, frame->x, frame->origin };
}

struct frame frame_along_y(const struct frame *frame)
{
	return (struct frame){ frame->z, frame->x, frame->y, frame->origin };
}

struct mesh mesh_counter(const struct mesh *mesh)
{
	struct mesh counter = *mesh;

	counter.pass = MESH_COUNT;
	counter.vertex_count = 0;
	counter.triangle_count = 0;
	counter.out = NULL;
	return counter;
}

unsigned mesh_segments(const struct mesh *mesh, double radius)
{
	double segments = 4 + mesh->level * (0.5 + 2.2 * sqrt(radius));

	return (unsigned)fmin(fmax(segments / 2, 2), MESH_CIRCLE_MAX / 2) * 2;
}

void mesh_group(struct mesh *mesh, const char *group, const char *material)
{
	if (mesh->is_obj && mesh->pass == MESH_FACES)
		out_file_printf(mesh->out, "g %s\nusemtl %s\n", group, material);
}

static void write_ply_vertex(struct mesh *mesh, const double xyz[3])
{
	const float floats[3] = { (float)xyz[0], (float)xyz[1], (float)xyz[2] };
	size_t position_bytes = 3 * (mesh->doubles ? sizeof(double) : sizeof(float));
	uint8_t *room = out_file_room(mesh->out, position_bytes + (mesh->colours ? 3 : 0));

	memcpy(room, mesh->doubles ? (const void *)xyz : (const void *)floats, position_bytes);
	if (mesh->colours)
		memcpy(room + position_bytes, &mesh->colour, 3);
}

void mesh_write_vertex(struct mesh *mesh, struct vec3 position)
{
	const double xyz[3] = { position.x + mesh->shift.x, position.y + mesh->shift.y,
				position.z + mesh->shift.z };

	if (mesh->is_obj)
		out_file_printf(mesh->out, "v %.9g %.9g %.9g\n", xyz[0], xyz[1], xyz[2]);
	else
		write_ply_vertex(mesh, xyz);
}

void mesh_write_triangle(struct mesh *mesh, uint32_t a, uint32_t b, uint32_t c)
{
	uint32_t first = (uint32_t)mesh->first_vertex;
	const uint32_t corners[3] = { first + a, first + b, first + c };
	uint8_t *room;

	if (mesh->is_obj) {
		out_file_printf(mesh->out, "f %" PRIu32 " %" PRIu32 " %" PRIu32 "\n",
				corners[0] + 1, corners[1] + 1, corners[2] + 1);
		return;
	}
	room = out_file_room(mesh->out, 1 + sizeof(corners));
	room[0] = 3;
	memcpy(room + 1, corners, sizeof(corners));
}

static struct turn *circles_create(void)
{
	struct turn *circles =
		malloc((MESH_CIRCLE_MAX + 1) * MESH_CIRCLE_MAX / 2 * sizeof(*circles));

	if (!circles)
		return NULL;
	for (uint32_t count = 1, i = 0; count <= MESH_CIRCLE_MAX; count++) {
		for (uint32_t k = 0; k < count; k++)
			circles[i++] = turn_of(k, count);
	}
	return circles;
}

static void write_ply_header(const struct mesh *counted, const struct mesh_file *file)
{
	const char *real = counted->doubles ? "double" : "float";

	out_file_printf(counted->out,
			"ply\nformat binary_little_endian 1.0\n"
			"comment made by oocgen " OOCD_VERSION ": %s\n"
			"%scomment up z\n"
			"element vertex %" PRIu64 "\n"
			"property %s x\nproperty %s y\nproperty %s z\n",
			file->description, file->metres ? "comment unit metres\n" : "",
			counted->vertex_count, real, real, real);
	if (counted->colours)
		out_file_printf(counted->out, "property uchar red\nproperty uchar green\n"
					      "property uchar blue\n");
	out_file_printf(counted->out,
			"element face %" PRIu64 "\n"
			"property list uchar %s vertex_indices\nend_header\n",
			counted->triangle_count,
			counted->vertex_count <= INT32_MAX ? "int" : "uint");
}

int mesh_write_file(const struct mesh_file *file, mesh_scene_fn scene, void *arg,
		    struct mesh_count *ret, struct why *why)
{
	struct turn *circles = circles_create();
	struct mesh counted = { .pass = MESH_COUNT,
				.shift = file->shift,
				.doubles = file->doubles,
				.colours = file->colours,
				.is_obj = file->materials != NULL,
				.circles = circles };
	struct out_file out;
	int r;

	if (!circles)
		return why_set(why, -ENOMEM, "out of memory");
	scene(&counted, arg);
	if (interrupted) {
		free(circles);
		return why_set(why, -ECANCELED, "%s: interrupted, nothing was kept", file->path);
	}
	if (counted.vertex_count > UINT32_MAX) {
		free(circles);
		return why_set(why, -EOVERFLOW,
			       "%s: %" PRIu64 " vertices are more than PLY can number (2^32 - 1); "
			       "ask for fewer triangles",
			       file->path, counted.vertex_count);
	}

	r = out_file_open(&out, file->path, why);
	if (r < 0) {
		free(circles);
		return r;
	}
	counted.out = &out;
	if (counted.is_obj)
		out_file_printf(&out, "# made by oocgen " OOCD_VERSION ": %s\nmtllib %s\n",
				file->description, file->materials);
	else
		write_ply_header(&counted, file);
	for (enum mesh_pass pass = MESH_VERTICES; pass <= MESH_FACES; pass++) {
		struct mesh mesh = counted;

		mesh.pass = pass;
		mesh.vertex_count = 0;
		mesh.triangle_count = 0;
		scene(&mesh, arg);
		if (mesh_stopped(&mesh))
			break;
		CHECK(mesh.vertex_count == counted.vertex_count);
		CHECK(mesh.triangle_count == counted.triangle_count);
	}
	r = out_file_commit(&out, why);
	if (r == 0 && ret)
		*ret = (struct mesh_count){ counted.vertex_count, counted.triangle_count };
	out_file_done(&out);
	free(circles);
	return r;
}
