/* SPDX-License-Identifier: MIT */
/* Goal: what the writer commits, the reader opens, and verify finds whole. */
#include <errno.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "formats/store/payload.h"
#include "formats/store/store_file.h"
#include "formats/store/store_writer.h"
#include "tests/helper.h"

static void no_damage(void *arg, uint32_t node_index, int error, const struct why *why)
{
	(void)arg;
	fail_msg("node %u: %d: %s", node_index, error, why->text);
}

/* Reads everything by the public functions and counts triangles. */
static uint64_t read_all(const char *path)
{
	const struct store_superblock *superblock;
	struct store_file *store;
	struct store_node *nodes;
	struct store_names names;
	struct why why;
	uint64_t triangles = 0;
	void *payload;
	void *scratch;

	if (store_open_path(path, &store, &why) < 0)
		fail_msg("%s", why.text);
	superblock = store_superblock(store);
	nodes = malloc(superblock->node_count * sizeof(*nodes));
	payload = malloc(superblock->payload_bytes_max);
	scratch = malloc(superblock->payload_bytes_max);
	assert_non_null(nodes);
	if (store_load_hs(store, nodes, &why) < 0)
		fail_msg("%s", why.text);
	if (store_load_names(store, &names, &why) < 0)
		fail_msg("%s", why.text);
	for (uint64_t i = 0; i < superblock->node_count; i++) {
		if (nodes[i].payload_id == 0)
			continue;
		if (store_read_payload(store, &nodes[i], payload, scratch, &why) < 0)
			fail_msg("node %u: %s", (unsigned)i, why.text);
		triangles += ((const struct payload_header *)payload)->triangle_count;
	}
	assert_int_equal(triangles, superblock->triangle_count);
	store_names_done(&names);
	free(scratch);
	free(payload);
	free(nodes);
	store_close(store);
	return triangles;
}

static void stores_of_every_kind_are_read_as_they_were_written(void **state)
{
	const char *path = test_path(*state, "grid.ooc");

	for (unsigned i = 0; i < 128; i++) {
		static const uint32_t counts[] = { 0, 1, 2, 5 };
		const struct test_grid grid = {
			.count = counts[i & 3],
			.codec = i >> 2 & 3,
			.float_positions = i & 16,
			.normals = i & 32,
			.colours = i & 64,
			.triangle_ids = i & 16,
			.face_quads = 1 + (i & 1) * 4,
		};
		struct store_verify_summary summary;
		struct why why;

		test_store_grid_make(path, &grid);
		assert_int_equal(read_all(path), test_grid_triangles(&grid));
		if (store_verify_path(path, no_damage, NULL, &summary, &why) < 0)
			fail_msg("%s", why.text);
		assert_int_equal(summary.nodes_damaged, 0);
	}
	assert_string_equal(test_folder_list(*state), "grid.ooc ");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(stores_of_every_kind_are_read_as_they_were_written,
						test_folder_setup, test_folder_teardown),
	};

	return TEST_RUN(tests);
}
