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
#include "tests/helper.h"
#include "tests/integration/daemon_kit.h"

/* Users that nobody is; only root can become one. */
#define OTHER_UID 65533u

/* ---- users ---- */

/* Connects as another user.  Returns: was it welcome? */
static bool other_user_is_welcome(const struct kit_daemon *daemon)
{
	int status;
	pid_t pid;

	(void)fflush(NULL);
	pid = fork();
	assert_true(pid >= 0);
	if (pid == 0) {
		if (setresuid(OTHER_UID, OTHER_UID, OTHER_UID) < 0)
			_exit(1);
		kit_disconnect(kit_hello(daemon));
		_exit(0);
	}
	assert_int_equal(waitpid(pid, &status, 0), pid);
	return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

static void a_user_over_its_cap_is_told_so_and_another_still_connects(void **state)
{
	const struct account_policy policies[] = { { .uid = getuid(), .session_count_max = 20 } };
	struct server_config config = kit_config();
	struct kit_client *clients[20];
	struct kit_daemon daemon;

	config.policies = policies;
	config.policy_count = 1;
	kit_daemon_start(*state, &config, &daemon);
	for (uint32_t i = 0; i < ARRAY_LENGTH(clients); i++)
		clients[i] = kit_hello(&daemon);
	for (uint32_t i = 0; i < 200; i++) {
		struct kit_client *refused = kit_connect(&daemon);
		const struct wire_error *error = kit_receive(refused, WIRE_ERROR);

		assert_int_equal(error->error, -EAGAIN);
		assert_non_null(strstr(error->text, "has 20 clients connected already"));
		assert_null(strchr(error->text, '\n'));
		kit_disconnect(refused);
	}
	assert_int_equal(kit_status_number(clients[0], "sessions_refused"), 200);
	if (getuid() == 0) {
		assert_int_equal(chmod(*state, 0711), 0);
		assert_int_equal(chmod(daemon.socket_path, 0666), 0);
		assert_true(other_user_is_welcome(&daemon));
	}
	/* One that goes makes room for one. */
	kit_disconnect(clients[0]);
	kit_await_number(clients[1], "sessions", 19);
	clients[0] = kit_hello(&daemon);
	for (uint32_t i = 0; i < ARRAY_LENGTH(clients); i++)
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

int main(void)
{
#define SHARING_TEST(name)                                                                         \
	cmocka_unit_test_setup_teardown(name, test_folder_setup, test_folder_teardown)
	const struct CMUnitTest tests[] = {
		SHARING_TEST(a_user_over_its_cap_is_told_so_and_another_still_connects),
		SHARING_TEST(a_user_may_have_hundreds_of_clients),
	};

	return TEST_RUN(tests);
}
