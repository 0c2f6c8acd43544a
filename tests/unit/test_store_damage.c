/* SPDX-License-Identifier: MIT */
/*
 * Goal: no damaged byte of a store goes unnoticed, and the newest whole generation is what is read.
 * Method: one bit, one block or the end of a small store is changed, and what verify says is
 * compared with where the change was.
 */
#include <errno.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "formats/store/store_checksum.h"
#include "formats/store/store_file.h"
#include "formats/store/store_hs.h"
#include "formats/store/store_judge.h"
#include "tests/helper.h"
#include "tests/store_image.h"

/** What a pass over a store told. */
struct told {
	unsigned count;
	uint32_t last_node;
	struct why last_why;
};

static void on_damage(void *arg, uint32_t node_index, int error, const struct why *why)
{
	struct told *told = arg;

	assert_true(error < 0);
	told->count++;
	told->last_node = node_index;
	told->last_why = *why;
}

static int verify(const char *path, struct told *ret)
{
	struct store_verify_summary summary;

	memset(ret, 0, sizeof(*ret));
	return store_verify_path(path, on_damage, ret, &summary, NULL);
}

static int open_store(const char *path, uint64_t *ret_generation, struct why *why)
{
	struct store_file *store;
	struct store_node *nodes;
	int r = store_open_path(path, &store, why);

	if (r < 0)
		return r;
	*ret_generation = store_superblock(store)->generation;
	nodes = malloc(store_superblock(store)->node_count * sizeof(*nodes));
	assert_non_null(nodes);
	r = store_load_hs(store, nodes, why);
	free(nodes);
	store_close(store);
	return r;
}

/* ---- flipped bits ---- */

/* The node whose extent, with its pad, has a byte of the file; STORE_NODE_NONE: none. */
static uint32_t node_at(const struct store_image *image, uint64_t offset)
{
	const struct store_node *nodes = store_image_nodes(image);

	for (uint32_t i = 0; i < store_image_superblock(image, 0)->node_count; i++)
		if (nodes[i].payload_id != 0 && offset >= nodes[i].file_offset &&
		    offset < bytes_round_up(nodes[i].file_offset + nodes[i].stored_bytes,
					    STORE_BLOCK_BYTES))
			return i;
	return STORE_NODE_NONE;
}

/* What must be named for a flipped byte that is no node's. */
static const char *name_at(const struct store_image *image, uint64_t offset)
{
	const struct store_superblock *superblock = store_image_superblock(image, 0);

	if (offset < STORE_BLOCK_BYTES)
		return ""; /* the store does not open; the reason depends on the field */
	if (offset < STORE_FIRST_EXTENT_OFFSET)
		return "superblock B";
	return offset >= superblock->names.file_offset ? "names" : "HS";
}

static void flip_and_verify(const char *path, const struct store_image *image, uint64_t offset)
{
	uint32_t node = node_at(image, offset);
	struct told told;
	int r;

	image->bytes[offset] ^= (uint8_t)(1u << (offset % 8));
	store_image_save(image, path);
	r = verify(path, &told);
	image->bytes[offset] ^= (uint8_t)(1u << (offset % 8));
	if (r != -EBADMSG || told.count == 0)
		fail_msg("byte %llu: %d, %u told", (unsigned long long)offset, r, told.count);
	if (told.last_node != node)
		fail_msg("byte %llu is of node %u, not %u: %s", (unsigned long long)offset, node,
			 told.last_node, told.last_why.text);
	if (node == STORE_NODE_NONE && !strstr(told.last_why.text, name_at(image, offset)))
		fail_msg("byte %llu: %s", (unsigned long long)offset, told.last_why.text);
}

static void each_flipped_bit_is_found_and_named(void **state)
{
	const char *path = test_path(*state, "grid.ooc");
	struct store_image image;
	const struct store_superblock *superblock;

	for (uint32_t codec = 0; codec < STORE_CODEC_COUNT_; codec += 3) {
		const struct test_grid grid = { .count = 3, .codec = codec, .normals = true };

		test_store_grid_make(path, &grid);
		store_image_load(path, &image);
		superblock = store_image_superblock(&image, 0);
		/* 61 is no divisor of anything here: each field is met in one record or another. */
		for (uint64_t offset = 0; offset < image.size_bytes; offset += 61)
			flip_and_verify(path, &image, offset);
		/* Each record of the HS and the first and last byte of each payload. */
		for (uint64_t i = 0; i < superblock->node_count; i++) {
			const struct store_node *node = &store_image_nodes(&image)[i];

			flip_and_verify(path, &image, superblock->hs.file_offset + i * 128 + 5);
			if (node->payload_id == 0)
				continue;
			flip_and_verify(path, &image, node->file_offset);
			flip_and_verify(path, &image, node->file_offset + node->stored_bytes - 1);
		}
		store_image_done(&image);
	}
}

/* ---- cut off, zeroed, in the wrong place ---- */

static void a_store_that_was_cut_off_is_refused(void **state)
{
	const char *path = test_path(*state, "grid.ooc");
	struct store_image image;
	size_t size_bytes;

	test_store_grid(path, 3);
	store_image_load(path, &image);
	size_bytes = image.size_bytes;
	for (size_t length = 0; length < size_bytes; length += STORE_BLOCK_BYTES / 2) {
		uint64_t generation;
		struct told told;
		struct why why;
		int r;

		image.size_bytes = length;
		store_image_save(&image, path);
		r = open_store(path, &generation, &why);
		if (r !=
		    (length < STORE_BLOCK_BYTES ? (length == 0 ? -EINVAL : -ENODATA) : -ENODATA))
			fail_msg("%zu bytes: %d, %s", length, r, why.text);
		assert_int_equal(verify(path, &told), -EBADMSG);
		assert_int_equal(told.count, 1);
	}
	store_image_done(&image);
}

static void a_zeroed_block_is_found(void **state)
{
	const char *path = test_path(*state, "grid.ooc");
	struct store_image image;

	test_store_grid(path, 3);
	store_image_load(path, &image);
	for (size_t offset = 0; offset < image.size_bytes; offset += STORE_BLOCK_BYTES) {
		uint8_t block[STORE_BLOCK_BYTES];
		struct told told;

		if (offset == STORE_BLOCK_BYTES)
			continue; /* superblock B is zero already */
		memcpy(block, image.bytes + offset, sizeof(block));
		memset(image.bytes + offset, 0, sizeof(block));
		store_image_save(&image, path);
		memcpy(image.bytes + offset, block, sizeof(block));
		assert_int_equal(verify(path, &told), -EBADMSG);
		assert_int_equal(told.last_node, node_at(&image, offset));
	}
	store_image_done(&image);
}

static void swap_bytes(struct store_image *image, uint64_t a, uint64_t b, size_t size_bytes)
{
	for (size_t i = 0; i < size_bytes; i++) {
		uint8_t byte = image->bytes[a + i];

		image->bytes[a + i] = image->bytes[b + i];
		image->bytes[b + i] = byte;
	}
}

static void a_right_block_in_the_wrong_place_is_found(void **state)
{
	const char *path = test_path(*state, "grid.ooc");
	struct store_image image;
	struct store_superblock *superblock;
	struct store_node *nodes;
	struct told told;
	uint64_t table;

	/* More than two blocks of records, all leaves alike. */
	test_store_grid(path, 20);
	store_image_load(path, &image);
	superblock = store_image_superblock(&image, 0);
	nodes = store_image_nodes(&image);
	assert_true(superblock->node_count > 2 * STORE_HS_BLOCK_NODES);

	/* Two payloads change places. */
	swap_bytes(&image, nodes[superblock->node_count - 1].file_offset,
		   nodes[superblock->node_count - 2].file_offset,
		   nodes[superblock->node_count - 1].stored_bytes);
	store_image_save(&image, path);
	assert_int_equal(verify(path, &told), -EBADMSG);
	assert_int_equal(told.count, 2);
	assert_non_null(strstr(told.last_why.text, "wrong checksum"));
	store_image_done(&image);

	/* Two blocks of the HS change places, and their checksums with them. */
	test_store_grid(path, 20);
	store_image_load(path, &image);
	superblock = store_image_superblock(&image, 0);
	nodes = store_image_nodes(&image);
	table = superblock->hs.file_offset + superblock->node_count * sizeof(*nodes);
	swap_bytes(&image, superblock->hs.file_offset,
		   superblock->hs.file_offset + STORE_HS_BLOCK_NODES * sizeof(*nodes),
		   STORE_HS_BLOCK_NODES * sizeof(*nodes));
	swap_bytes(&image, table, table + sizeof(uint64_t), sizeof(uint64_t));
	superblock->hs.checksum =
		store_checksum(image.bytes + table,
			       superblock->hs.stored_bytes - (table - superblock->hs.file_offset),
			       superblock->generation);
	store_image_seal_superblock(&image, 0);
	store_image_save(&image, path);
	assert_int_equal(verify(path, &told), -EBADMSG);
	assert_non_null(strstr(told.last_why.text, "records 512 to 1023"));
	store_image_done(&image);

	/* Superblock A is copied to the place of B. */
	test_store_grid(path, 1);
	store_image_load(path, &image);
	memcpy(image.bytes + STORE_BLOCK_BYTES, image.bytes, STORE_BLOCK_BYTES);
	store_image_save(&image, path);
	assert_int_equal(verify(path, &told), -EBADMSG);
	assert_non_null(strstr(told.last_why.text, "superblock B: wrong checksum"));
	store_image_done(&image);
}

/* ---- generations ---- */

/*
 * Commits a second generation by the book: HS and names are written behind everything with the new
 * generation's seeds, payloads stay where they are, and superblock B says so.
 */
static void flip(struct store_image *image)
{
	struct store_superblock next = *store_image_superblock(image, 0);
	size_t hs_offset = image->size_bytes;
	size_t names_offset = hs_offset + bytes_round_up(next.hs.stored_bytes, STORE_BLOCK_BYTES);
	struct store_node *nodes;
	uint64_t *table;

	image->size_bytes =
		names_offset + bytes_round_up(next.names.stored_bytes, STORE_BLOCK_BYTES);
	image->bytes = realloc(image->bytes, image->size_bytes);
	assert_non_null(image->bytes);
	memset(image->bytes + hs_offset, 0, image->size_bytes - hs_offset);
	memcpy(image->bytes + hs_offset, image->bytes + next.hs.file_offset, next.hs.stored_bytes);
	memcpy(image->bytes + names_offset, image->bytes + next.names.file_offset,
	       next.names.stored_bytes);
	next.generation++;
	next.file_bytes = image->size_bytes;
	next.hs.file_offset = hs_offset;
	next.names.file_offset = names_offset;
	nodes = (void *)(image->bytes + hs_offset);
	table = (void *)(nodes + next.node_count);
	for (uint64_t i = 0; i < store_hs_block_count(next.node_count); i++)
		table[i] = store_hs_block_checksum(&next, nodes, i);
	next.hs.checksum = store_checksum(
		table, store_hs_block_count(next.node_count) * sizeof(*table), next.generation);
	next.names.checksum = store_checksum(image->bytes + names_offset, next.names.stored_bytes,
					     next.generation);
	memcpy(image->bytes + STORE_BLOCK_BYTES, &next, sizeof(next));
	store_image_seal_superblock(image, 1);
}

static void expect_generation(const struct store_image *image, const char *path,
			      uint64_t generation)
{
	uint64_t found;
	struct why why;

	store_image_save(image, path);
	if (open_store(path, &found, &why) < 0)
		fail_msg("%s", why.text);
	assert_int_equal(found, generation);
}

static void the_newest_whole_superblock_wins(void **state)
{
	const char *path = test_path(*state, "grid.ooc");
	struct store_image image;
	struct told told;

	test_store_grid(path, 3);
	store_image_load(path, &image);
	expect_generation(&image, path, 1);
	flip(&image);
	expect_generation(&image, path, 2);
	assert_int_equal(verify(path, &told), 0);

	/* A torn write of the newer one: the older stands, and verify says what happened. */
	for (size_t torn = 512; torn < STORE_BLOCK_BYTES; torn += 512) {
		uint8_t half[STORE_BLOCK_BYTES];

		memcpy(half, image.bytes + STORE_BLOCK_BYTES + torn, STORE_BLOCK_BYTES - torn);
		memset(image.bytes + STORE_BLOCK_BYTES + torn, 0, STORE_BLOCK_BYTES - torn);
		expect_generation(&image, path, 1);
		assert_int_equal(verify(path, &told), -EBADMSG);
		assert_non_null(strstr(told.last_why.text, "superblock B: wrong checksum"));
		memcpy(image.bytes + STORE_BLOCK_BYTES + torn, half, STORE_BLOCK_BYTES - torn);
	}

	/* The older one is damaged: the newer does not need it. */
	image.bytes[100] ^= 1;
	expect_generation(&image, path, 2);
	image.bytes[100] ^= 1;
	store_image_done(&image);
}

static void superblocks_that_contradict_each_other_are_refused(void **state)
{
	const char *path = test_path(*state, "grid.ooc");
	struct store_image image;
	uint64_t generation;
	struct why why;

	test_store_grid(path, 3);
	store_image_load(path, &image);
	flip(&image);
	store_image_superblock(&image, 1)->generation = 1;
	store_image_seal_superblock(&image, 1);
	store_image_save(&image, path);
	assert_int_equal(open_store(path, &generation, &why), -EUCLEAN);
	assert_non_null(strstr(why.text, "one generation"));

	/* Flushed before its superblock was written, it cannot have been cut off by a crash. */
	store_image_superblock(&image, 1)->generation = 2;
	store_image_seal_superblock(&image, 1);
	image.size_bytes -= STORE_BLOCK_BYTES;
	store_image_save(&image, path);
	assert_int_equal(open_store(path, &generation, &why), -ENODATA);
	store_image_done(&image);
}

/* ---- what is no store ---- */

static void what_is_no_store_is_refused_with_one_line(void **state)
{
	const char *path = test_path(*state, "x.ooc");
	static const char text[] = "ply\nformat ascii 1.0\n";
	uint8_t zeros[3 * STORE_BLOCK_BYTES] = { 0 };
	uint64_t generation;
	struct why why;

	assert_int_equal(open_store(path, &generation, &why), -ENOENT);
	assert_int_equal(open_store(*state, &generation, &why), -EINVAL);
	assert_non_null(strstr(why.text, "no regular file"));
	assert_int_equal(open_store("/dev/zero", &generation, &why), -EINVAL);
	test_file_write(path, "", 0);
	assert_int_equal(open_store(path, &generation, &why), -EINVAL);
	assert_non_null(strstr(why.text, "empty"));
	test_file_write(path, text, sizeof(text));
	assert_int_equal(open_store(path, &generation, &why), -EINVAL);
	assert_non_null(strstr(why.text, "no store"));
	test_file_write(path, zeros, sizeof(zeros));
	assert_int_equal(open_store(path, &generation, &why), -EINVAL);
	assert_non_null(strstr(why.text, "no store"));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(each_flipped_bit_is_found_and_named,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(a_store_that_was_cut_off_is_refused,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(a_zeroed_block_is_found, test_folder_setup,
						test_folder_teardown),
		cmocka_unit_test_setup_teardown(a_right_block_in_the_wrong_place_is_found,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(the_newest_whole_superblock_wins, test_folder_setup,
						test_folder_teardown),
		cmocka_unit_test_setup_teardown(superblocks_that_contradict_each_other_are_refused,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(what_is_no_store_is_refused_with_one_line,
						test_folder_setup, test_folder_teardown),
	};

	return TEST_RUN(tests);
}
