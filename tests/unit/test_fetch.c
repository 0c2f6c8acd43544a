/* SPDX-License-Identifier: MIT */
/* Goal: the same reads come out right, or end in the right error, on all three back ends. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "daemon/fetch/fetch.h"
#include "daemon/limits.h"
#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "tests/helper.h"

#define FILE_BYTES    (3u * MIB + 1000u)
#define REQUEST_COUNT 64u
#define SLOT_BYTES    (1u * MIB)

struct reader {
	char *folder;
	int fd;
	struct fetch *fetch;
	uint32_t file;
	uint32_t buffer;
	uint8_t *content;
	uint8_t *memory; /* REQUEST_COUNT slots */
	int errors[REQUEST_COUNT];
	bool over[REQUEST_COUNT];
	uint32_t over_count;
};

static void on_done(void *arg, uint64_t tag, int error)
{
	struct reader *reader = arg;

	assert_true(tag < REQUEST_COUNT);
	assert_false(reader->over[tag]);
	reader->over[tag] = true;
	reader->errors[tag] = error;
	reader->over_count++;
}

/* Returns: false where io_uring is not to be had. */
static bool reader_init_on(struct reader *reader, enum fetch_kind kind, struct fetch_sim sim,
			   const struct disk_profile *disk)
{
	struct fetch_config config = {
		.kind = kind,
		.depth = 8,
		.done = on_done,
		.done_arg = reader,
		.sim = sim,
		.disk = disk,
	};
	const char *path;
	struct why why;

	*reader = (struct reader){ 0 };
	if (fetch_create(&config, &reader->fetch, &why) < 0) {
		print_message("%s\n", why.text);
		assert_int_equal(kind, FETCH_URING);
		return false;
	}
	reader->folder = test_folder_make();
	reader->content = malloc(FILE_BYTES);
	for (uint32_t i = 0; i < FILE_BYTES; i++)
		reader->content[i] = (uint8_t)(i * 2654435761u >> 23);
	path = test_path(reader->folder, "file");
	test_file_write(path, reader->content, FILE_BYTES);
	reader->fd = open(path, O_RDONLY | O_DIRECT | O_CLOEXEC);
	if (reader->fd < 0)
		reader->fd = open(path, O_RDONLY | O_CLOEXEC);
	assert_true(reader->fd >= 0);
	reader->memory = mmap(NULL, REQUEST_COUNT * SLOT_BYTES, PROT_READ | PROT_WRITE,
			      MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
	assert_ptr_not_equal(reader->memory, MAP_FAILED);
	assert_int_equal(fetch_add_file(reader->fetch, reader->fd, &reader->file), 0);
	if (fetch_add_buffer(reader->fetch, reader->memory, REQUEST_COUNT * SLOT_BYTES,
			     &reader->buffer) < 0)
		reader->buffer = FETCH_BUFFER_NONE;
	return true;
}

static bool reader_init(struct reader *reader, enum fetch_kind kind, struct fetch_sim sim)
{
	return reader_init_on(reader, kind, sim, NULL);
}

static void reader_done(struct reader *reader)
{
	fetch_destroy(reader->fetch);
	(void)munmap(reader->memory, REQUEST_COUNT * SLOT_BYTES);
	(void)close(reader->fd);
	free(reader->content);
	test_folder_remove(reader->folder);
}

static void reader_start(struct reader *reader, uint32_t tag, uint64_t offset, uint32_t bytes)
{
	struct fetch_request request = {
		.file = reader->file,
		.buffer = tag % 2 ? reader->buffer : FETCH_BUFFER_NONE,
		.file_offset = offset,
		.bytes = bytes,
		.destination = reader->memory + (size_t)tag * SLOT_BYTES,
		.tag = tag,
	};

	assert_int_equal(fetch_start(reader->fetch, &request), 0);
}

static void reader_wait(struct reader *reader, uint32_t count)
{
	fetch_flush(reader->fetch);
	while (reader->over_count < count) {
		struct pollfd fd = { .fd = fetch_fd(reader->fetch), .events = POLLIN };

		assert_int_equal(poll(&fd, 1, 20000), 1);
		fetch_dispatch(reader->fetch);
		fetch_flush(reader->fetch);
		assert_true(fetch_in_flight(reader->fetch) <= 8);
	}
	assert_int_equal(fetch_in_flight(reader->fetch), 0);
	assert_true(fetch_has_room(reader->fetch));
}

static void check_reads(enum fetch_kind kind, struct fetch_sim sim)
{
	struct reader reader;
	uint64_t offsets[REQUEST_COUNT];
	uint32_t lengths[REQUEST_COUNT];
	unsigned seed = 3;

	if (!reader_init(&reader, kind, sim))
		return;
	for (uint32_t i = 0; i < REQUEST_COUNT; i++) {
		offsets[i] = (uint64_t)(rand_r(&seed) % 700) * STORE_BLOCK_BYTES;
		lengths[i] =
			1 + (uint32_t)rand_r(&seed) % (uint32_t)(i % 4 ? 20000 : SLOT_BYTES - 1);
		lengths[i] = (uint32_t)u64_min(lengths[i], FILE_BYTES - offsets[i]);
		reader_start(&reader, i, offsets[i], lengths[i]);
	}
	reader_wait(&reader, REQUEST_COUNT);
	for (uint32_t i = 0; i < REQUEST_COUNT; i++) {
		assert_int_equal(reader.errors[i], 0);
		assert_memory_equal(reader.memory + (size_t)i * SLOT_BYTES,
				    reader.content + offsets[i], lengths[i]);
	}
	reader_done(&reader);
}

static const struct fetch_sim quiet = { 0 };

static void reads_of_any_length_are_right_with_uring(void **state)
{
	(void)state;
	check_reads(FETCH_URING, quiet);
}

static void reads_of_any_length_are_right_with_pread(void **state)
{
	(void)state;
	check_reads(FETCH_PREAD, quiet);
}

static void reads_are_right_through_short_reads_interrupts_delays_and_any_order(void **state)
{
	(void)state;
	for (uint64_t seed = 0; seed < 20; seed++)
		check_reads(FETCH_SIM, (struct fetch_sim){ .seed = seed,
							   .short_permille = 300,
							   .interrupt_permille = 200,
							   .delay_permille = 300,
							   .reorder = 1 });
}

static void reads_behind_a_slower_disk_are_right_and_no_earlier_than_its_own(void **state)
{
	static const enum fetch_kind kinds[] = { FETCH_URING, FETCH_PREAD, FETCH_SIM };
	static const struct disk_profile disk = { .bytes_per_s = 100 * MIB,
						  .latency_ns = 2 * NS_PER_MS,
						  .parallel = 1 };

	(void)state;
	for (size_t k = 0; k < ARRAY_LENGTH(kinds); k++) {
		uint64_t begin_ns = clock_now_ns();
		struct reader reader;

		if (!reader_init_on(&reader, kinds[k], (struct fetch_sim){ .short_permille = 200 },
				    &disk))
			continue;
		for (uint32_t i = 0; i < 8; i++)
			reader_start(&reader, i, (uint64_t)i * 64 * STORE_BLOCK_BYTES, 10000);
		reader_wait(&reader, 8);
		for (uint32_t i = 0; i < 8; i++) {
			assert_int_equal(reader.errors[i], 0);
			assert_memory_equal(reader.memory + (size_t)i * SLOT_BYTES,
					    reader.content + (size_t)i * 64 * STORE_BLOCK_BYTES,
					    10000);
		}
		assert_true(clock_now_ns() - begin_ns >= 8 * disk.latency_ns);
		reader_done(&reader);
	}
}

static void check_end_of_file(enum fetch_kind kind)
{
	struct reader reader;

	if (!reader_init(&reader, kind, quiet))
		return;
	/* The first ends where the file ends, the second after, the third begins after. */
	reader_start(&reader, 0, 3 * MIB, 1000);
	reader_start(&reader, 1, 3 * MIB, 5000);
	reader_start(&reader, 2, 4 * MIB, 1000);
	reader_wait(&reader, 3);
	assert_int_equal(reader.errors[0], 0);
	assert_int_equal(reader.errors[1], -ENODATA);
	assert_int_equal(reader.errors[2], -ENODATA);
	reader_done(&reader);
}

static void a_read_past_the_end_is_an_error_on_every_back_end(void **state)
{
	(void)state;
	check_end_of_file(FETCH_URING);
	check_end_of_file(FETCH_PREAD);
	check_end_of_file(FETCH_SIM);
}

#define NEIGHBOUR_BYTES 10000u
#define NEIGHBOUR_STEP  (3u * STORE_BLOCK_BYTES)

/* Requests that follow each other in the file; every third goes right behind the one before it. */
static void start_neighbours(struct reader *reader, uint32_t count)
{
	for (uint32_t i = 0; i < count; i++) {
		struct fetch_request request = {
			.file = reader->file,
			.buffer = reader->buffer,
			.file_offset = (uint64_t)i * NEIGHBOUR_STEP,
			.bytes = NEIGHBOUR_BYTES,
			.destination = reader->memory + (size_t)(i - i % 3) * SLOT_BYTES +
				       (size_t)(i % 3) * NEIGHBOUR_STEP,
			.tag = i,
		};

		assert_int_equal(fetch_start(reader->fetch, &request), 0);
	}
}

static bool neighbour_is_right(const struct reader *reader, uint32_t i)
{
	return memcmp(reader->memory + (size_t)(i - i % 3) * SLOT_BYTES +
			      (size_t)(i % 3) * NEIGHBOUR_STEP,
		      reader->content + (size_t)i * NEIGHBOUR_STEP, NEIGHBOUR_BYTES) == 0;
}

static void requests_side_by_side_in_the_file_share_a_read(void **state)
{
	static const enum fetch_kind kinds[] = { FETCH_URING, FETCH_PREAD, FETCH_SIM };

	(void)state;
	for (size_t k = 0; k < ARRAY_LENGTH(kinds); k++) {
		struct reader reader;

		if (!reader_init(&reader, kinds[k], quiet))
			continue;
		start_neighbours(&reader, REQUEST_COUNT);
		/* 64 times 3 blocks in pieces of 64 blocks, each of which takes 21 whole requests. */
		assert_int_equal(fetch_in_flight(reader.fetch), 4);
		reader_wait(&reader, REQUEST_COUNT);
		for (uint32_t i = 0; i < REQUEST_COUNT; i++) {
			assert_int_equal(reader.errors[i], 0);
			assert_true(neighbour_is_right(&reader, i));
		}
		reader_done(&reader);
	}
}

static void a_read_that_is_shared_survives_all_that_is_no_error(void **state)
{
	(void)state;
	for (uint64_t seed = 0; seed < 20; seed++) {
		struct reader reader;

		assert_true(reader_init(&reader, FETCH_SIM,
					(struct fetch_sim){ .seed = seed,
							    .short_permille = 600,
							    .interrupt_permille = 200,
							    .delay_permille = 300,
							    .reorder = 1 }));
		start_neighbours(&reader, REQUEST_COUNT);
		reader_wait(&reader, REQUEST_COUNT);
		for (uint32_t i = 0; i < REQUEST_COUNT; i++) {
			assert_int_equal(reader.errors[i], 0);
			assert_true(neighbour_is_right(&reader, i));
		}
		reader_done(&reader);
	}
}

static void who_shares_a_read_that_fails_is_read_again_alone(void **state)
{
	uint32_t failed = 0;

	(void)state;
	for (uint64_t seed = 0; seed < 20; seed++) {
		struct reader reader;

		assert_true(reader_init(&reader, FETCH_SIM,
					(struct fetch_sim){ .seed = seed,
							    .error_permille = 200,
							    .short_permille = 300 }));
		start_neighbours(&reader, REQUEST_COUNT);
		reader_wait(&reader, REQUEST_COUNT);
		for (uint32_t i = 0; i < REQUEST_COUNT; i++) {
			assert_true(reader.errors[i] == 0 || reader.errors[i] == -EIO);
			assert_true(reader.errors[i] < 0 || neighbour_is_right(&reader, i));
			failed += reader.errors[i] < 0;
		}
		reader_done(&reader);
	}
	/* A fifth of the shared reads fails, then a fifth of those that were in them: not all. */
	assert_in_range(failed, 1, 20 * REQUEST_COUNT / 6);
}

static void the_end_of_the_file_fails_only_who_asks_beyond_it(void **state)
{
	static const enum fetch_kind kinds[] = { FETCH_URING, FETCH_PREAD, FETCH_SIM };

	(void)state;
	for (size_t k = 0; k < ARRAY_LENGTH(kinds); k++) {
		struct reader reader;

		if (!reader_init(&reader, kinds[k], quiet))
			continue;
		reader_start(&reader, 0, 3 * MIB - 2 * STORE_BLOCK_BYTES, 2 * STORE_BLOCK_BYTES);
		reader_start(&reader, 1, 3 * MIB, 1000);
		reader_start(&reader, 2, 3 * MIB + STORE_BLOCK_BYTES, 1000);
		assert_int_equal(fetch_in_flight(reader.fetch), 1);
		reader_wait(&reader, 3);
		assert_int_equal(reader.errors[0], 0);
		assert_int_equal(reader.errors[1], 0);
		assert_int_equal(reader.errors[2], -ENODATA);
		reader_done(&reader);
	}
}

static void a_device_that_never_gets_anywhere_ends_in_an_error(void **state)
{
	struct reader reader;

	(void)state;
	assert_true(
		reader_init(&reader, FETCH_SIM, (struct fetch_sim){ .interrupt_permille = 1000 }));
	reader_start(&reader, 0, 0, SLOT_BYTES);
	reader_wait(&reader, 1);
	assert_int_equal(reader.errors[0], -EIO);
	reader_done(&reader);
}

static void a_queue_that_was_full_is_filled_again_when_half_of_it_is_free(void **state)
{
	struct reader reader;
	uint32_t refill_count = 0;
	uint32_t before = 8;

	(void)state;
	assert_true(reader_init(&reader, FETCH_SIM,
				(struct fetch_sim){ .seed = 6, .delay_permille = 700 }));
	for (uint32_t i = 0; i < REQUEST_COUNT; i++)
		reader_start(&reader, i, (uint64_t)i * 3 * STORE_BLOCK_BYTES, STORE_BLOCK_BYTES);
	assert_int_equal(fetch_in_flight(reader.fetch), 8);
	while (reader.over_count + before < REQUEST_COUNT) {
		uint32_t ended = reader.over_count;
		uint32_t now;

		fetch_dispatch(reader.fetch);
		ended = reader.over_count - ended;
		now = fetch_in_flight(reader.fetch);
		if (before - ended > 4)
			assert_int_equal(now, before - ended);
		else
			assert_int_equal(now, u64_min(8, REQUEST_COUNT - reader.over_count));
		refill_count += now > before - ended;
		before = now;
	}
	assert_true(refill_count > 0 && refill_count < REQUEST_COUNT / 4);
	reader_wait(&reader, REQUEST_COUNT);
	reader_done(&reader);
}

static void one_failed_piece_fails_its_request_and_no_other(void **state)
{
	uint32_t failed = 0;
	struct reader reader;

	(void)state;
	assert_true(reader_init(&reader, FETCH_SIM,
				(struct fetch_sim){ .seed = 9, .error_permille = 100 }));
	for (uint32_t i = 0; i < REQUEST_COUNT; i++)
		reader_start(&reader, i, (uint64_t)i * 8 * STORE_BLOCK_BYTES, SLOT_BYTES / 2);
	reader_wait(&reader, REQUEST_COUNT);
	for (uint32_t i = 0; i < REQUEST_COUNT; i++) {
		if (reader.errors[i] == 0) {
			assert_memory_equal(reader.memory + (size_t)i * SLOT_BYTES,
					    reader.content + (size_t)i * 8 * STORE_BLOCK_BYTES,
					    SLOT_BYTES / 2);
			continue;
		}
		assert_int_equal(reader.errors[i], -EIO);
		failed++;
	}
	assert_in_range(failed, 1, REQUEST_COUNT - 1);
	reader_done(&reader);
}

static void requests_beyond_the_table_are_refused(void **state)
{
	struct reader reader;
	struct fetch_request request = { .buffer = FETCH_BUFFER_NONE, .bytes = 4096 };

	(void)state;
	assert_true(reader_init(&reader, FETCH_SIM, quiet));
	request.file = reader.file;
	request.destination = reader.memory;
	for (uint32_t i = 0; i < FILL_COUNT_MAX; i++)
		assert_int_equal(fetch_start(reader.fetch, &request), 0);
	assert_int_equal(fetch_start(reader.fetch, &request), -EAGAIN);
	assert_false(fetch_has_room(reader.fetch));
	reader_done(&reader);
}

static void check_destroy_in_flight(enum fetch_kind kind)
{
	struct reader reader;

	if (!reader_init(&reader, kind, quiet))
		return;
	for (uint32_t i = 0; i < REQUEST_COUNT; i++)
		reader_start(&reader, i, 0, SLOT_BYTES);
	fetch_flush(reader.fetch);
	reader_done(&reader);
}

static void destroying_waits_for_what_is_in_flight(void **state)
{
	(void)state;
	check_destroy_in_flight(FETCH_URING);
	check_destroy_in_flight(FETCH_PREAD);
	check_destroy_in_flight(FETCH_SIM);
}

static void files_and_buffers_can_be_replaced(void **state)
{
	static const enum fetch_kind kinds[] = { FETCH_URING, FETCH_PREAD, FETCH_SIM };

	(void)state;
	for (size_t k = 0; k < ARRAY_LENGTH(kinds); k++) {
		struct reader reader;

		if (!reader_init(&reader, kinds[k], quiet))
			continue;
		fetch_remove_file(reader.fetch, reader.file);
		fetch_remove_buffer(reader.fetch, reader.buffer);
		assert_int_equal(fetch_add_file(reader.fetch, reader.fd, &reader.file), 0);
		reader.buffer = FETCH_BUFFER_NONE;
		reader_start(&reader, 1, 0, 10000);
		reader_wait(&reader, 1);
		assert_int_equal(reader.errors[1], 0);
		reader_done(&reader);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(reads_of_any_length_are_right_with_uring),
		cmocka_unit_test(reads_of_any_length_are_right_with_pread),
		cmocka_unit_test(
			reads_are_right_through_short_reads_interrupts_delays_and_any_order),
		cmocka_unit_test(reads_behind_a_slower_disk_are_right_and_no_earlier_than_its_own),
		cmocka_unit_test(a_read_past_the_end_is_an_error_on_every_back_end),
		cmocka_unit_test(requests_side_by_side_in_the_file_share_a_read),
		cmocka_unit_test(a_read_that_is_shared_survives_all_that_is_no_error),
		cmocka_unit_test(who_shares_a_read_that_fails_is_read_again_alone),
		cmocka_unit_test(the_end_of_the_file_fails_only_who_asks_beyond_it),
		cmocka_unit_test(a_device_that_never_gets_anywhere_ends_in_an_error),
		cmocka_unit_test(a_queue_that_was_full_is_filled_again_when_half_of_it_is_free),
		cmocka_unit_test(one_failed_piece_fails_its_request_and_no_other),
		cmocka_unit_test(requests_beyond_the_table_are_refused),
		cmocka_unit_test(destroying_waits_for_what_is_in_flight),
		cmocka_unit_test(files_and_buffers_can_be_replaced),
	};

	return TEST_RUN(tests);
}
