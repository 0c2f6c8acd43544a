/* SPDX-License-Identifier: MIT */
#include "tools/build/spool.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/base/file.h"

/** Addresses with this bit lie in the scratch file. */
#define ON_DISK      (UINT64_C(1) << 63)
#define HUGE_BYTES   (UINT64_C(2) << 20)
#define SCRATCH_NAME "oocbuild-XXXXXX"

struct segment {
	uint8_t *memory;
	uint64_t live_bytes; /* of pieces that were not released */
};

struct spool {
	struct budget *budget;
	char *scratch_directory;
	pthread_mutex_t lock; /* of all that follows */
	struct segment *segments;
	size_t segment_count;
	size_t segment_max;
	size_t segment_used_bytes; /* of the last segment */
	int scratch_fd;
	uint64_t scratch_bytes;
};

int spool_create(struct budget *budget, const char *scratch_directory, struct spool **ret)
{
	struct spool *spool = calloc(1, sizeof(*spool));

	if (!spool)
		return -ENOMEM;
	spool->budget = budget;
	spool->scratch_fd = -1;
	(void)pthread_mutex_init(&spool->lock, NULL);
	/* As many as the budget has room for: the table never moves while others read it. */
	spool->segment_max = budget->limit_bytes / SPOOL_SEGMENT_BYTES;
	spool->segments = calloc(spool->segment_max + 1, sizeof(*spool->segments));
	spool->scratch_directory = strdup(scratch_directory);
	if (!spool->segments || !spool->scratch_directory) {
		spool_destroy(spool);
		return -ENOMEM;
	}
	*ret = spool;
	return 0;
}

static void segment_free(struct spool *spool, struct segment *segment)
{
	if (!segment->memory)
		return;
	(void)munmap(segment->memory, SPOOL_SEGMENT_BYTES);
	segment->memory = NULL;
	budget_give(spool->budget, SPOOL_SEGMENT_BYTES);
}

struct spool *spool_destroy(struct spool *spool)
{
	if (!spool)
		return NULL;
	for (size_t i = 0; i < spool->segment_count; i++)
		segment_free(spool, &spool->segments[i]);
	spool->scratch_fd = fd_close(spool->scratch_fd);
	(void)pthread_mutex_destroy(&spool->lock);
	free(spool->segments);
	free(spool->scratch_directory);
	free(spool);
	return NULL;
}

/* Aligned to huge pages, which halve the time of first touching it. */
static uint8_t *segment_map(void)
{
	uint8_t *memory = mmap(NULL, SPOOL_SEGMENT_BYTES + HUGE_BYTES, PROT_READ | PROT_WRITE,
			       MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
	size_t before;

	if (memory == MAP_FAILED)
		return NULL;
	before = (size_t)(-(uintptr_t)memory & (HUGE_BYTES - 1));
	if (before > 0)
		(void)munmap(memory, before);
	if (before < HUGE_BYTES)
		(void)munmap(memory + before + SPOOL_SEGMENT_BYTES, HUGE_BYTES - before);
	(void)madvise(memory + before, SPOOL_SEGMENT_BYTES, MADV_HUGEPAGE);
	return memory + before;
}

/* A new last segment, if table and budget allow one.  The lock is held. */
static bool segment_add(struct spool *spool)
{
	struct segment *segment = &spool->segments[spool->segment_count];

	if (spool->segment_count == spool->segment_max ||
	    !budget_take(spool->budget, SPOOL_SEGMENT_BYTES))
		return false;
	segment->memory = segment_map();
	if (!segment->memory) {
		budget_give(spool->budget, SPOOL_SEGMENT_BYTES);
		return false;
	}
	segment->live_bytes = 0;
	spool->segment_count++;
	spool->segment_used_bytes = 0;
	return true;
}

static int scratch_open(struct spool *spool, struct why *why)
{
	char path[PATH_MAX];
	int fd = open(spool->scratch_directory, O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);

	if (fd < 0 && (errno == EOPNOTSUPP || errno == EISDIR || errno == EINVAL)) {
		(void)snprintf(path, sizeof(path), "%s/" SCRATCH_NAME, spool->scratch_directory);
		fd = mkostemp(path, O_CLOEXEC);
		if (fd >= 0)
			(void)unlink(path);
	}
	if (fd < 0)
		return why_errno(why, -errno, "%s: cannot make a scratch file there",
				 spool->scratch_directory);
	spool->scratch_fd = fd;
	return 0;
}

/* Finds room for a piece.  The lock is held. */
static int reserve(struct spool *spool, size_t bytes, uint64_t *ret_address, struct why *why)
{
	bool fits = spool->segment_count > 0 && spool->segments[spool->segment_count - 1].memory &&
		    bytes <= SPOOL_SEGMENT_BYTES - spool->segment_used_bytes;
	int r;

	if (fits || segment_add(spool)) {
		struct segment *segment = &spool->segments[spool->segment_count - 1];

		*ret_address = (spool->segment_count - 1) * (uint64_t)SPOOL_SEGMENT_BYTES +
			       spool->segment_used_bytes;
		segment->live_bytes += bytes;
		spool->segment_used_bytes += bytes_round_up(bytes, sizeof(uint64_t));
		return 0;
	}
	if (spool->scratch_fd < 0) {
		r = scratch_open(spool, why);
		if (r < 0)
			return r;
	}
	*ret_address = ON_DISK | spool->scratch_bytes;
	spool->scratch_bytes += bytes_round_up(bytes, sizeof(uint64_t));
	return 0;
}

static uint8_t *memory_of(const struct spool *spool, uint64_t address)
{
	return spool->segments[address / SPOOL_SEGMENT_BYTES].memory +
	       address % SPOOL_SEGMENT_BYTES;
}

int spool_append(struct spool *spool, const void *data, size_t bytes, uint64_t *ret_address,
		 struct why *why)
{
	uint64_t address = 0;
	int r;

	CHECK(bytes > 0 && bytes <= SPOOL_SEGMENT_BYTES);
	(void)pthread_mutex_lock(&spool->lock);
	r = reserve(spool, bytes, &address, why);
	(void)pthread_mutex_unlock(&spool->lock);
	if (r < 0)
		return r;
	if (address & ON_DISK) {
		r = file_write_at(spool->scratch_fd, data, bytes, address & ~ON_DISK);
		if (r < 0)
			return why_errno(why, r, "%s: cannot write scratch (--scratch DIR)",
					 spool->scratch_directory);
	} else {
		memcpy(memory_of(spool, address), data, bytes);
	}
	*ret_address = address;
	return 0;
}

int spool_read(const struct spool *spool, uint64_t address, void *data, size_t bytes,
	       struct why *why)
{
	int r;

	if (!(address & ON_DISK)) {
		memcpy(data, memory_of(spool, address), bytes);
		return 0;
	}
	r = file_read_at(spool->scratch_fd, data, bytes, address & ~ON_DISK);
	if (r < 0)
		return why_errno(why, r, "%s: cannot read scratch", spool->scratch_directory);
	return 0;
}

const void *spool_peek(const struct spool *spool, uint64_t address)
{
	return address & ON_DISK ? NULL : memory_of(spool, address);
}

void spool_release(struct spool *spool, uint64_t address, size_t bytes)
{
	struct segment *segment;

	if (address & ON_DISK) {
		/* Only saves disk: where the file system cannot, the bytes stay until the end. */
		(void)fallocate(spool->scratch_fd, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE,
				(off_t)(address & ~ON_DISK), (off_t)bytes);
		return;
	}
	(void)pthread_mutex_lock(&spool->lock);
	segment = &spool->segments[address / SPOOL_SEGMENT_BYTES];
	CHECK(segment->live_bytes >= bytes);
	segment->live_bytes -= bytes;
	if (segment->live_bytes == 0)
		segment_free(spool, segment);
	(void)pthread_mutex_unlock(&spool->lock);
}

uint64_t spool_scratch_bytes(const struct spool *spool)
{
	return spool ? spool->scratch_bytes : 0;
}
