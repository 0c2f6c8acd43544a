/* SPDX-License-Identifier: MIT */
/* Goal: references come back as the values they point at, in their order, in bounded memory. */
#include <errno.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "formats/import/join.h"
#include "tests/helper.h"

/* What value number i is. */
struct value {
	uint64_t number;
	uint64_t mixed;
};

static struct value value_of(uint64_t number)
{
	return (struct value){ number, number * UINT64_C(2654435761) };
}

static uint64_t next_random(uint64_t *seed)
{
	*seed = *seed * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
	return *seed >> 33;
}

static void join_random(const char *folder, uint64_t memory_bytes, uint64_t value_count,
			uint64_t reference_count)
{
	struct scratch scratch = { .directory = folder };
	uint64_t seed = 7, added = 0;
	struct join *join;
	struct why why;

	assert_int_equal(join_create(&scratch, sizeof(struct value), memory_bytes, &join, &why), 0);
	for (uint64_t i = 0; i < reference_count; i++) {
		/* Values come before, between and after the references. */
		while (added < value_count && added <= i) {
			struct value value = value_of(added++);

			assert_int_equal(join_add(join, &value, 1, &why), 0);
		}
		assert_int_equal(join_refer(join, next_random(&seed) % value_count, &why), 0);
	}
	for (; added < value_count; added++) {
		struct value value = value_of(added);

		assert_int_equal(join_add(join, &value, 1, &why), 0);
	}
	if (join_resolve(join, &why) < 0)
		fail_msg("%s", why.text);
	seed = 7;
	for (uint64_t i = 0; i < reference_count; i++) {
		struct value expected = value_of(next_random(&seed) % value_count);
		struct value value;

		assert_int_equal(join_next(join, &value, &why), 0);
		assert_memory_equal(&value, &expected, sizeof(value));
	}
	join_destroy(join);
	assert_int_equal(scratch.live_bytes, 0);
	/* Nothing has a name in the folder, now or ever. */
	assert_string_equal(test_folder_list(folder), "");
}

static void random_references_find_their_values(void **state)
{
	join_random(*state, 1 << 16, 1, 1);
	join_random(*state, 1 << 16, 1, 10000);
	join_random(*state, 1 << 16, 10000, 1);
	join_random(*state, 1 << 14, 50000, 200000);
	join_random(*state, 1 << 24, 50000, 200000);
}

static void an_empty_join_resolves(void **state)
{
	struct scratch scratch = { .directory = *state };
	struct join *join;
	struct why why;

	assert_int_equal(join_create(&scratch, 12, 1 << 16, &join, &why), 0);
	assert_int_equal(join_resolve(join, &why), 0);
	join_destroy(join);
}

static void a_reference_behind_the_values_is_refused(void **state)
{
	static const uint64_t indices[] = { 1, 100000, UINT64_MAX };
	struct scratch scratch = { .directory = *state };

	for (size_t i = 0; i < 3; i++) {
		struct value value = value_of(0);
		struct join *join;
		struct why why;

		assert_int_equal(join_create(&scratch, sizeof(value), 1 << 16, &join, &why), 0);
		assert_int_equal(join_add(join, &value, 1, &why), 0);
		assert_int_equal(join_refer(join, 0, &why), 0);
		assert_int_equal(join_refer(join, indices[i], &why), 0);
		assert_int_equal(join_resolve(join, &why), -EUCLEAN);
		assert_true(join->index_max == indices[i]);
		join_destroy(join);
	}
}

static void too_little_memory_is_told(void **state)
{
	struct scratch scratch = { .directory = *state };
	struct join *join;
	struct why why;

	/* A range of one record: 1024 are all that there is room for. */
	assert_int_equal(join_create(&scratch, sizeof(struct value), 8, &join, &why), 0);
	for (uint64_t i = 0; i < 2000; i++) {
		struct value value = value_of(i);

		assert_int_equal(join_add(join, &value, 1, &why), 0);
		assert_int_equal(join_refer(join, i, &why), 0);
	}
	assert_int_equal(join_resolve(join, &why), -ENOMEM);
	join_destroy(join);
}

static void references_far_apart_in_their_range_are_found(void **state)
{
	/* One reference into the first range, many into the second, one into the first again. */
	struct scratch scratch = { .directory = *state };
	struct join *join;
	struct value value;
	struct why why;

	assert_int_equal(join_create(&scratch, sizeof(value), 1 << 14, &join, &why), 0);
	for (uint64_t i = 0; i < 2000; i++) {
		value = value_of(i);
		assert_int_equal(join_add(join, &value, 1, &why), 0);
	}
	assert_int_equal(join_refer(join, 5, &why), 0);
	for (int i = 0; i < 100000; i++)
		assert_int_equal(join_refer(join, 1999, &why), 0);
	assert_int_equal(join_refer(join, 7, &why), 0);
	assert_int_equal(join_resolve(join, &why), 0);
	for (int i = 0; i < 100002; i++)
		assert_int_equal(join_next(join, &value, &why), 0);
	assert_int_equal(value.number, 7);
	join_destroy(join);
}

static void a_folder_that_is_not_there_is_told(void **state)
{
	struct scratch scratch = { .directory = test_path(*state, "none") };
	struct join *join;
	struct why why;

	assert_int_equal(join_create(&scratch, 12, 1 << 16, &join, &why), -ENOENT);
	assert_non_null(strstr(why.text, "scratch"));
}

int main(void)
{
#define JOIN_TEST(name)                                                                            \
	cmocka_unit_test_setup_teardown(name, test_folder_setup, test_folder_teardown)
	const struct CMUnitTest tests[] = {
		JOIN_TEST(random_references_find_their_values),
		JOIN_TEST(an_empty_join_resolves),
		JOIN_TEST(a_reference_behind_the_values_is_refused),
		JOIN_TEST(too_little_memory_is_told),
		JOIN_TEST(references_far_apart_in_their_range_are_found),
		JOIN_TEST(a_folder_that_is_not_there_is_told),
	};

	return TEST_RUN(tests);
}
