/* SPDX-License-Identifier: MIT */
/*
 * Goal: a store whose checksums are right and whose fields are not is refused with a reason.
 * Method: a small store is written, one thing in it is changed, its checksums are made right again,
 * and it is opened.  The reason must be the one for what was changed.
 */
#include <errno.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "formats/store/store_file.h"
#include "tests/helper.h"
#include "tests/store_image.h"

/* The store has a root, 8 inner nodes and 27 leaves: root 0, inner 1..8, leaves 9..35. */
#define FIRST_LEAF 9u

struct hostile {
	const char *reason; /* a piece of it */
	void (*change)(struct store_superblock *superblock, struct store_node *nodes);
	int error; /* 0 means -EUCLEAN */
};

/* One line a case: what is changed, and the piece of the reason that must be given for it. */
#define CASE(name, body)                                                                           \
	static void name(struct store_superblock *superblock, struct store_node *nodes)            \
	{                                                                                          \
		(void)superblock;                                                                  \
		(void)nodes;                                                                       \
		body;                                                                              \
	}

/* clang-format off */
CASE(newer_version, superblock->version = 2)
CASE(no_generation, superblock->generation = 0)
CASE(other_block_size, superblock->superblock_bytes = 512)
CASE(odd_file_bytes, superblock->file_bytes -= 1)
CASE(huge_file_bytes, superblock->file_bytes = UINT64_MAX - 4095)
CASE(longer_file, superblock->file_bytes += STORE_BLOCK_BYTES)
CASE(no_nodes, superblock->node_count = 0)
CASE(huge_node_count, superblock->node_count = UINT32_MAX)
CASE(overflowing_node_count, superblock->node_count = UINT64_MAX / 128 + 1)
CASE(wrong_node_count, superblock->node_count += 1)
CASE(fewer_nodes, superblock->node_count -= 1)
CASE(no_leaves, superblock->leaf_count = 0)
CASE(more_triangles, superblock->triangle_count += 1)
CASE(huge_triangles, superblock->triangle_count = UINT64_MAX)
CASE(more_vertices, superblock->vertex_count += 1)
CASE(more_leaves, superblock->leaf_count += 1)
CASE(more_stored, superblock->payload_stored_bytes += 1)
CASE(more_raw, superblock->payload_raw_bytes += 1)
CASE(wrong_payload_max, superblock->payload_bytes_max += 16)
CASE(huge_payload_max, superblock->payload_bytes_max = UINT32_MAX)
CASE(wrong_level_max, superblock->level_max += 1)
CASE(huge_level_max, superblock->level_max = 22)
CASE(low_id_next, superblock->payload_id_next = 2)
CASE(nan_origin, superblock->origin[1] = NAN)
CASE(infinite_root, superblock->root_min[0] = INFINITY)
CASE(odd_root_size, superblock->root_size = 3)
CASE(negative_unit, superblock->unit_metres = -1)
CASE(nan_error, superblock->error = NAN)
CASE(inverted_box, superblock->box_min[2] = superblock->box_max[2] + 1)
CASE(absurd_step, superblock->step_exponent = 3000)
CASE(unknown_axis, superblock->up_axis = 4)
CASE(unknown_layout, superblock->layout = 2)
CASE(used_reserve, superblock->reserved[17] = 1)
CASE(unterminated_producer, memset(superblock->producer, 'x', sizeof(superblock->producer)))
CASE(hs_outside, superblock->hs.file_offset = superblock->file_bytes)
CASE(hs_in_superblock, superblock->hs.file_offset = 0)
CASE(hs_overflow, superblock->hs.file_offset = UINT64_MAX - 4095)
CASE(hs_unaligned, superblock->hs.file_offset += 8)
CASE(names_over_hs, superblock->names.file_offset = superblock->hs.file_offset)
CASE(names_huge, superblock->names.raw_bytes = STORE_NAMES_BYTES_MAX + 1)
CASE(names_empty, superblock->names.raw_bytes = 0)
CASE(more_parts, superblock->part_count = UINT64_MAX / 2)
CASE(more_sections, superblock->section_count = 1000)

CASE(self_cycle, nodes[1].first_child = 1)
CASE(cycle, nodes[1].first_child = 0)
CASE(child_of_two, nodes[2].first_child = nodes[1].first_child)
CASE(wrong_parent, nodes[3].parent = 5)
CASE(root_with_parent, nodes[0].parent = 1)
CASE(children_outside, nodes[8].child_count = 8)
CASE(nine_children, nodes[0].child_count = 9)
CASE(childless_with_link, nodes[FIRST_LEAF].first_child = 12)
CASE(unreachable, (nodes[8].child_count = 0, nodes[8].first_child = STORE_NODE_NONE))
CASE(cell_outside_root, nodes[2].cell[0] = 7)
CASE(cell_outside_parent, nodes[FIRST_LEAF].cell[0] = 2)
CASE(same_cell_twice, memcpy(nodes[2].cell, nodes[1].cell, sizeof(nodes[1].cell)))
CASE(too_deep, nodes[FIRST_LEAF].level = 200)
CASE(child_not_deeper, nodes[1].level = 0)
CASE(unknown_kind, nodes[FIRST_LEAF].kind = 9)
CASE(reserved_kind, nodes[FIRST_LEAF].kind = STORE_KIND_VOXELS)
CASE(unknown_codec, nodes[FIRST_LEAF].codec = 9)
CASE(empty_leaf, (nodes[FIRST_LEAF].kind = 0))
CASE(nothing_with_extent, nodes[1].file_offset = 8192)
CASE(no_id, nodes[FIRST_LEAF].payload_id = 0)
CASE(id_twice, nodes[FIRST_LEAF].payload_id = nodes[FIRST_LEAF + 1].payload_id)
CASE(extent_outside, nodes[FIRST_LEAF].file_offset = superblock->file_bytes)
CASE(extent_overflow, nodes[FIRST_LEAF].file_offset = UINT64_MAX - 4095)
CASE(extent_unaligned, nodes[FIRST_LEAF].file_offset += 512)
CASE(extent_in_superblock, nodes[FIRST_LEAF].file_offset = 4096)
CASE(extent_twice, nodes[FIRST_LEAF].file_offset = nodes[FIRST_LEAF + 3].file_offset)
CASE(extent_over_hs, nodes[FIRST_LEAF].file_offset = superblock->hs.file_offset)
CASE(huge_payload, nodes[FIRST_LEAF].payload_bytes = UINT32_MAX)
CASE(tiny_payload, nodes[FIRST_LEAF].payload_bytes = 16)
CASE(stored_differs, nodes[FIRST_LEAF].stored_bytes -= 16)
CASE(huge_vertex_count, nodes[FIRST_LEAF].vertex_count = UINT32_MAX)
CASE(huge_triangle_count, nodes[FIRST_LEAF].triangle_count = UINT32_MAX)
CASE(no_triangles, nodes[FIRST_LEAF].triangle_count = 0)
CASE(nan_box, nodes[FIRST_LEAF].box_min[0] = NAN)
CASE(infinite_box, nodes[FIRST_LEAF].box_max[2] = INFINITY)
CASE(inverted_node_box, nodes[FIRST_LEAF].box_min[1] = 1000)
CASE(box_outside_parent, nodes[FIRST_LEAF].box_min[1] = -1000)
CASE(nan_sphere, nodes[FIRST_LEAF].sphere[1] = NAN)
CASE(negative_radius, nodes[FIRST_LEAF].sphere[3] = -1)
CASE(sphere_outside_parent, nodes[FIRST_LEAF].sphere[3] = 1000)
CASE(nan_node_error, nodes[FIRST_LEAF].error = NAN)
CASE(errors_inverted, (nodes[FIRST_LEAF].error = 2, nodes[FIRST_LEAF].parent_error = 1))
CASE(nan_parent_error, nodes[FIRST_LEAF].parent_error = NAN)
CASE(root_replaced, nodes[0].parent_error = 5)
CASE(nan_edge, nodes[FIRST_LEAF].longest_edge = NAN)
CASE(negative_area, nodes[FIRST_LEAF].area = -1)
/* clang-format on */

static const struct hostile superblock_hostiles[] = {
	{ "version 2", newer_version, -EPROTONOSUPPORT },
	{ "generation 0", no_generation, 0 },
	{ "512 bytes", other_block_size, 0 },
	{ "cannot be", odd_file_bytes, 0 },
	{ "cut off", huge_file_bytes, -ENODATA },
	{ "cut off", longer_file, -ENODATA },
	{ "0 nodes", no_nodes, 0 },
	{ "4294967295 nodes", huge_node_count, 0 },
	{ "144115188075855872 nodes", overflowing_node_count, 0 },
	{ "are not those of", wrong_node_count, 0 },
	{ "are not those of", fewer_nodes, 0 },
	{ "counts that cannot be", no_leaves, 0 },
	{ "the superblock says", more_triangles, 0 },
	{ "counts that cannot be", huge_triangles, 0 },
	{ "the superblock says", more_vertices, 0 },
	{ "the superblock says", more_leaves, 0 },
	{ "do not add up", more_stored, 0 },
	{ "do not add up", more_raw, 0 },
	{ "do not add up", wrong_payload_max, 0 },
	{ "counts that cannot be", huge_payload_max, 0 },
	{ "do not add up", wrong_level_max, 0 },
	{ "counts that cannot be", huge_level_max, 0 },
	{ "never given", low_id_next, 0 },
	{ "not finite", nan_origin, 0 },
	{ "not finite", infinite_root, 0 },
	{ "power of two", odd_root_size, 0 },
	{ "unit or error", negative_unit, 0 },
	{ "unit or error", nan_error, 0 },
	{ "inside out", inverted_box, 0 },
	{ "2^3000", absurd_step, 0 },
	{ "up axis 4", unknown_axis, 0 },
	{ "layout 2", unknown_layout, 0 },
	{ "reserved", used_reserve, 0 },
	{ "not terminated", unterminated_producer, 0 },
	{ "HS: ", hs_outside, 0 },
	{ "HS: ", hs_in_superblock, 0 },
	{ "HS: ", hs_overflow, 0 },
	{ "HS: ", hs_unaligned, 0 },
	{ "overlap", names_over_hs, 0 },
	{ "names: ", names_huge, 0 },
	{ "names: ", names_empty, 0 },
	{ "too short for", more_parts, 0 },
	{ "too short for", more_sections, 0 },
};

static const struct hostile record_hostiles[] = {
	{ "where they must be", self_cycle, 0 },
	{ "where they must be", cycle, 0 },
	{ "where they must be", child_of_two, 0 },
	{ "parent does not know it", wrong_parent, 0 },
	{ "not a root", root_with_parent, 0 },
	{ "where they must be", children_outside, 0 },
	{ "children that cannot be", nine_children, 0 },
	{ "children that cannot be", childless_with_link, 0 },
	{ "neither children nor", unreachable, 0 },
	{ "not inside the root's", cell_outside_root, 0 },
	{ "outside its parent's", cell_outside_parent, 0 },
	{ "out of order", same_cell_twice, 0 },
	{ "deeper than", too_deep, 0 },
	{ "outside its parent's", child_not_deeper, 0 },
	{ "unknown kind", unknown_kind, 0 },
	{ "unknown kind", reserved_kind, 0 },
	{ "unknown codec", unknown_codec, 0 },
	{ "neither children nor", empty_leaf, 0 },
	{ "nothing to draw", nothing_with_extent, 0 },
	{ "never given", no_id, 0 },
	{ "share a payload id", id_twice, 0 },
	{ "not inside the file", extent_outside, 0 },
	{ "not inside the file", extent_overflow, 0 },
	{ "not inside the file", extent_unaligned, 0 },
	{ "not inside the file", extent_in_superblock, 0 },
	{ "share bytes", extent_twice, 0 },
	{ "over HS or names", extent_over_hs, 0 },
	{ "length cannot be", huge_payload, 0 },
	{ "length cannot be", tiny_payload, 0 },
	{ "not the payload's", stored_differs, 0 },
	{ "length cannot be", huge_vertex_count, 0 },
	{ "length cannot be", huge_triangle_count, 0 },
	{ "without triangles", no_triangles, 0 },
	{ "not finite", nan_box, 0 },
	{ "not finite", infinite_box, 0 },
	{ "inside out", inverted_node_box, 0 },
	{ "box is not inside", box_outside_parent, 0 },
	{ "not finite", nan_sphere, 0 },
	{ "no size", negative_radius, 0 },
	{ "sphere is not inside", sphere_outside_parent, 0 },
	{ "no size", nan_node_error, 0 },
	{ "below its own", errors_inverted, 0 },
	{ "below its own", nan_parent_error, 0 },
	{ "root's stead", root_replaced, 0 },
	{ "no size", nan_edge, 0 },
	{ "no size", negative_area, 0 },
};

/* Opens a store and its HS; the error of the first that fails, or 0. */
static int open_all(const char *path, struct why *why)
{
	struct store_file *store;
	struct store_node *nodes;
	struct store_names names;
	int r;

	r = store_open_path(path, &store, why);
	if (r < 0)
		return r;
	nodes = malloc(store_superblock(store)->node_count * sizeof(*nodes));
	assert_non_null(nodes);
	r = store_load_hs(store, nodes, why);
	if (r == 0)
		r = store_load_names(store, &names, why);
	if (r == 0)
		store_names_done(&names);
	free(nodes);
	store_close(store);
	return r;
}

static void expect_refusal(const char *folder, const struct hostile *hostile,
			   void (*seal)(const struct store_image *image))
{
	const char *broken = test_path(folder, "broken.ooc");
	int error = hostile->error ? hostile->error : -EUCLEAN;
	struct store_image image;
	struct why why = { "" };
	int r;

	store_image_load(test_path(folder, "grid.ooc"), &image);
	hostile->change(store_image_superblock(&image, 0), store_image_nodes(&image));
	seal(&image);
	store_image_save(&image, broken);
	r = open_all(broken, &why);
	if (r != error || !strstr(why.text, hostile->reason))
		fail_msg("\"%s\" was expected: %d, %s", hostile->reason, r, why.text);
	store_image_done(&image);
}

static void seal_superblock_a(const struct store_image *image)
{
	store_image_seal_superblock(image, 0);
}

static void superblocks_that_cannot_be_are_refused(void **state)
{
	test_store_grid(test_path(*state, "grid.ooc"), 5);
	for (size_t i = 0; i < ARRAY_LENGTH(superblock_hostiles); i++)
		expect_refusal(*state, &superblock_hostiles[i], seal_superblock_a);
}

static void records_that_cannot_be_are_refused(void **state)
{
	test_store_grid(test_path(*state, "grid.ooc"), 5);
	for (size_t i = 0; i < ARRAY_LENGTH(record_hostiles); i++)
		expect_refusal(*state, &record_hostiles[i], store_image_seal);
}

static void a_superblock_and_records_that_agree_on_nonsense_are_refused(void **state)
{
	struct store_image image;
	struct store_node *nodes;
	struct store_superblock *superblock;
	struct why why;

	/* An extent of which the superblock itself says that it is in use by the names. */
	test_store_grid(test_path(*state, "grid.ooc"), 5);
	store_image_load(test_path(*state, "grid.ooc"), &image);
	superblock = store_image_superblock(&image, 0);
	nodes = store_image_nodes(&image);
	nodes[FIRST_LEAF].file_offset = superblock->names.file_offset;
	nodes[FIRST_LEAF].codec = STORE_CODEC_ZSTD;
	superblock->payload_stored_bytes -= nodes[FIRST_LEAF].stored_bytes - 64;
	nodes[FIRST_LEAF].stored_bytes = 64;
	store_image_seal(&image);
	store_image_save(&image, test_path(*state, "broken.ooc"));
	assert_int_equal(open_all(test_path(*state, "broken.ooc"), &why), -EUCLEAN);
	assert_non_null(strstr(why.text, "over HS or names"));
	store_image_done(&image);
}

/* ---- names ---- */

/** A names block with room to break it: one section, one source, two parts, eight bytes of strings. */
struct names_block {
	struct store_names_header header;
	struct store_section section;
	struct store_source source;
	struct store_part parts[2];
	char strings[8];
};

static void put_names(const char *folder, void (*change)(struct names_block *block))
{
	struct names_block block = {
		.header = { .section_count = 1,
			    .source_count = 1,
			    .part_count = 2,
			    .string_bytes = 8 },
		.section = { .name = 1, .part_count = 2 },
		.source = { .path = 1 },
		.parts = { { .name = 1 }, { .name = 3 } },
		.strings = { 0, 'a', 0, 'b', 'c', 0, 'd', 0 },
	};
	struct store_image image;

	change(&block);
	store_image_load(test_path(folder, "grid.ooc"), &image);
	store_image_superblock(&image, 0)->section_count = 1;
	store_image_superblock(&image, 0)->part_count = 2;
	store_image_put_names(&image, &block, sizeof(block));
	store_image_save(&image, test_path(folder, "broken.ooc"));
	store_image_done(&image);
}

/* clang-format off */
#define NAMES_CASE(name, body)                                                                     \
	static void name(struct names_block *block)                                                \
	{                                                                                          \
		body;                                                                              \
	}

NAMES_CASE(good_names, (void)block)
NAMES_CASE(other_parts, block->header.part_count = 1)
NAMES_CASE(huge_sources, block->header.source_count = UINT64_MAX / 8)
NAMES_CASE(huge_strings, block->header.string_bytes = UINT64_MAX)
NAMES_CASE(short_strings, block->header.string_bytes = 7)
NAMES_CASE(unterminated, block->strings[7] = 'x')
NAMES_CASE(no_empty_string, block->strings[0] = 'x')
NAMES_CASE(part_name_outside, block->parts[1].name = 8)
NAMES_CASE(scene_path_outside, block->parts[1].scene_path = UINT64_MAX)
NAMES_CASE(material_outside, block->parts[0].material = 100)
NAMES_CASE(section_outside, block->parts[0].section = 1)
NAMES_CASE(source_outside, block->section.source = 1)
NAMES_CASE(source_path_outside, block->source.path = 9)
NAMES_CASE(parts_outside, block->section.first_part = 1)
NAMES_CASE(parts_overflow, (block->section.first_part = 2, block->section.part_count = UINT64_MAX))
NAMES_CASE(nan_placement, block->section.placement[3] = NAN)
/* clang-format on */

static void names_that_cannot_be_are_refused(void **state)
{
	static const struct {
		const char *reason;
		void (*change)(struct names_block *block);
	} cases[] = {
		{ "superblock says", other_parts },      { "do not fill", huge_sources },
		{ "do not fill", huge_strings },         { "do not fill", short_strings },
		{ "not terminated", unterminated },      { "not terminated", no_empty_string },
		{ "points outside", part_name_outside }, { "points outside", scene_path_outside },
		{ "points outside", material_outside },  { "points outside", section_outside },
		{ "points outside", source_outside },    { "points outside", source_path_outside },
		{ "points outside", parts_outside },     { "points outside", parts_overflow },
		{ "stands nowhere", nan_placement },
	};
	const char *broken = test_path(*state, "broken.ooc");
	struct why why = { "" };

	test_store_grid(test_path(*state, "grid.ooc"), 1);
	put_names(*state, good_names);
	assert_int_equal(open_all(broken, &why), 0);
	for (size_t i = 0; i < ARRAY_LENGTH(cases); i++) {
		int r;

		put_names(*state, cases[i].change);
		r = open_all(broken, &why);
		if (r != -EUCLEAN || !strstr(why.text, cases[i].reason))
			fail_msg("%zu: \"%s\" was expected: %d, %s", i, cases[i].reason, r,
				 why.text);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(superblocks_that_cannot_be_are_refused,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(records_that_cannot_be_are_refused,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(
			a_superblock_and_records_that_agree_on_nonsense_are_refused,
			test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(names_that_cannot_be_are_refused, test_folder_setup,
						test_folder_teardown),
	};

	return TEST_RUN(tests);
}
