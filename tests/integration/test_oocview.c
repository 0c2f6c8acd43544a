/* SPDX-License-Identifier: MIT */
/*
 * Goal: each way of drawing gives the same picture, models are built when need be, each wrong use
 * gets one line and the right status.
 * Method: the program itself, headless, with a daemon in another process.
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
#include "tests/store_image.h"

static void copied_and_in_place_give_the_same_picture(void **state)
{
	const struct test_grid grid = {
		.count = 6, .face_quads = 4, .normals = true, .colours = true
	};
	struct view_fixture *fixture = *state;

	view_start_daemon(fixture, 64 * MIB);
	test_store_grid_make(view_file(fixture, "g.ooc"), &grid);
	view_must(view_run(fixture, "--headless --json --screenshot place.png g.ooc"));
	assert_non_null(strstr(view_output, "\"in_place\":true"));
	view_must(
		view_run(fixture, "--headless --json --gpu-cache 1G --screenshot copy.png g.ooc"));
	assert_non_null(strstr(view_output, "\"in_place\":false"));
	test_assert_same_files(view_file(fixture, "place.png"), view_file(fixture, "copy.png"));
	/* A cache of a few nodes: each is copied, drawn and given up. */
	view_must(view_run(fixture, "--headless --gpu-cache 100K --screenshot small.png g.ooc"));
	test_assert_same_files(view_file(fixture, "place.png"), view_file(fixture, "small.png"));
}

static void portions_give_the_same_picture_as_the_whole(void **state)
{
	const struct test_grid grid = { .count = 8, .face_quads = 8, .normals = true };
	struct view_fixture *fixture = *state;

	test_store_grid_make(view_file(fixture, "g.ooc"), &grid);
	view_start_daemon(fixture, 64 * MIB);
	view_must(view_run(fixture, "--headless --json --screenshot whole.png g.ooc"));
	assert_true(view_summary_number("portions") == 1.0);
	view_start_daemon(fixture, 1 * MIB);
	view_must(view_run(fixture, "--headless --json --screenshot portions.png g.ooc"));
	assert_true(view_summary_number("portions") > 3.0);
	assert_true(view_summary_number("nodes_missing") == 0.0);
	test_assert_same_files(view_file(fixture, "whole.png"), view_file(fixture, "portions.png"));
}

static void two_viewers_with_a_cache_for_neither_both_get_whole_pictures(void **state)
{
	const struct test_grid grid = { .count = 8, .face_quads = 8, .normals = true };
	struct view_fixture *fixture = *state;

	test_store_grid_make(view_file(fixture, "g.ooc"), &grid);
	view_start_daemon(fixture, 1 * MIB);
	view_must(test_command(view_output, sizeof(view_output),
			       "cd %s && v=\"$OOCD_BIN/oocview --socket oocd.sock --headless\" && "
			       "{ $v --screenshot a.png g.ooc & $v --screenshot b.png g.ooc && "
			       "wait $!; }",
			       fixture->folder));
	test_assert_same_files(view_file(fixture, "a.png"), view_file(fixture, "b.png"));
}
static void a_budget_is_kept(void **state)
{
	struct view_fixture *fixture = *state;

	view_start_daemon(fixture, 64 * MIB);
	test_store_grid(view_file(fixture, "g.ooc"), 8);
	view_must(view_run(fixture, "--headless --json --screenshot full.png g.ooc"));
	assert_true(view_summary_number("triangles_max") == 8 * 8 * 8 * 12.0);
	view_must(view_run(
		fixture,
		"--headless --json --mode approximate --budget 1000 --screenshot b.png g.ooc"));
	assert_true(view_summary_number("triangles_max") >= 96.0);
	assert_true(view_summary_number("triangles_max") <= 1000.0 + 96.0);
}
static void a_world_that_fits_the_budget_is_not_chosen_from(void **state)
{
	struct view_fixture *fixture = *state;

	view_start_daemon(fixture, 64 * MIB);
	test_store_grid(view_file(fixture, "g.ooc"), 4);
	view_must(view_run(fixture, "--headless --json --mode approximate --budget 768 "
				    "--screenshot a.png g.ooc"));
	assert_non_null(strstr(view_output, "\"everything\":1,\"budget\":0"));
	view_must(view_run(fixture, "--headless --json --mode approximate --budget 767 "
				    "--screenshot b.png g.ooc"));
	assert_non_null(strstr(view_output, "\"everything\":0,\"budget\":1"));
	view_must(view_run(fixture, "--headless --screenshot full.png g.ooc"));
	test_assert_same_files(view_file(fixture, "full.png"), view_file(fixture, "a.png"));
}

/* Costs are measured once for a driver, and again when it is another. */
static void a_frame_rate_sets_the_budget(void **state)
{
	struct view_fixture *fixture = *state;
	const char *const film = "cd %s && XDG_CACHE_HOME=%s/cache exec $OOCD_BIN/oocview --socket "
				 "oocd.sock --headless --settle --json --size 160x120 --fps 25 "
				 "--path p.csv --stats s.csv g.ooc";
	const char *const driver = "sed -i 's/^version .*/version 4.5 of long ago/' "
				   "%s/cache/oocd/renderer-*.cost";
	const char *const told = "measuring how fast ";

	view_start_daemon(fixture, 64 * MIB);
	test_store_grid(view_file(fixture, "g.ooc"), 4);
	view_write_path(fixture, "p.csv", 3);
	view_must(test_command(view_output, sizeof(view_output), film, fixture->folder,
			       fixture->folder));
	assert_non_null(strstr(view_output, told));
	assert_non_null(strstr(view_output, "\"full\":0"));
	view_must(test_command(view_output, sizeof(view_output), film, fixture->folder,
			       fixture->folder));
	assert_null(strstr(view_output, told));
	view_must(test_command(view_output, sizeof(view_output), driver, fixture->folder));
	view_must(test_command(view_output, sizeof(view_output), film, fixture->folder,
			       fixture->folder));
	assert_non_null(strstr(view_output, told));
	/* Each frame had a budget. */
	view_must(test_command(view_output, sizeof(view_output),
			       "awk -F, 'NR == 1 { for (i = 1; i <= NF; i++) if ($i == \"budget\") "
			       "b = i } NR > 1 && $b >= 1000' %s/s.csv | wc -l",
			       fixture->folder));
	assert_string_equal(view_output, "3\n");
}

/* ---- presets ---- */

static void a_preset_is_what_was_published_and_other_options_change_it(void **state)
{
	struct view_fixture *fixture = *state;

	view_start_daemon(fixture, 32 * MIB);
	test_store_grid(view_file(fixture, "g.ooc"), 4);
	view_must(view_run(fixture, "--headless --json --preset iwalk-2002 --screenshot a.png "
				    "g.ooc"));
	assert_true(view_summary_number("width") == 1024.0);
	assert_true(view_summary_number("height") == 768.0);
	assert_non_null(strstr(view_output, "\"everything\":1"));
	assert_null(strstr(view_output, "--preset"));
	/* Wherever the preset stands. */
	view_must(view_run(fixture, "--headless --json --size 160x120 --budget 100 --screenshot "
				    "a.png --preset iwalk-2003 g.ooc"));
	assert_true(view_summary_number("width") == 160.0);
	assert_non_null(strstr(view_output, "\"budget\":1"));
	assert_non_null(strstr(view_output, "has a cache of 32.0 MiB, not the 256.0 MiB of "
					    "--preset iwalk-2003"));
}

static void a_preset_says_how_a_daemon_is_started(void **state)
{
	struct view_fixture *fixture = *state;
	const char *const script = "#!/bin/sh\necho \"$@\" >\"${0%/*}/arguments\"\nexit 1\n";
	size_t bytes;
	char *arguments;

	test_store_grid(view_file(fixture, "g.ooc"), 2);
	test_file_write(view_file(fixture, "daemon.sh"), script, strlen(script));
	assert_int_equal(test_command(view_output, sizeof(view_output),
				      "cd %s && chmod +x daemon.sh && OOCD_SOCKET=%s/own.sock "
				      "OOCD_DAEMON=%s/daemon.sh exec $OOCD_BIN/oocview --headless "
				      "--preset iwalk-2002 --screenshot a.png g.ooc",
				      fixture->folder, fixture->folder, fixture->folder),
			 1);
	arguments = test_file_read(view_file(fixture, "arguments"), &bytes);
	arguments[bytes - 1] = '\0';
	assert_non_null(strstr(arguments, "--cache-size 32M --queue-depth 8"));
	free(arguments);
}

/* ---- models ---- */

/* A tetrahedron of that size. */
static void write_model(const struct view_fixture *fixture, const char *name, double size)
{
	FILE *file = fopen(view_file(fixture, name), "we");

	assert_non_null(file);
	(void)fprintf(file,
		      "v 0 0 0\nv %g 0 0\nv 0 %g 0\nv 0 0 %g\n"
		      "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n",
		      size, size, size);
	(void)fclose(file);
}

/* Runs oocview with a cache folder of its own; says whether it built a store. */
static bool view_model(const struct view_fixture *fixture, const char *arguments)
{
	view_must(test_command(view_output, sizeof(view_output),
			       "cd %s && XDG_CACHE_HOME=%s/cache exec $OOCD_BIN/oocview "
			       "--socket oocd.sock --headless --size 160x120 %s",
			       fixture->folder, fixture->folder, arguments));
	return strstr(view_output, "building its store") != NULL;
}

static unsigned stores_in_cache(const struct view_fixture *fixture)
{
	char count[32];

	assert_int_equal(test_command(count, sizeof(count), "ls %s/cache/oocd/*.ooc | wc -l",
				      fixture->folder),
			 0);
	return (unsigned)strtoul(count, NULL, 10);
}

static void a_model_is_built_once_and_again_when_it_changes(void **state)
{
	struct view_fixture *fixture = *state;

	view_start_daemon(fixture, 64 * MIB);
	write_model(fixture, "m.obj", 1.0);
	assert_true(view_model(fixture, "--screenshot 1.png m.obj"));
	assert_false(view_model(fixture, "--screenshot 2.png m.obj"));
	test_assert_same_files(view_file(fixture, "1.png"), view_file(fixture, "2.png"));
	assert_int_equal(stores_in_cache(fixture), 1);
	/* A longer file: the time of change need not differ. */
	write_model(fixture, "m.obj", 0.125);
	assert_true(view_model(fixture, "--screenshot 3.png m.obj"));
	assert_int_equal(stores_in_cache(fixture), 1);
	/* Another model of the same name is another model. */
	assert_int_equal(test_command(NULL, 0, "cd %s && mkdir d && cp m.obj d", fixture->folder),
			 0);
	assert_true(view_model(fixture, "--screenshot 4.png d/m.obj"));
	test_assert_same_files(view_file(fixture, "3.png"), view_file(fixture, "4.png"));
	assert_int_equal(stores_in_cache(fixture), 2);
}

static void a_folder_or_list_is_built_again_when_a_file_in_it_changes(void **state)
{
	struct view_fixture *fixture = *state;
	FILE *list;

	view_start_daemon(fixture, 64 * MIB);
	assert_int_equal(test_command(NULL, 0, "mkdir %s/d", fixture->folder), 0);
	write_model(fixture, "d/m.obj", 1.0);
	list = fopen(view_file(fixture, "l.csv"), "we");
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
	struct view_fixture *fixture = *state;

	view_start_daemon(fixture, 64 * MIB);
	write_model(fixture, "m.obj", 1.0);
	assert_true(view_model(fixture, "--json --screenshot 1.png m.obj >summary.json"));
	view_must(test_command(view_output, sizeof(view_output),
			       "wc -l <%s/summary.json && cat %s/summary.json", fixture->folder,
			       fixture->folder));
	assert_memory_equal(view_output, "1\n{\"renderer\":", 14);
}

static void a_model_that_cannot_be_built_leaves_no_store(void **state)
{
	struct view_fixture *fixture = *state;

	view_start_daemon(fixture, 64 * MIB);
	test_file_write(view_file(fixture, "m.ply"), "this is no model", 16);
	assert_int_equal(test_command(view_output, sizeof(view_output),
				      "cd %s && XDG_CACHE_HOME=%s/cache exec $OOCD_BIN/oocview "
				      "--socket oocd.sock --headless --screenshot 1.png m.ply",
				      fixture->folder, fixture->folder),
			 1);
	assert_non_null(strstr(view_output, "oocbuild: "));
	assert_non_null(strstr(view_output, "oocview: m.ply: no store could be built of it"));
	assert_string_equal(test_folder_list(view_file(fixture, "cache/oocd")), "lock ");
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
		{ "--headless --screenshot a.png --fps 0 g.ooc", 2, "--fps: \"0\"" },
		{ "--headless --screenshot a.png --fps 10 --budget 9 g.ooc", 2,
		  "--fps and --budget do not go together" },
		{ "--headless --screenshot a.png --fps 10 --mode full g.ooc", 2,
		  "--fps needs --mode approximate" },
		{ "--headless --screenshot a.png --preset fast g.ooc", 2, "--preset: \"fast\"" },
		{ "--headless --path p.csv --speed 0 g.ooc", 2, "--speed: \"0\"" },
		{ "--headless --screenshot a.png --speed 2 g.ooc", 2, "--speed needs --path" },
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
	struct view_fixture *fixture = *state;
	size_t bytes;
	void *store;

	view_start_daemon(fixture, 64 * MIB);
	test_store_grid(view_file(fixture, "g.ooc"), 2);
	view_write_path(fixture, "p.csv", 1);
	store = test_file_read(view_file(fixture, "g.ooc"), &bytes);
	test_file_write(view_file(fixture, "cut.ooc"), store, bytes / 2);
	free(store);
	for (size_t i = 0; i < ARRAY_LENGTH(cases); i++) {
		int status = view_run(fixture, "%s", cases[i].arguments);

		if (status != cases[i].status || !strstr(view_output, cases[i].says))
			fail_msg("oocview %s: %d, %s", cases[i].arguments, status, view_output);
		/* One line, which begins with the program's name. */
		assert_non_null(strchr(view_output, '\n'));
		assert_true(strchr(view_output, '\n')[1] == '\0');
		assert_non_null(strstr(view_output, "oocview: "));
	}
}

static void a_daemon_or_display_that_is_not_there_is_told_in_a_line(void **state)
{
	struct view_fixture *fixture = *state;

	test_store_grid(view_file(fixture, "g.ooc"), 2);
	assert_int_equal(view_run(fixture, "--headless --screenshot a.png g.ooc"), 1);
	assert_non_null(strstr(view_output, "oocd.sock"));
	assert_true(strchr(view_output, '\n')[1] == '\0');
	view_start_daemon(fixture, 64 * MIB);
	assert_int_equal(test_command(view_output, sizeof(view_output),
				      "cd %s && unset WAYLAND_DISPLAY && DISPLAY=:7777 exec "
				      "$OOCD_BIN/oocview --socket oocd.sock g.ooc",
				      fixture->folder),
			 1);
	assert_non_null(strstr(view_output, "--headless needs no display"));
	assert_true(strchr(view_output, '\n')[1] == '\0');
}

static void a_damaged_node_is_told_and_the_rest_drawn(void **state)
{
	struct view_fixture *fixture = *state;
	struct store_image image;
	struct store_node *nodes;
	uint32_t victim = 0;
	size_t bytes;

	view_start_daemon(fixture, 64 * MIB);
	test_store_grid(view_file(fixture, "g.ooc"), 4);
	store_image_load(view_file(fixture, "g.ooc"), &image);
	nodes = store_image_nodes(&image);
	while (nodes[victim].payload_id == 0)
		victim++;
	((uint8_t *)store_image_payload(&image, victim))[300] ^= 1;
	store_image_save(&image, view_file(fixture, "bad.ooc"));
	store_image_done(&image);
	assert_int_equal(view_run(fixture, "--headless --json --screenshot a.png bad.ooc"), 1);
	assert_non_null(strstr(view_output, "is damaged and not drawn"));
	assert_true(view_summary_number("nodes_missing") == 1.0);
	assert_true(view_summary_number("nodes_drawn") == 7.0);
	free(test_file_read(view_file(fixture, "a.png"), &bytes));
}

static void help_and_version_answer(void **state)
{
	struct view_fixture *fixture = *state;

	assert_int_equal(view_run(fixture, "--help"), 0);
	assert_non_null(strstr(view_output, "Examples:"));
	assert_int_equal(view_run(fixture, "--version"), 0);
	assert_string_equal(view_output, "oocview " OOCD_VERSION "\n");
}
int main(void)
{
	const struct CMUnitTest tests[] = {
		VIEW_TEST(copied_and_in_place_give_the_same_picture),
		VIEW_TEST(portions_give_the_same_picture_as_the_whole),
		VIEW_TEST(two_viewers_with_a_cache_for_neither_both_get_whole_pictures),
		VIEW_TEST(a_budget_is_kept),
		VIEW_TEST(a_world_that_fits_the_budget_is_not_chosen_from),
		VIEW_TEST(a_frame_rate_sets_the_budget),
		VIEW_TEST(a_preset_is_what_was_published_and_other_options_change_it),
		VIEW_TEST(a_preset_says_how_a_daemon_is_started),
		VIEW_TEST(a_model_is_built_once_and_again_when_it_changes),
		VIEW_TEST(a_folder_or_list_is_built_again_when_a_file_in_it_changes),
		VIEW_TEST(a_summary_stays_alone_on_standard_output),
		VIEW_TEST(a_model_that_cannot_be_built_leaves_no_store),
		VIEW_TEST(wrong_use_is_told_in_a_line),
		VIEW_TEST(a_daemon_or_display_that_is_not_there_is_told_in_a_line),
		VIEW_TEST(a_damaged_node_is_told_and_the_rest_drawn),
		VIEW_TEST(help_and_version_answer),
	};

	return TEST_RUN(tests);
}
