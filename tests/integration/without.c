/* SPDX-License-Identifier: MIT */
/*
 * without PROGRAM [ARGUMENT]...: runs a program, and all that it starts, without io_uring, with 8 MiB
 * of lockable memory, without pages of 2 MiB and without a service manager.
 */
#include <errno.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#define MEMLOCK_BYTES (8u << 20)

static int deny_io_uring(void)
{
	struct sock_filter filter[] = {
		BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr)),
		BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, __NR_io_uring_setup, 0, 1),
		BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EPERM),
		BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
	};
	struct sock_fprog program = { sizeof(filter) / sizeof(filter[0]), filter };

	if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) < 0)
		return -1;
	return prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program);
}

int main(int argc, char **argv)
{
	const struct rlimit memlock = { MEMLOCK_BYTES, MEMLOCK_BYTES };

	if (argc < 2) {
		(void)fputs("usage: without PROGRAM [ARGUMENT]...\n", stderr);
		return 2;
	}
	(void)unsetenv("NOTIFY_SOCKET");
	if (setrlimit(RLIMIT_MEMLOCK, &memlock) < 0 || prctl(PR_SET_THP_DISABLE, 1, 0, 0, 0) < 0 ||
	    deny_io_uring() < 0) {
		(void)fprintf(stderr, "without: cannot take it away: %s\n", strerror(errno));
		return 1;
	}
	(void)execvp(argv[1], argv + 1);
	(void)fprintf(stderr, "without: %s: %s\n", argv[1], strerror(errno));
	return 1;
}
