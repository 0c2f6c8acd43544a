/* SPDX-License-Identifier: MIT */
#include "daemon/server/memory.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/text.h"

#define PATH_BYTES 4400u
#define NAME_BYTES 4096u

static void limit(struct memory *memory, uint64_t bytes, const char *what, const char *where)
{
	if (bytes >= memory->bytes)
		return;
	memory->bytes = bytes;
	(void)snprintf(memory->limited_by, sizeof(memory->limited_by), "%s%.200s", what, where);
}

static void read_machine(const char *root, struct memory *memory)
{
	char path[PATH_BYTES];
	char line[256];
	unsigned long long kib;
	FILE *file;

	(void)snprintf(path, sizeof(path), "%s/proc/meminfo", root);
	file = fopen(path, "re");
	if (!file)
		return;
	while (fgets(line, sizeof(line), file))
		if (sscanf(line, "MemAvailable: %llu kB", &kib) == 1)
			limit(memory, (uint64_t)kib * KIB, "available memory", "");
	(void)fclose(file);
}

/* Returns: false where there is no number, as in "max". */
static bool read_number(const char *root, const char *cgroup, const char *name, uint64_t *ret)
{
	char path[PATH_BYTES];
	char text[64];
	FILE *file;
	bool there;

	(void)snprintf(path, sizeof(path), "%s/sys/fs/cgroup%s/%s", root, cgroup, name);
	file = fopen(path, "re");
	if (!file)
		return false;
	there = fgets(text, sizeof(text), file) != NULL;
	(void)fclose(file);
	if (!there)
		return false;
	text[strcspn(text, "\n")] = '\0';
	return text_to_u64(text, ret) == 0;
}

/* What an enclosing group may still take: a limit holds for all below it. */
static void read_cgroups(const char *root, char *cgroup, struct memory *memory)
{
	for (;;) {
		uint64_t max_bytes;
		uint64_t used_bytes = 0;
		char *slash;

		if (read_number(root, cgroup, "memory.max", &max_bytes)) {
			(void)read_number(root, cgroup, "memory.current", &used_bytes);
			limit(memory, max_bytes - u64_min(max_bytes, used_bytes), "memory.max of ",
			      cgroup[0] ? cgroup : "/");
		}
		slash = strrchr(cgroup, '/');
		if (!slash)
			return;
		*slash = '\0';
	}
}

void memory_read_below(const char *root, struct memory *ret)
{
	char path[PATH_BYTES];
	char line[NAME_BYTES];
	FILE *file;

	*ret = (struct memory){ .bytes = UINT64_MAX };
	read_machine(root, ret);
	(void)snprintf(path, sizeof(path), "%s/proc/self/cgroup", root);
	file = fopen(path, "re");
	if (!file)
		return;
	/* "0::/path": the line of version 2. */
	while (fgets(line, sizeof(line), file)) {
		line[strcspn(line, "\n")] = '\0';
		if (strncmp(line, "0::/", 4) == 0)
			read_cgroups(root, line + 3, ret);
	}
	(void)fclose(file);
}

void memory_read(struct memory *ret)
{
	memory_read_below("", ret);
}
