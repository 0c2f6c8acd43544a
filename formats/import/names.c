/* SPDX-License-Identifier: MIT */
#include "formats/import/names.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "formats/base/clock.h"

#define SLOTS_MIN 64u

void names_init(struct names *names, uint64_t bytes_max)
{
	/* A seed that no file can foresee: its names cannot be made to collide. */
	*names = (struct names){ .seed = clock_now_ns(), .bytes_max = bytes_max };
}

void names_done(struct names *names)
{
	for (size_t i = 0; i < names->slot_count; i++)
		free(names->slots[i].name);
	free(names->slots);
	*names = (struct names){ 0 };
}

/* The slot that has the name, or the free one where it belongs. */
static struct name_slot *slot_of(const struct names *names, struct name_slot *slots,
				 size_t slot_count, const char *name)
{
	size_t index = XXH3_64bits_withSeed(name, strlen(name), names->seed) & (slot_count - 1);

	while (slots[index].name && strcmp(slots[index].name, name) != 0)
		index = (index + 1) & (slot_count - 1);
	return &slots[index];
}

static int names_grow(struct names *names)
{
	size_t slot_count = names->slot_count ? 2 * names->slot_count : SLOTS_MIN;
	struct name_slot *slots = calloc(slot_count, sizeof(*slots));

	if (!slots)
		return -ENOMEM;
	for (size_t i = 0; i < names->slot_count; i++)
		if (names->slots[i].name)
			*slot_of(names, slots, slot_count, names->slots[i].name) = names->slots[i];
	free(names->slots);
	names->slots = slots;
	names->slot_count = slot_count;
	return 0;
}

static const struct name_slot *find_slot(const struct names *names, const char *name)
{
	static const struct name_slot none;

	if (names->slot_count == 0)
		return &none;
	return slot_of(names, names->slots, names->slot_count, name);
}

uint32_t names_find(const struct names *names, const char *name)
{
	const struct name_slot *slot = find_slot(names, name);

	return slot->name ? slot->number : UINT32_MAX;
}

const char *names_text(const struct names *names, const char *name)
{
	return find_slot(names, name)->name;
}

int names_add(struct names *names, const char *name, uint32_t *ret_number, struct why *why)
{
	/* The slots that a name causes are counted with it. */
	uint64_t cost_bytes = strlen(name) + 1 + 4 * sizeof(struct name_slot);
	struct name_slot *slot;

	if (2 * (size_t)names->count >= names->slot_count && names_grow(names) < 0)
		return why_set(why, -ENOMEM, "no memory for its names");
	slot = slot_of(names, names->slots, names->slot_count, name);
	if (!slot->name) {
		if (names->bytes + cost_bytes > names->bytes_max)
			return why_set(why, -ENOMEM, "its %u names do not fit in memory",
				       names->count);
		slot->name = strdup(name);
		if (!slot->name)
			return why_set(why, -ENOMEM, "no memory for its names");
		slot->number = names->count++;
		names->bytes += cost_bytes;
	}
	*ret_number = slot->number;
	return 0;
}
