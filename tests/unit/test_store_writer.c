/* SPDX-License-Identifier: MIT */
/* Goal: store_writer.h: states x operations, same calls same bytes, what no reader opens is refused. */
#include <errno.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "formats/store/store_writer.h"
#include "tests/helper.h"
#include "tests/store_image.h"

/** A store of one leaf, as a builder has it before it is written. */
struct leaf {
	struct store_image image;
	struct store_superblock superblock;
	struct store_node node;
	struct store_names_content names;
};

static void leaf_init(const char *folder, struct leaf *ret)
{
	const char *path = test_path(folder, "template.ooc");

	memset(ret, 0, sizeof(*ret));
	test_store_grid(path, 1);
	store_image_load(path, &ret->image);
	ret->superblock = *store_image_superblock(&ret->image, 0);
	ret->node = store_image_nodes(&ret->image)[0];
	ret->names.strings = "";
	ret->names.string_bytes = 1;
	assert_int_equal(remove(path), 0);
}

static void leaf_done(struct leaf *leaf)
{
	store_image_done(&leaf->image);
}

static int leaf_payload(struct leaf *leaf, struct store_writer *writer)
{
	return store_writer_payload(writer, leaf->node.payload_id, leaf->node.codec,
				    store_image_payload(&leaf->image, 0), leaf->node.stored_bytes,
				    &leaf->node, NULL);
}

static int leaf_commit(struct leaf *leaf, struct store_writer *writer, struct why *why)
{
	return store_writer_commit(writer, &leaf->superblock, &leaf->node, &leaf->names, why);
}

static void nothing_is_seen_before_the_commit(void **state)
{
	const char *path = test_path(*state, "x.ooc");
	struct store_writer *writer;
	struct leaf leaf;

	leaf_init(*state, &leaf);
	assert_int_equal(store_writer_create(path, &writer, NULL), 0);
	assert_int_equal(store_writer_bytes(writer), STORE_FIRST_EXTENT_OFFSET);
	assert_int_equal(leaf_payload(&leaf, writer), 0);
	assert_int_equal(store_writer_bytes(writer), STORE_FIRST_EXTENT_OFFSET + STORE_BLOCK_BYTES);
	assert_string_equal(test_folder_list(*state), "");
	writer = store_writer_destroy(writer);
	assert_string_equal(test_folder_list(*state), "");
	assert_null(store_writer_destroy(NULL));

	assert_int_equal(store_writer_create(path, &writer, NULL), 0);
	assert_int_equal(leaf_payload(&leaf, writer), 0);
	assert_int_equal(leaf_commit(&leaf, writer, NULL), 0);
	assert_string_equal(test_folder_list(*state), "x.ooc ");
	store_writer_destroy(writer);
	assert_string_equal(test_folder_list(*state), "x.ooc ");
	leaf_done(&leaf);
}

/* A function of its own for each, because of the setjmp() in expect_assert_failure(). */
static void assert_payload_is_refused(struct leaf *leaf, struct store_writer *writer)
{
	expect_assert_failure(leaf_payload(leaf, writer));
}

static void assert_commit_is_refused(struct leaf *leaf, struct store_writer *writer)
{
	expect_assert_failure(leaf_commit(leaf, writer, NULL));
}

static void a_commit_is_the_last_thing(void **state)
{
	const char *path = test_path(*state, "x.ooc");

	for (unsigned i = 0; i < 2; i++) {
		struct store_writer *writer;
		struct leaf leaf;

		leaf_init(*state, &leaf);
		/* The second one fails: it is over as well. */
		leaf.superblock.triangle_count += i;
		assert_int_equal(store_writer_create(path, &writer, NULL), 0);
		assert_int_equal(leaf_payload(&leaf, writer), 0);
		assert_int_equal(leaf_commit(&leaf, writer, NULL), i == 0 ? 0 : -EUCLEAN);
		assert_payload_is_refused(&leaf, writer);
		assert_commit_is_refused(&leaf, writer);
		store_writer_destroy(writer);
		leaf_done(&leaf);
	}
}

static void a_commit_without_payloads_is_an_empty_model(void **state)
{
	const char *path = test_path(*state, "x.ooc");
	struct store_writer *writer;
	struct leaf leaf;
	struct why why = { "" };

	leaf_init(*state, &leaf);
	leaf.node = (struct store_node){
		.parent = STORE_NODE_NONE,
		.first_child = STORE_NODE_NONE,
		.parent_error = INFINITY,
	};
	leaf.superblock = (struct store_superblock){
		.node_count = 1,
		.leaf_count = 1,
		.payload_id_next = 1,
		.root_size = 1,
		.step_exponent = STORE_STEP_NONE,
	};
	assert_int_equal(store_writer_create(path, &writer, NULL), 0);
	if (leaf_commit(&leaf, writer, &why) < 0)
		fail_msg("%s", why.text);
	store_writer_destroy(writer);
	leaf_done(&leaf);
}

static void the_same_calls_give_the_same_bytes_and_others_another_uuid(void **state)
{
	const char *path = test_path(*state, "x.ooc");
	struct store_image images[3];

	for (unsigned i = 0; i < 3; i++) {
		struct store_writer *writer;
		struct leaf leaf;

		leaf_init(*state, &leaf);
		if (i == 2)
			leaf.superblock.unit_metres = 0.001;
		assert_int_equal(store_writer_create(path, &writer, NULL), 0);
		assert_int_equal(leaf_payload(&leaf, writer), 0);
		assert_int_equal(leaf_commit(&leaf, writer, NULL), 0);
		store_writer_destroy(writer);
		store_image_load(path, &images[i]);
		/* What the caller gets is what was written. */
		assert_memory_equal(&leaf.superblock, images[i].bytes, sizeof(leaf.superblock));
		leaf_done(&leaf);
	}
	assert_int_equal(images[0].size_bytes, images[1].size_bytes);
	assert_memory_equal(images[0].bytes, images[1].bytes, images[0].size_bytes);
	assert_memory_not_equal(store_image_superblock(&images[0], 0)->uuid,
				store_image_superblock(&images[2], 0)->uuid, 16);
	for (unsigned i = 0; i < 3; i++)
		store_image_done(&images[i]);
}

/* clang-format off */
#define CASE(name, body)                                                                           \
	static void name(struct leaf *leaf)                                                        \
	{                                                                                          \
		body;                                                                              \
	}

CASE(no_nodes, leaf->superblock.node_count = 0)
CASE(wrong_sum, leaf->superblock.vertex_count++)
CASE(nan_box, leaf->node.box_min[0] = NAN)
CASE(low_id_next, leaf->superblock.payload_id_next = 1)
CASE(no_root_size, leaf->superblock.root_size = 0)
CASE(endless_names, leaf->names.string_bytes = STORE_NAMES_BYTES_MAX + 1)
CASE(endless_parts, leaf->names.part_count = UINT64_MAX)
/* clang-format on */

static void what_no_reader_would_open_is_not_committed(void **state)
{
	static const struct {
		int error;
		void (*change)(struct leaf *leaf);
	} cases[] = {
		{ -EINVAL, no_nodes },         { -EUCLEAN, wrong_sum },
		{ -EUCLEAN, nan_box },         { -EUCLEAN, low_id_next },
		{ -EUCLEAN, no_root_size },    { -EOVERFLOW, endless_names },
		{ -EOVERFLOW, endless_parts },
	};
	const char *path = test_path(*state, "x.ooc");

	test_store_grid(path, 2);
	for (size_t i = 0; i < ARRAY_LENGTH(cases); i++) {
		struct store_writer *writer;
		struct store_image before;
		struct store_image after;
		struct leaf leaf;
		struct why why = { "" };

		store_image_load(path, &before);
		leaf_init(*state, &leaf);
		assert_int_equal(store_writer_create(path, &writer, NULL), 0);
		assert_int_equal(leaf_payload(&leaf, writer), 0);
		cases[i].change(&leaf);
		assert_int_equal(leaf_commit(&leaf, writer, &why), cases[i].error);
		assert_true(why.text[0] != '\0');
		store_writer_destroy(writer);
		store_image_load(path, &after);
		assert_int_equal(after.size_bytes, before.size_bytes);
		assert_memory_equal(after.bytes, before.bytes, before.size_bytes);
		assert_string_equal(test_folder_list(*state), "x.ooc ");
		store_image_done(&before);
		store_image_done(&after);
		leaf_done(&leaf);
	}
}

static void payloads_longer_than_the_buffer_come_back(void **state)
{
	const char *path = test_path(*state, "x.ooc");
	const size_t lengths[] = { 1, 4095, 4096, 4097, (4 << 20) - 4096, 4 << 20, (9 << 20) + 1 };
	uint8_t *bytes = malloc(lengths[ARRAY_LENGTH(lengths) - 1]);
	struct store_node records[ARRAY_LENGTH(lengths)];
	struct store_writer *writer;
	struct leaf leaf;
	struct store_image image;

	for (size_t i = 0; i < lengths[ARRAY_LENGTH(lengths) - 1]; i++)
		bytes[i] = (uint8_t)(i * 2654435761u >> 13);
	leaf_init(*state, &leaf);
	assert_int_equal(store_writer_create(path, &writer, NULL), 0);
	assert_int_equal(leaf_payload(&leaf, writer), 0);
	for (size_t i = 0; i < ARRAY_LENGTH(lengths); i++)
		assert_int_equal(store_writer_payload(writer, i + 2, STORE_CODEC_ZSTD, bytes,
						      (uint32_t)lengths[i], &records[i], NULL),
				 0);
	assert_int_equal(leaf_commit(&leaf, writer, NULL), 0);
	store_writer_destroy(writer);
	store_image_load(path, &image);
	for (size_t i = 0; i < ARRAY_LENGTH(lengths); i++) {
		assert_memory_equal(image.bytes + records[i].file_offset, bytes, lengths[i]);
		assert_true(bytes_is_aligned(records[i].file_offset, STORE_BLOCK_BYTES));
	}
	store_image_done(&image);
	leaf_done(&leaf);
	free(bytes);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(nothing_is_seen_before_the_commit,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(a_commit_is_the_last_thing, test_folder_setup,
						test_folder_teardown),
		cmocka_unit_test_setup_teardown(a_commit_without_payloads_is_an_empty_model,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(
			the_same_calls_give_the_same_bytes_and_others_another_uuid,
			test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(what_no_reader_would_open_is_not_committed,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(payloads_longer_than_the_buffer_come_back,
						test_folder_setup, test_folder_teardown),
	};

	return TEST_RUN(tests);
}
