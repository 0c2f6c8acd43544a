/* SPDX-License-Identifier: MIT */
/*
 * Goal: oocctl watches and steers a running daemon as its manual says; orders are for administrators,
 * and nobody else sees what other users do.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <grp.h>
#include <jansson.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "tests/helper.h"
#include "tests/integration/daemon_kit.h"
#include "tests/openmetrics_judge.h"

#define OUTPUT_BYTES (1 << 18)
#define PAYLOADS     27u
#define HELD_COUNT   5u
#define SOME_UID     65534u
#define SOME_GID     65534u
#define STEERING_GID 4242u

static char output[OUTPUT_BYTES];

/** A daemon with one store of 27 leaves, and a client that holds five of them. */
struct scene {
	char *folder;
	const char *store_path;
	struct kit_daemon daemon;
	struct kit_client *client;
};

static void scene_begin(struct scene *scene, const struct server_config *config)
{
	struct wire_entry entries[HELD_COUNT];
	struct kit_store *store;

	kit_daemon_start(scene->folder, config, &scene->daemon);
	scene->client = kit_hello(&scene->daemon);
	store = kit_open(scene->client, 0, scene->store_path);
	assert_int_equal(kit_entries(store, 0, 0, HELD_COUNT, entries), HELD_COUNT);
	kit_set(scene->client, entries, HELD_COUNT, 0);
	kit_settle(scene->client);
}

static int scene_setup(void **state)
{
	struct scene *scene = calloc(1, sizeof(*scene));
	struct server_config config = kit_config();

	config.admin_gid = STEERING_GID;
	scene->folder = test_folder_make();
	scene->store_path = test_path(scene->folder, "grid.ooc");
	test_store_grid(scene->store_path, 5);
	scene_begin(scene, &config);
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

/* ---- oocctl ---- */

static int run(const struct scene *scene, const char *arguments)
{
	return test_command(output, sizeof(output),
			    "cd %s && OOCD_SOCKET=%s $OOCD_BIN/oocctl %s </dev/null", scene->folder,
			    scene->daemon.socket_path, arguments);
}

static void expect_line(const struct scene *scene, const char *arguments, int status,
			const char *line)
{
	int got = run(scene, arguments);

	if (got != status || !strstr(output, line))
		fail_msg("oocctl %s: %d: %s", arguments, got, output);
}

static json_t *ask(const struct scene *scene, const char *arguments)
{
	json_error_t error;
	json_t *json;

	if (run(scene, arguments) != 0)
		fail_msg("oocctl %s: %s", arguments, output);
	json = json_loads(output, 0, &error);
	if (!json)
		fail_msg("oocctl %s: %s: %s", arguments, error.text, output);
	return json;
}

static json_int_t number(const json_t *object, const char *key)
{
	const json_t *value = json_object_get(object, key);

	if (!json_is_number(value))
		fail_msg("no number: %s", key);
	return (json_int_t)json_number_value(value);
}

static json_int_t count_of(const struct scene *scene, const char *filter)
{
	char arguments[128];
	json_t *answer;
	json_int_t count;

	(void)snprintf(arguments, sizeof(arguments), "nodes grid.ooc --json %s", filter);
	answer = ask(scene, arguments);
	count = (json_int_t)json_array_size(json_object_get(answer, "nodes"));
	json_decref(answer);
	return count;
}

/* ---- steering ---- */

static void evict_takes_out_what_nobody_holds(void **state)
{
	const struct scene *scene = *state;

	expect_line(scene, "prefetch grid.ooc --nodes 14-19", 0, "ready by ");
	assert_int_equal(count_of(scene, "--state ready"), 11);
	assert_int_equal(count_of(scene, "--state free"), 6);
	assert_int_equal(count_of(scene, "--prefetched"), 6);
	expect_line(scene, "evict grid.ooc --nodes 14,15", 0, "evicted 2 nodes");
	assert_int_equal(count_of(scene, "--state free"), 4);
	expect_line(scene, "evict --all", 0, "evicted 4 nodes, 16.0 KiB; 5 are held");
	assert_int_equal(count_of(scene, "--state ready"), HELD_COUNT);
	assert_int_equal(count_of(scene, "--state held"), HELD_COUNT);
}

static void pinned_nodes_come_and_stay_until_they_are_unpinned(void **state)
{
	const struct scene *scene = *state;
	json_t *answer;

	expect_line(scene, "pin grid.ooc --nodes 20-22 --wait 20", 0, "pinned 3 nodes");
	assert_int_equal(count_of(scene, "--pinned --state held"), 3);
	expect_line(scene, "evict --all", 0, "evicted 0 nodes, 0 B; 8 are held");
	answer = ask(scene, "pin grid.ooc --wait 20 --json");
	assert_int_equal(number(answer, "nodes"), PAYLOADS);
	assert_int_equal(number(answer, "ready_nodes"), PAYLOADS);
	json_decref(answer);
	assert_int_equal(kit_status_number(scene->client, "pinned_nodes"), PAYLOADS);
	expect_line(scene, "unpin grid.ooc --nodes 20-22", 0, "unpinned 3 nodes");
	expect_line(scene, "unpin --all", 0, "unpinned 24 nodes");
	expect_line(scene, "unpin --all", 0, "unpinned 0 nodes");
	assert_int_equal(count_of(scene, "--pinned"), 0);
	expect_line(scene, "evict --all", 0, "evicted 22 nodes");
	/* What one verb lists the next one takes. */
	assert_int_equal(test_command(output, sizeof(output),
				      "cd %s && export OOCD_SOCKET=%s && $OOCD_BIN/oocctl nodes "
				      "grid.ooc --state held --list | "
				      "$OOCD_BIN/oocctl pin grid.ooc --nodes -",
				      scene->folder, scene->daemon.socket_path),
			 0);
	assert_non_null(strstr(output, "pinned 5 nodes, 20.0 KiB; 5 of them are in the cache"));
}

static void more_than_the_share_is_not_pinned(void **state)
{
	struct scene *scene = *state;
	struct server_config config = kit_config();

	kit_disconnect(scene->client);
	(void)kit_daemon_stop(&scene->daemon, SIGTERM);
	config.cache_bytes = MIB;
	test_store_grid(scene->store_path, 14);
	scene_begin(scene, &config);
	expect_line(scene, "pin grid.ooc", 1, "may be (1/2 of the cache)");
	assert_int_equal(count_of(scene, "--pinned"), 0);
	expect_line(scene, "pin grid.ooc --nodes 100-120 --wait 20", 0, "pinned 21 nodes");
}

static void write_path(const struct scene *scene)
{
	static const char path[] = "t,eye_x,eye_y,eye_z,at_x,at_y,at_z,up_x,up_y,up_z,fov_y\n"
				   "0,102.5,202.5,280,102.5,202.5,302.5,0,1,0,60\n"
				   "2.5,102.5,202.5,330,102.5,202.5,302.5,0,1,0,60\n";

	test_file_write(test_path(scene->folder, "path.csv"), path, sizeof(path) - 1);
}

static void prefetch_along_a_path_says_when_it_is_ready_or_what_is_short(void **state)
{
	struct scene *scene = *state;
	struct server_config config = kit_config();
	json_t *answer;

	write_path(scene);
	answer = ask(scene, "prefetch grid.ooc --path path.csv --deadline 20 --json");
	assert_true(json_is_true(json_object_get(answer, "ready")));
	assert_int_equal(number(answer, "nodes"), PAYLOADS);
	json_decref(answer);
	assert_int_equal(count_of(scene, "--state ready"), PAYLOADS);
	expect_line(scene, "prefetch grid.ooc --path path.csv --budget 20", 0, "ready by ");
	expect_line(scene, "prefetch grid.ooc --path none.csv", 1, "none.csv");

	/* Too small a cache: it says so, and how far the path is whole. */
	kit_disconnect(scene->client);
	(void)kit_daemon_stop(&scene->daemon, SIGTERM);
	config.cache_bytes = MIB;
	test_store_grid(scene->store_path, 14);
	scene_begin(scene, &config);
	expect_line(scene, "prefetch grid.ooc --path path.csv --deadline 0.2", 1,
		    "they are more than the cache holds; the path is whole until t = 0.00 s");
}

static void reload_says_what_is_wrong(void **state)
{
	/* The kit's daemon has no configuration file. */
	expect_line(*state, "reload", 1, "use --config");
}

/* ---- watching ---- */

static void top_clients_and_dump_show_what_is_going_on(void **state)
{
	const struct scene *scene = *state;
	json_t *answer;

	answer = ask(scene, "top --once --interval 0.01 --json");
	assert_true(number(json_object_get(answer, "totals"), "device_read_bytes_per_s") == 0);
	assert_int_equal(number(json_object_get(answer, "totals"), "fetches"), HELD_COUNT);
	json_decref(answer);
	expect_line(scene, "top --count 2 --interval 0.01", 0, "fetches/s");
	expect_line(scene, "clients", 0, "  kit\n");
	answer = ask(scene, "dump --monitor --count 1");
	assert_int_equal(json_array_size(json_object_get(answer, "clients")), 2);
	json_decref(answer);
	answer = ask(scene, "dump --json");
	assert_int_equal(number(answer, "store_count"), 1);
	json_decref(answer);
}

static void metrics_are_openmetrics_text(void **state)
{
	struct why why;

	assert_int_equal(run(*state, "metrics"), 0);
	if (openmetrics_judge(output, &why) < 0)
		fail_msg("%s", why.text);
	assert_true(openmetrics_value(output, "oocd_fetches_total") == HELD_COUNT);
}

static void nodes_have_places_in_the_order_of_replacement(void **state)
{
	const struct scene *scene = *state;
	const json_t *nodes;
	json_int_t sum = 0;
	json_t *answer;

	expect_line(scene, "prefetch grid.ooc --nodes 14-17", 0, "ready by ");
	answer = ask(scene, "nodes grid.ooc --state free --json");
	nodes = json_object_get(answer, "nodes");
	assert_int_equal(json_array_size(nodes), 4);
	for (size_t i = 0; i < 4; i++) {
		const json_t *node = json_array_get(nodes, i);

		sum += number(node, "place");
		assert_int_equal(number(node, "holds"), 0);
		assert_true(json_is_number(json_object_get(node, "age_s")));
	}
	assert_int_equal(sum, 1 + 2 + 3 + 4);
	json_decref(answer);
	answer = ask(scene, "nodes grid.ooc --payer 1 --json");
	assert_int_equal(json_array_size(json_object_get(answer, "nodes")), HELD_COUNT);
	json_decref(answer);
}

static void what_is_degraded_is_named_with_what_to_do(void **state)
{
	struct scene *scene = *state;
	struct server_config config = kit_config();

	kit_disconnect(scene->client);
	(void)kit_daemon_stop(&scene->daemon, SIGTERM);
	config.metrics_path = test_path(scene->folder, "none/metrics.prom");
	scene_begin(scene, &config);
	/* It is noticed when a worker has tried. */
	do
		assert_int_equal(run(scene, "status"), 0);
	while (!strstr(output, "degraded: the file of metrics cannot be written (No such file"));
	assert_non_null(strstr(output, "see that oocd may write to the folder of metrics-file"));
	assert_int_equal(run(scene, "metrics"), 0);
	assert_true(openmetrics_value(output, "oocd_degraded") >= 1);
}

/* ---- mistakes ---- */

static void wrong_command_lines_are_told_as_such(void **state)
{
	static const char *const wrong[] = {
		"evict",
		"evict grid.ooc --all",
		"evict --all --nodes 3",
		"evict grid.ooc --nodes 3-1",
		"evict grid.ooc --nodes x",
		"evict grid.ooc --nodes ''",
		"evict grid.ooc --wait 1",
		"pin --all",
		"pin grid.ooc --wait 0",
		"unpin",
		"reload grid.ooc",
		"prefetch grid.ooc",
		"prefetch grid.ooc --nodes 1 --path path.csv",
		"prefetch grid.ooc --nodes 9 --deadline -1",
		"prefetch grid.ooc --nodes 9 --size 12",
		"top --count 0",
		"top --interval x",
		"top --monitor",
		"dump grid.ooc",
		"nodes",
		"nodes grid.ooc --state warm",
		"nodes grid.ooc --payer 0",
		"nodes grid.ooc --list --json",
		"clients --nodes 3",
		"metrics grid.ooc",
	};

	for (size_t i = 0; i < ARRAY_LENGTH(wrong); i++)
		if (run(*state, wrong[i]) != 2)
			fail_msg("oocctl %s: %s", wrong[i], output);
	expect_line(*state, "evict grid.ooc --nodes 0", 1, "node 0 has nothing to draw");
	expect_line(*state, "prefetch grid.ooc --nodes 99", 1, "node 99");
}

static void without_a_daemon_each_verb_says_so_in_a_line(void **state)
{
	static const char *const verbs[] = {
		"top --once",    "clients",      "dump",
		"metrics",       "reload",       "evict --all",
		"unpin --all",   "pin grid.ooc", "prefetch grid.ooc --nodes 9",
		"nodes grid.ooc"
	};

	for (size_t i = 0; i < ARRAY_LENGTH(verbs); i++) {
		assert_int_equal(test_command(output, sizeof(output),
					      "cd %s && $OOCD_BIN/oocctl %s --socket %s/none.sock",
					      (const char *)*state, verbs[i], (const char *)*state),
				 1);
		assert_non_null(strstr(output, "is `oocd` running?"));
		assert_ptr_equal(strchr(output, '\n'), output + strlen(output) - 1);
	}
}

/* ---- rights ---- */

/* Connects as another user, in one group more than his own.  The descriptor keeps what it was made as. */
static struct kit_client *hello_as_other(const struct scene *scene, gid_t group)
{
	struct kit_client *client;

	assert_int_equal(chmod(scene->folder, 0755), 0);
	assert_int_equal(chmod(scene->daemon.socket_path, 0666), 0);
	assert_int_equal(setgroups(1, &group), 0);
	assert_int_equal(setegid(SOME_GID), 0);
	assert_int_equal(seteuid(SOME_UID), 0);
	client = kit_hello(&scene->daemon);
	assert_int_equal(seteuid(0), 0);
	assert_int_equal(setegid(0), 0);
	return client;
}

static int order(struct kit_client *client, enum wire_admin_what what)
{
	struct wire_admin message = {
		.what = what,
		.store = what == WIRE_ADMIN_RELOAD ? 0 : WIRE_STORE_ALL,
	};
	const struct wire_error *error = (const struct wire_error *)(void *)client->message;

	wire_header_init(&message.header, WIRE_ADMIN, sizeof(message));
	kit_send(client, &message, sizeof(message), -1);
	kit_receive_any(client);
	if (error->header.type == WIRE_TEXT)
		return 0;
	assert_int_equal(error->header.type, WIRE_ERROR);
	assert_int_equal(error->type, WIRE_ADMIN);
	return error->error;
}

static void skip_unless_root(void)
{
	if (geteuid() == 0)
		return;
	print_message("not root: no other user to be\n");
	skip();
}

static void orders_are_refused_to_other_users(void **state)
{
	const struct scene *scene = *state;
	struct kit_client *other;

	skip_unless_root();
	other = hello_as_other(scene, SOME_GID);
	assert_int_equal(order(other, WIRE_ADMIN_EVICT), -EACCES);
	assert_int_equal(order(other, WIRE_ADMIN_UNPIN), -EACCES);
	assert_int_equal(order(other, WIRE_ADMIN_RELOAD), -EACCES);
	kit_disconnect(other);
	/* To a member of the group they are not. */
	other = hello_as_other(scene, STEERING_GID);
	assert_int_equal(order(other, WIRE_ADMIN_EVICT), 0);
	assert_int_equal(order(other, WIRE_ADMIN_UNPIN), 0);
	kit_disconnect(other);
}

static void other_users_see_sums_of_what_is_not_theirs(void **state)
{
	const struct scene *scene = *state;
	struct kit_client *other;
	json_t *status;
	char *text;

	skip_unless_root();
	other = hello_as_other(scene, SOME_GID);
	text = kit_status(other);
	status = json_loads(text, 0, NULL);
	free(text);
	assert_true(json_is_false(json_object_get(status, "administrator")));
	assert_int_equal(json_array_size(json_object_get(status, "stores")), 0);
	assert_int_equal(json_array_size(json_object_get(status, "clients")), 1);
	assert_int_equal(json_array_size(json_object_get(status, "accounts")), 1);
	assert_int_equal(number(status, "other_stores"), 1);
	assert_int_equal(number(status, "other_clients"), 1);
	assert_int_equal(number(json_object_get(status, "totals"), "fetches"), HELD_COUNT);
	json_decref(status);
	/* What he can open he is told of. */
	kit_open(other, 0, scene->store_path);
	assert_int_equal(kit_status_number(other, "other_stores"), 0);
	assert_int_equal(kit_status_number(other, "pinned_nodes"), 0);
	kit_disconnect(other);
}

static void nodes_are_told_of_open_stores_alone_and_questions_wait_their_turn(void **state)
{
	const struct scene *scene = *state;
	struct wire_status question = { .what = WIRE_STATUS_NODES, .store = 3 };
	const struct wire_error *error;
	const struct wire_nodes *nodes;

	wire_header_init(&question.header, WIRE_STATUS, sizeof(question));
	kit_send(scene->client, &question, sizeof(question), -1);
	error = kit_receive(scene->client, WIRE_ERROR);
	assert_int_equal(error->error, -ENOENT);
	assert_int_equal(error->type, WIRE_STATUS);
	question.store = 0;
	question.first = UINT32_MAX;
	kit_send(scene->client, &question, sizeof(question), -1);
	nodes = kit_receive(scene->client, WIRE_NODES);
	assert_int_equal(nodes->entry_count, 0);
	question.first = 0;
	kit_send(scene->client, &question, sizeof(question), -1);
	nodes = kit_receive(scene->client, WIRE_NODES);
	assert_int_equal(nodes->entry_count, 36);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
#define SCENE_TEST(name) cmocka_unit_test_setup_teardown(name, scene_setup, scene_teardown)
		SCENE_TEST(evict_takes_out_what_nobody_holds),
		SCENE_TEST(pinned_nodes_come_and_stay_until_they_are_unpinned),
		SCENE_TEST(more_than_the_share_is_not_pinned),
		SCENE_TEST(prefetch_along_a_path_says_when_it_is_ready_or_what_is_short),
		SCENE_TEST(reload_says_what_is_wrong),
		SCENE_TEST(top_clients_and_dump_show_what_is_going_on),
		SCENE_TEST(metrics_are_openmetrics_text),
		SCENE_TEST(nodes_have_places_in_the_order_of_replacement),
		SCENE_TEST(what_is_degraded_is_named_with_what_to_do),
		SCENE_TEST(wrong_command_lines_are_told_as_such),
		SCENE_TEST(orders_are_refused_to_other_users),
		SCENE_TEST(other_users_see_sums_of_what_is_not_theirs),
		SCENE_TEST(nodes_are_told_of_open_stores_alone_and_questions_wait_their_turn),
		cmocka_unit_test_setup_teardown(without_a_daemon_each_verb_says_so_in_a_line,
						test_folder_setup, test_folder_teardown),
	};

	return TEST_RUN(tests);
}
