/* SPDX-License-Identifier: MIT */
/* Goal: the procedural scenes are what they promise: exact counts, closed solids, the same bytes. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "tests/helper.h"
#include "tests/unit/ply_mesh.h"
#include "tools/gen/plant.h"
#include "tools/gen/scene.h"
#include "tools/gen/solid.h"

static void write_file(const struct mesh_file *file, mesh_scene_fn scene, void *arg)
{
	struct why why;

	if (mesh_write_file(file, scene, arg, NULL, &why) < 0)
		fail_msg("%s", why.text);
}

static void write_plant(const char *path, uint64_t triangle_count, uint64_t seed)
{
	const struct mesh_file file = { .path = path, .description = "test", .colours = true };
	static struct plant plant;

	plant_init(&plant, triangle_count, seed);
	write_file(&file, plant_scene, &plant);
}

static bool same_bytes(const char *a, const char *b)
{
	size_t a_bytes, b_bytes;
	void *a_data = test_file_read(a, &a_bytes);
	void *b_data = test_file_read(b, &b_bytes);
	bool same = a_bytes == b_bytes && memcmp(a_data, b_data, a_bytes) == 0;

	free(a_data);
	free(b_data);
	return same;
}

static void assert_closed(const struct ply_mesh *mesh)
{
	struct ply_mesh_faults faults = ply_mesh_judge(mesh);

	assert_int_equal(faults.open_edges, 0);
	assert_int_equal(faults.degenerate, 0);
	assert_int_equal(faults.duplicates, 0);
	assert_int_equal(faults.unused, 0);
	assert_true(ply_mesh_volume(mesh) > 0);
}

/* ---- solids ---- */

/* One of each, at different levels, with the volume that it has to have at infinite level. */
static void solid_scene(struct mesh *mesh, void *arg)
{
	static const struct lathe_point spindle[] = { { 0, 0 }, { 1, 1 }, { 0, 2 } };
	static const struct vec3 path[] = { { 0, 0, 0 }, { 5, 0, 0 }, { 5, 5, 0 }, { 5, 5, 5 } };
	struct frame frame = FRAME_WORLD;
	struct frame tilted = frame_along_y(&frame);
	struct plate plate = { 4, 3, 0.5, 2, { { 1, 0, 2, 2 }, { 2.5, 1, 3, 2 } } };
	struct outline outline;

	mesh->level = 8;
	switch (*(const int *)arg) {
	case 0:
		solid_box(mesh, &tilted, (struct vec3){ 0, 0, 0 }, (struct vec3){ 1, 2, 3 });
		break;
	case 1:
		solid_lathe(mesh, &tilted, spindle, 3, 200);
		break;
	case 2:
		solid_cylinder(mesh, &tilted, 1, 2);
		break;
	case 3:
		solid_torus(mesh, &tilted, 3, 1);
		break;
	case 4:
		solid_plate(mesh, &tilted, &plate);
		break;
	case 5:
		solid_grating(mesh, &tilted, (struct vec3){ 4.25, 4.25, 1 }, 4, 4);
		break;
	case 6:
		outline_beam(2, 2, 0.5, &outline);
		solid_sweep(mesh, &tilted, &outline, path, 2, 0);
		break;
	case 7:
		outline_channel(2, 1, 0.25, &outline);
		solid_sweep(mesh, &tilted, &outline, path, 2, 0);
		break;
	case 8:
		outline_rectangle(1, 1, &outline);
		solid_sweep(mesh, &tilted, &outline, path, 4, 1);
		break;
	}
}

static void each_solid_is_closed_and_has_its_volume(void **state)
{
	/* Round ones by the polygon that their circle is; the swept bends by Pappus, nearly. */
	static const double volumes[] = { 6,      2.0943951, 6.2831853, 59.217626, 4.75,
					  9.0625, 12.5,      4.375,     14.141593 };
	const char *path = test_path(*state, "solid.ply");

	for (int i = 0; i < (int)ARRAY_LENGTH(volumes); i++) {
		const struct mesh_file file = { .path = path, .description = "test" };
		struct ply_mesh mesh;

		write_file(&file, solid_scene, &i);
		mesh = ply_mesh_read(path);
		assert_closed(&mesh);
		print_message("solid %d: %g of %g\n", i, ply_mesh_volume(&mesh), volumes[i]);
		assert_true(fabs(ply_mesh_volume(&mesh) / volumes[i] - 1) < 0.04);
		ply_mesh_done(&mesh);
	}
}

static void angles_are_exact_where_they_can_be(void **state)
{
	(void)state;
	for (unsigned k = 0; k < 1000; k++) {
		struct turn turn = turn_of(k, 1000);

		assert_true(fabs(turn.cosine - cos(2 * M_PI * k / 1000)) < 1e-14);
		assert_true(fabs(turn.sine - sin(2 * M_PI * k / 1000)) < 1e-14);
	}
	assert_true(turn_of(1, 4).cosine == 0 && turn_of(1, 4).sine == 1);
	assert_true(turn_of(1, 2).cosine == -1 && turn_of(1, 2).sine == 0);
	assert_true(turn_of(3, 4).cosine == 0 && turn_of(3, 4).sine == -1);
}

/* ---- the plant ---- */

static void a_plant_has_the_triangles_that_were_asked_for(void **state)
{
	static const uint64_t counts[] = { 10000, 10001, 12346, 33333, 99998, 150000, 400000 };
	const char *path = test_path(*state, "plant.ply");

	for (uint64_t i = 0; i < 3 * ARRAY_LENGTH(counts); i++) {
		uint64_t count = counts[i / 3];
		struct ply_mesh mesh;

		write_plant(path, count, i);
		mesh = ply_mesh_read(path);
		assert_int_equal(mesh.triangle_count, count / 2 * 2);
		ply_mesh_done(&mesh);
	}
}

static void a_plant_is_made_of_closed_solids(void **state)
{
	static const uint64_t counts[] = { 10000, 60000, 300000 };
	const char *path = test_path(*state, "plant.ply");

	for (uint64_t i = 0; i < ARRAY_LENGTH(counts); i++) {
		struct ply_mesh mesh;

		write_plant(path, counts[i], 7 + i);
		mesh = ply_mesh_read(path);
		assert_closed(&mesh);
		ply_mesh_done(&mesh);
	}
}

static void the_same_seed_makes_the_same_plant(void **state)
{
	char *first = strdup(test_path(*state, "first.ply"));
	const char *second = test_path(*state, "second.ply");

	write_plant(first, 50000, 3);
	write_plant(second, 50000, 3);
	assert_true(same_bytes(first, second));
	write_plant(second, 50000, 4);
	assert_false(same_bytes(first, second));
	free(first);
}

/* A triangle that lies across an axis, as its plane sees it. */
struct flat {
	unsigned facing; /* axis and direction */
	double plane;
	double corners[3][2]; /* counterclockwise */
};

static bool flat_of(const struct ply_mesh *mesh, uint32_t triangle, struct flat *ret)
{
	const uint32_t *c = mesh->corners[triangle];

	for (unsigned axis = 0; axis < 3; axis++) {
		double e[2][2];

		if (fabs(mesh->positions[c[1]][axis] - mesh->positions[c[0]][axis]) > 1e-5 ||
		    fabs(mesh->positions[c[2]][axis] - mesh->positions[c[0]][axis]) > 1e-5)
			continue;
		*ret = (struct flat){ 2 * axis, mesh->positions[c[0]][axis], { { 0 } } };
		for (unsigned i = 0; i < 3; i++)
			for (unsigned k = 0; k < 2; k++)
				ret->corners[i][k] = mesh->positions[c[i]][(axis + 1 + k) % 3];
		for (unsigned i = 0; i < 2; i++)
			for (unsigned k = 0; k < 2; k++)
				e[i][k] = ret->corners[i + 1][k] - ret->corners[0][k];
		if (e[0][0] * e[1][1] < e[0][1] * e[1][0]) {
			double corner[2] = { ret->corners[1][0], ret->corners[1][1] };

			memcpy(ret->corners[1], ret->corners[2], sizeof(corner));
			memcpy(ret->corners[2], corner, sizeof(corner));
			ret->facing++;
		}
		return true;
	}
	return false;
}

static int flat_compare(const void *left, const void *right)
{
	const struct flat *a = left;
	const struct flat *b = right;

	if (a->facing != b->facing)
		return a->facing < b->facing ? -1 : 1;
	return (a->plane > b->plane) - (a->plane < b->plane);
}

/* Lies the middle of a, at least a millimetre inside, in b? */
static bool flat_middle_is_in(const struct flat *a, const struct flat *b)
{
	const double(*p)[2] = a->corners;
	double x = (p[0][0] + p[1][0] + p[2][0]) / 3;
	double y = (p[0][1] + p[1][1] + p[2][1]) / 3;

	for (unsigned i = 0; i < 3; i++) {
		const double *from = b->corners[i];
		const double *to = b->corners[(i + 1) % 3];
		double dx = to[0] - from[0];
		double dy = to[1] - from[1];

		if (dx * (y - from[1]) - dy * (x - from[0]) < 1e-3 * hypot(dx, dy))
			return false;
	}
	return true;
}

/* Faces of one solid do not overlap; those of two that do would be drawn in any order. */
static void a_plants_faces_do_not_lie_in_each_other(void **state)
{
	const char *path = test_path(*state, "plant.ply");
	uint32_t overlaps = 0;
	uint32_t count = 0;
	struct ply_mesh mesh;
	struct flat *flats;

	write_plant(path, 100000, 1);
	mesh = ply_mesh_read(path);
	flats = malloc(mesh.triangle_count * sizeof(*flats));
	assert_non_null(flats);
	for (uint32_t i = 0; i < mesh.triangle_count; i++)
		count += flat_of(&mesh, i, &flats[count]);
	qsort(flats, count, sizeof(*flats), flat_compare);
	for (uint32_t i = 0; i < count; i++)
		for (uint32_t j = i + 1; j < count && flats[j].facing == flats[i].facing &&
					 flats[j].plane - flats[i].plane < 1e-3;
		     j++)
			overlaps += flat_middle_is_in(&flats[i], &flats[j]) ||
				    flat_middle_is_in(&flats[j], &flats[i]);
	print_message("%u of %u flat triangles overlap\n", overlaps, count);
	/* Pipes and what hangs from ceilings may meet by chance. */
	assert_true(overlaps < 4);
	free(flats);
	ply_mesh_done(&mesh);
}

/* ---- scenes ---- */

/* FNV-1a of what follows the header, which has our version in it. */
static uint64_t file_hash(const char *path)
{
	uint64_t hash = UINT64_C(0xcbf29ce484222325);
	size_t size_bytes;
	uint8_t *bytes = test_file_read(path, &size_bytes);
	uint8_t *body = memmem(bytes, size_bytes, "end_header\n", 11);

	assert_non_null(body);
	for (size_t i = (size_t)(body - bytes); i < size_bytes; i++)
		hash = (hash ^ bytes[i]) * UINT64_C(0x100000001b3);
	free(bytes);
	return hash;
}

static void write_scene(const char *path, struct scene *scene, struct vec3 shift)
{
	const struct mesh_file file = {
		.path = path, .description = "test", .shift = shift, .doubles = shift.x != 0
	};

	write_file(&file, scene_make, scene);
}

static void each_scene_has_the_triangles_that_were_asked_for(void **state)
{
	static const uint64_t counts[] = { SCENE_TRIANGLES_MIN, 1000, 1237, 20000 };
	const char *path = test_path(*state, "scene.ply");
	const struct vec3 nowhere = { 0, 0, 0 };

	for (const struct scene_kind *kind = scene_kinds; kind->name; kind++) {
		for (size_t i = 0; i < ARRAY_LENGTH(counts); i++) {
			struct scene scene = { kind, counts[i], i };
			struct ply_mesh mesh;

			print_message("%s of %d\n", kind->name, (int)counts[i]);
			write_scene(path, &scene, nowhere);
			mesh = ply_mesh_read(path);
			assert_int_equal(ply_mesh_judge(&mesh).degenerate, 0);
			if (strcmp(kind->name, "sphere") == 0) {
				assert_closed(&mesh);
				assert_in_range(mesh.triangle_count,
						counts[i] - (uint64_t)(2 * sqrt((double)counts[i])),
						counts[i]);
			} else {
				assert_int_equal(mesh.triangle_count, counts[i]);
			}
			ply_mesh_done(&mesh);
		}
	}
	assert_null(scene_find("nothing"));
}

/* Compilers may evaluate arguments in any order, and C libraries differ in the last bit of sin(). */
static void every_compiler_makes_the_same_bytes(void **state)
{
	const char *path = test_path(*state, "scene.ply");
	uint64_t hash;

	write_plant(path, 300000, 1);
	hash = file_hash(path);
	for (const struct scene_kind *kind = scene_kinds; kind->name; kind++) {
		struct scene scene = { kind, 3000, 1 };

		write_scene(path, &scene, (struct vec3){ 0, 0, 0 });
		hash = hash * 31 + file_hash(path);
	}
	/* Whoever changes a scene changes this number with it. */
	assert_int_equal(hash, UINT64_C(0xb89652b746205745));
}

static void coplanar_faces_lie_in_each_other(void **state)
{
	const char *path = test_path(*state, "scene.ply");
	struct scene scene = { scene_find("coplanar"), 5000, 1 };
	struct ply_mesh mesh;

	write_scene(path, &scene, (struct vec3){ 0, 0, 0 });
	mesh = ply_mesh_read(path);
	assert_true(ply_mesh_judge(&mesh).duplicates > 500);
	ply_mesh_done(&mesh);
}

static void an_origin_moves_a_scene_without_loss(void **state)
{
	const char *path = test_path(*state, "scene.ply");
	const struct vec3 far = { 1e7, -2e7, 3e7 };
	struct scene scene = { scene_find("corridor"), 3000, 5 };
	struct ply_mesh here, there;

	write_scene(path, &scene, (struct vec3){ 0, 0, 0 });
	here = ply_mesh_read(path);
	write_scene(path, &scene, far);
	there = ply_mesh_read(path);
	assert_true(there.doubles && !here.doubles);
	assert_int_equal(here.vertex_count, there.vertex_count);
	for (uint32_t i = 0; i < here.vertex_count; i++) {
		/* The nearest float, of a place that the double has to 2^-28. */
		assert_true(fabs(there.positions[i][0] - far.x - here.positions[i][0]) < 1e-4);
		assert_true(fabs(there.positions[i][1] - far.y - here.positions[i][1]) < 1e-4);
		assert_true(fabs(there.positions[i][2] - far.z - here.positions[i][2]) < 1e-4);
	}
	ply_mesh_done(&here);
	ply_mesh_done(&there);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(each_solid_is_closed_and_has_its_volume,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test(angles_are_exact_where_they_can_be),
		cmocka_unit_test_setup_teardown(a_plant_has_the_triangles_that_were_asked_for,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(a_plant_is_made_of_closed_solids, test_folder_setup,
						test_folder_teardown),
		cmocka_unit_test_setup_teardown(the_same_seed_makes_the_same_plant,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(a_plants_faces_do_not_lie_in_each_other,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(each_scene_has_the_triangles_that_were_asked_for,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(every_compiler_makes_the_same_bytes,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(coplanar_faces_lie_in_each_other, test_folder_setup,
						test_folder_teardown),
		cmocka_unit_test_setup_teardown(an_origin_moves_a_scene_without_loss,
						test_folder_setup, test_folder_teardown),
	};

	return TEST_RUN(tests);
}
