/* SPDX-License-Identifier: MIT */
/*
 * Goal: what oocview writes is what the stores hold: each pixel against the software rasteriser,
 * each way of drawing against the others, each wrong use with one line and the right status.
 * Method: the program itself, headless, with a daemon in another process.
 */
#include <math.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/inotify.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "formats/store/payload.h"
#include "formats/store/store_file.h"
#include "libclient/select/raster.h"
#include "tests/helper.h"
#include "tests/integration/daemon_kit.h"
#include "tests/store_image.h"
#include "viewer/image.h"

#define OUTPUT_BYTES 8192

/* Odd, so that a picture upside down or a row too far does not pass. */
#define WIDTH  321
#define HEIGHT 203

/* Inside the grid and outside of it, level and rolled.  The grid is at (100, 200, 300). */
static const char *const cameras[] = {
	"0,92.5,188.1,309.7,103,203,303,0,0,1,45",
	"0,103.01,202.97,303.02,106,206,304.5,0,0,1,70",
	"0,110,204,302,103,203,303,0.3,0.2,1,30",
};

static char output[OUTPUT_BYTES];

/* A daemon and the folder that it and the pictures are in. */
struct fixture {
	char *folder;
	struct kit_daemon daemon;
};

static int set_up(void **state)
{
	struct fixture *fixture = calloc(1, sizeof(*fixture));

	assert_non_null(fixture);
	fixture->folder = test_folder_make();
	*state = fixture;
	return 0;
}

static int tear_down(void **state)
{
	struct fixture *fixture = *state;

	if (fixture->daemon.pid > 0)
		assert_int_equal(kit_daemon_stop(&fixture->daemon, SIGTERM), 0);
	test_folder_remove(fixture->folder);
	free(fixture);
	return 0;
}

static void start_daemon(struct fixture *fixture, uint64_t cache_bytes)
{
	struct server_config config = kit_config();

	if (fixture->daemon.pid > 0)
		assert_int_equal(kit_daemon_stop(&fixture->daemon, SIGTERM), 0);
	config.cache_bytes = cache_bytes;
	kit_daemon_start(fixture->folder, &config, &fixture->daemon);
}

/* Runs oocview; a relative name in the arguments is one in the folder. */
static int __attribute__((format(printf, 2, 3)))
view(const struct fixture *fixture, const char *format, ...)
{
	char arguments[2048];
	va_list args;

	va_start(args, format);
	(void)vsnprintf(arguments, sizeof(arguments), format, args);
	va_end(args);
	return test_command(output, sizeof(output),
			    "cd %s && exec $OOCD_BIN/oocview --socket %s/oocd.sock %s",
			    fixture->folder, fixture->folder, arguments);
}

static void must_view(int status)
{
	if (status != 0)
		fail_msg("oocview ended with %d: %s", status, output);
}

static const char *in(const struct fixture *fixture, const char *name)
{
	return test_path(fixture->folder, name);
}

/* ---- pictures ---- */

struct raw_image {
	void *file;
	struct image_raw_header header;
	const uint64_t *items;
	const float *reals;
};

static struct raw_image load_raw(const char *path)
{
	struct raw_image image;
	size_t bytes;

	image.file = test_file_read(path, &bytes);
	assert_true(bytes > sizeof(image.header));
	memcpy(&image.header, image.file, sizeof(image.header));
	assert_int_equal(bytes, sizeof(image.header) + (size_t)image.header.width *
							       image.header.height *
							       image.header.pixel_bytes);
	image.items = (const void *)((const uint8_t *)image.file + sizeof(image.header));
	image.reals = (const void *)image.items;
	return image;
}

static void assert_same_files(const char *one, const char *other)
{
	size_t one_bytes;
	size_t other_bytes;
	void *one_file = test_file_read(one, &one_bytes);
	void *other_file = test_file_read(other, &other_bytes);

	assert_int_equal(one_bytes, other_bytes);
	assert_memory_equal(one_file, other_file, one_bytes);
	free(one_file);
	free(other_file);
}

/* ---- brute force ---- */

static void raster_payload(struct raster *raster, const struct camera_view *camera_view,
			   const void *payload, uint64_t item_first, bool by_id)
{
	struct payload_view view;
	struct raster_draw draw = { .item_first = item_first };
	float *positions;
	uint32_t *indices;

	payload_view(payload, &view);
	positions = calloc(view.header->vertex_count, 3 * sizeof(float));
	indices = calloc(view.header->triangle_count, 3 * sizeof(uint32_t));
	assert_non_null(positions);
	assert_non_null(indices);
	for (uint32_t v = 0; v < view.header->vertex_count; v++) {
		const uint16_t *shorts = (const uint16_t *)view.positions + 4 * (size_t)v;
		const float *floats = (const float *)view.positions + 4 * (size_t)v;

		for (uint32_t k = 0; k < 3; k++)
			positions[3 * v + k] = view.position_format == PAYLOAD_U16X3_RUN
						       ? (float)shorts[k]
						       : floats[k];
	}
	for (uint32_t i = 0; i < 3 * view.header->triangle_count; i++)
		indices[i] = payload_index(&view, i / 3, i % 3);
	draw.positions = positions;
	draw.vertex_count = view.header->vertex_count;
	draw.indices = indices;
	draw.triangle_count = view.header->triangle_count;
	draw.items = by_id ? view.triangle_ids : NULL;
	draw.scale = (float)view.header->scale;
	camera_node_offset(camera_view, view.header->origin, draw.offset);
	assert_int_equal(raster_triangles(raster, camera_view, &draw), 0);
	free(positions);
	free(indices);
}

/* All triangles of a store, whether in view or not. */
static struct raster *raster_store(const char *path, const char *row,
				   const struct image_raw_header *header, bool by_id)
{
	struct why why = { "" };
	struct camera camera;
	struct camera_view camera_view;
	struct store_file *store;
	struct store_node *nodes;
	struct raster *raster;
	uint64_t node_count;

	assert_int_equal(raster_create(header->width, header->height, &raster), 0);
	assert_int_equal(camera_from_row(&camera, row, &why), 0);
	assert_int_equal(store_open_path(path, &store, &why), 0);
	node_count = store_superblock(store)->node_count;
	nodes = calloc(node_count, sizeof(*nodes));
	assert_non_null(nodes);
	assert_int_equal(store_load_hs(store, nodes, &why), 0);
	assert_int_equal(camera_view_init(&camera_view, &camera, store_superblock(store),
					  (double)header->width / header->height, header->near),
			 0);
	for (uint32_t i = 0; i < node_count; i++) {
		void *payload;
		void *scratch;

		if (nodes[i].payload_id == 0)
			continue;
		payload = aligned_alloc(16, nodes[i].payload_bytes);
		scratch = malloc(nodes[i].stored_bytes);
		assert_non_null(payload);
		assert_non_null(scratch);
		assert_int_equal(store_read_payload(store, &nodes[i], payload, scratch, &why), 0);
		free(scratch);
		raster_payload(raster, &camera_view, payload, (uint64_t)i << 32, by_id);
		free(payload);
	}
	free(nodes);
	store_close(store);
	return raster;
}

/* At most 1 in 10^4 of the covered pixels may differ, and there must be some. */
static void assert_items_are(const struct raw_image *image, const struct raster *raster)
{
	const uint64_t *expected = raster_items(raster);
	size_t pixel_count = (size_t)image->header.width * image->header.height;
	size_t covered = 0;
	size_t wrong = 0;

	for (size_t i = 0; i < pixel_count; i++) {
		covered += expected[i] != RASTER_ITEM_NONE;
		wrong += expected[i] != image->items[i];
	}
	assert_true(covered > pixel_count / 50);
	if (wrong * 10000 > covered)
		fail_msg("%zu of %zu covered pixels are wrong", wrong, covered);
}

static void check_against_raster(struct fixture *fixture, const char *store, const char *row,
				 bool by_id)
{
	struct raw_image image;
	struct raster *raster;

	must_view(view(fixture,
		       "--headless --size %dx%d --camera %s --channel triangle "
		       "--screenshot t.raw %s",
		       WIDTH, HEIGHT, row, store));
	image = load_raw(in(fixture, "t.raw"));
	assert_int_equal(image.header.width, WIDTH);
	raster = raster_store(in(fixture, store), row, &image.header, by_id);
	assert_items_are(&image, raster);
	raster_destroy(raster);
	free(image.file);
}

static void every_pixel_shows_the_triangle_that_the_rasteriser_says(void **state)
{
	const struct test_grid grids[] = {
		{ .count = 5, .face_quads = 3, .normals = true },
		{ .count = 5, .face_quads = 2, .float_positions = true, .colours = true },
		{ .count = 5, .codec = STORE_CODEC_MESHOPT_ZSTD },
	};
	struct fixture *fixture = *state;

	start_daemon(fixture, 64 * MIB);
	for (size_t g = 0; g < ARRAY_LENGTH(grids); g++) {
		char name[16];

		(void)snprintf(name, sizeof(name), "g%zu.ooc", g);
		test_store_grid_make(in(fixture, name), &grids[g]);
		for (size_t c = 0; c < ARRAY_LENGTH(cameras); c++)
			check_against_raster(fixture, name, cameras[c], false);
	}
}

static void a_triangle_with_an_id_shows_its_id(void **state)
{
	const struct test_grid grid = { .count = 4, .triangle_ids = true };
	struct fixture *fixture = *state;

	start_daemon(fixture, 64 * MIB);
	test_store_grid_make(in(fixture, "g.ooc"), &grid);
	check_against_raster(fixture, "g.ooc", cameras[0], true);
}

/* Copies a store to another place and unit of the world. */
static void move_store(const char *from, const char *to, const double origin[3], double unit_metres)
{
	struct store_image image;

	store_image_load(from, &image);
	for (uint32_t slot = 0; slot < STORE_SUPERBLOCK_COUNT; slot++) {
		struct store_superblock *superblock = store_image_superblock(&image, slot);

		if (superblock->generation == 0)
			continue;
		memcpy(superblock->origin, origin, sizeof(superblock->origin));
		superblock->unit_metres = unit_metres;
		store_image_seal_superblock(&image, slot);
	}
	store_image_save(&image, to);
	store_image_done(&image);
}

static void ten_million_units_from_the_origin_the_picture_is_the_same(void **state)
{
	const struct test_grid grid = { .count = 5, .face_quads = 3 };
	const double far[3] = { 1e7, -3e7, 2e7 };
	const char *far_row = "0,9999992.5,-30000011.9,20000009.7,10000003,-29999997,20000003,"
			      "0,0,1,45";
	struct fixture *fixture = *state;

	start_daemon(fixture, 64 * MIB);
	test_store_grid_make(in(fixture, "near.ooc"), &grid);
	move_store(in(fixture, "near.ooc"), in(fixture, "far.ooc"), far, 0.0);
	check_against_raster(fixture, "far.ooc", far_row, false);
	must_view(view(fixture,
		       "--headless --size 640x480 --camera %s --screenshot far.png far.ooc",
		       far_row));
	must_view(view(fixture,
		       "--headless --size 640x480 --camera %s --screenshot near.png near.ooc",
		       cameras[0]));
	assert_same_files(in(fixture, "near.png"), in(fixture, "far.png"));
}

static void depth_is_the_rasterisers(void **state)
{
	struct fixture *fixture = *state;
	struct raw_image image;
	struct raster *raster;
	size_t covered = 0;
	size_t wrong = 0;

	start_daemon(fixture, 64 * MIB);
	test_store_grid(in(fixture, "g.ooc"), 5);
	must_view(
		view(fixture,
		     "--headless --size %dx%d --camera %s --channel depth --screenshot d.raw g.ooc",
		     WIDTH, HEIGHT, cameras[0]));
	image = load_raw(in(fixture, "d.raw"));
	raster = raster_store(in(fixture, "g.ooc"), cameras[0], &image.header, false);
	for (size_t i = 0; i < WIDTH * HEIGHT; i++) {
		float expected = raster_depths(raster)[i];

		covered += expected > 0.0f;
		wrong += fabsf(expected - image.reals[i]) > 1e-4f * expected;
	}
	assert_true(covered > 1000);
	assert_true(wrong * 10000 <= covered);
	raster_destroy(raster);
	free(image.file);
}

/* ---- ways of drawing ---- */

/* A number of the --json summary. */
static double summary_number(const char *key)
{
	char quoted[64];
	const char *at;

	(void)snprintf(quoted, sizeof(quoted), "\"%s\":", key);
	at = strstr(output, quoted);
	if (!at)
		fail_msg("no %s in %s", key, output);
	return strtod(at + strlen(quoted), NULL);
}

static void copied_and_in_place_give_the_same_picture(void **state)
{
	const struct test_grid grid = {
		.count = 6, .face_quads = 4, .normals = true, .colours = true
	};
	struct fixture *fixture = *state;

	start_daemon(fixture, 64 * MIB);
	test_store_grid_make(in(fixture, "g.ooc"), &grid);
	must_view(view(fixture, "--headless --json --screenshot place.png g.ooc"));
	assert_non_null(strstr(output, "\"in_place\":true"));
	must_view(view(fixture, "--headless --json --gpu-cache 1G --screenshot copy.png g.ooc"));
	assert_non_null(strstr(output, "\"in_place\":false"));
	assert_same_files(in(fixture, "place.png"), in(fixture, "copy.png"));
	/* A cache of a few nodes: each is copied, drawn and given up. */
	must_view(view(fixture, "--headless --gpu-cache 100K --screenshot small.png g.ooc"));
	assert_same_files(in(fixture, "place.png"), in(fixture, "small.png"));
}

static void portions_give_the_same_picture_as_the_whole(void **state)
{
	const struct test_grid grid = { .count = 8, .face_quads = 8, .normals = true };
	struct fixture *fixture = *state;

	test_store_grid_make(in(fixture, "g.ooc"), &grid);
	start_daemon(fixture, 64 * MIB);
	must_view(view(fixture, "--headless --json --screenshot whole.png g.ooc"));
	assert_true(summary_number("portions") == 1.0);
	start_daemon(fixture, 1 * MIB);
	must_view(view(fixture, "--headless --json --screenshot portions.png g.ooc"));
	assert_true(summary_number("portions") > 3.0);
	assert_true(summary_number("nodes_missing") == 0.0);
	assert_same_files(in(fixture, "whole.png"), in(fixture, "portions.png"));
}

static void two_viewers_with_a_cache_for_neither_both_get_whole_pictures(void **state)
{
	const struct test_grid grid = { .count = 8, .face_quads = 8, .normals = true };
	struct fixture *fixture = *state;

	test_store_grid_make(in(fixture, "g.ooc"), &grid);
	start_daemon(fixture, 1 * MIB);
	must_view(test_command(output, sizeof(output),
			       "cd %s && v=\"$OOCD_BIN/oocview --socket oocd.sock --headless\" && "
			       "{ $v --screenshot a.png g.ooc & $v --screenshot b.png g.ooc && "
			       "wait $!; }",
			       fixture->folder));
	assert_same_files(in(fixture, "a.png"), in(fixture, "b.png"));
}

static void tiles_make_up_the_picture(void **state)
{
	struct fixture *fixture = *state;
	struct raw_image image;
	struct raster *raster;

	start_daemon(fixture, 64 * MIB);
	test_store_grid(in(fixture, "g.ooc"), 5);
	/* Wider than a tile. */
	must_view(view(fixture,
		       "--headless --size 5001x333 --camera %s --channel triangle "
		       "--screenshot t.raw g.ooc",
		       cameras[1]));
	image = load_raw(in(fixture, "t.raw"));
	assert_int_equal(image.header.width, 5001);
	raster = raster_store(in(fixture, "g.ooc"), cameras[1], &image.header, false);
	assert_items_are(&image, raster);
	raster_destroy(raster);
	free(image.file);
}

static void several_stores_share_a_view_and_their_units_agree(void **state)
{
	const double metres[3] = { 0.0, 0.0, 0.0 };
	const double decimetres[3] = { 80.0, 0.0, 0.0 };
	const char *row = "0,6,-30,9,6,2,2,0,0,1,45";
	struct fixture *fixture = *state;
	struct raw_image image;
	uint32_t left[2] = { WIDTH, WIDTH };
	uint32_t right[2] = { 0, 0 };

	start_daemon(fixture, 64 * MIB);
	test_store_grid(in(fixture, "g.ooc"), 4);
	move_store(in(fixture, "g.ooc"), in(fixture, "m.ooc"), metres, 1.0);
	move_store(in(fixture, "g.ooc"), in(fixture, "dm.ooc"), decimetres, 0.1);
	must_view(view(fixture,
		       "--headless --size %dx%d --camera %s --channel node --screenshot n.raw "
		       "m.ooc dm.ooc",
		       WIDTH, HEIGHT, row));
	image = load_raw(in(fixture, "n.raw"));
	for (uint32_t i = 0; i < WIDTH * HEIGHT; i++) {
		uint64_t store = image.items[i] >> 32;
		uint32_t x = i % WIDTH;

		if (image.items[i] == CHANNEL_ITEM_NONE)
			continue;
		assert_true(store < 2);
		left[store] = x < left[store] ? x : left[store];
		right[store] = x > right[store] ? x : right[store];
	}
	free(image.file);
	/* Eight pixels a metre: four metres wide beside four decimetres, eight metres to the right. */
	assert_in_range(right[0] - left[0], 24, 32);
	assert_in_range(left[1] - left[0], 56, 72);
	assert_in_range(right[1] - left[1], 1, 6);
}

static void parts_are_items_and_colours_are_the_stores(void **state)
{
	const struct test_grid grid = { .count = 4, .part_count = 3 };
	struct fixture *fixture = *state;
	struct raw_image image;
	bool seen[3] = { false, false, false };

	start_daemon(fixture, 64 * MIB);
	test_store_grid_make(in(fixture, "g.ooc"), &grid);
	must_view(view(fixture, "--headless --size %dx%d --channel part --screenshot p.raw g.ooc",
		       WIDTH, HEIGHT));
	image = load_raw(in(fixture, "p.raw"));
	for (size_t i = 0; i < WIDTH * HEIGHT; i++) {
		if (image.items[i] == CHANNEL_ITEM_NONE)
			continue;
		assert_true(image.items[i] < 3);
		seen[image.items[i]] = true;
	}
	free(image.file);
	assert_true(seen[0] && seen[1] && seen[2]);
}

static void normals_face_the_eye_and_are_flat_where_there_are_none(void **state)
{
	const struct test_grid grids[] = { { .count = 4, .normals = true }, { .count = 4 } };
	struct fixture *fixture = *state;

	start_daemon(fixture, 64 * MIB);
	for (size_t g = 0; g < 2; g++) {
		struct raw_image image;
		size_t covered = 0;
		size_t axial = 0;

		test_store_grid_make(in(fixture, "g.ooc"), &grids[g]);
		must_view(view(fixture,
			       "--headless --size %dx%d --camera %s --channel normal "
			       "--screenshot n.raw g.ooc",
			       WIDTH, HEIGHT, cameras[0]));
		image = load_raw(in(fixture, "n.raw"));
		for (size_t i = 0; i < WIDTH * HEIGHT; i++) {
			const float *n = image.reals + 3 * i;
			float largest = fmaxf(fabsf(n[0]), fmaxf(fabsf(n[1]), fabsf(n[2])));

			if (largest == 0.0f)
				continue;
			covered++;
			/* Boxes have axial faces; pixels at edges may mix two. */
			axial += largest > 0.99f;
			/* The camera looks along +x, +y and -z. */
			if (largest > 0.99f)
				assert_true(n[0] < 0.5f && n[1] < 0.5f && n[2] > -0.5f);
		}
		assert_true(covered > 1000);
		assert_true(axial * 10 > covered * 9);
		free(image.file);
	}
}

static void a_budget_is_kept(void **state)
{
	struct fixture *fixture = *state;

	start_daemon(fixture, 64 * MIB);
	test_store_grid(in(fixture, "g.ooc"), 8);
	must_view(view(fixture, "--headless --json --screenshot full.png g.ooc"));
	assert_true(summary_number("triangles_max") == 8 * 8 * 8 * 12.0);
	must_view(view(
		fixture,
		"--headless --json --mode approximate --budget 1000 --screenshot b.png g.ooc"));
	assert_true(summary_number("triangles_max") >= 96.0);
	assert_true(summary_number("triangles_max") <= 1000.0 + 96.0);
}

/* ---- films ---- */

static void write_path(const struct fixture *fixture, const char *name, uint32_t rows)
{
	FILE *file = fopen(in(fixture, name), "we");

	assert_non_null(file);
	(void)fprintf(file, "t,eye_x,eye_y,eye_z,at_x,at_y,at_z,up_x,up_y,up_z,fov_y\n");
	for (uint32_t i = 0; i < rows; i++)
		(void)fprintf(file, "%g,%g,188,309,103,203,303,0,0,1,45\n", 0.1 * i, 92.0 + i);
	(void)fclose(file);
}

static void a_film_has_a_picture_a_row_and_a_recording_a_frame(void **state)
{
	struct fixture *fixture = *state;
	size_t bytes;
	char *text;
	char *line;
	int rows = 0;

	start_daemon(fixture, 64 * MIB);
	test_store_grid(in(fixture, "g.ooc"), 4);
	write_path(fixture, "p.csv", 3);
	must_view(view(fixture,
		       "--headless --settle --size 160x120 --path p.csv --repeat 2 --frames film "
		       "--record r.csv --stats s.csv g.ooc"));
	assert_string_equal(test_folder_list(in(fixture, "film")),
			    "frame_000000.png frame_000001.png frame_000002.png frame_000003.png "
			    "frame_000004.png frame_000005.png ");
	assert_same_files(in(fixture, "film/frame_000001.png"),
			  in(fixture, "film/frame_000004.png"));
	text = test_file_read(in(fixture, "s.csv"), &bytes);
	text = realloc(text, bytes + 1);
	assert_non_null(text);
	text[bytes] = '\0';
	for (line = strtok(text, "\n"); line; line = strtok(NULL, "\n")) {
		unsigned frame;
		unsigned wanted;
		unsigned drawn;
		unsigned missing;
		unsigned triangles;
		unsigned long fetched;
		double t;
		double ms;

		if (rows++ == 0)
			continue;
		assert_int_equal(sscanf(line, "%u,%lf,%lf,%u,%u,%u,%u,%lu", &frame, &t, &ms,
					&wanted, &drawn, &missing, &triangles, &fetched),
				 8);
		assert_int_equal(frame, rows - 2);
		assert_true(fabs(t - 0.1 * (frame % 3)) < 1e-9);
		assert_true(ms > 0.0);
		assert_int_equal(drawn, wanted);
		assert_int_equal(missing, 0);
		assert_int_equal(triangles, 4 * 4 * 4 * 12);
		/* All of it is read for the first frame, nothing for the others. */
		assert_true((fetched > 0) == (frame == 0));
	}
	assert_int_equal(rows, 7);
	free(text);
	/* The recording is a path like any other, here twice as long. */
	must_view(view(fixture, "--headless --settle --size 160x120 --path r.csv --frames again "
				"g.ooc"));
	assert_same_files(in(fixture, "film/frame_000002.png"),
			  in(fixture, "again/frame_000005.png"));
}

/* Starts a program and does not wait. */
static pid_t start_view(const struct fixture *fixture, const char *arguments)
{
	char command[1024];
	pid_t child;

	(void)snprintf(command, sizeof(command),
		       "cd %s && exec $OOCD_BIN/oocview --socket oocd.sock %s", fixture->folder,
		       arguments);
	(void)fflush(NULL);
	child = fork();
	assert_true(child >= 0);
	if (child == 0) {
		(void)execl("/bin/sh", "sh", "-c", command, (char *)NULL);
		_exit(127);
	}
	return child;
}

static void a_signal_ends_a_film_cleanly(void **state)
{
	const int signals[] = { SIGINT, SIGTERM };
	struct fixture *fixture = *state;

	start_daemon(fixture, 64 * MIB);
	test_store_grid(in(fixture, "g.ooc"), 4);
	write_path(fixture, "p.csv", 3);
	for (size_t i = 0; i < 2; i++) {
		char event[4096];
		int status;
		int watch = inotify_init1(IN_CLOEXEC);
		pid_t child;

		assert_true(watch >= 0);
		(void)test_command(NULL, 0, "rm -rf %s/film && mkdir %s/film", fixture->folder,
				   fixture->folder);
		assert_true(inotify_add_watch(watch, in(fixture, "film"), IN_MOVED_TO) >= 0);
		child = start_view(fixture, "--headless --settle --size 160x120 --path p.csv "
					    "--repeat 100000 --frames film g.ooc");
		/* The first picture is there: now it is in the midst of it. */
		assert_true(read(watch, event, sizeof(event)) > 0);
		assert_int_equal(kill(child, signals[i]), 0);
		assert_int_equal(waitpid(child, &status, 0), child);
		assert_true(WIFEXITED(status));
		assert_int_equal(WEXITSTATUS(status), 130);
		assert_null(strstr(test_folder_list(in(fixture, "film")), "part"));
		(void)close(watch);
	}
}

static void a_film_goes_on_when_the_daemon_is_started_again(void **state)
{
	struct fixture *fixture = *state;
	char event[4096];
	int status;
	int watch;
	pid_t child;

	start_daemon(fixture, 1 * MIB);
	test_store_grid(in(fixture, "g.ooc"), 8);
	write_path(fixture, "p.csv", 3);
	must_view(view(fixture,
		       "--headless --settle --size 160x120 --path p.csv --frames film g.ooc"));
	(void)test_command(NULL, 0, "mkdir %s/again", fixture->folder);
	watch = inotify_init1(IN_CLOEXEC);
	assert_true(watch >= 0);
	assert_true(inotify_add_watch(watch, in(fixture, "again"), IN_MOVED_TO) >= 0);
	child = start_view(fixture, "--headless --settle --size 160x120 --path p.csv --repeat 30 "
				    "--frames again g.ooc");
	assert_true(read(watch, event, sizeof(event)) > 0);
	assert_int_equal(kit_daemon_stop(&fixture->daemon, SIGKILL), -SIGKILL);
	fixture->daemon.pid = 0;
	start_daemon(fixture, 1 * MIB);
	assert_int_equal(waitpid(child, &status, 0), child);
	assert_true(WIFEXITED(status));
	assert_int_equal(WEXITSTATUS(status), 0);
	for (int i = 0; i < 3; i++) {
		char name[64];
		char last[64];

		(void)snprintf(name, sizeof(name), "film/frame_%06d.png", i);
		(void)snprintf(last, sizeof(last), "again/frame_%06d.png", 87 + i);
		assert_same_files(in(fixture, name), in(fixture, last));
	}
	(void)close(watch);
}

/* ---- models ---- */

/* A tetrahedron of that size. */
static void write_model(const struct fixture *fixture, const char *name, double size)
{
	FILE *file = fopen(in(fixture, name), "we");

	assert_non_null(file);
	(void)fprintf(file,
		      "v 0 0 0\nv %g 0 0\nv 0 %g 0\nv 0 0 %g\n"
		      "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n",
		      size, size, size);
	(void)fclose(file);
}

/* Runs oocview with a cache folder of its own; says whether it built a store. */
static bool view_model(const struct fixture *fixture, const char *arguments)
{
	must_view(test_command(output, sizeof(output),
			       "cd %s && XDG_CACHE_HOME=%s/cache exec $OOCD_BIN/oocview "
			       "--socket oocd.sock --headless --size 160x120 %s",
			       fixture->folder, fixture->folder, arguments));
	return strstr(output, "building its store") != NULL;
}

static unsigned stores_in_cache(const struct fixture *fixture)
{
	char count[32];

	assert_int_equal(test_command(count, sizeof(count), "ls %s/cache/oocd/*.ooc | wc -l",
				      fixture->folder),
			 0);
	return (unsigned)strtoul(count, NULL, 10);
}

static void a_model_is_built_once_and_again_when_it_changes(void **state)
{
	struct fixture *fixture = *state;

	start_daemon(fixture, 64 * MIB);
	write_model(fixture, "m.obj", 1.0);
	assert_true(view_model(fixture, "--screenshot 1.png m.obj"));
	assert_false(view_model(fixture, "--screenshot 2.png m.obj"));
	assert_same_files(in(fixture, "1.png"), in(fixture, "2.png"));
	assert_int_equal(stores_in_cache(fixture), 1);
	/* A longer file: the time of change need not differ. */
	write_model(fixture, "m.obj", 0.125);
	assert_true(view_model(fixture, "--screenshot 3.png m.obj"));
	assert_int_equal(stores_in_cache(fixture), 1);
	/* Another model of the same name is another model. */
	assert_int_equal(test_command(NULL, 0, "cd %s && mkdir d && cp m.obj d", fixture->folder),
			 0);
	assert_true(view_model(fixture, "--screenshot 4.png d/m.obj"));
	assert_same_files(in(fixture, "3.png"), in(fixture, "4.png"));
	assert_int_equal(stores_in_cache(fixture), 2);
}

static void a_folder_or_list_is_built_again_when_a_file_in_it_changes(void **state)
{
	struct fixture *fixture = *state;
	FILE *list;

	start_daemon(fixture, 64 * MIB);
	assert_int_equal(test_command(NULL, 0, "mkdir %s/d", fixture->folder), 0);
	write_model(fixture, "d/m.obj", 1.0);
	list = fopen(in(fixture, "l.csv"), "we");
	assert_non_null(list);
	(void)fprintf(list, "file,m00,m01,m02,m03,m10,m11,m12,m13,m20,m21,m22,m23\n"
			    "d/m.obj,1,0,0,0,0,1,0,0,0,0,1,0\n");
	(void)fclose(list);
	assert_true(view_model(fixture, "--screenshot 1.png d"));
	assert_false(view_model(fixture, "--screenshot 1.png d"));
	assert_true(view_model(fixture, "--screenshot 2.png l.csv"));
	assert_false(view_model(fixture, "--screenshot 2.png l.csv"));
	write_model(fixture, "d/m.obj", 0.125);
	assert_true(view_model(fixture, "--screenshot 1.png d"));
	assert_true(view_model(fixture, "--screenshot 2.png l.csv"));
	assert_int_equal(stores_in_cache(fixture), 2);
}

static void a_summary_stays_alone_on_standard_output(void **state)
{
	struct fixture *fixture = *state;

	start_daemon(fixture, 64 * MIB);
	write_model(fixture, "m.obj", 1.0);
	assert_true(view_model(fixture, "--json --screenshot 1.png m.obj >summary.json"));
	must_view(test_command(output, sizeof(output),
			       "wc -l <%s/summary.json && cat %s/summary.json", fixture->folder,
			       fixture->folder));
	assert_memory_equal(output, "1\n{\"renderer\":", 14);
}

static void a_model_that_cannot_be_built_leaves_no_store(void **state)
{
	struct fixture *fixture = *state;

	start_daemon(fixture, 64 * MIB);
	test_file_write(in(fixture, "m.ply"), "this is no model", 16);
	assert_int_equal(test_command(output, sizeof(output),
				      "cd %s && XDG_CACHE_HOME=%s/cache exec $OOCD_BIN/oocview "
				      "--socket oocd.sock --headless --screenshot 1.png m.ply",
				      fixture->folder, fixture->folder),
			 1);
	assert_non_null(strstr(output, "oocbuild: "));
	assert_non_null(strstr(output, "oocview: m.ply: no store could be built of it"));
	assert_string_equal(test_folder_list(in(fixture, "cache/oocd")), "lock ");
}

/* ---- wrong use ---- */

static void wrong_use_is_told_in_a_line(void **state)
{
	const struct {
		const char *arguments;
		int status;
		const char *says;
	} cases[] = {
		{ "", 2, "nothing to draw" },
		{ "--headless g.ooc", 2, "--headless needs --screenshot or --path" },
		{ "--headless --screenshot a.jpg g.ooc", 2, "--screenshot: \"a.jpg\" will not do" },
		{ "--headless --screenshot a.png --size 0x3 g.ooc", 2, "--size: \"0x3\"" },
		{ "--headless --screenshot a.png --size 640 g.ooc", 2, "--size: \"640\"" },
		{ "--headless --screenshot a.png --mode quick g.ooc", 2, "--mode: \"quick\"" },
		{ "--headless --screenshot a.png --background red g.ooc", 2, "--background" },
		{ "--headless --screenshot a.png --channel red g.ooc", 2, "--channel: \"red\"" },
		{ "--headless --screenshot a.png --gpu-cache 0 g.ooc", 2, "--gpu-cache" },
		{ "--headless --screenshot a.png --repeat 0 g.ooc", 2, "--repeat" },
		{ "--channel part g.ooc", 2, "needs --headless" },
		{ "--frames film g.ooc", 2, "--frames needs --path" },
		{ "--camera 1,2,3 --path p.csv g.ooc", 2, "do not go together" },
		{ "--nonsense g.ooc", 2, "nonsense" },
		{ "--headless --screenshot a.png --camera 1,2,3 g.ooc", 1, "--camera: 3 numbers" },
		{ "--headless --screenshot a.png --camera no.csv g.ooc", 1, "no.csv" },
		{ "--headless --path no.csv g.ooc", 1, "no.csv" },
		{ "--headless --screenshot a.png no.ooc", 1, "no.ooc: No such file" },
		{ "--headless --screenshot a.png cut.ooc", 1, "cut.ooc: " },
		{ "--headless --screenshot no/a.png g.ooc", 1, "no/a.png: No such file" },
		{ "--headless --path p.csv --frames p.csv g.ooc", 1, "p.csv" },
		{ "--headless --path p.csv --stats no/s.csv g.ooc", 1, "no/s.csv: No such file" },
		{ "--headless --path p.csv --record no/r.csv g.ooc", 1, "no/r.csv: No such file" },
	};
	struct fixture *fixture = *state;
	size_t bytes;
	void *store;

	start_daemon(fixture, 64 * MIB);
	test_store_grid(in(fixture, "g.ooc"), 2);
	write_path(fixture, "p.csv", 1);
	store = test_file_read(in(fixture, "g.ooc"), &bytes);
	test_file_write(in(fixture, "cut.ooc"), store, bytes / 2);
	free(store);
	for (size_t i = 0; i < ARRAY_LENGTH(cases); i++) {
		int status = view(fixture, "%s", cases[i].arguments);

		if (status != cases[i].status || !strstr(output, cases[i].says))
			fail_msg("oocview %s: %d, %s", cases[i].arguments, status, output);
		/* One line, which begins with the program's name. */
		assert_non_null(strchr(output, '\n'));
		assert_true(strchr(output, '\n')[1] == '\0');
		assert_non_null(strstr(output, "oocview: "));
	}
}

static void a_daemon_or_display_that_is_not_there_is_told_in_a_line(void **state)
{
	struct fixture *fixture = *state;

	test_store_grid(in(fixture, "g.ooc"), 2);
	assert_int_equal(view(fixture, "--headless --screenshot a.png g.ooc"), 1);
	assert_non_null(strstr(output, "oocd.sock"));
	assert_true(strchr(output, '\n')[1] == '\0');
	start_daemon(fixture, 64 * MIB);
	assert_int_equal(test_command(output, sizeof(output),
				      "cd %s && unset WAYLAND_DISPLAY && DISPLAY=:7777 exec "
				      "$OOCD_BIN/oocview --socket oocd.sock g.ooc",
				      fixture->folder),
			 1);
	assert_non_null(strstr(output, "--headless needs no display"));
	assert_true(strchr(output, '\n')[1] == '\0');
}

static void a_damaged_node_is_told_and_the_rest_drawn(void **state)
{
	struct fixture *fixture = *state;
	struct store_image image;
	struct store_node *nodes;
	uint32_t victim = 0;
	size_t bytes;

	start_daemon(fixture, 64 * MIB);
	test_store_grid(in(fixture, "g.ooc"), 4);
	store_image_load(in(fixture, "g.ooc"), &image);
	nodes = store_image_nodes(&image);
	while (nodes[victim].payload_id == 0)
		victim++;
	((uint8_t *)store_image_payload(&image, victim))[300] ^= 1;
	store_image_save(&image, in(fixture, "bad.ooc"));
	store_image_done(&image);
	assert_int_equal(view(fixture, "--headless --json --screenshot a.png bad.ooc"), 1);
	assert_non_null(strstr(output, "is damaged and not drawn"));
	assert_true(summary_number("nodes_missing") == 1.0);
	assert_true(summary_number("nodes_drawn") == 7.0);
	free(test_file_read(in(fixture, "a.png"), &bytes));
}

static void help_and_version_answer(void **state)
{
	struct fixture *fixture = *state;

	assert_int_equal(view(fixture, "--help"), 0);
	assert_non_null(strstr(output, "Examples:"));
	assert_int_equal(view(fixture, "--version"), 0);
	assert_string_equal(output, "oocview " OOCD_VERSION "\n");
}

#define WITH_FIXTURE(test) cmocka_unit_test_setup_teardown(test, set_up, tear_down)

int main(void)
{
	const struct CMUnitTest tests[] = {
		WITH_FIXTURE(every_pixel_shows_the_triangle_that_the_rasteriser_says),
		WITH_FIXTURE(a_triangle_with_an_id_shows_its_id),
		WITH_FIXTURE(ten_million_units_from_the_origin_the_picture_is_the_same),
		WITH_FIXTURE(depth_is_the_rasterisers),
		WITH_FIXTURE(copied_and_in_place_give_the_same_picture),
		WITH_FIXTURE(portions_give_the_same_picture_as_the_whole),
		WITH_FIXTURE(two_viewers_with_a_cache_for_neither_both_get_whole_pictures),
		WITH_FIXTURE(tiles_make_up_the_picture),
		WITH_FIXTURE(several_stores_share_a_view_and_their_units_agree),
		WITH_FIXTURE(parts_are_items_and_colours_are_the_stores),
		WITH_FIXTURE(normals_face_the_eye_and_are_flat_where_there_are_none),
		WITH_FIXTURE(a_budget_is_kept),
		WITH_FIXTURE(a_film_has_a_picture_a_row_and_a_recording_a_frame),
		WITH_FIXTURE(a_signal_ends_a_film_cleanly),
		WITH_FIXTURE(a_film_goes_on_when_the_daemon_is_started_again),
		WITH_FIXTURE(a_model_is_built_once_and_again_when_it_changes),
		WITH_FIXTURE(a_folder_or_list_is_built_again_when_a_file_in_it_changes),
		WITH_FIXTURE(a_summary_stays_alone_on_standard_output),
		WITH_FIXTURE(a_model_that_cannot_be_built_leaves_no_store),
		WITH_FIXTURE(wrong_use_is_told_in_a_line),
		WITH_FIXTURE(a_daemon_or_display_that_is_not_there_is_told_in_a_line),
		WITH_FIXTURE(a_damaged_node_is_told_and_the_rest_drawn),
		WITH_FIXTURE(help_and_version_answer),
	};

	return TEST_RUN(tests);
}
