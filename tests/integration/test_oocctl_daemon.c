/* SPDX-License-Identifier: MIT */
/* Goal: what oocctl says of a running daemon is what its clients have asked it for. */
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <jansson.h>

#include "tests/helper.h"
#include "tests/integration/daemon_kit.h"

#define HELD_COUNT   5u
#define OUTPUT_BYTES (1 << 16)

/** A daemon with one store of 27 leaves, and a client that holds five of them. */
struct scene {
	char *folder;
	const char *store_path;
	struct kit_daemon daemon;
	struct kit_client *client;
};

static int scene_setup(void **state)
{
	struct scene *scene = calloc(1, sizeof(*scene));
	struct server_config config = kit_config();
	struct wire_entry entries[HELD_COUNT];
	struct kit_store *store;

	scene->folder = test_folder_make();
	scene->store_path = test_path(scene->folder, "grid.ooc");
	test_store_grid(scene->store_path, 5);
	kit_daemon_start(scene->folder, &config, &scene->daemon);
	scene->client = kit_hello(&scene->daemon);
	store = kit_open(scene->client, 0, scene->store_path);
	assert_int_equal(kit_entries(store, 0, 0, HELD_COUNT, entries), HELD_COUNT);
	kit_set(scene->client, entries, HELD_COUNT, 0);
	kit_settle(scene->client);
	*state = scene;
	return 0;
}

static int scene_teardown(void **state)
{
	struct scene *scene = *state;

	kit_disconnect(scene->client);
	(void)kit_daemon_stop(&scene->daemon, SIGTERM);
	test_folder_remove(scene->folder);
	free(scene);
	return 0;
}

static json_t *ask(const struct scene *scene, const char *verb, const char *arguments)
{
	static char output[OUTPUT_BYTES];
	json_error_t error;
	json_t *json;

	if (test_command(output, sizeof(output), "$OOCD_BIN/oocctl %s %s --json --socket %s", verb,
			 arguments, scene->daemon.socket_path) != 0)
		fail_msg("%s", output);
	json = json_loads(output, 0, &error);
	if (!json)
		fail_msg("%s: %s", error.text, output);
	return json;
}

static json_int_t number(const json_t *object, const char *key)
{
	const json_t *value = json_object_get(object, key);

	if (!json_is_integer(value))
		fail_msg("no number: %s", key);
	return json_integer_value(value);
}

static void check_store(const json_t *store)
{
	static const char *const keys[] = { "generation", "arena_bytes", "used_bytes", "held_bytes",
					    "hits",       "misses",      "fetches",    "prefetches",
					    "evictions",  "read_bytes",  "errors" };

	for (size_t i = 0; i < sizeof(keys) / sizeof(keys[0]); i++)
		assert_true(number(store, keys[i]) >= 0);
	assert_true(json_is_string(json_object_get(store, "path")));
	assert_int_equal(number(store, "nodes"), 36);
	assert_int_equal(number(store, "ready_nodes"), HELD_COUNT);
	assert_int_equal(number(store, "hits") + number(store, "misses"), HELD_COUNT);
}

static void status_and_stores_say_who_holds_what(void **state)
{
	const struct scene *scene = *state;
	json_t *status = ask(scene, "status", "");
	json_t *stores = ask(scene, "stores", "");
	const json_t *clients = json_object_get(status, "clients");
	json_int_t held_nodes = 0;

	assert_string_equal(json_string_value(json_object_get(status, "version")), OOCD_VERSION);
	assert_true(number(status, "uptime_s") >= 0);
	assert_true(json_is_array(json_object_get(status, "degraded")));
	check_store(json_array_get(json_object_get(status, "stores"), 0));
	check_store(json_array_get(stores, 0));
	/* The one that holds, and the one that asks. */
	assert_int_equal(json_array_size(clients), 2);
	for (size_t i = 0; i < json_array_size(clients); i++)
		held_nodes += number(json_array_get(clients, i), "held_nodes");
	assert_int_equal(held_nodes, HELD_COUNT);
	json_decref(stores);
	json_decref(status);
}

static void nodes_says_which_are_ready(void **state)
{
	const struct scene *scene = *state;
	json_t *answer = ask(scene, "nodes", scene->store_path);
	const json_t *counts = json_object_get(answer, "counts");
	const json_t *nodes = json_object_get(answer, "nodes");
	unsigned ready = 0;

	assert_int_equal(number(json_object_get(counts, "ready"), "nodes"), HELD_COUNT);
	assert_int_equal(number(json_object_get(counts, "absent"), "nodes"), 27 - HELD_COUNT);
	assert_int_equal(json_array_size(nodes), 36);
	for (size_t i = 0; i < json_array_size(nodes); i++)
		ready += strcmp(json_string_value(
					json_object_get(json_array_get(nodes, i), "state")),
				"ready") == 0;
	assert_int_equal(ready, HELD_COUNT);
	json_decref(answer);
}

static void map_draws_what_is_held_and_counts_it(void **state)
{
	const struct scene *scene = *state;
	const char *picture = test_path(scene->folder, "map.png");
	char arguments[4096];
	char output[8192];
	json_t *counts;
	size_t bytes;
	char *png;

	(void)snprintf(arguments, sizeof(arguments), "%s -o %s --size 64x48", scene->store_path,
		       picture);
	counts = ask(scene, "map", arguments);
	assert_int_equal(number(counts, "held"), HELD_COUNT);
	assert_int_equal(number(counts, "absent"), 27 - HELD_COUNT);
	json_decref(counts);
	png = test_file_read(picture, &bytes);
	assert_true(bytes > 8 && memcmp(png, "\x89PNG", 4) == 0);
	free(png);
	assert_int_equal(test_command(output, sizeof(output),
				      "$OOCD_BIN/oocctl map %s -o %s/no/map.png --socket %s",
				      scene->store_path, scene->folder, scene->daemon.socket_path),
			 1);
	assert_int_equal(
		test_command(output, sizeof(output), "$OOCD_BIN/oocctl map %s", scene->store_path),
		2);
}

static void tables_are_for_people(void **state)
{
	const struct scene *scene = *state;
	char output[8192];

	assert_int_equal(test_command(output, sizeof(output), "$OOCD_BIN/oocctl status --socket %s",
				      scene->daemon.socket_path),
			 0);
	assert_non_null(strstr(output, "oocd " OOCD_VERSION ", up for "));
	assert_non_null(strstr(output, "cache "));
	assert_int_equal(test_command(output, sizeof(output),
				      "$OOCD_BIN/oocctl nodes %s --socket %s", scene->store_path,
				      scene->daemon.socket_path),
			 0);
	assert_non_null(strstr(output, "ready             5 nodes"));
	assert_int_equal(test_command(output, sizeof(output),
				      "$OOCD_BIN/oocctl nodes %s/none.ooc --socket %s",
				      scene->folder, scene->daemon.socket_path),
			 1);
	assert_non_null(strstr(output, "No such file"));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(status_and_stores_say_who_holds_what, scene_setup,
						scene_teardown),
		cmocka_unit_test_setup_teardown(nodes_says_which_are_ready, scene_setup,
						scene_teardown),
		cmocka_unit_test_setup_teardown(map_draws_what_is_held_and_counts_it, scene_setup,
						scene_teardown),
		cmocka_unit_test_setup_teardown(tables_are_for_people, scene_setup, scene_teardown),
	};

	return TEST_RUN(tests);
}
