/* SPDX-License-Identifier: MIT */
/* Goal: whatever the sizes, things on shelves do not touch each other, the boards or the walls. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "tests/helper.h"
#include "tests/unit/ply_mesh.h"
#include "tools/gen/rack_place.h"
#include "tools/gen/rack_room.h"

#define ITEM_COUNT 700

/* Things of very different sizes, some of them flat or of no extent. */
static void make_items(struct rack_item *items, uint64_t seed)
{
	struct random random = random_stream(seed, 0);

	for (size_t i = 0; i < ITEM_COUNT; i++) {
		double large = random_chance(&random, 0.05) ? 40 : 1;

		items[i].size = (struct vec3){ random_between(&random, 0.1, 4) * large,
					       random_between(&random, 0.1, 4) * large,
					       random_between(&random, 0, 2) * large };
	}
	items[3].size = (struct vec3){ 0, 0, 0 };
	items[4].size = (struct vec3){ 0, 0, 500 };
	items[5].size = (struct vec3){ 300, 0.1, 0.1 };
}

struct box {
	struct vec3 low;
	struct vec3 high;
};

static struct box item_box(const struct rack_item *item)
{
	return (struct box){ { item->place.x - item->size.x / 2, item->place.y - item->size.y / 2,
			       item->place.z },
			     { item->place.x + item->size.x / 2, item->place.y + item->size.y / 2,
			       item->place.z + item->size.z } };
}

static bool overlap(const struct box *a, const struct box *b)
{
	return a->low.x < b->high.x && b->low.x < a->high.x && a->low.y < b->high.y &&
	       b->low.y < a->high.y && a->low.z < b->high.z && b->low.z < a->high.z;
}

static void things_do_not_overlap(void **state)
{
	static struct rack_item items[ITEM_COUNT];

	(void)state;
	for (uint64_t seed = 0; seed < 20; seed++) {
		struct rack_layout layout;

		make_items(items, seed);
		assert_int_equal(rack_place(items, ITEM_COUNT, &layout), 0);
		assert_true(layout.room_count >= 2 && layout.room_count % 2 == 0);
		for (size_t i = 0; i < ITEM_COUNT; i++) {
			struct box box = item_box(&items[i]);

			for (size_t j = 0; j < i; j++) {
				struct box other = item_box(&items[j]);

				assert_false(overlap(&box, &other));
			}
		}
		rack_layout_done(&layout);
	}
}

/* Does any triangle's box of a room reach into the thing?  Rooms are made of upright boxes. */
static bool room_touches(const struct ply_mesh *room, const struct frame *frame,
			 const struct box *thing)
{
	for (uint32_t i = 0; i < room->triangle_count; i++) {
		struct box face;

		for (int k = 0; k < 3; k++) {
			const double *p = room->positions[room->corners[i][k]];
			struct vec3 v = frame_point(frame, (struct vec3){ p[0], p[1], p[2] });

			if (k == 0)
				face = (struct box){ v, v };
			face.low.x = v.x < face.low.x ? v.x : face.low.x;
			face.low.y = v.y < face.low.y ? v.y : face.low.y;
			face.low.z = v.z < face.low.z ? v.z : face.low.z;
			face.high.x = v.x > face.high.x ? v.x : face.high.x;
			face.high.y = v.y > face.high.y ? v.y : face.high.y;
			face.high.z = v.z > face.high.z ? v.z : face.high.z;
		}
		if (overlap(&face, thing))
			return true;
	}
	return false;
}

static void things_lie_clear_of_boards_panels_and_walls(void **state)
{
	static struct rack_item items[ITEM_COUNT];
	const struct mesh_file file = { .path = test_path(*state, "room.ply"),
					.description = "test",
					.doubles = true };
	struct rack_layout layout;
	struct why why;

	make_items(items, 1);
	assert_int_equal(rack_place(items, ITEM_COUNT, &layout), 0);
	for (size_t room = 0; room < layout.room_count; room++) {
		struct ply_mesh mesh;
		struct ply_mesh_faults faults;

		assert_int_equal(
			mesh_write_file(&file, rack_room_make, &layout.rooms[room], NULL, &why), 0);
		mesh = ply_mesh_read(file.path);
		faults = ply_mesh_judge(&mesh);
		assert_int_equal(faults.open_edges, 0);
		assert_int_equal(faults.degenerate, 0);
		assert_int_equal(faults.duplicates, 0);
		for (size_t i = 0; i < ITEM_COUNT; i++) {
			struct box box = item_box(&items[i]);

			assert_false(room_touches(&mesh, &layout.rooms[room].frame, &box));
		}
		ply_mesh_done(&mesh);
	}
	rack_layout_done(&layout);
}

static void a_single_thing_of_any_size_finds_a_place(void **state)
{
	static const struct vec3 sizes[] = { { 0, 0, 0 },        { 1, 1, 1 },    { 1, 1000, 1 },
					     { 1000, 1, 1 },     { 1, 1, 1000 }, { 0, 0, 7 },
					     { 1e-9, 1e-9, 1e9 } };

	(void)state;
	for (size_t i = 0; i < ARRAY_LENGTH(sizes); i++) {
		struct rack_item item = { .size = sizes[i] };
		struct rack_layout layout;

		assert_int_equal(rack_place(&item, 1, &layout), 0);
		assert_int_equal(layout.room_count, 2);
		assert_true(item.place.z > 0);
		rack_layout_done(&layout);
	}
}

static void rooms_are_alike_and_full(void **state)
{
	static struct rack_item items[20 * ITEM_COUNT];
	struct rack_layout layout;
	unsigned empty_count = 0;

	(void)state;
	for (uint64_t i = 0; i < 20; i++)
		make_items(items + i * ITEM_COUNT, i);
	for (size_t i = 0; i < ARRAY_LENGTH(items); i++) {
		struct vec3 *size = &items[i].size;

		/* No more than twice the largest side of most, as in a set of parts. */
		*size = (struct vec3){ fmin(size->x, 8), fmin(size->y, 8), fmin(size->z, 4) };
	}
	assert_int_equal(rack_place(items, ARRAY_LENGTH(items), &layout), 0);
	assert_true(layout.room_count >= 4);
	for (size_t i = 0; i < layout.room_count; i++) {
		assert_memory_equal(&layout.rooms[i].sizes, &layout.rooms[0].sizes,
				    sizeof(layout.rooms[0].sizes));
		for (unsigned bay = 0; bay + 1 < RACK_ROOM_BAYS; bay++)
			empty_count += layout.rooms[i].bays[bay].board_count == 0;
	}
	assert_true(empty_count <= layout.room_count);
	rack_layout_done(&layout);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(things_do_not_overlap),
		cmocka_unit_test_setup_teardown(things_lie_clear_of_boards_panels_and_walls,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test(rooms_are_alike_and_full),
		cmocka_unit_test(a_single_thing_of_any_size_finds_a_place),
	};

	return TEST_RUN(tests);
}
