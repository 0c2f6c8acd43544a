/* SPDX-License-Identifier: MIT */
/**
 * helper.h - what tests of every area share: folders, descriptors, small stores.
 *
 * Nothing here returns an error: what goes wrong fails the test that asked for it.  Include it
 * after <cmocka.h>.
 */
#ifndef TESTS_HELPER_H
#define TESTS_HELPER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

/* ---- the whole program ---- */

#define TEST_DESCRIPTOR_MAX 1024

/** The descriptors that are open. */
struct test_descriptors {
	bool is_open[TEST_DESCRIPTOR_MAX];
};

void test_descriptors_note(struct test_descriptors *ret);

/** Names those that are open now and were not then.  Returns: how many. */
int test_descriptors_leaked(const struct test_descriptors *before);

/**
 * How often to do what finds more the longer it goes on: `usual` times, in every run, and
 * $OOCD_REPEATS times that where somebody has the time.
 */
uint64_t test_repeats(uint64_t usual);

/** `return TEST_RUN(tests);` ends main(): runs all, and counts leaked descriptors as failures. */
#define TEST_RUN(tests)                                                                            \
	({                                                                                         \
		struct test_descriptors test_before;                                               \
		test_descriptors_note(&test_before);                                               \
		cmocka_run_group_tests(tests, NULL, NULL) + test_descriptors_leaked(&test_before); \
	})

/* ---- files ---- */

/** Makes a folder of its own, on a disk.  Ownership: ends with test_folder_remove(). */
char *test_folder_make(void);

/** Removes a folder and all in it, and frees its name. */
void test_folder_remove(char *folder);

/** For cmocka_unit_test_setup_teardown(): *state is a new folder's name. */
int test_folder_setup(void **state);
int test_folder_teardown(void **state);

/** "folder/name", for the rest of the program. */
const char *test_path(const char *folder, const char *name);

/** Names in a folder but "." and "..", in byte order, each followed by a space. */
const char *test_folder_list(const char *folder);

/** Reads a whole file.  Ownership: free(). */
void *test_file_read(const char *path, size_t *ret_bytes);
void test_file_write(const char *path, const void *data, size_t size_bytes);

/** Fails unless both files have the same bytes. */
void test_assert_same_files(const char *a, const char *b);

/* ---- processes ---- */

/**
 * Forks.  The child dies with its parent, and at a check that fails: else it would go on with the tests
 * that follow.
 *
 * Returns: as fork(), which does not fail.
 */
pid_t test_fork(void);

/** Waits until a child has ended.  Returns: its exit status, or minus the signal that killed it. */
int test_wait(pid_t pid);

/* ---- users ---- */

/** A user that nobody is.  Only root can become one. */
#define TEST_OTHER_UID 65533u

/**
 * Goes on as a user that nobody is, in a child process, for the rest of it: with none of root's groups.
 *
 * Returns: false where this process may not; then it is who it was.
 */
bool test_become_other_user(void);

/**
 * Tries all ways to change a file, of a page at least, through a descriptor of it, by the user that this
 * process is.
 *
 * Returns: 0, or the number of the way that was open.
 */
int test_write_in_every_way(int fd);

/* ---- programs ---- */

/**
 * Runs a shell command and waits for it.  "$OOCD_BIN" in it is where our programs are.
 *
 * ret_output:  the beginning of what it said on both outputs, terminated; may be NULL.
 *
 * Returns: its exit status; a signal fails the test.
 */
int test_command(char *ret_output, size_t output_bytes, const char *format, ...)
	__attribute__((format(printf, 3, 4)));

/* ---- stores ---- */

/**
 * A scene of count^3 boxes, each of edge 0.5 in the middle of a unit cube, the corner of the first
 * cube at the store's origin (100, 200, 300).  A leaf holds up to 2^3 boxes, each a run of its own;
 * inner nodes have nothing to draw.  Box k is of part k % part_count; the first half of the parts is
 * of section 0, the rest of section 1.
 */
struct test_grid {
	uint32_t count;       /* boxes along an edge, up to 64; 0: a model without triangles */
	uint32_t codec;       /* enum store_codec */
	uint32_t face_quads;  /* squares along an edge of a face, 1 .. 32; 0 means 1 */
	uint32_t part_count;  /* 0 means 4 */
	bool float_positions; /* PAYLOAD_F32X3_RUN and no step, in place of PAYLOAD_U16X3_RUN */
	bool normals;         /* PAYLOAD_OCT8, of the faces */
	bool colours;         /* of the vertices */
	bool triangle_ids;
};

/** Triangles of the scene. */
uint64_t test_grid_triangles(const struct test_grid *grid);

/** Writes a valid store of the scene.  The same bytes for the same scene. */
void test_store_grid_make(const char *path, const struct test_grid *grid);

/** The same with count boxes along an edge and nothing special. */
void test_store_grid(const char *path, uint32_t count);

#endif /* TESTS_HELPER_H */
