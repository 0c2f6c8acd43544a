/* SPDX-License-Identifier: MIT */
/*
 * Goal: a hostile client, of whatever user, gets nothing that is not its own and costs nobody anything.
 * Method: a real daemon beside an honest client that is served before, meanwhile and after; messages
 * made at random, by a seed that is printed (OOCD_SEED chooses another), with descriptors beside them;
 * and another user, which only root can become.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "tests/helper.h"
#include "tests/integration/daemon_kit.h"

#define FUZZ_MESSAGES 1500u
#define SKIPPED       77

struct fixture {
	char *folder;
	char store_path[256];
	struct kit_daemon daemon;
	struct kit_client *honest;
	unsigned seed;
};

static int setup(void **state)
{
	const struct test_grid grid = { .count = 12, .face_quads = 4 };
	const struct server_config config = kit_config();
	const char *seed = getenv("OOCD_SEED");
	struct fixture *fixture = calloc(1, sizeof(*fixture));

	fixture->seed = seed ? (unsigned)strtoul(seed, NULL, 10) : 1;
	fixture->folder = test_folder_make();
	(void)snprintf(fixture->store_path, sizeof(fixture->store_path), "%s/a.ooc",
		       fixture->folder);
	test_store_grid_make(fixture->store_path, &grid);
	kit_daemon_start(fixture->folder, &config, &fixture->daemon);
	kit_let_others_in(fixture->folder, &fixture->daemon);
	fixture->honest = kit_hello(&fixture->daemon);
	kit_open(fixture->honest, 0, fixture->store_path);
	*state = fixture;
	return 0;
}

static int teardown(void **state)
{
	struct fixture *fixture = *state;

	kit_disconnect(fixture->honest);
	assert_int_equal(kit_daemon_stop(&fixture->daemon, SIGTERM), 0);
	test_folder_remove(fixture->folder);
	free(fixture);
	return 0;
}

/* ---- a live socket ---- */

/* Begins as a message that is right, so that some get past the first check. */
static size_t make_message(unsigned *seed, uint8_t *bytes)
{
	static const uint16_t types[] = { WIRE_HELLO,  WIRE_OPEN,     WIRE_CLOSE, WIRE_SET,
					  WIRE_RETIRE, WIRE_PREFETCH, WIRE_STATUS };
	static const uint16_t lengths[] = {
		sizeof(struct wire_hello),
		sizeof(struct wire_open),
		sizeof(struct wire_close),
		sizeof(struct wire_set) + sizeof(struct wire_entry),
		sizeof(struct wire_retire),
		sizeof(struct wire_prefetch) + sizeof(struct wire_entry),
		sizeof(struct wire_status),
	};
	uint32_t kind = (uint32_t)rand_r(seed) % ARRAY_LENGTH(types);
	uint32_t changes = (uint32_t)rand_r(seed) % 4;
	size_t length = lengths[kind];

	memset(bytes, 0, length);
	if (types[kind] == WIRE_SET) {
		struct wire_set *set = (struct wire_set *)(void *)bytes;

		set->serial = 1 + (uint64_t)rand_r(seed) % 100;
		set->flags = (uint32_t)rand_r(seed) % 16;
		set->entry_count = 1;
		set->entries[0].node = (uint32_t)rand_r(seed) % 64;
	}
	wire_header_init((struct wire_header *)(void *)bytes, types[kind], (uint32_t)length);
	while (changes-- > 0)
		bytes[(uint32_t)rand_r(seed) % length] ^= (uint8_t)(1u << rand_r(seed) % 8);
	if (rand_r(seed) % 16 == 0)
		length = (uint32_t)rand_r(seed) % (length + 1);
	return length;
}

static void send_with_descriptors(struct kit_client *client, unsigned *seed, const void *bytes,
				  size_t length, const int *choice)
{
	int fds[WIRE_FD_COUNT_MAX + 2];
	union {
		struct cmsghdr header;
		char room[CMSG_SPACE(sizeof(fds))];
	} control;
	struct iovec part = { (void *)(uintptr_t)bytes, length };
	struct msghdr message = { .msg_iov = &part, .msg_iovlen = 1 };
	uint32_t count = rand_r(seed) % 3 ? 0 : (uint32_t)rand_r(seed) % ARRAY_LENGTH(fds);

	for (uint32_t i = 0; i < count; i++)
		fds[i] = choice[rand_r(seed) % 3];
	if (count > 0) {
		memset(&control, 0, sizeof(control));
		message.msg_control = &control;
		message.msg_controllen = CMSG_SPACE(count * sizeof(int));
		control.header.cmsg_level = SOL_SOCKET;
		control.header.cmsg_type = SCM_RIGHTS;
		control.header.cmsg_len = CMSG_LEN(count * sizeof(int));
		memcpy(CMSG_DATA(&control.header), fds, count * sizeof(int));
	}
	/* It may have been dropped by now, and may not read fast enough: both are its business. */
	(void)sendmsg(client->fd, &message, MSG_NOSIGNAL | MSG_DONTWAIT);
}

static bool is_dropped(const struct kit_client *client)
{
	struct pollfd poll_fd = { client->fd, POLLRDHUP, 0 };

	return poll(&poll_fd, 1, 0) == 1 && (poll_fd.revents & (POLLHUP | POLLRDHUP));
}

static void messages_at_random_with_descriptors_crash_nothing_and_leak_nothing(void **state)
{
	struct fixture *fixture = *state;
	unsigned seed = fixture->seed;
	int choice[3] = { open(fixture->store_path, O_RDONLY | O_CLOEXEC),
			  open("/dev/null", O_RDWR | O_CLOEXEC),
			  open(fixture->folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC) };
	struct kit_client *client = NULL;
	uint32_t connection_count = 0;
	uint32_t before;

	print_message("seed %u\n", seed);
	kit_check_served(fixture->honest, 0);
	before = kit_descriptor_count(fixture->daemon.pid);
	for (uint32_t i = 0; i < FUZZ_MESSAGES; i++) {
		_Alignas(8) uint8_t bytes[2048];
		size_t length = make_message(&seed, bytes);

		if (!client || is_dropped(client) || rand_r(&seed) % 50 == 0) {
			if (client)
				kit_disconnect(client);
			client = rand_r(&seed) % 8 ? kit_hello(&fixture->daemon)
						   : kit_connect(&fixture->daemon);
			connection_count++;
		}
		send_with_descriptors(client, &seed, bytes, length, choice);
		if (i % 100 == 0)
			kit_check_served(fixture->honest, i % 40);
	}
	kit_disconnect(client);
	for (uint32_t i = 0; i < ARRAY_LENGTH(choice); i++)
		(void)close(choice[i]);
	print_message("%u connections\n", connection_count);
	kit_check_served(fixture->honest, 0);
	kit_await_number(fixture->honest, "sessions", 1);
	assert_int_equal(kit_descriptor_count(fixture->daemon.pid), before);
}

/* ---- another user ---- */

/* Runs it as another user, in a process of its own.  Returns: what it returned, or SKIPPED. */
static int as_another_user(struct fixture *fixture, int (*attempt)(struct fixture *fixture))
{
	pid_t pid = test_fork();

	if (pid == 0) {
		if (!test_become_other_user())
			_exit(SKIPPED);
		_exit(attempt(fixture));
	}
	return test_wait(pid);
}

static void must_be_refused(int result)
{
	if (result == SKIPPED) {
		print_message("not root: no other user to be\n");
		skip();
	}
	assert_int_equal(result, 0);
}

/* Receives as a client would, but keeps the descriptors.  Returns: as test_write_in_every_way(). */
static int attack_what_is_given(struct fixture *fixture)
{
	struct kit_client *client = kit_connect(&fixture->daemon);
	struct wire_hello hello = { .version = WIRE_VERSION, .name = "hostile" };
	uint32_t descriptor_count = 0;
	int store_fd = open(fixture->store_path, O_RDONLY | O_CLOEXEC);

	if (store_fd < 0)
		return 20;
	wire_header_init(&hello.header, WIRE_HELLO, sizeof(hello));
	kit_send(client, &hello, sizeof(hello), -1);
	kit_send_open(client, 0, store_fd);
	/* The page; HS, directory, grants; a segment. */
	while (descriptor_count < 5) {
		int fds[WIRE_FD_COUNT_MAX];
		size_t fd_count = 0;
		struct pollfd poll_fd = { client->fd, POLLIN, 0 };

		if (poll(&poll_fd, 1, KIT_TIMEOUT_MS) != 1 ||
		    wire_receive(client->fd, client->message, fds, &fd_count) <= 0)
			return 21;
		for (size_t i = 0; i < fd_count; i++) {
			int way = test_write_in_every_way(fds[i]);

			if (way != 0)
				return way;
			descriptor_count++;
		}
	}
	return 0;
}

static void another_user_can_write_nothing_that_is_shared(void **state)
{
	struct fixture *fixture = *state;

	assert_int_equal(chmod(fixture->store_path, 0644), 0);
	kit_check_served(fixture->honest, 0);
	must_be_refused(as_another_user(fixture, attack_what_is_given));
	kit_check_served(fixture->honest, 0);
}

/* Returns: 0 when the store is no more to it than a file that there is not. */
static int attack_what_it_may_not_read(struct fixture *fixture)
{
	struct kit_client *client = kit_hello(&fixture->daemon);
	char served_text[WIRE_PATH_BYTES];
	char other_path[300];
	char *status;
	int fd;
	int r;

	if (open(fixture->store_path, O_RDONLY | O_CLOEXEC) >= 0)
		return 1;
	fd = open(fixture->store_path, O_PATH | O_CLOEXEC);
	r = kit_open_error(client, 0, fd);
	(void)snprintf(served_text, sizeof(served_text), "%s",
		       ((const struct wire_error *)(const void *)client->message)->text);
	(void)close(fd);
	/* What is said of a file that nobody has open is the same. */
	(void)snprintf(other_path, sizeof(other_path), "%s/b.ooc", fixture->folder);
	fd = open(other_path, O_PATH | O_CLOEXEC);
	if (fd < 0 || r != -EACCES || kit_open_error(client, 1, fd) != r)
		return 2;
	(void)close(fd);
	if (strcmp(served_text, ((const struct wire_error *)(const void *)client->message)->text) !=
	    0)
		return 3;
	status = kit_status(client);
	return strstr(status, "a test's store") || strstr(status, "a.ooc") ? 4 : 0;
}

static void who_may_not_read_a_store_gets_no_descriptor_and_no_hint(void **state)
{
	struct fixture *fixture = *state;

	assert_int_equal(chmod(fixture->store_path, 0600), 0);
	test_file_write(test_path(fixture->folder, "b.ooc"), "nothing", 7);
	assert_int_equal(chmod(test_path(fixture->folder, "b.ooc"), 0600), 0);
	kit_check_served(fixture->honest, 0);
	must_be_refused(as_another_user(fixture, attack_what_it_may_not_read));
	kit_check_served(fixture->honest, 0);
}

int main(void)
{
#define HOSTILE_TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)
	const struct CMUnitTest tests[] = {
		HOSTILE_TEST(messages_at_random_with_descriptors_crash_nothing_and_leak_nothing),
		HOSTILE_TEST(another_user_can_write_nothing_that_is_shared),
		HOSTILE_TEST(who_may_not_read_a_store_gets_no_descriptor_and_no_hint),
	};

	return TEST_RUN(tests);
}
