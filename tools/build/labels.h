/* SPDX-License-Identifier: MIT */
/**
 * labels.h - parts, sections and sources: who is who in the model.
 *
 * While a file is read its parts go into a part list of its own; parts that a file names alike
 * (name, path, material and colour) are one part.  When all files are read the lists are joined, in
 * the order of the sections, into the tables of the store's names block.
 *
 * Threads: one a part list; labels_join() alone; part counts from any.
 */
#ifndef TOOLS_BUILD_LABELS_H
#define TOOLS_BUILD_LABELS_H

#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "formats/import/import.h"
#include "formats/store/layout.h"
#include "formats/store/store_writer.h"

/** Strings, each kept once.  Offset 0 is the empty one. */
struct strings {
	char *bytes;
	uint64_t byte_count;
	uint64_t byte_max;
	uint64_t *slots; /* of a hash table: offset + 1 */
	uint64_t slot_count;
	uint64_t used_count;
};

/** A part as a file knows it; strings are offsets into its list's. */
struct part_entry {
	uint64_t name;
	uint64_t scene_path;
	uint64_t material;
	uint32_t colour;
};

struct part_list {
	struct strings strings;
	struct part_entry *entries;
	uint32_t entry_count;
	uint32_t entry_max;
	uint32_t *slots; /* of a hash table: entry + 1 */
	uint32_t slot_count;
};

/** Finds or adds a part.  Returns: 0, -ENOMEM, or -EOVERFLOW above 2^31 parts. */
int part_list_add(struct part_list *list, const struct import_part *part, uint32_t *ret_entry);
/** Gives up what only adding needs. */
void part_list_seal(struct part_list *list);
/** A zeroed list is allowed. */
void part_list_done(struct part_list *list);

struct labels {
	struct strings strings;
	struct store_section *sections;
	struct store_source *sources;
	struct store_part *parts;
	uint64_t section_count;
	uint64_t source_count;
	uint64_t part_count;
};

/**
 * Joins the lists of all sections, which are freed as they are taken.
 *
 * Returns: 0, -ENOMEM, or -EOVERFLOW when there are more parts than 32 bits count.
 */
int labels_join(struct labels *labels, const struct import_inputs *inputs, struct part_list *lists,
		struct why *why);
/** A zeroed one is allowed. */
void labels_done(struct labels *labels);

/** Adds to a part's count of triangles. */
void labels_count(struct labels *labels, uint32_t part, uint64_t triangle_count);

/** As the writer takes it. */
struct store_names_content labels_content(const struct labels *labels);

/** Bytes of the tables, decoded. */
uint64_t labels_bytes(const struct labels *labels);

#endif /* TOOLS_BUILD_LABELS_H */
