/* SPDX-License-Identifier: MIT */
/*
 * Goal: what oocview writes is what the stores hold, each pixel against the software rasteriser.
 * Method: the program itself, headless, with a daemon in another process.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "formats/store/payload.h"
#include "formats/store/store_file.h"
#include "libclient/select/raster.h"
#include "tests/helper.h"
#include "tests/integration/view_kit.h"
#include "tests/store_image.h"

/* Odd, so that a picture upside down or a row too far does not pass. */
#define WIDTH  321
#define HEIGHT 203

/* Inside the grid and outside of it, level and rolled.  The grid is at (100, 200, 300). */
static const char *const cameras[] = {
	"0,92.5,188.1,309.7,103,203,303,0,0,1,45",
	"0,103.01,202.97,303.02,106,206,304.5,0,0,1,70",
	"0,110,204,302,103,203,303,0.3,0.2,1,30",
};

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
static void assert_items_are(const struct view_image *image, const struct raster *raster)
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

static void check_against_raster(struct view_fixture *fixture, const char *store, const char *row,
				 bool by_id)
{
	struct view_image image;
	struct raster *raster;

	view_must(view_run(fixture,
			   "--headless --size %dx%d --camera %s --channel triangle "
			   "--screenshot t.raw %s",
			   WIDTH, HEIGHT, row, store));
	image = view_load_raw(view_file(fixture, "t.raw"));
	assert_int_equal(image.header.width, WIDTH);
	raster = raster_store(view_file(fixture, store), row, &image.header, by_id);
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
	struct view_fixture *fixture = *state;

	view_start_daemon(fixture, 64 * MIB);
	for (size_t g = 0; g < ARRAY_LENGTH(grids); g++) {
		char name[16];

		(void)snprintf(name, sizeof(name), "g%zu.ooc", g);
		test_store_grid_make(view_file(fixture, name), &grids[g]);
		for (size_t c = 0; c < ARRAY_LENGTH(cameras); c++)
			check_against_raster(fixture, name, cameras[c], false);
	}
}

static void a_triangle_with_an_id_shows_its_id(void **state)
{
	const struct test_grid grid = { .count = 4, .triangle_ids = true };
	struct view_fixture *fixture = *state;

	view_start_daemon(fixture, 64 * MIB);
	test_store_grid_make(view_file(fixture, "g.ooc"), &grid);
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
	struct view_fixture *fixture = *state;

	view_start_daemon(fixture, 64 * MIB);
	test_store_grid_make(view_file(fixture, "near.ooc"), &grid);
	move_store(view_file(fixture, "near.ooc"), view_file(fixture, "far.ooc"), far, 0.0);
	check_against_raster(fixture, "far.ooc", far_row, false);
	view_must(view_run(fixture,
			   "--headless --size 640x480 --camera %s --screenshot far.png far.ooc",
			   far_row));
	view_must(view_run(fixture,
			   "--headless --size 640x480 --camera %s --screenshot near.png near.ooc",
			   cameras[0]));
	test_assert_same_files(view_file(fixture, "near.png"), view_file(fixture, "far.png"));
}

static void depth_is_the_rasterisers(void **state)
{
	struct view_fixture *fixture = *state;
	struct view_image image;
	struct raster *raster;
	size_t covered = 0;
	size_t wrong = 0;

	view_start_daemon(fixture, 64 * MIB);
	test_store_grid(view_file(fixture, "g.ooc"), 5);
	view_must(view_run(
		fixture,
		"--headless --size %dx%d --camera %s --channel depth --screenshot d.raw g.ooc",
		WIDTH, HEIGHT, cameras[0]));
	image = view_load_raw(view_file(fixture, "d.raw"));
	raster = raster_store(view_file(fixture, "g.ooc"), cameras[0], &image.header, false);
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
static void tiles_make_up_the_picture(void **state)
{
	struct view_fixture *fixture = *state;
	struct view_image image;
	struct raster *raster;

	view_start_daemon(fixture, 64 * MIB);
	test_store_grid(view_file(fixture, "g.ooc"), 5);
	/* Wider than a tile. */
	view_must(view_run(fixture,
			   "--headless --size 5001x333 --camera %s --channel triangle "
			   "--screenshot t.raw g.ooc",
			   cameras[1]));
	image = view_load_raw(view_file(fixture, "t.raw"));
	assert_int_equal(image.header.width, 5001);
	raster = raster_store(view_file(fixture, "g.ooc"), cameras[1], &image.header, false);
	assert_items_are(&image, raster);
	raster_destroy(raster);
	free(image.file);
}

static void several_stores_share_a_view_and_their_units_agree(void **state)
{
	const double metres[3] = { 0.0, 0.0, 0.0 };
	const double decimetres[3] = { 80.0, 0.0, 0.0 };
	const char *row = "0,6,-30,9,6,2,2,0,0,1,45";
	struct view_fixture *fixture = *state;
	struct view_image image;
	uint32_t left[2] = { WIDTH, WIDTH };
	uint32_t right[2] = { 0, 0 };

	view_start_daemon(fixture, 64 * MIB);
	test_store_grid(view_file(fixture, "g.ooc"), 4);
	move_store(view_file(fixture, "g.ooc"), view_file(fixture, "m.ooc"), metres, 1.0);
	move_store(view_file(fixture, "g.ooc"), view_file(fixture, "dm.ooc"), decimetres, 0.1);
	view_must(view_run(fixture,
			   "--headless --size %dx%d --camera %s --channel node --screenshot n.raw "
			   "m.ooc dm.ooc",
			   WIDTH, HEIGHT, row));
	image = view_load_raw(view_file(fixture, "n.raw"));
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
	struct view_fixture *fixture = *state;
	struct view_image image;
	bool seen[3] = { false, false, false };

	view_start_daemon(fixture, 64 * MIB);
	test_store_grid_make(view_file(fixture, "g.ooc"), &grid);
	view_must(view_run(fixture,
			   "--headless --size %dx%d --channel part --screenshot p.raw g.ooc", WIDTH,
			   HEIGHT));
	image = view_load_raw(view_file(fixture, "p.raw"));
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
	struct view_fixture *fixture = *state;

	view_start_daemon(fixture, 64 * MIB);
	for (size_t g = 0; g < 2; g++) {
		struct view_image image;
		size_t covered = 0;
		size_t axial = 0;

		test_store_grid_make(view_file(fixture, "g.ooc"), &grids[g]);
		view_must(view_run(fixture,
				   "--headless --size %dx%d --camera %s --channel normal "
				   "--screenshot n.raw g.ooc",
				   WIDTH, HEIGHT, cameras[0]));
		image = view_load_raw(view_file(fixture, "n.raw"));
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
int main(void)
{
	const struct CMUnitTest tests[] = {
		VIEW_TEST(every_pixel_shows_the_triangle_that_the_rasteriser_says),
		VIEW_TEST(a_triangle_with_an_id_shows_its_id),
		VIEW_TEST(ten_million_units_from_the_origin_the_picture_is_the_same),
		VIEW_TEST(depth_is_the_rasterisers),
		VIEW_TEST(tiles_make_up_the_picture),
		VIEW_TEST(several_stores_share_a_view_and_their_units_agree),
		VIEW_TEST(parts_are_items_and_colours_are_the_stores),
		VIEW_TEST(normals_face_the_eye_and_are_flat_where_there_are_none),
	};

	return TEST_RUN(tests);
}
