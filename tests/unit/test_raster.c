/* SPDX-License-Identifier: MIT */
/*
 * Goal: the rasteriser draws what a ray through each pixel's centre hits, leaves no gap and no
 * overlap along shared edges, and gives the same picture wherever in the world the scene stands.
 * Method: rays in double precision, written without a look at the rasteriser; exact small cases.
 */
#include <errno.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "formats/base/random.h"
#include "libclient/select/raster.h"
#include "tests/helper.h"

#define SIDE 64u
#define STEP 0x1p-10f

static const struct store_superblock plain = { .step_exponent = -10 };
static const double no_origin[3];

static struct random dice;

static struct raster *raster_new(uint32_t width, uint32_t height)
{
	struct raster *raster = NULL;

	assert_int_equal(raster_create(width, height, &raster), 0);
	return raster;
}

/*
 * A view in which the plane y = SIDE / 2 is the screen: one unit is a pixel, x runs to the right, z
 * upwards, and 0, 0 is the middle.  Vertices can then be put on pixel centres exactly.
 */
static struct camera_view screen_view(void)
{
	struct camera camera = { .at = { 0, 1, 0 }, .up = { 0, 0, 1 }, .fov_y_degrees = 90 };
	struct camera_view view;

	assert_int_equal(camera_view_init(&view, &camera, &plain, 1.0, 0.5), 0);
	return view;
}

/* Draws triangles given in pixels on the screen's plane, from the lower left corner. */
static void screen_draw(struct raster *raster, const float (*corners)[2], uint32_t triangle_count,
			uint64_t item_first)
{
	struct camera_view view = screen_view();
	struct raster_draw draw = { .vertex_count = 3 * triangle_count,
				    .triangle_count = triangle_count,
				    .item_first = item_first,
				    .scale = 1.0f };
	float *positions = malloc(draw.vertex_count * 3 * sizeof(*positions));
	uint32_t *indices = malloc(draw.vertex_count * sizeof(*indices));

	assert_true(positions && indices);
	for (uint32_t i = 0; i < draw.vertex_count; i++) {
		positions[3 * i] = corners[i][0] - SIDE / 2;
		positions[3 * i + 1] = SIDE / 2;
		positions[3 * i + 2] = corners[i][1] - SIDE / 2;
		indices[i] = i;
	}
	draw.positions = positions;
	draw.indices = indices;
	camera_node_offset(&view, no_origin, draw.offset);
	assert_int_equal(raster_triangles(raster, &view, &draw), 0);
	free(positions);
	free(indices);
}

/* The item of a pixel counted from the lower left corner. */
static uint64_t item_at(const struct raster *raster, uint32_t x, uint32_t y)
{
	return raster_items(raster)[(SIDE - 1 - y) * SIDE + x];
}

static void raster_create_refuses_sides_that_cannot_be(void **state)
{
	struct raster *raster = NULL;

	(void)state;
	assert_int_equal(raster_create(0, 1, &raster), -EINVAL);
	assert_int_equal(raster_create(1, 0, &raster), -EINVAL);
	assert_int_equal(raster_create(16385, 1, &raster), -EINVAL);
	assert_null(raster);
	assert_int_equal(raster_create(16384, 1, &raster), 0);
	assert_null(raster_destroy(raster));
	assert_null(raster_destroy(NULL));
}

static void a_square_on_pixel_centres_owns_its_left_and_lower_edges(void **state)
{
	static const float square[6][2] = { { 8.5f, 8.5f },   { 12.5f, 8.5f }, { 12.5f, 12.5f },
					    { 12.5f, 12.5f }, { 8.5f, 12.5f }, { 8.5f, 8.5f } };
	struct raster *raster = raster_new(SIDE, SIDE);

	(void)state;
	screen_draw(raster, square, 2, 0);
	for (uint32_t y = 0; y < SIDE; y++)
		for (uint32_t x = 0; x < SIDE; x++)
			assert_int_equal(item_at(raster, x, y) != RASTER_ITEM_NONE,
					 x >= 8 && x < 12 && y >= 8 && y < 12);
	raster_destroy(raster);
}

/* How often each pixel is drawn when every triangle has a raster of its own. */
static void count_coverage(const float (*corners)[2], uint32_t triangle_count,
			   uint8_t ret[SIDE * SIDE])
{
	struct raster *raster = raster_new(SIDE, SIDE);

	memset(ret, 0, SIDE * SIDE);
	for (uint32_t i = 0; i < triangle_count; i++) {
		raster_clear(raster);
		screen_draw(raster, &corners[3 * i], 1, i);
		for (uint32_t pixel = 0; pixel < SIDE * SIDE; pixel++)
			ret[pixel] += raster_items(raster)[pixel] != RASTER_ITEM_NONE;
	}
	raster_destroy(raster);
}

static void a_closed_mesh_has_no_gap_and_no_overlap(void **state)
{
	enum {
		CELLS = 12,
		TRIANGLES = 2 * CELLS * CELLS
	};
	static const unsigned corner_cells[2][3][2] = { { { 0, 0 }, { 1, 0 }, { 1, 1 } },
							{ { 1, 1 }, { 0, 1 }, { 0, 0 } } };

	(void)state;
	for (unsigned kind = 0; kind < 3; kind++) {
		float grid[CELLS + 1][CELLS + 1][2];
		float corners[3 * TRIANGLES][2];
		uint8_t coverage[SIDE * SIDE];
		uint32_t count = 0;

		dice.state = kind;
		for (int y = 0; y <= CELLS; y++)
			for (int x = 0; x <= CELLS; x++) {
				bool inside = x > 0 && x < CELLS && y > 0 && y < CELLS;

				for (int k = 0; k < 2; k++) {
					/* Borders well outside; inside on centres, on 1/256, or anywhere. */
					double at = (k ? y : x) * 6.0 - 4.0;
					double moved = at + (inside ? 4.0 * random_unit(&dice) - 2.0
								    : 0.0);

					grid[y][x][k] = kind == 0 ? (float)(floor(moved) + 0.5)
							: kind == 1
								? (float)(rint(moved * 256) / 256)
								: (float)moved;
				}
			}
		for (int y = 0; y < CELLS; y++)
			for (int x = 0; x < CELLS; x++)
				for (int t = 0; t < 2; t++)
					for (int c = 0; c < 3; c++)
						memcpy(corners[count++],
						       grid[y + corner_cells[t][c][1]]
							   [x + corner_cells[t][c][0]],
						       sizeof(corners[0]));
		count_coverage(corners, TRIANGLES, coverage);
		for (uint32_t pixel = 0; pixel < SIDE * SIDE; pixel++)
			assert_int_equal(coverage[pixel], 1);
	}
}

static void the_larger_depth_wins_and_a_tie_goes_to_the_lower_item(void **state)
{
	static const float all[3][2] = { { -200, -100 }, { 300, -100 }, { 32, 400 } };
	struct raster *raster = raster_new(SIDE, SIDE);
	struct camera_view view = screen_view();
	static const float nearer[9] = { -40, 16, -40, 40, 16, -40, 0, 16, 60 };
	static const uint32_t indices[3] = { 0, 1, 2 };
	static const uint64_t name = 1000;
	struct raster_draw draw = { .positions = nearer,
				    .vertex_count = 3,
				    .indices = indices,
				    .triangle_count = 1,
				    .items = &name,
				    .scale = 1.0f };

	(void)state;
	screen_draw(raster, all, 1, 7);
	screen_draw(raster, all, 1, 9);
	assert_int_equal(item_at(raster, 20, 20), 7);
	screen_draw(raster, all, 1, 5);
	assert_int_equal(item_at(raster, 20, 20), 5);
	assert_true(raster_depths(raster)[0] == 0.5f / 32.0f);

	camera_node_offset(&view, no_origin, draw.offset);
	assert_int_equal(raster_triangles(raster, &view, &draw), 0);
	assert_int_equal(item_at(raster, 32, 32), 1000);
	screen_draw(raster, all, 1, 5);
	assert_int_equal(item_at(raster, 32, 32), 1000);

	raster_clear(raster);
	assert_true(item_at(raster, 32, 32) == RASTER_ITEM_NONE);
	assert_true(raster_depths(raster)[0] == 0.0f);
	raster_destroy(raster);
}

static void both_sides_are_drawn_and_the_top_row_comes_first(void **state)
{
	static const float one_way[3][2] = { { 10, 50 }, { 20, 50 }, { 15, 60 } };
	static const float other_way[3][2] = { { 40, 50 }, { 45, 60 }, { 50, 50 } };
	struct raster *raster = raster_new(SIDE, SIDE);

	(void)state;
	screen_draw(raster, one_way, 1, 1);
	screen_draw(raster, other_way, 1, 2);
	assert_int_equal(raster_items(raster)[(SIDE - 1 - 52) * SIDE + 15], 1);
	assert_int_equal(raster_items(raster)[(SIDE - 1 - 52) * SIDE + 45], 2);
	raster_destroy(raster);
}

/* ---- rays ---- */

struct soup {
	float *positions; /* in steps */
	uint32_t *indices;
	uint32_t triangle_count;
};

static void soup_make(struct soup *soup, uint64_t seed, uint32_t triangle_count, double size)
{
	soup->triangle_count = triangle_count;
	soup->positions = malloc(9 * triangle_count * sizeof(*soup->positions));
	soup->indices = malloc(3 * triangle_count * sizeof(*soup->indices));
	assert_true(soup->positions && soup->indices);
	dice.state = seed;
	for (uint32_t i = 0; i < triangle_count; i++) {
		double centre[3];

		for (int k = 0; k < 3; k++)
			centre[k] = 10.0 * random_unit(&dice) - 5.0;
		for (uint32_t c = 0; c < 9; c++)
			soup->positions[9 * i + c] = (float)rint(
				(centre[c % 3] + size * (random_unit(&dice) - 0.5)) / (double)STEP);
	}
	for (uint32_t i = 0; i < 3 * triangle_count; i++)
		soup->indices[i] = i;
}

static void soup_done(struct soup *soup)
{
	free(soup->positions);
	free(soup->indices);
}

static void soup_draw(struct raster *raster, const struct camera_view *view,
		      const struct soup *soup, const double origin[3])
{
	struct raster_draw draw = { .positions = soup->positions,
				    .vertex_count = 3 * soup->triangle_count,
				    .indices = soup->indices,
				    .triangle_count = soup->triangle_count,
				    .scale = STEP };

	camera_node_offset(view, origin, draw.offset);
	assert_int_equal(raster_triangles(raster, view, &draw), 0);
}

static double determinant(const double a[3], const double b[3], const double c[3])
{
	return a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) +
	       a[2] * (b[0] * c[1] - b[1] * c[0]);
}

/*
 * The triangle that a ray from the eye through a point of the picture hits first, beyond the near
 * plane; x, y in pixels.  The ray meets a triangle where all three volumes have one sign.
 */
static uint64_t ray_item(const struct camera_view *view, const struct soup *soup, double x,
			 double y, double *ret_depth)
{
	uint64_t item = RASTER_ITEM_NONE;
	double ray[3];

	*ret_depth = INFINITY;
	for (int k = 0; k < 3; k++)
		ray[k] = view->forward[k] +
			 view->right[k] * view->tan_half_x * (2.0 * x / SIDE - 1.0) +
			 view->up[k] * view->tan_half_y * (2.0 * y / SIDE - 1.0);
	for (uint32_t i = 0; i < soup->triangle_count; i++) {
		double v[3][3];
		double volumes[3];
		double depth;

		for (int c = 0; c < 3; c++)
			for (int k = 0; k < 3; k++)
				v[c][k] =
					(double)soup->positions[9 * i + 3 * c + k] * (double)STEP -
					view->eye[k];
		for (int c = 0; c < 3; c++)
			volumes[c] = determinant(ray, v[(c + 1) % 3], v[(c + 2) % 3]);
		if (!((volumes[0] >= 0 && volumes[1] >= 0 && volumes[2] >= 0) ||
		      (volumes[0] <= 0 && volumes[1] <= 0 && volumes[2] <= 0)))
			continue;
		/* ray * depth = a point of the plane; forward . ray is 1, so this is w. */
		depth = determinant(v[0], v[1], v[2]) / (volumes[0] + volumes[1] + volumes[2]);
		if (depth >= view->near && depth < *ret_depth) {
			*ret_depth = depth;
			item = i;
		}
	}
	return item;
}

/* Is the item hit by some ray within a few subpixels of the pixel's centre, or as deep as the hit? */
static bool is_within_reason(const struct camera_view *view, const struct soup *soup, uint64_t item,
			     double x, double y)
{
	for (int dy = -1; dy <= 1; dy++)
		for (int dx = -1; dx <= 1; dx++) {
			double depth;

			if (ray_item(view, soup, x + dx / 128.0, y + dy / 128.0, &depth) == item)
				return true;
		}
	return false;
}

static void compare_with_rays(const struct camera_view *view, const struct soup *soup,
			      uint32_t *different, uint32_t *covered)
{
	struct raster *raster = raster_new(SIDE, SIDE);

	soup_draw(raster, view, soup, no_origin);
	for (uint32_t y = 0; y < SIDE; y++)
		for (uint32_t x = 0; x < SIDE; x++) {
			uint64_t item = item_at(raster, x, y);
			double depth;

			if (item != RASTER_ITEM_NONE)
				++*covered;
			if (ray_item(view, soup, x + 0.5, y + 0.5, &depth) != item) {
				++*different;
				assert_true(is_within_reason(view, soup, item, x + 0.5, y + 0.5));
			} else if (item != RASTER_ITEM_NONE) {
				double ours = raster_depths(raster)[(SIDE - 1 - y) * SIDE + x];

				/* Depth planes of slivers are steep: the snapped centre is off. */
				assert_true(fabs(ours * depth / view->near - 1.0) < 0.2);
			}
		}
	raster_destroy(raster);
}

static void every_pixel_shows_what_its_ray_hits_or_is_a_subpixel_from_it(void **state)
{
	uint32_t different = 0;
	uint32_t covered = 0;

	(void)state;
	for (uint64_t seed = 1; seed <= 24; seed++) {
		struct camera camera = { .up = { 0, 0, 1 }, .fov_y_degrees = 70 };
		struct camera_view view;
		struct soup soup;

		/* Small ones from outside; large ones around the eye, cut by near and side planes. */
		soup_make(&soup, seed, seed % 2 ? 150 : 40, seed % 2 ? 2.0 : 12.0);
		for (int k = 0; k < 3; k++) {
			camera.eye[k] = (seed % 2 ? 16.0 : 4.0) * (random_unit(&dice) - 0.5);
			camera.at[k] = 2.0 * random_unit(&dice);
		}
		assert_int_equal(camera_view_init(&view, &camera, &plain, 1.0, 0.25), 0);
		compare_with_rays(&view, &soup, &different, &covered);
		soup_done(&soup);
	}
	assert_true(covered > 40000);
	assert_true(different * 100 < covered);
}

/* Three points that are on a line as the eye sees them, but for so many pixels. */
static void sliver_make(const struct camera_view *view, double pixels, float positions[9],
			float *ret_nearest)
{
	double ray[2][3];

	for (int side = 0; side < 2; side++)
		for (int k = 0; k < 3; k++)
			ray[side][k] = view->forward[k] +
				       view->right[k] * 0.9 * (2.0 * random_unit(&dice) - 1.0) +
				       view->up[k] * 0.9 * (2.0 * random_unit(&dice) - 1.0);
	*ret_nearest = 0.0f;
	for (int c = 0; c < 3; c++) {
		double along = random_unit(&dice);
		double aside = pixels * (random_unit(&dice) - 0.5) * 2.0 / SIDE;
		double distance = 2.0 + 20.0 * random_unit(&dice);
		double w = 0.0;

		for (int k = 0; k < 3; k++) {
			double at = distance * (ray[0][k] + along * (ray[1][k] - ray[0][k]) +
						aside * view->up[k]);

			positions[3 * c + k] = (float)rint(at / (double)STEP);
			w += view->forward[k] * (double)positions[3 * c + k] * (double)STEP;
		}
		*ret_nearest = fmaxf(*ret_nearest, (float)(view->near / w));
	}
}

/* Without RASTER_DEPTH_OFFSET some are, by more than all the depths that they have. */
static void a_triangle_seen_edge_on_is_nowhere_nearer_than_its_nearest_corner(void **state)
{
	struct raster *raster = raster_new(SIDE, SIDE);
	struct camera_view view = screen_view();
	uint32_t covered = 0;

	(void)state;
	dice.state = 5;
	for (unsigned turn = 0; turn < 4000; turn++) {
		uint32_t indices[] = { 0, 1, 2 };
		float positions[9];
		const struct soup soup = { positions, indices, 1 };
		float nearest;

		sliver_make(&view, turn % 2 == 0 ? 0.0 : 0.1, positions, &nearest);
		raster_clear(raster);
		soup_draw(raster, &view, &soup, no_origin);
		for (uint32_t i = 0; i < SIDE * SIDE; i++) {
			assert_true(raster_depths(raster)[i] <= nearest * 1.00001f);
			covered += raster_items(raster)[i] == 0;
		}
	}
	assert_true(covered > 100);
	raster_destroy(raster);
}

static void a_scene_moved_far_from_the_origin_gives_the_same_picture(void **state)
{
	struct raster *first = raster_new(SIDE, SIDE);
	struct raster *raster = raster_new(SIDE, SIDE);
	struct soup soup;

	(void)state;
	soup_make(&soup, 5, 2000, 1.0);
	for (int view_number = 0; view_number < 8; view_number++) {
		for (unsigned kind = 0; kind < 2; kind++) {
			for (double shift = 0.0; shift < 2e7;
			     shift = shift == 0.0 ? 1e3 : shift * 10) {
				struct store_superblock superblock = plain;
				struct camera camera = { .up = { 0, 0, 1 }, .fov_y_degrees = 60 };
				double origin[3] = { 0, 0, 0 };
				struct camera_view view;

				dice.state = (uint64_t)view_number;
				for (int k = 0; k < 3; k++) {
					/* Either the store stands there, or the payload in the store. */
					(kind == 0 ? superblock.origin : origin)[k] = shift;
					camera.eye[k] =
						shift +
						rint(2048 * (random_unit(&dice) - 0.5)) / 128;
					camera.at[k] = shift +
						       rint(256 * (random_unit(&dice) - 0.5)) / 128;
				}
				assert_int_equal(
					camera_view_init(&view, &camera, &superblock, 1.0, 0.1), 0);
				raster_clear(raster);
				soup_draw(shift == 0.0 ? first : raster, &view, &soup, origin);
				if (shift == 0.0)
					continue;
				assert_memory_equal(raster_items(first), raster_items(raster),
						    SIDE * SIDE * sizeof(uint64_t));
				assert_memory_equal(raster_depths(first), raster_depths(raster),
						    SIDE * SIDE * sizeof(float));
			}
			raster_clear(first);
		}
	}
	soup_done(&soup);
	raster_destroy(first);
	raster_destroy(raster);
}

/* Positions are multiples of the step, so how they are divided over payloads shows nowhere. */
static void a_vertex_lands_on_the_same_bits_from_any_payload(void **state)
{
	struct raster *one = raster_new(SIDE, SIDE);
	struct raster *many = raster_new(SIDE, SIDE);
	struct soup soup;

	(void)state;
	soup_make(&soup, 6, 1000, 1.0);
	for (uint64_t seed = 1; seed <= 10; seed++) {
		struct camera camera = { .up = { 0, 0, 1 }, .fov_y_degrees = 60 };
		struct camera_view view;

		dice.state = seed;
		for (int k = 0; k < 3; k++) {
			camera.eye[k] = 16.0 * (random_unit(&dice) - 0.5);
			camera.at[k] = 2.0 * random_unit(&dice);
		}
		assert_int_equal(camera_view_init(&view, &camera, &plain, 1.0, 0.1), 0);
		raster_clear(one);
		raster_clear(many);
		soup_draw(one, &view, &soup, no_origin);
		for (uint32_t i = 0; i < soup.triangle_count; i++) {
			struct raster_draw draw = { .vertex_count = 3,
						    .indices = soup.indices,
						    .triangle_count = 1,
						    .item_first = i,
						    .scale = STEP };
			double origin[3];
			float moved[9];

			for (int k = 0; k < 3; k++)
				origin[k] = rint(20.0 * (random_unit(&dice) - 0.5) / (double)STEP) *
					    (double)STEP;
			for (int c = 0; c < 9; c++)
				moved[c] = soup.positions[9 * i + (uint32_t)c] -
					   (float)(origin[c % 3] / (double)STEP);
			draw.positions = moved;
			camera_node_offset(&view, origin, draw.offset);
			assert_int_equal(raster_triangles(many, &view, &draw), 0);
		}
		assert_memory_equal(raster_items(one), raster_items(many),
				    SIDE * SIDE * sizeof(uint64_t));
	}
	soup_done(&soup);
	raster_destroy(one);
	raster_destroy(many);
}

static void positions_beyond_all_floats_draw_nothing_and_harm_nothing(void **state)
{
	static const float far_away[9] = { 3e38f, 1, 1, -3e38f, 3e38f, 0, 0, -3e38f, 3e38f };
	static const uint32_t indices[3] = { 0, 1, 2 };
	struct raster *raster = raster_new(SIDE, SIDE);
	struct camera_view view = screen_view();
	struct raster_draw draw = { .positions = far_away,
				    .vertex_count = 3,
				    .indices = indices,
				    .triangle_count = 1,
				    .scale = 1024.0f };

	(void)state;
	assert_int_equal(raster_triangles(raster, &view, &draw), 0);
	for (uint32_t pixel = 0; pixel < SIDE * SIDE; pixel++)
		assert_true(raster_items(raster)[pixel] == RASTER_ITEM_NONE);
	raster_destroy(raster);
}

int main(void)
{
	static const struct CMUnitTest tests[] = {
		cmocka_unit_test(raster_create_refuses_sides_that_cannot_be),
		cmocka_unit_test(a_square_on_pixel_centres_owns_its_left_and_lower_edges),
		cmocka_unit_test(a_closed_mesh_has_no_gap_and_no_overlap),
		cmocka_unit_test(the_larger_depth_wins_and_a_tie_goes_to_the_lower_item),
		cmocka_unit_test(both_sides_are_drawn_and_the_top_row_comes_first),
		cmocka_unit_test(every_pixel_shows_what_its_ray_hits_or_is_a_subpixel_from_it),
		cmocka_unit_test(a_triangle_seen_edge_on_is_nowhere_nearer_than_its_nearest_corner),
		cmocka_unit_test(a_scene_moved_far_from_the_origin_gives_the_same_picture),
		cmocka_unit_test(a_vertex_lands_on_the_same_bits_from_any_payload),
		cmocka_unit_test(positions_beyond_all_floats_draw_nothing_and_harm_nothing),
	};

	return TEST_RUN(tests);
}
