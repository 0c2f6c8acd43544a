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
/** Segments that a warm pool has ready. */
#define WARM_SEGMENTS 4u

struct segment {
	uint8_t *memory;
	uint64_t live_bytes; /* of pieces that were not released */
};

/** A free segment: its first bytes link it to the next. */
struct free_segment {
	struct free_segment *next;
};

struct spool_pool {
	struct budget *budget;
	pthread_mutex_t lock; /* of all that follows */
	struct free_segment *free;
	unsigned free_count;
	bool drained;
	bool warm; /* is there a warmer, and shall it go on? */
	pthread_t warmer;
	pthread_cond_t taken; /* the warmer waits for it */
};

struct spool {
	struct spool_pool *pool;
	char *scratch_directory;
	pthread_mutex_t lock; /* of all that follows */
	struct segment *segments;
	size_t segment_count;
	size_t segment_max;
	size_t segment_used_bytes; /* of the last segment */
	int scratch_fd;
	uint64_t scratch_bytes;
};

/* ---- segments ---- */

int spool_pool_create(struct budget *budget, struct spool_pool **ret)
{
	struct spool_pool *pool = calloc(1, sizeof(*pool));

	if (!pool)
		return -ENOMEM;
	pool->budget = budget;
	(void)pthread_mutex_init(&pool->lock, NULL);
	(void)pthread_cond_init(&pool->taken, NULL);
	*ret = pool;
	return 0;
}

struct spool_pool *spool_pool_destroy(struct spool_pool *pool)
{
	if (!pool)
		return NULL;
	spool_pool_cool(pool);
	spool_pool_drain(pool);
	(void)pthread_cond_destroy(&pool->taken);
	(void)pthread_mutex_destroy(&pool->lock);
	free(pool);
	return NULL;
}

void spool_pool_drain(struct spool_pool *pool)
{
	(void)pthread_mutex_lock(&pool->lock);
	while (pool->free) {
		struct free_segment *segment = pool->free;

		pool->free = segment->next;
		pool->free_count--;
		(void)munmap(segment, SPOOL_SEGMENT_BYTES);
		budget_give(pool->budget, SPOOL_SEGMENT_BYTES);
	}
	pool->drained = true;
	(void)pthread_mutex_unlock(&pool->lock);
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

/* Returns: a segment, from the pool or new within the budget, or NULL. */
static uint8_t *segment_take(struct spool_pool *pool)
{
	struct free_segment *segment;
	uint8_t *memory;

	(void)pthread_mutex_lock(&pool->lock);
	segment = pool->free;
	if (segment) {
		pool->free = segment->next;
		pool->free_count--;
		(void)pthread_cond_signal(&pool->taken);
	}
	(void)pthread_mutex_unlock(&pool->lock);
	if (segment)
		return (uint8_t *)segment;
	if (!budget_take(pool->budget, SPOOL_SEGMENT_BYTES))
		return NULL;
	memory = segment_map();
	if (!memory)
		budget_give(pool->budget, SPOOL_SEGMENT_BYTES);
	return memory;
}

static void segment_give(struct spool_pool *pool, uint8_t *memory)
{
	struct free_segment *segment = (struct free_segment *)(void *)memory;

	(void)pthread_mutex_lock(&pool->lock);
	if (pool->drained) {
		(void)munmap(memory, SPOOL_SEGMENT_BYTES);
		budget_give(pool->budget, SPOOL_SEGMENT_BYTES);
	} else {
		segment->next = pool->free;
		pool->free = segment;
		pool->free_count++;
	}
	(void)pthread_mutex_unlock(&pool->lock);
}

static void *warm_segments(void *arg)
{
	const size_t page_bytes = (size_t)sysconf(_SC_PAGESIZE);
	struct spool_pool *pool = arg;
	bool spent = false;

	(void)pthread_mutex_lock(&pool->lock);
	while (pool->warm && !spent) {
		uint8_t *memory = NULL;

		if (pool->free_count >= WARM_SEGMENTS) {
			(void)pthread_cond_wait(&pool->taken, &pool->lock);
			continue;
		}
		(void)pthread_mutex_unlock(&pool->lock);
		if (budget_take(pool->budget, SPOOL_SEGMENT_BYTES)) {
			memory = segment_map();
			if (!memory)
				budget_give(pool->budget, SPOOL_SEGMENT_BYTES);
		}
		for (size_t at = 0; memory && at < SPOOL_SEGMENT_BYTES; at += page_bytes)
			*(volatile uint8_t *)(memory + at) = 0;
		if (memory)
			segment_give(pool, memory);
		spent = !memory;
		(void)pthread_mutex_lock(&pool->lock);
	}
	(void)pthread_mutex_unlock(&pool->lock);
	return NULL;
}

void spool_pool_warm(struct spool_pool *pool)
{
	(void)pthread_mutex_lock(&pool->lock);
	pool->warm = true;
	if (pthread_create(&pool->warmer, NULL, warm_segments, pool) != 0)
		pool->warm = false;
	(void)pthread_mutex_unlock(&pool->lock);
}

void spool_pool_cool(struct spool_pool *pool)
{
	bool warm;

	(void)pthread_mutex_lock(&pool->lock);
	warm = pool->warm;
	pool->warm = false;
	(void)pthread_cond_signal(&pool->taken);
	(void)pthread_mutex_unlock(&pool->lock);
	if (warm)
		(void)pthread_join(pool->warmer, NULL);
}

/* ---- spools ---- */

int spool_create(struct spool_pool *pool, const char *scratch_directory, struct spool **ret)
{
	struct spool *spool = calloc(1, sizeof(*spool));

	if (!spool)
		return -ENOMEM;
	spool->pool = pool;
	spool->scratch_fd = -1;
	(void)pthread_mutex_init(&spool->lock, NULL);
	/* As many as the budget has room for: the table never moves while others read it. */
	spool->segment_max = pool->budget->limit_bytes / SPOOL_SEGMENT_BYTES;
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
	segment_give(spool->pool, segment->memory);
	segment->memory = NULL;
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

/* A new last segment, if table and budget allow one.  The lock is held. */
static bool segment_add(struct spool *spool)
{
	struct segment *segment = &spool->segments[spool->segment_count];

	if (spool->segment_count == spool->segment_max)
		return false;
	segment->memory = segment_take(spool->pool);
	if (!segment->memory)
		return false;
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
	const struct iovec whole = { .iov_base = (void *)(uintptr_t)data, .iov_len = bytes };

	return spool_gather(spool, &whole, 1, ret_address, why);
}

int spool_gather(struct spool *spool, const struct iovec *parts, size_t part_count,
		 uint64_t *ret_address, struct why *why)
{
	uint64_t address = 0;
	uint64_t at;
	size_t bytes = 0;
	int r;

	for (size_t i = 0; i < part_count; i++)
		bytes += parts[i].iov_len;
	CHECK(bytes > 0 && bytes <= SPOOL_SEGMENT_BYTES);
	(void)pthread_mutex_lock(&spool->lock);
	r = reserve(spool, bytes, &address, why);
	(void)pthread_mutex_unlock(&spool->lock);
	if (r < 0)
		return r;
	at = address;
	for (size_t i = 0; i < part_count; i++) {
		if (!(address & ON_DISK))
			memcpy(memory_of(spool, at), parts[i].iov_base, parts[i].iov_len);
		else
			r = file_write_at(spool->scratch_fd, parts[i].iov_base, parts[i].iov_len,
					  at & ~ON_DISK);
		if (r < 0)
			return why_errno(why, r, "%s: cannot write scratch (--scratch DIR)",
					 spool->scratch_directory);
		at += parts[i].iov_len;
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
