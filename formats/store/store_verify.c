/* SPDX-License-Identifier: MIT */
#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/file.h"
#include "formats/store/payload.h"
#include "formats/store/store_file.h"
#include "formats/store/store_hs.h"
#include "formats/store/store_judge.h"

/** What is known while a store is being read through. */
struct verify {
	const struct store_file *store;
	const struct store_superblock *superblock;
	struct store_node *nodes;
	bool *is_damaged;    /* of each node: its record cannot be relied on */
	uint32_t *by_offset; /* the nodes with payloads, in the order of the file */
	struct store_names names;
	void *payload; /* room for the largest payload, decoded and stored */
	void *stored;
	store_damage_fn damage;
	void *arg;
	struct store_verify_summary summary;
	bool something_is_damaged;
};

static bool is_damage(int error)
{
	return error == -EBADMSG || error == -EUCLEAN || error == -ENODATA || error == -EINVAL ||
	       error == -EIO;
}

/* Passes damage on; what is none (no memory, no right) ends the pass. */
static int report(struct verify *verify, uint32_t node_index, int error, const struct why *why)
{
	if (error == 0)
		return 0;
	if (!is_damage(error))
		return error;
	verify->something_is_damaged = true;
	if (node_index != STORE_NODE_NONE)
		verify->summary.nodes_damaged++;
	verify->damage(verify->arg, node_index, error, why);
	return 0;
}

/* ---- superblocks, HS, names ---- */

static int verify_superblocks(struct verify *verify)
{
	int fd = store_fd(verify->store);

	for (uint32_t slot = 0; slot < STORE_SUPERBLOCK_COUNT; slot++) {
		struct store_superblock block;
		struct why why;
		int r = store_read_superblock(fd, slot, &block, &why);

		verify->summary.bytes_read += sizeof(block);
		/* B has never been written while A is the first generation. */
		if (r == -EINVAL && slot == 1 && verify->superblock->generation == 1 &&
		    bytes_are_zero(&block, sizeof(block)))
			continue;
		r = report(verify, STORE_NODE_NONE, r, &why);
		if (r < 0)
			return r;
	}
	return 0;
}

/* The zeros between an extent's end and the end of its last block. */
static int verify_pad(const struct verify *verify, uint64_t file_offset, uint64_t stored_bytes,
		      struct why *why)
{
	uint8_t pad[STORE_BLOCK_BYTES];
	uint64_t end = file_offset + stored_bytes;
	size_t pad_bytes = bytes_round_up(end, STORE_BLOCK_BYTES) - end;
	int r = file_read_at(store_fd(verify->store), pad, pad_bytes, end);

	if (r < 0)
		return why_errno(why, r, "pad behind byte %llu: cannot be read",
				 (unsigned long long)end);
	if (!bytes_are_zero(pad, pad_bytes))
		return why_set(why, -EBADMSG, "pad behind byte %llu is not zero",
			       (unsigned long long)end);
	return 0;
}

static int verify_extent_pad(struct verify *verify, const struct store_extent *extent,
			     const char *name)
{
	struct why why;
	int r = verify_pad(verify, extent->file_offset, extent->stored_bytes, &why);

	if (r < 0)
		why_prefix(&why, "%s", name);
	verify->summary.bytes_read += bytes_round_up(extent->stored_bytes, STORE_BLOCK_BYTES);
	return report(verify, STORE_NODE_NONE, r, &why);
}

static void on_damaged_records(void *arg, uint32_t first, uint32_t count)
{
	struct verify *verify = arg;
	struct why why;

	memset(verify->is_damaged + first, true, count);
	why_set(&why, -EBADMSG, "HS: records %u to %u have a wrong checksum", first,
		first + count - 1);
	(void)report(verify, STORE_NODE_NONE, -EBADMSG, &why);
}

static int verify_hs(struct verify *verify)
{
	bool were_whole = !verify->something_is_damaged;
	struct why why;
	int r;

	r = store_hs_read(store_fd(verify->store), verify->superblock, verify->nodes,
			  on_damaged_records, verify, &why);
	if (r == 0) {
		r = store_judge_hs(verify->superblock, verify->nodes, &why);
	} else if (r == -EBADMSG && were_whole && verify->something_is_damaged) {
		/* Each block was told already. */
		r = 0;
	} else {
		/* Without its table, or unreadable, no record can be relied on. */
		memset(verify->is_damaged, true, verify->superblock->node_count);
	}
	r = report(verify, STORE_NODE_NONE, r, &why);
	return r < 0 ? r : verify_extent_pad(verify, &verify->superblock->hs, "HS");
}

static int verify_names(struct verify *verify)
{
	struct why why;
	int r = store_load_names(verify->store, &verify->names, &why);

	r = report(verify, STORE_NODE_NONE, r, &why);
	return r < 0 ? r : verify_extent_pad(verify, &verify->superblock->names, "names");
}

/* ---- payloads ---- */

static int verify_runs(const struct verify *verify, const struct payload_view *view,
		       struct why *why)
{
	const struct store_part *parts = verify->names.parts;

	for (uint32_t i = 0; i < view->header->run_count; i++) {
		const struct payload_run *run = &view->runs[i];

		if (run->part >= verify->superblock->part_count)
			return why_set(why, -EUCLEAN, "payload: run %u is of part %u of %llu", i,
				       run->part,
				       (unsigned long long)verify->superblock->part_count);
		if (parts && parts[run->part].section != run->section)
			return why_set(why, -EUCLEAN,
				       "payload: run %u is of another section than part %u", i,
				       run->part);
	}
	return 0;
}

static int verify_box(const struct store_node *node, const struct payload_view *view,
		      struct why *why)
{
	for (uint32_t i = 0; i < view->header->vertex_count; i++) {
		double position[3];

		payload_position(view, i, position);
		for (unsigned axis = 0; axis < 3; axis++)
			if (!(position[axis] >= (double)node->box_min[axis] &&
			      position[axis] <= (double)node->box_max[axis]))
				return why_set(why, -EUCLEAN,
					       "payload: vertex %u is outside the box", i);
	}
	return 0;
}

static int verify_payload(struct verify *verify, uint32_t node_index)
{
	const struct store_node *node = &verify->nodes[node_index];
	struct payload_view view;
	struct why why;
	int r;

	verify->summary.nodes_read++;
	verify->summary.bytes_read += bytes_round_up(node->stored_bytes, STORE_BLOCK_BYTES);
	r = store_read_payload(verify->store, node, verify->payload, verify->stored, &why);
	if (r == 0) {
		payload_view(verify->payload, &view);
		r = verify_runs(verify, &view, &why);
	}
	if (r == 0)
		r = verify_box(node, &view, &why);
	if (r == 0)
		r = verify_pad(verify, node->file_offset, node->stored_bytes, &why);
	return report(verify, node_index, r, &why);
}

static int compare_offsets(const void *a, const void *b, void *arg)
{
	const struct store_node *nodes = arg;
	uint64_t left = nodes[*(const uint32_t *)a].file_offset;
	uint64_t right = nodes[*(const uint32_t *)b].file_offset;

	return (left > right) - (left < right);
}

static int verify_payloads(struct verify *verify)
{
	uint64_t node_count = verify->superblock->node_count;
	uint32_t stored_bytes_max = 0;
	size_t count = 0;
	int r = 0;

	for (uint32_t i = 0; i < node_count; i++) {
		const struct store_node *node = &verify->nodes[i];

		if (verify->is_damaged[i] ||
		    store_judge_record(verify->superblock, verify->nodes, i, NULL) < 0 ||
		    node->payload_id == 0)
			continue;
		verify->by_offset[count++] = i;
		if (node->stored_bytes > stored_bytes_max)
			stored_bytes_max = node->stored_bytes;
	}
	/* Neighbours on the disk are read one after the other. */
	qsort_r(verify->by_offset, count, sizeof(*verify->by_offset), compare_offsets,
		verify->nodes);
	verify->payload = malloc(verify->superblock->payload_bytes_max);
	verify->stored = malloc(stored_bytes_max);
	if ((!verify->payload || !verify->stored) && count > 0)
		return -ENOMEM;
	for (size_t i = 0; i < count && r == 0; i++)
		r = verify_payload(verify, verify->by_offset[i]);
	return r;
}

/* ---- all ---- */

static int verify_store(struct verify *verify)
{
	uint64_t node_count = verify->superblock->node_count;
	int r;

	verify->nodes = malloc(node_count * sizeof(*verify->nodes));
	verify->is_damaged = calloc(node_count, sizeof(*verify->is_damaged));
	verify->by_offset = malloc(node_count * sizeof(*verify->by_offset));
	if (!verify->nodes || !verify->is_damaged || !verify->by_offset)
		return -ENOMEM;
	r = verify_superblocks(verify);
	if (r == 0)
		r = verify_names(verify);
	if (r == 0)
		r = verify_hs(verify);
	if (r == 0)
		r = verify_payloads(verify);
	return r;
}

int store_verify_path(const char *path, store_damage_fn damage, void *arg,
		      struct store_verify_summary *ret, struct why *why)
{
	struct verify verify = { .damage = damage, .arg = arg };
	struct store_file *store = NULL;
	struct why reason;
	AUTO_FD fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
	int r;

	if (fd < 0)
		return why_errno(why, -errno, "%s", path);
	r = store_open(fd, &store, &reason);
	if (r < 0) {
		why_set(why, r, "%s: %s", path, reason.text);
		r = report(&verify, STORE_NODE_NONE, r, &reason);
	} else {
		fd = -1;
		verify.store = store;
		verify.superblock = store_superblock(store);
		r = verify_store(&verify);
		if (r < 0)
			why_errno(why, r, "%s: cannot be verified", path);
	}
	store_names_done(&verify.names);
	free(verify.stored);
	free(verify.payload);
	free(verify.by_offset);
	free(verify.is_damaged);
	free(verify.nodes);
	store_close(store);
	if (r < 0)
		return r;
	*ret = verify.summary;
	if (verify.something_is_damaged)
		return why_set(why, -EBADMSG, "%s: is damaged", path);
	return 0;
}
