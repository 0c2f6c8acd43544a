/* SPDX-License-Identifier: MIT */
#include "daemon/cache/served.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include "daemon/limits.h"
#include "formats/base/check.h"
#include "formats/base/file.h"
#include "formats/store/store_file.h"

int served_identify(int fd, dev_t *ret_device, ino_t *ret_inode, struct why *why)
{
	struct stat status;
	int flags = fcntl(fd, F_GETFL);

	if (flags < 0 || fstat(fd, &status) < 0)
		return why_errno(why, -errno, "the descriptor of the store");
	if (!S_ISREG(status.st_mode))
		return why_set(why, -EINVAL, "not a regular file");
	if (flags & O_PATH || (flags & O_ACCMODE) == O_WRONLY)
		return why_set(why, -EACCES, "not open for reading");
	*ret_device = status.st_dev;
	*ret_inode = status.st_ino;
	return 0;
}

bool served_is_current(int fd, const uint8_t uuid[16], uint64_t generation)
{
	struct store_file *store;
	bool current;

	fd = fcntl(fd, F_DUPFD_CLOEXEC, 3);
	if (fd < 0)
		return false;
	if (store_open(fd, &store, NULL) < 0) {
		(void)fd_close(fd);
		return false;
	}
	current = memcmp(store_superblock(store)->uuid, uuid, 16) == 0 &&
		  store_superblock(store)->generation == generation;
	store_close(store);
	return current;
}

static uint64_t power_of_two_up(uint64_t value)
{
	return value <= 1 ? 1 : UINT64_C(1) << (64 - __builtin_clzll(value - 1));
}

static uint64_t power_of_two_down(uint64_t value)
{
	return UINT64_C(1) << (63 - __builtin_clzll(value | 1));
}

/*
 * A sixteenth of the cache, so that several stores can share it; where payloads are large for that,
 * up to a quarter, so that what is left over at a segment's end is little of it; not above what is
 * usual unless the cache is so large that the table of buffers would run out; not above what the
 * store can ever fill; and never below its largest payload, which lies in one segment.
 */
int served_segment_bytes(const struct store_superblock *superblock, uint64_t cache_bytes,
			 uint64_t *ret, struct why *why)
{
	uint64_t largest_bytes = power_of_two_up(
		bytes_round_up(u64_max(superblock->payload_bytes_max, 1), WIRE_PAGE_BYTES));
	uint64_t page_pad_bytes;
	uint64_t store_bytes;
	uint64_t bytes;

	/* What the payloads take when each is rounded up to pages. */
	if (__builtin_mul_overflow(superblock->node_count, (uint64_t)WIRE_PAGE_BYTES,
				   &page_pad_bytes) ||
	    __builtin_add_overflow(superblock->payload_raw_bytes, page_pad_bytes, &store_bytes))
		store_bytes = UINT64_MAX;
	bytes = u64_min(8 * largest_bytes, power_of_two_down(cache_bytes / 4));
	bytes = u64_max(bytes, power_of_two_down(cache_bytes / 16));
	bytes = u64_min(bytes, SEGMENT_BYTES_USUAL);
	bytes = u64_max(bytes, power_of_two_up(cache_bytes / SEGMENT_COUNT_MAX));
	if (store_bytes < bytes)
		bytes = power_of_two_up(store_bytes);
	bytes = u64_max(bytes, SEGMENT_BYTES_MIN);
	bytes = u64_max(bytes, largest_bytes);
	bytes = u64_min(bytes, SEGMENT_BYTES_MAX);
	if (bytes > cache_bytes)
		return why_set(
			why, -ENOBUFS,
			"the cache of %llu bytes cannot hold its largest payload: start oocd "
			"with --cache-size %lluK or more",
			(unsigned long long)cache_bytes, (unsigned long long)(bytes / KIB));
	*ret = bytes;
	return 0;
}

static int load_hs(struct served *served, const struct store_file *store, struct why *why)
{
	const struct store_superblock *superblock = store_superblock(store);
	uint64_t records_bytes = superblock->node_count * sizeof(struct store_node);
	uint8_t *base;
	int r;

	r = memfile_create("oocd-hs", sizeof(*superblock) + records_bytes, false, &served->hs, why);
	if (r < 0)
		return r;
	base = served->hs.base;
	memcpy(base, superblock, sizeof(*superblock));
	r = store_load_hs(store, (struct store_node *)(void *)(base + sizeof(*superblock)), why);
	if (r < 0)
		return r;
	r = memfile_publish(&served->hs, MEMFILE_FIXED, why);
	if (r < 0)
		return r;
	base = served->hs.base;
	served->superblock = (const struct store_superblock *)(void *)base;
	served->records = (const struct store_node *)(void *)(base + sizeof(*superblock));
	served->node_count = (uint32_t)superblock->node_count;
	return 0;
}

static int make_directory(struct served *served, uint64_t epoch, struct why *why)
{
	uint64_t bytes =
		sizeof(struct wire_directory) + served->node_count * sizeof(_Atomic uint64_t);
	int r;

	r = memfile_create("oocd-directory", bytes, false, &served->directory_file, why);
	if (r < 0)
		return r;
	/* Zeros say ABSENT. */
	served->directory = served->directory_file.base;
	served->directory->generation = served->superblock->generation;
	served->directory->node_count = served->node_count;
	atomic_init(&served->directory->epoch, epoch);
	return memfile_publish(&served->directory_file, MEMFILE_CHANGING, why);
}

static int make_ledger(struct served *served, uint64_t segment_bytes, struct why *why)
{
	struct ledger_header header = {
		.device = served->device,
		.inode = served->inode,
		.generation = served->superblock->generation,
		.node_count = served->node_count,
		.segment_bytes = segment_bytes,
	};

	memcpy(header.uuid, served->superblock->uuid, sizeof(header.uuid));
	memcpy(header.path, served->path, sizeof(header.path));
	if (getrandom(&served->key, sizeof(served->key), 0) != sizeof(served->key))
		return why_errno(why, -errno, "a random number");
	return ledger_create(&header, &served->ledger, why);
}

int served_inherit(struct served *served, struct ledger *ledger, uint64_t key, uint64_t cache_bytes,
		   struct why *why)
{
	const struct ledger_header *header = ledger->header;
	uint64_t segment_bytes = header->segment_bytes;

	if (header->device != served->device || header->inode != served->inode ||
	    header->generation != served->superblock->generation ||
	    memcmp(header->uuid, served->superblock->uuid, sizeof(header->uuid)) != 0 ||
	    header->node_count != served->node_count)
		return why_set(why, -ESTALE, "it has been written anew since");
	if (segment_bytes < WIRE_PAGE_BYTES || segment_bytes > SEGMENT_BYTES_MAX ||
	    (segment_bytes & (segment_bytes - 1)) != 0 ||
	    segment_bytes < served->superblock->payload_bytes_max || segment_bytes > cache_bytes)
		return why_set(why, -ENOBUFS, "its memory does not fit into the cache");
	arena_init(&served->arena, segment_bytes);
	ledger_done(&served->ledger);
	served->ledger = *ledger;
	*ledger = LEDGER_NONE;
	served->key = key;
	return 0;
}

/*
 * A description of the file that reads past the page cache.  Opened anew through /proc where the
 * daemon's own user may open the file.  Where only the client could, its own description is
 * switched, which harms nobody: the client that passed it has no other use for it, and if it
 * switches back, reads are buffered.  Where neither works (the file system has no O_DIRECT) reads
 * are buffered, too.
 */
static int open_direct(int fd, bool *ret_direct)
{
	char path[32];
	int direct_fd;
	int flags;

	(void)snprintf(path, sizeof(path), "/proc/self/fd/%d", fd);
	direct_fd = open(path, O_RDONLY | O_DIRECT | O_CLOEXEC | O_NOCTTY);
	*ret_direct = direct_fd >= 0;
	if (direct_fd >= 0)
		return direct_fd;
	direct_fd = fcntl(fd, F_DUPFD_CLOEXEC, 3);
	if (direct_fd < 0)
		return -errno;
	flags = fcntl(direct_fd, F_GETFL);
	*ret_direct = flags >= 0 && fcntl(direct_fd, F_SETFL, flags | O_DIRECT) == 0;
	return direct_fd;
}

static int load(struct served *served, const struct store_file *store, uint64_t cache_bytes,
		uint64_t epoch, struct why *why)
{
	uint64_t segment_bytes = 0;
	int r;

	r = served_identify(store_fd(store), &served->device, &served->inode, why);
	if (r == 0)
		r = served_segment_bytes(store_superblock(store), cache_bytes, &segment_bytes, why);
	if (r == 0)
		r = load_hs(served, store, why);
	if (r == 0)
		r = make_directory(served, epoch, why);
	if (r < 0)
		return r;
	arena_init(&served->arena, segment_bytes);
	r = make_ledger(served, segment_bytes, why);
	if (r < 0)
		return r;
	served->nodes = calloc(served->node_count, sizeof(*served->nodes));
	if (!served->nodes)
		return why_errno(why, -ENOMEM, "states of %u nodes", served->node_count);
	for (uint32_t i = 0; i < served->node_count; i++)
		node_init(&served->nodes[i], served->records[i].payload_bytes);
	/* Last: from here on the client's description may be O_DIRECT. */
	served->fd = open_direct(store_fd(store), &served->direct);
	return served->fd < 0 ? why_errno(why, served->fd, "the store's descriptor") : 0;
}

int served_open(int fd, const char *path, uint64_t cache_bytes, uint64_t epoch, struct served **ret,
		struct why *why)
{
	struct store_file *store = NULL;
	struct served *served;
	int r;

	served = calloc(1, sizeof(*served));
	if (!served) {
		(void)fd_close(fd);
		return why_errno(why, -ENOMEM, "opening a store");
	}
	list_init(&served->link);
	list_init(&served->lru);
	list_init(&served->arena.in_order);
	served->hs = MEMFILE_NONE;
	served->directory_file = MEMFILE_NONE;
	served->ledger = LEDGER_NONE;
	served->fd = -1;
	(void)snprintf(served->path, sizeof(served->path), "%s", path);
	r = store_open(fd, &store, why);
	if (r < 0) {
		(void)fd_close(fd);
		served_close(served);
		return r;
	}
	r = load(served, store, cache_bytes, epoch, why);
	store_close(store);
	if (r < 0) {
		served_close(served);
		return r;
	}
	*ret = served;
	return 0;
}

struct served *served_close(struct served *served)
{
	if (!served)
		return NULL;
	CHECK(served->attach_count == 0);
	arena_done(&served->arena);
	ledger_done(&served->ledger);
	memfile_done(&served->directory_file);
	memfile_done(&served->hs);
	(void)fd_close(served->fd);
	replacement_destroy(served->replacement);
	free(served->nodes);
	free(served);
	return NULL;
}
