/* SPDX-License-Identifier: MIT */
/*
 * Goal: oocbench proves what is exact, refuses what is not, and walks without touching a wall.
 * Method: small models, stores by oocbuild, pictures by oocview and by the software rasteriser.
 */
#include <fcntl.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "formats/base/random.h"
#include "formats/store/payload.h"
#include "formats/store/store_file.h"
#include "libclient/select/camera.h"
#include "libclient/select/vector.h"
#include "tests/helper.h"
#include "tools/bench/accuracy/explain.h"

static struct random dice = { 1 };

static double random_sign(void)
{
	return random_between(&dice, -1.0, 1.0);
}

/* Runs one of our programs in the folder, without its output.  Returns: its exit status. */
static int run(const char *folder, const char *format, ...) __attribute__((format(printf, 2, 3)));
static int run(const char *folder, const char *format, ...)
{
	const char *programs = getenv("OOCD_BIN");
	char arguments[1024];
	char command[4096];
	va_list args;
	int status;

	assert_non_null(programs);
	va_start(args, format);
	(void)vsnprintf(arguments, sizeof(arguments), format, args);
	va_end(args);
	(void)snprintf(command, sizeof(command), "cd %s && TMPDIR=. %s/%s >output 2>errors", folder,
		       programs, arguments);
	status = system(command);
	assert_true(WIFEXITED(status));
	return WEXITSTATUS(status);
}

/* A word of what the last program said. */
static bool said(const char *folder, const char *file, const char *word)
{
	size_t length;
	char *text = test_file_read(test_path(folder, file), &length);
	bool found = length > 0 && memmem(text, length, word, strlen(word)) != NULL;

	free(text);
	return found;
}

/* A binary PLY of loose triangles of all sizes about a point. */
static void soup_write(const char *path, uint32_t triangle_count, double middle, bool doubles)
{
	FILE *file = fopen(path, "we");

	assert_non_null(file);
	dice.state = triangle_count;
	fprintf(file,
		"ply\nformat binary_little_endian 1.0\nelement vertex %u\nproperty %s x\n"
		"property %s y\nproperty %s z\nelement face %u\n"
		"property list uchar int vertex_indices\nend_header\n",
		3 * triangle_count, doubles ? "double" : "float", doubles ? "double" : "float",
		doubles ? "double" : "float", triangle_count);
	for (uint32_t i = 0; i < triangle_count; i++) {
		double size = 4.0 * pow(fabs(random_sign()), 3.0);
		double centre[3];

		for (int k = 0; k < 3; k++)
			centre[k] = middle + 10.0 * random_sign();
		for (int c = 0; c < 9; c++) {
			double value = centre[c % 3] + size * random_sign();
			float rounded = (float)value;

			assert_int_equal(doubles ? fwrite(&value, sizeof(value), 1, file)
						 : fwrite(&rounded, sizeof(rounded), 1, file),
					 1);
		}
	}
	for (uint32_t i = 0; i < triangle_count; i++) {
		uint32_t corners[3] = { 3 * i, 3 * i + 1, 3 * i + 2 };

		assert_int_equal(fputc(3, file), 3);
		assert_int_equal(fwrite(corners, sizeof(corners), 1, file), 1);
	}
	assert_int_equal(fclose(file), 0);
}

/* ---- exact ---- */

static void pictures_are_exact(const char *folder, const char *build_options)
{
	assert_int_equal(
		run(folder, "oocbuild --quiet --keep-ids %s -o m.ooc m.ply", build_options), 0);
	/* GL drivers leak, and are gone when LeakSanitizer looks, so that it cannot name them. */
	assert_int_equal(setenv("ASAN_OPTIONS", "detect_leaks=0", 0), 0);
	if (run(folder, "oocbench exact m.ooc m.ply --views 4 --size 320x240 --json") != 0) {
		size_t output_bytes;
		size_t errors_bytes;
		char *output = test_file_read(test_path(folder, "output"), &output_bytes);
		char *errors = test_file_read(test_path(folder, "errors"), &errors_bytes);

		print_error("%.*s%.*s\n", (int)output_bytes, output, (int)errors_bytes, errors);
		free(output);
		free(errors);
		fail();
	}
	assert_int_equal(unsetenv("ASAN_OPTIONS"), 0);
	assert_true(said(folder, "output", "\"holds\": \"yes\""));
}

static void pictures_of_a_plant_are_exact(void **state)
{
	const char *folder = *state;

	assert_int_equal(run(folder, "oocgen plant --triangles 30000 --seed 1 -o m.ply"), 0);
	pictures_are_exact(folder, "--leaf-triangles 1000");
	pictures_are_exact(folder, "--error 0 --codec meshopt+zstd");
}

static void pictures_are_exact_ten_million_units_from_the_origin(void **state)
{
	const char *folder = *state;

	soup_write(test_path(folder, "m.ply"), 5000, 1e7, true);
	pictures_are_exact(folder, "--leaf-triangles 300");
	pictures_are_exact(folder, "--leaf-triangles 300 --error 0");
	pictures_are_exact(folder, "--leaf-triangles 300 --layout replicate");
}

static void pictures_of_a_soup_of_floats_are_exact(void **state)
{
	const char *folder = *state;

	soup_write(test_path(folder, "m.ply"), 5000, 0.0, false);
	pictures_are_exact(folder, "--leaf-triangles 300 --error 0");
	pictures_are_exact(folder, "--leaf-triangles 300 --error 0.01");
}

static void exact_fails_on_a_model_that_is_a_little_different(void **state)
{
	const char *folder = *state;

	soup_write(test_path(folder, "m.ply"), 3000, 0.0, false);
	assert_int_equal(run(folder, "oocbuild --quiet --keep-ids -o m.ooc m.ply"), 0);
	/* By a hundredth of the model's size: no error bound explains that. */
	soup_write(test_path(folder, "m.ply"), 3000, 0.2, false);
	assert_int_equal(run(folder, "oocbench exact m.ooc m.ply --views 2 --no-viewer --json"), 1);
	assert_true(said(folder, "output", "\"holds\": \"no\""));

	soup_write(test_path(folder, "m.ply"), 2999, 0.0, false);
	assert_int_equal(run(folder, "oocbench exact m.ooc m.ply --views 2 --no-viewer"), 1);
	assert_true(said(folder, "errors", "not its input"));
}

static void exact_needs_the_ids_of_triangles(void **state)
{
	const char *folder = *state;

	soup_write(test_path(folder, "m.ply"), 300, 0.0, false);
	assert_int_equal(run(folder, "oocbuild --quiet -o m.ooc m.ply"), 0);
	assert_int_equal(run(folder, "oocbench exact m.ooc m.ply --views 4 --no-viewer"), 1);
	assert_true(said(folder, "errors", "--keep-ids"));
}

static void a_difference_is_explained_by_edges_and_ties_alone(void **state)
{
	static const struct store_superblock superblock = { .step_exponent = -10 };
	/* Seen from 10 units: 100 pixels high, 10 pixels a unit at that distance. */
	static const double wall[3][3] = { { -4, 10, -4 }, { 4, 10, -4 }, { -4, 10, 4 } };
	static const double behind[3][3] = { { -40, 11, -40 }, { 40, 11, -40 }, { 0, 11, 40 } };
	static const double same[3][3] = { { -40, 10, -40 }, { 40, 10, -40 }, { 0, 10, 40 } };
	struct camera camera = { .at = { 0, 1, 0 }, .up = { 0, 0, 1 }, .fov_y_degrees = 53.130102 };
	struct camera_view view;
	struct explain explain = { .view = &view, .width = 100, .height = 100, .pixels = 0.006 };

	(void)state;
	assert_int_equal(camera_view_init(&view, &camera, &superblock, 1.0, 0.1), 0);
	/* In the middle of the wall. */
	assert_int_equal(explain_difference(&explain, wall, behind, 30, 70), EXPLAIN_NONE);
	assert_int_equal(explain_difference(&explain, wall, NULL, 30, 70), EXPLAIN_NONE);
	assert_int_equal(explain_difference(&explain, wall, same, 30, 70), EXPLAIN_TIE);
	/* A pixel from its left edge, which is at 10.0: no; with error enough: yes. */
	assert_int_equal(explain_difference(&explain, wall, behind, 11, 70), EXPLAIN_NONE);
	explain.error = 0.2;
	assert_int_equal(explain_difference(&explain, wall, behind, 11, 70), EXPLAIN_EDGE);
	assert_int_equal(explain_difference(&explain, wall, behind, 30, 70), EXPLAIN_NONE);
	/* Depths that are off by more than they differ. */
	explain.error = 0.6;
	assert_int_equal(explain_difference(&explain, wall, behind, 30, 70), EXPLAIN_EDGE);
}

/* ---- path ---- */

/* Squared distance from a point to a triangle: to its plane inside, else to its edges. */
static double distance2(const double p[3], const double v[3][3])
{
	double best = INFINITY;
	double n[3];
	bool inside = true;
	double e[3][3];

	for (int c = 0; c < 3; c++)
		for (int k = 0; k < 3; k++)
			e[c][k] = v[(c + 1) % 3][k] - v[c][k];
	for (int k = 0; k < 3; k++)
		n[k] = e[0][(k + 1) % 3] * e[1][(k + 2) % 3] -
		       e[0][(k + 2) % 3] * e[1][(k + 1) % 3];
	for (int c = 0; c < 3; c++) {
		double to[3];
		double side[3];
		double near2 = 0.0;
		double t;

		for (int k = 0; k < 3; k++)
			to[k] = p[k] - v[c][k];
		for (int k = 0; k < 3; k++)
			side[k] = n[(k + 1) % 3] * e[c][(k + 2) % 3] -
				  n[(k + 2) % 3] * e[c][(k + 1) % 3];
		inside = inside && vector_dot(side, to) >= 0.0;
		t = fmin(1.0,
			 fmax(0.0, vector_dot(to, e[c]) / fmax(vector_dot(e[c], e[c]), 1e-30)));
		for (int k = 0; k < 3; k++)
			near2 += (to[k] - t * e[c][k]) * (to[k] - t * e[c][k]);
		best = fmin(best, near2);
	}
	if (inside && vector_dot(n, n) > 0.0) {
		double to[3] = { p[0] - v[0][0], p[1] - v[0][1], p[2] - v[0][2] };

		best = fmin(best, vector_dot(to, n) * vector_dot(to, n) / vector_dot(n, n));
	}
	return best;
}

/* The least distance of each camera's eye to the store's geometry. */
static void clearances(const char *path, const struct camera *cameras, uint32_t count, double *ret)
{
	const struct store_superblock *superblock;
	struct store_file *store;
	struct store_node *nodes;
	void *payload;

	assert_int_equal(store_open_path(path, &store, NULL), 0);
	superblock = store_superblock(store);
	nodes = calloc(superblock->node_count, sizeof(*nodes));
	payload = malloc(superblock->payload_bytes_max);
	assert_true(nodes && payload);
	assert_int_equal(store_load_hs(store, nodes, NULL), 0);
	for (uint32_t i = 0; i < count; i++)
		ret[i] = INFINITY;
	for (uint64_t n = 0; n < superblock->node_count; n++) {
		struct payload_view view;

		if (nodes[n].payload_id == 0)
			continue;
		assert_int_equal(store_read_payload(store, &nodes[n], payload, NULL, NULL), 0);
		payload_view(payload, &view);
		for (uint32_t t = 0; t < view.header->triangle_count; t++) {
			double corners[3][3];

			for (uint32_t c = 0; c < 3; c++)
				payload_position(&view, payload_index(&view, t, c), corners[c]);
			for (uint32_t i = 0; i < count; i++) {
				double eye[3];

				for (int k = 0; k < 3; k++)
					eye[k] = cameras[i].eye[k] - superblock->origin[k];
				ret[i] = fmin(ret[i], distance2(eye, (const double(*)[3])corners));
			}
		}
	}
	free(payload);
	free(nodes);
	store_close(store);
}

static void a_walk_keeps_off_the_walls_at_a_constant_pace(void **state)
{
	const char *folder = *state;
	struct camera *cameras;
	double steps[300];
	double eyes[300];
	uint32_t count;

	assert_int_equal(run(folder, "oocgen plant --triangles 60000 --seed 3 -o m.ply"), 0);
	assert_int_equal(run(folder, "oocbuild --quiet -o m.ooc m.ply"), 0);
	assert_int_equal(run(folder, "oocbench path m.ooc --frames 300 --seed 4 -o a.csv --json"),
			 0);
	assert_true(said(folder, "output", "\"frames\": 300"));
	assert_int_equal(run(folder, "oocbench path m.ooc --frames 300 --seed 4 -o b.csv"), 0);
	assert_int_equal(camera_path_read(test_path(folder, "a.csv"), &cameras, &count, NULL), 0);
	assert_int_equal(count, 300);
	clearances(test_path(folder, "m.ooc"), cameras, count, eyes);
	for (uint32_t i = 0; i < count; i++) {
		double before[3];
		double after[3];

		/* Storeys of this plant are 4.2 units high, of which the body takes a twentieth. */
		assert_true(sqrt(eyes[i]) > 0.1);
		assert_true(cameras[i].up[2] == 1.0);
		if (i == 0)
			continue;
		assert_true(fabs(cameras[i].time_s - cameras[i - 1].time_s - 1.0 / 30.0) < 1e-9);
		steps[i] = 0.0;
		for (int k = 0; k < 3; k++) {
			steps[i] += (cameras[i].eye[k] - cameras[i - 1].eye[k]) *
				    (cameras[i].eye[k] - cameras[i - 1].eye[k]);
			before[k] = cameras[i - 1].at[k] - cameras[i - 1].eye[k];
			after[k] = cameras[i].at[k] - cameras[i].eye[k];
		}
		assert_true(vector_dot(before, after) /
				    sqrt(vector_dot(before, before) * vector_dot(after, after)) >
			    cos(8.0 * M_PI / 180.0));
		if (i > 1)
			assert_true(sqrt(steps[i]) < 1.02 * sqrt(steps[1]) + 0.01);
	}
	free(cameras);

	/* The same again is the same. */
	{
		size_t length_a;
		size_t length_b;
		char *a = test_file_read(test_path(folder, "a.csv"), &length_a);
		char *b = test_file_read(test_path(folder, "b.csv"), &length_b);

		assert_int_equal(length_a, length_b);
		assert_memory_equal(a, b, length_a);
		free(a);
		free(b);
	}
}

static struct camera *path_read(const char *folder, const char *name, uint32_t count_wanted)
{
	struct camera *cameras;
	uint32_t count;

	assert_int_equal(camera_path_read(test_path(folder, name), &cameras, &count, NULL), 0);
	assert_int_equal(count, count_wanted);
	return cameras;
}

static bool same_eye(const struct camera *a, const struct camera *b)
{
	return memcmp(a->eye, b->eye, sizeof(a->eye)) == 0;
}

static void teleports_and_reversals_are_the_walk_in_another_order(void **state)
{
	const char *folder = *state;
	struct camera *walk;
	struct camera *jumps;
	struct camera *turns;
	uint32_t moved_count = 0;

	assert_int_equal(run(folder, "oocgen plant --triangles 20000 -o m.ply"), 0);
	assert_int_equal(run(folder, "oocbuild --quiet -o m.ooc m.ply"), 0);
	assert_int_equal(run(folder, "oocbench path m.ooc --frames 300 -o w.csv"), 0);
	assert_int_equal(run(folder, "oocbench path m.ooc --kind teleport --frames 300 -o t.csv"),
			 0);
	assert_int_equal(run(folder, "oocbench path m.ooc --kind reversal --frames 300 -o r.csv"),
			 0);
	walk = path_read(folder, "w.csv", 300);
	jumps = path_read(folder, "t.csv", 300);
	turns = path_read(folder, "r.csv", 300);
	/* Whole seconds of the walk, each once. */
	for (uint32_t piece = 0; piece < 10; piece++) {
		uint32_t from = 0;

		while (from < 10 && !same_eye(&jumps[piece * 30], &walk[from * 30]))
			from++;
		assert_true(from < 10);
		moved_count += from != piece;
		for (uint32_t i = 0; i < 30; i++)
			assert_true(same_eye(&jumps[piece * 30 + i], &walk[from * 30 + i]));
	}
	assert_true(moved_count > 0);
	/* Ninety frames on, sixty back with the face to the other side, and on again. */
	for (uint32_t i = 0; i < 300; i++) {
		uint32_t on = i / 150 * 30 + i % 150;
		uint32_t back = i / 150 * 30 + 180 - i % 150;

		assert_true(same_eye(&turns[i], &walk[i % 150 < 90 ? on : back]));
	}
	assert_true((turns[90].at[0] - turns[90].eye[0]) * (turns[89].at[0] - turns[89].eye[0]) +
			    (turns[90].at[1] - turns[90].eye[1]) *
				    (turns[89].at[1] - turns[89].eye[1]) <
		    0.0);
	free(walk);
	free(jumps);
	free(turns);
}

static void a_flight_stays_above_the_model_and_comes_back(void **state)
{
	const char *folder = *state;
	struct camera *cameras;

	test_store_grid(test_path(folder, "m.ooc"), 4);
	assert_int_equal(run(folder, "oocbench path m.ooc --kind fly --frames 60 -o f.csv"), 0);
	cameras = path_read(folder, "f.csv", 60);
	for (uint32_t i = 1; i < 60; i++)
		assert_true(cameras[i].eye[2] == cameras[0].eye[2] &&
			    cameras[i].at[2] < cameras[i].eye[2]);
	free(cameras);
}

static void an_orbit_keeps_the_model_in_view(void **state)
{
	const char *folder = *state;
	const struct store_superblock *superblock;
	struct store_file *store;
	struct camera *cameras;
	uint32_t count;

	test_store_grid(test_path(folder, "m.ooc"), 4);
	assert_int_equal(run(folder, "oocbench path m.ooc --kind orbit --frames 36 -o o.csv"), 0);
	assert_int_equal(camera_path_read(test_path(folder, "o.csv"), &cameras, &count, NULL), 0);
	assert_int_equal(count, 36);
	assert_int_equal(store_open_path(test_path(folder, "m.ooc"), &store, NULL), 0);
	superblock = store_superblock(store);
	for (uint32_t i = 0; i < count; i++) {
		struct camera_view view;

		assert_int_equal(camera_view_init(&view, &cameras[i], superblock, 16.0 / 9.0,
						  camera_near(&cameras[i], superblock)),
				 0);
		for (int k = 0; k < 5; k++) {
			double middle[3];

			for (int j = 0; j < 3; j++)
				middle[j] = 0.5 * (superblock->box_min[j] + superblock->box_max[j]);
			assert_true(vector_dot(view.planes[k], middle) + view.planes[k][3] > 0.5);
		}
	}
	store_close(store);
	free(cameras);
}

static void a_model_without_floors_has_no_walk_and_says_so(void **state)
{
	const char *folder = *state;
	static const char one[] = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n"
				  "property float y\nproperty float z\nelement face 1\n"
				  "property list uchar int vertex_indices\nend_header\n"
				  "0 0 0\n0 0 1\n0 1 0\n3 0 1 2\n";

	test_file_write(test_path(folder, "m.ply"), one, sizeof(one) - 1);
	assert_int_equal(run(folder, "oocbuild --quiet -o m.ooc m.ply"), 0);
	assert_int_equal(run(folder, "oocbench path m.ooc"), 1);
	assert_true(said(folder, "errors", "--kind orbit"));
}

static void wrong_command_lines_are_refused_with_two(void **state)
{
	const char *folder = *state;
	static const char *const wrong[] = { "",
					     "nothing",
					     "path",
					     "path a b",
					     "path a --kind swim",
					     "path a --frames 0",
					     "path --json a",
					     "exact a",
					     "exact a b --size 3",
					     "fetch",
					     "fetch a --depth 0",
					     "cache a --held 0",
					     "cache a --viewers 2",
					     "build a b",
					     "build --memory x" };

	for (size_t i = 0; i < ARRAY_LENGTH(wrong); i++) {
		assert_int_equal(run(folder, "oocbench %s", wrong[i]), 2);
		assert_true(said(folder, "errors", "oocbench"));
	}
	assert_int_equal(run(folder, "oocbench path missing.ooc"), 1);
	assert_true(said(folder, "errors", "missing.ooc: "));
	assert_int_equal(run(folder, "oocbench --version"), 0);
	assert_int_equal(run(folder, "oocbench build --help"), 0);
	assert_true(said(folder, "output", "Example"));
}

static void fetch_and_build_measure_something(void **state)
{
	const char *folder = *state;

	assert_int_equal(run(folder, "oocgen plant --triangles 60000 --seed 2 -o m.ply"), 0);
	assert_int_equal(run(folder, "oocbuild --quiet --leaf-triangles 500 -o m.ooc m.ply"), 0);
	assert_int_equal(run(folder, "oocbench fetch m.ooc --repeats 1 --json"), 0);
	assert_true(said(folder, "output", "\"daemon_mb_s\""));
	assert_int_equal(run(folder, "oocbench build m.ply --repeats 1 --memory 256M --json"), 0);
	assert_true(said(folder, "output", "\"triangles\": 60000"));
	assert_true(said(folder, "output", "\"within_bound\": \"yes\""));
	/* Nothing of it stays: only what this test made. */
	assert_string_equal(test_folder_list(folder), "errors m.ooc m.ply output ");
}

/* The number behind the first key of that name in the last program's output, or NaN. */
static double number_said(const char *folder, const char *key)
{
	size_t length;
	char *text = test_file_read(test_path(folder, "output"), &length);
	const char *at = length > 0 ? memmem(text, length, key, strlen(key)) : NULL;
	double number = NAN;

	if (at)
		(void)sscanf(at + strlen(key), " %lf", &number);
	free(text);
	return number;
}

static void cache_reads_the_same_bytes_in_every_way_and_counts_calls(void **state)
{
	const char *folder = *state;

	assert_int_equal(run(folder, "oocgen plant --triangles 60000 --seed 2 -o m.ply"), 0);
	assert_int_equal(run(folder, "oocbuild --quiet --leaf-triangles 500 -o m.ooc m.ply"), 0);
	/* Different sums are a failure. */
	assert_int_equal(run(folder, "oocbench cache m.ooc --quick --frames 4 --clients 2 --json "
				     "--csv frames.csv"),
			 0);
	assert_true(said(folder, "output", "\"resident_lines\""));
	assert_true(said(folder, "output", "\"mmap_nodes_s\""));
	assert_true(said(folder, "output", "\"pread_nodes_s\""));
	assert_true(said(folder, "output", "\"system_calls\":"));
	assert_true(said(folder, "frames.csv", "regime,contestant,round,frame,nodes,us"));
	assert_true(said(folder, "frames.csv", "cold_bytes,oocd,0,3,"));
}

static void a_daemon_killed_under_load_comes_back_with_all_that_was_kept(void **state)
{
	const char *folder = *state;

	assert_int_equal(run(folder, "oocgen plant --triangles 60000 --seed 2 -o m.ply"), 0);
	assert_int_equal(run(folder, "oocbuild --quiet --leaf-triangles 500 -o m.ooc m.ply"), 0);
	/* Of a copy as well.  It waits until each payload was verified, or fails. */
	assert_int_equal(run(folder, "oocbench cache m.ooc --restart --keep 4M --clients 2 "
				     "--repeats 2 --held 50 --json"),
			 0);
	assert_true(number_said(folder, "\"kept_stores\":") >= 2);
	assert_true(number_said(folder, "\"kept_bytes\":") >= 4 << 20);
	assert_true(said(folder, "output", "\"first_frame_s\""));
	assert_true(said(folder, "output", "\"verified_s\""));
	assert_true(number_said(folder, "\"survivor_frames\":") > 0);
	assert_string_equal(test_folder_list(folder), "errors m.ooc m.ply output ");
}

#define IN_FOLDER(test)                                                                            \
	cmocka_unit_test_setup_teardown(test, test_folder_setup, test_folder_teardown)

int main(void)
{
	static const struct CMUnitTest tests[] = {
		IN_FOLDER(pictures_of_a_plant_are_exact),
		IN_FOLDER(pictures_are_exact_ten_million_units_from_the_origin),
		IN_FOLDER(pictures_of_a_soup_of_floats_are_exact),
		IN_FOLDER(exact_fails_on_a_model_that_is_a_little_different),
		IN_FOLDER(exact_needs_the_ids_of_triangles),
		cmocka_unit_test(a_difference_is_explained_by_edges_and_ties_alone),
		IN_FOLDER(a_walk_keeps_off_the_walls_at_a_constant_pace),
		IN_FOLDER(teleports_and_reversals_are_the_walk_in_another_order),
		IN_FOLDER(a_flight_stays_above_the_model_and_comes_back),
		IN_FOLDER(an_orbit_keeps_the_model_in_view),
		IN_FOLDER(a_model_without_floors_has_no_walk_and_says_so),
		IN_FOLDER(wrong_command_lines_are_refused_with_two),
		IN_FOLDER(fetch_and_build_measure_something),
		IN_FOLDER(cache_reads_the_same_bytes_in_every_way_and_counts_calls),
		IN_FOLDER(a_daemon_killed_under_load_comes_back_with_all_that_was_kept),
	};

	return TEST_RUN(tests);
}
