/* SPDX-License-Identifier: MIT */
#include "formats/store/store_hs.h"

#include <errno.h>
#include <stdlib.h>

#include "formats/base/bytes.h"
#include "formats/base/file.h"
#include "formats/store/store_checksum.h"
#include "formats/store/store_judge.h"

uint64_t store_hs_block_checksum(const struct store_superblock *superblock,
				 const struct store_node *nodes, uint64_t block)
{
	uint64_t first = block * STORE_HS_BLOCK_NODES;
	uint64_t count = u64_min(STORE_HS_BLOCK_NODES, superblock->node_count - first);

	return store_checksum(nodes + first, count * sizeof(*nodes),
			      store_hs_seed(superblock->generation, block));
}

static int compare_blocks(const struct store_superblock *superblock, const struct store_node *nodes,
			  const uint64_t *table, store_hs_damage_fn damage, void *arg,
			  struct why *why)
{
	int r = 0;

	for (uint64_t block = 0; block < store_hs_block_count(superblock->node_count); block++) {
		uint64_t first = block * STORE_HS_BLOCK_NODES;
		uint64_t count = u64_min(STORE_HS_BLOCK_NODES, superblock->node_count - first);

		if (store_hs_block_checksum(superblock, nodes, block) == table[block])
			continue;
		r = why_set(why, -EBADMSG, "HS: records %llu to %llu have a wrong checksum",
			    (unsigned long long)first, (unsigned long long)(first + count - 1));
		if (!damage)
			return r;
		damage(arg, (uint32_t)first, (uint32_t)count);
	}
	return r;
}

int store_hs_read(int fd, const struct store_superblock *superblock, struct store_node *nodes,
		  store_hs_damage_fn damage, void *arg, struct why *why)
{
	const struct store_extent *hs = &superblock->hs;
	size_t records_bytes = superblock->node_count * sizeof(*nodes);
	size_t table_bytes = hs->stored_bytes - records_bytes;
	uint64_t *table = malloc(table_bytes);
	int r;

	if (!table)
		return why_set(why, -ENOMEM, "no memory for the HS's checksums");
	r = file_read_at(fd, table, table_bytes, hs->file_offset + records_bytes);
	if (r == 0)
		r = file_read_at(fd, nodes, records_bytes, hs->file_offset);
	if (r < 0)
		why_errno(why, r, "HS: cannot be read");
	else if (store_checksum(table, table_bytes, superblock->generation) != hs->checksum)
		r = why_set(why, -EBADMSG, "HS: the table of checksums has a wrong checksum");
	else
		r = compare_blocks(superblock, nodes, table, damage, arg, why);
	free(table);
	return r;
}
