/* SPDX-License-Identifier: MIT */
#include "daemon/server/listener.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include "formats/base/file.h"

#define BACKLOG 128

/*
 * The folder must be ours or root's: in a folder of somebody else, clients could be led to another
 * socket.
 */
static int prepare_folder(const char *path, struct why *why)
{
	char folder[sizeof(((struct listener *)NULL)->path)];
	struct stat status;
	char *slash;

	(void)snprintf(folder, sizeof(folder), "%s", path);
	slash = strrchr(folder, '/');
	if (!slash || slash == folder)
		return 0;
	*slash = '\0';
	if (mkdir(folder, 0700) == 0)
		return 0;
	if (errno != EEXIST)
		return why_errno(why, -errno, "%s: cannot be made", folder);
	if (stat(folder, &status) < 0)
		return why_errno(why, -errno, "%s", folder);
	if (!S_ISDIR(status.st_mode))
		return why_set(why, -ENOTDIR, "%s: not a folder", folder);
	if (status.st_uid != geteuid() && status.st_uid != 0)
		return why_set(why, -EPERM,
			       "%s: belongs to another user: choose another place with --socket",
			       folder);
	return 0;
}

static int in_use(const char *path, struct why *why)
{
	return why_set(why, -EADDRINUSE,
		       "%s: another oocd serves there: use it, stop it, or choose another --socket",
		       path);
}

/* The lock counts only if the file that was locked is still the one of that name. */
static int take_lock(struct listener *listener, struct why *why)
{
	for (;;) {
		struct stat ours;
		struct stat named;

		listener->lock_fd =
			open(listener->lock_path, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
		if (listener->lock_fd < 0)
			return why_errno(why, -errno, "%s: cannot be made", listener->lock_path);
		if (flock(listener->lock_fd, LOCK_EX | LOCK_NB) < 0) {
			int r = errno == EWOULDBLOCK
					? in_use(listener->path, why)
					: why_errno(why, -errno, "%s", listener->lock_path);

			listener->lock_fd = fd_close(listener->lock_fd);
			return r;
		}
		if (fstat(listener->lock_fd, &ours) == 0 &&
		    stat(listener->lock_path, &named) == 0 && ours.st_ino == named.st_ino &&
		    ours.st_dev == named.st_dev)
			return 0;
		/* Whoever had it has just removed it: once more, with the new one. */
		listener->lock_fd = fd_close(listener->lock_fd);
	}
}

/* With the lock held, a socket file is old unless a program without our lock listens there. */
static int remove_old_socket(const struct sockaddr_un *address, int kind, struct why *why)
{
	struct stat status;
	int probe_fd;
	int r;

	if (lstat(address->sun_path, &status) < 0)
		return errno == ENOENT ? 0 : why_errno(why, -errno, "%s", address->sun_path);
	if (!S_ISSOCK(status.st_mode))
		return why_set(why, -EEXIST, "%s: exists and is no socket: choose another --socket",
			       address->sun_path);
	probe_fd = socket(AF_UNIX, kind | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
	if (probe_fd < 0)
		return why_errno(why, -errno, "a socket");
	r = connect(probe_fd, (const struct sockaddr *)address, sizeof(*address)) < 0 ? -errno : 0;
	(void)fd_close(probe_fd);
	/* EPROTOTYPE: of another kind, but alive.  EAGAIN: so busy that its queue is full. */
	if (r != -ECONNREFUSED)
		return in_use(address->sun_path, why);
	if (unlink(address->sun_path) < 0)
		return why_errno(why, -errno, "%s: old socket file", address->sun_path);
	return 0;
}

static int bind_and_listen(struct listener *listener, const struct sockaddr_un *address, int kind,
			   struct why *why)
{
	listener->fd = socket(AF_UNIX, kind | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
	if (listener->fd < 0)
		return why_errno(why, -errno, "a socket");
	if (bind(listener->fd, (const struct sockaddr *)address, sizeof(*address)) < 0)
		return why_errno(why, -errno, "%s", listener->path);
	if (listen(listener->fd, BACKLOG) < 0) {
		int r = why_errno(why, -errno, "%s", listener->path);

		(void)unlink(listener->path);
		return r;
	}
	return 0;
}

int listener_open(const char *path, int kind, struct listener *ret, struct why *why)
{
	struct sockaddr_un address = { .sun_family = AF_UNIX };
	struct listener listener = LISTENER_NONE;
	int r;

	if (strlen(path) >= sizeof(address.sun_path) || path[0] == '\0')
		return why_set(why, -ENAMETOOLONG, "%s: longer than a socket's name may be", path);
	(void)snprintf(address.sun_path, sizeof(address.sun_path), "%s", path);
	(void)snprintf(listener.path, sizeof(listener.path), "%s", path);
	(void)snprintf(listener.lock_path, sizeof(listener.lock_path), "%s.lock", path);
	r = prepare_folder(path, why);
	if (r < 0)
		return r;
	r = take_lock(&listener, why);
	if (r < 0)
		return r;
	r = remove_old_socket(&address, kind, why);
	if (r == 0)
		r = bind_and_listen(&listener, &address, kind, why);
	if (r < 0) {
		/* The socket, if there is one, is somebody else's. */
		listener.fd = fd_close(listener.fd);
		(void)unlink(listener.lock_path);
		listener.lock_fd = fd_close(listener.lock_fd);
		return r;
	}
	*ret = listener;
	return 0;
}

int listener_adopt(int fd, struct listener *ret, struct why *why)
{
	int flags = fcntl(fd, F_GETFL);

	if (flags < 0 || fcntl(fd, F_SETFL, flags | O_NONBLOCK) < 0)
		return why_errno(why, -errno, "the socket handed over");
	*ret = LISTENER_NONE;
	ret->fd = fd;
	return 0;
}

void listener_close(struct listener *listener)
{
	if (listener->lock_fd >= 0) {
		(void)unlink(listener->path);
		listener->fd = fd_close(listener->fd);
		/* Removed while it is held: nobody can have locked this file and think it counts. */
		(void)unlink(listener->lock_path);
	}
	(void)fd_close(listener->fd);
	(void)fd_close(listener->lock_fd);
	*listener = LISTENER_NONE;
}
