/* SPDX-License-Identifier: MIT */
/*
 * Goal: making shared memory, opening a store, and attaching a session to it leak nothing, whichever
 * of their calls fails.
 * Method: fail the first call, then the second, and so on, until a run has no call left to fail.
 * The linker sends the calls here (--wrap, see daemon.cmake).
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

#include "daemon/server/session.h"
#include "formats/base/bytes.h"
#include "formats/base/file.h"
#include "tests/helper.h"

static unsigned countdown; /* the call that takes it to 0 fails; 0: none */

static bool fault_now(int error)
{
	if (countdown == 0 || --countdown > 0)
		return false;
	errno = error;
	return true;
}

void *__real_calloc(size_t count, size_t size);
void *__wrap_calloc(size_t count, size_t size);
void *__wrap_calloc(size_t count, size_t size)
{
	return fault_now(ENOMEM) ? NULL : __real_calloc(count, size);
}

int __real_memfd_create(const char *name, unsigned flags);
int __wrap_memfd_create(const char *name, unsigned flags);
int __wrap_memfd_create(const char *name, unsigned flags)
{
	return fault_now(EMFILE) ? -1 : __real_memfd_create(name, flags);
}

int __real_fallocate64(int fd, int mode, off_t offset, off_t length);
int __wrap_fallocate64(int fd, int mode, off_t offset, off_t length);
int __wrap_fallocate64(int fd, int mode, off_t offset, off_t length)
{
	return fault_now(ENOSPC) ? -1 : __real_fallocate64(fd, mode, offset, length);
}

void *__real_mmap64(void *address, size_t length, int protection, int flags, int fd, off_t offset);
void *__wrap_mmap64(void *address, size_t length, int protection, int flags, int fd, off_t offset);
void *__wrap_mmap64(void *address, size_t length, int protection, int flags, int fd, off_t offset)
{
	return fault_now(ENOMEM) ? MAP_FAILED
				 : __real_mmap64(address, length, protection, flags, fd, offset);
}

int __real_fchmod(int fd, mode_t mode);
int __wrap_fchmod(int fd, mode_t mode);
int __wrap_fchmod(int fd, mode_t mode)
{
	return fault_now(EPERM) ? -1 : __real_fchmod(fd, mode);
}

/*
 * Runs an operation until no call is left to fail.  Returns: how many calls did.
 */
static unsigned fail_each_call(int (*operation)(void *arg), void *arg)
{
	struct test_descriptors before;
	unsigned nth = 0;
	int r;

	do {
		nth++;
		test_descriptors_note(&before);
		countdown = nth;
		r = operation(arg);
		/* Not every failure fails the whole: what is left over says which it was. */
		if (countdown == 0 && r >= 0)
			print_message("call %u is survived\n", nth);
		assert_true(countdown == 0 || r == 0);
		assert_int_equal(test_descriptors_leaked(&before), 0);
	} while (countdown == 0);
	countdown = 0;
	return nth - 1;
}

static int make_memory(void *arg)
{
	struct memfile memfile;
	struct why why;
	int r;

	(void)arg;
	r = memfile_create("test", 64 * KIB, true, &memfile, &why);
	if (r < 0)
		return r;
	r = memfile_publish(&memfile, MEMFILE_CHANGING, &why);
	memfile_done(&memfile);
	return r;
}

static void shared_memory_leaks_nothing_when_any_call_fails(void **state)
{
	(void)state;
	assert_true(fail_each_call(make_memory, NULL) >= 5);
}

static int add_segment(void *arg)
{
	struct arena *arena = arg;
	struct memfile memfile;
	struct segment *segment;
	struct why why;
	int r;

	r = memfile_create("test", arena->segment_bytes, true, &memfile, &why);
	if (r == 0)
		r = memfile_publish(&memfile, MEMFILE_CHANGING, &why);
	if (r == 0)
		r = arena_add(arena, &memfile, &segment);
	memfile_done(&memfile);
	if (r == 0)
		arena_remove(arena, segment->number);
	assert_int_equal(arena->segment_count, 0);
	return r;
}

static void a_segment_leaks_nothing_when_any_call_fails(void **state)
{
	struct arena *arena = calloc(1, sizeof(*arena));

	(void)state;
	arena_init(arena, 64 * KIB);
	assert_true(fail_each_call(add_segment, arena) >= 7);
	arena_done(arena);
	free(arena);
}

static int open_store(void *arg)
{
	const char *path = arg;
	struct served *served;
	struct why why;
	int r;

	r = served_open(open(path, O_RDONLY | O_CLOEXEC), path, 16 * MIB, 1, &served, &why);
	if (r < 0)
		assert_true(why.text[0] != '\0');
	else
		served_close(served);
	return r;
}

static void a_served_store_leaks_nothing_when_any_call_fails(void **state)
{
	const char *path = test_path(*state, "a.ooc");

	test_store_grid(path, 4);
	assert_true(fail_each_call(open_store, (void *)(uintptr_t)path) >= 10);
}

static struct served *attach_served;

static int attach(void *arg)
{
	static struct wire_session_page page;
	struct account account = { .session_count = 1 };
	struct visible visible;
	struct room room;
	struct why why;
	int r;

	room_init(&room, arg);
	visible_init(&visible, &room, &account, NULL, 1, &page);
	r = visible_attach(&visible, 3, attach_served, 1, &why);
	visible_done(&visible);
	assert_int_equal(attach_served->attach_count, 0);
	return r;
}

static void an_attached_store_leaks_nothing_when_any_call_fails(void **state)
{
	const struct cache_calls calls = { 0 };
	const char *path = test_path(*state, "a.ooc");
	struct cache cache;
	struct why why;

	test_store_grid(path, 4);
	assert_int_equal(served_open(open(path, O_RDONLY | O_CLOEXEC), path, 16 * MIB, 1,
				     &attach_served, &why),
			 0);
	cache_init(&cache, 16 * MIB, &calls, NULL);
	cache_add_store(&cache, attach_served);
	assert_true(fail_each_call(attach, &cache) >= 7);
	cache_remove_store(&cache, attach_served);
	served_close(attach_served);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(shared_memory_leaks_nothing_when_any_call_fails),
		cmocka_unit_test(a_segment_leaks_nothing_when_any_call_fails),
		cmocka_unit_test_setup_teardown(a_served_store_leaks_nothing_when_any_call_fails,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(an_attached_store_leaks_nothing_when_any_call_fails,
						test_folder_setup, test_folder_teardown),
	};

	return TEST_RUN(tests);
}
