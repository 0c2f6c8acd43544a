/* SPDX-License-Identifier: MIT */
/*
 * Goal: oocd as a program: its command line, its socket, its end, and what it does without.
 * Method: the program itself; and the server in a process that was denied something.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <fcntl.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <poll.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/un.h>
#include <unistd.h>

#include "daemon/server/memory.h"
#include "formats/base/bytes.h"
#include "tests/helper.h"
#include "tests/integration/daemon_kit.h"

#define ARGUMENTS_MAX 12

/* ---- the program ---- */

struct program {
	pid_t pid;
	int output_fd; /* both streams */
};

static void program_start(struct program *program, const char *const *arguments)
{
	const char *argv[ARGUMENTS_MAX + 2] = { "oocd" };
	const char *bin = getenv("OOCD_BIN");
	char path[512];
	int pipes[2];

	assert_non_null(bin);
	(void)snprintf(path, sizeof(path), "%s/oocd", bin);
	for (uint32_t i = 0; arguments[i]; i++)
		argv[i + 1] = arguments[i];
	assert_int_equal(pipe2(pipes, O_CLOEXEC), 0);
	program->pid = test_fork();
	if (program->pid == 0) {
		(void)dup2(pipes[1], STDOUT_FILENO);
		(void)dup2(pipes[1], STDERR_FILENO);
		(void)execv(path, (char *const *)(uintptr_t)argv);
		_exit(127);
	}
	(void)close(pipes[1]);
	program->output_fd = pipes[0];
}

/* Waits for its end.  Returns: its exit status; *ret_text is what it said, for free(). */
static int program_end(struct program *program, char **ret_text)
{
	char buffer[4096];
	size_t text_bytes;
	FILE *out = open_memstream(ret_text, &text_bytes);
	ssize_t n;

	while ((n = read(program->output_fd, buffer, sizeof(buffer))) > 0)
		(void)fwrite(buffer, 1, (size_t)n, out);
	(void)fclose(out);
	(void)close(program->output_fd);
	return test_wait(program->pid);
}

static void check_says(const char *const *arguments, int status, const char *text)
{
	struct program program;
	char *said;

	program_start(&program, arguments);
	assert_int_equal(program_end(&program, &said), status);
	if (!strstr(said, text))
		fail_msg("not \"%s\" but \"%s\"", text, said);
	if (status == 1)
		assert_ptr_equal(strchr(said, '\n'), said + strlen(said) - 1);
	free(said);
}

#define CHECK_SAYS(status, text, ...)                                                              \
	check_says((const char *const[]){ __VA_ARGS__, NULL }, status, text)

static void wrong_use_says_what_is_wrong(void **state)
{
	const char *socket_path = test_path(*state, "s");

	CHECK_SAYS(0, "Examples:", "--help");
	CHECK_SAYS(0, "oocd " OOCD_VERSION, "--version");
	CHECK_SAYS(2, "--cache-size lots: not a size", "--cache-size", "lots");
	CHECK_SAYS(2, "--cache-size 1K: not a size", "--cache-size", "1K");
	CHECK_SAYS(2, "--queue-depth 0: not a number", "--queue-depth", "0");
	CHECK_SAYS(2, "--io tape: not uring, pread or auto", "--io", "tape");
	CHECK_SAYS(2, "--help", "--no-such-option");
	CHECK_SAYS(1, "cannot be had", "--socket", socket_path, "--cache-size", "900G");
	CHECK_SAYS(1, "No such file", "--socket", socket_path, "/nowhere/there.ooc");
	CHECK_SAYS(1, "cannot be made", "--socket", "/nowhere/there/oocd.sock");
	assert_string_equal(test_folder_list(*state), "");
}

static void a_store_that_is_none_ends_the_start(void **state)
{
	const char *path = test_path(*state, "a.ooc");

	test_file_write(path, "OOCSTORE and no more", 20);
	CHECK_SAYS(1, path, "--socket", test_path(*state, "s"), path);
	test_file_write(path, "", 0);
	CHECK_SAYS(1, path, "--socket", test_path(*state, "s"), path);
	CHECK_SAYS(1, "not a regular file", "--socket", test_path(*state, "s"), (char *)*state);
	assert_string_equal(test_folder_list(*state), "a.ooc ");
}

static bool can_connect(const char *path)
{
	struct sockaddr_un address = { .sun_family = AF_UNIX };
	int fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);
	bool connected;

	(void)snprintf(address.sun_path, sizeof(address.sun_path), "%s", path);
	connected = connect(fd, (struct sockaddr *)&address, sizeof(address)) == 0;
	(void)close(fd);
	return connected;
}

/* --verbose says when it serves; that line is the event to wait for. */
static void program_await_serving(const struct program *program)
{
	char buffer[512];
	ssize_t n = read(program->output_fd, buffer, sizeof(buffer) - 1);

	assert_true(n > 0);
	buffer[n] = '\0';
	if (!strstr(buffer, "serving on"))
		fail_msg("%s", buffer);
}

static void one_socket_has_one_daemon_and_is_gone_after_it(void **state)
{
	const char *socket_path = test_path(*state, "new folder/oocd.sock");
	struct program program;
	char *said;

	program_start(&program, (const char *const[]){ "--socket", socket_path, "--cache-size",
						       "8M", "--verbose", NULL });
	program_await_serving(&program);
	assert_true(can_connect(socket_path));
	CHECK_SAYS(1, "another oocd serves there", "--socket", socket_path, "--cache-size", "8M");
	assert_true(can_connect(socket_path));
	assert_int_equal(kill(program.pid, SIGTERM), 0);
	assert_int_equal(program_end(&program, &said), 0);
	free(said);
	assert_string_equal(test_folder_list(test_path(*state, "new folder")), "");
}

static void an_old_socket_file_is_replaced(void **state)
{
	const char *socket_path = test_path(*state, "oocd.sock");
	struct program program;
	char *said;

	program_start(&program, (const char *const[]){ "--socket", socket_path, "--cache-size",
						       "8M", "--verbose", NULL });
	program_await_serving(&program);
	assert_int_equal(kill(program.pid, SIGKILL), 0);
	assert_int_equal(test_wait(program.pid), -SIGKILL);
	(void)close(program.output_fd);
	assert_string_equal(test_folder_list(*state), "oocd.sock oocd.sock.lock ");
	program_start(&program, (const char *const[]){ "--socket", socket_path, "--cache-size",
						       "8M", "--verbose", NULL });
	program_await_serving(&program);
	assert_true(can_connect(socket_path));
	assert_int_equal(kill(program.pid, SIGINT), 0);
	assert_int_equal(program_end(&program, &said), 0);
	free(said);
	assert_string_equal(test_folder_list(*state), "");
}

static void a_file_that_is_no_socket_is_not_touched(void **state)
{
	const char *path = test_path(*state, "precious");

	test_file_write(path, "data", 4);
	CHECK_SAYS(1, "is no socket", "--socket", path, "--cache-size", "8M");
	assert_string_equal(test_folder_list(*state), "precious ");
}

static void an_idle_daemon_ends_when_asked_to(void **state)
{
	const char *socket_path = test_path(*state, "oocd.sock");
	struct program program;
	char *said;

	program_start(&program, (const char *const[]){ "--socket", socket_path, "--cache-size",
						       "8M", "--idle-exit", "1", NULL });
	assert_int_equal(program_end(&program, &said), 0);
	assert_string_equal(said, "");
	free(said);
	assert_string_equal(test_folder_list(*state), "");
}

static void a_handed_socket_is_served(void **state)
{
	const char *bin = getenv("OOCD_BIN");
	struct sockaddr_un address = { .sun_family = AF_UNIX };
	struct kit_daemon daemon;
	struct kit_client *client;
	char path[512];
	int fd;

	(void)snprintf(path, sizeof(path), "%s/oocd", bin);
	(void)snprintf(address.sun_path, sizeof(address.sun_path), "%s", test_path(*state, "s"));
	(void)snprintf(daemon.socket_path, sizeof(daemon.socket_path), "%s", address.sun_path);
	fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);
	assert_int_equal(bind(fd, (struct sockaddr *)&address, sizeof(address)), 0);
	assert_int_equal(listen(fd, 8), 0);
	daemon.pid = test_fork();
	if (daemon.pid == 0) {
		char pid[16];

		(void)snprintf(pid, sizeof(pid), "%d", (int)getpid());
		(void)setenv("LISTEN_PID", pid, 1);
		(void)setenv("LISTEN_FDS", "1", 1);
		if (fd != 3)
			(void)dup2(fd, 3);
		else
			(void)fcntl(fd, F_SETFD, 0);
		(void)execl(path, "oocd", "--cache-size", "8M", (char *)NULL);
		_exit(127);
	}
	(void)close(fd);
	client = kit_hello(&daemon);
	kit_disconnect(client);
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
	/* Whoever made the socket removes it. */
	assert_string_equal(test_folder_list(*state), "s ");
}

/* ---- without ---- */

static void deny_io_uring(void)
{
	struct sock_filter filter[] = {
		BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr)),
		BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_io_uring_setup, 0, 1),
		BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EPERM),
		BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
	};
	struct sock_fprog program = { ARRAY_LENGTH(filter), filter };

	if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) < 0 ||
	    prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) < 0)
		_exit(77);
}

/* The limit of locked memory does not hold for root. */
static void lock_no_memory(void)
{
	struct rlimit none = { 0, 0 };

	if (setrlimit(RLIMIT_MEMLOCK, &none) < 0 || setgid(65534) < 0 || setuid(65534) < 0)
		_exit(77);
}

static void check_without(const char *folder, void (*prepare)(void), const char *named)
{
	const struct test_grid grid = { .count = 12, .face_quads = 4 };
	const char *path = test_path(folder, "a.ooc");
	struct server_config config = kit_config();
	struct kit_daemon daemon;
	struct kit_client *client;
	struct kit_store *store;
	char *status;
	uint32_t count;

	test_store_grid_make(path, &grid);
	assert_int_equal(chmod(folder, 0777), 0);
	kit_daemon_start_prepared(folder, &config, prepare, &daemon);
	client = kit_hello(&daemon);
	store = kit_open(client, 0, path);
	count = kit_want(client, 0, 0, KIT_ALL, WIRE_SET_RETIRE);
	kit_settle(client);
	assert_int_equal(kit_count_drawable(store), count);
	status = kit_status(client);
	if (!strstr(strstr(status, "\"degraded\""), named))
		fail_msg("not \"%s\" in %s", named, status);
	free(status);
	kit_disconnect(client);
	assert_int_equal(kit_daemon_stop(&daemon, SIGTERM), 0);
}

static void without_io_uring_threads_read_and_the_status_says_so(void **state)
{
	check_without(*state, deny_io_uring, "kernel.io_uring_disabled");
}

static void without_lockable_memory_plain_reads_do_and_the_status_says_so(void **state)
{
	if (getuid() != 0) {
		print_message("not root: the user cannot be changed\n");
		skip();
	}
	check_without(*state, lock_no_memory, "LimitMEMLOCK");
}

/* ---- memory ---- */

static void memory_is_the_least_of_machine_and_groups(void **state)
{
	static const char *const folders[] = { "proc",
					       "proc/self",
					       "sys",
					       "sys/fs",
					       "sys/fs/cgroup",
					       "sys/fs/cgroup/a",
					       "sys/fs/cgroup/a/b" };
	static const struct {
		const char *path;
		const char *text;
	} files[] = {
		{ "proc/meminfo", "MemTotal: 4000 kB\nMemAvailable:    3000 kB\n" },
		{ "proc/self/cgroup", "0::/a/b\n" },
		{ "sys/fs/cgroup/a/memory.max", "2097152\n" },
		{ "sys/fs/cgroup/a/memory.current", "1048576\n" },
		{ "sys/fs/cgroup/a/b/memory.max", "max\n" },
	};
	struct memory memory;

	memory_read_below(*state, &memory);
	assert_true(memory.bytes == UINT64_MAX);
	for (size_t i = 0; i < ARRAY_LENGTH(folders); i++)
		assert_int_equal(mkdir(test_path(*state, folders[i]), 0700), 0);
	for (size_t i = 0; i < ARRAY_LENGTH(files); i++)
		test_file_write(test_path(*state, files[i].path), files[i].text,
				strlen(files[i].text));
	memory_read_below(*state, &memory);
	assert_int_equal(memory.bytes, MIB);
	assert_string_equal(memory.limited_by, "memory.max of /a");
	test_file_write(test_path(*state, "proc/meminfo"), "MemAvailable: 9 kB\n", 19);
	memory_read_below(*state, &memory);
	assert_int_equal(memory.bytes, 9 * KIB);
	assert_string_equal(memory.limited_by, "available memory");
}

int main(void)
{
#define PROGRAM_TEST(test)                                                                         \
	cmocka_unit_test_setup_teardown(test, test_folder_setup, test_folder_teardown)
	const struct CMUnitTest tests[] = {
		PROGRAM_TEST(wrong_use_says_what_is_wrong),
		PROGRAM_TEST(a_store_that_is_none_ends_the_start),
		PROGRAM_TEST(one_socket_has_one_daemon_and_is_gone_after_it),
		PROGRAM_TEST(an_old_socket_file_is_replaced),
		PROGRAM_TEST(a_file_that_is_no_socket_is_not_touched),
		PROGRAM_TEST(an_idle_daemon_ends_when_asked_to),
		PROGRAM_TEST(a_handed_socket_is_served),
		PROGRAM_TEST(without_io_uring_threads_read_and_the_status_says_so),
		PROGRAM_TEST(without_lockable_memory_plain_reads_do_and_the_status_says_so),
		PROGRAM_TEST(memory_is_the_least_of_machine_and_groups),
	};

	return TEST_RUN(tests);
}
