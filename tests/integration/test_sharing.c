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

/* Connects as another user.  Returns: was it welcome? */
static bool other_user_is_welcome(const struct kit_daemon *daemon)
{
	pid_t pid = test_fork();

	if (pid == 0) {
		if (!test_become_other_user())
			_exit(1);
		kit_disconnect(kit_hello(daemon));
		_exit(0);
	}
	return test_wait(pid) == 0;
}

/* Connects again and again, as who has as many clients as it may.  Ends with 0 if all were refused. */
static pid_t start_flood(const struct kit_daemon *daemon)
{
	pid_t pid = test_fork();

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
	kit_let_others_in(*state, &daemon);
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

/* As many nodes as a cache has room for, whichever they are. */
static uint32_t nodes_that_fit(const struct kit_store *store, const struct server_config *config)
{
	return (uint32_t)(config->cache_bytes /
			  bytes_round_up(store->superblock->payload_bytes_max, WIRE_PAGE_BYTES));
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

/* What was refused once may still be on its way to who is settled. */
static bool crowd_waits(const struct crowd *crowd)
{
	return kit_status_number(crowd->clients[0], "fetches_queued") > 0 ||
	       kit_status_number(crowd->clients[0], "fills_in_flight") > 0;
}

static void crowd_settle(struct crowd *crowd)
{
	do {
		while (crowd_turn(crowd, crowd_is_settled(crowd) ? 0 : KIT_TIMEOUT_MS))
			continue;
		assert_true(crowd_is_settled(crowd));
	} while (crowd_waits(crowd));
}

/*
 * Wants nodes until it has them: a set may be refused while others take their time to let go, and is
 * granted when they have.
 */
static void want_until_drawable(struct kit_client *client, uint32_t first, uint32_t count)
{
	assert_int_equal(kit_want(client, 0, first, count, WIRE_SET_RETIRE), count);
	while (kit_count_drawable(&client->stores[0]) < count) {
		kit_receive_any(client);
		if (client->recalled)
			(void)kit_want(client, 0, first, count, WIRE_SET_RETIRE);
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
	fit = nodes_that_fit(&crowd->clients[0]->stores[0], &config);
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
	pid = test_fork();
	if (pid == 0) {
		struct crowd *crowd = calloc(1, sizeof(*crowd));

		(void)close(ready[0]);
		if (!test_become_other_user())
			_exit(1);
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
	struct server_config config = kit_config();
	const char *path = make_store(*state);
	struct kit_client *client;
	struct kit_daemon daemon;
	const struct kit_store *store;
	pid_t greedy;

	if (getuid() != 0) {
		print_message("not root: no other user to be\n");
		skip();
	}
	config.cache_bytes = 2 * MIB;
	kit_daemon_start(*state, &config, &daemon);
	kit_let_others_in(*state, &daemon);
	assert_int_equal(chmod(path, 0644), 0);
	greedy = start_greedy_user(&daemon, path);
	client = kit_hello(&daemon);
	store = kit_open(client, 0, path);
	/* It has all there is, but for what is left over between payloads. */
	assert_true(kit_status_number(client, "held_and_busy_bytes") >=
		    config.cache_bytes * 8 / 10);
	/* One client against many of one user has its half, but for what is left over: users share. */
	want_until_drawable(client, 400, nodes_that_fit(store, &config) / 2 * 9 / 10);
	assert_int_equal(kill(greedy, SIGKILL), 0);
	assert_int_equal(test_wait(greedy), -SIGKILL);
	kit_disconnect(client);
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
}

/* ---- prefetches ---- */

/* What was prefetched when nothing is read any more. */
static uint64_t prefetched(struct kit_client *client)
{
	kit_await_number(client, "fills_in_flight", 0);
	return kit_status_number(client, "prefetches");
}

static void a_frame_s_prefetches_are_capped_and_take_nothing_that_is_held(void **state)
{
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
	(void)kit_want(client, 0, 300, 200, WIRE_SET_RETIRE);
	kit_settle(client);
	assert_int_equal(kit_status_number(client, "arena_bytes"), config.cache_bytes);
	kit_set(client, NULL, 0, WIRE_SET_RETIRE);
	kit_settle(client);
	/* All of what the policy allows, and no more until a new list or a new set comes. */
	(void)kit_prefetch(client, 0, 100, 100);
	capped = prefetched(client);
	assert_in_range(capped * store->superblock->payload_bytes_max, 150 * KIB, 220 * KIB);
	assert_int_equal(prefetched(client), capped);
	count = kit_want(client, 0, 0, 20, WIRE_SET_RETIRE);
	kit_settle(client);
	assert_int_equal(prefetched(client), 2 * capped);
	/* What is there or on its way is not asked for again. */
	(void)kit_prefetch(client, 0, 100, 2 * (uint32_t)capped);
	assert_int_equal(prefetched(client), 2 * capped);
	/* Far more than the cache has, a frame after the other: nothing that is held goes. */
	for (uint32_t i = 0; i < 20; i++) {
		(void)kit_prefetch(client, 0, 150 + 10 * i, 100);
		(void)prefetched(client);
		assert_int_equal(kit_count_drawable(store), count);
	}
	assert_true(kit_status_number(client, "evictions") > 0);
	assert_int_equal(kit_status_number(client, "revocations"), 0);
	kit_disconnect(client);
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
}

/* ---- leases ---- */

/* A daemon, a client that is stopped with what it holds, and one that has nothing yet. */
struct lease {
	struct kit_daemon daemon;
	pid_t sleeper;
	struct kit_client *client;
};

/*
 * A client in another process that holds seventy nodes, and is stopped.  When it goes on it ends with 0
 * if it has been told that what it drew is no longer there, else with 1.
 */
static pid_t start_sleeper(const struct kit_daemon *daemon, const char *path)
{
	int status;
	pid_t pid = test_fork();

	if (pid == 0) {
		struct kit_client *client = kit_hello(daemon);
		const struct kit_store *store = kit_open(client, 0, path);

		(void)kit_want(client, 0, 0, 70, WIRE_SET_RETIRE);
		kit_settle(client);
		(void)raise(SIGSTOP);
		_exit(store->grants->epoch == 0 ? 0 : 1);
	}
	assert_int_equal(waitpid(pid, &status, WUNTRACED), pid);
	assert_true(WIFSTOPPED(status));
	return pid;
}

static void lease_start(struct lease *lease, const char *folder, uint64_t cache_bytes,
			uint32_t lease_ms)
{
	struct server_config config = kit_config();
	const char *path = make_store(folder);

	config.cache_bytes = cache_bytes;
	config.lease_ms = lease_ms;
	kit_daemon_start(folder, &config, &lease->daemon);
	lease->sleeper = start_sleeper(&lease->daemon, path);
	lease->client = kit_hello(&lease->daemon);
	kit_open(lease->client, 0, path);
}

/* Lets the sleeper go on, and ends all.  Returns: how the sleeper has ended. */
static int lease_end(struct lease *lease)
{
	int ret;

	assert_int_equal(kill(lease->sleeper, SIGCONT), 0);
	ret = test_wait(lease->sleeper);
	kit_disconnect(lease->client);
	assert_int_equal(kit_daemon_stop(&lease->daemon, SIGTERM), 0);
	return ret;
}

static void a_stopped_client_loses_what_others_need(void **state)
{
	struct lease lease;

	lease_start(&lease, *state, 2 * MIB, 300);
	/* Who waits for the other is silent as well, but answers. */
	want_until_drawable(lease.client, 100, 80);
	assert_int_equal(kit_status_number(lease.client, "sessions"), 1);
	assert_int_equal(lease_end(&lease), 0);
}

static void a_stopped_client_is_left_in_peace_while_there_is_room(void **state)
{
	struct lease lease;
	uint64_t until_ns;

	lease_start(&lease, *state, 4 * MIB, 1);
	(void)kit_want(lease.client, 0, 100, 80, WIRE_SET_RETIRE);
	kit_settle(lease.client);
	/* The daemon looks at its leases four times a second. */
	until_ns = kit_status_number(lease.client, "now_ns") + 600 * NS_PER_MS;
	while (kit_status_number(lease.client, "now_ns") < until_ns)
		continue;
	assert_int_equal(kit_status_number(lease.client, "sessions"), 2);
	assert_int_equal(lease_end(&lease), 1);
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
