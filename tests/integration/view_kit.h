/* SPDX-License-Identifier: MIT */
/**
 * view_kit.h - oocview as a program, headless, with a daemon in another process.
 *
 * What goes wrong fails the test.  Include it after <cmocka.h>.
 */
#ifndef TESTS_INTEGRATION_VIEW_KIT_H
#define TESTS_INTEGRATION_VIEW_KIT_H

#include <stdint.h>

#include "tests/integration/daemon_kit.h"
#include "viewer/image.h"

#define VIEW_OUTPUT_BYTES 8192

/** What the newest program said on both outputs. */
extern char view_output[VIEW_OUTPUT_BYTES];

/** A daemon and the folder that it and the pictures are in. */
struct view_fixture {
	char *folder;
	struct kit_daemon daemon;
};

int view_setup(void **state);
int view_teardown(void **state);
#define VIEW_TEST(test) cmocka_unit_test_setup_teardown(test, view_setup, view_teardown)

/** Starts the daemon, in place of the one before. */
void view_start_daemon(struct view_fixture *fixture, uint64_t cache_bytes);

/** Runs oocview; a relative name in the arguments is one in the folder.  Returns: its status. */
int view_run(const struct view_fixture *fixture, const char *format, ...)
	__attribute__((format(printf, 2, 3)));

/** Fails with what the program said unless the status is 0. */
void view_must(int status);

/** The path of a file of the folder. */
const char *view_file(const struct view_fixture *fixture, const char *name);

/** A number of the --json summary. */
double view_summary_number(const char *key);

/** A path of so many rows beside the grid of test_grid. */
void view_write_path(const struct view_fixture *fixture, const char *name, uint32_t rows);

/** A raw picture.  Ownership: free(file). */
struct view_image {
	void *file;
	struct image_raw_header header;
	const uint64_t *items;
	const float *reals;
};

struct view_image view_load_raw(const char *path);

#endif /* TESTS_INTEGRATION_VIEW_KIT_H */
