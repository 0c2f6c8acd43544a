/* SPDX-License-Identifier: MIT */
/*
 * Goal: the daemon's counters add up, at every moment and whatever its clients do, and agree with what
 * the kernel counts.
 * Method: a real daemon with a tiny cache, clients that want, prefetch, retire, break rules and leave at
 * random from a fixed seed; a look after each step.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <jansson.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/statfs.h>
#include <sys/un.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "tests/helper.h"
#include "tests/integration/daemon_kit.h"
#include "tests/openmetrics_judge.h"

#define CLIENT_COUNT 4u
#define STEP_COUNT   400u

static const char *make_store(const char *folder, uint32_t codec)
{
	const struct test_grid grid = { .count = 12, .face_quads = 4, .codec = codec };
	const char *path = test_path(folder, "a.ooc");

	test_store_grid_make(path, &grid);
	return path;
}

/* ---- what the daemon says ---- */

static json_t *look(struct kit_client *client)
{
	char *text = kit_status(client);
	json_error_t error;
	json_t *status = json_loads(text, 0, &error);

	if (!status)
		fail_msg("%s: %s", error.text, text);
	free(text);
	return status;
}

static json_int_t number(const json_t *object, const char *key)
{
	const json_t *value = json_object_get(object, key);

	if (!json_is_integer(value))
		fail_msg("no number: %s", key);
	return json_integer_value(value);
}

/* Over all elements of an array. */
static json_int_t sum(const json_t *status, const char *array, const char *key)
{
	const json_t *elements = json_object_get(status, array);
	json_int_t total = 0;

	for (size_t i = 0; i < json_array_size(elements); i++)
		total += number(json_array_get(elements, i), key);
	return total;
}

static json_int_t sum_members(const json_t *object)
{
	json_int_t total = 0;
	const char *key;
	json_t *value;

	json_object_foreach((json_t *)(uintptr_t)object, key, value) total +=
		json_integer_value(value);
	return total;
}

/* Asks for the state of every node, and counts those with a flag. */
static json_int_t count_flagged(struct kit_client *client, const struct kit_store *store,
				uint32_t flag)
{
	struct wire_status question = { .what = WIRE_STATUS_NODES };
	json_int_t count = 0;

	for (; question.first < store->node_count; question.first += WIRE_NODES_ENTRY_COUNT_MAX) {
		const struct wire_nodes *nodes;

		wire_header_init(&question.header, WIRE_STATUS, sizeof(question));
		kit_send(client, &question, sizeof(question), -1);
		nodes = kit_receive(client, WIRE_NODES);
		assert_int_equal(nodes->first, question.first);
		for (uint32_t i = 0; i < nodes->entry_count; i++)
			count += (nodes->entries[i].flags & flag) != 0;
	}
	return count;
}

#define ASSERT_SUM(left, right)                                                                    \
	do {                                                                                       \
		json_int_t left_ = (left);                                                         \
		json_int_t right_ = (right);                                                       \
		if (left_ != right_)                                                               \
			fail_msg("step %u: %s is %lld, %s is %lld", step, #left, (long long)left_, \
				 #right, (long long)right_);                                       \
	} while (0)

/* The sums of daemon/README.md, but for that about prefetches. */
static void check_sums(const json_t *status, uint32_t step)
{
	const json_t *totals = json_object_get(status, "totals");

	ASSERT_SUM(number(totals, "misses") + number(totals, "retries"),
		   number(totals, "fetches") + number(totals, "joined") +
			   number(totals, "refused") + number(totals, "dropped") +
			   number(status, "fetches_queued"));
	ASSERT_SUM(number(totals, "fetches") + number(totals, "prefetches"),
		   number(totals, "filled") + number(totals, "errors") +
			   number(status, "fills_in_flight"));
	ASSERT_SUM(number(totals, "filled"),
		   number(totals, "evictions") + sum(status, "stores", "ready_nodes"));
	ASSERT_SUM(number(totals, "holds") - number(totals, "releases"),
		   sum(status, "clients", "held_nodes"));
	ASSERT_SUM(number(status, "accepted"),
		   (json_int_t)json_array_size(json_object_get(status, "clients")) +
			   sum_members(json_object_get(status, "disconnects")));
	ASSERT_SUM(sum(status, "stores", "arena_bytes"), sum(status, "stores", "memory_bytes"));
	ASSERT_SUM(sum(status, "stores", "used_bytes"), number(status, "cache_used_bytes"));
}

/* ---- clients that do anything ---- */

static uint32_t random_below(uint64_t *seed, uint32_t bound)
{
	*seed = *seed * UINT64_C(6364136223846793005) + 1442695040888963407u;
	return (uint32_t)(*seed >> 33) % bound;
}

static void send_retire(struct kit_client *client)
{
	struct wire_retire message = { .serial = client->serial };

	wire_header_init(&message.header, WIRE_RETIRE, sizeof(message));
	kit_send(client, &message, sizeof(message), -1);
}

static struct kit_client *come(const struct kit_daemon *daemon, const char *path)
{
	struct kit_client *client = kit_hello(daemon);

	kit_open(client, 0, path);
	return client;
}

/* Sets, prefetches, retirements; ways to leave: politely, or by a message that must not be. */
static void act(struct kit_client **client, const struct kit_daemon *daemon, const char *path,
		uint64_t *seed)
{
	static const struct wire_header none = { .type = 999, .bytes = sizeof(none) };
	uint32_t payloads = kit_count_payloads(&(*client)->stores[0]);
	uint32_t first = random_below(seed, payloads);
	uint32_t count = 1 + random_below(seed, 120);

	switch (random_below(seed, 12)) {
	case 0:
		kit_disconnect(*client);
		*client = come(daemon, path);
		break;
	case 1:
		kit_send(*client, &none, sizeof(none), -1);
		kit_disconnect(*client);
		*client = come(daemon, path);
		break;
	case 2:
	case 3:
	case 4:
		(void)kit_prefetch(*client, 0, first, count);
		break;
	case 5:
		if ((*client)->serial > 0)
			send_retire(*client);
		break;
	default:
		/* Not waited for: what others are asked to give up, they give up when it is their turn. */
		(void)kit_want(*client, 0, first, count,
			       random_below(seed, 3) > 0 ? WIRE_SET_RETIRE : 0);
		break;
	}
}

static void counters_add_up_whatever_clients_do(void **state)
{
	const char *path = make_store(*state, STORE_CODEC_MESHOPT);
	struct server_config config = kit_config();
	struct kit_client *clients[CLIENT_COUNT];
	struct kit_client *observer;
	struct kit_daemon daemon;
	uint64_t seed = 20261128;
	json_t *status = NULL;
	uint32_t step = 0;

	config.cache_bytes = MIB;
	/* One read at a time, so that wants wait and can be dropped. */
	config.queue_depth = 1;
	/* However slow this machine is: nobody is dropped for silence. */
	config.lease_ms = 600000;
	kit_daemon_start(*state, &config, &daemon);
	observer = come(&daemon, path);
	for (uint32_t i = 0; i < CLIENT_COUNT; i++)
		clients[i] = come(&daemon, path);
	for (; step < STEP_COUNT; step++) {
		act(&clients[random_below(&seed, CLIENT_COUNT)], &daemon, path, &seed);
		json_decref(status);
		status = look(observer);
		check_sums(status, step);
	}
	/* It was not for nothing: each of these has happened. */
	for (const char *const *key = (const char *const[]){ "hits", "joined", "refused", "dropped",
							     "retries", "prefetches", "evictions",
							     "shared_hits", "prefetch_used", NULL };
	     *key; key++)
		if (number(json_object_get(status, "totals"), *key) == 0)
			fail_msg("nothing was counted as %s", *key);
	json_decref(status);
	for (uint32_t i = 0; i < CLIENT_COUNT; i++)
		kit_disconnect(clients[i]);
	/* When all is quiet, every prefetch is accounted for. */
	kit_await_number(observer, "prefetches_queued", 0);
	kit_await_number(observer, "fills_in_flight", 0);
	status = look(observer);
	check_sums(status, step);
	ASSERT_SUM(
		number(json_object_get(status, "totals"), "prefetches"),
		number(json_object_get(status, "totals"), "prefetch_used") +
			number(json_object_get(status, "totals"), "prefetch_wasted") +
			count_flagged(observer, &observer->stores[0], WIRE_NODE_UNUSED_PREFETCH));
	json_decref(status);
	kit_disconnect(observer);
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
}

/* ---- the kernel's count ---- */

static uint64_t kernel_read_bytes(const struct kit_daemon *daemon)
{
	char path[64];
	char line[128];
	unsigned long long bytes = 0;
	FILE *file;

	(void)snprintf(path, sizeof(path), "/proc/%d/io", (int)daemon->pid);
	file = fopen(path, "re");
	if (!file)
		return UINT64_MAX;
	while (fgets(line, sizeof(line), file))
		(void)sscanf(line, "read_bytes: %llu", &bytes);
	(void)fclose(file);
	return bytes;
}

static void bytes_read_are_those_that_the_kernel_counts(void **state)
{
	const char *path = make_store(*state, STORE_CODEC_NONE);
	struct server_config config = kit_config();
	struct kit_client *client;
	struct kit_daemon daemon;
	uint64_t before_bytes;
	uint64_t read_bytes;
	uint64_t stored_bytes;

	/* Written out: reading past the page cache would write it, and that is counted elsewhere. */
	sync();
	kit_daemon_start(*state, &config, &daemon);
	client = come(&daemon, path);
	before_bytes = kernel_read_bytes(&daemon);
	(void)kit_want(client, 0, 0, KIT_ALL, 0);
	kit_settle(client);
	kit_await_number(client, "fills_in_flight", 0);
	read_bytes = kernel_read_bytes(&daemon) - before_bytes;
	stored_bytes = kit_status_number(client, "read_bytes");
	assert_int_equal(stored_bytes, client->stores[0].superblock->payload_stored_bytes);
	if (before_bytes == UINT64_MAX || read_bytes == 0) {
		print_message("/proc/PID/io counts no reads here: not compared with it\n");
	} else {
		assert_int_equal(read_bytes, kit_status_number(client, "device_read_bytes"));
		assert_true(read_bytes >= stored_bytes);
	}
	kit_disconnect(client);
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
}

/* ---- who pays for whom, and what prefetches are worth ---- */

static const json_t *client_of_session(const json_t *status, json_int_t session)
{
	const json_t *clients = json_object_get(status, "clients");

	for (size_t i = 0; i < json_array_size(clients); i++)
		if (number(json_array_get(clients, i), "session") == session)
			return json_array_get(clients, i);
	fail_msg("no session %d", (int)session);
	return NULL;
}

static void a_client_owes_what_anothers_read_had_brought(void **state)
{
	const char *path = make_store(*state, STORE_CODEC_NONE);
	struct server_config config = kit_config();
	struct kit_client *payer;
	struct kit_client *debtor;
	struct kit_daemon daemon;
	const json_t *owes;
	json_t *status;

	kit_daemon_start(*state, &config, &daemon);
	payer = come(&daemon, path);
	debtor = come(&daemon, path);
	(void)kit_want(payer, 0, 0, 50, 0);
	kit_settle(payer);
	/* Twenty of them, and ten that are its own to pay. */
	(void)kit_want(debtor, 0, 30, 30, 0);
	kit_settle(debtor);
	status = look(payer);
	owes = json_object_get(client_of_session(status, 2), "owes");
	assert_int_equal(json_array_size(owes), 1);
	assert_int_equal(number(json_array_get(owes, 0), "session"), 1);
	assert_int_equal(number(json_array_get(owes, 0), "nodes"), 20);
	assert_int_equal(number(client_of_session(status, 2), "hits"), 20);
	assert_int_equal(number(client_of_session(status, 2), "fetches"), 10);
	assert_int_equal(number(client_of_session(status, 1), "owed_nodes"), 0);
	assert_int_equal(number(json_object_get(status, "totals"), "shared_hits"), 20);
	json_decref(status);
	kit_disconnect(debtor);
	kit_disconnect(payer);
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
}

static void order_evict_all(struct kit_client *client)
{
	struct wire_admin order = { .what = WIRE_ADMIN_EVICT, .store = WIRE_STORE_ALL };

	wire_header_init(&order.header, WIRE_ADMIN, sizeof(order));
	kit_send(client, &order, sizeof(order), -1);
	(void)kit_receive(client, WIRE_TEXT);
}

static void prefetches_are_used_wasted_or_still_there_and_evictions_regretted(void **state)
{
	const char *path = make_store(*state, STORE_CODEC_NONE);
	struct server_config config = kit_config();
	struct kit_client *client;
	struct kit_daemon daemon;
	const json_t *totals;
	json_t *status;

	kit_daemon_start(*state, &config, &daemon);
	client = come(&daemon, path);
	(void)kit_prefetch(client, 0, 0, 10);
	kit_await_number(client, "ready_nodes", 10);
	assert_int_equal(count_flagged(client, &client->stores[0], WIRE_NODE_UNUSED_PREFETCH), 10);
	/* Six of them are wanted, and two that were not prefetched. */
	(void)kit_want(client, 0, 4, 8, 0);
	kit_settle(client);
	assert_int_equal(count_flagged(client, &client->stores[0], WIRE_NODE_UNUSED_PREFETCH), 4);
	kit_set(client, NULL, 0, WIRE_SET_RETIRE);
	kit_settle(client);
	order_evict_all(client);
	(void)kit_want(client, 0, 4, 5, 0);
	kit_settle(client);
	status = look(client);
	totals = json_object_get(status, "totals");
	assert_int_equal(number(totals, "prefetches"), 10);
	assert_int_equal(number(totals, "prefetch_used"), 6);
	assert_int_equal(number(totals, "prefetch_hits"), 6);
	assert_int_equal(number(totals, "prefetch_wasted"), 4);
	assert_int_equal(number(totals, "evictions"), 12);
	assert_int_equal(number(totals, "regrets"), 5);
	json_decref(status);
	kit_disconnect(client);
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
}

/* ---- metrics ---- */

/* What is told to whoever connects to the socket for it.  Ownership: free(). */
static char *collect(const char *socket_path)
{
	struct sockaddr_un address = { .sun_family = AF_UNIX };
	char *text = calloc(1, 1 << 20);
	int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
	size_t length = 0;
	ssize_t n;

	(void)strcpy(address.sun_path, socket_path);
	assert_int_equal(connect(fd, (const struct sockaddr *)&address, sizeof(address)), 0);
	while ((n = read(fd, text + length, (1 << 20) - 1 - length)) > 0)
		length += (size_t)n;
	(void)close(fd);
	return text;
}

static void check_metrics(const char *text, const char *path)
{
	struct why why;

	if (openmetrics_judge(text, &why) < 0)
		fail_msg("%s", why.text);
	assert_true(openmetrics_value(text, "oocd_misses_total") == 20);
	assert_true(openmetrics_value(text, "oocd_refusals_total{reason=\"full\"}") == 0);
	assert_true(openmetrics_value(text, "oocd_fill_seconds_count{kind=\"fetch\"}") == 20);
	assert_true(openmetrics_value(text, "oocd_arena_bytes") ==
		    openmetrics_value(text, "oocd_arena_memory_bytes"));
	/* Everybody may have it, so nobody's name is in it. */
	assert_null(strstr(text, path));
}

static void metrics_are_told_on_request_on_a_socket_and_in_a_file(void **state)
{
	const char *path = make_store(*state, STORE_CODEC_NONE);
	struct wire_status question = { .what = WIRE_STATUS_METRICS };
	struct server_config config = kit_config();
	const struct wire_text *answer;
	struct kit_client *client;
	struct kit_daemon daemon;
	size_t file_bytes;
	char *text;

	config.metrics_path = test_path(*state, "metrics.prom");
	config.metrics_socket_path = test_path(*state, "metrics.sock");
	kit_daemon_start(*state, &config, &daemon);
	client = come(&daemon, path);
	(void)kit_want(client, 0, 0, 20, 0);
	kit_settle(client);
	text = collect(config.metrics_socket_path);
	check_metrics(text, path);
	free(text);
	wire_header_init(&question.header, WIRE_STATUS, sizeof(question));
	kit_send(client, &question, sizeof(question), -1);
	answer = kit_receive(client, WIRE_TEXT);
	assert_int_equal(answer->last, 1);
	text = strndup(answer->text, answer->text_bytes);
	check_metrics(text, path);
	free(text);
	/* The file is written by a worker soon after the start; stopping waits for it. */
	while (access(config.metrics_path, R_OK) < 0)
		(void)kit_status_number(client, "uptime_s");
	kit_disconnect(client);
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
	text = test_file_read(config.metrics_path, &file_bytes);
	assert_true(file_bytes > 6 && memcmp(text + file_bytes - 6, "# EOF\n", 6) == 0);
	free(text);
	assert_int_equal(access(config.metrics_socket_path, F_OK), -1);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
#define COUNTER_TEST(name)                                                                         \
	cmocka_unit_test_setup_teardown(name, test_folder_setup, test_folder_teardown)
		COUNTER_TEST(counters_add_up_whatever_clients_do),
		COUNTER_TEST(bytes_read_are_those_that_the_kernel_counts),
		COUNTER_TEST(a_client_owes_what_anothers_read_had_brought),
		COUNTER_TEST(prefetches_are_used_wasted_or_still_there_and_evictions_regretted),
		COUNTER_TEST(metrics_are_told_on_request_on_a_socket_and_in_a_file),
	};

	return TEST_RUN(tests);
}
