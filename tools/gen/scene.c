/* SPDX-License-Identifier: MIT */
#include "tools/gen/scene.h"

#include <math.h>
#include <string.h>

#include "tools/gen/solid.h"

static struct vec3 at(double x, double y, double z)
{
	return (struct vec3){ x, y, z };
}

static struct vec3 random_in(struct random *random, struct vec3 low, struct vec3 high)
{
	double x = random_between(random, low.x, high.x);
	double y = random_between(random, low.y, high.y);

	return at(x, y, random_between(random, low.z, high.z));
}

static uint64_t left(const struct mesh *mesh, const struct scene *scene)
{
	return scene->triangle_count - mesh->triangle_count;
}

static void triangle(struct mesh *mesh, struct vec3 a, struct vec3 b, struct vec3 c)
{
	if (!mesh_begin(mesh, 3, 1))
		return;
	mesh_vertex(mesh, a);
	mesh_vertex(mesh, b);
	mesh_vertex(mesh, c);
	mesh_triangle(mesh, 0, 1, 2);
}

/* Loose triangles in a box, each within a cube of that size; as many as are left. */
static void litter(struct mesh *mesh, const struct scene *scene, struct random *random,
		   const struct vec3 box[2], double size)
{
	for (uint64_t count = left(mesh, scene); count > 0 && !mesh_stopped(mesh); count--) {
		struct vec3 place = random_in(random, box[0], box[1]);
		struct vec3 corners[3];

		for (int i = 0; i < 3; i++)
			corners[i] = vec3_add_scaled(
				place, random_in(random, at(0, 0, 0), at(1, 1, 1)), size);
		triangle(mesh, corners[0], corners[1], corners[2]);
	}
}

static void make_soup(struct mesh *mesh, const struct scene *scene, struct random *random)
{
	const struct vec3 box[2] = { { 0, 0, 0 }, { 100, 100, 100 } };

	mesh->colour = 0x4080c0;
	litter(mesh, scene, random, box, 2);
}

static void make_forest(struct mesh *mesh, const struct scene *scene, struct random *random)
{
	const struct frame world = FRAME_WORLD;
	uint64_t tree_count = 1 + scene->triangle_count / 1000;
	double half = 3 * sqrt((double)tree_count);

	mesh->colour = 0x305030;
	solid_box(mesh, &world, at(-half - 5, -half - 5, -1), at(half + 5, half + 5, 0));
	for (uint64_t tree = 0; tree < tree_count; tree++) {
		struct vec3 foot = random_in(random, at(-half, -half, -0.1), at(half, half, -0.1));
		double height = random_between(random, 4, 9);
		const struct vec3 crown[2] = { { foot.x - 2, foot.y - 2, 0.35 * height },
					       { foot.x + 2, foot.y + 2, height + 1 } };
		struct scene leaves = *scene;

		mesh->colour = 0x304058;
		solid_rod(mesh, &world, foot, at(foot.x, foot.y, height), 0.2);
		mesh->colour = 0x308848;
		/* An even share of what is left; the last tree takes all of it. */
		leaves.triangle_count =
			mesh->triangle_count + left(mesh, scene) / (tree_count - tree);
		litter(mesh, &leaves, random, crown, 0.5);
	}
}

static void make_corridor(struct mesh *mesh, const struct scene *scene, struct random *random)
{
	const struct frame world = FRAME_WORLD;
	uint64_t room_count = 2 + scene->triangle_count / 400;
	double length = 6.0 * (double)room_count;

	mesh->colour = 0x808890;
	solid_box(mesh, &world, at(-0.5, -8, -0.3), at(length + 0.5, 10.5, 0));
	for (uint64_t i = 0; i < room_count && left(mesh, scene) > 200; i++) {
		struct frame bay = frame_at(&world, 6.0 * (double)i, 0, -0.02);

		for (int side = 0; side < 2; side++) {
			struct plate wall = { .width = 5.98, .height = 3, .thickness = 0.2 };
			struct frame upright = frame_at(&bay, 0.01, side ? 2.7 : 0, 0);
			double door = random_between(random, 0.5, 4.2);

			wall.openings[wall.opening_count++] =
				(struct opening){ door, 0, door + 1, 2.2 };
			upright = (struct frame){ upright.x, upright.z, at(0, -1, 0),
						  upright.origin };
			mesh->colour = 0xb0c0c8;
			solid_plate(mesh, &upright, &wall);
			solid_box(mesh, &bay, at(-0.1, side ? 2.5 : -8, 0),
				  at(0.1, side ? 10.5 : -0.05, 3));
			for (int block = 0; block < 3; block++) {
				struct vec3 low = random_in(random, at(0.5, 0.5, 0), at(4, 5.5, 0));

				mesh->colour = (uint32_t)random_next(random) & 0xffffff;
				low.y += side ? 2.7 : -7.5;
				solid_box(mesh, &bay, low,
					  vec3_add_scaled(low,
							  random_in(random, at(0.3, 0.3, 0.3),
								    at(1.4, 1.4, 1.8)),
							  1));
			}
		}
	}
	litter(mesh, scene, random, (const struct vec3[2]){ { 0, -7.5, 0 }, { length, 10, 2.5 } },
	       0.2);
}

static void make_fence(struct mesh *mesh, const struct scene *scene, struct random *random)
{
	const struct frame world = FRAME_WORLD;
	uint64_t picket_count = scene->triangle_count / 40;
	double length = 0.15 * (double)picket_count;
	/* A third is kept for what can be seen behind; a panel has at most 3000. */
	const uint64_t kept = scene->triangle_count / 3 + 3000;

	mesh->colour = 0x6090b0;
	for (uint64_t i = 0; i < picket_count; i++)
		solid_box(mesh, &world, at(0.15 * (double)i, 0, 0),
			  at(0.15 * (double)i + 0.1, 0.03, 2));
	/* 20 m behind it a wall of panels, in each a dozen holes of 2 cm. */
	mesh->colour = 0x9098a0;
	for (double x = 0; x < length && left(mesh, scene) > kept; x += 4.01) {
		struct plate panel = { .width = 4, .height = 4, .thickness = 0.05 };
		struct frame upright = { at(1, 0, 0), at(0, 0, 1), at(0, -1, 0), at(x, 20, 0) };

		for (unsigned hole = 0; hole < PLATE_OPENINGS_MAX; hole++) {
			double left_x = 0.2 + 0.3 * hole;
			double low_y = random_between(random, 0.2, 3.7);

			panel.openings[panel.opening_count++] =
				(struct opening){ left_x, low_y, left_x + 0.02, low_y + 0.02 };
		}
		solid_plate(mesh, &upright, &panel);
	}
	mesh->colour = 0x40a060;
	litter(mesh, scene, random, (const struct vec3[2]){ { 0, 22, 0 }, { length, 40, 4 } }, 0.3);
}

static void make_sheet(struct mesh *mesh, const struct scene *scene, struct random *random)
{
	uint32_t n = (uint32_t)sqrt((double)scene->triangle_count / 4);

	/* Half of it a waved sheet with shared vertices. */
	mesh->colour = 0xa08060;
	if (mesh_begin(mesh, (uint64_t)(n + 1) * (n + 1), 2 * (uint64_t)n * n)) {
		for (uint32_t j = 0; j <= n; j++) {
			for (uint32_t i = 0; i <= n; i++) {
				struct turn a = turn_of(7 * i % n, n);
				struct turn b = turn_of(5 * j % n, n);

				mesh_vertex(mesh, at(100.0 * i / n, 100.0 * j / n,
						     2 * a.sine * b.cosine));
			}
		}
		for (uint32_t j = 0; j < n; j++) {
			for (uint32_t i = 0; i < n; i++) {
				uint32_t a = j * (n + 1) + i;

				mesh_quad(mesh, a, a + 1, a + n + 2, a + n + 1);
			}
		}
	}
	/* One triangle as large as all the rest, above it, and needles through everything. */
	mesh->colour = 0x4040c0;
	triangle(mesh, at(-50, -50, 20), at(250, -50, 20), at(-50, 250, 20));
	mesh->colour = 0x30a0d0;
	for (uint64_t count = left(mesh, scene); count > 0 && !mesh_stopped(mesh); count--) {
		struct vec3 from = random_in(random, at(0, 0, -20), at(100, 100, 20));
		struct vec3 to = random_in(random, at(0, 0, -20), at(100, 100, 20));

		triangle(mesh, from, to, vec3_add_scaled(from, at(0.01, 0.01, 0.01), 1));
	}
}

static void make_sphere(struct mesh *mesh, const struct scene *scene, struct random *random)
{
	/* 2 n (m - 1) triangles in m bands of n, two of them with a pole. */
	uint32_t n = (uint32_t)sqrt((double)scene->triangle_count);
	uint32_t m = (uint32_t)(scene->triangle_count / (2 * (uint64_t)n)) + 1;
	uint32_t last = 1 + (m - 2) * n;

	mesh->colour = (uint32_t)random_next(random) & 0xffffff;
	if (!mesh_begin(mesh, (uint64_t)(m - 1) * n + 2, 2 * (uint64_t)n * (m - 1)))
		return;
	mesh_vertex(mesh, at(0, 0, -10));
	for (uint32_t j = 1; j < m; j++) {
		struct turn up = turn_of(j, 2 * (uint64_t)m);

		for (uint32_t i = 0; i < n; i++) {
			struct turn around = turn_of(i, n);

			mesh_vertex(mesh, at(10 * up.sine * around.cosine,
					     10 * up.sine * around.sine, -10 * up.cosine));
		}
	}
	mesh_vertex(mesh, at(0, 0, 10));
	for (uint32_t i = 0; i < n; i++) {
		uint32_t next = i + 1 < n ? i + 1 : 0;

		mesh_triangle(mesh, 0, 1 + next, 1 + i);
		for (uint32_t j = 0; j + 2 < m; j++)
			mesh_quad(mesh, 1 + j * n + i, 1 + j * n + next, 1 + (j + 1) * n + next,
				  1 + (j + 1) * n + i);
		mesh_triangle(mesh, last + n, last + i, last + next);
	}
}

static void make_coplanar(struct mesh *mesh, const struct scene *scene, struct random *random)
{
	const struct frame world = FRAME_WORLD;
	uint64_t box_count = scene->triangle_count / 20;
	uint32_t edge = (uint32_t)ceil(cbrt((double)box_count));

	/* Unit boxes that touch: every inner face there twice, on a plane that cuts cells. */
	for (uint64_t i = 0; i < box_count; i++) {
		struct vec3 low = at((double)(i % edge), (double)(i / edge % edge),
				     (double)(i / edge / edge));

		mesh->colour = (uint32_t)random_next(random) & 0xffffff;
		solid_box(mesh, &world, low, vec3_add_scaled(low, at(1, 1, 1), 1));
	}
	/* And triangles of all sizes that lie in the same planes. */
	mesh->colour = 0x8080f0;
	for (uint64_t count = left(mesh, scene); count > 0 && !mesh_stopped(mesh); count--) {
		double x = random_below(random, edge + 1);
		double y = random_below(random, edge + 1);
		double z = random_below(random, edge + 1);
		double size = 1 << random_below(random, 4);

		triangle(mesh, at(x, y, z), at(x, y + size, z), at(x, y, z + size));
	}
}

const struct scene_kind scene_kinds[] = {
	{ "soup", "loose triangles, nothing hides much", make_soup },
	{ "forest", "trees of leaves: much is hidden, but by nothing solid", make_forest },
	{ "corridor", "a corridor with doors: a step changes what shows", make_corridor },
	{ "fence", "a picket fence and a wall with pinholes", make_fence },
	{ "sheet", "a waved sheet, one huge triangle, needles", make_sheet },
	{ "sphere", "closed and smooth, half of it always hidden", make_sphere },
	{ "coplanar", "faces in each other, on the borders of cells", make_coplanar },
	{ NULL, NULL, NULL },
};

const struct scene_kind *scene_find(const char *name)
{
	for (const struct scene_kind *kind = scene_kinds; kind->name; kind++) {
		if (strcmp(kind->name, name) == 0)
			return kind;
	}
	return NULL;
}

void scene_make(struct mesh *mesh, void *arg)
{
	const struct scene *scene = arg;
	struct random random = random_stream(scene->seed, 0);

	mesh->level = 1;
	scene->kind->make(mesh, scene, &random);
}
