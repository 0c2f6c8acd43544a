/* SPDX-License-Identifier: MIT */
#include "tools/build/labels.h"

#include <errno.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "formats/base/bytes.h"

#define SLOTS_MIN 64u
#define PARTS_MAX (UINT32_C(1) << 31)

/* ---- strings ---- */

static int strings_rehash(struct strings *strings)
{
	uint64_t slot_count = u64_max(strings->slot_count * 2, SLOTS_MIN);
	uint64_t *slots = calloc(slot_count, sizeof(*slots));

	if (!slots)
		return -ENOMEM;
	for (uint64_t i = 0; i < strings->slot_count; i++) {
		const char *text;
		uint64_t slot;

		if (strings->slots[i] == 0)
			continue;
		text = strings->bytes + strings->slots[i] - 1;
		slot = XXH3_64bits(text, strlen(text)) & (slot_count - 1);
		while (slots[slot] != 0)
			slot = (slot + 1) & (slot_count - 1);
		slots[slot] = strings->slots[i];
	}
	free(strings->slots);
	strings->slots = slots;
	strings->slot_count = slot_count;
	return 0;
}

static int strings_append(struct strings *strings, const char *text, size_t length)
{
	if (strings->byte_count + length + 1 > strings->byte_max) {
		uint64_t byte_max =
			u64_max(strings->byte_max * 2, strings->byte_count + length + 1);
		char *bytes = realloc(strings->bytes, byte_max);

		if (!bytes)
			return -ENOMEM;
		strings->bytes = bytes;
		strings->byte_max = byte_max;
	}
	memcpy(strings->bytes + strings->byte_count, text, length + 1);
	strings->byte_count += length + 1;
	return 0;
}

/* Finds or adds a string.  The empty one, at offset 0, comes first into every table. */
static int strings_intern(struct strings *strings, const char *text, uint64_t *ret_offset)
{
	size_t length = strlen(text);
	uint64_t slot;
	int r = 0;

	if (strings->byte_count == 0)
		r = strings_append(strings, "", 0);
	if (r == 0 && (strings->used_count + 1) * 2 > strings->slot_count)
		r = strings_rehash(strings);
	if (r < 0)
		return r;
	if (length == 0) {
		*ret_offset = 0;
		return 0;
	}
	slot = XXH3_64bits(text, length) & (strings->slot_count - 1);
	while (strings->slots[slot] != 0) {
		uint64_t offset = strings->slots[slot] - 1;

		if (strcmp(strings->bytes + offset, text) == 0) {
			*ret_offset = offset;
			return 0;
		}
		slot = (slot + 1) & (strings->slot_count - 1);
	}
	*ret_offset = strings->byte_count;
	r = strings_append(strings, text, length);
	if (r < 0)
		return r;
	strings->slots[slot] = *ret_offset + 1;
	strings->used_count++;
	return 0;
}

static void strings_seal(struct strings *strings)
{
	free(strings->slots);
	strings->slots = NULL;
	strings->slot_count = 0;
}

static void strings_done(struct strings *strings)
{
	strings_seal(strings);
	free(strings->bytes);
	*strings = (struct strings){ 0 };
}

/* ---- parts of a file ---- */

static bool entries_equal(const struct part_entry *a, const struct part_entry *b)
{
	return a->name == b->name && a->scene_path == b->scene_path && a->material == b->material &&
	       a->colour == b->colour;
}

static uint32_t entry_slot(const struct part_list *list, const struct part_entry *entry)
{
	const uint64_t words[] = { entry->name, entry->scene_path, entry->material, entry->colour };

	return (uint32_t)XXH3_64bits(words, sizeof(words)) & (list->slot_count - 1);
}

static int part_list_grow(struct part_list *list)
{
	uint32_t entry_max = list->entry_max == 0 ? SLOTS_MIN / 2 : list->entry_max * 2;
	uint32_t slot_count = entry_max * 2;
	struct part_entry *entries;
	uint32_t *slots;

	entries = reallocarray(list->entries, entry_max, sizeof(*entries));
	if (!entries)
		return -ENOMEM;
	list->entries = entries;
	slots = calloc(slot_count, sizeof(*slots));
	if (!slots)
		return -ENOMEM;
	free(list->slots);
	list->slots = slots;
	list->slot_count = slot_count;
	list->entry_max = entry_max;
	for (uint32_t i = 0; i < list->entry_count; i++) {
		uint32_t slot = entry_slot(list, &list->entries[i]);

		while (slots[slot] != 0)
			slot = (slot + 1) & (slot_count - 1);
		slots[slot] = i + 1;
	}
	return 0;
}

int part_list_add(struct part_list *list, const struct import_part *part, uint32_t *ret_entry)
{
	struct part_entry entry = { .colour = part->colour };
	uint32_t slot;
	int r;

	r = strings_intern(&list->strings, part->name, &entry.name);
	if (r == 0)
		r = strings_intern(&list->strings, part->scene_path, &entry.scene_path);
	if (r == 0)
		r = strings_intern(&list->strings, part->material, &entry.material);
	if (r == 0 && list->entry_count == PARTS_MAX)
		r = -EOVERFLOW;
	if (r == 0 && list->entry_count == list->entry_max)
		r = part_list_grow(list);
	if (r < 0)
		return r;
	slot = entry_slot(list, &entry);
	while (list->slots[slot] != 0) {
		if (entries_equal(&list->entries[list->slots[slot] - 1], &entry)) {
			*ret_entry = list->slots[slot] - 1;
			return 0;
		}
		slot = (slot + 1) & (list->slot_count - 1);
	}
	list->entries[list->entry_count] = entry;
	*ret_entry = list->entry_count++;
	list->slots[slot] = list->entry_count;
	return 0;
}

void part_list_seal(struct part_list *list)
{
	strings_seal(&list->strings);
	free(list->slots);
	list->slots = NULL;
	list->slot_count = 0;
}

void part_list_done(struct part_list *list)
{
	strings_done(&list->strings);
	free(list->entries);
	free(list->slots);
	*list = (struct part_list){ 0 };
}

/* ---- all files together ---- */

/* Which source has a path.  A scene list names its files again and again. */
struct source_map {
	uint64_t *slots; /* of a hash table: source + 1 */
	uint64_t slot_count;
};

static int join_source(struct labels *labels, struct source_map *map,
		       const struct import_input *input, struct store_section *section)
{
	uint64_t path;
	uint64_t slot;
	int r = strings_intern(&labels->strings, input->path, &path);

	if (r < 0)
		return r;
	slot = XXH3_64bits(&path, sizeof(path)) & (map->slot_count - 1);
	while (map->slots[slot] != 0 && labels->sources[map->slots[slot] - 1].path != path)
		slot = (slot + 1) & (map->slot_count - 1);
	if (map->slots[slot] == 0) {
		labels->sources[labels->source_count].path = path;
		map->slots[slot] = ++labels->source_count;
	}
	section->source = map->slots[slot] - 1;
	return 0;
}

static int join_parts(struct labels *labels, struct part_list *list, uint32_t section_index)
{
	for (uint32_t i = 0; i < list->entry_count; i++) {
		const struct part_entry *entry = &list->entries[i];
		const char *bytes = list->strings.bytes;
		struct store_part part = { .section = section_index, .colour = entry->colour };
		int r = strings_intern(&labels->strings, bytes + entry->name, &part.name);

		if (r == 0)
			r = strings_intern(&labels->strings, bytes + entry->scene_path,
					   &part.scene_path);
		if (r == 0)
			r = strings_intern(&labels->strings, bytes + entry->material,
					   &part.material);
		if (r < 0)
			return r;
		labels->parts[labels->part_count++] = part;
	}
	return 0;
}

static int join_section(struct labels *labels, struct source_map *map,
			const struct import_input *input, struct part_list *list)
{
	static const double identity[12] = { 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0 };
	struct store_section *section = &labels->sections[labels->section_count];
	int r = join_source(labels, map, input, section);

	if (r == 0)
		r = strings_intern(&labels->strings, input->name, &section->name);
	if (r < 0)
		return r;
	section->first_part = labels->part_count;
	section->part_count = list->entry_count;
	memcpy(section->placement, input->placed ? input->placement : identity,
	       sizeof(section->placement));
	r = join_parts(labels, list, (uint32_t)labels->section_count);
	labels->section_count++;
	part_list_done(list);
	return r;
}

int labels_join(struct labels *labels, const struct import_inputs *inputs, struct part_list *lists,
		struct why *why)
{
	struct source_map map = { .slot_count = SLOTS_MIN };
	uint64_t part_count = 0;
	uint64_t ignored;
	int r;

	for (size_t i = 0; i < inputs->input_count; i++)
		part_count += lists[i].entry_count;
	if (part_count > PARTS_MAX || inputs->input_count > PARTS_MAX)
		return why_set(why, -EOVERFLOW, "%llu parts are too many for one store",
			       (unsigned long long)part_count);
	while (map.slot_count < inputs->input_count * 2)
		map.slot_count *= 2;
	map.slots = calloc(map.slot_count, sizeof(*map.slots));
	labels->sections = calloc(inputs->input_count + 1, sizeof(*labels->sections));
	labels->sources = calloc(inputs->input_count + 1, sizeof(*labels->sources));
	labels->parts = calloc(part_count + 1, sizeof(*labels->parts));
	r = map.slots && labels->sections && labels->sources && labels->parts ? 0 : -ENOMEM;
	/* Even a table without a name has the empty string. */
	if (r == 0)
		r = strings_intern(&labels->strings, "", &ignored);
	for (size_t i = 0; i < inputs->input_count && r == 0; i++)
		r = join_section(labels, &map, &inputs->inputs[i], &lists[i]);
	strings_seal(&labels->strings);
	free(map.slots);
	return r == 0 ? 0
		      : why_set(why, r, "no memory for the names of %llu parts",
				(unsigned long long)part_count);
}

void labels_done(struct labels *labels)
{
	strings_done(&labels->strings);
	free(labels->sections);
	free(labels->sources);
	free(labels->parts);
	*labels = (struct labels){ 0 };
}

void labels_count(struct labels *labels, uint32_t part, uint64_t triangle_count)
{
	(void)__atomic_fetch_add(&labels->parts[part].triangle_count, triangle_count,
				 __ATOMIC_RELAXED);
}

struct store_names_content labels_content(const struct labels *labels)
{
	return (struct store_names_content){
		.sections = labels->sections,
		.sources = labels->sources,
		.parts = labels->parts,
		.strings = labels->strings.bytes,
		.section_count = labels->section_count,
		.source_count = labels->source_count,
		.part_count = labels->part_count,
		.string_bytes = labels->strings.byte_count,
	};
}

uint64_t labels_bytes(const struct labels *labels)
{
	return sizeof(struct store_names_header) +
	       labels->section_count * sizeof(*labels->sections) +
	       labels->source_count * sizeof(*labels->sources) +
	       labels->part_count * sizeof(*labels->parts) + labels->strings.byte_count;
}
