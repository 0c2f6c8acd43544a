/* SPDX-License-Identifier: MIT */
/*
 * Goal: a conservative picture is the full one, whichever way what shows is tested, with less drawn;
 * what had no time to come is said to be missing; each order is what was asked for.
 * Method: the program itself, headless, with a daemon in another process; pixels compared as items.
 */
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
#include "tests/helper.h"
#include "tests/integration/view_kit.h"

static const char *const ways[] = { "items", "queries", "software" };

/* Inside the grid, outside, close before a face, and away from all; the grid is at (100, 200, 300). */
static const char *const cameras[] = {
	"0,103.01,202.97,303.02,106,206,304.5,0,0,1,70",
	"0,92.5,188.1,309.7,104,204,304,0,0,1,45",
	"0,103.24,203.5,303.5,104,203.6,303.4,0,0,1,90",
	"0,92.5,188.1,309.7,80,170,320,0,0,1,45",
};

/* Eight boxes along an edge: from most places most of them are hidden. */
static void make_store(const struct view_fixture *fixture)
{
	const struct test_grid grid = { .count = 8, .face_quads = 3 };

	test_store_grid_make(view_file(fixture, "g.ooc"), &grid);
}

static void write_camera_path(const struct view_fixture *fixture, const char *name)
{
	FILE *file = fopen(view_file(fixture, name), "we");

	assert_non_null(file);
	(void)fprintf(file, "t,eye_x,eye_y,eye_z,at_x,at_y,at_z,up_x,up_y,up_z,fov_y\n");
	for (size_t i = 0; i < ARRAY_LENGTH(cameras); i++)
		(void)fprintf(file, "%s\n", cameras[i]);
	(void)fclose(file);
}

static void assert_same_items(const struct view_fixture *fixture, const char *one,
			      const char *other)
{
	test_assert_same_files(view_file(fixture, one), view_file(fixture, other));
}

static void a_settled_conservative_picture_is_the_full_one(void **state)
{
	struct view_fixture *fixture = *state;

	view_start_daemon(fixture, 64 * MIB);
	make_store(fixture);
	for (size_t c = 0; c < ARRAY_LENGTH(cameras); c++) {
		view_must(view_run(fixture,
				   "--headless --size 321x203 --camera %s --channel triangle "
				   "--screenshot full.raw g.ooc",
				   cameras[c]));
		for (size_t w = 0; w < ARRAY_LENGTH(ways); w++) {
			view_must(view_run(fixture,
					   "--headless --json --size 321x203 --camera %s --channel "
					   "triangle --mode conservative --visibility %s "
					   "--screenshot shown.raw g.ooc",
					   cameras[c], ways[w]));
			assert_same_items(fixture, "full.raw", "shown.raw");
			assert_non_null(strstr(view_output, "\"exact\":1"));
		}
	}
}

static void less_is_drawn_where_much_is_hidden(void **state)
{
	struct view_fixture *fixture = *state;
	double full;

	view_start_daemon(fixture, 64 * MIB);
	make_store(fixture);
	view_must(view_run(fixture, "--headless --json --camera %s --screenshot a.png g.ooc",
			   cameras[0]));
	full = view_summary_number("nodes_drawn");
	for (size_t w = 0; w < ARRAY_LENGTH(ways); w++) {
		view_must(view_run(fixture,
				   "--headless --json --camera %s --mode conservative "
				   "--visibility %s --screenshot a.png g.ooc",
				   cameras[0], ways[w]));
		assert_true(view_summary_number("nodes_drawn") < full);
		assert_true(view_summary_number("nodes_shown") > 0.0);
		assert_true(view_summary_number("nodes_shown") <=
			    view_summary_number("nodes_drawn"));
		assert_true(view_summary_number("rounds") > 1.0);
		assert_true(view_summary_number("boxes_tested") > 0.0);
		assert_true((view_summary_number("queries") > 0.0) ==
			    (strcmp(ways[w], "queries") == 0));
	}
}

/* The frames of the path, and twice those of it. */
static void assert_same_frames(const struct view_fixture *fixture)
{
	for (int frame = 0; frame < 8; frame++) {
		char full[64];
		char shown[64];

		(void)snprintf(full, sizeof(full), "full/frame_%06d.png", frame % 4);
		(void)snprintf(shown, sizeof(shown), "shown/frame_%06d.png", frame);
		test_assert_same_files(view_file(fixture, full), view_file(fixture, shown));
	}
}

/* Live frames one after the other, each begun with what the one before showed. */
static void a_live_conservative_frame_is_the_full_one(void **state)
{
	struct view_fixture *fixture = *state;

	view_start_daemon(fixture, 64 * MIB);
	make_store(fixture);
	write_camera_path(fixture, "p.csv");
	view_must(view_run(fixture, "--headless --settle --size 321x203 --path p.csv --frames full "
				    "--unlit g.ooc"));
	for (size_t w = 0; w < ARRAY_LENGTH(ways); w++) {
		view_must(view_run(fixture,
				   "--headless --json --size 321x203 --path p.csv --repeat 2 "
				   "--mode conservative --visibility %s --deadline 60000 --unlit "
				   "--frames shown g.ooc",
				   ways[w]));
		assert_true(view_summary_number("incomplete_frames") == 0.0);
		assert_same_frames(fixture);
	}
}

/* Boxes of two stores lie in the same places: OpenGL shows those that were drawn first. */
static void ties_in_depth_go_where_a_full_picture_has_them(void **state)
{
	const struct test_grid fewer = { .count = 5, .face_quads = 3 };
	struct view_fixture *fixture = *state;

	view_start_daemon(fixture, 64 * MIB);
	make_store(fixture);
	test_store_grid_make(view_file(fixture, "h.ooc"), &fewer);
	write_camera_path(fixture, "p.csv");
	view_must(view_run(fixture, "--headless --settle --size 321x203 --path p.csv --frames full "
				    "--channel triangle g.ooc h.ooc"));
	for (size_t w = 0; w < ARRAY_LENGTH(ways); w++) {
		view_must(view_run(fixture,
				   "--headless --json --size 321x203 --path p.csv --repeat 2 "
				   "--mode conservative --visibility %s --deadline 60000 "
				   "--channel triangle --frames shown g.ooc h.ooc",
				   ways[w]));
		assert_same_frames(fixture);
	}
}

static void a_cache_for_a_few_nodes_is_enough_for_a_settled_picture(void **state)
{
	struct view_fixture *fixture = *state;
	const struct test_grid grid = { .count = 6, .face_quads = 8, .normals = true };

	test_store_grid_make(view_file(fixture, "g.ooc"), &grid);
	view_start_daemon(fixture, 1 * MIB);
	view_must(view_run(fixture, "--headless --camera %s --screenshot full.png g.ooc",
			   cameras[1]));
	/* OpenGL and not: the ways differ in where nodes go, not in how they come. */
	for (size_t w = 0; w < ARRAY_LENGTH(ways); w += 2) {
		view_must(view_run(fixture,
				   "--headless --camera %s --mode conservative --visibility %s "
				   "--screenshot shown.png g.ooc",
				   cameras[1], ways[w]));
		test_assert_same_files(view_file(fixture, "full.png"),
				       view_file(fixture, "shown.png"));
	}
}

static void copies_and_tiles_and_several_stores_show_the_same(void **state)
{
	const char *const variants[] = { "--gpu-cache 1G g.ooc", "--size 5001x333 g.ooc",
					 "g.ooc h.ooc" };
	const struct test_grid other = { .count = 5, .face_quads = 2 };
	struct view_fixture *fixture = *state;

	view_start_daemon(fixture, 64 * MIB);
	make_store(fixture);
	test_store_grid_make(view_file(fixture, "h.ooc"), &other);
	for (size_t i = 0; i < ARRAY_LENGTH(variants); i++) {
		/* The two stores lie in one place: where they tie, the list's order decides. */
		const char *channel = i == 2 ? "depth" : "triangle";

		view_must(view_run(fixture,
				   "--headless --camera %s --channel %s --screenshot full.raw %s",
				   cameras[1], channel, variants[i]));
		view_must(view_run(fixture,
				   "--headless --camera %s --channel %s --mode conservative "
				   "--screenshot shown.raw %s",
				   cameras[1], channel, variants[i]));
		assert_same_items(fixture, "full.raw", "shown.raw");
	}
}

static void what_has_not_come_by_the_deadline_is_missing_and_said_so(void **state)
{
	struct view_fixture *fixture = *state;

	view_start_daemon(fixture, 64 * MIB);
	make_store(fixture);
	write_camera_path(fixture, "p.csv");
	/* The first frame may wait for nothing, and nothing is there. */
	view_must(view_run(fixture, "--headless --json --size 321x203 --path p.csv --mode "
				    "conservative --deadline 0 --stats s.csv g.ooc"));
	assert_true(view_summary_number("incomplete_frames") >= 1.0);
	view_must(test_command(view_output, sizeof(view_output),
			       "awk -F, 'NR == 1 { for (i = 1; i <= NF; i++) c[$i] = i } "
			       "NR == 2 { print $c[\"incomplete\"], $c[\"way\"], "
			       "$c[\"nodes_drawn\"] }' %s/s.csv",
			       fixture->folder));
	assert_string_equal(view_output, "1 exact 0\n");
	view_must(view_run(fixture, "--headless --json --settle --size 321x203 --path p.csv --mode "
				    "conservative --deadline 0 g.ooc"));
	assert_true(view_summary_number("incomplete_frames") == 0.0);
	assert_true(view_summary_number("nodes_missing") == 0.0);
}

static void queries_can_be_made_late(void **state)
{
	struct view_fixture *fixture = *state;

	view_start_daemon(fixture, 64 * MIB);
	make_store(fixture);
	view_must(view_run(fixture,
			   "--headless --json --camera %s --mode conservative --visibility queries "
			   "--query-latency 30 --screenshot a.png g.ooc",
			   cameras[0]));
	/* No less than that; how much more is the machine's business. */
	assert_true(view_summary_number("max") >= 30.0 * view_summary_number("rounds"));
}

static void each_order_is_what_was_asked_for(void **state)
{
	const char *const orders[] = { "layer",    "solidity", "extinction", "transmittance",
				       "distance", "coverage", "auto" };
	struct view_fixture *fixture = *state;

	view_start_daemon(fixture, 64 * MIB);
	make_store(fixture);
	write_camera_path(fixture, "p.csv");
	for (size_t i = 0; i < ARRAY_LENGTH(orders); i++) {
		char expected[64];

		view_must(view_run(fixture,
				   "--headless --settle --size 160x120 --path p.csv --mode "
				   "approximate --budget 3000 --order %s --stats s.csv g.ooc",
				   orders[i]));
		view_must(test_command(view_output, sizeof(view_output),
				       "awk -F, 'NR == 1 { for (i = 1; i <= NF; i++) c[$i] = i } "
				       "NR == 2 { print $c[\"way\"], $c[\"order\"], $c[\"budget\"] "
				       "}' %s/s.csv",
				       fixture->folder));
		(void)snprintf(expected, sizeof(expected), "budget %s 3000\n", orders[i]);
		assert_string_equal(view_output, expected);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		VIEW_TEST(a_settled_conservative_picture_is_the_full_one),
		VIEW_TEST(less_is_drawn_where_much_is_hidden),
		VIEW_TEST(a_live_conservative_frame_is_the_full_one),
		VIEW_TEST(ties_in_depth_go_where_a_full_picture_has_them),
		VIEW_TEST(a_cache_for_a_few_nodes_is_enough_for_a_settled_picture),
		VIEW_TEST(copies_and_tiles_and_several_stores_show_the_same),
		VIEW_TEST(what_has_not_come_by_the_deadline_is_missing_and_said_so),
		VIEW_TEST(queries_can_be_made_late),
		VIEW_TEST(each_order_is_what_was_asked_for),
	};

	return TEST_RUN(tests);
}
