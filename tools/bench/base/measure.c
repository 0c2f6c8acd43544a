/* SPDX-License-Identifier: MIT */
#include "tools/bench/base/measure.h"

#include <errno.h>
#include <fcntl.h>
#include <ftw.h>
#include <math.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/base/clock.h"
#include "formats/base/file.h"
#include "formats/base/text.h"

/** How long a daemon may take until it answers. */
#define DAEMON_START_NS  (10 * NS_PER_S)
#define OUTPUT_BYTES_MAX (64u << 20)

static volatile sig_atomic_t was_cancelled;

/* ---- other programs ---- */

void measure_program(const char *name, char ret[PATH_MAX])
{
	ssize_t length = readlink("/proc/self/exe", ret, PATH_MAX - 1);
	char *slash;

	ret[length > 0 ? length : 0] = '\0';
	slash = strrchr(ret, '/');
	if (slash && strlen(name) + (size_t)(slash - ret) + 2 <= PATH_MAX) {
		strcpy(slash + 1, name);
		if (access(ret, X_OK) == 0)
			return;
	}
	(void)snprintf(ret, PATH_MAX, "%s", name);
}

bool measure_has_program(const char *name)
{
	const char *folders = getenv("PATH");
	char path[PATH_MAX];

	while (folders && *folders) {
		size_t length = strcspn(folders, ":");

		(void)snprintf(path, sizeof(path), "%.*s/%s", (int)length, folders, name);
		if (access(path, X_OK) == 0)
			return true;
		folders += length + (folders[length] == ':');
	}
	return false;
}

static void on_signal(int number)
{
	(void)number;
	was_cancelled = 1;
}

void measure_catch_signals(void)
{
	/* Without SA_RESTART: waiting ends. */
	struct sigaction action = { .sa_handler = on_signal };

	(void)sigaction(SIGINT, &action, NULL);
	(void)sigaction(SIGTERM, &action, NULL);
}

bool measure_was_cancelled(void)
{
	return was_cancelled != 0;
}

static _Noreturn void child_execute(const char *const *argv, int output_fd, int error_fd)
{
	int error;

	(void)prctl(PR_SET_PDEATHSIG, SIGTERM);
	if (dup2(output_fd, STDOUT_FILENO) >= 0)
		execvp(argv[0], (char *const *)(uintptr_t)argv);
	error = errno;
	(void)!write(error_fd, &error, sizeof(error));
	_exit(127);
}

int measure_start(const char *const *argv, struct measure_child *ret, struct why *why)
{
	AUTO_FD output_fd = memfd_create("output", MFD_CLOEXEC);
	AUTO_FD error_read = -1;
	AUTO_FD error_write = -1;
	int pipe_fds[2];
	int error;
	pid_t pid;

	*ret = (struct measure_child){ .output_fd = -1 };
	if (output_fd < 0 || pipe2(pipe_fds, O_CLOEXEC) < 0)
		return why_errno(why, -errno, "%s cannot be started", argv[0]);
	error_read = pipe_fds[0];
	error_write = pipe_fds[1];
	ret->begin_ns = clock_now_ns();
	pid = fork();
	if (pid < 0)
		return why_errno(why, -errno, "%s cannot be started", argv[0]);
	if (pid == 0)
		child_execute(argv, output_fd, error_write);
	error_write = fd_close(error_write);
	/* The pipe closes without a byte when the program runs. */
	if (read(error_read, &error, sizeof(error)) == sizeof(error)) {
		(void)waitpid(pid, NULL, 0);
		return why_errno(why, -error, "%s cannot be started", argv[0]);
	}
	ret->pid = pid;
	ret->output_fd = output_fd;
	output_fd = -1;
	return 0;
}

static char *output_read(int fd)
{
	struct stat status;
	char *text;
	size_t size;

	if (fstat(fd, &status) < 0 || status.st_size > OUTPUT_BYTES_MAX)
		return NULL;
	size = (size_t)status.st_size;
	text = malloc(size + 1);
	if (!text || file_read_at(fd, text, size, 0) < 0) {
		free(text);
		return NULL;
	}
	text[size] = '\0';
	return text;
}

static double timeval_seconds(struct timeval time)
{
	return (double)time.tv_sec + 1e-6 * (double)time.tv_usec;
}

int measure_finish(struct measure_child *child, struct measure_result *ret, struct why *why)
{
	struct rusage usage;
	int status;
	uint64_t end_ns;

	while (wait4(child->pid, &status, 0, &usage) < 0) {
		if (errno == EINTR && !measure_was_cancelled())
			continue;
		measure_stop(child);
		return why_set(why, -ECANCELED, "interrupted");
	}
	end_ns = clock_now_ns();
	child->pid = 0;
	ret->output = output_read(child->output_fd);
	child->output_fd = fd_close(child->output_fd);
	if (measure_was_cancelled() || !ret->output || !WIFEXITED(status) ||
	    WEXITSTATUS(status) != 0) {
		free(ret->output);
		if (measure_was_cancelled())
			return why_set(why, -ECANCELED, "interrupted");
		if (WIFEXITED(status) && WEXITSTATUS(status) == 0)
			return why_set(why, -ENOMEM, "what it said cannot be read");
		if (WIFSIGNALED(status))
			return why_set(why, -ECHILD, "it was ended by signal %d", WTERMSIG(status));
		return why_set(why, -ECHILD, "it failed with exit status %d; see its message above",
			       WEXITSTATUS(status));
	}
	ret->seconds = (double)(end_ns - child->begin_ns) / (double)NS_PER_S;
	ret->cpu_seconds = timeval_seconds(usage.ru_utime) + timeval_seconds(usage.ru_stime);
	ret->peak_rss_bytes = (uint64_t)usage.ru_maxrss << 10;
	return 0;
}

void measure_result_done(struct measure_result *result)
{
	free(result->output);
	result->output = NULL;
}

int measure_run(const char *const *argv, struct measure_result *ret, struct why *why)
{
	struct measure_child child;
	int r = measure_start(argv, &child, why);

	if (r == 0) {
		r = measure_finish(&child, ret, why);
		if (r < 0)
			why_prefix(why, "%s", argv[0]);
	}
	return r;
}

void measure_stop(struct measure_child *child)
{
	if (child->pid > 0) {
		(void)kill(child->pid, SIGTERM);
		while (waitpid(child->pid, NULL, 0) < 0 && errno == EINTR) {
		}
		child->pid = 0;
	}
	child->output_fd = fd_close(child->output_fd);
}

int measure_json_number(const char *json, const char *key, double *ret)
{
	char quoted[128];
	const char *at;
	char *end;

	(void)snprintf(quoted, sizeof(quoted), "\"%s\"", key);
	at = strstr(json, quoted);
	if (!at)
		return -ENOENT;
	at += strlen(quoted);
	at += strspn(at, " \t\r\n:");
	*ret = strtod(at, &end);
	return end == at ? -ENOENT : 0;
}

/* ---- our daemon ---- */

static bool answers(const char *socket_path)
{
	struct sockaddr_un address = { .sun_family = AF_UNIX };
	AUTO_FD fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);

	if (fd < 0 || strlen(socket_path) >= sizeof(address.sun_path))
		return false;
	strcpy(address.sun_path, socket_path);
	return connect(fd, (const struct sockaddr *)&address, sizeof(address)) == 0;
}

int measure_daemon_start_with(const char *scratch, const char *const *options,
			      struct measure_daemon *ret, struct why *why)
{
	char program[PATH_MAX];
	const char *argv[MEASURE_DAEMON_OPTION_COUNT_MAX + 4] = { program, "--socket",
								  ret->socket_path };
	uint64_t deadline_ns = clock_now_ns() + DAEMON_START_NS;
	size_t count = 3;
	int r;

	measure_program("oocd", program);
	if (snprintf(ret->socket_path, sizeof(ret->socket_path), "%s/oocd.sock", scratch) >=
	    (int)sizeof(((struct sockaddr_un *)NULL)->sun_path))
		return why_set(why, -ENAMETOOLONG, "%s: too long a folder for a socket; set TMPDIR",
			       scratch);
	for (; *options; options++) {
		CHECK(count < ARRAY_LENGTH(argv) - 1);
		argv[count++] = *options;
	}
	r = measure_start(argv, &ret->child, why);
	while (r == 0 && !answers(ret->socket_path)) {
		if (waitpid(ret->child.pid, NULL, WNOHANG) == ret->child.pid) {
			ret->child.pid = 0;
			r = why_set(why, -ECHILD, "oocd ended before it answered");
		} else if (measure_was_cancelled()) {
			r = why_set(why, -ECANCELED, "interrupted");
		} else if (clock_now_ns() > deadline_ns) {
			r = why_set(why, -ETIMEDOUT, "oocd does not answer on %s",
				    ret->socket_path);
		} else {
			clock_pause_ns(2 * NS_PER_MS);
		}
		if (r < 0)
			measure_stop(&ret->child);
	}
	return r;
}

int measure_daemon_start(const char *scratch, uint64_t cache_bytes, unsigned queue_depth,
			 struct measure_daemon *ret, struct why *why)
{
	char cache[32];
	char depth[16];
	const char *options[] = { "--cache-size", cache, "--queue-depth", depth, NULL };

	(void)snprintf(cache, sizeof(cache), "%llu", (unsigned long long)cache_bytes);
	(void)snprintf(depth, sizeof(depth), "%u", queue_depth);
	/* Without a depth of our own its default is what we want. */
	if (queue_depth == 0)
		options[2] = NULL;
	return measure_daemon_start_with(scratch, options, ret, why);
}

void measure_daemon_stop(struct measure_daemon *daemon)
{
	measure_stop(&daemon->child);
	(void)unlink(daemon->socket_path);
}

int measure_cpu_seconds(pid_t pid, double *ret)
{
	struct timespec time;
	clockid_t clock;
	int r = clock_getcpuclockid(pid, &clock);

	/* Of another process; to the nanosecond, where /proc/PID/stat counts hundredths of a second. */
	if (r != 0)
		return -r;
	if (clock_gettime(clock, &time) < 0)
		return -errno;
	*ret = (double)time.tv_sec + (double)time.tv_nsec / (double)NS_PER_S;
	return 0;
}

/* ---- scratch ---- */

int measure_scratch_make(const char *parent, char ret[PATH_MAX], struct why *why)
{
	if (!parent)
		parent = getenv("TMPDIR");
	if (!parent || !*parent)
		parent = "/var/tmp";
	if (snprintf(ret, PATH_MAX, "%s/oocbench-XXXXXX", parent) >= PATH_MAX)
		return why_set(why, -ENAMETOOLONG, "%.100s...: too long a path", parent);
	if (!mkdtemp(ret))
		return why_errno(why, -errno, "%s: no folder can be made there", parent);
	return 0;
}

static int remove_one(const char *path, const struct stat *status, int kind, struct FTW *ftw)
{
	(void)status;
	(void)kind;
	(void)ftw;
	return remove(path);
}

void measure_scratch_remove(const char *folder)
{
	(void)nftw(folder, remove_one, 16, FTW_DEPTH | FTW_PHYS);
}
