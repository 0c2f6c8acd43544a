/* SPDX-License-Identifier: MIT */
#include "tools/bench/accuracy/resident.h"

#include <errno.h>
#include <stdlib.h>

#include "tools/bench/base/measure.h"

/** Payloads are read as validated ones are: aligned for whole vectors. */
#define PAYLOAD_ALIGNMENT 64u

static int payload_load(struct resident *resident, uint64_t index, void *scratch, struct why *why)
{
	const struct store_node *node = &resident->nodes[index];

	if (node->payload_id == 0)
		return 0;
	if (posix_memalign(&resident->payloads[index], PAYLOAD_ALIGNMENT, node->payload_bytes) != 0)
		return why_set(why, -ENOMEM, "no room for all payloads in memory");
	return store_read_payload(resident->file, node, resident->payloads[index], scratch, why);
}

int resident_open(struct resident *resident, const char *path, struct why *why)
{
	void *scratch = malloc(STORE_PAYLOAD_BYTES_MAX);
	int r;

	*resident = (struct resident){ 0 };
	r = store_open_path(path, &resident->file, why);
	if (r == 0) {
		resident->superblock = store_superblock(resident->file);
		resident->nodes =
			calloc(resident->superblock->node_count + 1, sizeof(*resident->nodes));
		resident->payloads =
			calloc(resident->superblock->node_count + 1, sizeof(*resident->payloads));
		if (!scratch || !resident->nodes || !resident->payloads)
			r = why_set(why, -ENOMEM, "out of memory");
	}
	if (r == 0)
		r = store_load_hs(resident->file, resident->nodes, why);
	for (uint64_t i = 0; r == 0 && i < resident->superblock->node_count; i++) {
		r = payload_load(resident, i, scratch, why);
		if (r == 0 && measure_was_cancelled())
			r = why_set(why, -ECANCELED, "interrupted");
	}
	free(scratch);
	if (r < 0)
		why_prefix(why, "%s", path);
	return r;
}

void resident_close(struct resident *resident)
{
	for (uint64_t i = 0; resident->payloads && i < resident->superblock->node_count; i++)
		free(resident->payloads[i]);
	free(resident->payloads);
	free(resident->nodes);
	store_close(resident->file);
}
