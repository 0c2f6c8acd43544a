/* SPDX-License-Identifier: MIT */
/*
 * Goal: nothing that a client, a store or a disk does hurts the daemon or its other clients.
 * Method: a real daemon beside an honest client that is served before and after.
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
#include "formats/base/file.h"
#include "tests/helper.h"
#include "tests/integration/daemon_kit.h"

#define ENTRIES_MAX 1024u
#define DEATHS      3u
#define HELD_COUNT  1000u /* leaves of many_grid */

struct fixture {
	char *folder;
	char store_path[256];
	struct kit_daemon daemon;
	struct kit_client *honest;
};

static const struct test_grid usual_grid = { .count = 12, .face_quads = 4 };
static const struct test_grid many_grid = { .count = 20 };

static struct wire_entry entries[ENTRIES_MAX];

static int setup_with(void **state, struct server_config config, const struct test_grid *grid)
{
	struct fixture *fixture = calloc(1, sizeof(*fixture));

	fixture->folder = test_folder_make();
	(void)snprintf(fixture->store_path, sizeof(fixture->store_path), "%s/a.ooc",
		       fixture->folder);
	test_store_grid_make(fixture->store_path, grid);
	kit_daemon_start(fixture->folder, &config, &fixture->daemon);
	fixture->honest = kit_hello(&fixture->daemon);
	*state = fixture;
	return 0;
}

static int setup(void **state)
{
	return setup_with(state, kit_config(), &usual_grid);
}

static int setup_many(void **state)
{
	return setup_with(state, kit_config(), &many_grid);
}

static int setup_failing_disk(void **state)
{
	struct server_config config = kit_config();

	config.fetch_kind = FETCH_SIM;
	config.sim = (struct fetch_sim){ .seed = 8, .error_permille = 50, .corrupt_permille = 50 };
	return setup_with(state, config, &usual_grid);
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

/* The honest client draws twenty nodes, from wherever it is. */
static void check_honest(struct fixture *fixture, uint32_t first)
{
	if (!fixture->honest->stores[0].superblock)
		kit_open(fixture->honest, 0, fixture->store_path);
	kit_check_served(fixture->honest, first);
}

/* ---- death ---- */

/* A child inherits the socket, and would hide the hang-up for as long as it lives. */
static void fork_keeper(int until_fd)
{
	char byte;

	if (fork() > 0)
		return;
	(void)!read(until_fd, &byte, 1);
	_exit(0);
}

/*
 * A client in another process that holds HELD_COUNT nodes and then waits to be killed.
 *
 * child_until:  NULL, or it has a child that keeps the socket until the test closes this pipe.
 */
static pid_t start_holder(const struct fixture *fixture, const int *child_until)
{
	int ready[2];
	char byte;
	pid_t pid;

	assert_int_equal(pipe2(ready, O_CLOEXEC), 0);
	pid = test_fork();
	if (pid == 0) {
		struct kit_client *client = kit_hello(&fixture->daemon);

		kit_open(client, 0, fixture->store_path);
		(void)kit_want(client, 0, 0, HELD_COUNT, WIRE_SET_RETIRE);
		kit_settle(client);
		if (child_until) {
			(void)close(child_until[1]);
			fork_keeper(child_until[0]);
		}
		(void)!write(ready[1], "r", 1);
		for (;;)
			(void)pause();
	}
	(void)close(ready[1]);
	assert_int_equal(read(ready[0], &byte, 1), 1);
	(void)close(ready[0]);
	return pid;
}

/* Kills a holder and waits until what it had is given back.  Its child lives that long. */
static void kill_holder(struct fixture *fixture, bool with_child)
{
	int until[2];
	pid_t holder;

	assert_int_equal(pipe2(until, O_CLOEXEC), 0);
	holder = start_holder(fixture, with_child ? until : NULL);
	assert_true(kit_status_number(fixture->honest, "held_and_busy_bytes") >=
		    (uint64_t)HELD_COUNT * WIRE_PAGE_BYTES);
	assert_int_equal(kill(holder, SIGKILL), 0);
	assert_int_equal(test_wait(holder), -SIGKILL);
	kit_await_number(fixture->honest, "held_and_busy_bytes", 0);
	/* The honest one is the only client left. */
	kit_await_number(fixture->honest, "sessions", 1);
	(void)close(until[0]);
	(void)close(until[1]);
}

static void check_killed_holders(struct fixture *fixture, bool with_child)
{
	uint32_t descriptor_count;

	/* What the first has brought about stays: the store is kept open. */
	kill_holder(fixture, with_child);
	descriptor_count = kit_descriptor_count(fixture->daemon.pid);
	for (uint64_t i = 0; i < test_repeats(DEATHS); i++)
		kill_holder(fixture, with_child);
	assert_int_equal(kit_descriptor_count(fixture->daemon.pid), descriptor_count);
}

static void a_killed_client_gives_its_holds_back(void **state)
{
	check_killed_holders(*state, false);
}

static void a_killed_client_gives_its_holds_back_though_its_child_keeps_the_socket(void **state)
{
	check_killed_holders(*state, true);
}

/* ---- the protocol ---- */

static void another_version_is_told_so(void **state)
{
	struct fixture *fixture = *state;
	struct kit_client *client = kit_connect(&fixture->daemon);
	struct wire_hello hello = { .version = WIRE_VERSION + 1, .name = "future" };
	const struct wire_error *error;

	wire_header_init(&hello.header, WIRE_HELLO, sizeof(hello));
	kit_send(client, &hello, sizeof(hello), -1);
	error = kit_receive(client, WIRE_ERROR);
	assert_int_equal(error->error, -EPROTONOSUPPORT);
	assert_int_equal(error->version, WIRE_VERSION);
	kit_receive(client, 0);
	kit_disconnect(client);
	check_honest(fixture, 0);
}

/* A message that is wrong, after HELLO and an OPEN of store 0. */
struct bad_message {
	const char *what;
	uint16_t type;
	uint32_t bytes;
	/* What lies behind the header, in 32-bit words. */
	uint32_t words[7];
};

#define SET_BYTES          (uint32_t)sizeof(struct wire_set)
#define SET_ONE_BYTES      (uint32_t)(sizeof(struct wire_set) + sizeof(struct wire_entry))
#define PREFETCH_ONE_BYTES (uint32_t)(sizeof(struct wire_prefetch) + sizeof(struct wire_entry))
#define WHOLE              (WIRE_SET_FIRST | WIRE_SET_LAST)
#define ONE                0x3f800000u /* 1.0f */

static const struct bad_message bad_messages[] = {
	{ "a second HELLO", WIRE_HELLO, sizeof(struct wire_hello), { WIRE_VERSION } },
	{ "what only the daemon says", WIRE_WELCOME, sizeof(struct wire_welcome), { 0 } },
	{ "an unknown type", 999, 8, { 0 } },
	{ "no more than a header", WIRE_SET, 8, { 0 } },
	{ "a part of a header", WIRE_SET, 4, { 0 } },
	{ "CLOSE beyond the numbers", WIRE_CLOSE, 16, { WIRE_STORE_COUNT_MAX } },
	{ "OPEN without a descriptor", WIRE_OPEN, sizeof(struct wire_open), { 3 } },
	/* serial (2), flags, entry_count, then store, node, importance */
	{ "SET of a store that is not open",
	  WIRE_SET,
	  SET_ONE_BYTES,
	  { 9, 0, WHOLE, 1, 5, 1, ONE } },
	{ "SET of a node that there is not",
	  WIRE_SET,
	  SET_ONE_BYTES,
	  { 9, 0, WHOLE, 1, 0, UINT32_MAX, ONE } },
	{ "SET with a count beyond its end",
	  WIRE_SET,
	  SET_ONE_BYTES,
	  { 9, 0, WHOLE, 1000, 0, 1, ONE } },
	{ "SET with unknown flags", WIRE_SET, SET_ONE_BYTES, { 9, 0, 1u << 31, 1, 0, 1, ONE } },
	{ "SET that goes on without having begun", WIRE_SET, SET_BYTES, { 9, 0, WIRE_SET_LAST } },
	{ "SET number 0", WIRE_SET, SET_BYTES, { 0, 0, WHOLE } },
	/* entry_count, reserved, then store, node, importance */
	{ "PREFETCH of a node that there is not",
	  WIRE_PREFETCH,
	  PREFETCH_ONE_BYTES,
	  { 1, 0, 0, 1u << 30, ONE } },
	{ "STATUS of nothing known", WIRE_STATUS, sizeof(struct wire_status), { 77 } },
};

static void a_client_that_breaks_the_protocol_is_dropped_alone(void **state)
{
	struct fixture *fixture = *state;

	for (size_t i = 0; i < ARRAY_LENGTH(bad_messages); i++) {
		const struct bad_message *bad = &bad_messages[i];
		_Alignas(8) uint8_t message[2048] = { 0 };
		struct kit_client *client = kit_hello(&fixture->daemon);

		print_message("%s\n", bad->what);
		kit_open(client, 0, fixture->store_path);
		wire_header_init((struct wire_header *)(void *)message, bad->type, bad->bytes);
		memcpy(message + sizeof(struct wire_header), bad->words, sizeof(bad->words));
		kit_send(client, message, bad->bytes, -1);
		kit_receive(client, 0);
		kit_disconnect(client);
		check_honest(fixture, (uint32_t)i);
	}
}

static void bytes_at_random_harm_nobody(void **state)
{
	struct fixture *fixture = *state;
	unsigned seed = 12;

	for (uint32_t i = 0; i < 300; i++) {
		struct kit_client *client =
			i % 2 ? kit_hello(&fixture->daemon) : kit_connect(&fixture->daemon);
		_Alignas(8) uint8_t bytes[4096];
		uint32_t length = 1 + (uint32_t)rand_r(&seed) % sizeof(bytes);
		struct wire_header *header = (struct wire_header *)(void *)bytes;

		for (uint32_t b = 0; b < length; b++)
			bytes[b] = rand_r(&seed) % 4 ? 0 : (uint8_t)rand_r(&seed);
		/* Mostly with a head that gets it looked at. */
		if (length >= sizeof(*header) && i % 8) {
			header->type = (uint16_t)(1 + (uint32_t)rand_r(&seed) % 7);
			header->reserved = 0;
			header->bytes = length;
		}
		kit_send(client, bytes, length, i % 5 ? -1 : client->fd);
		kit_disconnect(client);
	}
	check_honest(fixture, 3);
}

static void a_client_that_never_reads_harms_nobody(void **state)
{
	struct fixture *fixture = *state;
	struct wire_status message = { .what = WIRE_STATUS_ALL };
	struct kit_client *clients[8];

	wire_header_init(&message.header, WIRE_STATUS, sizeof(message));
	for (uint32_t i = 0; i < 8; i++) {
		clients[i] = kit_hello(&fixture->daemon);
		kit_open(clients[i], 0, fixture->store_path);
	}
	for (uint32_t round = 0; round < 200; round++) {
		for (uint32_t i = 0; i < 8; i++) {
			(void)kit_want(clients[i], 0, round, 40, WIRE_SET_RETIRE);
			kit_send(clients[i], &message, sizeof(message), -1);
		}
		if (round % 20 == 0)
			check_honest(fixture, round);
	}
	for (uint32_t i = 0; i < 8; i++)
		kit_disconnect(clients[i]);
	kit_await_number(fixture->honest, "held_nodes", 20);
}

/* ---- what is passed as a store ---- */

static void what_is_no_store_is_refused_with_its_reason(void **state)
{
	struct fixture *fixture = *state;
	const char *text_path = test_path(fixture->folder, "text.ooc");
	const char *empty_path = test_path(fixture->folder, "empty.ooc");
	int pipes[2];
	int fd;

	test_file_write(text_path, "ply\nformat ascii 1.0\n", 21);
	test_file_write(empty_path, "", 0);
	assert_int_equal(pipe2(pipes, O_CLOEXEC), 0);
	assert_int_equal(kit_open_error(fixture->honest, 1, pipes[0]), -EINVAL);
	(void)close(pipes[0]);
	(void)close(pipes[1]);
	fd = open(fixture->folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	assert_int_equal(kit_open_error(fixture->honest, 1, fd), -EINVAL);
	(void)close(fd);
	fd = open("/dev/null", O_RDONLY | O_CLOEXEC);
	assert_int_equal(kit_open_error(fixture->honest, 1, fd), -EINVAL);
	(void)close(fd);
	/* A descriptor that is no proof of the right to read. */
	fd = open(fixture->store_path, O_WRONLY | O_CLOEXEC);
	assert_int_equal(kit_open_error(fixture->honest, 1, fd), -EACCES);
	(void)close(fd);
	fd = open(fixture->store_path, O_PATH | O_CLOEXEC);
	assert_int_equal(kit_open_error(fixture->honest, 1, fd), -EACCES);
	(void)close(fd);
	fd = open(text_path, O_RDONLY | O_CLOEXEC);
	assert_true(kit_open_error(fixture->honest, 1, fd) < 0);
	(void)close(fd);
	fd = open(empty_path, O_RDONLY | O_CLOEXEC);
	assert_true(kit_open_error(fixture->honest, 1, fd) < 0);
	(void)close(fd);
	check_honest(fixture, 0);
}

static void a_store_cut_anywhere_is_refused_or_served_without_what_is_gone(void **state)
{
	struct fixture *fixture = *state;
	const char *path = test_path(fixture->folder, "cut.ooc");
	size_t bytes;
	uint8_t *content = test_file_read(fixture->store_path, &bytes);

	for (uint32_t i = 0; i < 12; i++) {
		int fd;

		test_file_write(path, content, bytes * i / 12);
		fd = open(path, O_RDONLY | O_CLOEXEC);
		assert_true(kit_open_error(fixture->honest, 1, fd) < 0);
		(void)close(fd);
	}
	free(content);
	check_honest(fixture, 0);
}

static void a_store_cut_while_it_is_served_fails_per_node(void **state)
{
	struct fixture *fixture = *state;
	struct kit_store *store = kit_open(fixture->honest, 0, fixture->store_path);
	uint32_t count;

	check_honest(fixture, 0);
	count = kit_entries(store, 0, 0, ENTRIES_MAX, entries);
	assert_int_equal(truncate(fixture->store_path,
				  (off_t)store->nodes[entries[count / 2].node].file_offset + 100),
			 0);
	kit_set(fixture->honest, entries, count, WIRE_SET_RETIRE);
	kit_settle(fixture->honest);
	assert_in_range(kit_count_drawable(store), 20, count - 1);
	assert_int_equal(fixture->honest->last_reason, WIRE_REASON_UNREADABLE);
	assert_int_equal(fixture->honest->refusal_count, count - kit_count_drawable(store));
	assert_int_equal(kit_status_number(fixture->honest, "errors"),
			 fixture->honest->refusal_count);
}

/* Flips one bit of a node's bytes in the file. */
static void damage(const struct fixture *fixture, const struct store_node *record, uint32_t at)
{
	int fd = open(fixture->store_path, O_RDWR | O_CLOEXEC);
	uint8_t byte;

	assert_true(fd >= 0);
	assert_int_equal(pread(fd, &byte, 1, (off_t)(record->file_offset + at)), 1);
	byte ^= 0x10;
	assert_int_equal(pwrite(fd, &byte, 1, (off_t)(record->file_offset + at)), 1);
	assert_int_equal(fsync(fd), 0);
	(void)close(fd);
}

static void a_damaged_payload_is_said_to_be_and_never_shown(void **state)
{
	struct fixture *fixture = *state;
	struct kit_store *store = kit_open(fixture->honest, 0, fixture->store_path);
	uint32_t count = kit_entries(store, 0, 0, 60, entries);

	for (uint32_t i = 0; i < 60; i += 6)
		damage(fixture, &store->nodes[entries[i].node], i * 31);
	kit_set(fixture->honest, entries, count, WIRE_SET_RETIRE);
	kit_settle(fixture->honest);
	assert_int_equal(kit_count_drawable(store), 50);
	assert_int_equal(fixture->honest->refusal_count, 10);
	assert_int_equal(fixture->honest->last_reason, WIRE_REASON_DAMAGED);
	for (uint32_t i = 0; i < 60; i += 6)
		assert_int_equal(wire_word_state(store->directory->words[entries[i].node]),
				 WIRE_NODE_DAMAGED);
	assert_int_equal(kit_status_number(fixture->honest, "errors"), 10);
	/* Asked for again, it is refused again, and not read. */
	kit_set(fixture->honest, entries, count, WIRE_SET_RETIRE);
	kit_settle(fixture->honest);
	assert_int_equal(fixture->honest->refusal_count, 10);
	assert_int_equal(kit_status_number(fixture->honest, "fetches"), 60);
}

static void a_disk_that_fails_now_and_then_loses_only_what_it_fails(void **state)
{
	struct fixture *fixture = *state;
	struct kit_store *store = kit_open(fixture->honest, 0, fixture->store_path);
	uint32_t count = kit_want(fixture->honest, 0, 0, KIT_ALL, WIRE_SET_RETIRE);
	uint32_t drawable;

	kit_settle(fixture->honest);
	drawable = kit_count_drawable(store);
	assert_in_range(drawable, count / 2, count - 1);
	assert_int_equal(fixture->honest->refusal_count, count - drawable);
}

/* Somebody who comes now is served from another store than the honest client. */
static void check_is_another_store(struct fixture *fixture)
{
	struct kit_client *client = kit_hello(&fixture->daemon);
	const struct kit_store *store = kit_open(client, 0, fixture->store_path);

	assert_true(store->node_count != fixture->honest->stores[0].node_count);
	kit_check_served(client, 0);
	kit_disconnect(client);
}

static void a_store_replaced_by_another_is_another_store(void **state)
{
	struct fixture *fixture = *state;
	const struct test_grid other_grid = { .count = 6 };

	check_honest(fixture, 0);
	/* Committing replaces the name; the old file lives on for those who have it. */
	test_store_grid_make(fixture->store_path, &other_grid);
	check_is_another_store(fixture);
	check_honest(fixture, 30);
}

static void a_store_written_anew_in_its_place_is_noticed_when_it_is_opened(void **state)
{
	struct fixture *fixture = *state;
	const struct test_grid other_grid = { .count = 6 };
	const char *other_path = test_path(fixture->folder, "other.ooc");
	uint8_t *content;
	size_t bytes;

	check_honest(fixture, 0);
	test_store_grid_make(other_path, &other_grid);
	content = test_file_read(other_path, &bytes);
	test_file_write(fixture->store_path, content, bytes);
	free(content);
	check_is_another_store(fixture);
}

static void many_connections_at_once_are_served_or_told_why_not(void **state)
{
	struct fixture *fixture = *state;
	struct kit_client *clients[100];

	for (uint32_t i = 0; i < ARRAY_LENGTH(clients); i++)
		clients[i] = kit_hello(&fixture->daemon);
	check_honest(fixture, 0);
	for (uint32_t i = 0; i < ARRAY_LENGTH(clients); i++)
		kit_disconnect(clients[i]);
	check_honest(fixture, 10);
}

int main(void)
{
#define FAULT_TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(a_killed_client_gives_its_holds_back, setup_many,
						teardown),
		cmocka_unit_test_setup_teardown(
			a_killed_client_gives_its_holds_back_though_its_child_keeps_the_socket,
			setup_many, teardown),
		FAULT_TEST(another_version_is_told_so),
		FAULT_TEST(a_client_that_breaks_the_protocol_is_dropped_alone),
		FAULT_TEST(bytes_at_random_harm_nobody),
		FAULT_TEST(a_client_that_never_reads_harms_nobody),
		FAULT_TEST(what_is_no_store_is_refused_with_its_reason),
		FAULT_TEST(a_store_cut_anywhere_is_refused_or_served_without_what_is_gone),
		FAULT_TEST(a_store_cut_while_it_is_served_fails_per_node),
		FAULT_TEST(a_damaged_payload_is_said_to_be_and_never_shown),
		cmocka_unit_test_setup_teardown(
			a_disk_that_fails_now_and_then_loses_only_what_it_fails, setup_failing_disk,
			teardown),
		FAULT_TEST(a_store_replaced_by_another_is_another_store),
		FAULT_TEST(a_store_written_anew_in_its_place_is_noticed_when_it_is_opened),
		FAULT_TEST(many_connections_at_once_are_served_or_told_why_not),
	};

	return TEST_RUN(tests);
}
