/* SPDX-License-Identifier: MIT */
/*
 * Goal: whichever call fails, an import ends with an error and its reason, and leaks nothing; short
 * reads and interrupted ones change nothing.
 * Method: fail the first call, then the second, and so on, until a run has no call left to fail.
 * The linker sends the calls here (--wrap, see import.cmake); sanitizers see what leaks.
 */
#include <errno.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/types.h>

#include <cmocka.h>
#include <png.h>

#include "formats/base/bytes.h"
#include "formats/import/import.h"
#include "tests/helper.h"

/* ---- calls that fail ---- */

static unsigned fault_countdown; /* the call that takes it to 0 fails; 0: none */
static bool short_reads;         /* each read gives little, or is interrupted */
static unsigned read_count;

static bool fault_now(int error)
{
	if (fault_countdown == 0 || --fault_countdown > 0)
		return false;
	errno = error;
	return true;
}

#define WRAP(type, name, failed, error, parameters, arguments)                                     \
	type __real_##name parameters;                                                             \
	type __wrap_##name parameters;                                                             \
	type __wrap_##name parameters                                                              \
	{                                                                                          \
		return fault_now(error) ? (failed) : __real_##name arguments;                      \
	}

WRAP(void *, malloc, NULL, ENOMEM, (size_t size), (size))
WRAP(void *, calloc, NULL, ENOMEM, (size_t count, size_t size), (count, size))
WRAP(void *, realloc, NULL, ENOMEM, (void *old, size_t size), (old, size))
WRAP(char *, strdup, NULL, ENOMEM, (const char *text), (text))
WRAP(char *, strndup, NULL, ENOMEM, (const char *text, size_t length), (text, length))
WRAP(int, fstat64, -1, EIO, (int fd, struct stat *status), (fd, status))
WRAP(ssize_t, pread64, -1, EIO, (int fd, void *data, size_t size, off_t offset),
     (fd, data, size, offset))
WRAP(ssize_t, pwrite64, -1, ENOSPC, (int fd, const void *data, size_t size, off_t offset),
     (fd, data, size, offset))

int __real_open64(const char *path, int flags, ...);
int __wrap_open64(const char *path, int flags, ...);
int __wrap_open64(const char *path, int flags, ...)
{
	/* The mode is for O_TMPFILE alone. */
	return fault_now(EMFILE) ? -1 : __real_open64(path, flags, 0600);
}

ssize_t __real_read(int fd, void *data, size_t size);
ssize_t __wrap_read(int fd, void *data, size_t size);
ssize_t __wrap_read(int fd, void *data, size_t size)
{
	if (fault_now(EIO))
		return -1;
	if (short_reads && ++read_count % 3 == 0) {
		errno = EINTR;
		return -1;
	}
	return __real_read(fd, data, short_reads && size > 7 ? 7 : size);
}

/* ---- models ---- */

#define FILLER "v 0 0 0\nv 0 0 0\nv 0 0 0\nv 0 0 0\nv 0 0 0\nv 0 0 0\nv 0 0 0\nv 0 0 0\n"

#define STL_TEXT                                                                                   \
	"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"      \
	"endloop\nendfacet\nendsolid\n"

static const struct model {
	const char *name;
	const char *text;
	uint64_t memory_bytes; /* so little that the join is used */
	uint64_t triangle_count;
} models[] = {
	{ "a.ply",
	  "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
	  "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
	  "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
	  "0 0 0 1 2 3\n1 0 0 1 2 3\n1 1 0 1 2 3\n0 1 0 1 2 3\n4 0 1 2 3\n3 0 1 2\n",
	  64 * MIB, 3 },
	{ "join.ply",
	  "ply\nformat ascii 1.0\nelement face 2\nproperty list uchar int vertex_indices\n"
	  "element vertex 4\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
	  "4 0 1 2 3\n3 0 1 2\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n",
	  64 * MIB, 3 },
	{ "a.obj",
	  "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 1\no a\nf 1 2 3 4\n"
	  "g b\nf 1//1 2//1 \\\n3//1\n",
	  64 * MIB, 3 },
	{ "join.obj",
	  FILLER FILLER FILLER FILLER
	  "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 1\nf -1 -2 -3 -4\nf -1//1 -2//1 -3//1\n",
	  1600, 3 },
	{ "image.obj",
	  "mtllib image.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 1\n"
	  "f 1/1 2/2 3/1 4/2\nf 1 2 3\n",
	  64 * MIB, 3 },
	{ "a.stl", STL_TEXT, 64 * MIB, 1 },
	{ "a.wrl",
	  "#VRML V2.0 utf8\nDEF A Transform { translation 1 0 0 children DEF S Shape {\n"
	  "appearance Appearance { material DEF M Material { } }\n"
	  "geometry IndexedFaceSet { coordIndex [ 0 1 2 3 ] coord Coordinate {\n"
	  "point [ 0 0 0 1 0 0 1 1 0 0 1 0 ] } } } }\nUSE S\n",
	  64 * MIB, 4 },
};

static int ignore_part(void *arg, const struct import_part *part, struct why *why)
{
	(void)arg;
	(void)part;
	(void)why;
	return 0;
}

static int count_batch(void *arg, const struct import_batch *batch, struct why *why)
{
	uint64_t *triangle_count = arg;

	(void)why;
	*triangle_count += batch->triangle_count;
	return 0;
}

static int run(const char *path, const char *scratch, const struct model *model,
	       uint64_t *triangle_count, struct why *why)
{
	const struct import_options options = { .memory_bytes = model->memory_bytes,
						.scratch_directory = scratch };
	const struct import_sink sink = { .part = ignore_part,
					  .batch = count_batch,
					  .arg = triangle_count };
	struct import_info info;

	*triangle_count = 0;
	why->text[0] = '\0';
	return import_file(path, &options, &sink, &info, why);
}

static void write_image_library(const char *folder)
{
	static const char library[] = "newmtl m\nmap_Kd none\\image.png\n";
	static const uint8_t rgb[] = { 255, 0, 0, 0, 255, 0, 0, 0, 255, 255, 255, 255 };
	png_image image = {
		.version = PNG_IMAGE_VERSION, .width = 2, .height = 2, .format = PNG_FORMAT_RGB
	};

	test_file_write(test_path(folder, "image.mtl"), library, sizeof(library) - 1);
	assert_true(
		png_image_write_to_file(&image, test_path(folder, "image.png"), 0, rgb, 0, NULL));
}

static void any_call_that_fails_ends_an_import_cleanly(void **state)
{
	test_file_write(test_path(*state, "a.mtl"), "newmtl m\nKd 1 0 0\n", 18);
	write_image_library(*state);
	for (size_t i = 0; i < ARRAY_LENGTH(models); i++) {
		const char *path = test_path(*state, models[i].name);
		uint64_t triangle_count;
		unsigned nth = 0, failures = 0;
		struct why why;
		int r;

		test_file_write(path, models[i].text, strlen(models[i].text));
		do {
			fault_countdown = ++nth;
			r = run(path, *state, &models[i], &triangle_count, &why);
			if (r < 0) {
				assert_int_not_equal(why.text[0], '\0');
				failures++;
			} else {
				/* A material file that cannot be read is no reason to stop. */
				assert_int_equal(triangle_count, models[i].triangle_count);
			}
		} while (fault_countdown == 0);
		fault_countdown = 0;
		assert_int_equal(r, 0);
		print_message("%s: %u calls, %u ends\n", models[i].name, nth - 1, failures);
		assert_true(failures > 8);
	}
}

static void any_call_that_fails_ends_an_expansion_cleanly(void **state)
{
	const char *list = "file,m00,m01,m02,m03,m10,m11,m12,m13,m20,m21,m22,m23\n"
			   "a.stl,1,0,0,0,0,1,0,0,0,0,1,0\n";
	char *arguments[2] = { *state, (char *)test_path(*state, "scene.csv") };
	struct import_inputs inputs;
	unsigned nth = 0;
	struct why why;
	int r;

	test_file_write(test_path(*state, "a.stl"), STL_TEXT, strlen(STL_TEXT));
	test_file_write(arguments[1], list, strlen(list));
	do {
		fault_countdown = ++nth;
		why.text[0] = '\0';
		r = import_inputs_expand(arguments, 2, &inputs, &why);
		assert_true(r == 0 || why.text[0] != '\0');
		if (r == 0)
			import_inputs_done(&inputs);
	} while (fault_countdown == 0);
	fault_countdown = 0;
	assert_int_equal(r, 0);
}

static void short_and_interrupted_reads_change_nothing(void **state)
{
	write_image_library(*state);
	short_reads = true;
	for (size_t i = 0; i < ARRAY_LENGTH(models); i++) {
		const char *path = test_path(*state, models[i].name);
		uint64_t triangle_count;
		struct why why;

		test_file_write(path, models[i].text, strlen(models[i].text));
		if (run(path, *state, &models[i], &triangle_count, &why) < 0)
			fail_msg("%s", why.text);
		assert_int_equal(triangle_count, models[i].triangle_count);
	}
	short_reads = false;
}

int main(void)
{
#define FAULT_TEST(name)                                                                           \
	cmocka_unit_test_setup_teardown(name, test_folder_setup, test_folder_teardown)
	const struct CMUnitTest tests[] = {
		FAULT_TEST(any_call_that_fails_ends_an_import_cleanly),
		FAULT_TEST(any_call_that_fails_ends_an_expansion_cleanly),
		FAULT_TEST(short_and_interrupted_reads_change_nothing),
	};

	return TEST_RUN(tests);
}
