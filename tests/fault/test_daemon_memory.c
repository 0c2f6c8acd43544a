/* SPDX-License-Identifier: MIT */
/*
 * Goal: whichever allocation fails while it serves, the daemon goes on serving the others, and loses
 * nothing by it.
 * Method: a daemon in a process of its own whose n-th allocation fails, for every n that a client's
 * visit has: the visitor may be refused or dropped, an honest client is served as before.  The linker
 * sends the allocations here (--wrap, see daemon.cmake).
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <fcntl.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <unistd.h>

#include "tests/helper.h"
#include "tests/integration/daemon_kit.h"

/* More than a visit has: the loop ends when one passes without a failure. */
#define CALLS_MAX 200u

/* Shared by daemon and test: which allocation of the daemon's fails; 0: none. */
static _Atomic uint32_t *countdown;
static pid_t daemon_pid;

static bool fails_now(void)
{
	uint32_t left;

	if (!countdown || daemon_pid != getpid())
		return false;
	left = atomic_load(countdown);
	while (left > 0 && !atomic_compare_exchange_weak(countdown, &left, left - 1))
		continue;
	return left == 1;
}

void *__real_malloc(size_t size);
void *__wrap_malloc(size_t size);
void *__wrap_malloc(size_t size)
{
	return fails_now() ? NULL : __real_malloc(size);
}

void *__real_calloc(size_t count, size_t size);
void *__wrap_calloc(size_t count, size_t size);
void *__wrap_calloc(size_t count, size_t size)
{
	return fails_now() ? NULL : __real_calloc(count, size);
}

void *__real_realloc(void *pointer, size_t size);
void *__wrap_realloc(void *pointer, size_t size);
void *__wrap_realloc(void *pointer, size_t size)
{
	return fails_now() ? NULL : __real_realloc(pointer, size);
}

FILE *__real_open_memstream(char **pointer, size_t *size);
FILE *__wrap_open_memstream(char **pointer, size_t *size);
FILE *__wrap_open_memstream(char **pointer, size_t *size)
{
	return fails_now() ? NULL : __real_open_memstream(pointer, size);
}

static void note_daemon(void)
{
	daemon_pid = getpid();
}

/* Ends the visit where the daemon says no. */
static void await(struct kit_client *client, uint16_t type)
{
	const struct wire_header *header = (const void *)client->message;

	do
		kit_receive_any(client);
	while (header->type != type && header->type != WIRE_ERROR);
	if (header->type == WIRE_ERROR)
		_exit(1);
}

static _Noreturn void visitor_main(const struct kit_daemon *daemon, const char *path,
				   uint32_t round)
{
	struct wire_status question = { .what = WIRE_STATUS_ALL };
	struct kit_client *client;

	/* Where it fails it ends, without a word and without a core. */
	(void)prctl(PR_SET_DUMPABLE, 0);
	if (!freopen("/dev/null", "w", stdout) || !freopen("/dev/null", "w", stderr))
		_exit(2);
	client = kit_hello(daemon);
	kit_send_open(client, 0, open(path, O_RDONLY | O_CLOEXEC));
	await(client, WIRE_OPENED);
	(void)kit_prefetch(client, 0, 60, 1);
	(void)kit_want(client, 0, round % 50, 40, WIRE_SET_RETIRE);
	kit_settle(client);
	wire_header_init(&question.header, WIRE_STATUS, sizeof(question));
	kit_send(client, &question, sizeof(question), -1);
	await(client, WIRE_TEXT);
	_exit(0);
}

/* All that a client does, in a process of its own that may fail at any of it. */
static void visit(const struct kit_daemon *daemon, const char *path, uint32_t round)
{
	pid_t pid = test_fork();

	if (pid == 0)
		visitor_main(daemon, path, round);
	(void)test_wait(pid);
}

static void the_daemon_serves_on_whichever_allocation_fails(void **state)
{
	const struct test_grid grid = { .count = 12, .face_quads = 4 };
	const struct server_config config = kit_config();
	const char *first_path = test_path(*state, "a.ooc");
	const char *second_path = test_path(*state, "b.ooc");
	struct kit_daemon daemon;
	struct kit_client *honest;
	uint32_t before;
	uint32_t nth = 0;

	countdown = mmap(NULL, sizeof(*countdown), PROT_READ | PROT_WRITE,
			 MAP_SHARED | MAP_ANONYMOUS, -1, 0);
	assert_ptr_not_equal(countdown, MAP_FAILED);
	test_store_grid_make(first_path, &grid);
	test_store_grid_make(second_path, &grid);
	kit_daemon_start_prepared(*state, &config, note_daemon, &daemon);
	honest = kit_hello(&daemon);
	kit_open(honest, 0, first_path);
	kit_open(honest, 1, second_path);
	kit_check_served(honest, 0);
	visit(&daemon, second_path, 0);
	kit_await_number(honest, "sessions", 1);
	before = kit_descriptor_count(daemon.pid);
	do {
		atomic_store(countdown, ++nth);
		visit(&daemon, second_path, nth);
		if (atomic_load(countdown) > 0)
			break;
		kit_check_served(honest, 0);
		kit_await_number(honest, "sessions", 1);
	} while (nth < CALLS_MAX);
	atomic_store(countdown, 0);
	print_message("%u allocations\n", nth - 1);
	assert_in_range(nth, 5, CALLS_MAX - 1);
	kit_check_served(honest, 0);
	kit_await_number(honest, "sessions", 1);
	assert_int_equal(kit_descriptor_count(daemon.pid), before);
	kit_disconnect(honest);
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
	(void)munmap((void *)countdown, sizeof(*countdown));
	countdown = NULL;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(the_daemon_serves_on_whichever_allocation_fails,
						test_folder_setup, test_folder_teardown),
	};

	return TEST_RUN(tests);
}
