/* SPDX-License-Identifier: MIT */
#include "formats/store/new_file.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "formats/base/file.h"

/** Files being made under one name at one time. */
#define HIDDEN_COUNT_MAX 100u
#define FILE_MODE        0666

struct new_file {
	int fd;
	int folder_fd;
	char *given_path;
	char *path;                     /* the same, resolved */
	const char *name;               /* its last part */
	char hidden_name[NAME_MAX + 1]; /* "" while it has none */
};

/* "folder/.name.N.part" is the N-th hidden name. */
static void set_hidden_name(struct new_file *file, unsigned number)
{
	(void)snprintf(file->hidden_name, sizeof(file->hidden_name), ".%.200s.%u.part", file->name,
		       number);
}

static void remove_hidden(struct new_file *file)
{
	if (file->hidden_name[0] != '\0')
		(void)unlinkat(file->folder_fd, file->hidden_name, 0);
	file->hidden_name[0] = '\0';
}

/* Removes a hidden file whose maker has died: nobody holds its lock. */
static void remove_if_stale(struct new_file *file)
{
	AUTO_FD fd = openat(file->folder_fd, file->hidden_name,
			    O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);

	if (fd >= 0 && flock(fd, LOCK_EX | LOCK_NB) == 0)
		(void)unlinkat(file->folder_fd, file->hidden_name, 0);
}

static void remove_stale_files(struct new_file *file)
{
	for (unsigned number = 0; number < HIDDEN_COUNT_MAX; number++) {
		set_hidden_name(file, number);
		/* Numbers are given from 0 up, so behind the first gap there is rarely one. */
		if (faccessat(file->folder_fd, file->hidden_name, F_OK, AT_SYMLINK_NOFOLLOW) < 0)
			break;
		remove_if_stale(file);
	}
	file->hidden_name[0] = '\0';
}

/*
 * The lock is taken after the file can be seen: someone may have taken it for stale.
 * Returns: 1 locked and still there, 0 lost, or -errno.
 */
static int lock_hidden(int fd)
{
	struct stat status;

	if (flock(fd, LOCK_EX | LOCK_NB) < 0)
		return errno == EWOULDBLOCK ? 0 : -errno;
	return fstat(fd, &status) < 0 ? -errno : status.st_nlink > 0;
}

/* Makes the hidden file of one number.  Returns: 1, 0 when someone else has the number, or -errno. */
static int try_hidden(struct new_file *file)
{
	int r;

	file->fd = openat(file->folder_fd, file->hidden_name, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC,
			  FILE_MODE);
	if (file->fd < 0)
		return errno == EEXIST ? 0 : -errno;
	r = lock_hidden(file->fd);
	if (r < 0)
		(void)unlinkat(file->folder_fd, file->hidden_name, 0);
	if (r <= 0)
		file->fd = fd_close(file->fd);
	return r;
}

static int open_hidden(struct new_file *file)
{
	int r = 0;

	for (unsigned number = 0; number < HIDDEN_COUNT_MAX && r == 0; number++) {
		set_hidden_name(file, number);
		r = try_hidden(file);
	}
	if (r > 0)
		return 0;
	file->hidden_name[0] = '\0';
	return r < 0 ? r : -EBUSY;
}

static int open_unnamed(struct new_file *file)
{
	file->fd = openat(file->folder_fd, ".", O_TMPFILE | O_RDWR | O_CLOEXEC, FILE_MODE);
	if (file->fd >= 0) {
		(void)flock(file->fd, LOCK_EX | LOCK_NB);
		return 0;
	}
	/* The three ways in which file systems and old kernels say that they have none. */
	if (errno == EOPNOTSUPP || errno == EISDIR || errno == EINVAL)
		return open_hidden(file);
	return -errno;
}

static int open_folder(struct new_file *file)
{
	char *slash = strrchr(file->path, '/');
	const char *folder = ".";

	file->name = file->path;
	if (slash) {
		file->name = slash + 1;
		folder = slash == file->path ? "/" : file->path;
		*slash = '\0';
	}
	if (file->name[0] == '\0')
		return -EISDIR;
	file->folder_fd = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	return file->folder_fd < 0 ? -errno : 0;
}

static int resolve_path(struct new_file *file, const char *path)
{
	struct stat status;

	if (stat(path, &status) == 0) {
		if (!S_ISREG(status.st_mode))
			return -EINVAL;
		file->path = realpath(path, NULL);
	} else {
		file->path = strdup(path);
	}
	return file->path ? 0 : -errno;
}

int new_file_create(const char *path, struct new_file **ret, struct why *why)
{
	struct new_file *file = calloc(1, sizeof(*file));
	int r;

	if (!file)
		return why_set(why, -ENOMEM, "%s: no memory", path);
	file->fd = -1;
	file->folder_fd = -1;
	file->given_path = strdup(path);
	r = file->given_path ? resolve_path(file, path) : -ENOMEM;
	if (r == -EINVAL) {
		why_set(why, r, "%s: is there and no regular file", path);
		goto err_destroy;
	}
	if (r == 0)
		r = open_folder(file);
	if (r == 0) {
		remove_stale_files(file);
		r = open_unnamed(file);
	}
	if (r < 0) {
		why_errno(why, r, "%s: cannot be made", path);
		goto err_destroy;
	}
	*ret = file;
	return 0;

err_destroy:
	new_file_destroy(file);
	return r;
}

struct new_file *new_file_destroy(struct new_file *file)
{
	if (!file)
		return NULL;
	remove_hidden(file);
	file->fd = fd_close(file->fd);
	file->folder_fd = fd_close(file->folder_fd);
	free(file->given_path);
	free(file->path);
	free(file);
	return NULL;
}

int new_file_fd(const struct new_file *file)
{
	return file->fd;
}

const char *new_file_path(const struct new_file *file)
{
	return file->given_path;
}

/* Gives the unnamed file a name that nothing has.  Linking needs no right but by way of /proc. */
static int link_as(const struct new_file *file, const char *name)
{
	char link[64];

	(void)snprintf(link, sizeof(link), "/proc/self/fd/%d", file->fd);
	return linkat(AT_FDCWD, link, file->folder_fd, name, AT_SYMLINK_FOLLOW) < 0 ? -errno : 0;
}

static int link_hidden(struct new_file *file)
{
	int r = -EBUSY;

	for (unsigned number = 0; number < HIDDEN_COUNT_MAX; number++) {
		set_hidden_name(file, number);
		r = link_as(file, file->hidden_name);
		if (r == 0)
			return 0;
		if (r != -EEXIST)
			break;
	}
	file->hidden_name[0] = '\0';
	return r;
}

static int give_name(struct new_file *file)
{
	int r;

	if (file->hidden_name[0] == '\0') {
		r = link_as(file, file->name);
		if (r != -EEXIST)
			return r;
		/* Something is to be replaced, which linking cannot and renaming can. */
		r = link_hidden(file);
		if (r < 0)
			return r;
	}
	if (renameat(file->folder_fd, file->hidden_name, file->folder_fd, file->name) < 0)
		return -errno;
	file->hidden_name[0] = '\0';
	return 0;
}

int new_file_commit(struct new_file *file, struct why *why)
{
	int r = give_name(file);

	if (r < 0)
		return why_errno(why, r, "%s: cannot be given its name", file->given_path);
	if (fsync(file->folder_fd) < 0)
		return why_errno(why, -errno, "%s: its folder cannot be flushed", file->given_path);
	return 0;
}
