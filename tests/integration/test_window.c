/* SPDX-License-Identifier: MIT */
/*
 * Goal: a person's window opens, obeys keys and mouse, and closes.
 * Method: the program in a virtual X server, xdotool for hands.  Keys and buttons are handled in the
 * order in which they come, so nothing has to be waited for but the end.
 */
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "tests/helper.h"
#include "tests/integration/daemon_kit.h"

#define SKIPPED 77

static char output[8192];

/* Waits for the window; a program that closes it by itself may be gone before it is looked for. */
#define FIND_WINDOW                                                                                \
	"window=$(xdotool search --sync --onlyvisible --name '^oocview$')\n"                       \
	"xdotool windowfocus --sync $window\n"                                                     \
	"key='xdotool key --delay 40'\n"

/*
 * Opens a window with a store and does what the script says.
 *
 * hands:  shell, FIND_WINDOW first: then $key presses keys, and $window is there; $pid always is.
 *
 * Returns: the program's exit status.
 */
static int in_a_window(const char *folder, const char *arguments, const char *hands)
{
	struct server_config config = kit_config();
	struct kit_daemon daemon;
	const char *script = test_path(folder, "hands.sh");
	FILE *file;
	int status;

	kit_daemon_start(folder, &config, &daemon);
	test_store_grid(test_path(folder, "g.ooc"), 4);
	file = fopen(script, "we");
	assert_non_null(file);
	/* GLFW unloads Mesa's driver, which leaves two small blocks behind; leaks of ours show headless. */
	(void)fprintf(file,
		      "cd %s\n"
		      "export ASAN_OPTIONS=detect_leaks=0\n"
		      "$OOCD_BIN/oocview --socket oocd.sock --settle %s g.ooc &\n"
		      "pid=$!\n"
		      "%s\n"
		      "wait $pid\n",
		      folder, arguments, hands);
	(void)fclose(file);
	status = test_command(output, sizeof(output),
			      "unset WAYLAND_DISPLAY; exec timeout 60 xvfb-run -a -s '-screen 0 "
			      "800x600x24' sh %s",
			      script);
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
	return status;
}

/* Pictures that were taken with a key, in order: all are alike named but for the time. */
static uint32_t pictures(const char *folder, char names[][64], uint32_t room)
{
	char list[4096];
	uint32_t count = 0;

	assert_int_equal(test_command(list, sizeof(list),
				      "cd %s && ls -tr --time=birth oocview-*.png", folder),
			 0);
	for (char *name = strtok(list, "\n"); name && count < room; name = strtok(NULL, "\n"))
		(void)snprintf(names[count++], 64, "%s", name);
	return count;
}

static bool is_same(const char *folder, const char *one, const char *other)
{
	return test_command(NULL, 0, "cd %s && cmp -s %s %s", folder, one, other) == 0;
}

static void keys_copy_the_camera_take_pictures_and_quit(void **state)
{
	char names[4][64];

	assert_int_equal(
		in_a_window(*state, "--size 400x300",
			    FIND_WINDOW
			    "$key p ctrl+c 1 p ctrl+v p Home h h t m minus u l g b b b b b p q"),
		0);
	assert_int_equal(pictures(*state, names, 4), 4);
	assert_false(is_same(*state, names[0], names[1]));
	assert_true(is_same(*state, names[0], names[2]));
	assert_false(is_same(*state, names[0], names[3]));
}

static void the_mouse_turns_and_picks_and_held_keys_walk(void **state)
{
	char names[4][64];

	assert_int_equal(in_a_window(*state, "--size 400x300 --record r.csv",
				     FIND_WINDOW
				     "$key p\n"
				     "xdotool mousemove --window $window 200 150 click 1\n"
				     "xdotool mousemove --window $window 200 150 mousedown 1 "
				     "mousemove --window $window 260 170 mouseup 1\n"
				     "$key p\n"
				     "xdotool click 4 keydown w keyup w mousedown 3 "
				     "mousemove --window $window 240 170 mouseup 3\n"
				     "$key p q"),
			 0);
	assert_int_equal(pictures(*state, names, 4), 3);
	assert_false(is_same(*state, names[0], names[1]));
	assert_false(is_same(*state, names[1], names[2]));
	assert_int_equal(test_command(output, sizeof(output),
				      "cd %s && test $(wc -l < r.csv) -ge 3 && head -1 r.csv",
				      (const char *)*state),
			 0);
	assert_memory_equal(output, "t,eye_x", 7);
}

static void a_path_plays_to_its_end_and_its_frames_are_kept(void **state)
{
	FILE *file = fopen(test_path(*state, "p.csv"), "we");

	assert_non_null(file);
	(void)fprintf(file, "t,eye_x,eye_y,eye_z,at_x,at_y,at_z,up_x,up_y,up_z,fov_y\n"
			    "0,92,188,309,103,203,303,0,0,1,45\n"
			    "0.05,93,188,309,103,203,303,0,0,1,45\n");
	(void)fclose(file);
	assert_int_equal(in_a_window(*state,
				     "--size 400x300 --path p.csv --frames film --json "
				     "--screenshot last.png",
				     ""),
			 0);
	assert_non_null(strstr(output, "\"nodes_missing_last\":0"));
	assert_string_equal(test_folder_list(test_path(*state, "film")),
			    "frame_000000.png frame_000001.png ");
	assert_true(is_same(*state, "film/frame_000001.png", "last.png"));
}

static void a_signal_closes_the_window(void **state)
{
	assert_int_equal(
		in_a_window(*state, "--size 400x300 --stats s.csv", FIND_WINDOW "kill -TERM $pid"),
		0);
	assert_int_equal(test_command(NULL, 0, "test -s %s/s.csv", (const char *)*state), 0);
}

#define IN_A_FOLDER(test)                                                                          \
	cmocka_unit_test_setup_teardown(test, test_folder_setup, test_folder_teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		IN_A_FOLDER(keys_copy_the_camera_take_pictures_and_quit),
		IN_A_FOLDER(the_mouse_turns_and_picks_and_held_keys_walk),
		IN_A_FOLDER(a_path_plays_to_its_end_and_its_frames_are_kept),
		IN_A_FOLDER(a_signal_closes_the_window),
	};

	if (system("command -v xvfb-run xdotool >/dev/null") != 0) {
		(void)puts("xvfb-run or xdotool is missing: no window can be tried");
		return SKIPPED;
	}
	return TEST_RUN(tests);
}
