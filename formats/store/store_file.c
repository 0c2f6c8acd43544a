/* SPDX-License-Identifier: MIT */
#include "formats/store/store_file.h"

#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <zstd.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/base/file.h"
#include "formats/codec/codec.h"
#include "formats/store/payload.h"
#include "formats/store/store_checksum.h"
#include "formats/store/store_hs.h"
#include "formats/store/store_judge.h"

struct store_file {
	int fd;
	struct store_superblock superblock;
};

int store_read_superblock(int fd, uint32_t slot, struct store_superblock *ret, struct why *why)
{
	const char *name = slot == 0 ? "A" : "B";
	struct store_superblock block;
	int r;

	r = file_read_at(fd, &block, sizeof(block), (uint64_t)slot * STORE_BLOCK_BYTES);
	if (r < 0)
		return why_errno(why, r, "superblock %s: cannot be read", name);
	*ret = block;
	if (memcmp(block.magic, STORE_MAGIC, sizeof(block.magic)) != 0)
		return why_set(why, -EINVAL, "superblock %s: is none", name);
	if (store_checksum(&block, offsetof(struct store_superblock, checksum), slot) !=
	    block.checksum)
		return why_set(why, -EUCLEAN, "superblock %s: wrong checksum", name);
	/* Only now: a damaged version is damage, and no newer format. */
	if (block.version != STORE_VERSION)
		return why_set(why, -EPROTONOSUPPORT,
			       "format version %u; this program reads version %u", block.version,
			       STORE_VERSION);
	return 0;
}

/* Does a slot at least begin like a superblock?  Tells damaged stores from what never was one. */
static bool has_magic(int fd, uint32_t slot)
{
	uint8_t magic[sizeof(((struct store_superblock *)NULL)->magic)];

	return file_read_at(fd, magic, sizeof(magic), (uint64_t)slot * STORE_BLOCK_BYTES) == 0 &&
	       memcmp(magic, STORE_MAGIC, sizeof(magic)) == 0;
}

/* The valid superblock of the higher generation, or why there is none. */
static int pick_superblock(int fd, struct store_superblock *ret, struct why *why)
{
	struct store_superblock blocks[STORE_SUPERBLOCK_COUNT];
	struct why whys[STORE_SUPERBLOCK_COUNT];
	int results[STORE_SUPERBLOCK_COUNT];
	uint32_t slot;

	for (slot = 0; slot < STORE_SUPERBLOCK_COUNT; slot++)
		results[slot] = store_read_superblock(fd, slot, &blocks[slot], &whys[slot]);
	if (results[0] == 0 && results[1] == 0) {
		if (blocks[0].generation == blocks[1].generation)
			return why_set(why, -EUCLEAN, "both superblocks are of one generation");
		slot = blocks[0].generation > blocks[1].generation ? 0 : 1;
	} else {
		slot = results[0] == 0 ? 0 : 1;
	}
	if (results[slot] == 0) {
		*ret = blocks[slot];
		return 0;
	}
	if (!has_magic(fd, 0) && !has_magic(fd, 1))
		return why_set(why, -EINVAL, "is no store");
	/* Neither is whole.  The one that was meant to be has the better reason. */
	slot = has_magic(fd, 0) ? 0 : 1;
	if (why)
		*why = whys[slot];
	return results[slot];
}

int store_open(int fd, struct store_file **ret, struct why *why)
{
	struct store_file *store;
	struct stat status;
	int r;

	if (fstat(fd, &status) < 0)
		return why_errno(why, -errno, "cannot be examined");
	if (!S_ISREG(status.st_mode))
		return why_set(why, -EINVAL, "is no regular file");
	if (status.st_size == 0)
		return why_set(why, -EINVAL, "is empty and no store");
	store = calloc(1, sizeof(*store));
	if (!store)
		return why_set(why, -ENOMEM, "no memory");
	store->fd = -1;
	r = pick_superblock(fd, &store->superblock, why);
	if (r == 0 && store->superblock.file_bytes > (uint64_t)status.st_size)
		r = why_set(why, -ENODATA, "has %lld bytes of %llu: it was cut off",
			    (long long)status.st_size,
			    (unsigned long long)store->superblock.file_bytes);
	if (r == 0)
		r = store_judge_superblock(&store->superblock, why);
	if (r < 0) {
		store_close(store);
		return r;
	}
	store->fd = fd;
	*ret = store;
	return 0;
}

int store_open_path(const char *path, struct store_file **ret, struct why *why)
{
	/* O_NONBLOCK: opening a FIFO must not wait for a writer; it means nothing to a file. */
	int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
	int r;

	if (fd < 0)
		return why_errno(why, -errno, "%s", path);
	r = store_open(fd, ret, why);
	if (r < 0) {
		fd = fd_close(fd);
		why_prefix(why, "%s", path);
	}
	return r;
}

struct store_file *store_close(struct store_file *store)
{
	if (!store)
		return NULL;
	store->fd = fd_close(store->fd);
	free(store);
	return NULL;
}

int store_fd(const struct store_file *store)
{
	return store->fd;
}

const struct store_superblock *store_superblock(const struct store_file *store)
{
	return &store->superblock;
}

int store_load_hs(const struct store_file *store, struct store_node *nodes, struct why *why)
{
	int r = store_hs_read(store->fd, &store->superblock, nodes, NULL, NULL, why);

	return r < 0 ? r : store_judge_hs(&store->superblock, nodes, why);
}

/* ---- names ---- */

static int read_names(const struct store_file *store, void *stored, void *decoded, struct why *why)
{
	const struct store_extent *extent = &store->superblock.names;
	size_t n;
	int r;

	r = file_read_at(store->fd, stored, extent->stored_bytes, extent->file_offset);
	if (r < 0)
		return why_errno(why, r, "names: cannot be read");
	if (store_checksum(stored, extent->stored_bytes, store->superblock.generation) !=
	    extent->checksum)
		return why_set(why, -EBADMSG, "names: wrong checksum");
	n = ZSTD_decompress(decoded, extent->raw_bytes, stored, extent->stored_bytes);
	if (ZSTD_isError(n))
		return why_set(why, -EUCLEAN, "names: zstd: %s", ZSTD_getErrorName(n));
	if (n != extent->raw_bytes)
		return why_set(why, -EUCLEAN, "names: %zu bytes of %llu", n,
			       (unsigned long long)extent->raw_bytes);
	return store_judge_names(&store->superblock, decoded, n, why);
}

int store_load_names(const struct store_file *store, struct store_names *ret, struct why *why)
{
	const struct store_extent *extent = &store->superblock.names;
	/* Pages that no decoded byte reaches are never touched, so a false length costs nothing. */
	uint8_t *decoded = malloc(extent->raw_bytes);
	void *stored = malloc(extent->stored_bytes);
	int r;

	if (decoded && stored)
		r = read_names(store, stored, decoded, why);
	else
		r = why_set(why, -ENOMEM, "no memory for the names");
	free(stored);
	if (r < 0) {
		free(decoded);
		return r;
	}
	ret->memory = decoded;
	ret->header = (const void *)decoded;
	ret->sections = (const void *)(ret->header + 1);
	ret->sources = (const void *)(ret->sections + ret->header->section_count);
	ret->parts = (const void *)(ret->sources + ret->header->source_count);
	ret->strings = (const void *)(ret->parts + ret->header->part_count);
	return 0;
}

void store_names_done(struct store_names *names)
{
	free(names->memory);
	memset(names, 0, sizeof(*names));
}

/* ---- payloads ---- */

static int decode_payload(const struct store_node *node, const void *stored, void *payload,
			  struct why *why)
{
	struct codec_scratch *scratch;
	int r;

	r = codec_scratch_create(&scratch);
	if (r < 0)
		return why_set(why, r, "no memory to decode");
	r = codec_decode(scratch, node->codec, stored, node->stored_bytes, payload,
			 node->payload_bytes, why);
	codec_scratch_destroy(scratch);
	return r;
}

int store_read_payload(const struct store_file *store, const struct store_node *node, void *payload,
		       void *scratch, struct why *why)
{
	void *stored = node->codec == STORE_CODEC_NONE ? payload : scratch;
	int r;

	CHECK(node->payload_id != 0);
	r = file_read_at(store->fd, stored, node->stored_bytes, node->file_offset);
	if (r < 0)
		return why_errno(why, r, "payload: cannot be read");
	if (store_checksum(stored, node->stored_bytes, node->payload_id) != node->payload_checksum)
		return why_set(why, -EBADMSG, "payload: wrong checksum");
	if (node->codec != STORE_CODEC_NONE) {
		r = decode_payload(node, stored, payload, why);
		if (r < 0)
			return r;
	}
	return payload_validate(payload, node->payload_bytes, node, why);
}
