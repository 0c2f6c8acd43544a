/* SPDX-License-Identifier: MIT */
/*
 * Goal: whichever call of the client library fails, the program is told or the library recovers, and
 * nothing leaks.
 * Method: connect, open, want, wait, ask the status and leave, with the real daemon; fail the first
 * call, then the second, and so on, until a run has no call left to fail.  The linker sends the calls
 * here (--wrap, see tests/client.cmake).
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "libclient/ooc/client.h"
#include "tests/helper.h"

#define FAULT_COUNT_MAX 500

static unsigned fault_countdown; /* the call that takes it to 0 fails; 0: none */

static int fault_now(int error)
{
	if (fault_countdown == 0 || --fault_countdown > 0)
		return 0;
	errno = error;
	return 1;
}

#define WRAP(type, failed, error, name, parameters, arguments)                                     \
	type __real_##name parameters;                                                             \
	type __wrap_##name parameters;                                                             \
	type __wrap_##name parameters                                                              \
	{                                                                                          \
		return fault_now(error) ? (failed) : __real_##name arguments;                      \
	}

WRAP(void *, NULL, ENOMEM, calloc, (size_t count, size_t bytes), (count, bytes))
WRAP(void *, NULL, ENOMEM, realloc, (void *memory, size_t bytes), (memory, bytes))
WRAP(int, -1, EMFILE, socket, (int domain, int type, int protocol), (domain, type, protocol))
WRAP(int, -1, ENOMEM, connect, (int fd, const struct sockaddr *address, socklen_t bytes),
     (fd, address, bytes))
WRAP(ssize_t, -1, ENOMEM, sendmsg, (int fd, const struct msghdr *message, int flags),
     (fd, message, flags))
WRAP(ssize_t, -1, ENOMEM, recvmsg, (int fd, struct msghdr *message, int flags),
     (fd, message, flags))
WRAP(int, -1, EMFILE, open64, (const char *path, int flags, mode_t mode), (path, flags, mode))
WRAP(int, -1, EIO, fstat64, (int fd, struct stat *status), (fd, status))
WRAP(int, -1, EINVAL, fcntl64, (int fd, int command, long argument), (fd, command, argument))
WRAP(void *, MAP_FAILED, ENOMEM, mmap64,
     (void *address, size_t bytes, int protection, int flags, int fd, off_t offset),
     (address, bytes, protection, flags, fd, offset))

struct scene {
	char *folder;
	char socket_path[100];
	char store_path[100];
	pid_t daemon;
};

static int scene_setup(void **state)
{
	static struct scene scene;
	struct ooc_client *client;
	char program[4096];

	scene.folder = test_folder_make();
	(void)snprintf(scene.socket_path, sizeof(scene.socket_path), "%s/sock", scene.folder);
	(void)snprintf(scene.store_path, sizeof(scene.store_path), "%s/a.ooc", scene.folder);
	(void)snprintf(program, sizeof(program), "%s/oocd", getenv("OOCD_BIN"));
	test_store_grid(scene.store_path, 4);
	scene.daemon = test_fork();
	if (scene.daemon == 0) {
		execl(program, "oocd", "--socket", scene.socket_path, "--cache-size", "4M",
		      (char *)NULL);
		_exit(127);
	}
	while (ooc_connect(scene.socket_path, "test", &client) < 0) {
		assert_int_equal(waitpid(scene.daemon, NULL, WNOHANG), 0);
		(void)poll(NULL, 0, 2);
	}
	ooc_disconnect(client);
	*state = &scene;
	return 0;
}

static int scene_teardown(void **state)
{
	struct scene *scene = *state;

	(void)kill(scene->daemon, SIGTERM);
	assert_int_equal(test_wait(scene->daemon), 0);
	test_folder_remove(scene->folder);
	return 0;
}

/* Wants all leaves, and waits.  Returns: 0, or the first error. */
static int draw(struct ooc_client *client, struct ooc_store *store)
{
	struct ooc_want wants[8];
	struct ooc_progress progress;
	size_t count = 0;
	int64_t serial;

	for (uint32_t i = 0; i < ooc_node_count(store); i++) {
		if (ooc_nodes(store)[i].payload_bytes > 0)
			wants[count++] = (struct ooc_want){ store, i, 1.0f };
	}
	assert_int_equal(count, 8);
	serial = ooc_visible_set(client, wants, count);
	if (serial < 0)
		return (int)serial;
	/* A session that was lost by the fault comes back by itself. */
	assert_int_equal(ooc_wait(client, 10000), 0);
	ooc_progress(client, &progress);
	assert_true(progress.complete);
	return 0;
}

/* One of each kind of question, and an order. */
static int ask(struct ooc_client *client, struct ooc_store *store)
{
	static struct ooc_node_info infos[OOC_INSPECT_COUNT_MAX];
	char *text;
	int r;

	r = ooc_status(client, &text);
	if (r < 0)
		return r;
	free(text);
	r = ooc_inspect(store, 0, infos);
	if (r < 0)
		return r;
	assert_int_equal(r, (int)ooc_node_count(store));
	r = ooc_steer(client, OOC_EVICT, store, NULL, 0, &text);
	if (r == 0)
		free(text);
	return r;
}

static int run(const struct scene *scene)
{
	struct ooc_client *client;
	struct ooc_store *store;
	int r;

	r = ooc_connect(scene->socket_path, "test", &client);
	if (r < 0) {
		assert_null(client);
		assert_true(ooc_error_text(NULL)[0] != '\0');
		return r;
	}
	r = ooc_open(client, scene->store_path, &store);
	if (r == 0) {
		r = draw(client, store);
		if (r == 0)
			r = ask(client, store);
		ooc_close(store);
	}
	assert_true(r == 0 || ooc_error_text(client)[0] != '\0');
	ooc_disconnect(client);
	return r;
}

static void a_failing_call_is_told_or_made_good_and_leaks_nothing(void **state)
{
	unsigned told_count = 0;
	unsigned good_count = 0;

	for (unsigned nth = 1; nth < FAULT_COUNT_MAX; nth++) {
		struct test_descriptors before;
		bool was_reached;
		int r;

		test_descriptors_note(&before);
		fault_countdown = nth;
		r = run(*state);
		was_reached = fault_countdown == 0;
		fault_countdown = 0;
		assert_int_equal(test_descriptors_leaked(&before), 0);
		if (!was_reached) {
			assert_int_equal(r, 0);
			break;
		}
		told_count += r < 0;
		good_count += r == 0;
	}
	print_message("%u faults told, %u made good\n", told_count, good_count);
	assert_true(told_count > 0);
	assert_true(good_count > 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(
			a_failing_call_is_told_or_made_good_and_leaks_nothing, scene_setup,
			scene_teardown),
	};

	return TEST_RUN(tests);
}
