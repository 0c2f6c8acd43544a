/* SPDX-License-Identifier: MIT */
/*
 * main() of a fuzzer that is built without libFuzzer: each file of a corpus, and seeded changes of
 * it, go through the fuzzer's entry.  So a corpus is an ordinary test too, and what a real run
 * found stays found.
 *
 *	fuzz_x FOLDER [CHANGES]
 */
#include <dirent.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

/* Sanitizers make everything ten times slower. */
#ifdef OOCD_SANITIZED
#define CHANGES_DEFAULT 30u
#else
#define CHANGES_DEFAULT 300u
#endif

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size_bytes);

static uint64_t random_state;

static uint64_t next_random(void)
{
	random_state ^= random_state << 13;
	random_state ^= random_state >> 7;
	random_state ^= random_state << 17;
	return random_state;
}

/* Numbers that parsers stumble over, put where a number may be. */
static void change(uint8_t *data, size_t size_bytes)
{
	static const uint64_t values[] = { 0,
					   1,
					   2,
					   0x7f,
					   0xff,
					   0xffff,
					   0x7fffffff,
					   0xffffffff,
					   0x7fffffffffffffff,
					   0xffffffffffffffff };
	uint64_t value = values[next_random() % (sizeof(values) / sizeof(values[0]))];
	size_t length = (size_t)1 << next_random() % 4;
	size_t offset = next_random() % size_bytes;

	if (next_random() % 2)
		data[offset] ^= (uint8_t)(1u << next_random() % 8);
	else if (offset + length <= size_bytes)
		memcpy(data + offset, &value, length);
}

static void run_file(const uint8_t *data, size_t size_bytes, unsigned changes)
{
	uint8_t *changed = malloc(size_bytes + 1);

	if (!changed)
		abort();
	(void)LLVMFuzzerTestOneInput(data, size_bytes);
	for (unsigned i = 0; i < changes && size_bytes > 0; i++) {
		size_t length = next_random() % 8 ? size_bytes : next_random() % size_bytes;

		memcpy(changed, data, length);
		for (uint64_t k = next_random() % 4; length > 0 && k < 4; k++)
			change(changed, length);
		(void)LLVMFuzzerTestOneInput(changed, length);
	}
	free(changed);
}

static int run_path(const char *path, unsigned changes)
{
	FILE *file = fopen(path, "re");
	struct stat status;
	uint8_t *data;

	if (!file || fstat(fileno(file), &status) < 0) {
		perror(path);
		return 1;
	}
	data = malloc((size_t)status.st_size + 1);
	if (!data || fread(data, 1, (size_t)status.st_size, file) != (size_t)status.st_size)
		abort();
	(void)fclose(file);
	/* The same changes for the same file, whatever else the folder has. */
	random_state = 0x9e3779b97f4a7c15 ^ (uint64_t)status.st_size;
	run_file(data, (size_t)status.st_size, changes);
	free(data);
	return 0;
}

int main(int argc, char **argv)
{
	unsigned changes = argc > 2 ? (unsigned)atoi(argv[2]) : CHANGES_DEFAULT;
	struct dirent **entries;
	int failed = 0;
	int ran = 0;
	int count;

	if (argc < 2) {
		fprintf(stderr, "usage: %s FOLDER [CHANGES]\n", argv[0]);
		return 2;
	}
	count = scandir(argv[1], &entries, NULL, alphasort);
	for (int i = 0; i < count; i++) {
		char path[4096];

		(void)snprintf(path, sizeof(path), "%s/%s", argv[1], entries[i]->d_name);
		if (entries[i]->d_name[0] != '.') {
			failed += run_path(path, changes);
			ran++;
		}
		free(entries[i]);
	}
	if (count >= 0)
		free(entries);
	printf("%d files, %u changes of each\n", ran, changes);
	return failed > 0 || ran == 0;
}
