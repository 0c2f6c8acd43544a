/* SPDX-License-Identifier: MIT */
/*
 * Goal: the daemon's ring reads registered files and does nothing else, even for whoever has it.
 * Method: the ring that the fetch layer made, mapped a second time, and asked for what it must refuse.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <fcntl.h>
#include <liburing.h>
#include <stdio.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "daemon/fetch/fetch.h"
#include "formats/base/bytes.h"
#include "tests/helper.h"

#define DEPTH 4u

struct fixture {
	struct fetch *fetch; /* NULL: there is no io_uring here */
	struct io_uring ring;
};

static void on_done(void *arg, uint64_t tag, int error)
{
	(void)arg;
	(void)tag;
	(void)error;
}

/* Where things lie in a ring follows from its depth: another one of that depth tells. */
static void map_ring(int ring_fd, struct io_uring *ret)
{
	struct io_uring_params params = { .flags = IORING_SETUP_R_DISABLED | IORING_SETUP_CLAMP };
	struct io_uring other;

	assert_int_equal(io_uring_queue_init_params(DEPTH, &other, &params), 0);
	io_uring_queue_exit(&other);
	assert_int_equal(io_uring_queue_mmap(ring_fd, &params, ret), 0);
}

static int setup(void **state)
{
	static struct fixture fixture;
	const struct fetch_config config = { .kind = FETCH_URING, .depth = DEPTH, .done = on_done };
	struct why why;

	fixture = (struct fixture){ 0 };
	if (fetch_create(&config, &fixture.fetch, &why) < 0)
		print_message("%s\n", why.text);
	else
		map_ring(fetch_fd(fixture.fetch), &fixture.ring);
	*state = &fixture;
	return 0;
}

static int teardown(void **state)
{
	struct fixture *fixture = *state;

	if (!fixture->fetch)
		return 0;
	/* The maps only: the ring itself is the fetch layer's. */
	fixture->ring.ring_fd = dup(fixture->ring.ring_fd);
	io_uring_queue_exit(&fixture->ring);
	fetch_destroy(fixture->fetch);
	return 0;
}

static int ask(struct io_uring *ring)
{
	struct io_uring_cqe *cqe;
	int result;

	assert_int_equal(io_uring_submit(ring), 1);
	assert_int_equal(io_uring_wait_cqe(ring, &cqe), 0);
	result = cqe->res;
	io_uring_cqe_seen(ring, cqe);
	return result;
}

static void the_ring_refuses_what_is_not_a_read_of_a_registered_file(void **state)
{
	struct fixture *fixture = *state;
	struct io_uring *ring = &fixture->ring;
	char byte = 0;
	int pipes[2];

	if (!fixture->fetch)
		skip();
	assert_int_equal(pipe2(pipes, O_CLOEXEC), 0);
	io_uring_prep_nop(io_uring_get_sqe(ring));
	assert_int_equal(ask(ring), -EACCES);
	io_uring_prep_write(io_uring_get_sqe(ring), pipes[1], "x", 1, 0);
	assert_int_equal(ask(ring), -EACCES);
	io_uring_prep_openat(io_uring_get_sqe(ring), AT_FDCWD, "/dev/null", O_RDONLY, 0);
	assert_int_equal(ask(ring), -EACCES);
	io_uring_prep_send(io_uring_get_sqe(ring), pipes[1], "x", 1, 0);
	assert_int_equal(ask(ring), -EACCES);
	io_uring_prep_unlink(io_uring_get_sqe(ring), "/nonexistent", 0);
	assert_int_equal(ask(ring), -EACCES);
	/* A read, but of a descriptor. */
	io_uring_prep_read(io_uring_get_sqe(ring), pipes[0], &byte, 1, 0);
	assert_int_equal(ask(ring), -EACCES);
	(void)close(pipes[0]);
	(void)close(pipes[1]);
}

static void the_ring_registers_nothing_but_files_and_buffers(void **state)
{
	static const unsigned refused[] = {
		IORING_REGISTER_BUFFERS,      IORING_REGISTER_FILES,
		IORING_UNREGISTER_FILES,      IORING_REGISTER_EVENTFD,
		IORING_REGISTER_PROBE,        IORING_REGISTER_PERSONALITY,
		IORING_REGISTER_RESTRICTIONS, IORING_REGISTER_FILES_UPDATE,
	};
	struct fixture *fixture = *state;

	if (!fixture->fetch)
		skip();
	for (size_t i = 0; i < ARRAY_LENGTH(refused); i++) {
		int fd = STDIN_FILENO;

		errno = 0;
		assert_int_equal(
			syscall(SYS_io_uring_register, fixture->ring.ring_fd, refused[i], &fd, 1),
			-1);
		/* Restrictions cannot even be said of a ring that runs. */
		assert_int_equal(errno,
				 refused[i] == IORING_REGISTER_RESTRICTIONS ? errno : EACCES);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(
			the_ring_refuses_what_is_not_a_read_of_a_registered_file, setup, teardown),
		cmocka_unit_test_setup_teardown(the_ring_registers_nothing_but_files_and_buffers,
						setup, teardown),
	};

	return TEST_RUN(tests);
}
