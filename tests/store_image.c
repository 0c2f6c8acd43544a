/* SPDX-License-Identifier: MIT */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <zstd.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "formats/store/store_checksum.h"
#include "formats/store/store_hs.h"
#include "formats/store/store_judge.h"
#include "tests/helper.h"
#include "tests/store_image.h"

void store_image_load(const char *path, struct store_image *ret)
{
	ret->bytes = test_file_read(path, &ret->size_bytes);
}

void store_image_save(const struct store_image *image, const char *path)
{
	test_file_write(path, image->bytes, image->size_bytes);
}

void store_image_done(struct store_image *image)
{
	free(image->bytes);
	memset(image, 0, sizeof(*image));
}

struct store_superblock *store_image_superblock(const struct store_image *image, uint32_t slot)
{
	return (void *)(image->bytes + (size_t)slot * STORE_BLOCK_BYTES);
}

struct store_node *store_image_nodes(const struct store_image *image)
{
	return (void *)(image->bytes + store_image_superblock(image, 0)->hs.file_offset);
}

void *store_image_payload(const struct store_image *image, uint32_t node)
{
	return image->bytes + store_image_nodes(image)[node].file_offset;
}

void store_image_seal_superblock(const struct store_image *image, uint32_t slot)
{
	struct store_superblock *superblock = store_image_superblock(image, slot);

	superblock->checksum =
		store_checksum(superblock, offsetof(struct store_superblock, checksum), slot);
}

/* As many records as lie in the HS's extent, whatever the superblock has been made to say. */
static uint64_t record_count(const struct store_superblock *superblock)
{
	uint64_t count = superblock->hs.stored_bytes / sizeof(struct store_node);

	while (count > 0 && store_hs_bytes(count) > superblock->hs.stored_bytes)
		count--;
	return count;
}

static bool is_inside(const struct store_image *image, uint64_t offset, uint64_t size_bytes)
{
	return offset <= image->size_bytes && size_bytes <= image->size_bytes - offset;
}

static void seal_hs(const struct store_image *image)
{
	struct store_superblock *superblock = store_image_superblock(image, 0);
	struct store_superblock true_superblock = *superblock;
	struct store_node *nodes = store_image_nodes(image);
	uint64_t *table;

	true_superblock.node_count = record_count(superblock);
	for (uint64_t i = 0; i < true_superblock.node_count; i++) {
		struct store_node *node = &nodes[i];

		if (node->payload_id != 0 &&
		    is_inside(image, node->file_offset, node->stored_bytes))
			node->payload_checksum =
				store_checksum(image->bytes + node->file_offset, node->stored_bytes,
					       node->payload_id);
	}
	table = (void *)(nodes + true_superblock.node_count);
	for (uint64_t i = 0; i < store_hs_block_count(true_superblock.node_count); i++)
		table[i] = store_hs_block_checksum(&true_superblock, nodes, i);
	superblock->hs.checksum = store_checksum(
		table, store_hs_block_count(true_superblock.node_count) * sizeof(*table),
		superblock->generation);
}

void store_image_seal(const struct store_image *image)
{
	struct store_superblock *superblock = store_image_superblock(image, 0);
	const struct store_extent *hs = &superblock->hs;
	struct store_extent *names = &superblock->names;

	if (hs->file_offset % STORE_BLOCK_BYTES == 0 &&
	    is_inside(image, hs->file_offset, hs->stored_bytes))
		seal_hs(image);
	if (is_inside(image, names->file_offset, names->stored_bytes))
		names->checksum = store_checksum(image->bytes + names->file_offset,
						 names->stored_bytes, superblock->generation);
	store_image_seal_superblock(image, 0);
}

void store_image_put_names(struct store_image *image, const void *names, size_t names_bytes)
{
	size_t offset = bytes_round_up(image->size_bytes, STORE_BLOCK_BYTES);
	size_t bound = ZSTD_compressBound(names_bytes);
	size_t size_bytes = bytes_round_up(offset + bound, STORE_BLOCK_BYTES);
	struct store_superblock *superblock;
	size_t stored_bytes;

	image->bytes = realloc(image->bytes, size_bytes);
	assert_non_null(image->bytes);
	memset(image->bytes + image->size_bytes, 0, size_bytes - image->size_bytes);
	image->size_bytes = size_bytes;
	stored_bytes = ZSTD_compress(image->bytes + offset, bound, names, names_bytes, 3);
	assert_false(ZSTD_isError(stored_bytes));
	superblock = store_image_superblock(image, 0);
	superblock->file_bytes = size_bytes;
	superblock->names = (struct store_extent){
		.file_offset = offset,
		.stored_bytes = stored_bytes,
		.raw_bytes = names_bytes,
		.checksum =
			store_checksum(image->bytes + offset, stored_bytes, superblock->generation),
	};
	store_image_seal(image);
}
