/* SPDX-License-Identifier: MIT */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "tests/integration/manager_kit.h"

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
	char socket_path[108];
	char notify_path[108];
	int listen_fd;
	int notify_fd;
	pid_t pid;
	pthread_t thread;

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

/* Ends by an empty message of the test's own. */
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

static int bind_at(const char *path, int type)
{
	struct sockaddr_un address = { .sun_family = AF_UNIX };
	int fd = socket(AF_UNIX, type | SOCK_CLOEXEC, 0);

	(void)snprintf(address.sun_path, sizeof(address.sun_path), "%s", path);
	assert_true(fd >= 0);
	assert_int_equal(bind(fd, (struct sockaddr *)&address, sizeof(address)), 0);
	return fd;
}

struct manager *manager_create(const char *folder)
{
	struct manager *manager = calloc(1, sizeof(*manager));

	assert_non_null(manager);
	(void)snprintf(manager->socket_path, sizeof(manager->socket_path), "%s/oocd.sock", folder);
	(void)snprintf(manager->notify_path, sizeof(manager->notify_path), "%s/notify", folder);
	manager->listen_fd = bind_at(manager->socket_path, SOCK_SEQPACKET);
	assert_int_equal(listen(manager->listen_fd, 64), 0);
	manager->notify_fd = bind_at(manager->notify_path, SOCK_DGRAM);
	(void)pthread_mutex_init(&manager->mutex, NULL);
	(void)pthread_cond_init(&manager->changed, NULL);
	assert_int_equal(pthread_create(&manager->thread, NULL, listen_thread, manager), 0);
	return manager;
}

/* What a daemon said is of no interest when the next one speaks, and thousands may come. */
static void forget_what_was_said(struct manager *manager)
{
	(void)pthread_mutex_lock(&manager->mutex);
	while (manager->said_count > 0)
		free(manager->said[--manager->said_count]);
	(void)pthread_mutex_unlock(&manager->mutex);
}

struct manager *manager_destroy(struct manager *manager)
{
	struct sockaddr_un address = { .sun_family = AF_UNIX };
	int fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);

	if (manager->pid > 0)
		(void)manager_stop(manager, SIGKILL);
	(void)snprintf(address.sun_path, sizeof(address.sun_path), "%s", manager->notify_path);
	assert_int_equal(sendto(fd, "", 0, 0, (struct sockaddr *)&address, sizeof(address)), 0);
	(void)close(fd);
	(void)pthread_join(manager->thread, NULL);
	while (manager->kept_count > 0)
		forget_at(manager, 0);
	forget_what_was_said(manager);
	(void)close(manager->listen_fd);
	(void)close(manager->notify_fd);
	(void)unlink(manager->socket_path);
	(void)unlink(manager->notify_path);
	free(manager);
	return NULL;
}

/* ---- the daemon ---- */

/* Descriptors first go out of each other's way, then to where the daemon looks for them. */
static _Noreturn void exec_daemon(struct manager *manager, const char *const *options)
{
	uint32_t count = manager->kept_count + 1;
	char *names = calloc(count, 257);
	const char *argv[OPTIONS_MAX + 2] = { "oocd" };
	char path[512];
	char number[16];
	int fds[KEPT_MAX + 1];

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
	(void)snprintf(path, sizeof(path), "%s/oocd", getenv("OOCD_BIN"));
	for (uint32_t i = 0; options[i] && i < OPTIONS_MAX; i++)
		argv[i + 1] = options[i];
	(void)execv(path, (char *const *)(uintptr_t)argv);
	_exit(127);
}

void manager_start(struct manager *manager, const char *const *options)
{
	assert_int_equal(manager->pid, 0);
	forget_what_was_said(manager);
	(void)fflush(NULL);
	/* The child sees the table as it is: nobody is there who could say anything. */
	manager->pid = fork();
	assert_true(manager->pid >= 0);
	if (manager->pid == 0)
		exec_daemon(manager, options);
	manager_await(manager, "READY=1", 1);
}

int manager_stop(struct manager *manager, int signal)
{
	int status;

	assert_true(manager->pid > 0);
	assert_int_equal(kill(manager->pid, signal), 0);
	assert_int_equal(waitpid(manager->pid, &status, 0), manager->pid);
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
static void await(struct manager *manager, uint32_t (*counts)(const struct manager *, const char *),
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
	if (r != 0)
		fail_msg("the daemon does not come to %u of \"%s\"", count, part);
}

void manager_await(struct manager *manager, const char *part, uint32_t count)
{
	await(manager, count_said, part, count, true);
}

void manager_await_kept(struct manager *manager, const char *part, uint32_t count)
{
	await(manager, count_kept, part, count, false);
}

void manager_keep_nothing(struct manager *manager)
{
	(void)pthread_mutex_lock(&manager->mutex);
	manager->keeps_nothing = true;
	while (manager->kept_count > 0)
		forget_at(manager, 0);
	(void)pthread_mutex_unlock(&manager->mutex);
}
