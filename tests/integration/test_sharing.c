/* SPDX-License-Identifier: MIT */
/*
 * Goal: many clients lean on one daemon, and none of them at the cost of another.
 * Method: a real daemon and real sockets; a small cache and clients that want several times as much.
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
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "tests/helper.h"
#include "tests/integration/daemon_kit.h"

#define ENTRIES_MAX   2048u
#define CAP           20u
#define REFUSED_COUNT 200u

/* ---- users ---- */

/* Others have to get there. */
static void let_others_in(const char *folder, const struct kit_daemon *daemon)
{
	assert_int_equal(chmod(folder, 0711), 0);
	assert_int_equal(chmod(daemon->socket_path, 0666), 0);
}

/* Connects as another user.  Returns: was it welcome? */
static bool other_user_is_welcome(const struct kit_daemon *daemon)
{
	int status;
	pid_t pid;

	(void)fflush(NULL);
	pid = fork();
	assert_true(pid >= 0);
	if (pid == 0) {
		if (!test_become_other_user())
			_exit(1);
		kit_disconnect(kit_hello(daemon));
		_exit(0);
	}
	assert_int_equal(waitpid(pid, &status, 0), pid);
	return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

/* Connects again and again, as who has as many clients as it may.  Ends with 0 if all were refused. */
static pid_t start_flood(const struct kit_daemon *daemon)
{
	pid_t pid;

	(void)fflush(NULL);
	pid = fork();
	assert_true(pid >= 0);
	if (pid > 0)
		return pid;
	for (uint64_t i = 0; i < test_repeats(REFUSED_COUNT); i++) {
		struct kit_client *refused = kit_connect(daemon);
		const struct wire_error *error = kit_receive(refused, WIRE_ERROR);

		if (error->error != -EAGAIN ||
		    !strstr(error->text, "has 20 clients connected already") ||
		    strchr(error->text, '\n'))
			_exit(1);
		kit_disconnect(refused);
	}
	_exit(0);
}

static void a_user_over_its_cap_is_told_so_and_another_still_connects(void **state)
{
	const struct account_policy policies[] = { { .uid = getuid(), .session_count_max = CAP } };
	struct server_config config = kit_config();
	struct kit_client *clients[CAP];
	uint64_t longest_ns = 0;
	struct kit_daemon daemon;
	pid_t flood;
	int status;

	config.policies = policies;
	config.policy_count = 1;
	kit_daemon_start(*state, &config, &daemon);
	let_others_in(*state, &daemon);
	for (uint32_t i = 0; i < CAP; i++)
		clients[i] = kit_hello(&daemon);
	flood = start_flood(&daemon);
	do {
		uint64_t begin_ns = clock_now_ns();

		if (getuid() == 0)
			assert_true(other_user_is_welcome(&daemon));
		longest_ns = u64_max(longest_ns, clock_now_ns() - begin_ns);
	} while (waitpid(flood, &status, WNOHANG) == 0);
	assert_int_equal(status, 0);
	assert_int_equal(kit_status_number(clients[0], "sessions_refused"),
			 test_repeats(REFUSED_COUNT));
	print_message("another user was welcome within %.1f ms, a process made included\n",
		      1e-6 * (double)longest_ns);
	/* One that goes makes room for one. */
	kit_disconnect(clients[0]);
	kit_await_number(clients[1], "sessions", CAP - 1);
	clients[0] = kit_hello(&daemon);
	for (uint32_t i = 0; i < CAP; i++)
		kit_disconnect(clients[i]);
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
}

static void a_user_may_have_hundreds_of_clients(void **state)
{
	struct server_config config = kit_config();
	struct kit_client *clients[300];
	struct kit_daemon daemon;

	kit_daemon_start(*state, &config, &daemon);
	for (uint32_t i = 0; i < ARRAY_LENGTH(clients); i++)
		clients[i] = kit_hello(&daemon);
	for (uint32_t i = 0; i < ARRAY_LENGTH(clients); i++)
		kit_disconnect(clients[i]);
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
}

/* ---- more is wanted than fits ---- */

#define CROWD_COUNT 6u

struct crowd {
	struct kit_client *clients[CROWD_COUNT];
	struct wire_entry entries[CROWD_COUNT][ENTRIES_MAX];
	uint32_t counts[CROWD_COUNT];
};

static const char *make_store(const char *folder)
{
	const struct test_grid grid = { .count = 16, .face_quads = 4 };
	const char *path = test_path(folder, "a.ooc");

	test_store_grid_make(path, &grid);
	return path;
}

static void crowd_want(struct crowd *crowd, uint32_t i, uint32_t first, uint32_t count)
{
	struct kit_client *client = crowd->clients[i];

	crowd->counts[i] = kit_entries(&client->stores[0], 0, first, count, crowd->entries[i]);
	assert_int_equal(crowd->counts[i], count);
	kit_set(client, crowd->entries[i], count, WIRE_SET_RETIRE);
}

/* Each says its set again when it was asked to and reads what it is sent.  Returns: was anything? */
static bool crowd_turn(struct crowd *crowd, int timeout_ms)
{
	struct pollfd fds[CROWD_COUNT];

	for (uint32_t i = 0; i < CROWD_COUNT; i++) {
		struct kit_client *client = crowd->clients[i];

		fds[i] = (struct pollfd){ client->fd, POLLIN, 0 };
		if (client->recalled)
			kit_set(client, crowd->entries[i], crowd->counts[i], WIRE_SET_RETIRE);
	}
	if (poll(fds, CROWD_COUNT, timeout_ms) <= 0)
		return false;
	for (uint32_t i = 0; i < CROWD_COUNT; i++)
		if (fds[i].revents)
			kit_receive_any(crowd->clients[i]);
	return true;
}

static bool crowd_is_settled(const struct crowd *crowd)
{
	for (uint32_t i = 0; i < CROWD_COUNT; i++)
		if (crowd->clients[i]->recalled || !kit_is_settled(crowd->clients[i]))
			return false;
	return true;
}

static void crowd_settle(struct crowd *crowd)
{
	while (crowd_turn(crowd, crowd_is_settled(crowd) ? 0 : KIT_TIMEOUT_MS))
		continue;
	assert_true(crowd_is_settled(crowd));
}

/* A set may be refused while others take their time to let go, and is granted when they have. */
static void await_drawable(struct kit_client *client, const struct wire_entry *entries,
			   uint32_t count)
{
	while (kit_count_drawable(&client->stores[0]) < count) {
		kit_receive_any(client);
		if (client->recalled)
			kit_set(client, entries, count, WIRE_SET_RETIRE);
	}
}

static uint32_t crowd_drawn(const struct crowd *crowd, uint32_t i)
{
	uint32_t drawn = 0;

	while (drawn < crowd->counts[i] &&
	       kit_map(&crowd->clients[i]->stores[0], crowd->entries[i][drawn].node))
		drawn++;
	/* And nothing behind the first that it does not draw. */
	assert_int_equal(kit_count_drawable(&crowd->clients[i]->stores[0]), drawn);
	return drawn;
}

static void a_crowd_that_wants_three_times_the_cache_settles_and_reads_no_more(void **state)
{
	struct server_config config = kit_config();
	const char *path = make_store(*state);
	struct crowd *crowd = calloc(1, sizeof(*crowd));
	struct kit_daemon daemon;
	uint64_t read_bytes;
	uint32_t fit;

	config.cache_bytes = 2 * MIB;
	kit_daemon_start(*state, &config, &daemon);
	for (uint32_t i = 0; i < CROWD_COUNT; i++) {
		crowd->clients[i] = kit_hello(&daemon);
		kit_open(crowd->clients[i], 0, path);
	}
	fit = (uint32_t)(config.cache_bytes /
			 bytes_round_up(crowd->clients[0]->stores[0].superblock->payload_bytes_max,
					WIRE_PAGE_BYTES));
	for (uint32_t step = 0; step < 5; step++) {
		/* The first wants little and has it; the others share what is left. */
		crowd_want(crowd, 0, 0, fit / 20);
		for (uint32_t i = 1; i < CROWD_COUNT; i++)
			crowd_want(crowd, i, 20 + 70 * i + 7 * step, fit * 3 / 5);
		crowd_settle(crowd);
		assert_int_equal(crowd_drawn(crowd, 0), fit / 20);
		for (uint32_t i = 1; i < CROWD_COUNT; i++)
			assert_true(crowd_drawn(crowd, i) >= fit * 8 / 10 / CROWD_COUNT);
		/* It stays so, whatever is said again. */
		read_bytes = kit_status_number(crowd->clients[0], "read_bytes");
		for (uint32_t i = 0; i < CROWD_COUNT; i++)
			kit_set(crowd->clients[i], crowd->entries[i], crowd->counts[i],
				WIRE_SET_RETIRE);
		crowd_settle(crowd);
		assert_int_equal(kit_status_number(crowd->clients[0], "read_bytes"), read_bytes);
		assert_int_equal(kit_status_number(crowd->clients[0], "fetches_queued"), 0);
	}
	for (uint32_t i = 0; i < CROWD_COUNT; i++)
		kit_disconnect(crowd->clients[i]);
	free(crowd);
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
}

/* Another user's clients want all there is, until somebody kills them. */
static pid_t start_greedy_user(const struct kit_daemon *daemon, const char *path)
{
	int ready[2];
	char byte;
	pid_t pid;

	assert_int_equal(pipe2(ready, O_CLOEXEC), 0);
	(void)fflush(NULL);
	pid = fork();
	assert_true(pid >= 0);
	if (pid == 0) {
		struct crowd *crowd = calloc(1, sizeof(*crowd));

		(void)close(ready[0]);
		if (!test_become_other_user())
			_exit(1);
		(void)prctl(PR_SET_PDEATHSIG, SIGKILL);
		for (uint32_t i = 0; i < CROWD_COUNT; i++) {
			crowd->clients[i] = kit_hello(daemon);
			kit_open(crowd->clients[i], 0, path);
			crowd_want(crowd, i, 50 * i, 100);
		}
		crowd_settle(crowd);
		(void)!write(ready[1], "r", 1);
		for (;;)
			(void)crowd_turn(crowd, -1);
	}
	(void)close(ready[1]);
	assert_int_equal(read(ready[0], &byte, 1), 1);
	(void)close(ready[0]);
	return pid;
}

static void a_user_who_holds_all_it_may_leaves_another_its_half(void **state)
{
	static struct wire_entry entries[ENTRIES_MAX];
	struct server_config config = kit_config();
	const char *path = make_store(*state);
	struct kit_client *client;
	struct kit_daemon daemon;
	struct kit_store *store;
	uint32_t count;
	uint32_t fit;
	pid_t greedy;
	int status;

	if (getuid() != 0) {
		print_message("not root: no other user to be\n");
		skip();
	}
	config.cache_bytes = 2 * MIB;
	kit_daemon_start(*state, &config, &daemon);
	let_others_in(*state, &daemon);
	assert_int_equal(chmod(path, 0644), 0);
	greedy = start_greedy_user(&daemon, path);
	client = kit_hello(&daemon);
	store = kit_open(client, 0, path);
	fit = (uint32_t)(config.cache_bytes /
			 bytes_round_up(store->superblock->payload_bytes_max, WIRE_PAGE_BYTES));
	/* It has all there is, but for what is left over between payloads. */
	assert_true(kit_status_number(client, "held_and_busy_bytes") >=
		    config.cache_bytes * 8 / 10);
	/* Its half, but for what is left over. */
	count = kit_entries(store, 0, 400, fit / 2 * 9 / 10, entries);
	kit_set(client, entries, count, WIRE_SET_RETIRE);
	/* One client against many of one user: it is users that share. */
	await_drawable(client, entries, count);
	assert_int_equal(kill(greedy, SIGKILL), 0);
	assert_int_equal(waitpid(greedy, &status, 0), greedy);
	kit_disconnect(client);
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
}

/* ---- prefetches ---- */

static void send_prefetch(struct kit_client *client, uint32_t first, uint32_t count)
{
	_Alignas(8) uint8_t bytes[WIRE_MESSAGE_BYTES_MAX];
	struct wire_prefetch *message = (struct wire_prefetch *)(void *)bytes;

	message->entry_count = kit_entries(&client->stores[0], 0, first, count, message->entries);
	message->reserved = 0;
	wire_header_init(&message->header, WIRE_PREFETCH,
			 sizeof(*message) + message->entry_count * sizeof(message->entries[0]));
	kit_send(client, message, message->header.bytes, -1);
}

/* What was prefetched when nothing is read any more. */
static uint64_t prefetched(struct kit_client *client)
{
	kit_await_number(client, "fills_in_flight", 0);
	return kit_status_number(client, "prefetches");
}

static void a_frame_s_prefetches_are_capped_and_take_nothing_that_is_held(void **state)
{
	static struct wire_entry entries[ENTRIES_MAX];
	const struct account_policy policies[] = { { .uid = getuid(),
						     .prefetch_bytes_max = 200 * KIB } };
	struct server_config config = kit_config();
	const char *path = make_store(*state);
	struct kit_client *client;
	struct kit_daemon daemon;
	struct kit_store *store;
	uint64_t capped;
	uint32_t count;

	config.cache_bytes = 2 * MIB;
	config.policies = policies;
	config.policy_count = 1;
	kit_daemon_start(*state, &config, &daemon);
	client = kit_hello(&daemon);
	store = kit_open(client, 0, path);
	/* A prefetch that waits for a segment to be made would look like one that is over. */
	kit_set(client, entries, kit_entries(store, 0, 300, 200, entries), WIRE_SET_RETIRE);
	kit_settle(client);
	assert_int_equal(kit_status_number(client, "arena_bytes"), config.cache_bytes);
	kit_set(client, NULL, 0, WIRE_SET_RETIRE);
	kit_settle(client);
	/* All of what the policy allows, and no more until a new list or a new set comes. */
	send_prefetch(client, 100, 100);
	capped = prefetched(client);
	assert_in_range(capped * store->superblock->payload_bytes_max, 150 * KIB, 220 * KIB);
	assert_int_equal(prefetched(client), capped);
	count = kit_entries(store, 0, 0, 20, entries);
	kit_set(client, entries, count, WIRE_SET_RETIRE);
	kit_settle(client);
	assert_int_equal(prefetched(client), 2 * capped);
	/* What is there or on its way is not asked for again. */
	send_prefetch(client, 100, 2 * (uint32_t)capped);
	assert_int_equal(prefetched(client), 2 * capped);
	/* Far more than the cache has, a frame after the other: nothing that is held goes. */
	for (uint32_t i = 0; i < 20; i++) {
		send_prefetch(client, 150 + 10 * i, 100);
		(void)prefetched(client);
		assert_int_equal(kit_count_drawable(store), count);
	}
	assert_true(kit_status_number(client, "evictions") > 0);
	assert_int_equal(kit_status_number(client, "revocations"), 0);
	kit_disconnect(client);
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
}

/* ---- leases ---- */

/*
 * A client in another process that holds `count` nodes from `first` on, and is stopped.  When it goes on
 * it ends with 0 if it has been told that what it drew is no longer there, else with 1.
 */
static pid_t start_sleeper(const struct kit_daemon *daemon, const char *path, uint32_t first,
			   uint32_t count)
{
	int status;
	pid_t pid;

	(void)fflush(NULL);
	pid = fork();
	assert_true(pid >= 0);
	if (pid == 0) {
		static struct wire_entry entries[ENTRIES_MAX];
		struct kit_client *client = kit_hello(daemon);
		struct kit_store *store = kit_open(client, 0, path);

		count = kit_entries(store, 0, first, count, entries);
		kit_set(client, entries, count, WIRE_SET_RETIRE);
		kit_settle(client);
		(void)raise(SIGSTOP);
		_exit(store->grants->epoch == 0 ? 0 : 1);
	}
	assert_int_equal(waitpid(pid, &status, WUNTRACED), pid);
	assert_true(WIFSTOPPED(status));
	return pid;
}

static int wake_sleeper(pid_t pid)
{
	int status;

	assert_int_equal(kill(pid, SIGCONT), 0);
	assert_int_equal(waitpid(pid, &status, 0), pid);
	assert_true(WIFEXITED(status));
	return WEXITSTATUS(status);
}

static void a_stopped_client_loses_what_others_need(void **state)
{
	static struct wire_entry entries[ENTRIES_MAX];
	struct server_config config = kit_config();
	const char *path = make_store(*state);
	struct kit_client *client;
	struct kit_daemon daemon;
	struct kit_store *store;
	uint32_t count;
	pid_t sleeper;

	config.cache_bytes = 2 * MIB;
	config.lease_ms = 300;
	kit_daemon_start(*state, &config, &daemon);
	sleeper = start_sleeper(&daemon, path, 0, 70);
	client = kit_hello(&daemon);
	store = kit_open(client, 0, path);
	count = kit_entries(store, 0, 100, 80, entries);
	kit_set(client, entries, count, WIRE_SET_RETIRE);
	/* Who waits for the other is silent as well, but answers. */
	await_drawable(client, entries, count);
	assert_int_equal(kit_status_number(client, "sessions"), 1);
	assert_int_equal(wake_sleeper(sleeper), 0);
	kit_disconnect(client);
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
}

static void a_stopped_client_is_left_in_peace_while_there_is_room(void **state)
{
	static struct wire_entry entries[ENTRIES_MAX];
	struct server_config config = kit_config();
	const char *path = make_store(*state);
	struct kit_client *client;
	struct kit_daemon daemon;
	struct kit_store *store;
	uint32_t count;
	pid_t sleeper;

	config.cache_bytes = 4 * MIB;
	config.lease_ms = 1;
	kit_daemon_start(*state, &config, &daemon);
	sleeper = start_sleeper(&daemon, path, 0, 70);
	client = kit_hello(&daemon);
	store = kit_open(client, 0, path);
	count = kit_entries(store, 0, 100, 80, entries);
	kit_set(client, entries, count, WIRE_SET_RETIRE);
	kit_settle(client);
	/* The daemon looks at its leases four times a second. */
	while (kit_status_number(client, "uptime_s") < 1)
		continue;
	assert_int_equal(kit_status_number(client, "sessions"), 2);
	assert_int_equal(wake_sleeper(sleeper), 1);
	kit_disconnect(client);
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
}

int main(void)
{
#define SHARING_TEST(name)                                                                         \
	cmocka_unit_test_setup_teardown(name, test_folder_setup, test_folder_teardown)
	const struct CMUnitTest tests[] = {
		SHARING_TEST(a_user_over_its_cap_is_told_so_and_another_still_connects),
		SHARING_TEST(a_user_may_have_hundreds_of_clients),
		SHARING_TEST(a_crowd_that_wants_three_times_the_cache_settles_and_reads_no_more),
		SHARING_TEST(a_user_who_holds_all_it_may_leaves_another_its_half),
		SHARING_TEST(a_frame_s_prefetches_are_capped_and_take_nothing_that_is_held),
		SHARING_TEST(a_stopped_client_loses_what_others_need),
		SHARING_TEST(a_stopped_client_is_left_in_peace_while_there_is_room),
	};

	return TEST_RUN(tests);
}
