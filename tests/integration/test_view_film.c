/* SPDX-License-Identifier: MIT */
/*
 * Goal: a film is a picture a row, ends cleanly when it is told to, and outlives a daemon.
 * Method: the program itself, headless, with a daemon in another process.
 */
#include <math.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/inotify.h>
#include <unistd.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "tests/helper.h"
#include "tests/integration/view_kit.h"

static void a_film_has_a_picture_a_row_and_a_recording_a_frame(void **state)
{
	struct view_fixture *fixture = *state;
	size_t bytes;
	char *text;
	char *line;
	int rows = 0;

	view_start_daemon(fixture, 64 * MIB);
	test_store_grid(view_file(fixture, "g.ooc"), 4);
	view_write_path(fixture, "p.csv", 3);
	view_must(view_run(
		fixture, "--headless --settle --size 160x120 --path p.csv --repeat 2 --frames film "
			 "--record r.csv --stats s.csv g.ooc"));
	assert_string_equal(test_folder_list(view_file(fixture, "film")),
			    "frame_000000.png frame_000001.png frame_000002.png frame_000003.png "
			    "frame_000004.png frame_000005.png ");
	test_assert_same_files(view_file(fixture, "film/frame_000001.png"),
			       view_file(fixture, "film/frame_000004.png"));
	text = test_file_read(view_file(fixture, "s.csv"), &bytes);
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
	/* At twice the speed every other row is left out. */
	view_must(view_run(fixture, "--headless --settle --size 160x120 --path p.csv --speed 2 "
				    "--frames fast g.ooc"));
	assert_string_equal(test_folder_list(view_file(fixture, "fast")),
			    "frame_000000.png frame_000001.png ");
	test_assert_same_files(view_file(fixture, "film/frame_000002.png"),
			       view_file(fixture, "fast/frame_000001.png"));
	/* The recording is a path like any other, here twice as long. */
	view_must(view_run(fixture,
			   "--headless --settle --size 160x120 --path r.csv --frames again "
			   "g.ooc"));
	test_assert_same_files(view_file(fixture, "film/frame_000002.png"),
			       view_file(fixture, "again/frame_000005.png"));
}

/* A path into the grid: what comes into view has been asked for before. */
static void a_film_asks_for_what_is_ahead(void **state)
{
	struct view_fixture *fixture = *state;
	FILE *file;

	test_store_grid(view_file(fixture, "g.ooc"), 16);
	file = fopen(view_file(fixture, "p.csv"), "we");
	assert_non_null(file);
	(void)fprintf(file, "t,eye_x,eye_y,eye_z,at_x,at_y,at_z,up_x,up_y,up_z,fov_y\n");
	for (int i = 0; i < 60; i++)
		(void)fprintf(file, "%g,%g,207.9,307.9,%g,207.9,307.9,0,0,1,20\n", 0.1 * i,
			      115.0 - 0.5 * i, 120.0 - 0.5 * i);
	(void)fclose(file);
	/* How far it gets is for the scheduler to say: it has as many films as it takes. */
	do {
		view_start_daemon(fixture, 64 * MIB);
		view_must(view_run(fixture, "--headless --json --settle --size 160x120 --prefetch "
					    "1M --path p.csv g.ooc"));
		assert_true(view_summary_number("nodes_missing") == 0.0);
	} while (view_summary_number("bytes_prefetched") == 0.0);
	view_start_daemon(fixture, 64 * MIB);
	view_must(view_run(fixture, "--headless --json --settle --size 160x120 --path p.csv "
				    "g.ooc"));
	assert_true(view_summary_number("bytes_prefetched") == 0.0);
}

/* Starts a program and does not wait. */
static pid_t start_view(const struct view_fixture *fixture, const char *arguments)
{
	char command[1024];
	pid_t child;

	(void)snprintf(command, sizeof(command),
		       "cd %s && exec $OOCD_BIN/oocview --socket oocd.sock %s", fixture->folder,
		       arguments);
	child = test_fork();
	if (child == 0) {
		(void)execl("/bin/sh", "sh", "-c", command, (char *)NULL);
		_exit(127);
	}
	return child;
}

static void a_signal_ends_a_film_cleanly(void **state)
{
	const int signals[] = { SIGINT, SIGTERM };
	struct view_fixture *fixture = *state;

	view_start_daemon(fixture, 64 * MIB);
	test_store_grid(view_file(fixture, "g.ooc"), 4);
	view_write_path(fixture, "p.csv", 3);
	for (size_t i = 0; i < 2; i++) {
		char event[4096];
		int watch = inotify_init1(IN_CLOEXEC);
		pid_t child;

		assert_true(watch >= 0);
		(void)test_command(NULL, 0, "rm -rf %s/film && mkdir %s/film", fixture->folder,
				   fixture->folder);
		assert_true(inotify_add_watch(watch, view_file(fixture, "film"), IN_MOVED_TO) >= 0);
		child = start_view(fixture, "--headless --settle --size 160x120 --path p.csv "
					    "--repeat 100000 --frames film g.ooc");
		/* The first picture is there: now it is in the midst of it. */
		assert_true(read(watch, event, sizeof(event)) > 0);
		assert_int_equal(kill(child, signals[i]), 0);
		assert_int_equal(test_wait(child), 130);
		assert_null(strstr(test_folder_list(view_file(fixture, "film")), "part"));
		(void)close(watch);
	}
}

static void a_film_goes_on_when_the_daemon_is_started_again(void **state)
{
	struct view_fixture *fixture = *state;
	char event[4096];
	int watch;
	pid_t child;

	view_start_daemon(fixture, 1 * MIB);
	test_store_grid(view_file(fixture, "g.ooc"), 8);
	view_write_path(fixture, "p.csv", 3);
	view_must(view_run(fixture,
			   "--headless --settle --size 160x120 --path p.csv --frames film g.ooc"));
	(void)test_command(NULL, 0, "mkdir %s/again", fixture->folder);
	watch = inotify_init1(IN_CLOEXEC);
	assert_true(watch >= 0);
	assert_true(inotify_add_watch(watch, view_file(fixture, "again"), IN_MOVED_TO) >= 0);
	child = start_view(fixture, "--headless --settle --size 160x120 --path p.csv --repeat 30 "
				    "--frames again g.ooc");
	assert_true(read(watch, event, sizeof(event)) > 0);
	assert_int_equal(kit_daemon_stop(&fixture->daemon, SIGKILL), -SIGKILL);
	fixture->daemon.pid = 0;
	view_start_daemon(fixture, 1 * MIB);
	assert_int_equal(test_wait(child), 0);
	for (int i = 0; i < 3; i++) {
		char name[64];
		char last[64];

		(void)snprintf(name, sizeof(name), "film/frame_%06d.png", i);
		(void)snprintf(last, sizeof(last), "again/frame_%06d.png", 87 + i);
		test_assert_same_files(view_file(fixture, name), view_file(fixture, last));
	}
	(void)close(watch);
}
int main(void)
{
	const struct CMUnitTest tests[] = {
		VIEW_TEST(a_film_has_a_picture_a_row_and_a_recording_a_frame),
		VIEW_TEST(a_film_asks_for_what_is_ahead),
		VIEW_TEST(a_signal_ends_a_film_cleanly),
		VIEW_TEST(a_film_goes_on_when_the_daemon_is_started_again),
	};

	return TEST_RUN(tests);
}
