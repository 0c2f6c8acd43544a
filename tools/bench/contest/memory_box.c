/* SPDX-License-Identifier: MIT */
#include "tools/bench/contest/memory_box.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "formats/base/file.h"

/* Where the two versions of control groups have the controller of memory, and their files. */
static const struct version {
	const char *root;
	const char *limit;
	const char *enable; /* file that hands the controller down; NULL: not needed */
} versions[] = {
	{ "/sys/fs/cgroup", "memory.max", "/sys/fs/cgroup/cgroup.subtree_control" },
	{ "/sys/fs/cgroup/memory", "memory.limit_in_bytes", NULL },
};

static int write_text(const char *folder, const char *name, const char *text)
{
	char path[PATH_MAX + 64];
	ssize_t n;
	int fd;

	(void)snprintf(path, sizeof(path), "%s%s%s", folder, *folder ? "/" : "", name);
	fd = open(path, O_WRONLY | O_CLOEXEC);
	if (fd < 0)
		return -errno;
	n = write(fd, text, strlen(text));
	if (n < 0) {
		int r = -errno;

		(void)fd_close(fd);
		return r;
	}
	(void)fd_close(fd);
	return 0;
}

static int make_in(const struct version *version, uint64_t bytes, struct memory_box *ret)
{
	static unsigned made_count;
	char number[32];
	int r;

	if (version->enable)
		(void)write_text("", version->enable, "+memory");
	(void)snprintf(ret->folder, sizeof(ret->folder), "%s/oocbench-%d-%u", version->root,
		       (int)getpid(), made_count++);
	if (mkdir(ret->folder, 0700) < 0)
		return -errno;
	(void)snprintf(number, sizeof(number), "%llu", (unsigned long long)bytes);
	r = write_text(ret->folder, version->limit, number);
	if (r < 0)
		(void)rmdir(ret->folder);
	return r;
}

int memory_box_make(uint64_t bytes, struct memory_box *ret, struct why *why)
{
	int r = -ENOTSUP;

	for (size_t i = 0; i < ARRAY_LENGTH(versions); i++) {
		r = make_in(&versions[i], bytes, ret);
		if (r == 0)
			return 0;
	}
	ret->folder[0] = '\0';
	return why_set(why, -ENOTSUP,
		       "no control group for memory can be made (%s): run this as root",
		       strerror(-r));
}

int memory_box_enter(const struct memory_box *box, struct why *why)
{
	int r = write_text(box->folder, "cgroup.procs", "0");

	return r < 0 ? why_errno(why, r, "%s", box->folder) : 0;
}

void memory_box_done(struct memory_box *box)
{
	/* The kernel is done with a process some time after it was waited for. */
	for (int i = 0; box->folder[0] != '\0' && i < 100; i++) {
		if (rmdir(box->folder) == 0 || errno != EBUSY)
			break;
		clock_pause_ns(10 * NS_PER_MS);
	}
	box->folder[0] = '\0';
}
