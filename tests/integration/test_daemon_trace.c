/* SPDX-License-Identifier: MIT */
/*
 * Goal: a trace says what the daemon's own counters say, and costs the daemon nothing when it cannot
 * be written.
 * Method: a real daemon, clients that walk through a cache that is too small, and the trace's reader.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <signal.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include "formats/base/bytes.h"
#include "formats/trace/trace_reader.h"
#include "tests/helper.h"
#include "tests/integration/daemon_kit.h"

#define STORIES_MAX 1024u
#define CLIENTS     2u

static const char *make_store(const char *folder)
{
	const struct test_grid grid = { .count = 12, .face_quads = 4 };
	const char *path = test_path(folder, "a.ooc");

	test_store_grid_make(path, &grid);
	return path;
}

static struct server_config traced_config(const char *trace_path)
{
	struct server_config config = kit_config();

	config.cache_bytes = MIB;
	config.trace_path = trace_path;
	return config;
}

/* What was said of one node last; of a node of which nothing was said it was evicted. */
struct story {
	enum trace_kind last; /* FETCH, READY or EVICT */
	uint32_t fetch_count;
};

struct counts {
	uint64_t fetched_again; /* after an eviction */
	uint64_t of_kind[TRACE_KIND_COUNT_];
	uint64_t fetched_bytes;
	uint32_t store_count;
	bool was_cut;
};

/* A node is fetched when it is away, becomes ready when it was fetched, is evicted when it was ready. */
static void tell(struct story *story, enum trace_kind kind, struct counts *counts)
{
	bool is_first = story->fetch_count == 0;

	switch (kind) {
	case TRACE_FETCH:
		assert_true(is_first || story->last == TRACE_EVICT);
		counts->fetched_again += !is_first;
		story->fetch_count++;
		break;
	case TRACE_READY:
		assert_int_equal(story->last, TRACE_FETCH);
		break;
	case TRACE_EVICT:
		assert_int_equal(story->last, TRACE_READY);
		break;
	default:
		return;
	}
	story->last = kind;
}

static struct counts read_trace(const char *path)
{
	struct story stories[STORIES_MAX] = { 0 };
	struct counts counts = { 0 };
	struct trace_reader *reader;
	struct trace_event event;
	struct why why;
	int r;

	if (trace_reader_open_path(path, &reader, &why) < 0)
		fail_msg("%s", why.text);
	while ((r = trace_reader_next(reader, &event, &why)) > 0) {
		counts.of_kind[event.kind]++;
		if (!trace_kind_has_entry(event.kind))
			continue;
		assert_true(event.entry < STORIES_MAX);
		tell(&stories[event.entry], event.kind, &counts);
		if (event.kind == TRACE_READY)
			counts.fetched_bytes += trace_reader_entry(reader, event.entry)->bytes;
	}
	if (r < 0)
		fail_msg("%s", why.text);
	counts.store_count = trace_reader_store_count(reader);
	counts.was_cut = trace_reader_was_cut(reader);
	trace_reader_close(reader);
	return counts;
}

/* Both clients walk the same way, one after the other, at different paces. */
static void walk(struct kit_client **clients, struct kit_store **stores, uint32_t steps)
{
	/* Few enough for both: who waits for the other to let go waits for its lease to end. */
	const uint32_t set_nodes = 12;
	uint32_t payloads = kit_count_payloads(stores[0]);

	for (uint32_t step = 0; step < steps; step++) {
		uint32_t i = step % CLIENTS;
		uint32_t first = step * (i + 3) % (payloads - set_nodes);

		(void)kit_want(clients[i], 0, first, set_nodes, WIRE_SET_RETIRE);
		kit_settle(clients[i]);
	}
}

static void a_trace_counts_what_the_daemon_counts(void **state)
{
	const char *path = make_store(*state);
	const char *trace_path = test_path(*state, "a.trace");
	struct server_config config = traced_config(trace_path);
	struct kit_client *clients[CLIENTS];
	struct kit_store *stores[CLIENTS];
	struct kit_daemon daemon;
	struct counts counts;
	struct stat status;

	kit_daemon_start(*state, &config, &daemon);
	for (uint32_t i = 0; i < CLIENTS; i++) {
		clients[i] = kit_hello(&daemon);
		stores[i] = kit_open(clients[i], 0, path);
	}
	walk(clients, stores, 200);
	{
		uint64_t hits = kit_status_number(clients[0], "hits");
		uint64_t misses = kit_status_number(clients[0], "misses");
		uint64_t fetches = kit_status_number(clients[0], "fetches");
		uint64_t evictions = kit_status_number(clients[0], "evictions");
		uint64_t read_bytes = kit_status_number(clients[0], "read_bytes");

		for (uint32_t i = 0; i < CLIENTS; i++)
			kit_disconnect(clients[i]);
		assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
		counts = read_trace(trace_path);
		assert_true(hits > 100 && evictions > 100);
		assert_int_equal(counts.of_kind[TRACE_HIT], hits);
		assert_int_equal(counts.of_kind[TRACE_MISS], misses);
		assert_int_equal(counts.of_kind[TRACE_FETCH], fetches);
		assert_int_equal(counts.of_kind[TRACE_READY], fetches);
		assert_int_equal(counts.of_kind[TRACE_EVICT], evictions);
		assert_true(counts.fetched_again > 100);
		assert_int_equal(counts.fetched_bytes, read_bytes);
	}
	/* The session that waited for the socket and those that asked: all that began have ended. */
	assert_int_equal(counts.of_kind[TRACE_BEGIN], counts.of_kind[TRACE_END]);
	assert_int_equal(counts.of_kind[TRACE_HIT] + counts.of_kind[TRACE_MISS],
			 counts.of_kind[TRACE_DROP]);
	assert_int_equal(counts.of_kind[TRACE_SET], 200);
	assert_int_equal(counts.of_kind[TRACE_OPEN], 1);
	assert_int_equal(counts.of_kind[TRACE_CLOSE], 1);
	assert_false(counts.was_cut);
	/* What clients look at is nobody else's business. */
	assert_int_equal(stat(trace_path, &status), 0);
	assert_int_equal(status.st_mode & 0777, 0600);
}

static void a_killed_daemon_leaves_a_trace_that_is_good_so_far(void **state)
{
	const char *path = make_store(*state);
	const char *trace_path = test_path(*state, "a.trace");
	struct server_config config = traced_config(trace_path);
	struct kit_client *client;
	struct kit_daemon daemon;
	struct counts counts;
	uint32_t count;

	kit_daemon_start(*state, &config, &daemon);
	client = kit_hello(&daemon);
	kit_open(client, 0, path);
	count = kit_want(client, 0, 0, 30, WIRE_SET_RETIRE);
	kit_settle(client);
	/* Its tick brings them to the file. */
	do
		counts = read_trace(trace_path);
	while (counts.of_kind[TRACE_READY] < count);
	assert_int_equal(kit_daemon_stop(&daemon, SIGKILL), -SIGKILL);
	counts = read_trace(trace_path);
	assert_int_equal(counts.of_kind[TRACE_MISS], count);
	assert_int_equal(counts.of_kind[TRACE_DROP], 0);
	kit_disconnect(client);
}

#define DISK_BYTES (512 * KIB)

/* The cache's segments are files too, and have to fit. */
static void limit_files(void)
{
	const struct rlimit limit = { DISK_BYTES, DISK_BYTES };

	(void)signal(SIGXFSZ, SIG_IGN);
	(void)setrlimit(RLIMIT_FSIZE, &limit);
}

static void a_full_disk_ends_the_trace_and_not_the_daemon(void **state)
{
	const char *path = make_store(*state);
	const char *trace_path = test_path(*state, "a.trace");
	struct server_config config = traced_config(trace_path);
	struct kit_client *client;
	struct kit_store *store;
	struct kit_daemon daemon;
	struct stat status;

	kit_daemon_start_prepared(*state, &config, limit_files, &daemon);
	client = kit_hello(&daemon);
	store = kit_open(client, 0, path);
	/* Two sets in turn that have nothing in common, until the limit, and on after it. */
	for (uint64_t after = 0; after <= client->serial / 8;) {
		uint32_t first = client->serial % 2 * 100;

		(void)kit_want(client, 0, first, 40, WIRE_SET_RETIRE);
		if (client->serial % 16 == 0)
			kit_settle(client);
		assert_int_equal(stat(trace_path, &status), 0);
		after += (uint64_t)status.st_size + 2 * TRACE_BLOCK_BYTES_MAX > DISK_BYTES;
	}
	kit_settle(client);
	assert_true(kit_count_drawable(store) > 0);
	kit_disconnect(client);
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
	assert_false(read_trace(trace_path).was_cut);
	assert_int_equal(stat(trace_path, &status), 0);
	assert_true((uint64_t)status.st_size <= DISK_BYTES);
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, test_folder_setup, test_folder_teardown)
	const struct CMUnitTest tests[] = {
		TEST(a_trace_counts_what_the_daemon_counts),
		TEST(a_killed_daemon_leaves_a_trace_that_is_good_so_far),
		TEST(a_full_disk_ends_the_trace_and_not_the_daemon),
	};

	return TEST_RUN(tests);
}
