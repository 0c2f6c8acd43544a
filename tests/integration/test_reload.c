/* SPDX-License-Identifier: MIT */
/*
 * Goal: a changed configuration is taken over while clients draw, without one failed request; a wrong
 * one changes nothing.
 * Method: the server in a process of its own, told by SIGHUP; a pipe says when it has read the file.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "daemon/config.h"
#include "formats/base/bytes.h"
#include "tests/helper.h"
#include "tests/integration/daemon_kit.h"

/* 64,000 boxes in 8,000 leaves of a page each; of 64 MiB, a segment has 4. */
#define GRID_COUNT 40u

/* ---- in the daemon ---- */

static const char *config_path;
static int read_pipe[2];
static struct config *config_read;
static struct config *config_taken;

static int reload(void *arg, struct server_config *ret, struct why *why)
{
	int r = config_load(config_path, NULL, 0, &config_read, why);

	(void)arg;
	if (r == 0)
		*ret = config_read->server;
	else
		(void)!write(read_pipe[1], "w", 1);
	return r;
}

static void reload_done(void *arg, bool taken)
{
	(void)arg;
	if (taken) {
		config_destroy(config_taken);
		config_taken = config_read;
	} else {
		config_destroy(config_read);
	}
	config_read = NULL;
	(void)!write(read_pipe[1], taken ? "t" : "r", 1);
}

/* ---- outside ---- */

static void start(const char *folder, struct kit_daemon *ret)
{
	struct server_config config = kit_config();

	config.reload = reload;
	config.reload_done = reload_done;
	config_path = test_path(folder, "oocd.conf");
	assert_int_equal(pipe2(read_pipe, O_CLOEXEC), 0);
	kit_daemon_start(folder, &config, ret);
}

static void end(struct kit_daemon *daemon)
{
	assert_int_equal(kit_daemon_stop(daemon, SIGTERM), 0);
	(void)close(read_pipe[0]);
	(void)close(read_pipe[1]);
}

/* Returns: 't' taken, 'w' wrong, 'r' refused; the daemon acts on it before it takes a message. */
static char reload_with(const struct kit_daemon *daemon, const char *format, ...)
{
	char text[1024];
	char byte = 0;
	va_list args;

	va_start(args, format);
	(void)vsnprintf(text, sizeof(text), format, args);
	va_end(args);
	test_file_write(config_path, text, strlen(text));
	assert_int_equal(kill(daemon->pid, SIGHUP), 0);
	assert_int_equal(read(read_pipe[0], &byte, 1), 1);
	return byte;
}

static uint32_t want_all(struct kit_client *client, uint32_t flags)
{
	uint32_t count = kit_want(client, 0, 0, KIT_ALL, flags);

	kit_settle(client);
	return count;
}

static void the_cache_grows_at_once_and_shrinks_as_holds_go(void **state)
{
	const char *store_path = test_path(*state, "grid.ooc");
	struct kit_daemon daemon;
	struct kit_client *client;
	struct kit_store *store;
	uint32_t count;

	test_store_grid(store_path, GRID_COUNT);
	start(*state, &daemon);
	client = kit_hello(&daemon);
	store = kit_open(client, 0, store_path);
	count = want_all(client, 0);
	assert_int_equal(kit_count_drawable(store), count);

	assert_int_equal(reload_with(&daemon, "cache-size = 96M\n"), 't');
	assert_int_equal(kit_status_number(client, "cache_bytes"), 96 * MIB);
	assert_int_equal(kit_count_drawable(store), count);

	/* What is held is revoked, not taken: it lies where it lay until the client lets go. */
	assert_int_equal(reload_with(&daemon, "cache-size = 8M\n"), 't');
	assert_true(kit_status_number(client, "cache_bytes") > 8 * MIB);
	assert_true(kit_count_drawable(store) < count);
	kit_set(client, NULL, 0, WIRE_SET_RETIRE);
	kit_settle(client);
	kit_await_number(client, "cache_bytes", 8 * MIB);
	assert_true(kit_status_number(client, "arena_bytes") <= 8 * MIB);

	/* And with that little, as much of the set as fits is drawable. */
	(void)want_all(client, WIRE_SET_RETIRE);
	assert_true(kit_count_drawable(store) > 0);
	assert_int_equal(reload_with(&daemon, "cache-size = 64M\n"), 't');
	(void)want_all(client, WIRE_SET_RETIRE);
	assert_int_equal(kit_count_drawable(store), count);
	kit_disconnect(client);
	end(&daemon);
}

static void stores_are_opened_and_no_longer_kept(void **state)
{
	const char *first = test_path(*state, "first.ooc");
	const char *second = test_path(*state, "second.ooc");
	struct kit_daemon daemon;
	struct kit_client *client;

	test_store_grid(first, 4);
	test_store_grid(second, 6);
	start(*state, &daemon);
	client = kit_hello(&daemon);
	assert_int_equal(reload_with(&daemon, "store = %s\nstore = %s\n", first, second), 't');
	kit_await_number(client, "store_count", 2);
	/* Named no longer, and closed at once when idle. */
	assert_int_equal(reload_with(&daemon, "store = %s\nidle-close = 0\n", second), 't');
	kit_await_number(client, "store_count", 1);
	kit_disconnect(client);
	end(&daemon);
}

static void a_wrong_file_changes_nothing(void **state)
{
	const char *store_path = test_path(*state, "grid.ooc");
	struct kit_daemon daemon;
	struct kit_client *client;
	struct kit_store *store;
	uint32_t count;

	test_store_grid(store_path, GRID_COUNT);
	start(*state, &daemon);
	client = kit_hello(&daemon);
	store = kit_open(client, 0, store_path);
	count = want_all(client, 0);
	assert_int_equal(reload_with(&daemon, "cache-size = 1M\nio = tape\n"), 'w');
	assert_int_equal(reload_with(&daemon, "cache-size = 1M\nstore = /nowhere.ooc\n"), 'r');
	assert_int_equal(reload_with(&daemon, "cache-size = 1000G\n"), 'r');
	assert_int_equal(reload_with(&daemon, "cache-size = 2M\n"), 'r');
	assert_int_equal(kit_status_number(client, "cache_bytes"), 64 * MIB);
	assert_int_equal(kit_count_drawable(store), count);
	kit_disconnect(client);
	end(&daemon);
}

int main(void)
{
#define FOLDER_TEST(test)                                                                          \
	cmocka_unit_test_setup_teardown(test, test_folder_setup, test_folder_teardown)
	const struct CMUnitTest tests[] = {
		FOLDER_TEST(the_cache_grows_at_once_and_shrinks_as_holds_go),
		FOLDER_TEST(stores_are_opened_and_no_longer_kept),
		FOLDER_TEST(a_wrong_file_changes_nothing),
	};

	return TEST_RUN(tests);
}
