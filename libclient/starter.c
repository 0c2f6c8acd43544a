/* SPDX-License-Identifier: MIT */
#include "libclient/starter.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "formats/base/file.h"

/* Debian 12's kernel headers have it; its libc's headers do not. */
#ifndef CLOSE_RANGE_CLOEXEC
#define CLOSE_RANGE_CLOEXEC (1u << 2)
#endif

#define PROGRAM           "oocd"
#define IDLE_EXIT_SECONDS "60"

void starter_init(struct starter *starter, const char *const *options)
{
	*starter = (struct starter){ .options = options, .lock_fd = -1, .process_fd = -1 };
}

void starter_done(struct starter *starter)
{
	starter->lock_fd = fd_close(starter->lock_fd);
	starter->process_fd = fd_close(starter->process_fd);
}

/* "/run/user/7" of "/run/user/7/oocd.sock". */
static void folder_of(const char *path, char ret[PATH_MAX])
{
	const char *slash = strrchr(path, '/');

	(void)snprintf(ret, PATH_MAX, "%.*s", (int)(slash - path), path);
	if (ret[0] == '\0')
		(void)snprintf(ret, PATH_MAX, "/");
}

int starter_check_folder(const char *socket_path, struct why *why)
{
	char folder[PATH_MAX];
	struct stat status;

	folder_of(socket_path, folder);
	/* lstat: a link that someone else placed could be turned elsewhere after this look. */
	if (lstat(folder, &status) < 0)
		return 0;
	if (!S_ISDIR(status.st_mode) || status.st_uid != geteuid() ||
	    (status.st_mode & (S_IWGRP | S_IWOTH)))
		return why_set(why, -EACCES,
			       "%s is not a folder that only this user can write to: remove it, or "
			       "name a socket with $OOCD_SOCKET",
			       folder);
	return 0;
}

static int take_lock(const char *socket_path, struct why *why)
{
	char folder[PATH_MAX];
	char path[PATH_MAX];
	int fd;
	int r;

	folder_of(socket_path, folder);
	if (mkdir(folder, 0700) < 0 && errno != EEXIST)
		return why_errno(why, -errno, "cannot make the folder %s for the daemon's socket",
				 folder);
	r = starter_check_folder(socket_path, why);
	if (r < 0)
		return r;

	/* Not the daemon's own lock ("SOCKET.lock"): the daemon that is started has to get that one. */
	(void)snprintf(path, sizeof(path), "%s.starting", socket_path);
	fd = open(path, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
	if (fd < 0)
		return why_errno(why, -errno, "cannot make %s, the lock for starting a daemon",
				 path);
	if (flock(fd, LOCK_EX | LOCK_NB) < 0) {
		r = -errno;
		(void)fd_close(fd);
		return r == -EWOULDBLOCK ? -EAGAIN : why_errno(why, r, "cannot lock %s", path);
	}
	return fd;
}

/* The program, in this order: $OOCD_DAEMON, beside the running program, in $PATH. */
static int find_program(char ret[PATH_MAX], struct why *why)
{
	const char *wanted = getenv("OOCD_DAEMON");
	const char *folders = getenv("PATH");
	ssize_t length;

	if (wanted && wanted[0]) {
		/* Absolute: the daemon leaves this folder before it is executed. */
		if (realpath(wanted, ret) && access(ret, X_OK) == 0)
			return 0;
		return why_errno(why, -errno, "cannot start $OOCD_DAEMON, %s", wanted);
	}
	length = readlink("/proc/self/exe", ret, PATH_MAX - sizeof(PROGRAM) - 1);
	if (length > 0) {
		ret[length] = '\0';
		(void)strcpy(strrchr(ret, '/') + 1, PROGRAM);
		if (access(ret, X_OK) == 0)
			return 0;
	}
	while (folders && folders[0]) {
		size_t folder_length = strcspn(folders, ":");

		(void)snprintf(ret, PATH_MAX, "%.*s/%s", (int)folder_length, folders, PROGRAM);
		if (folder_length > 0 && access(ret, X_OK) == 0)
			return 0;
		folders += folder_length + (folders[folder_length] == ':');
	}
	return why_set(why, -ENOENT,
		       "no daemon runs and no " PROGRAM
		       " is found to start: install it, or name it "
		       "with $OOCD_DAEMON");
}

/* What the new process needs, prepared before there is one. */
struct launch {
	char program[PATH_MAX];
	const char *arguments[6 + STARTER_OPTION_COUNT_MAX];
	int null_fd;
	int log_fd;
	int report_fd; /* told the process's number, and an errno where it could not be started */
};

struct launch_report {
	pid_t process;
	int error;
};

/*
 * The daemon-to-be, in a copy of a program that may have threads: only calls that are safe in
 * signal handlers are allowed here.
 */
static _Noreturn void become_daemon(const struct launch *launch)
{
	struct launch_report report = { .process = getpid() };
	sigset_t none;

	(void)write(launch->report_fd, &report, sizeof(report));
	/* What a program ignores or blocks would be ignored and blocked after exec as well. */
	for (int signal_number = 1; signal_number < NSIG; signal_number++)
		(void)signal(signal_number, SIG_DFL);
	(void)sigemptyset(&none);
	(void)sigprocmask(SIG_SETMASK, &none, NULL);
	if (dup2(launch->null_fd, STDIN_FILENO) >= 0 && dup2(launch->log_fd, STDOUT_FILENO) >= 0 &&
	    dup2(launch->log_fd, STDERR_FILENO) >= 0 && chdir("/") == 0) {
		/* The program's own files may lack close-on-exec. */
		(void)syscall(SYS_close_range, 3u, ~0u, CLOSE_RANGE_CLOEXEC);
		(void)execv(launch->program, (char *const *)(uintptr_t)launch->arguments);
	}
	report.error = errno;
	(void)write(launch->report_fd, &report, sizeof(report));
	_exit(127);
}

/*
 * Forks twice, so that the daemon is nobody's child: no program shall have to wait for a process
 * that it does not know of.
 */
static int launch_detached(const struct launch *launch)
{
	pid_t child = fork();
	int status;

	if (child < 0)
		return -errno;
	if (child == 0) {
		(void)setsid();
		/* fork() runs handlers that a copy of a threaded program must not run. */
		if (_Fork() == 0)
			become_daemon(launch);
		_exit(0);
	}
	while (waitpid(child, &status, 0) < 0 && errno == EINTR)
		;
	return 0;
}

/* Returns: pidfd of the daemon, or -errno. */
static int read_report(int report_fd)
{
	struct launch_report report = { 0 };
	struct launch_report newest;

	/* It ends with exec, which closes the other end. */
	while (read(report_fd, &newest, sizeof(newest)) == (ssize_t)sizeof(newest))
		report = newest;
	if (report.error != 0)
		return -report.error;
	if (report.process == 0)
		return -EAGAIN;
	return (int)syscall(SYS_pidfd_open, report.process, 0);
}

static int start(const char *const *options, const char *socket_path, struct why *why)
{
	struct launch launch = {
		.arguments = { PROGRAM, "--socket", socket_path, "--idle-exit", IDLE_EXIT_SECONDS },
	};
	const char **next = launch.arguments + 5;
	char log_path[PATH_MAX];
	int pipe_fds[2];
	int r;

	while (options && *options)
		*next++ = *options++;
	r = find_program(launch.program, why);
	if (r < 0)
		return r;
	(void)snprintf(log_path, sizeof(log_path), "%s.log", socket_path);
	AUTO_FD null_fd = open("/dev/null", O_RDONLY | O_CLOEXEC);
	AUTO_FD log_fd = open(
		log_path, O_WRONLY | O_CREAT | O_TRUNC | O_APPEND | O_CLOEXEC | O_NOFOLLOW, 0600);
	if (null_fd < 0 || log_fd < 0)
		return why_errno(why, -errno, "cannot open %s",
				 null_fd < 0 ? "/dev/null" : log_path);
	if (pipe2(pipe_fds, O_CLOEXEC) < 0)
		return why_errno(why, -errno, "cannot make a pipe to start a daemon");

	AUTO_FD read_fd = pipe_fds[0];
	AUTO_FD report_fd = pipe_fds[1];

	launch.null_fd = null_fd;
	launch.log_fd = log_fd;
	launch.report_fd = report_fd;
	r = launch_detached(&launch);
	report_fd = fd_close(report_fd);
	if (r == 0)
		r = read_report(read_fd);
	return r >= 0 ? r : why_errno(why, r, "cannot start %s", launch.program);
}

int starter_step(struct starter *starter, const char *socket_path, struct why *why)
{
	struct pollfd process = { .fd = starter->process_fd, .events = POLLIN };
	int r;

	if (starter->lock_fd < 0) {
		r = take_lock(socket_path, why);
		if (r < 0)
			return r;
		/* Whoever had the lock before may have started one: look again before starting. */
		starter->lock_fd = r;
		return -EAGAIN;
	}
	if (starter->process_fd < 0) {
		r = start(starter->options, socket_path, why);
		if (r < 0)
			return r;
		starter->process_fd = r;
		return -EAGAIN;
	}
	if (poll(&process, 1, 0) > 0)
		return why_set(why, -ECONNREFUSED,
			       "the daemon that was started ended at once: %s.log says why",
			       socket_path);
	return -EAGAIN;
}
