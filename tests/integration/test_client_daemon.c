/* SPDX-License-Identifier: MIT */
/*
 * The client library and the real daemon: what is drawn is what is on disk, whoever else draws,
 * whoever is killed, and whoever starts the daemon.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/file.h"
#include "formats/store/payload.h"
#include "formats/store/store_file.h"
#include "libclient/ooc/client.h"
#include "tests/helper.h"

#define GRID_COUNT      16u /* 512 leaves */
#define LEAF_COUNT      512u
#define RACER_COUNT     8
#define NEWCOMER_LEAVES 12u /* of some fifty that fit into the tiny cache */
/* Clients that draw while the daemon lives and dies, and how much all of them do. */
#define CROWD_COUNT     8u
#define CROWD_COUNT_MAX 64u
#define CROWD_LIVES     4u
#define CROWD_READS     20000u

/* What is on disk, read without the daemon. */
struct truth {
	uint32_t leaf_count;
	uint32_t leaves[LEAF_COUNT];
	uint32_t bytes[LEAF_COUNT];
	void *payloads[LEAF_COUNT];
};

struct scene {
	char *folder;
	char socket_path[100];
	char store_path[100];
	pid_t daemon;
	struct truth truth;
};

/* ---- processes ---- */

/* A daemon that died is noticed within a tenth of a second: no test waits longer, or for a clock. */
static int dispatch_until_away(struct ooc_client *client)
{
	int r;

	do
		r = ooc_dispatch(client);
	while (r == 0);
	return r;
}

static void wait_a_moment(void)
{
	(void)poll(NULL, 0, 2);
}

static void start_daemon(struct scene *scene, const char *cache_size)
{
	char program[4096];

	(void)snprintf(program, sizeof(program), "%s/oocd", getenv("OOCD_BIN"));
	scene->daemon = test_fork();
	if (scene->daemon == 0) {
		execl(program, "oocd", "--socket", scene->socket_path, "--cache-size", cache_size,
		      (char *)NULL);
		_exit(127);
	}
}

static void kill_daemon(struct scene *scene)
{
	if (scene->daemon <= 0)
		return;
	assert_int_equal(kill(scene->daemon, SIGKILL), 0);
	assert_int_equal(test_wait(scene->daemon), -SIGKILL);
	scene->daemon = 0;
}

/* A daemon that was just started needs a moment to listen. */
static struct ooc_client *connect_to(const struct scene *scene)
{
	struct ooc_client *client;
	int status;
	int r;

	while ((r = ooc_connect(scene->socket_path, "test", &client)) < 0) {
		assert_true(r == -ENOENT || r == -ECONNREFUSED);
		assert_int_equal(waitpid(scene->daemon, &status, WNOHANG), 0);
		wait_a_moment();
	}
	return client;
}

/* ---- the scene ---- */

static void truth_read(const char *path, struct truth *ret)
{
	struct store_file *file;
	struct store_node *nodes;
	uint64_t node_count;

	assert_int_equal(store_open_path(path, &file, NULL), 0);
	node_count = store_superblock(file)->node_count;
	nodes = calloc(node_count, sizeof(*nodes));
	assert_int_equal(store_load_hs(file, nodes, NULL), 0);
	for (uint32_t i = 0; i < node_count; i++) {
		uint32_t leaf = ret->leaf_count;
		void *scratch;

		if (nodes[i].payload_bytes == 0)
			continue;
		assert_true(leaf < LEAF_COUNT);
		scratch = malloc(nodes[i].stored_bytes);
		ret->leaves[leaf] = i;
		ret->bytes[leaf] = nodes[i].payload_bytes;
		ret->payloads[leaf] = aligned_alloc(16, (nodes[i].payload_bytes + 15) / 16 * 16);
		assert_int_equal(
			store_read_payload(file, &nodes[i], ret->payloads[leaf], scratch, NULL), 0);
		free(scratch);
		ret->leaf_count++;
	}
	free(nodes);
	store_close(file);
}

static int scene_setup(void **state)
{
	struct scene *scene = calloc(1, sizeof(*scene));
	struct test_grid grid = { .count = GRID_COUNT, .codec = STORE_CODEC_ZSTD, .face_quads = 4 };

	scene->folder = test_folder_make();
	(void)snprintf(scene->socket_path, sizeof(scene->socket_path), "%s/sock", scene->folder);
	(void)snprintf(scene->store_path, sizeof(scene->store_path), "%s/a.ooc", scene->folder);
	test_store_grid_make(scene->store_path, &grid);
	truth_read(scene->store_path, &scene->truth);
	*state = scene;
	return 0;
}

static int scene_teardown(void **state)
{
	struct scene *scene = *state;

	kill_daemon(scene);
	for (uint32_t i = 0; i < scene->truth.leaf_count; i++)
		free(scene->truth.payloads[i]);
	test_folder_remove(scene->folder);
	free(scene);
	return 0;
}

static struct ooc_store *open_store(const struct scene *scene, struct ooc_client *client)
{
	struct ooc_store *store;
	int r = ooc_open(client, scene->store_path, &store);

	if (r < 0)
		fail_msg("cannot open: %s", ooc_error_text(client));
	return store;
}

/* Wants leaves first, first + stride, ... */
static int64_t want_leaves(const struct scene *scene, struct ooc_client *client,
			   struct ooc_store *store, uint32_t first, uint32_t stride, uint32_t count)
{
	struct ooc_want wants[LEAF_COUNT];

	for (uint32_t i = 0; i < count; i++) {
		uint32_t leaf = (first + i * stride) % scene->truth.leaf_count;

		wants[i] =
			(struct ooc_want){ store, scene->truth.leaves[leaf], (float)(count - i) };
	}
	return ooc_visible_set(client, wants, count);
}

/* Compares all that is drawable with the disk.  Returns: how many leaves are. */
static uint32_t verify_drawable(const struct scene *scene, const struct ooc_store *store)
{
	const struct truth *truth = &scene->truth;
	uint32_t count = 0;

	for (uint32_t i = 0; i < truth->leaf_count; i++) {
		const void *payload = ooc_map(store, truth->leaves[i]);

		if (!payload)
			continue;
		assert_memory_equal(payload, truth->payloads[i], truth->bytes[i]);
		count++;
	}
	return count;
}

static void wait_complete(struct ooc_client *client)
{
	struct ooc_progress progress;
	int r = ooc_wait(client, 30000);

	if (r < 0)
		fail_msg("waiting: %d, %s", r, ooc_error_text(client));
	ooc_progress(client, &progress);
	assert_true(progress.complete);
}

/* ---- drawing ---- */

static void every_payload_is_what_is_on_disk(void **state)
{
	struct scene *scene = *state;
	struct ooc_client *client;
	struct ooc_store *store;
	struct ooc_counters before;
	struct ooc_counters after;
	int64_t serial;

	start_daemon(scene, "64M");
	client = connect_to(scene);
	store = open_store(scene, client);
	assert_int_equal(ooc_superblock(store)->leaf_count, LEAF_COUNT);
	serial = want_leaves(scene, client, store, 0, 1, LEAF_COUNT);
	wait_complete(client);
	assert_int_equal(verify_drawable(scene, store), LEAF_COUNT);

	ooc_counters(client, &before);
	assert_true(before.cache_bytes > 0);
	for (int i = 0; i < 1000; i++) {
		assert_int_equal(want_leaves(scene, client, store, 0, 1, LEAF_COUNT), serial);
		assert_int_equal(ooc_dispatch(client), 0);
	}
	ooc_counters(client, &after);
	assert_int_equal(after.messages_sent, before.messages_sent);
	ooc_close(store);
	store = open_store(scene, client);
	assert_int_equal(verify_drawable(scene, store), 0);
	ooc_disconnect(client);
}

static void what_one_client_has_loaded_another_does_not_read(void **state)
{
	struct scene *scene = *state;
	struct ooc_client *clients[2];
	struct ooc_store *stores[2];
	struct ooc_counters counters;
	char *text;

	start_daemon(scene, "64M");
	for (int i = 0; i < 2; i++) {
		clients[i] = connect_to(scene);
		stores[i] = open_store(scene, clients[i]);
		(void)want_leaves(scene, clients[i], stores[i], 0, 1, LEAF_COUNT);
		wait_complete(clients[i]);
		assert_int_equal(verify_drawable(scene, stores[i]), LEAF_COUNT);
	}
	ooc_counters(clients[1], &counters);
	assert_int_equal(counters.fetched_bytes, 0);
	assert_int_equal(ooc_status(clients[1], &text), 0);
	assert_int_equal(text[0], '{');
	assert_non_null(strstr(text, "\"clients\""));
	free(text);

	/* One leaves; what the other holds stays. */
	ooc_disconnect(clients[0]);
	assert_int_equal(ooc_dispatch(clients[1]), 0);
	assert_int_equal(verify_drawable(scene, stores[1]), LEAF_COUNT);
	ooc_disconnect(clients[1]);
}

static void a_prefetched_node_is_there_when_it_is_wanted(void **state)
{
	struct scene *scene = *state;
	struct ooc_client *client;
	struct ooc_store *store;
	struct ooc_counters counters;
	struct ooc_want want;

	start_daemon(scene, "64M");
	client = connect_to(scene);
	store = open_store(scene, client);
	want = (struct ooc_want){ store, scene->truth.leaves[7], 1 };
	assert_int_equal(ooc_prefetch(client, &want, 1), 0);
	while (ooc_node_state(store, want.node) != OOC_STATE_READY)
		wait_a_moment();
	/* Ready, but held by nobody: not to be drawn. */
	assert_null(ooc_map(store, want.node));
	(void)want_leaves(scene, client, store, 7, 1, 1);
	wait_complete(client);
	assert_int_equal(verify_drawable(scene, store), 1);
	ooc_counters(client, &counters);
	assert_int_equal(counters.fetched_bytes, 0);
	ooc_disconnect(client);
}

static void a_killed_daemon_that_comes_back_is_found_and_holds_again(void **state)
{
	struct scene *scene = *state;
	struct ooc_client *client;
	struct ooc_store *store;
	struct ooc_counters counters;

	start_daemon(scene, "64M");
	client = connect_to(scene);
	store = open_store(scene, client);
	(void)want_leaves(scene, client, store, 0, 1, LEAF_COUNT);
	wait_complete(client);
	for (uint64_t i = 1; i <= 3; i++) {
		kill_daemon(scene);
		assert_int_equal(dispatch_until_away(client), -ENOTCONN);
		assert_int_equal(verify_drawable(scene, store), LEAF_COUNT);
		start_daemon(scene, "64M");
		/* All the while, nothing that was drawable is missing or wrong. */
		do {
			(void)ooc_dispatch(client);
			assert_int_equal(verify_drawable(scene, store), LEAF_COUNT);
			ooc_counters(client, &counters);
		} while (counters.reconnects < i || counters.fetched_bytes == 0);
		wait_complete(client);
		assert_int_equal(verify_drawable(scene, store), LEAF_COUNT);
	}
	ooc_disconnect(client);
}

static void more_than_fits_is_refused_with_a_reason_and_drawn_in_portions(void **state)
{
	struct scene *scene = *state;
	const struct truth *truth = &scene->truth;
	struct ooc_client *client;
	struct ooc_store *store;
	struct ooc_progress progress;
	uint32_t seen = 0;

	start_daemon(scene, "1M");
	client = connect_to(scene);
	store = open_store(scene, client);
	(void)want_leaves(scene, client, store, 0, 1, LEAF_COUNT);
	assert_int_equal(ooc_wait(client, 30000), 0);
	ooc_progress(client, &progress);
	assert_true(progress.settled);
	assert_false(progress.complete);
	assert_true(progress.drawable_count > 0);
	assert_true(progress.refused_count > 0);
	assert_int_equal(ooc_not_now(store, truth->leaves[LEAF_COUNT - 1]), OOC_REASON_FULL);

	while (seen < LEAF_COUNT) {
		(void)want_leaves(scene, client, store, seen, 1, LEAF_COUNT - seen);
		assert_int_equal(ooc_wait(client, 30000), 0);
		assert_non_null(ooc_map(store, truth->leaves[seen]));
		(void)verify_drawable(scene, store);
		while (seen < LEAF_COUNT && ooc_map(store, truth->leaves[seen]))
			seen++;
	}
	ooc_disconnect(client);
}

/* ---- giving way ---- */

/* As another user, where that may be: draws some leaves that nobody else wants.  Ends with 0 if it could. */
static pid_t start_newcomer(const struct scene *scene)
{
	struct ooc_progress progress;
	struct ooc_client *client;
	struct ooc_store *store;
	pid_t pid = test_fork();

	if (pid > 0)
		return pid;
	(void)test_become_other_user();
	if (ooc_connect(scene->socket_path, "newcomer", &client) < 0 ||
	    ooc_open(client, scene->store_path, &store) < 0)
		_exit(1);
	(void)want_leaves(scene, client, store, LEAF_COUNT / 2, 1, NEWCOMER_LEAVES);
	if (ooc_wait(client, 30000) < 0)
		_exit(2);
	ooc_progress(client, &progress);
	_exit(progress.complete ? 0 : 3);
}

/* Who has the whole cache is asked for room, and has no more to do than to go on as it did. */
static void check_gives_way(const struct scene *scene, struct ooc_client *client,
			    bool keeps_drawing)
{
	struct ooc_store *store = open_store(scene, client);
	struct ooc_counters counters;
	uint32_t drawable_count;
	pid_t newcomer;
	int status;

	ooc_keep_drawing(client, keeps_drawing);
	(void)want_leaves(scene, client, store, 0, 1, LEAF_COUNT / 2);
	assert_int_equal(ooc_wait(client, 30000), 0);
	drawable_count = verify_drawable(scene, store);
	assert_true(drawable_count > NEWCOMER_LEAVES);
	newcomer = start_newcomer(scene);
	while (waitpid(newcomer, &status, WNOHANG) == 0) {
		assert_int_equal(ooc_dispatch(client), 0);
		if (keeps_drawing)
			assert_int_equal(ooc_retire(client, want_leaves(scene, client, store, 0, 1,
									LEAF_COUNT / 2)),
					 0);
		assert_in_range(verify_drawable(scene, store), drawable_count - 2 * NEWCOMER_LEAVES,
				drawable_count);
		wait_a_moment();
	}
	assert_int_equal(status, 0);
	/* It was asked, and not thrown out. */
	ooc_counters(client, &counters);
	assert_int_equal(counters.reconnects, 0);
	/* And what the other has left comes back by itself. */
	while (verify_drawable(scene, store) < drawable_count) {
		assert_int_equal(ooc_dispatch(client), 0);
		wait_a_moment();
	}
	ooc_disconnect(client);
}

/* With a socket and a store for all. */
static struct ooc_client *connect_beside_others(struct scene *scene)
{
	struct ooc_client *client;

	assert_int_equal(chmod(scene->folder, 0711), 0);
	assert_int_equal(chmod(scene->store_path, 0644), 0);
	start_daemon(scene, "1M");
	client = connect_to(scene);
	assert_int_equal(chmod(scene->socket_path, 0666), 0);
	return client;
}

static void a_client_gives_way_to_another_users_by_itself(void **state)
{
	check_gives_way(*state, connect_beside_others(*state), false);
}

static void a_client_that_keeps_drawing_gives_way_with_its_next_set(void **state)
{
	check_gives_way(*state, connect_beside_others(*state), true);
}

/* ---- a crowd in a tiny cache ---- */

/* What the processes of a crowd and the test know of each other, in memory that they share. */
struct crowd {
	_Atomic uint64_t reads;
	uint32_t client_count;
	_Atomic uint32_t lives[CROWD_COUNT_MAX]; /* of the daemon, that a client has drawn in */
};

/* In a child process: cmocka's checks would go on with the next test there. */
static void child_check(bool holds, const char *what)
{
	if (holds)
		return;
	(void)fprintf(stderr, "a client finds that %s\n", what);
	_exit(1);
}

/* Compares all that is drawable, and counts it. */
static uint32_t draw(const struct truth *truth, const struct ooc_store *store, struct crowd *crowd)
{
	uint32_t drawn = 0;

	for (uint32_t i = 0; i < truth->leaf_count; i++) {
		const void *payload = ooc_map(store, truth->leaves[i]);

		if (!payload)
			continue;
		child_check(memcmp(payload, truth->payloads[i], truth->bytes[i]) == 0,
			    "a payload has wrong bytes");
		drawn++;
	}
	atomic_fetch_add(&crowd->reads, drawn);
	return drawn;
}

/* Draws leaves at random, until it has in all lives of the daemon.  Ends with the process. */
static _Noreturn void draw_at_random(const struct scene *scene, struct crowd *crowd,
				     uint32_t number)
{
	const uint64_t reads = test_repeats(CROWD_READS);
	struct ooc_client *client;
	struct ooc_store *store;
	uint32_t random = number + 1;

	while (ooc_connect(scene->socket_path, "crowd", &client) < 0)
		wait_a_moment();
	while (ooc_open(client, scene->store_path, &store) < 0)
		wait_a_moment();
	while (atomic_load(&crowd->lives[number]) < CROWD_LIVES ||
	       atomic_load(&crowd->reads) < reads) {
		struct ooc_counters counters;
		bool is_settled;

		random = random * 1664525u + 1013904223u;
		(void)want_leaves(scene, client, store, random >> 8, 1 + (random >> 4) % 3,
				  2 + random % 30);
		(void)ooc_dispatch(client);
		(void)draw(&scene->truth, store, crowd);
		is_settled = ooc_wait(client, 1000) == 0;
		ooc_counters(client, &counters);
		/* What is drawn of a set that is settled is held in the life that settled it. */
		if (draw(&scene->truth, store, crowd) > 0 && is_settled)
			atomic_store(&crowd->lives[number], (uint32_t)counters.reconnects + 1);
	}
	ooc_disconnect(client);
	_exit(0);
}

/* Waits until every client has drawn in so many lives of the daemon. */
static void await_life(const struct crowd *crowd, const pid_t *clients, uint32_t life)
{
	for (uint32_t i = 0; i < crowd->client_count; i++)
		while (atomic_load(&crowd->lives[i]) < life) {
			int status;

			if (waitpid(clients[i], &status, WNOHANG) != 0)
				fail_msg("client %u ended with status %#x", i, (unsigned)status);
			wait_a_moment();
		}
}

static void a_crowd_in_a_tiny_cache_never_sees_a_wrong_byte_and_comes_back(void **state)
{
	struct scene *scene = *state;
	struct crowd *crowd = mmap(NULL, sizeof(*crowd), PROT_READ | PROT_WRITE,
				   MAP_SHARED | MAP_ANONYMOUS, -1, 0);
	pid_t clients[CROWD_COUNT_MAX];

	assert_ptr_not_equal(crowd, MAP_FAILED);
	crowd->client_count = (uint32_t)u64_min(test_repeats(CROWD_COUNT), CROWD_COUNT_MAX);
	start_daemon(scene, "1M");
	for (uint32_t i = 0; i < crowd->client_count; i++) {
		clients[i] = test_fork();
		if (clients[i] == 0)
			draw_at_random(scene, crowd, i);
	}
	for (uint32_t life = 1; life < CROWD_LIVES; life++) {
		await_life(crowd, clients, life);
		kill_daemon(scene);
		start_daemon(scene, "1M");
	}
	for (uint32_t i = 0; i < crowd->client_count; i++) {
		int status = test_wait(clients[i]);

		if (status != 0)
			fail_msg("client %u ended with %d", i, status);
	}
	print_message("%llu payloads compared\n", (unsigned long long)crowd->reads);
	(void)munmap(crowd, sizeof(*crowd));
}

/* ---- a daemon of one's own ---- */

static int own_setup(void **state)
{
	struct scene *scene;
	char program[4096];

	(void)scene_setup(state);
	scene = *state;
	(void)snprintf(program, sizeof(program), "%s/oocd", getenv("OOCD_BIN"));
	(void)setenv("OOCD_SOCKET", scene->socket_path, 1);
	(void)setenv("OOCD_DAEMON", program, 1);
	return 0;
}

static int own_teardown(void **state)
{
	(void)unsetenv("OOCD_SOCKET");
	(void)unsetenv("OOCD_DAEMON");
	return scene_teardown(state);
}

/* Who listens at the other end. */
static pid_t daemon_of(const struct ooc_client *client)
{
	struct ucred credentials = { 0 };
	socklen_t length = sizeof(credentials);

	assert_int_equal(getsockopt(ooc_fd(client), SOL_SOCKET, SO_PEERCRED, &credentials, &length),
			 0);
	return credentials.pid;
}

/* The daemon is nobody's child, so its end is seen by pidfd. */
static void end_daemon(pid_t daemon)
{
	struct pollfd process = { .fd = (int)syscall(SYS_pidfd_open, daemon, 0), .events = POLLIN };

	assert_true(process.fd >= 0);
	assert_int_equal(kill(daemon, SIGKILL), 0);
	assert_int_equal(poll(&process, 1, 10000), 1);
	(void)fd_close(process.fd);
}

static void eight_programs_that_find_no_daemon_end_with_one(void **state)
{
	pid_t racers[RACER_COUNT];
	pid_t daemons[RACER_COUNT];
	int start_fds[2];
	int answer_fds[2];
	int go_on_fds[2];

	(void)state;
	assert_int_equal(pipe(start_fds) | pipe(answer_fds) | pipe(go_on_fds), 0);
	for (int i = 0; i < RACER_COUNT; i++) {
		racers[i] = test_fork();
		if (racers[i] == 0) {
			struct ooc_client *client = NULL;
			pid_t daemon = 0;
			char byte;

			(void)close(start_fds[1]);
			(void)close(go_on_fds[1]);
			/* All begin when the parent closes its end, and stay until all have answered. */
			(void)!read(start_fds[0], &byte, 1);
			if (ooc_connect(NULL, "racer", &client) == 0)
				daemon = daemon_of(client);
			else
				(void)fprintf(stderr, "%s\n", ooc_error_text(NULL));
			(void)!write(answer_fds[1], &daemon, sizeof(daemon));
			(void)!read(go_on_fds[0], &byte, 1);
			ooc_disconnect(client);
			_exit(0);
		}
	}
	(void)close(start_fds[1]);
	for (int i = 0; i < RACER_COUNT; i++)
		assert_int_equal(read(answer_fds[0], &daemons[i], sizeof(daemons[i])),
				 sizeof(daemons[i]));
	(void)close(go_on_fds[1]);
	for (int i = 0; i < RACER_COUNT; i++)
		assert_int_equal(test_wait(racers[i]), 0);
	assert_true(daemons[0] > 0);
	end_daemon(daemons[0]);
	for (int i = 1; i < RACER_COUNT; i++)
		assert_int_equal(daemons[i], daemons[0]);
	(void)close(start_fds[0]);
	(void)close(answer_fds[0]);
	(void)close(answer_fds[1]);
	(void)close(go_on_fds[0]);
}

static void a_daemon_of_ones_own_that_dies_is_started_again(void **state)
{
	struct scene *scene = *state;
	struct ooc_client *client;
	struct ooc_store *store;
	pid_t first;

	assert_int_equal(ooc_connect(NULL, "test", &client), 0);
	store = open_store(scene, client);
	(void)want_leaves(scene, client, store, 0, 1, 20);
	wait_complete(client);
	first = daemon_of(client);
	end_daemon(first);
	assert_int_equal(dispatch_until_away(client), -ENOTCONN);
	(void)want_leaves(scene, client, store, 100, 1, 20);
	wait_complete(client);
	assert_int_equal(verify_drawable(scene, store), 20);
	assert_int_not_equal(daemon_of(client), first);
	end_daemon(daemon_of(client));
	ooc_disconnect(client);
}

static void the_runtime_folder_is_where_a_daemon_is_started(void **state)
{
	struct scene *scene = *state;
	struct ooc_client *client;

	(void)unsetenv("OOCD_SOCKET");
	if (access("/run/oocd/oocd.sock", F_OK) == 0)
		skip();
	(void)setenv("XDG_RUNTIME_DIR", scene->folder, 1);
	assert_int_equal(ooc_connect(NULL, "test", &client), 0);
	assert_int_equal(access(test_path(scene->folder, "oocd.sock"), F_OK), 0);
	end_daemon(daemon_of(client));
	ooc_disconnect(client);
	/* Others could write there: then it is no place to look for a daemon of ours. */
	assert_int_equal(chmod(scene->folder, 0777), 0);
	assert_int_equal(ooc_connect(NULL, "test", &client), -EACCES);
	assert_non_null(strstr(ooc_error_text(NULL), scene->folder));
	(void)unsetenv("XDG_RUNTIME_DIR");
}

static void a_daemon_is_started_with_the_options_given(void **state)
{
	const char *const options[] = { "--cache-size", "7M", NULL };
	const char *const many[] = { "a", "b", "c", "d", "e", "f", "g", "h", "i",
				     "j", "k", "l", "m", "n", "o", "p", "q", NULL };
	struct ooc_client *client;
	struct ooc_counters counters;

	(void)state;
	assert_int_equal(ooc_connect_or_start(NULL, "test", many, &client), -E2BIG);
	assert_int_equal(ooc_connect_or_start(NULL, "test", options, &client), 0);
	/* The daemon's page has it from the greeting on. */
	ooc_counters(client, &counters);
	assert_int_equal(counters.cache_bytes, 7 << 20);
	end_daemon(daemon_of(client));
	ooc_disconnect(client);
}

static void a_daemon_that_cannot_be_started_is_named(void **state)
{
	struct scene *scene = *state;
	struct ooc_client *client;

	(void)setenv("OOCD_DAEMON", "/nonexistent/oocd", 1);
	assert_int_equal(ooc_connect(NULL, "test", &client), -ENOENT);
	assert_non_null(strstr(ooc_error_text(NULL), "/nonexistent/oocd"));
	(void)setenv("OOCD_DAEMON", "/bin/false", 1);
	assert_int_equal(ooc_connect(NULL, "test", &client), -ECONNREFUSED);
	assert_non_null(strstr(ooc_error_text(NULL), "ended at once"));
	/* A path that is given is where the caller knows a daemon to be: none is started. */
	assert_int_equal(ooc_connect(scene->socket_path, "test", &client), -ENOENT);
}

#define SCENE_TEST(test) cmocka_unit_test_setup_teardown(test, scene_setup, scene_teardown)
#define OWN_TEST(test)   cmocka_unit_test_setup_teardown(test, own_setup, own_teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		SCENE_TEST(every_payload_is_what_is_on_disk),
		SCENE_TEST(what_one_client_has_loaded_another_does_not_read),
		SCENE_TEST(a_prefetched_node_is_there_when_it_is_wanted),
		SCENE_TEST(a_killed_daemon_that_comes_back_is_found_and_holds_again),
		SCENE_TEST(more_than_fits_is_refused_with_a_reason_and_drawn_in_portions),
		SCENE_TEST(a_client_gives_way_to_another_users_by_itself),
		SCENE_TEST(a_client_that_keeps_drawing_gives_way_with_its_next_set),
		SCENE_TEST(a_crowd_in_a_tiny_cache_never_sees_a_wrong_byte_and_comes_back),
		OWN_TEST(eight_programs_that_find_no_daemon_end_with_one),
		OWN_TEST(a_daemon_of_ones_own_that_dies_is_started_again),
		OWN_TEST(the_runtime_folder_is_where_a_daemon_is_started),
		OWN_TEST(a_daemon_is_started_with_the_options_given),
		OWN_TEST(a_daemon_that_cannot_be_started_is_named),
	};

	return TEST_RUN(tests);
}
