/* SPDX-License-Identifier: MIT */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <ftw.h>
#include <grp.h>
#include <linux/falloc.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "tests/helper.h"

#define LIST_BYTES 4096

/* ---- the whole program ---- */

void test_descriptors_note(struct test_descriptors *ret)
{
	DIR *folder = opendir("/proc/self/fd");

	memset(ret, 0, sizeof(*ret));
	if (!folder)
		abort();
	for (struct dirent *entry = readdir(folder); entry; entry = readdir(folder)) {
		long fd = strtol(entry->d_name, NULL, 10);

		if (entry->d_name[0] != '.' && fd < TEST_DESCRIPTOR_MAX && fd != dirfd(folder))
			ret->is_open[fd] = true;
	}
	closedir(folder);
}

int test_descriptors_leaked(const struct test_descriptors *before)
{
	struct test_descriptors now;
	int leaked = 0;

	test_descriptors_note(&now);
	for (int fd = 0; fd < TEST_DESCRIPTOR_MAX; fd++) {
		char link[64];
		char target[256] = "";

		if (!now.is_open[fd] || before->is_open[fd])
			continue;
		(void)snprintf(link, sizeof(link), "/proc/self/fd/%d", fd);
		if (readlink(link, target, sizeof(target) - 1) < 0)
			target[0] = '\0';
		fprintf(stderr, "descriptor %d leaked: %s\n", fd, target);
		leaked++;
	}
	return leaked;
}

uint64_t test_repeats(uint64_t usual)
{
	const char *text = getenv("OOCD_REPEATS");

	return usual * (text ? strtoull(text, NULL, 10) : 1);
}

/* ---- files ---- */

char *test_folder_make(void)
{
	const char *base = getenv("TMPDIR");
	char *folder;

	/* /var/tmp: /tmp is often in memory, where O_DIRECT may be missing. */
	if (asprintf(&folder, "%s/oocd-test-XXXXXX", base && base[0] ? base : "/var/tmp") < 0)
		fail_msg("no memory");
	if (!mkdtemp(folder))
		fail_msg("%s: %s", folder, strerror(errno));
	return folder;
}

static int remove_entry(const char *path, const struct stat *status, int kind, struct FTW *place)
{
	(void)status;
	(void)kind;
	(void)place;
	return remove(path);
}

void test_folder_remove(char *folder)
{
	(void)nftw(folder, remove_entry, 16, FTW_DEPTH | FTW_PHYS);
	free(folder);
}

int test_folder_setup(void **state)
{
	*state = test_folder_make();
	return 0;
}

int test_folder_teardown(void **state)
{
	test_folder_remove(*state);
	return 0;
}

const char *test_path(const char *folder, const char *name)
{
	static struct path {
		struct path *next;
		char text[];
	} * paths;
	size_t size_bytes = strlen(folder) + strlen(name) + 2;
	struct path *path = malloc(sizeof(*path) + size_bytes);

	if (!path)
		fail_msg("no memory");
	(void)snprintf(path->text, size_bytes, "%s/%s", folder, name);
	/* Kept on a list, so that nothing counts as leaked. */
	path->next = paths;
	paths = path;
	return path->text;
}

static int is_not_dots(const struct dirent *entry)
{
	return strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0;
}

static int compare_names(const struct dirent **a, const struct dirent **b)
{
	return strcmp((*a)->d_name, (*b)->d_name);
}

const char *test_folder_list(const char *folder)
{
	static char list[LIST_BYTES];
	struct dirent **entries;
	size_t used = 0;
	int count = scandir(folder, &entries, is_not_dots, compare_names);

	if (count < 0)
		fail_msg("%s: %s", folder, strerror(errno));
	list[0] = '\0';
	for (int i = 0; i < count; i++) {
		if (used < sizeof(list))
			used += (size_t)snprintf(list + used, sizeof(list) - used, "%s ",
						 entries[i]->d_name);
		free(entries[i]);
	}
	free(entries);
	return list;
}

void *test_file_read(const char *path, size_t *ret_bytes)
{
	FILE *file = fopen(path, "re");
	struct stat status;
	void *data;

	if (!file || fstat(fileno(file), &status) < 0)
		fail_msg("%s: %s", path, strerror(errno));
	data = malloc((size_t)status.st_size + 1);
	if (!data || fread(data, 1, (size_t)status.st_size, file) != (size_t)status.st_size)
		fail_msg("%s: cannot be read", path);
	(void)fclose(file);
	*ret_bytes = (size_t)status.st_size;
	return data;
}

void test_file_write(const char *path, const void *data, size_t size_bytes)
{
	FILE *file = fopen(path, "we");

	if (!file || fwrite(data, 1, size_bytes, file) != size_bytes || fclose(file) != 0)
		fail_msg("%s: cannot be written", path);
}

void test_assert_same_files(const char *a, const char *b)
{
	size_t bytes_a;
	size_t bytes_b;
	uint8_t *data_a = test_file_read(a, &bytes_a);
	uint8_t *data_b = test_file_read(b, &bytes_b);

	assert_int_equal(bytes_a, bytes_b);
	for (size_t i = 0; i < bytes_a; i++)
		if (data_a[i] != data_b[i])
			fail_msg("%s and %s differ from byte %zu on", a, b, i);
	free(data_a);
	free(data_b);
}

/* ---- processes ---- */

pid_t test_fork(void)
{
	pid_t pid;

	/* What is not written yet would be written by both. */
	(void)fflush(NULL);
	pid = fork();
	assert_true(pid >= 0);
	if (pid == 0) {
		(void)prctl(PR_SET_PDEATHSIG, SIGKILL);
		(void)setenv("CMOCKA_TEST_ABORT", "1", 1);
	}
	return pid;
}

int test_wait(pid_t pid)
{
	int status;

	assert_int_equal(waitpid(pid, &status, 0), pid);
	return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

/* ---- users ---- */

bool test_become_other_user(void)
{
	/* The kernel forgets about the parent's death where a process becomes somebody else. */
	return setgroups(0, NULL) == 0 &&
	       setresgid(TEST_OTHER_UID, TEST_OTHER_UID, TEST_OTHER_UID) == 0 &&
	       setresuid(TEST_OTHER_UID, TEST_OTHER_UID, TEST_OTHER_UID) == 0 &&
	       prctl(PR_SET_PDEATHSIG, SIGKILL) == 0;
}

int test_write_in_every_way(int fd)
{
	char path[64];
	void *map;

	if (write(fd, "x", 1) >= 0 || pwrite(fd, "x", 1, 0) >= 0)
		return 1;
	if (mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0) != MAP_FAILED)
		return 2;
	map = mmap(NULL, 4096, PROT_READ, MAP_SHARED, fd, 0);
	if (map == MAP_FAILED || mprotect(map, 4096, PROT_READ | PROT_WRITE) == 0)
		return 3;
	(void)munmap(map, 4096);
	if (ftruncate(fd, 0) == 0 || ftruncate(fd, 1 << 30) == 0)
		return 4;
	if (fallocate(fd, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, 0, 4096) == 0 ||
	    fallocate(fd, 0, 1 << 30, 4096) == 0)
		return 5;
	if (fchmod(fd, 0666) == 0 || fchown(fd, TEST_OTHER_UID, TEST_OTHER_UID) == 0)
		return 6;
	(void)snprintf(path, sizeof(path), "/proc/self/fd/%d", fd);
	if (open(path, O_RDWR | O_CLOEXEC) >= 0 || open(path, O_WRONLY | O_CLOEXEC) >= 0 ||
	    chmod(path, 0666) == 0 || truncate(path, 0) == 0)
		return 7;
	return fcntl(fd, F_ADD_SEALS, F_SEAL_WRITE) == 0 ? 8 : 0;
}

/* ---- programs ---- */

int test_command(char *ret_output, size_t output_bytes, const char *format, ...)
{
	char command[4096];
	char shell[4096 + 16];
	char rest[512];
	size_t length = 0;
	va_list arguments;
	FILE *pipe;
	int status;

	va_start(arguments, format);
	length = (size_t)vsnprintf(command, sizeof(command), format, arguments);
	va_end(arguments);
	/* Both outputs; a redirection in the command itself has the last word. */
	if (length >= sizeof(command) ||
	    snprintf(shell, sizeof(shell), "{ %s\n} 2>&1", command) >= (int)sizeof(shell))
		fail_msg("the command is too long");
	pipe = popen(shell, "re");
	if (!pipe)
		fail_msg("%s: %s", command, strerror(errno));
	length = ret_output ? fread(ret_output, 1, output_bytes - 1, pipe) : 0;
	if (ret_output)
		ret_output[length] = '\0';
	/* A program whose output nobody reads would wait for ever. */
	while (fread(rest, 1, sizeof(rest), pipe) > 0)
		;
	status = pclose(pipe);
	if (!WIFEXITED(status))
		fail_msg("%s: ended by signal %d", command, WTERMSIG(status));
	return WEXITSTATUS(status);
}
