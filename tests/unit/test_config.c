/* SPDX-License-Identifier: MIT */
/*
 * Goal: a configuration is taken as it is written, or refused with the line and what is allowed; the
 * command line wins over it; every key is documented.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/config.h"
#include "formats/base/bytes.h"
#include "tests/helper.h"

static int load(const char *folder, const char *text, struct config **ret, struct why *why)
{
	const char *path = test_path(folder, "oocd.conf");

	test_file_write(path, text, strlen(text));
	return config_load(path, NULL, 0, ret, why);
}

static void a_file_says_everything(void **state)
{
	struct config *config;
	struct why why;
	const struct server_config *server;

	assert_int_equal(load(*state,
			      "# a comment\n"
			      "\n"
			      "  cache-size=512M  \n"
			      "store = /srv/a b.ooc\n"
			      "store = /srv/c.ooc\n"
			      "queue-depth = 7\n"
			      "workers = 3\n"
			      "io = pread\n"
			      "idle-exit = 60\n"
			      "idle-close = 0\n"
			      "grace = 0.25\n"
			      "admin-group = root\n"
			      "verbose = yes\n"
			      "[user root]\n"
			      "weight = 200\n"
			      "share = 12.5%\n"
			      "[ user 4711 ]\n"
			      "clients = 5\n"
			      "prefetch-size = 1G",
			      &config, &why),
			 0);
	server = &config->server;
	assert_int_equal(server->cache_bytes, 512 * MIB);
	assert_int_equal(server->store_count, 2);
	assert_string_equal(server->stores[0], "/srv/a b.ooc");
	assert_string_equal(server->stores[1], "/srv/c.ooc");
	assert_int_equal(server->queue_depth, 7);
	assert_int_equal(server->worker_count, 3);
	assert_int_equal(server->fetch_kind, FETCH_PREAD);
	assert_int_equal(server->idle_exit_s, 60);
	assert_int_equal(server->idle_close_s, 0);
	assert_int_equal(server->grace_ms, 250);
	assert_true(config->verbose);
	assert_int_equal(server->policy_count, 2);
	assert_int_equal(server->policies[0].uid, 0);
	assert_int_equal(server->policies[0].weight, 200);
	assert_int_equal(server->policies[0].share_permille, 125);
	assert_int_equal(server->policies[1].uid, 4711);
	assert_int_equal(server->policies[1].session_count_max, 5);
	assert_int_equal(server->policies[1].prefetch_bytes_max, GIB);
	config_destroy(config);
}

static void a_fault_is_named_with_its_line_and_what_is_allowed(void **state)
{
	static const struct {
		const char *text;
		const char *says;
	} cases[] = {
		{ "cache-size = lots", ":1: cache-size = lots: not a size from 1.0 MiB to" },
		{ "cache-size = 1K", "not a size from" },
		{ "\n\nqueue-depth = 0\n", ":3: queue-depth = 0: not a number from 1 to 256" },
		{ "grace = long", "grace = long: not seconds from 0 to 3600" },
		{ "workers = many", "not a number from 1 to 64" },
		{ "io = tape", "io = tape: not uring, pread or auto" },
		{ "verbose = maybe", "not yes or no" },
		{ "admin-group = no-such-group", "no group of that name" },
		{ "store = plant.ooc", "not a path that begins with /" },
		{ "cache-size =", "no value" },
		{ "cache-size", ":1: cache-size: not of the form key = value" },
		{ "cache_size = 1G", "cache_size: no such key; there are socket, cache-size, " },
		{ "weight = 100", "weight: no such key; there are" },
		{ "workers = 2\nworkers = 3", ":2: workers: said already in line 1" },
		{ "[user", "not a section, as [user NAME]" },
		{ "[group a]", "not a section that there is" },
		{ "[user no-such-user]", "[user no-such-user]: no user of that name" },
		{ "[user root]\n[user 0]\n", ":2: [user 0]: user 0 has a section already" },
		{ "[user 0]\ncache-size = 1G", "no such key of a user; there are weight, share" },
		{ "[user 0]\nshare = 12", "not a share from 0% to 100%, as 25%" },
		{ "[user 0]\nshare = 120%", "not a share from 0% to 100%" },
		{ "[user 0]\nweight = 0", "not a number from 1 to 10000" },
		{ "[user 0]\nshare = 60%\n[user 1]\nshare=50%", "110.0% together: at most 100%" },
	};

	for (size_t i = 0; i < ARRAY_LENGTH(cases); i++) {
		struct config *config = NULL;
		struct why why;

		assert_int_equal(load(*state, cases[i].text, &config, &why), -EBADMSG);
		assert_null(config);
		if (!strstr(why.text, cases[i].says) || !strstr(why.text, "oocd.conf"))
			fail_msg("not \"%s\" but \"%s\"", cases[i].says, why.text);
		assert_null(strchr(why.text, '\n'));
	}
}

static void a_file_that_is_not_there_or_endless_is_refused(void **state)
{
	struct config *config = NULL;
	struct why why;
	char line[5000];

	assert_int_equal(config_load("/nowhere/oocd.conf", NULL, 0, &config, &why), -ENOENT);
	assert_int_equal(config_load("/dev/zero", NULL, 0, &config, &why), -E2BIG);
	memset(line, '#', sizeof(line));
	line[sizeof(line) - 1] = '\0';
	assert_int_equal(load(*state, line, &config, &why), -EBADMSG);
	assert_non_null(strstr(why.text, "longer than"));
	assert_null(config);
}

static void options_win_over_the_file_and_add_stores(void **state)
{
	static const struct config_option options[] = {
		{ "cache-size", "64M" },
		{ "store", "b.ooc" },
	};
	static const struct config_option wrong[] = { { "io", "tape" } };
	const char *path = test_path(*state, "oocd.conf");
	const char *text = "cache-size = 1G\nworkers = 3\nstore = /a.ooc\n";
	struct config *config;
	struct why why;

	test_file_write(path, text, strlen(text));
	assert_int_equal(config_load(path, options, 2, &config, &why), 0);
	assert_int_equal(config->server.cache_bytes, 64 * MIB);
	assert_int_equal(config->server.worker_count, 3);
	assert_int_equal(config->server.store_count, 2);
	assert_string_equal(config->server.stores[1], "b.ooc");
	config_destroy(config);
	assert_int_equal(config_load(path, wrong, 1, &config, &why), -EINVAL);
	assert_string_equal(why.text, "--io tape: not uring, pread or auto");
}

/* Its comments taken away from the keys, the example is right, too. */
static void the_example_and_the_manual_have_every_key(void **state)
{
	static const char *const keys[] = { "cache-size",  "store",   "idle-close",  "idle-exit",
					    "grace",       "workers", "queue-depth", "io",
					    "admin-group", "verbose", "weight",      "share" };
	char path[512];
	size_t bytes;
	char *example;
	char *manual;
	char *lines;
	char *at;
	size_t length = 0;
	struct config *config = NULL;
	struct why why;

	(void)snprintf(path, sizeof(path), "%s/daemon/oocd.conf", getenv("OOCD_SOURCE"));
	assert_int_equal(config_load(path, NULL, 0, &config, &why), 0);
	config_destroy(config);
	example = test_file_read(path, &bytes);
	example = realloc(example, bytes + 1);
	example[bytes] = '\0';
	(void)snprintf(path, sizeof(path), "%s/daemon/oocd.conf.5", getenv("OOCD_SOURCE"));
	manual = test_file_read(path, &bytes);
	manual = realloc(manual, bytes + 1);
	manual[bytes] = '\0';
	lines = calloc(1, strlen(example) + 1);
	for (at = strtok(example, "\n"); at; at = strtok(NULL, "\n")) {
		if (at[0] == '#' && at[1] != ' ' && at[1] != '\0')
			length += (size_t)sprintf(lines + length, "%s\n", at + 1);
	}
	for (size_t i = 0; i < ARRAY_LENGTH(keys); i++) {
		char in_manual[64] = "";

		for (const char *from = keys[i]; *from; from++)
			(void)sprintf(in_manual + strlen(in_manual), *from == '-' ? "\\-" : "%c",
				      *from);
		if (!strstr(manual, in_manual))
			fail_msg("oocd.conf.5 does not say %s", keys[i]);
		if (!strstr(lines, keys[i]))
			fail_msg("oocd.conf does not show %s", keys[i]);
	}
	at = strstr(lines, "alice");
	assert_non_null(at);
	memcpy(at, "root ", 5);
	at = strstr(lines, "admin-group = oocd");
	assert_non_null(at);
	memcpy(at, "admin-group = root", 18);
	if (load(*state, lines, &config, &why) < 0)
		fail_msg("%s", why.text);
	config_destroy(config);
	free(lines);
	free(manual);
	free(example);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(a_file_says_everything, test_folder_setup,
						test_folder_teardown),
		cmocka_unit_test_setup_teardown(a_fault_is_named_with_its_line_and_what_is_allowed,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(a_file_that_is_not_there_or_endless_is_refused,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(options_win_over_the_file_and_add_stores,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(the_example_and_the_manual_have_every_key,
						test_folder_setup, test_folder_teardown),
	};

	return TEST_RUN(tests);
}
