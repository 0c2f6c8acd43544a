/* SPDX-License-Identifier: MIT */
/*
 * Goal: what the daemon promises to clients that keep the rules: they draw what they asked for,
 * whole, from one copy, however it is read.
 * Method: a real daemon in another process, real stores and sockets.  The suite runs once for each
 * back end.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "tests/helper.h"
#include "tests/integration/daemon_kit.h"

#define ENTRIES_MAX 1024u

static struct server_config config; /* of the back end that is tested */
static struct wire_entry entries[ENTRIES_MAX];

static const char *make_store(const char *folder, const char *name, uint32_t codec)
{
	const struct test_grid grid = { .count = 12, .face_quads = 4, .codec = codec };
	const char *path = test_path(folder, name);

	test_store_grid_make(path, &grid);
	return path;
}

static void check_all_is_drawn(const char *folder, uint32_t codec)
{
	const char *path = make_store(folder, "a.ooc", codec);
	struct kit_daemon daemon;
	struct kit_client *client;
	struct kit_store *store;
	uint32_t count;

	kit_daemon_start(folder, &config, &daemon);
	client = kit_hello(&daemon);
	store = kit_open(client, 0, path);
	count = kit_want(client, 0, 0, KIT_ALL, WIRE_SET_RETIRE);
	assert_true(count > 100);
	kit_settle(client);
	assert_int_equal(kit_count_drawable(store), count);
	assert_int_equal(client->page->complete, client->serial);
	assert_int_equal(kit_status_number(client, "fetches"), count);
	assert_int_equal(kit_status_number(client, "misses"), count);
	assert_int_equal(kit_status_number(client, "held_nodes"), count);
	assert_true(client->page->fetched_bytes > 0);
	kit_disconnect(client);
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
}

static void a_client_draws_what_it_asked_for(void **state)
{
	check_all_is_drawn(*state, STORE_CODEC_NONE);
}

static void a_client_draws_coded_payloads(void **state)
{
	check_all_is_drawn(*state, STORE_CODEC_MESHOPT_ZSTD);
}

static void two_clients_share_one_copy_and_one_read(void **state)
{
	const char *path = make_store(*state, "a.ooc", STORE_CODEC_NONE);
	struct kit_daemon daemon;
	struct kit_client *clients[2];
	uint64_t read_bytes;
	uint32_t count = 0;

	kit_daemon_start(*state, &config, &daemon);
	for (uint32_t i = 0; i < 2; i++) {
		clients[i] = kit_hello(&daemon);
		kit_open(clients[i], 0, path);
	}
	for (uint32_t i = 0; i < 2; i++)
		count = kit_want(clients[i], 0, 0, KIT_ALL, WIRE_SET_RETIRE);
	for (uint32_t i = 0; i < 2; i++)
		kit_settle(clients[i]);
	for (uint32_t i = 0; i < 2; i++)
		assert_int_equal(kit_count_drawable(&clients[i]->stores[0]), count);
	assert_int_equal(kit_status_number(clients[0], "fetches"), count);
	read_bytes = kit_status_number(clients[0], "read_bytes");
	assert_true(read_bytes >= clients[0]->stores[0].superblock->payload_stored_bytes);
	/* And a third, later, reads nothing. */
	kit_disconnect(clients[1]);
	clients[1] = kit_hello(&daemon);
	kit_open(clients[1], 0, path);
	(void)kit_want(clients[1], 0, 0, KIT_ALL, WIRE_SET_RETIRE);
	kit_settle(clients[1]);
	assert_int_equal(kit_count_drawable(&clients[1]->stores[0]), count);
	assert_int_equal(kit_status_number(clients[0], "read_bytes"), read_bytes);
	for (uint32_t i = 0; i < 2; i++)
		kit_disconnect(clients[i]);
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
}

static void a_walk_through_a_small_cache_is_always_drawn_right(void **state)
{
	const char *path = make_store(*state, "a.ooc", STORE_CODEC_NONE);
	struct server_config small = config;
	struct kit_daemon daemon;
	struct kit_client *client;
	struct kit_store *store;
	uint32_t payloads;

	small.cache_bytes = MIB;
	kit_daemon_start(*state, &small, &daemon);
	client = kit_hello(&daemon);
	store = kit_open(client, 0, path);
	payloads = kit_count_payloads(store);
	for (uint32_t step = 0; step < 120; step++) {
		uint32_t first = step * 7 % (payloads - 30);

		(void)kit_want(client, 0, first, 30, step % 3 ? WIRE_SET_RETIRE : 0);
		kit_settle(client);
		assert_true(kit_count_drawable(store) >= (step % 3 ? 30 : 20));
	}
	assert_true(kit_status_number(client, "evictions") > 100);
	/*
	 * Alone, every miss is fetched, unless it was refused.  What was there and refused for room may go
	 * before there is some: it is then fetched, and was no miss.
	 */
	assert_int_equal(kit_status_number(client, "misses") + kit_status_number(client, "retries"),
			 kit_status_number(client, "fetches") +
				 kit_status_number(client, "refused"));
	kit_disconnect(client);
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
}

static void a_set_larger_than_the_cache_settles_and_is_drawn_in_portions(void **state)
{
	const char *path = make_store(*state, "a.ooc", STORE_CODEC_NONE);
	struct server_config small = config;
	struct kit_daemon daemon;
	struct kit_client *client;
	struct kit_store *store;
	uint32_t payloads;
	uint32_t count;

	small.cache_bytes = MIB;
	kit_daemon_start(*state, &small, &daemon);
	client = kit_hello(&daemon);
	store = kit_open(client, 0, path);
	payloads = kit_entries(store, 0, 0, ENTRIES_MAX, entries);
	kit_set(client, entries, payloads, WIRE_SET_RETIRE);
	kit_settle(client);
	count = kit_count_drawable(store);
	assert_in_range(count, 20, payloads - 20);
	assert_int_equal(client->refusal_count, payloads - count);
	assert_int_equal(client->last_reason, WIRE_REASON_FULL);
	assert_int_equal(client->page->complete, 0);
	/* The most important are the ones that are there. */
	for (uint32_t i = 0; i < count; i++)
		assert_non_null(kit_map(store, entries[i].node));
	for (uint32_t first = 0; first < payloads; first += 20) {
		count = kit_want(client, 0, first, 20, WIRE_SET_RETIRE);
		kit_settle(client);
		assert_int_equal(client->page->complete, client->serial);
		assert_int_equal(kit_count_drawable(store), count);
	}
	kit_disconnect(client);
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
}

static void several_stores_are_drawn_in_one_set(void **state)
{
	struct kit_daemon daemon;
	struct kit_client *client;
	uint32_t count = 0;

	kit_daemon_start(*state, &config, &daemon);
	client = kit_hello(&daemon);
	for (uint32_t i = 0; i < 3; i++) {
		char name[16];

		(void)snprintf(name, sizeof(name), "%u.ooc", i);
		kit_open(client, i, make_store(*state, name, i == 1 ? STORE_CODEC_ZSTD : 0));
		count += kit_entries(&client->stores[i], i, i * 10, 50, entries + count);
	}
	for (uint32_t i = 0; i < count; i++)
		entries[i].importance = (float)(count - i);
	kit_set(client, entries, count, WIRE_SET_RETIRE);
	kit_settle(client);
	for (uint32_t i = 0; i < 3; i++)
		assert_int_equal(kit_count_drawable(&client->stores[i]), 50);
	kit_disconnect(client);
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
}

static void a_prefetch_brings_nodes_in_and_holds_none(void **state)
{
	const char *path = make_store(*state, "a.ooc", STORE_CODEC_NONE);
	struct kit_daemon daemon;
	struct kit_client *client;
	struct kit_store *store;
	uint32_t count;

	kit_daemon_start(*state, &config, &daemon);
	client = kit_hello(&daemon);
	store = kit_open(client, 0, path);
	count = kit_prefetch(client, 0, 0, 50);
	kit_await_number(client, "ready_nodes", count);
	assert_int_equal(kit_status_number(client, "prefetches"), count);
	assert_int_equal(kit_count_drawable(store), 0);
	assert_int_equal(kit_status_number(client, "held_bytes"), 0);
	assert_true(client->page->prefetched_bytes > 0);
	assert_int_equal(kit_want(client, 0, 0, 50, WIRE_SET_RETIRE), count);
	kit_settle(client);
	assert_int_equal(kit_status_number(client, "hits"), count);
	assert_int_equal(kit_status_number(client, "fetches"), 0);
	assert_int_equal(kit_count_drawable(store), count);
	kit_disconnect(client);
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
}

static void closing_a_store_frees_its_number(void **state)
{
	const char *path = make_store(*state, "a.ooc", STORE_CODEC_NONE);
	struct wire_close message = { .store = 0 };
	struct kit_daemon daemon;

	wire_header_init(&message.header, WIRE_CLOSE, sizeof(message));
	kit_daemon_start(*state, &config, &daemon);
	for (uint32_t i = 0; i < 20; i++) {
		struct kit_client *client = kit_hello(&daemon);

		kit_open(client, 0, path);
		(void)kit_want(client, 0, 0, 20, 0);
		kit_settle(client);
		kit_send(client, &message, sizeof(message), -1);
		assert_int_equal(kit_status_number(client, "held_bytes"), 0);
		kit_disconnect(client);
	}
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
}

static void what_is_drawn_stays_when_the_daemon_ends(void **state)
{
	const char *path = make_store(*state, "a.ooc", STORE_CODEC_NONE);
	static const int signals[] = { SIGTERM, SIGKILL };

	for (size_t i = 0; i < ARRAY_LENGTH(signals); i++) {
		struct kit_daemon daemon;
		struct kit_client *client;
		struct kit_store *store;
		uint32_t count;
		int status;

		kit_daemon_start(*state, &config, &daemon);
		client = kit_hello(&daemon);
		store = kit_open(client, 0, path);
		count = kit_want(client, 0, 0, 60, WIRE_SET_RETIRE);
		kit_settle(client);
		status = kit_daemon_stop(&daemon, signals[i]);
		assert_int_equal(status, signals[i] == SIGTERM ? 0 : -SIGKILL);
		assert_int_equal(kit_count_drawable(store), count);
		assert_true(store->grants->epoch == client->epoch);
		assert_true(store->directory->epoch == client->epoch);
		kit_disconnect(client);
	}
	/* The killed one left its socket behind. */
	assert_string_equal(test_folder_list(*state), "a.ooc oocd.sock oocd.sock.lock ");
}

static int run_with(const char *name, enum fetch_kind kind, struct fetch_sim sim)
{
#define DAEMON_TEST(test)                                                                          \
	cmocka_unit_test_setup_teardown(test, test_folder_setup, test_folder_teardown)
	const struct CMUnitTest tests[] = {
		DAEMON_TEST(a_client_draws_what_it_asked_for),
		DAEMON_TEST(a_client_draws_coded_payloads),
		DAEMON_TEST(two_clients_share_one_copy_and_one_read),
		DAEMON_TEST(a_walk_through_a_small_cache_is_always_drawn_right),
		DAEMON_TEST(a_set_larger_than_the_cache_settles_and_is_drawn_in_portions),
		DAEMON_TEST(several_stores_are_drawn_in_one_set),
		DAEMON_TEST(a_prefetch_brings_nodes_in_and_holds_none),
		DAEMON_TEST(closing_a_store_frees_its_number),
		DAEMON_TEST(what_is_drawn_stays_when_the_daemon_ends),
	};

	config = kit_config();
	config.fetch_kind = kind;
	config.sim = sim;
	print_message("read by %s\n", name);
	return TEST_RUN(tests);
}

int main(void)
{
	return run_with("io_uring, or what there is", FETCH_AUTO, (struct fetch_sim){ 0 }) +
	       run_with("threads", FETCH_PREAD, (struct fetch_sim){ 0 }) +
	       run_with("simulation", FETCH_SIM,
			(struct fetch_sim){ .seed = 4,
					    .short_permille = 200,
					    .interrupt_permille = 100,
					    .delay_permille = 200,
					    .reorder = 1 });
}
