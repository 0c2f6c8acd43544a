/* SPDX-License-Identifier: MIT */
/*
 * The store's file as it is, by the two ways that need nothing else: mapped, and read through the page
 * cache; and the floor, a table of addresses.  The first two tell the kernel what a frame needs before
 * they read it, as madvise(2) and posix_fadvise(2) recommend.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/file.h"
#include "tools/bench/contest/contest.h"

#define PAGE_BYTES 4096u

struct files {
	const struct contest_config *config;
	int fd;
	uint8_t *map; /* the file; the table: all payloads, behind each other */
	uint64_t map_bytes;
	const uint8_t **addresses; /* of nodes: the table's */
	uint8_t *buffer;           /* pread */
	bool is_larger;            /* than memory: nothing stays where it was for long */
};

static void files_close(void *arg)
{
	struct files *self = arg;

	if (self->map)
		(void)munmap(self->map, self->map_bytes);
	(void)fd_close(self->fd);
	free(self->addresses);
	free(self->buffer);
	free(self);
}

static int files_open(const struct contest_config *config, struct files **ret, struct why *why)
{
	struct files *self = calloc(1, sizeof(*self));
	struct stat status;

	if (!self)
		return why_set(why, -ENOMEM, "out of memory");
	self->config = config;
	self->is_larger = config->limit_bytes > 0;
	self->fd = open(config->walk->store, O_RDONLY | O_CLOEXEC);
	if (self->fd < 0 || fstat(self->fd, &status) < 0) {
		int r = why_errno(why, -errno, "%s", config->walk->store);

		files_close(self);
		return r;
	}
	self->map_bytes = (uint64_t)status.st_size;
	*ret = self;
	return 0;
}

/* ---- mapped ---- */

static int file_map(struct files *self, struct why *why)
{
	self->map = mmap(NULL, self->map_bytes, PROT_READ, MAP_SHARED, self->fd, 0);
	if (self->map == MAP_FAILED) {
		self->map = NULL;
		return why_errno(why, -errno, "%s", self->config->walk->store);
	}
	return 0;
}

static int mmap_open(const struct contest_config *config, void **ret_self, struct why *why)
{
	struct files *self;
	int r = files_open(config, &self, why);

	if (r < 0)
		return r;
	r = file_map(self, why);
	if (r < 0)
		files_close(self);
	else
		*ret_self = self;
	return r;
}

static int mmap_frame(void *arg, const struct contest_frame *frame,
		      const struct contest_frame *next, struct contest_touch *touch,
		      struct why *why)
{
	struct files *self = arg;
	const struct store_node *nodes = self->config->walk->nodes;

	(void)why;
	/* Two system calls a node are not worth it where all is in memory after the first round. */
	for (size_t i = 0; next && self->is_larger && i < next->node_count; i++) {
		const struct store_node *node = &nodes[next->nodes[i]];

		(void)madvise(self->map + node->file_offset, node->stored_bytes, MADV_WILLNEED);
	}
	for (size_t i = 0; i < frame->node_count; i++) {
		const struct store_node *node = &nodes[frame->nodes[i]];

		contest_touch(touch, self->map + node->file_offset, node->payload_bytes);
	}
	return 0;
}

/* Pages that are mapped cannot be dropped. */
static int mmap_forget(void *arg, struct why *why)
{
	struct files *self = arg;

	(void)munmap(self->map, self->map_bytes);
	self->map = NULL;
	self->is_larger = true;
	contest_drop_file(self->fd);
	return file_map(self, why);
}

/* ---- read ---- */

static int pread_open(const struct contest_config *config, void **ret_self, struct why *why)
{
	struct files *self;
	int r = files_open(config, &self, why);

	if (r < 0)
		return r;
	self->buffer = aligned_alloc(PAGE_BYTES, STORE_PAYLOAD_BYTES_MAX);
	if (!self->buffer) {
		files_close(self);
		return why_set(why, -ENOMEM, "out of memory");
	}
	*ret_self = self;
	return 0;
}

static int pread_frame(void *arg, const struct contest_frame *frame,
		       const struct contest_frame *next, struct contest_touch *touch,
		       struct why *why)
{
	struct files *self = arg;
	const struct store_node *nodes = self->config->walk->nodes;

	for (size_t i = 0; next && self->is_larger && i < next->node_count; i++)
		(void)posix_fadvise(self->fd, (off_t)nodes[next->nodes[i]].file_offset,
				    nodes[next->nodes[i]].stored_bytes, POSIX_FADV_WILLNEED);
	for (size_t i = 0; i < frame->node_count; i++) {
		const struct store_node *node = &nodes[frame->nodes[i]];

		if (pread(self->fd, self->buffer, node->payload_bytes, (off_t)node->file_offset) !=
		    (ssize_t)node->payload_bytes)
			return why_set(why, -EIO, "%s: cannot be read", self->config->walk->store);
		contest_touch(touch, self->buffer, node->payload_bytes);
	}
	return 0;
}

static int pread_forget(void *arg, struct why *why)
{
	struct files *self = arg;

	(void)why;
	self->is_larger = true;
	contest_drop_file(self->fd);
	return 0;
}

/* ---- a table ---- */

static int table_fill(struct files *self, struct why *why)
{
	const struct contest_walk *walk = self->config->walk;
	uint64_t bytes = 0;

	for (size_t i = 0; i < walk->read_count; i++) {
		const struct store_node *node = &walk->nodes[walk->node_memory[i]];

		if (self->addresses[walk->node_memory[i]])
			continue;
		if (pread(self->fd, self->map + bytes, node->payload_bytes,
			  (off_t)node->file_offset) != (ssize_t)node->payload_bytes)
			return why_set(why, -EIO, "%s: cannot be read", walk->store);
		self->addresses[walk->node_memory[i]] = self->map + bytes;
		bytes += bytes_round_up(node->payload_bytes, PAGE_BYTES);
	}
	return 0;
}

static int table_open(const struct contest_config *config, void **ret_self, struct why *why)
{
	const struct contest_walk *walk = config->walk;
	struct files *self;
	int r = files_open(config, &self, why);

	if (r < 0)
		return r;
	self->map_bytes = walk->distinct_bytes + walk->superblock.node_count * PAGE_BYTES;
	self->map = mmap(NULL, self->map_bytes, PROT_READ | PROT_WRITE,
			 MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
	self->addresses = calloc(walk->superblock.node_count, sizeof(*self->addresses));
	if (self->map == MAP_FAILED || !self->addresses) {
		self->map = self->map == MAP_FAILED ? NULL : self->map;
		r = why_set(why, -ENOMEM, "out of memory");
	} else {
		(void)madvise(self->map, self->map_bytes, MADV_HUGEPAGE);
		r = table_fill(self, why);
	}
	if (r < 0)
		files_close(self);
	else
		*ret_self = self;
	return r;
}

static int table_frame(void *arg, const struct contest_frame *frame,
		       const struct contest_frame *next, struct contest_touch *touch,
		       struct why *why)
{
	const struct files *self = arg;
	const struct store_node *nodes = self->config->walk->nodes;

	(void)next;
	(void)why;
	for (size_t i = 0; i < frame->node_count; i++)
		contest_touch(touch, self->addresses[frame->nodes[i]],
			      nodes[frame->nodes[i]].payload_bytes);
	return 0;
}

const struct contestant contestant_mmap = { "mmap", mmap_open, mmap_frame, mmap_forget,
					    files_close };
const struct contestant contestant_pread = { "pread", pread_open, pread_frame, pread_forget,
					     files_close };
const struct contestant contestant_table = { "table", table_open, table_frame, NULL, files_close };
