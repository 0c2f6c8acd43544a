/* SPDX-License-Identifier: MIT */
#include <errno.h>
#include <fnmatch.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/log.h"
#include "tools/ctl/ctl.h"

int ctl_store_open(const char *path, struct ctl_store *ret)
{
	struct ctl_store store = { 0 };
	struct why why;
	int r;

	r = store_open_path(path, &store.file, &why);
	if (r < 0) {
		log_error("%s", why.text);
		return CTL_FAILED;
	}
	store.superblock = store_superblock(store.file);
	store.nodes = malloc(store.superblock->node_count * sizeof(*store.nodes));
	r = store.nodes ? store_load_hs(store.file, store.nodes, &why)
			: why_set(&why, -ENOMEM, "no memory for its HS");
	if (r == 0)
		r = store_load_names(store.file, &store.names, &why);
	if (r < 0) {
		log_error("%s: %s: `oocctl verify` names all that is damaged", path, why.text);
		ctl_store_close(&store);
		return CTL_FAILED;
	}
	*ret = store;
	return CTL_OK;
}

void ctl_store_close(struct ctl_store *store)
{
	store_names_done(&store->names);
	free(store->nodes);
	store->file = store_close(store->file);
	memset(store, 0, sizeof(*store));
}

bool ctl_part_matches(const struct store_names *names, uint64_t part_index, const char *pattern)
{
	const struct store_part *part = &names->parts[part_index];
	const struct store_section *section = &names->sections[part->section];

	return fnmatch(pattern, ctl_string(names, part->name), 0) == 0 ||
	       fnmatch(pattern, ctl_string(names, part->scene_path), 0) == 0 ||
	       fnmatch(pattern, ctl_string(names, section->name), 0) == 0;
}

int ctl_payload_init(struct ctl_payload *ret, const struct ctl_store *store)
{
	uint32_t stored_bytes_max = 1;

	for (uint64_t i = 0; i < store->superblock->node_count; i++)
		if (store->nodes[i].stored_bytes > stored_bytes_max)
			stored_bytes_max = store->nodes[i].stored_bytes;
	ret->decoded = malloc((size_t)store->superblock->payload_bytes_max + 1);
	ret->stored = malloc(stored_bytes_max);
	if (ret->decoded && ret->stored)
		return 0;
	log_error("no memory for a payload of %u bytes", store->superblock->payload_bytes_max);
	ctl_payload_done(ret);
	return -ENOMEM;
}

void ctl_payload_done(struct ctl_payload *payload)
{
	free(payload->decoded);
	free(payload->stored);
	memset(payload, 0, sizeof(*payload));
}
