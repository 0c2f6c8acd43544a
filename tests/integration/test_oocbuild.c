/* SPDX-License-Identifier: MIT */
/*
 * Goal: oocbuild makes the store that it was asked for, of any input, and says what it did.
 */
#include <math.h>
#include <sched.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "tests/helper.h"
#include "tests/integration/models.h"
#include "tools/build/overlap.h"

/** More than one bucket of triangles. */
#define PLANT_TRIANGLES 300000

static void make_plant(const char *folder, unsigned triangle_count)
{
	assert_int_equal(test_command(NULL, 0,
				      "\"$OOCD_BIN\"/oocgen plant --triangles %u --seed 3 -o "
				      "%s/plant.ply",
				      triangle_count, folder),
			 0);
}

static void verify(const char *folder, const char *store)
{
	char said[4096];

	if (test_command(said, sizeof(said), "\"$OOCD_BIN\"/oocctl verify %s/%s", folder, store) !=
	    0)
		fail_msg("%s", said);
}

/* ---- the same bytes ---- */

static void the_bytes_depend_on_neither_jobs_nor_memory(void **state)
{
	static const char *const looks[] = {
		"",
		"--layout replicate --codec meshopt+zstd",
		"--error 0 --normals oct16 --keep-ids",
	};
	/* Sanitizers look for what threads and little memory do; the other ways are the same code. */
	static const char *const ways[] = {
		"--jobs 2 --memory 1G",   "--jobs 5 --memory 150M",
#ifndef OOCD_SANITIZED
		"--jobs 1 --memory 150M", "--jobs 2 --memory 200M", "--jobs 5 --memory 2G",
#endif
	};

	make_plant(*state, PLANT_TRIANGLES);
	for (size_t look = 0; look < ARRAY_LENGTH(looks); look++) {
		for (size_t way = 0; way < ARRAY_LENGTH(ways); way++) {
			char arguments[256];

			(void)snprintf(arguments, sizeof(arguments), "-o %s.ooc %s %s plant.ply",
				       way == 0 ? "first" : "other", looks[look], ways[way]);
			model_build(*state, arguments);
			assert_true(model_told("buckets") >= 2);
			if (way > 0)
				test_assert_same_files(test_path(*state, "first.ooc"),
						       test_path(*state, "other.ooc"));
		}
		verify(*state, "other.ooc");
	}
	assert_string_equal(test_folder_list(*state), "first.ooc other.ooc plant.ply ");
}

static void scratch_changes_nothing_and_leaves_nothing(void **state)
{
	make_plant(*state, PLANT_TRIANGLES);
	model_build(*state, "-o first.ooc --memory 1G plant.ply");
	assert_int_equal(model_told("scratch_bytes"), 0);
	model_build(*state, "-o other.ooc --memory 96M plant.ply");
	assert_true(model_told("scratch_bytes") > 1e6);
	test_assert_same_files(test_path(*state, "first.ooc"), test_path(*state, "other.ooc"));
	assert_string_equal(test_folder_list(*state), "first.ooc other.ooc plant.ply ");
}

/* Sanitizers have memory of their own. */
#ifndef OOCD_SANITIZED
static void memory_stays_within_its_bound(void **state)
{
	static const unsigned bounds_mib[] = { 96, 160, 256 };

	make_plant(*state, 1500000);
	for (size_t i = 0; i < ARRAY_LENGTH(bounds_mib); i++) {
		char arguments[128];

		(void)snprintf(arguments, sizeof(arguments), "-o s.ooc --memory %uM plant.ply",
			       bounds_mib[i]);
		model_build(*state, arguments);
		assert_true(model_told("peak_rss_bytes") <= bounds_mib[i] * 1048576.0);
	}
	model_build_fails(*state, "-o s.ooc --memory 20M plant.ply", "--memory 20M is too little");
}
#endif

/* ---- positions and normals ---- */

/* Every triangle's corners are where the input has them, within the error that is told. */
static void assert_near_input(const char *path, const double *corners, double error)
{
	struct model_store store;
	uint64_t seen = 0;

	model_store_open(path, &store);
	for (uint32_t node = 0; node < store.superblock->node_count; node++) {
		if (!model_store_read(&store, node))
			continue;
		for (uint32_t i = 0; i < store.view.header->triangle_count; i++) {
			const double *from = corners + store.view.triangle_ids[i] * 9;
			double least = INFINITY;

			/* A triangle may have been turned, but is not wound the other way. */
			for (unsigned turn = 0; turn < 3; turn++) {
				double most = 0;

				for (unsigned c = 0; c < 3; c++) {
					double moved = 0;
					double at[3];

					payload_position(&store.view,
							 payload_index(&store.view, i, c), at);
					for (unsigned k = 0; k < 3; k++) {
						double away = at[k] + store.superblock->origin[k] -
							      from[3 * ((c + turn) % 3) + k];

						moved += away * away;
					}
					most = fmax(most, sqrt(moved));
				}
				least = fmin(least, most);
			}
			assert_true(least <= error);
			seen++;
		}
	}
	assert_true(seen == store.superblock->triangle_count);
	model_store_close(&store);
}

static void no_vertex_is_further_from_the_input_than_the_error(void **state)
{
	static const double offsets[] = { 0, 1e7 };
	static const char *const errors[] = { "0.01", "1", "0" };
	enum {
		TRIANGLES = 4000
	};
	double *corners = malloc(TRIANGLES * 9 * sizeof(*corners));

	assert_non_null(corners);
	for (size_t o = 0; o < ARRAY_LENGTH(offsets); o++) {
		for (size_t i = 0; i < TRIANGLES * 9; i++)
			corners[i] = offsets[o] + (model_random() - 0.5) * 100;
		model_write_doubles(test_path(*state, "soup.ply"), corners, TRIANGLES);
		for (size_t e = 0; e < ARRAY_LENGTH(errors); e++) {
			double error = strtod(errors[e], NULL);
			char arguments[128];

			(void)snprintf(arguments, sizeof(arguments),
				       "-o s.ooc --keep-ids --leaf-triangles 300 --error %s "
				       "soup.ply",
				       errors[e]);
			model_build(*state, arguments);
			assert_int_equal(model_told("triangles_stored"), TRIANGLES);
			assert_true(error == 0 || model_told("error_measured") <= error);
			/* Floats about a node's middle are good to some 2^-24 of its size. */
			assert_true(model_told("error_measured") <= fmax(error, 1e-5));
			assert_near_input(test_path(*state, "s.ooc"), corners,
					  model_told("error_measured") + 1e-8);
			verify(*state, "s.ooc");
		}
	}
	free(corners);
}

/** A vertex of a store: where, and its normal's code. */
struct seen_normal {
	double at[3];
	uint16_t code;
};

static int compare_seen(const void *a, const void *b)
{
	return memcmp(a, b, offsetof(struct seen_normal, code));
}

/* All vertices of a store by position.  Returns: how many. */
static size_t normals_of(const char *path, struct seen_normal **ret)
{
	struct model_store store;
	size_t count = 0;

	model_store_open(path, &store);
	*ret = calloc(store.superblock->vertex_count, sizeof(**ret));
	assert_non_null(*ret);
	for (uint32_t node = 0; node < store.superblock->node_count; node++) {
		if (!model_store_read(&store, node))
			continue;
		for (uint32_t i = 0; i < store.view.header->vertex_count; i++, count++) {
			payload_position(&store.view, i, (*ret)[count].at);
			memcpy(&(*ret)[count].code, (const uint8_t *)store.view.normals + 2 * i, 2);
		}
	}
	model_store_close(&store);
	qsort(*ret, count, sizeof(**ret), compare_seen);
	return count;
}

static void borders_of_nodes_do_not_show_on_a_smooth_surface(void **state)
{
	const double centre[3] = { 3, -2, 10 };
	struct seen_normal *fine;
	struct seen_normal *coarse;
	size_t fine_count;
	size_t coarse_count;
	size_t at = 0;

	/* 280 x 560 x 2: three buckets or more, and then hundreds of leaves. */
	model_write_sphere(test_path(*state, "sphere.ply"), 280, 5, centre);
	model_build(*state, "-o fine.ooc --leaf-triangles 700 sphere.ply");
	assert_true(model_told("buckets") >= 3);
	assert_true(model_told("leaves") > 500);
	model_build(*state, "-o coarse.ooc --leaf-triangles 500000 sphere.ply");
	assert_int_equal(model_told("leaves"), 1);
	fine_count = normals_of(test_path(*state, "fine.ooc"), &fine);
	coarse_count = normals_of(test_path(*state, "coarse.ooc"), &coarse);
	/* One leaf has each vertex once: the surface is smooth.  Cut, it has the same ones. */
	for (size_t i = 0; i < fine_count; i++) {
		while (at < coarse_count && compare_seen(&coarse[at], &fine[i]) < 0)
			at++;
		assert_true(at < coarse_count);
		assert_int_equal(compare_seen(&coarse[at], &fine[i]), 0);
		assert_int_equal(coarse[at].code, fine[i].code);
	}
	for (size_t i = 1; i < coarse_count; i++)
		assert_int_not_equal(compare_seen(&coarse[i - 1], &coarse[i]), 0);
	free(fine);
	free(coarse);
}

/* ---- layouts ---- */

static void a_replicated_triangle_is_in_every_leaf_that_it_touches(void **state)
{
	struct model_store store;
	struct model_store all;
	struct grid grid = { .form = GRID_LATTICE };
	uint64_t touching = 0;

	make_plant(*state, 20000);
	model_build(*state, "-o unique.ooc --error 0.01 --leaf-triangles 100000 plant.ply");
	assert_true(model_told("replication_factor") == 1);
	model_build(*state, "-o replicas.ooc --error 0.01 --leaf-triangles 1000 --layout replicate "
			    "plant.ply");
	assert_int_equal(model_told("depth_limited_leaves"), 0);
	assert_in_range((uint64_t)(model_told("replication_factor") * 1000), 1001, 4000);
	model_store_open(test_path(*state, "unique.ooc"), &all);
	model_store_open(test_path(*state, "replicas.ooc"), &store);
	grid.step = ldexp(1, store.superblock->step_exponent);
	grid.root_bits = (uint32_t)ilogb(store.superblock->root_size / grid.step);
	assert_true(model_store_read(&all, 0));
	for (uint32_t node = 0; node < store.superblock->node_count; node++) {
		const struct store_node *leaf = &store.nodes[node];
		double cell_min[3];
		double size;
		uint32_t count = 0;

		if (leaf->child_count > 0)
			continue;
		overlap_cell_box(&grid, leaf->level, leaf->cell, cell_min, &size);
		for (uint32_t i = 0; i < all.view.header->triangle_count; i++) {
			double corners[9];

			for (unsigned c = 0; c < 3; c++) {
				payload_position(&all.view, payload_index(&all.view, i, c),
						 &corners[3 * c]);
				for (unsigned k = 0; k < 3; k++)
					corners[3 * c + k] /= grid.step;
			}
			count += overlap_touches(&grid, corners, cell_min, size);
		}
		assert_int_equal(leaf->triangle_count, count);
		touching += count;
	}
	assert_true(touching == store.superblock->triangle_count);
	model_store_close(&store);
	model_store_close(&all);
}

static void the_published_setting_bounds_the_vertices_of_a_leaf(void **state)
{
	struct model_store store;

	make_plant(*state, 60000);
	model_build(*state, "-o s.ooc --preset iwalk plant.ply");
	assert_true(model_told("leaves") > 1);
	model_store_open(test_path(*state, "s.ooc"), &store);
	assert_int_equal(store.superblock->layout, STORE_LAYOUT_REPLICATE);
	for (uint32_t node = 0; node < store.superblock->node_count; node++)
		assert_in_range(store.nodes[node].vertex_count, 0, 15000);
	model_store_close(&store);
}

/* ---- awkward triangles ---- */

static void triangles_without_area_are_dropped_and_repeated_ones_counted(void **state)
{
	static const float corners[][9] = {
		{ 0, 0, 0, 1, 0, 0, 0, 1, 0 },         /* a triangle */
		{ 0, 1, 0, 0, 0, 0, 1, 0, 0 },         /* the same, turned */
		{ 0, 0, 0, 0, 1, 0, 1, 0, 0 },         /* the same, wound the other way */
		{ 5, 5, 5, 5, 5, 5, 5, 5, 5 },         /* a point */
		{ 1, 1, 1, 2, 2, 2, 1, 1, 1 },         /* two points */
		{ 0, 0, 0, 1, 1, 1, 3, 3, 3 },         /* a line */
		{ 0, 0, 9, 1e-9f, 0, 9, 0, 1e-9f, 9 }, /* nothing, once it is on the lattice */
		{ 7, 0, 0, 8, 0, 0, 7, 1, 0 },
	};

	model_write_floats(test_path(*state, "odd.ply"), corners[0], ARRAY_LENGTH(corners));
	model_build(*state, "-o s.ooc odd.ply");
	assert_int_equal(model_told("triangles_in"), 8);
	assert_int_equal(model_told("triangles_stored"), 4);
	assert_int_equal(model_told("degenerate"), 4);
	assert_int_equal(model_told("duplicates"), 2);
	verify(*state, "s.ooc");
	/* Exact positions keep what is small. */
	model_build(*state, "-o s.ooc --error 0 odd.ply");
	assert_int_equal(model_told("triangles_stored"), 5);
	assert_int_equal(model_told("degenerate"), 3);
	assert_int_equal(model_told("duplicates"), 2);
	verify(*state, "s.ooc");
}

static void what_is_not_finite_is_refused_or_dropped_as_asked(void **state)
{
	static const float corners[][9] = {
		{ 0, 0, 0, 1, 0, 0, 0, 1, 0 },
		{ 0, 0, NAN, 1, 0, 0, 0, 1, 0 },
		{ 0, 0, 1, 1, 0, 0, 0, 1, INFINITY },
		{ 7, 0, 0, 8, 0, 0, 7, 1, 0 },
	};

	model_write_floats(test_path(*state, "odd.ply"), corners[0], ARRAY_LENGTH(corners));
	model_build_fails(*state, "-o s.ooc odd.ply", "odd.ply: triangle 1 has a coordinate");
	assert_string_equal(test_folder_list(*state), "odd.ply ");
	for (unsigned exact = 0; exact < 2; exact++) {
		model_build(*state, exact ? "-o s.ooc --non-finite drop --error 0 odd.ply"
					  : "-o s.ooc --non-finite drop odd.ply");
		assert_int_equal(model_told("triangles_stored"), 2);
		assert_int_equal(model_told("non_finite"), 2);
		assert_int_equal(model_told("degenerate"), 0);
		verify(*state, "s.ooc");
	}
}

static void triangles_that_no_cutting_separates_neither_loop_nor_explode(void **state)
{
	/* More than a bucket of the same triangle, and one far away that sets the scale. */
	enum {
		SAME = 140000,
		LARGE = 3000
	};
	float *corners = malloc((SAME + 1) * 9 * sizeof(*corners));
	static const float one[9] = { 0, 0, 0, 1, 0, 0, 0, 1, 0 };

	assert_non_null(corners);
	for (size_t i = 0; i <= SAME; i++)
		memcpy(corners + 9 * i, one, sizeof(one));
	corners[(size_t)SAME * 9] = 1e4f;
	model_write_floats(test_path(*state, "same.ply"), corners, SAME + 1);
	model_build(*state, "-o s.ooc same.ply");
	assert_int_equal(model_told("triangles_stored"), SAME + 1);
	assert_true(model_told("depth_limited_leaves") >= SAME / 8192.0);
	/* Leaves are compared one by one: at least all but one of each are told. */
	assert_true(model_told("duplicates") >= SAME - model_told("leaves"));
	verify(*state, "s.ooc");
	model_build(*state, "-o s.ooc --layout replicate --error 0 same.ply");
	assert_true(model_told("replication_factor") <= 4);
	verify(*state, "s.ooc");

	/* Triangles as large as the scene. */
	for (size_t i = 0; i < (size_t)LARGE * 9; i++)
		corners[i] = (float)((model_random() - 0.5) * 1000);
	model_write_floats(test_path(*state, "large.ply"), corners, LARGE);
	model_build(*state, "-o s.ooc --layout replicate --leaf-triangles 50 large.ply");
	assert_true(model_told("replication_factor") <= 4);
	assert_true(model_told("depth_limited_leaves") > 0);
	verify(*state, "s.ooc");
	model_build(*state, "-o s.ooc --leaf-triangles 50 large.ply");
	assert_int_equal(model_told("triangles_stored"), LARGE);
	assert_int_equal(model_told("depth_limited_leaves"), 0);
	verify(*state, "s.ooc");
	free(corners);
}

static void a_hub_of_very_many_triangles_is_built(void **state)
{
	/* One vertex that all share, in another bucket than most of them. */
	enum {
		SPOKES = 200000
	};
	float *corners = malloc((size_t)SPOKES * 9 * sizeof(*corners));

	assert_non_null(corners);
	for (uint32_t i = 0; i < SPOKES; i++) {
		double angle = i * (6.283185307179586 / SPOKES);
		double next = (i + 1) * (6.283185307179586 / SPOKES);
		const float spoke[9] = { 0,
					 0,
					 0,
					 (float)(100 * cos(angle)),
					 (float)(100 * sin(angle)),
					 (float)(i % 7),
					 (float)(100 * cos(next)),
					 (float)(100 * sin(next)),
					 (float)(i % 5) };

		memcpy(corners + (size_t)9 * i, spoke, sizeof(spoke));
	}
	model_write_floats(test_path(*state, "hub.ply"), corners, SPOKES);
	model_build(*state, "-o s.ooc --leaf-triangles 2000 hub.ply");
	assert_int_equal(model_told("triangles_stored"), SPOKES);
	verify(*state, "s.ooc");
	model_build(*state, "-o t.ooc --leaf-triangles 2000 --memory 96M --jobs 1 hub.ply");
	test_assert_same_files(test_path(*state, "s.ooc"), test_path(*state, "t.ooc"));
	free(corners);
}

static void an_input_without_triangles_makes_an_empty_store_and_a_warning(void **state)
{
	static const float point[9] = { 5, 5, 5, 5, 5, 5, 5, 5, 5 };
	char said[4096];

	model_write_floats(test_path(*state, "empty.ply"), NULL, 0);
	model_write_floats(test_path(*state, "point.ply"), point, 1);
	assert_int_equal(test_command(said, sizeof(said),
				      "cd %s && \"$OOCD_BIN\"/oocbuild --quiet -o s.ooc empty.ply",
				      (char *)*state),
			 0);
	assert_non_null(strstr(said, "the store is empty"));
	verify(*state, "s.ooc");
	model_build(*state, "-o s.ooc --layout replicate point.ply empty.ply");
	assert_int_equal(model_told("degenerate"), 1);
	assert_int_equal(model_told("sections"), 2);
	verify(*state, "s.ooc");
	model_build(*state, "-o s.ooc --error 0 point.ply");
	verify(*state, "s.ooc");
}

/* ---- scenes ---- */

static void a_scene_list_places_its_models(void **state)
{
	static const float one[9] = { 0, 0, 0, 1, 0, 0, 0, 2, 0 };
	static const char list[] = "file,m00,m01,m02,m03,m10,m11,m12,m13,m20,m21,m22,m23\n"
				   "one.ply,1,0,0,0,0,1,0,0,0,0,1,0\n"
				   "one.ply,0,-1,0,100,1,0,0,200,0,0,1,50\n";
	struct store_names names;
	struct model_store store;
	struct why why = { 0 };

	model_write_floats(test_path(*state, "one.ply"), one, 1);
	test_file_write(test_path(*state, "list.csv"), list, strlen(list));
	model_build(*state, "-o s.ooc --error 0 --units cm --up y list.csv");
	assert_int_equal(model_told("sections"), 2);
	assert_int_equal(model_told("triangles_stored"), 2);
	model_store_open(test_path(*state, "s.ooc"), &store);
	assert_true(store.superblock->unit_metres == 0.01);
	assert_int_equal(store.superblock->up_axis, STORE_AXIS_Y);
	assert_true(store.superblock->box_min[0] == 0);
	assert_true(store.superblock->box_max[0] == 100);
	assert_true(store.superblock->box_max[1] == 201);
	assert_true(store.superblock->box_max[2] == 50);
	assert_int_equal(store_load_names(store.file, &names, &why), 0);
	assert_int_equal(names.header->source_count, 1);
	assert_int_equal(names.header->section_count, 2);
	assert_true(names.sections[1].placement[3] == 100);
	for (uint64_t i = 0; i < names.header->part_count; i++)
		assert_int_equal(names.parts[i].triangle_count, 1);
	store_names_done(&names);
	model_store_close(&store);
}

/* ---- what goes wrong ---- */

static void a_disk_that_is_full_leaves_nothing_and_the_old_store(void **state)
{
	size_t bytes;
	void *before;
	void *after;
	size_t bytes_after;
	char said[4096];

	make_plant(*state, 100000);
	model_build(*state, "-o s.ooc --leaf-triangles 500 plant.ply");
	before = test_file_read(test_path(*state, "s.ooc"), &bytes);
	/* 1 MiB is less than the store needs, and with little memory than scratch does. */
	for (unsigned scratch = 0; scratch < 2; scratch++) {
		assert_int_equal(test_command(said, sizeof(said),
					      "cd %s && ulimit -f 1024 && \"$OOCD_BIN\"/oocbuild "
					      "-o s.ooc %s plant.ply",
					      (char *)*state, scratch ? "--memory 96M" : ""),
				 1);
		assert_non_null(strstr(said, "oocbuild: "));
		assert_ptr_equal(strchr(said, '\n'), said + strlen(said) - 1);
		assert_true(!scratch || strstr(said, "scratch"));
		after = test_file_read(test_path(*state, "s.ooc"), &bytes_after);
		assert_int_equal(bytes_after, bytes);
		assert_memory_equal(after, before, bytes);
		free(after);
		assert_string_equal(test_folder_list(*state), "plant.ply s.ooc ");
	}
	free(before);
}

/* Bytes that a process has read and written so far; -1: it is no more. */
static long long process_bytes(pid_t process)
{
	char path[64];
	long long read_bytes = -1;
	FILE *file;

	(void)snprintf(path, sizeof(path), "/proc/%d/io", (int)process);
	file = fopen(path, "re");
	if (!file)
		return -1;
	if (fscanf(file, "rchar: %lld", &read_bytes) != 1)
		read_bytes = -1;
	(void)fclose(file);
	return read_bytes;
}

static void an_interrupted_build_leaves_nothing(void **state)
{
	static const int signals[] = { SIGINT, SIGTERM };
	char program[4096];
	char said[512] = "";

	make_plant(*state, 1000000);
	(void)snprintf(program, sizeof(program), "%s/oocbuild", getenv("OOCD_BIN"));
	for (size_t i = 0; i < ARRAY_LENGTH(signals); i++) {
		const char *store = test_path(*state, "s.ooc");
		const char *model = test_path(*state, "plant.ply");
		int ends[2];
		pid_t process;
		ssize_t length;

		assert_int_equal(pipe(ends), 0);
		process = test_fork();
		if (process == 0) {
			(void)dup2(ends[1], STDERR_FILENO);
			(void)execl(program, "oocbuild", "-o", store, "--memory", "96M", "--jobs",
				    "1", model, NULL);
			_exit(99);
		}
		assert_int_equal(close(ends[1]), 0);
		/* In the middle of it: half of the model has been read. */
		while (process_bytes(process) >= 0 && process_bytes(process) < 10000000)
			(void)sched_yield();
		assert_int_equal(kill(process, signals[i]), 0);
		assert_int_equal(test_wait(process), 1);
		length = read(ends[0], said, sizeof(said) - 1);
		assert_true(length > 0);
		said[length] = '\0';
		assert_int_equal(close(ends[0]), 0);
		assert_string_equal(said, "oocbuild: interrupted: no store was made\n");
		assert_string_equal(test_folder_list(*state), "plant.ply ");
	}
}

static void bad_input_is_one_line_and_no_store(void **state)
{
	static const char text[] = "This is not a model at all.\n";

	test_file_write(test_path(*state, "text.ply"), text, strlen(text));
	test_file_write(test_path(*state, "nothing.ply"), "", 0);
	model_build_fails(*state, "-o s.ooc missing.ply", "missing.ply");
	model_build_fails(*state, "-o s.ooc text.ply", "text.ply");
	model_build_fails(*state, "-o s.ooc nothing.ply", "nothing.ply");
	model_build_fails(*state, "-o nowhere/s.ooc text.ply", "nowhere");
	model_build_fails(*state, "-o . text.ply", "is no file");
	/* The slip of a hand that would cost a model. */
	model_build_fails(*state, "-o text.ply nothing.ply", "exists and is no store");
	assert_string_equal(test_folder_list(*state), "nothing.ply text.ply ");
}

static void progress_is_shown_on_a_terminal_and_never_in_a_pipe(void **state)
{
	char said[65536];

	make_plant(*state, 600000);
	assert_int_equal(
		test_command(said, sizeof(said),
			     "cd %s && \"$OOCD_BIN\"/oocbuild -o s.ooc plant.ply >/dev/null",
			     (char *)*state),
		0);
	assert_string_equal(said, "");
	assert_int_equal(
		test_command(said, sizeof(said),
			     "cd %s && script -qec '\"$OOCD_BIN\"/oocbuild --json --jobs 1 -o "
			     "s.ooc plant.ply' /dev/null",
			     (char *)*state),
		0);
	assert_non_null(strstr(said, "Mtriangles/s"));
	assert_non_null(strstr(said, "MiB"));
	assert_int_equal(
		test_command(said, sizeof(said),
			     "cd %s && script -qec '\"$OOCD_BIN\"/oocbuild --quiet -o s.ooc "
			     "plant.ply' /dev/null",
			     (char *)*state),
		0);
	assert_string_equal(said, "");
}

static void wrong_usage_says_what_is_wanted(void **state)
{
	static const char *const wrong[][2] = {
		{ "model.ply", "-o STORE.ooc is missing" },
		{ "-o s.ooc", "no model" },
		{ "-o s.ooc --memory much m.ply", "--memory much" },
		{ "-o s.ooc --jobs 0 m.ply", "--jobs 0" },
		{ "-o s.ooc --error -1 m.ply", "--error -1" },
		{ "-o s.ooc --layout flat m.ply", "unique, replicate" },
		{ "-o s.ooc --normals smooth m.ply", "flat, stored, oct8, oct16" },
		{ "-o s.ooc --crease 100 m.ply", "--crease 100" },
		{ "-o s.ooc --codec lz4 m.ply", "--codec lz4" },
		{ "-o s.ooc --units furlong m.ply", "--units furlong" },
		{ "-o s.ooc --leaf-triangles 9999999 m.ply", "--leaf-triangles 9999999" },
		{ "-o s.ooc --preset far m.ply", "only iwalk" },
		{ "-o s.ooc --colour red m.ply", "texture, vertex, material, none" },
		{ "-o s.ooc --wrong m.ply", "--wrong" },
	};
	char said[8192];

	(void)state;
	for (size_t i = 0; i < ARRAY_LENGTH(wrong); i++) {
		assert_int_equal(
			test_command(said, sizeof(said), "\"$OOCD_BIN\"/oocbuild %s", wrong[i][0]),
			2);
		if (!strstr(said, wrong[i][1]))
			fail_msg("%s: %s", wrong[i][0], said);
	}
	assert_int_equal(test_command(said, sizeof(said), "\"$OOCD_BIN\"/oocbuild --help"), 0);
	assert_non_null(strstr(said, "Examples:"));
	assert_int_equal(test_command(said, sizeof(said), "\"$OOCD_BIN\"/oocbuild --version"), 0);
	assert_non_null(strstr(said, "oocbuild 0."));
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, test_folder_setup, test_folder_teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		TEST(the_bytes_depend_on_neither_jobs_nor_memory),
		TEST(scratch_changes_nothing_and_leaves_nothing),
#ifndef OOCD_SANITIZED
		TEST(memory_stays_within_its_bound),
#endif
		TEST(no_vertex_is_further_from_the_input_than_the_error),
		TEST(borders_of_nodes_do_not_show_on_a_smooth_surface),
		TEST(a_replicated_triangle_is_in_every_leaf_that_it_touches),
		TEST(the_published_setting_bounds_the_vertices_of_a_leaf),
		TEST(triangles_without_area_are_dropped_and_repeated_ones_counted),
		TEST(what_is_not_finite_is_refused_or_dropped_as_asked),
		TEST(triangles_that_no_cutting_separates_neither_loop_nor_explode),
		TEST(a_hub_of_very_many_triangles_is_built),
		TEST(an_input_without_triangles_makes_an_empty_store_and_a_warning),
		TEST(a_scene_list_places_its_models),
		TEST(a_disk_that_is_full_leaves_nothing_and_the_old_store),
		TEST(an_interrupted_build_leaves_nothing),
		TEST(bad_input_is_one_line_and_no_store),
		TEST(progress_is_shown_on_a_terminal_and_never_in_a_pipe),
		cmocka_unit_test(wrong_usage_says_what_is_wanted),
	};

	return TEST_RUN(tests);
}
