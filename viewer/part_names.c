/* SPDX-License-Identifier: MIT */
#include "viewer/part_names.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

void part_names_done(struct part_names *names)
{
	if (names->store_names.memory)
		store_names_done(&names->store_names);
	memset(names, 0, sizeof(*names));
}

static int read_names(struct part_names *names, const char *store_path, struct why *why)
{
	struct store_file *store;
	int r = store_open_path(store_path, &store, why);

	if (r < 0)
		return r;
	r = store_load_names(store, &names->store_names, why);
	store_close(store);
	return r;
}

int part_names_describe(struct part_names *names, const char *store_path, uint32_t part,
			char *ret_line, size_t line_bytes, struct why *why)
{
	const struct store_names *all = &names->store_names;
	const struct store_part *found;
	const struct store_section *section;
	const char *scene_path;
	const char *material;
	int r;

	if (!all->memory) {
		r = read_names(names, store_path, why);
		if (r < 0)
			return r;
	}
	/* The file may have been replaced since the daemon opened it. */
	if (part >= all->header->part_count)
		return why_set(why, -ENOENT, "%s: it has no part %u", store_path, part);
	found = &all->parts[part];
	section = &all->sections[found->section];
	scene_path = all->strings + found->scene_path;
	material = all->strings + found->material;
	(void)snprintf(ret_line, line_bytes, "%s%s%s  %s%s%s", all->strings + found->name,
		       scene_path[0] ? "  " : "", scene_path, all->strings + section->name,
		       material[0] ? "  material " : "", material);
	return 0;
}
