/* SPDX-License-Identifier: MIT */
/*
 * Goal: what a spool or an exchange was given comes back, from memory or from disk, in an order that
 * does not depend on who was first; and no file of it ever has a name.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "tests/helper.h"
#include "tools/build/exchange.h"
#include "tools/build/spool.h"

#define PIECE_BYTES 700000u

struct setting {
	struct budget budget;
	struct spool_pool *pool;
	struct spool *spool;
};

static void setting_make(struct setting *setting, const char *folder, uint64_t memory_bytes)
{
	budget_init(&setting->budget, memory_bytes);
	assert_int_equal(spool_pool_create(&setting->budget, &setting->pool), 0);
	assert_int_equal(spool_create(setting->pool, folder, &setting->spool), 0);
}

static void setting_end(struct setting *setting)
{
	setting->spool = spool_destroy(setting->spool);
	setting->pool = spool_pool_destroy(setting->pool);
	assert_int_equal(setting->budget.taken_bytes, 0);
}

static void fill(uint8_t *bytes, unsigned seed)
{
	for (size_t i = 0; i < PIECE_BYTES; i++)
		bytes[i] = (uint8_t)(i * 31 + seed * 7 + (i >> 9));
}

static void pieces_come_back_from_memory_and_from_disk(void **state)
{
	static uint8_t bytes[PIECE_BYTES];
	static uint8_t back[PIECE_BYTES];
	uint64_t addresses[24];
	struct setting setting;
	unsigned in_memory = 0;

	/* Two segments of memory hold ten pieces; the rest goes to disk. */
	setting_make(&setting, *state, 2 * SPOOL_SEGMENT_BYTES);
	for (unsigned i = 0; i < ARRAY_LENGTH(addresses); i++) {
		fill(bytes, i);
		assert_int_equal(
			spool_append(setting.spool, bytes, PIECE_BYTES - i, &addresses[i], NULL),
			0);
		in_memory += spool_peek(setting.spool, addresses[i]) != NULL;
	}
	assert_int_equal(in_memory, 10);
	assert_true(spool_scratch_bytes(setting.spool) > 0);
	assert_string_equal(test_folder_list(*state), "");
	for (unsigned i = 0; i < ARRAY_LENGTH(addresses); i++) {
		fill(bytes, i);
		assert_int_equal(
			spool_read(setting.spool, addresses[i], back, PIECE_BYTES - i, NULL), 0);
		assert_memory_equal(back, bytes, PIECE_BYTES - i);
		assert_int_equal(spool_read(setting.spool, addresses[i] + 1000, back, 5000, NULL),
				 0);
		assert_memory_equal(back, bytes + 1000, 5000);
	}
	setting_end(&setting);
}

static void released_memory_serves_the_next_and_then_the_budget(void **state)
{
	static uint8_t bytes[PIECE_BYTES];
	struct setting setting;
	struct spool *next;
	uint64_t addresses[5];
	uint64_t address;

	setting_make(&setting, *state, SPOOL_SEGMENT_BYTES);
	assert_int_equal(spool_create(setting.pool, *state, &next), 0);
	for (unsigned i = 0; i < ARRAY_LENGTH(addresses); i++)
		assert_int_equal(
			spool_append(setting.spool, bytes, PIECE_BYTES, &addresses[i], NULL), 0);
	assert_int_equal(spool_append(next, bytes, PIECE_BYTES, &address, NULL), 0);
	assert_null(spool_peek(next, address));
	for (unsigned i = 0; i < ARRAY_LENGTH(addresses); i++)
		spool_release(setting.spool, addresses[i], PIECE_BYTES);
	assert_int_equal(budget_left(&setting.budget), 0);
	assert_int_equal(spool_append(next, bytes, PIECE_BYTES, &address, NULL), 0);
	assert_non_null(spool_peek(next, address));
	spool_pool_drain(setting.pool);
	spool_release(next, address, PIECE_BYTES);
	assert_int_equal(budget_left(&setting.budget), SPOOL_SEGMENT_BYTES);
	(void)spool_destroy(next);
	setting_end(&setting);
}

static void a_warm_pool_keeps_to_the_budget_and_gives_all_back(void **state)
{
	static uint8_t bytes[PIECE_BYTES];
	struct setting setting;
	uint64_t address;

	setting_make(&setting, *state, 3 * SPOOL_SEGMENT_BYTES);
	spool_pool_warm(setting.pool);
	for (unsigned i = 0; i < 15; i++) {
		assert_int_equal(spool_append(setting.spool, bytes, PIECE_BYTES, &address, NULL),
				 0);
		assert_true(setting.budget.taken_bytes <= 3 * SPOOL_SEGMENT_BYTES);
	}
	spool_pool_cool(setting.pool);
	setting_end(&setting);
}

static void a_scratch_folder_that_is_not_there_is_named(void **state)
{
	struct setting setting;
	struct why why = { 0 };
	uint64_t address;

	setting_make(&setting, test_path(*state, "nowhere"), 0);
	assert_true(spool_append(setting.spool, "x", 1, &address, &why) < 0);
	assert_non_null(strstr(why.text, "nowhere"));
	setting_end(&setting);
}

static void a_destination_reads_in_the_order_of_the_origins(void **state)
{
	static const unsigned order[] = { 3, 0, 4, 1, 2 };
	struct setting setting;
	struct exchange *exchange;
	uint32_t back[15];
	size_t fragment_count;

	setting_make(&setting, *state, 0);
	assert_int_equal(exchange_create(setting.spool, &setting.budget, 3, &exchange), 0);
	for (unsigned i = 0; i < ARRAY_LENGTH(order); i++) {
		/* Three words for destination 2, one for 0. */
		const uint32_t words[] = { order[i] * 10, order[i] * 10 + 1, order[i] * 10 + 2,
					   order[i] };
		struct exchange_fragment fragments[] = { { .destination = 2, .bytes = 12 },
							 { .destination = 0, .bytes = 4 } };

		assert_int_equal(exchange_put(exchange, order[i], words, fragments, 2, NULL), 0);
	}
	assert_int_equal(exchange_seal(exchange, NULL), 0);
	assert_int_equal(exchange_bytes(exchange, 0), 20);
	assert_int_equal(exchange_bytes(exchange, 1), 0);
	assert_int_equal(exchange_bytes(exchange, 2), 60);
	(void)exchange_fragments(exchange, 2, &fragment_count);
	assert_int_equal(fragment_count, 5);
	assert_int_equal(exchange_read(exchange, 2, 0, back, 60, NULL), 0);
	for (unsigned i = 0; i < 15; i++)
		assert_int_equal(back[i], i / 3 * 10 + i % 3);
	assert_int_equal(exchange_read(exchange, 2, 8, back, 20, NULL), 0);
	for (unsigned i = 0; i < 5; i++)
		assert_int_equal(back[i], (i + 2) / 3 * 10 + (i + 2) % 3);
	exchange = exchange_destroy(exchange);
	setting_end(&setting);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(pieces_come_back_from_memory_and_from_disk,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(released_memory_serves_the_next_and_then_the_budget,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(a_warm_pool_keeps_to_the_budget_and_gives_all_back,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(a_scratch_folder_that_is_not_there_is_named,
						test_folder_setup, test_folder_teardown),
		cmocka_unit_test_setup_teardown(a_destination_reads_in_the_order_of_the_origins,
						test_folder_setup, test_folder_teardown),
	};

	return TEST_RUN(tests);
}
