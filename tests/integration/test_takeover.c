/* SPDX-License-Identifier: MIT */
/*
 * Goal: a daemon that is started again has the cache of the one before, verified, and does nothing
 * to what that one's clients still draw.
 * Method: a service manager of the test's own keeps descriptors while oocd is killed and started.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <dirent.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/ptrace.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/trace/trace_reader.h"
#include "libclient/ooc/client.h"
#include "tests/helper.h"
#include "tests/integration/daemon_kit.h"
#include "tests/integration/manager_kit.h"

#define GRID_COUNT 16u /* 512 leaves */
#define LEAVES_MAX 512u
#define CRASHES    8u
/* Longer than a set of a quarter of a store takes. */
#define MOMENT_US 20000u
/* Of a segment, from its beginning: where something is most of the time. */
#define SPOILED_PAGES 4u

#define MANY_CLIENTS 64u

static const char *const usual[] = { "--cache-size", "64M", NULL };

struct scene {
	char *folder;
	const char *plain;
	const char *coded;
	const char *config;
	struct manager *manager;
	struct kit_daemon daemon; /* for clients: where to connect */
};

static int setup(void **state)
{
	struct scene *scene = calloc(1, sizeof(*scene));
	const struct test_grid coded = {
		.count = GRID_COUNT,
		.codec = STORE_CODEC_ZSTD,
		.face_quads = 4,
	};

	scene->folder = test_folder_make();
	scene->plain = test_path(scene->folder, "plain.ooc");
	scene->coded = test_path(scene->folder, "coded.ooc");
	scene->config = test_path(scene->folder, "oocd.conf");
	test_store_grid(scene->plain, GRID_COUNT);
	test_store_grid_make(scene->coded, &coded);
	scene->manager = kit_manager_create(scene->folder);
	(void)snprintf(scene->daemon.socket_path, sizeof(scene->daemon.socket_path), "%s",
		       manager_socket(scene->manager));
	*state = scene;
	return 0;
}

static int teardown(void **state)
{
	struct scene *scene = *state;

	manager_destroy(scene->manager);
	test_folder_remove(scene->folder);
	free(scene);
	return 0;
}

/* With a grace that the test chooses. */
static void start_with_grace(const struct scene *scene, const char *cache_size, const char *grace)
{
	const char *options[] = { "--config", scene->config, NULL };
	char text[128];

	(void)snprintf(text, sizeof(text), "cache-size = %s\ngrace = %s\n", cache_size, grace);
	test_file_write(scene->config, text, strlen(text));
	kit_manager_start(scene->manager, options);
}

/* Returns: how many nodes it wants, of which all there is room for are there. */
static uint32_t want_all(struct kit_client *client, uint32_t flags)
{
	uint32_t count = kit_want(client, 0, 0, KIT_ALL, flags);

	kit_settle(client);
	return count;
}

/* Connects, opens and wants all of a store. */
static struct kit_client *client_of(const struct scene *scene, const char *path,
				    uint32_t *ret_count)
{
	struct kit_client *client = kit_hello(&scene->daemon);

	kit_open(client, 0, path);
	*ret_count = want_all(client, 0);
	return client;
}

static void check_comes_back(struct scene *scene, const char *path, int signal)
{
	struct kit_client *client;
	uint32_t count;

	kit_manager_start(scene->manager, usual);
	client = client_of(scene, path, &count);
	assert_int_equal(kit_count_drawable(&client->stores[0]), count);
	assert_true(kit_status_number(client, "read_bytes") > 0);
	(void)manager_stop(scene->manager, signal);
	kit_disconnect(client);

	kit_manager_start(scene->manager, usual);
	client = client_of(scene, path, &count);
	assert_int_equal(kit_count_drawable(&client->stores[0]), count);
	assert_int_equal(kit_status_number(client, "takeover_verified"), count);
	assert_int_equal(kit_status_number(client, "takeover_reread"), 0);
	assert_int_equal(kit_status_number(client, "read_bytes"), 0);
	kit_disconnect(client);
	assert_int_equal(manager_stop(scene->manager, SIGTERM), 0);
}

static void a_killed_daemon_leaves_its_cache(void **state)
{
	check_comes_back(*state, ((struct scene *)*state)->plain, SIGKILL);
}

static void a_killed_daemon_leaves_what_it_has_decoded(void **state)
{
	check_comes_back(*state, ((struct scene *)*state)->coded, SIGKILL);
}

static void a_daemon_that_ends_in_order_leaves_its_cache(void **state)
{
	check_comes_back(*state, ((struct scene *)*state)->coded, SIGTERM);
}

static uint32_t count_events(const char *path, enum trace_kind kind)
{
	struct trace_reader *reader;
	struct trace_event event;
	uint32_t count = 0;
	struct why why;
	int r;

	if (trace_reader_open_path(path, &reader, &why) < 0)
		fail_msg("%s", why.text);
	while ((r = trace_reader_next(reader, &event, &why)) > 0)
		count += event.kind == kind;
	if (r < 0)
		fail_msg("%s", why.text);
	trace_reader_close(reader);
	return count;
}

static void a_trace_says_what_was_taken_over(void **state)
{
	struct scene *scene = *state;
	const char *trace = test_path(scene->folder, "a.trace");
	const char *options[] = { "--cache-size", "64M", "--trace", trace, NULL };
	struct kit_client *client;
	uint32_t count;

	kit_manager_start(scene->manager, usual);
	client = client_of(scene, scene->plain, &count);
	(void)manager_stop(scene->manager, SIGKILL);
	kit_disconnect(client);

	kit_manager_start(scene->manager, options);
	client = client_of(scene, scene->plain, &count);
	kit_disconnect(client);
	assert_int_equal(manager_stop(scene->manager, SIGTERM), 0);
	assert_int_equal(count_events(trace, TRACE_ADOPT), count);
	assert_int_equal(count_events(trace, TRACE_FETCH), 0);
	assert_int_equal(count_events(trace, TRACE_HIT) + count_events(trace, TRACE_MISS), count);
}

/* A byte of the payload that begins on a page, if one does, of each segment that is kept. */
static uint32_t spoil(struct manager *manager, uint32_t page)
{
	uint32_t count = manager_kept_count(manager, "-segment-");

	assert_true(count > 0);
	for (uint32_t i = 0; i < count; i++) {
		int fd = manager_kept(manager, "-segment-", i);
		uint8_t *base = mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_SHARED, fd,
				     (off_t)page * 4096);

		assert_ptr_not_equal(base, MAP_FAILED);
		base[40] ^= 1;
		(void)munmap(base, 4096);
	}
	return count;
}

static void check_reads_again(struct scene *scene, const char *path)
{
	struct kit_client *client;
	uint32_t spoiled;
	uint32_t count;

	kit_manager_start(scene->manager, usual);
	client = client_of(scene, path, &count);
	kit_disconnect(client);
	(void)manager_stop(scene->manager, SIGKILL);
	spoiled = spoil(scene->manager, 0);

	kit_manager_start(scene->manager, usual);
	client = client_of(scene, path, &count);
	kit_await_number(client, "takeover_left", 0);
	/* Every one that is drawable is looked at. */
	assert_int_equal(kit_count_drawable(&client->stores[0]), count);
	assert_true(kit_status_number(client, "takeover_reread") > 0);
	assert_true(kit_status_number(client, "takeover_reread") <= spoiled);
	kit_disconnect(client);
	assert_int_equal(manager_stop(scene->manager, SIGTERM), 0);
}

static void a_kept_payload_that_is_wrong_is_read_again(void **state)
{
	struct scene *scene = *state;

	check_reads_again(scene, scene->plain);
	manager_destroy(scene->manager);
	scene->manager = kit_manager_create(scene->folder);
	check_reads_again(scene, scene->coded);
}

static void a_store_that_was_written_anew_begins_cold(void **state)
{
	struct scene *scene = *state;
	struct kit_client *client;
	uint32_t count;
	uint32_t other_count;
	size_t byte_count;
	void *bytes;
	int fd;

	kit_manager_start(scene->manager, usual);
	client = client_of(scene, scene->plain, &count);
	kit_disconnect(client);
	(void)manager_stop(scene->manager, SIGKILL);
	/* In its place: device and inode stay. */
	test_store_grid(test_path(scene->folder, "other.ooc"), GRID_COUNT / 2);
	bytes = test_file_read(test_path(scene->folder, "other.ooc"), &byte_count);
	fd = open(scene->plain, O_WRONLY | O_TRUNC | O_CLOEXEC);
	assert_int_equal(write(fd, bytes, byte_count), byte_count);
	(void)close(fd);
	free(bytes);

	kit_manager_start(scene->manager, usual);
	kit_manager_await_kept(scene->manager, "oocd-", 0);
	client = client_of(scene, scene->plain, &other_count);
	assert_true(other_count < count);
	assert_int_equal(kit_count_drawable(&client->stores[0]), other_count);
	assert_int_equal(kit_status_number(client, "takeover_verified"), 0);
	kit_disconnect(client);
}

static void what_is_not_ours_or_not_whole_is_forgotten(void **state)
{
	struct scene *scene = *state;
	struct kit_client *client;
	uint32_t count;

	kit_manager_start(scene->manager, usual);
	client = client_of(scene, scene->plain, &count);
	kit_disconnect(client);
	(void)manager_stop(scene->manager, SIGKILL);
	/* A ledger of nonsense. */
	{
		int fd = manager_kept(scene->manager, "-ledger", 0);
		uint64_t *base = mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);

		assert_ptr_not_equal(base, MAP_FAILED);
		base[0] = 0;
		(void)munmap(base, 4096);
	}
	kit_manager_start(scene->manager, usual);
	kit_manager_await_kept(scene->manager, "oocd-", 0);
	client = client_of(scene, scene->plain, &count);
	assert_int_equal(kit_count_drawable(&client->stores[0]), count);
	assert_true(kit_status_number(client, "read_bytes") > 0);
	kit_disconnect(client);
}

static void a_store_that_is_closed_is_forgotten(void **state)
{
	struct scene *scene = *state;
	const char *const options[] = { "--cache-size", "64M", "--idle-close", "0", NULL };
	struct kit_client *client;
	uint32_t count;

	kit_manager_start(scene->manager, options);
	client = client_of(scene, scene->coded, &count);
	assert_int_equal(manager_kept_count(scene->manager, "-file"), 1);
	assert_int_equal(manager_kept_count(scene->manager, "-ledger"), 1);
	assert_int_equal(manager_kept_count(scene->manager, "-directory-"), 1);
	assert_true(manager_kept_count(scene->manager, "-segment-") > 0);
	kit_disconnect(client);
	kit_manager_await_kept(scene->manager, "oocd-", 0);
}

static void a_smaller_cache_takes_over_what_fits(void **state)
{
	struct scene *scene = *state;
	struct kit_client *client;
	uint32_t count;
	uint32_t verified;

	start_with_grace(scene, "64M", "0");
	client = client_of(scene, scene->coded, &count);
	kit_disconnect(client);
	(void)manager_stop(scene->manager, SIGKILL);

	start_with_grace(scene, "4M", "0");
	client = kit_hello(&scene->daemon);
	kit_await_number(client, "takeover_graces", 0);
	verified = (uint32_t)kit_status_number(client, "takeover_verified");
	assert_true(verified > 0 && verified < count);
	assert_true(kit_status_number(client, "arena_bytes") <= 4 * MIB);
	kit_disconnect(client);
}

/* ---- survivors ---- */

struct survivor {
	struct ooc_client *client;
	struct ooc_store *store;
	uint32_t node;
	struct ooc_place place;
	const uint8_t *payload;
	uint8_t *bytes; /* what it drew */
	uint32_t payload_bytes;
};

static void survivor_start(struct survivor *survivor, const char *socket_path, const char *path)
{
	struct ooc_want wants[LEAVES_MAX];
	size_t count = 0;

	assert_int_equal(ooc_connect(socket_path, "survivor", &survivor->client), 0);
	assert_int_equal(ooc_open(survivor->client, path, &survivor->store), 0);
	for (uint32_t i = 0; i < ooc_node_count(survivor->store) && count < LEAVES_MAX; i++)
		if (ooc_nodes(survivor->store)[i].payload_id != 0)
			wants[count++] = (struct ooc_want){
				.store = survivor->store,
				.node = i,
				.importance = 1,
			};
	assert_true(ooc_visible_set(survivor->client, wants, count) > 0);
	assert_true(ooc_wait(survivor->client, 20000) >= 0);
	survivor->node = wants[0].node;
	survivor->payload = ooc_map(survivor->store, survivor->node);
	assert_non_null(survivor->payload);
	assert_int_equal(ooc_locate(survivor->store, survivor->node, &survivor->place), 0);
	survivor->payload_bytes = ooc_nodes(survivor->store)[survivor->node].payload_bytes;
	survivor->bytes = malloc(survivor->payload_bytes);
	memcpy(survivor->bytes, survivor->payload, survivor->payload_bytes);
}

static bool survivor_sees_the_same(const struct survivor *survivor)
{
	return memcmp(survivor->bytes, survivor->payload, survivor->payload_bytes) == 0;
}

static void survivor_end(struct survivor *survivor)
{
	free(survivor->bytes);
	ooc_disconnect(survivor->client);
}

/* Someone else wants another store whole, in a cache that has no room for both. */
static void crowd(struct kit_client *client, const char *path)
{
	kit_open(client, 0, path);
	(void)want_all(client, WIRE_SET_RETIRE);
}

static void what_a_stopped_client_draws_stays_for_a_grace(void **state)
{
	struct scene *scene = *state;
	struct survivor survivor;
	struct kit_client *client;

	start_with_grace(scene, "8M", "3600");
	survivor_start(&survivor, manager_socket(scene->manager), scene->plain);
	(void)manager_stop(scene->manager, SIGKILL);

	/* It does not run: not one call of the library's until the end. */
	start_with_grace(scene, "8M", "3600");
	client = kit_hello(&scene->daemon);
	kit_await_number(client, "takeover_left", 0);
	crowd(client, scene->coded);
	assert_true(client->refusal_count > 0);
	assert_true(survivor_sees_the_same(&survivor));
	assert_true(ooc_still_valid(survivor.store, survivor.node, &survivor.place));
	assert_int_equal(kit_status_number(client, "takeover_graces"), 1);
	kit_disconnect(client);
	survivor_end(&survivor);
}

static void after_the_grace_a_stopped_client_can_tell(void **state)
{
	struct scene *scene = *state;
	struct survivor survivor;
	struct kit_client *client;

	start_with_grace(scene, "8M", "0");
	survivor_start(&survivor, manager_socket(scene->manager), scene->plain);
	assert_true(ooc_still_valid(survivor.store, survivor.node, &survivor.place));
	(void)manager_stop(scene->manager, SIGKILL);
	assert_true(ooc_still_valid(survivor.store, survivor.node, &survivor.place));

	start_with_grace(scene, "8M", "0");
	client = kit_hello(&scene->daemon);
	kit_await_number(client, "takeover_graces", 0);
	kit_manager_await_kept(scene->manager, "-directory-", 1);
	assert_false(ooc_still_valid(survivor.store, survivor.node, &survivor.place));
	crowd(client, scene->coded);
	kit_disconnect(client);
	survivor_end(&survivor);
}

/* And is not said again. */
static void after_the_grace_a_set_gets_what_it_was_refused(void **state)
{
	struct scene *scene = *state;
	struct survivor survivor;
	struct kit_client *client;
	struct kit_store *store;
	uint32_t count;

	/* Room for either store, and not for both. */
	start_with_grace(scene, "11M", "1");
	survivor_start(&survivor, manager_socket(scene->manager), scene->plain);
	(void)manager_stop(scene->manager, SIGKILL);

	start_with_grace(scene, "11M", "1");
	client = kit_hello(&scene->daemon);
	store = kit_open(client, 0, scene->coded);
	count = want_all(client, WIRE_SET_RETIRE);
	while (kit_count_drawable(store) < count)
		kit_receive_any(client);
	kit_disconnect(client);
	survivor_end(&survivor);
}

/* Two successors: what the first client drew is safe from both, and both directories end. */
static void a_daemon_that_dies_in_its_grace_passes_on_what_it_had(void **state)
{
	struct scene *scene = *state;
	struct survivor first;
	struct survivor second;
	struct kit_client *client;

	start_with_grace(scene, "64M", "3600");
	survivor_start(&first, manager_socket(scene->manager), scene->coded);
	(void)manager_stop(scene->manager, SIGKILL);
	start_with_grace(scene, "64M", "3600");
	survivor_start(&second, manager_socket(scene->manager), scene->coded);
	(void)manager_stop(scene->manager, SIGKILL);
	assert_int_equal(manager_kept_count(scene->manager, "-directory-"), 2);

	start_with_grace(scene, "64M", "0");
	client = kit_hello(&scene->daemon);
	kit_await_number(client, "takeover_graces", 0);
	kit_manager_await_kept(scene->manager, "-directory-", 1);
	assert_false(ooc_still_valid(first.store, first.node, &first.place));
	assert_false(ooc_still_valid(second.store, second.node, &second.place));
	assert_int_equal(kit_status_number(client, "takeover_reread"), 0);
	assert_int_equal(kit_status_number(client, "read_bytes"), 0);
	kit_disconnect(client);
	survivor_end(&first);
	survivor_end(&second);
}

/* A survivor that runs comes back by itself and draws all along. */
static void a_client_that_runs_draws_across_the_restart(void **state)
{
	struct scene *scene = *state;
	struct ooc_counters counters;
	struct survivor survivor;

	start_with_grace(scene, "64M", "0.2");
	survivor_start(&survivor, manager_socket(scene->manager), scene->coded);
	(void)manager_stop(scene->manager, SIGKILL);
	assert_true(survivor_sees_the_same(&survivor));
	start_with_grace(scene, "64M", "0.2");
	do {
		(void)ooc_dispatch(survivor.client);
		survivor.payload = ooc_map(survivor.store, survivor.node);
		assert_non_null(survivor.payload);
		assert_true(survivor_sees_the_same(&survivor));
		ooc_counters(survivor.client, &counters);
	} while (counters.reconnects == 0);
	assert_true(ooc_wait(survivor.client, 20000) >= 0);
	survivor.payload = ooc_map(survivor.store, survivor.node);
	assert_non_null(survivor.payload);
	assert_true(survivor_sees_the_same(&survivor));
	survivor_end(&survivor);
}

/* ---- at any moment ---- */

/* Says sets one after the other; kills the daemon at some moment of the last. */
static uint32_t draw_and_kill(struct scene *scene, struct kit_client *client,
			      const struct kit_store *store, unsigned *seed)
{
	static struct wire_entry entries[LEAVES_MAX];
	uint32_t count = kit_entries(store, 0, 0, LEAVES_MAX, entries);
	uint32_t drawable_count = 0;

	for (uint32_t parts = (uint32_t)rand_r(seed) % 4;; parts--) {
		uint32_t first = count / 4 * ((uint32_t)rand_r(seed) % 4);

		kit_set(client, entries + first, count / 4, WIRE_SET_RETIRE);
		if (parts == 0)
			break;
		/* And not a node is busy for ever, whatever was in flight when the one before died. */
		kit_settle(client);
		drawable_count += kit_count_drawable(store);
	}
	/* The moment is at random, and no event. */
	(void)usleep((useconds_t)rand_r(seed) % MOMENT_US);
	drawable_count += kit_count_drawable(store);
	assert_int_equal(manager_stop(scene->manager, SIGKILL), -SIGKILL);
	return drawable_count;
}

/*
 * Killed while it reads, decodes, evicts and takes over: whatever is drawable is whole, although
 * bytes that the next one takes over are changed between two lives.
 */
static void killed_at_any_moment_it_comes_back_whole(void **state)
{
	struct scene *scene = *state;
	const char *stores[] = { scene->plain, scene->coded };
	uint32_t drawable_count = 0;
	uint64_t reread_count = 0;
	unsigned seed = 1;
	size_t byte_counts[2];
	void *bytes[2];

	for (uint32_t i = 0; i < 2; i++)
		bytes[i] = test_file_read(stores[i], &byte_counts[i]);
	for (uint64_t i = 0; i < test_repeats(CRASHES); i++) {
		struct kit_client *client;

		start_with_grace(scene, "8M", "0");
		client = kit_hello(&scene->daemon);
		/* Now and then all is taken over, else what was kept is in the way for a moment. */
		if (i % 4 == 3) {
			kit_await_number(client, "takeover_graces", 0);
			reread_count += kit_status_number(client, "takeover_reread");
		}
		drawable_count += draw_and_kill(
			scene, client, kit_open(client, 0, stores[rand_r(&seed) % 2]), &seed);
		kit_disconnect(client);
		(void)spoil(scene->manager, (uint32_t)rand_r(&seed) % SPOILED_PAGES);
	}
	assert_true(drawable_count > 0);
	assert_true(reread_count > 0);
	for (uint32_t i = 0; i < 2; i++) {
		size_t byte_count;
		void *now = test_file_read(stores[i], &byte_count);

		assert_int_equal(byte_count, byte_counts[i]);
		assert_memory_equal(now, bytes[i], byte_count);
		free(now);
		free(bytes[i]);
	}
}

/* ---- the manager's other side ---- */

/* Every thread but the loop's is stopped.  Returns: how many. */
static uint32_t stop_workers(pid_t pid, pid_t *ret_threads, uint32_t max)
{
	char path[64];
	const struct dirent *entry;
	uint32_t count = 0;
	DIR *folder;

	(void)snprintf(path, sizeof(path), "/proc/%d/task", (int)pid);
	folder = opendir(path);
	assert_non_null(folder);
	while ((entry = readdir(folder)) != NULL && count < max) {
		pid_t thread = (pid_t)atoi(entry->d_name);
		int status;

		/* The kernel's own threads of a ring cannot be stopped. */
		if (thread <= 0 || thread == pid || ptrace(PTRACE_SEIZE, thread, NULL, NULL) < 0)
			continue;
		assert_int_equal(ptrace(PTRACE_INTERRUPT, thread, NULL, NULL), 0);
		assert_int_equal(waitpid(thread, &status, __WALL), thread);
		ret_threads[count++] = thread;
	}
	(void)closedir(folder);
	return count;
}

static void a_worker_that_hangs_is_no_ping_until_it_goes_on(void **state)
{
	struct scene *scene = *state;
	struct kit_client *client;
	pid_t threads[64];
	uint32_t thread_count;
	uint32_t ping_count;
	uint64_t until_ns;
	uint32_t count;
	int fd;

	kit_manager_start(scene->manager, usual);
	kit_manager_await(scene->manager, "WATCHDOG=1", 2);
	client = kit_hello(&scene->daemon);
	kit_open(client, 0, scene->coded);
	/* Segments are made by workers, too: they shall hang with a payload. */
	(void)want_all(client, WIRE_SET_RETIRE);
	kit_set(client, NULL, 0, WIRE_SET_RETIRE);
	kit_settle(client);
	kit_disconnect(client);
	thread_count = stop_workers(manager_pid(scene->manager), threads, 64);
	assert_true(thread_count > 0);

	client = kit_hello(&scene->daemon);
	fd = open(scene->plain, O_RDONLY | O_CLOEXEC);
	kit_send_open(client, 0, fd);
	(void)close(fd);
	ping_count = manager_said(scene->manager, "WATCHDOG=1");
	/* The loop turns and answers for many times as long as a ping is due: time is the event here. */
	until_ns = kit_status_number(client, "now_ns") + 2000000000;
	while (kit_status_number(client, "now_ns") < until_ns)
		(void)usleep(20000);
	assert_true(manager_said(scene->manager, "WATCHDOG=1") <= ping_count + 2);

	for (uint32_t i = 0; i < thread_count; i++)
		(void)ptrace(PTRACE_DETACH, threads[i], NULL, NULL);
	ping_count = manager_said(scene->manager, "WATCHDOG=1");
	kit_manager_await(scene->manager, "WATCHDOG=1", ping_count + 2);
	kit_receive(client, WIRE_OPENED);
	count = want_all(client, WIRE_SET_RETIRE);
	assert_int_equal(kit_count_drawable(&client->stores[0]), count);
	kit_disconnect(client);
}

static void it_ends_in_order_with_many_clients_that_wait(void **state)
{
	struct scene *scene = *state;
	struct kit_client *clients[MANY_CLIENTS];

	kit_manager_start(scene->manager, usual);
	for (uint32_t i = 0; i < MANY_CLIENTS; i++) {
		clients[i] = kit_hello(&scene->daemon);
		kit_open(clients[i], 0, i % 2 ? scene->plain : scene->coded);
		(void)kit_want(clients[i], 0, 0, KIT_ALL, 0);
	}
	assert_int_equal(manager_stop(scene->manager, SIGTERM), 0);
	assert_true(manager_said(scene->manager, "STOPPING=1") > 0);
	/* What they could draw they draw on. */
	for (uint32_t i = 0; i < MANY_CLIENTS; i++) {
		(void)kit_count_drawable(&clients[i]->stores[0]);
		kit_disconnect(clients[i]);
	}
}

int main(void)
{
#define SCENE_TEST(test) cmocka_unit_test_setup_teardown(test, setup, teardown)
	const struct CMUnitTest tests[] = {
		SCENE_TEST(a_killed_daemon_leaves_its_cache),
		SCENE_TEST(a_killed_daemon_leaves_what_it_has_decoded),
		SCENE_TEST(a_daemon_that_ends_in_order_leaves_its_cache),
		SCENE_TEST(a_trace_says_what_was_taken_over),
		SCENE_TEST(a_kept_payload_that_is_wrong_is_read_again),
		SCENE_TEST(a_store_that_was_written_anew_begins_cold),
		SCENE_TEST(what_is_not_ours_or_not_whole_is_forgotten),
		SCENE_TEST(a_store_that_is_closed_is_forgotten),
		SCENE_TEST(a_smaller_cache_takes_over_what_fits),
		SCENE_TEST(what_a_stopped_client_draws_stays_for_a_grace),
		SCENE_TEST(after_the_grace_a_stopped_client_can_tell),
		SCENE_TEST(after_the_grace_a_set_gets_what_it_was_refused),
		SCENE_TEST(a_daemon_that_dies_in_its_grace_passes_on_what_it_had),
		SCENE_TEST(a_client_that_runs_draws_across_the_restart),
		SCENE_TEST(killed_at_any_moment_it_comes_back_whole),
		SCENE_TEST(a_worker_that_hangs_is_no_ping_until_it_goes_on),
		SCENE_TEST(it_ends_in_order_with_many_clients_that_wait),
	};

	return TEST_RUN(tests);
}
