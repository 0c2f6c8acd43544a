/* SPDX-License-Identifier: MIT */
#include "tools/bench/base/manager.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/base/file.h"

#define KEPT_MAX        512u
#define SAID_MAX        4096u
#define MESSAGE_BYTES   1024
#define OPTIONS_MAX     16
#define TIMEOUT_SECONDS 20
/* Every look at the clock is one at the watchdog. */
#define WATCHDOG_USEC "200000"
/* Where descriptors are handed over. */
#define FIRST_FD 3

struct kept {
	char name[256];
	int fd;
};

struct manager {
	char socket_path[sizeof(((struct sockaddr_un *)NULL)->sun_path)];
	char notify_path[sizeof(((struct sockaddr_un *)NULL)->sun_path)];
	int listen_fd;
	int notify_fd;
	pid_t pid;
	pthread_t thread;
	bool has_thread;

	pthread_mutex_t mutex; /* all below */
	pthread_cond_t changed;
	bool keeps_nothing;
	uint32_t kept_count;
	struct kept kept[KEPT_MAX];
	uint32_t said_count;
	char *said[SAID_MAX];
};

/* ---- what the daemon says ---- */

static void forget_at(struct manager *manager, uint32_t index)
{
	(void)close(manager->kept[index].fd);
	manager->kept[index] = manager->kept[--manager->kept_count];
}

static void forget_name(struct manager *manager, const char *name)
{
	for (uint32_t i = manager->kept_count; i-- > 0;)
		if (strcmp(manager->kept[i].name, name) == 0)
			forget_at(manager, i);
}

static void take(struct manager *manager, const char *message, int fd)
{
	const char *name = strstr(message, "FDNAME=");
	char text[256] = "";

	if (name)
		(void)sscanf(name, "FDNAME=%255[^\n]", text);
	if (strstr(message, "FDSTOREREMOVE=1"))
		forget_name(manager, text);
	else if (fd >= 0 && strstr(message, "FDSTORE=1") && !manager->keeps_nothing &&
		 manager->kept_count < KEPT_MAX) {
		struct kept *kept = &manager->kept[manager->kept_count++];

		(void)snprintf(kept->name, sizeof(kept->name), "%s", text);
		kept->fd = fd;
		return;
	}
	if (fd >= 0)
		(void)close(fd);
}

/* Ends by an empty message of our own. */
static void *listen_thread(void *arg)
{
	struct manager *manager = arg;

	for (;;) {
		char message[MESSAGE_BYTES];
		_Alignas(struct cmsghdr) char control[CMSG_SPACE(sizeof(int))];
		struct iovec vector = { message, sizeof(message) - 1 };
		struct msghdr header = { .msg_iov = &vector,
					 .msg_iovlen = 1,
					 .msg_control = control,
					 .msg_controllen = sizeof(control) };
		ssize_t bytes = recvmsg(manager->notify_fd, &header, MSG_CMSG_CLOEXEC);
		const struct cmsghdr *part;
		int fd = -1;

		if (bytes < 0 && errno == EINTR)
			continue;
		if (bytes <= 0)
			return NULL;
		message[bytes] = '\0';
		part = CMSG_FIRSTHDR(&header);
		if (part && part->cmsg_type == SCM_RIGHTS)
			memcpy(&fd, CMSG_DATA(part), sizeof(fd));
		(void)pthread_mutex_lock(&manager->mutex);
		take(manager, message, fd);
		if (manager->said_count < SAID_MAX)
			manager->said[manager->said_count++] = strdup(message);
		(void)pthread_cond_broadcast(&manager->changed);
		(void)pthread_mutex_unlock(&manager->mutex);
	}
}

/* ---- life ---- */

static int bind_at(const char *folder, const char *name, int type, char *ret_path, int *ret_fd,
		   struct why *why)
{
	struct sockaddr_un address = { .sun_family = AF_UNIX };

	if (snprintf(ret_path, sizeof(address.sun_path), "%s/%s", folder, name) >=
	    (int)sizeof(address.sun_path))
		return why_set(why, -ENAMETOOLONG, "%s: too long a folder for a socket", folder);
	(void)strcpy(address.sun_path, ret_path);
	*ret_fd = socket(AF_UNIX, type | SOCK_CLOEXEC, 0);
	if (*ret_fd < 0 || bind(*ret_fd, (const struct sockaddr *)&address, sizeof(address)) < 0)
		return why_errno(why, -errno, "%s", ret_path);
	return 0;
}

int manager_create(const char *folder, struct manager **ret, struct why *why)
{
	struct manager *manager = calloc(1, sizeof(*manager));
	char absolute[PATH_MAX]; /* a daemon works in no folder */
	int r;

	if (!manager)
		return why_set(why, -ENOMEM, "out of memory");
	manager->listen_fd = -1;
	manager->notify_fd = -1;
	(void)pthread_mutex_init(&manager->mutex, NULL);
	(void)pthread_cond_init(&manager->changed, NULL);
	r = realpath(folder, absolute) ? 0 : why_errno(why, -errno, "%s", folder);
	if (r == 0)
		r = bind_at(absolute, "oocd.sock", SOCK_SEQPACKET, manager->socket_path,
			    &manager->listen_fd, why);
	if (r == 0 && listen(manager->listen_fd, 64) < 0)
		r = why_errno(why, -errno, "%s", manager->socket_path);
	if (r == 0)
		r = bind_at(absolute, "notify", SOCK_DGRAM, manager->notify_path,
			    &manager->notify_fd, why);
	if (r == 0) {
		r = -pthread_create(&manager->thread, NULL, listen_thread, manager);
		manager->has_thread = r == 0;
		if (r < 0)
			r = why_errno(why, r, "a thread");
	}
	if (r < 0)
		manager = manager_destroy(manager);
	*ret = manager;
	return r;
}

/* What a daemon said is of no interest when the next one speaks, and thousands may come. */
static void forget_what_was_said(struct manager *manager)
{
	(void)pthread_mutex_lock(&manager->mutex);
	while (manager->said_count > 0)
		free(manager->said[--manager->said_count]);
	(void)pthread_mutex_unlock(&manager->mutex);
}

static void end_thread(struct manager *manager)
{
	struct sockaddr_un address = { .sun_family = AF_UNIX };
	int fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);

	(void)strcpy(address.sun_path, manager->notify_path);
	(void)sendto(fd, "", 0, 0, (const struct sockaddr *)&address, sizeof(address));
	(void)fd_close(fd);
	(void)pthread_join(manager->thread, NULL);
}

struct manager *manager_destroy(struct manager *manager)
{
	if (!manager)
		return NULL;
	if (manager->pid > 0)
		(void)manager_stop(manager, SIGKILL);
	if (manager->has_thread)
		end_thread(manager);
	while (manager->kept_count > 0)
		forget_at(manager, 0);
	forget_what_was_said(manager);
	(void)fd_close(manager->listen_fd);
	(void)fd_close(manager->notify_fd);
	(void)unlink(manager->socket_path);
	(void)unlink(manager->notify_path);
	(void)pthread_cond_destroy(&manager->changed);
	(void)pthread_mutex_destroy(&manager->mutex);
	free(manager);
	return NULL;
}

/* ---- the daemon ---- */

/* Descriptors first go out of each other's way, then to where the daemon looks for them. */
static _Noreturn void exec_daemon(struct manager *manager, const char *program,
				  const char *const *options)
{
	uint32_t count = manager->kept_count + 1;
	char *names = calloc(count, 257);
	const char *argv[OPTIONS_MAX + 2] = { "oocd" };
	char number[16];
	int fds[KEPT_MAX + 1];

	(void)prctl(PR_SET_PDEATHSIG, SIGKILL);
	if (!names)
		_exit(127);
	fds[0] = manager->listen_fd;
	(void)strcpy(names, "oocd.socket");
	for (uint32_t i = 0; i < manager->kept_count; i++) {
		fds[i + 1] = manager->kept[i].fd;
		(void)strcat(strcat(names, ":"), manager->kept[i].name);
	}
	for (uint32_t i = 0; i < count; i++)
		fds[i] = fcntl(fds[i], F_DUPFD, FIRST_FD + (int)count);
	for (uint32_t i = 0; i < count; i++) {
		(void)dup2(fds[i], FIRST_FD + (int)i);
		(void)close(fds[i]);
	}
	(void)snprintf(number, sizeof(number), "%u", count);
	(void)setenv("LISTEN_FDS", number, 1);
	(void)snprintf(number, sizeof(number), "%d", (int)getpid());
	(void)setenv("LISTEN_PID", number, 1);
	(void)setenv("LISTEN_FDNAMES", names, 1);
	(void)setenv("NOTIFY_SOCKET", manager->notify_path, 1);
	(void)setenv("WATCHDOG_USEC", WATCHDOG_USEC, 1);
	for (uint32_t i = 0; options[i]; i++) {
		CHECK(i < OPTIONS_MAX);
		argv[i + 1] = options[i];
	}
	(void)execv(program, (char *const *)(uintptr_t)argv);
	_exit(127);
}

int manager_start(struct manager *manager, const char *program, const char *const *options,
		  struct why *why)
{
	CHECK(manager->pid == 0);
	forget_what_was_said(manager);
	(void)fflush(NULL);
	/* The child sees the table as it is: nobody is there who could say anything. */
	manager->pid = fork();
	if (manager->pid == 0)
		exec_daemon(manager, program, options);
	if (manager->pid < 0) {
		manager->pid = 0;
		return why_errno(why, -errno, "a process");
	}
	return manager_await(manager, "READY=1", 1)
		       ? 0
		       : why_set(why, -ETIMEDOUT, "%s does not say that it is ready", program);
}

int manager_stop(struct manager *manager, int signal)
{
	int status = 0;

	CHECK(manager->pid > 0);
	(void)kill(manager->pid, signal);
	while (waitpid(manager->pid, &status, 0) < 0 && errno == EINTR)
		;
	manager->pid = 0;
	return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

pid_t manager_pid(const struct manager *manager)
{
	return manager->pid;
}

const char *manager_socket(const struct manager *manager)
{
	return manager->socket_path;
}

/* ---- what is there ---- */

static uint32_t count_kept(const struct manager *manager, const char *part)
{
	uint32_t count = 0;

	for (uint32_t i = 0; i < manager->kept_count; i++)
		count += strstr(manager->kept[i].name, part) != NULL;
	return count;
}

static uint32_t count_said(const struct manager *manager, const char *part)
{
	uint32_t count = 0;

	for (uint32_t i = 0; i < manager->said_count; i++)
		count += strstr(manager->said[i], part) != NULL;
	return count;
}

uint32_t manager_kept_count(struct manager *manager, const char *part)
{
	uint32_t count;

	(void)pthread_mutex_lock(&manager->mutex);
	count = count_kept(manager, part);
	(void)pthread_mutex_unlock(&manager->mutex);
	return count;
}

int manager_kept(struct manager *manager, const char *part, uint32_t n)
{
	int fd = -1;

	(void)pthread_mutex_lock(&manager->mutex);
	for (uint32_t i = 0; i < manager->kept_count && fd < 0; i++)
		if (strstr(manager->kept[i].name, part) && n-- == 0)
			fd = manager->kept[i].fd;
	(void)pthread_mutex_unlock(&manager->mutex);
	return fd;
}

uint32_t manager_said(struct manager *manager, const char *part)
{
	uint32_t count;

	(void)pthread_mutex_lock(&manager->mutex);
	count = count_said(manager, part);
	(void)pthread_mutex_unlock(&manager->mutex);
	return count;
}

/* at_least: else exactly so many. */
static bool await(struct manager *manager, uint32_t (*counts)(const struct manager *, const char *),
		  const char *part, uint32_t count, bool at_least)
{
	struct timespec until;
	int r = 0;

	(void)clock_gettime(CLOCK_REALTIME, &until);
	until.tv_sec += TIMEOUT_SECONDS;
	(void)pthread_mutex_lock(&manager->mutex);
	while (r == 0 &&
	       (at_least ? counts(manager, part) < count : counts(manager, part) != count))
		r = pthread_cond_timedwait(&manager->changed, &manager->mutex, &until);
	(void)pthread_mutex_unlock(&manager->mutex);
	return r == 0;
}

bool manager_await(struct manager *manager, const char *part, uint32_t count)
{
	return await(manager, count_said, part, count, true);
}

bool manager_await_kept(struct manager *manager, const char *part, uint32_t count)
{
	return await(manager, count_kept, part, count, false);
}

void manager_keep_nothing(struct manager *manager)
{
	(void)pthread_mutex_lock(&manager->mutex);
	manager->keeps_nothing = true;
	while (manager->kept_count > 0)
		forget_at(manager, 0);
	(void)pthread_mutex_unlock(&manager->mutex);
}
