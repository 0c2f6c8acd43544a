/* SPDX-License-Identifier: MIT */
/*
 * Goal: whichever call fails, and wherever the process is killed, a commit leaves the old store or
 * the new one under the name, whole, and nothing beside it; a reader says what failed and leaks
 * nothing.
 * Method: fail the first call, then the second, and so on, until a run has no call left to fail.
 * The linker sends the calls here (--wrap, see store.cmake).
 */
#include <errno.h>
#include <fcntl.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "formats/store/store_file.h"
#include "formats/store/store_writer.h"
#include "tests/helper.h"
#include "tests/store_image.h"

/* ---- calls that fail ---- */

enum fault_kind {
	FAULT_NONE,
	FAULT_FAIL,
	FAULT_KILL_BEFORE,
	FAULT_KILL_AFTER,
};

static struct {
	enum fault_kind kind;
	unsigned countdown; /* the call that takes it to 0 is the one */
	bool fired;
	unsigned fsyncs;
	bool is_folder_fsync; /* the call that failed was the flush of the folder */
	bool no_unnamed_files;
	bool short_writes;
} fault;

static void fault_arm(enum fault_kind kind, unsigned countdown)
{
	fault.kind = kind;
	fault.countdown = countdown;
	fault.fired = false;
	fault.fsyncs = 0;
	fault.is_folder_fsync = false;
}

static bool fault_now(int error)
{
	if (fault.kind == FAULT_NONE || fault.fired || --fault.countdown > 0)
		return false;
	fault.fired = true;
	if (fault.kind == FAULT_KILL_BEFORE)
		(void)raise(SIGKILL);
	if (fault.kind == FAULT_KILL_AFTER)
		return false;
	errno = error;
	return true;
}

static void fault_after(void)
{
	if (fault.fired && fault.kind == FAULT_KILL_AFTER)
		(void)raise(SIGKILL);
}

#define WRAP(type, name, failed, error, parameters, arguments)                                     \
	type __real_##name parameters;                                                             \
	type __wrap_##name parameters;                                                             \
	type __wrap_##name parameters                                                              \
	{                                                                                          \
		type result;                                                                       \
                                                                                                   \
		if (fault_now(error))                                                              \
			return failed;                                                             \
		result = __real_##name arguments;                                                  \
		fault_after();                                                                     \
		return result;                                                                     \
	}

WRAP(void *, malloc, NULL, ENOMEM, (size_t size_bytes), (size_bytes))
WRAP(void *, calloc, NULL, ENOMEM, (size_t count, size_t size_bytes), (count, size_bytes))
WRAP(void *, aligned_alloc, NULL, ENOMEM, (size_t alignment, size_t size_bytes),
     (alignment, size_bytes))
WRAP(char *, strdup, NULL, ENOMEM, (const char *text), (text))
WRAP(char *, realpath, NULL, EIO, (const char *path, char *resolved), (path, resolved))
WRAP(int, linkat, -1, EIO, (int from_fd, const char *from, int to_fd, const char *to, int flags),
     (from_fd, from, to_fd, to, flags))
WRAP(int, renameat, -1, EIO, (int from_fd, const char *from, int to_fd, const char *to),
     (from_fd, from, to_fd, to))
WRAP(int, fstat64, -1, EIO, (int fd, struct stat *status), (fd, status))
WRAP(ssize_t, pread64, -1, EIO, (int fd, void *data, size_t size_bytes, off_t offset),
     (fd, data, size_bytes, offset))

ssize_t __real_pwrite64(int fd, const void *data, size_t size_bytes, off_t offset);
ssize_t __wrap_pwrite64(int fd, const void *data, size_t size_bytes, off_t offset);
ssize_t __wrap_pwrite64(int fd, const void *data, size_t size_bytes, off_t offset)
{
	ssize_t result;

	if (fault_now(ENOSPC))
		return -1;
	if (fault.short_writes && size_bytes > 512)
		size_bytes = size_bytes / 2 / 512 * 512;
	result = __real_pwrite64(fd, data, size_bytes, offset);
	fault_after();
	return result;
}

int __real_fsync(int fd);
int __wrap_fsync(int fd);
int __wrap_fsync(int fd)
{
	bool was_fired = fault.fired;
	int result;

	fault.fsyncs++;
	if (fault_now(EIO)) {
		fault.is_folder_fsync = !was_fired && fault.fsyncs == 3;
		return -1;
	}
	result = __real_fsync(fd);
	fault_after();
	return result;
}

int __real_open64(const char *path, int flags, ...);
int __wrap_open64(const char *path, int flags, ...);
int __wrap_open64(const char *path, int flags, ...)
{
	int result;

	if (fault_now(EMFILE))
		return -1;
	result = __real_open64(path, flags);
	fault_after();
	return result;
}

int __real_openat64(int folder_fd, const char *name, int flags, ...);
int __wrap_openat64(int folder_fd, const char *name, int flags, ...);
int __wrap_openat64(int folder_fd, const char *name, int flags, ...)
{
	mode_t mode = 0;
	va_list arguments;
	int result;

	va_start(arguments, flags);
	if (flags & (O_CREAT | O_TMPFILE))
		mode = va_arg(arguments, mode_t);
	va_end(arguments);
	if (fault.no_unnamed_files && (flags & O_TMPFILE) == O_TMPFILE) {
		errno = EOPNOTSUPP;
		return -1;
	}
	if (fault_now(EMFILE))
		return -1;
	result = __real_openat64(folder_fd, name, flags, mode);
	fault_after();
	return result;
}

/* ---- a commit by the public functions, of what an image has ---- */

struct material {
	char *folder;
	struct store_image old_store;
	struct store_image new_store;
	struct store_names names;
};

static int material_setup(void **state)
{
	struct material *material = calloc(1, sizeof(*material));
	struct store_file *store;
	const char *path;

	fault_arm(FAULT_NONE, 0);
	material->folder = test_folder_make();
	path = test_path(material->folder, "grid.ooc");
	test_store_grid(path, 1);
	store_image_load(path, &material->old_store);
	test_store_grid(path, 3);
	store_image_load(path, &material->new_store);
	assert_int_equal(store_open_path(path, &store, NULL), 0);
	assert_int_equal(store_load_names(store, &material->names, NULL), 0);
	store_close(store);
	*state = material;
	return 0;
}

static int material_teardown(void **state)
{
	struct material *material = *state;

	fault_arm(FAULT_NONE, 0);
	fault.no_unnamed_files = false;
	fault.short_writes = false;
	store_names_done(&material->names);
	store_image_done(&material->old_store);
	store_image_done(&material->new_store);
	test_folder_remove(material->folder);
	free(material);
	return 0;
}

static int write_payloads(const struct material *material, struct store_writer *writer,
			  struct store_node *nodes, struct why *why)
{
	uint64_t node_count = store_image_superblock(&material->new_store, 0)->node_count;
	int r = 0;

	for (uint32_t i = 0; i < node_count && r == 0; i++)
		if (nodes[i].payload_id != 0)
			r = store_writer_payload(writer, nodes[i].payload_id, nodes[i].codec,
						 store_image_payload(&material->new_store, i),
						 nodes[i].stored_bytes, &nodes[i], why);
	return r;
}

static int commit_new_store(const struct material *material, const char *path, struct why *why)
{
	struct store_superblock superblock = *store_image_superblock(&material->new_store, 0);
	const struct store_names_content names = {
		.sections = material->names.sections,
		.sources = material->names.sources,
		.parts = material->names.parts,
		.strings = material->names.strings,
		.section_count = material->names.header->section_count,
		.source_count = material->names.header->source_count,
		.part_count = material->names.header->part_count,
		.string_bytes = material->names.header->string_bytes,
	};
	struct store_node nodes[16];
	struct store_writer *writer;
	int r;

	assert_true(superblock.node_count <= 16);
	memcpy(nodes, store_image_nodes(&material->new_store),
	       superblock.node_count * sizeof(*nodes));
	r = store_writer_create(path, &writer, why);
	if (r < 0)
		return r;
	r = write_payloads(material, writer, nodes, why);
	if (r == 0)
		r = store_writer_commit(writer, &superblock, nodes, &names, why);
	store_writer_destroy(writer);
	return r;
}

static bool file_is(const char *path, const struct store_image *image)
{
	struct store_image found;
	bool is_same;

	if (access(path, F_OK) < 0)
		return false;
	store_image_load(path, &found);
	is_same = found.size_bytes == image->size_bytes &&
		  memcmp(found.bytes, image->bytes, image->size_bytes) == 0;
	store_image_done(&found);
	return is_same;
}

/* ---- tests of commits ---- */

static void put_old_store(const struct material *material, const char *path, bool there_is_one)
{
	(void)unlink(path);
	if (there_is_one)
		store_image_save(&material->old_store, path);
}

/* Returns: whether a call was left to fail. */
static bool commit_with_failure(struct material *material, unsigned n, bool there_is_an_old_one)
{
	const char *path = test_path(material->folder, "grid.ooc");
	bool new_is_there;
	struct why why = { "" };
	int r;

	put_old_store(material, path, there_is_an_old_one);
	fault_arm(FAULT_FAIL, n);
	r = commit_new_store(material, path, &why);
	fault.kind = FAULT_NONE;
	/* Some failures are survived: where no lock or no O_DIRECT can be had, for example. */
	new_is_there = r == 0 || fault.is_folder_fsync;
	if (r < 0)
		assert_true(why.text[0] != '\0');
	if (new_is_there)
		assert_true(file_is(path, &material->new_store));
	else if (there_is_an_old_one)
		assert_true(file_is(path, &material->old_store));
	assert_string_equal(test_folder_list(material->folder),
			    new_is_there || there_is_an_old_one ? "grid.ooc " : "");
	if (!fault.fired)
		assert_int_equal(r, 0);
	return fault.fired;
}

static void a_commit_in_which_any_call_fails_leaves_the_old_store_and_nothing_else(void **state)
{
	struct material *material = *state;

	for (unsigned i = 0; i < 4; i++) {
		unsigned n = 1;

		fault.no_unnamed_files = i & 1;
		while (commit_with_failure(material, n, i & 2))
			n++;
		/* Far fewer calls would mean that they are not seen here. */
		assert_true(n > 14);
	}
}

static void short_writes_make_the_same_file(void **state)
{
	struct material *material = *state;
	const char *path = test_path(material->folder, "grid.ooc");
	struct why why;

	fault.short_writes = true;
	(void)unlink(path);
	if (commit_new_store(material, path, &why) < 0)
		fail_msg("%s", why.text);
	assert_true(file_is(path, &material->new_store));
}

/* Returns: whether the process was killed before it had done everything. */
static bool commit_with_kill(struct material *material, enum fault_kind kind, unsigned n,
			     bool there_is_an_old_one)
{
	const char *path = test_path(material->folder, "grid.ooc");
	struct store_writer *next;
	int status;
	pid_t child;

	put_old_store(material, path, there_is_an_old_one);
	child = fork();
	assert_true(child >= 0);
	if (child == 0) {
		fault_arm(kind, n);
		_exit(commit_new_store(material, path, NULL) < 0);
	}
	assert_true(waitpid(child, &status, 0) == child);
	if (!file_is(path, &material->new_store)) {
		if (there_is_an_old_one)
			assert_true(file_is(path, &material->old_store));
		else
			assert_true(access(path, F_OK) < 0);
	}
	/* What may be left is a hidden name; the next writer takes it away. */
	assert_int_equal(store_writer_create(path, &next, NULL), 0);
	store_writer_destroy(next);
	assert_string_equal(test_folder_list(material->folder),
			    access(path, F_OK) == 0 ? "grid.ooc " : "");
	return WIFSIGNALED(status);
}

static void a_writer_killed_anywhere_leaves_the_old_store_or_the_new_one(void **state)
{
	struct material *material = *state;

	for (unsigned i = 0; i < 8; i++) {
		unsigned n = 1;

		fault.no_unnamed_files = i & 1;
		while (commit_with_kill(material, i & 4 ? FAULT_KILL_BEFORE : FAULT_KILL_AFTER, n,
					i & 2))
			n++;
		assert_true(n > 14);
	}
}

static void a_hidden_file_of_a_living_writer_is_left_alone(void **state)
{
	struct material *material = *state;
	const char *path = test_path(material->folder, "grid.ooc");
	struct store_writer *first;
	struct store_writer *second;

	(void)unlink(path);
	fault.no_unnamed_files = true;
	assert_int_equal(store_writer_create(path, &first, NULL), 0);
	assert_int_equal(store_writer_create(path, &second, NULL), 0);
	assert_string_equal(test_folder_list(material->folder),
			    ".grid.ooc.0.part .grid.ooc.1.part ");
	store_writer_destroy(first);
	store_writer_destroy(second);
	assert_string_equal(test_folder_list(material->folder), "");
}

static void a_folder_or_a_device_is_not_replaced(void **state)
{
	struct material *material = *state;
	struct store_writer *writer;
	struct why why;

	assert_int_equal(store_writer_create(material->folder, &writer, &why), -EINVAL);
	assert_int_equal(store_writer_create("/dev/null", &writer, &why), -EINVAL);
	assert_int_equal(
		store_writer_create(test_path(material->folder, "no/x.ooc"), &writer, &why),
		-ENOENT);
	assert_true(store_writer_create(test_path(material->folder, ""), &writer, &why) < 0);
}

static void a_symbolic_link_stays_and_its_target_is_replaced(void **state)
{
	struct material *material = *state;
	const char *path = test_path(material->folder, "grid.ooc");
	const char *link = test_path(material->folder, "link.ooc");
	struct stat status;

	put_old_store(material, path, true);
	assert_int_equal(symlink("grid.ooc", link), 0);
	assert_int_equal(commit_new_store(material, link, NULL), 0);
	assert_int_equal(lstat(link, &status), 0);
	assert_true(S_ISLNK(status.st_mode));
	assert_true(file_is(path, &material->new_store));
}

/* ---- tests of reading ---- */

static int read_all(const char *path, struct why *why)
{
	_Alignas(16) static uint8_t payload[1 << 16];
	struct store_node nodes[16];
	struct store_names names;
	struct store_file *store;
	int r;

	r = store_open_path(path, &store, why);
	if (r < 0)
		return r;
	r = store_load_hs(store, nodes, why);
	if (r == 0) {
		r = store_load_names(store, &names, why);
		if (r == 0)
			store_names_done(&names);
	}
	for (uint64_t i = 0; i < store_superblock(store)->node_count && r == 0; i++)
		if (nodes[i].payload_id != 0)
			r = store_read_payload(store, &nodes[i], payload, NULL, why);
	store_close(store);
	return r;
}

static void a_reader_whose_call_fails_says_so(void **state)
{
	struct material *material = *state;
	const char *path = test_path(material->folder, "grid.ooc");
	unsigned n = 0;

	store_image_save(&material->new_store, path);
	do {
		struct why why = { "" };
		int r;

		fault_arm(FAULT_FAIL, ++n);
		r = read_all(path, &why);
		fault.kind = FAULT_NONE;
		/* Superblock B is none here: that it cannot be read is found by verify. */
		assert_true(!fault.fired || r < 0 || n <= 6);
		assert_true(r == 0 || why.text[0] != '\0');
	} while (fault.fired);
	assert_true(n > 10);
}

static void count_damage(void *arg, uint32_t node_index, int error, const struct why *why)
{
	(void)node_index;
	(void)error;
	assert_true(why->text[0] != '\0');
	++*(unsigned *)arg;
}

static void verify_goes_on_past_what_cannot_be_read(void **state)
{
	struct material *material = *state;
	const char *path = test_path(material->folder, "grid.ooc");
	unsigned n = 0;

	store_image_save(&material->new_store, path);
	do {
		struct store_verify_summary summary = { 0 };
		unsigned told = 0;
		int r;

		fault_arm(FAULT_FAIL, ++n);
		r = store_verify_path(path, count_damage, &told, &summary, NULL);
		fault.kind = FAULT_NONE;
		if (r == -EBADMSG)
			assert_true(told > 0);
		else if (r == 0)
			assert_int_equal(summary.nodes_read, 8);
		assert_true(!fault.fired || r < 0 || n <= 6);
	} while (fault.fired);
	assert_true(n > 20);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(
			a_commit_in_which_any_call_fails_leaves_the_old_store_and_nothing_else,
			material_setup, material_teardown),
		cmocka_unit_test_setup_teardown(short_writes_make_the_same_file, material_setup,
						material_teardown),
		cmocka_unit_test_setup_teardown(
			a_writer_killed_anywhere_leaves_the_old_store_or_the_new_one,
			material_setup, material_teardown),
		cmocka_unit_test_setup_teardown(a_hidden_file_of_a_living_writer_is_left_alone,
						material_setup, material_teardown),
		cmocka_unit_test_setup_teardown(a_folder_or_a_device_is_not_replaced,
						material_setup, material_teardown),
		cmocka_unit_test_setup_teardown(a_symbolic_link_stays_and_its_target_is_replaced,
						material_setup, material_teardown),
		cmocka_unit_test_setup_teardown(a_reader_whose_call_fails_says_so, material_setup,
						material_teardown),
		cmocka_unit_test_setup_teardown(verify_goes_on_past_what_cannot_be_read,
						material_setup, material_teardown),
	};

	return TEST_RUN(tests);
}
