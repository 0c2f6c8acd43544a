/* SPDX-License-Identifier: MIT */
/*
 * Goal: a store that was written once stays readable, and what is written today is the same format.
 * A change that makes this fail needs a new STORE_VERSION and a reader for the old one; the files
 * themselves are never written again.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "formats/store/payload.h"
#include "formats/store/store_file.h"
#include "tests/helper.h"
#include "tests/store_image.h"

static const char *golden_path(const char *name)
{
	const char *source = getenv("OOCD_SOURCE");
	char folder[512];

	assert_non_null(source);
	(void)snprintf(folder, sizeof(folder), "%s/tests/golden", source);
	return test_path(folder, name);
}

static void no_damage(void *arg, uint32_t node_index, int error, const struct why *why)
{
	(void)arg;
	fail_msg("node %u: %d: %s", node_index, error, why->text);
}

static void old_stores_stay_readable(void **state)
{
	static const struct {
		const char *name;
		uint64_t triangles;
		uint8_t uuid[4];
	} stores[] = {
		{ "store_v1_leaf.ooc", 12, { 0x7e, 0x41, 0xf4, 0x2d } },
		{ "store_v1_meshopt_zstd.ooc", 96, { 0xf0, 0xab, 0xd9, 0xf9 } },
	};

	(void)state;
	for (size_t i = 0; i < sizeof(stores) / sizeof(stores[0]); i++) {
		_Alignas(16) static uint8_t payload[1 << 16];
		static uint8_t stored[1 << 16];
		const char *path = golden_path(stores[i].name);
		struct store_verify_summary summary;
		struct store_file *store;
		struct payload_view view;
		struct store_node node;
		double position[3];
		struct why why;

		if (store_verify_path(path, no_damage, NULL, &summary, &why) < 0)
			fail_msg("%s", why.text);
		assert_int_equal(store_open_path(path, &store, &why), 0);
		assert_int_equal(store_superblock(store)->triangle_count, stores[i].triangles);
		assert_memory_equal(store_superblock(store)->uuid, stores[i].uuid,
				    sizeof(stores[i].uuid));
		assert_int_equal(store_superblock(store)->node_count, 1);
		assert_int_equal(store_load_hs(store, &node, &why), 0);
		assert_int_equal(store_read_payload(store, &node, payload, stored, &why), 0);
		payload_view(payload, &view);
		payload_position(&view, 0, position);
		assert_true(position[0] == 0.25 && position[1] == 0.25 && position[2] == 0.25);
		store_close(store);
	}
}

static void what_is_written_today_is_the_old_format(void **state)
{
	const struct test_grid grid = { .count = 1, .normals = true, .colours = true };
	const char *path = test_path(*state, "today.ooc");
	struct store_image golden;
	struct store_image today;
	uint64_t names_offset;

	test_store_grid_make(path, &grid);
	store_image_load(golden_path("store_v1_leaf.ooc"), &golden);
	store_image_load(path, &today);
	names_offset = store_image_superblock(&golden, 0)->names.file_offset;
	/* Payloads and HS; the names' zstd frame may be another with another zstd. */
	assert_memory_equal(golden.bytes + STORE_FIRST_EXTENT_OFFSET,
			    today.bytes + STORE_FIRST_EXTENT_OFFSET,
			    names_offset - STORE_FIRST_EXTENT_OFFSET);
	store_image_done(&today);
	store_image_done(&golden);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(old_stores_stay_readable),
		cmocka_unit_test_setup_teardown(what_is_written_today_is_the_old_format,
						test_folder_setup, test_folder_teardown),
	};

	return TEST_RUN(tests);
}
