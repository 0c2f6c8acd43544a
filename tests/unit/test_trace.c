/* SPDX-License-Identifier: MIT */
/*
 * Goal: what was written to a trace is read from it, a cut one up to where it was cut, a damaged one
 * up to the damage; and formats/TRACE.md says what the headers say.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <fcntl.h>
#include <sched.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/store/store_checksum.h"
#include "formats/trace/trace_reader.h"
#include "formats/trace/trace_writer.h"
#include "tests/helper.h"

#define NODES 3000u

static struct trace_writer *writer_new(const char *path)
{
	const struct trace_header header = {
		.cache_bytes = 64 * MIB,
		.start_ns = 7,
		.replacement = "lru",
	};
	int fd = open(path, O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
	struct trace_writer *writer;
	struct why why;

	if (trace_writer_create(fd, &header, &writer, &why) < 0)
		fail_msg("%s", why.text);
	return writer;
}

static struct trace_reader *reader_new(const char *path)
{
	struct trace_reader *reader;
	struct why why;

	if (trace_reader_open_path(path, &reader, &why) < 0)
		fail_msg("%s", why.text);
	return reader;
}

static void add(struct trace_writer *writer, struct trace_event event)
{
	trace_writer_add(writer, &event);
}

static void add_open(struct trace_writer *writer)
{
	struct trace_event event = {
		.kind = TRACE_OPEN,
		.count = NODES,
		.path_bytes = 12,
		.path = "/a/plant.ooc and more",
	};

	memset(event.uuid, 0xab, sizeof(event.uuid));
	trace_writer_add(writer, &event);
}

static void add_node(struct trace_writer *writer, uint32_t node)
{
	add(writer, (struct trace_event){
			    .kind = TRACE_NODE, .node = node, .pages = 1 + node % 9, .bytes = 77 });
}

static void expect(struct trace_reader *reader, struct trace_event wanted)
{
	struct trace_event event;
	struct why why;
	int r = trace_reader_next(reader, &event, &why);

	if (r < 0)
		fail_msg("%s", why.text);
	assert_int_equal(r, 1);
	assert_string_equal(trace_kind_name(event.kind), trace_kind_name(wanted.kind));
	assert_int_equal(event.ticks, wanted.ticks);
	if (trace_kind_has_session(event.kind))
		assert_int_equal(event.session, wanted.session);
	if (trace_kind_has_entry(event.kind) || event.kind == TRACE_NODE)
		assert_int_equal(event.entry, wanted.entry);
	if (event.kind == TRACE_SET || event.kind == TRACE_OPEN)
		assert_int_equal(event.count, wanted.count);
}

static void expect_end(struct trace_reader *reader, bool was_cut)
{
	struct trace_event event;
	struct why why;

	assert_int_equal(trace_reader_next(reader, &event, &why), 0);
	assert_int_equal(trace_reader_was_cut(reader), was_cut);
}

/* Every kind once, in an order that may be. */
static const struct trace_event story[] = {
	{ .kind = TRACE_BEGIN, .session = 4, .ticks = 3 },
	{ .kind = TRACE_SET, .session = 4, .count = 2, .ticks = 3 },
	{ .kind = TRACE_MISS, .session = 4, .entry = 2, .ticks = 3 },
	{ .kind = TRACE_MISS, .session = 4, .entry = 1, .ticks = 3 },
	{ .kind = TRACE_FETCH, .entry = 2, .ticks = 4 },
	{ .kind = TRACE_PREFETCH, .entry = 0, .ticks = 4 },
	{ .kind = TRACE_READY, .entry = 2, .ticks = 900000000 },
	{ .kind = TRACE_FAIL, .entry = 1, .ticks = 900000000 },
	{ .kind = TRACE_REFUSE, .session = 4, .entry = 1, .ticks = 900000000 },
	{ .kind = TRACE_BEGIN, .session = 5, .ticks = 900000001 },
	{ .kind = TRACE_HIT, .session = 5, .entry = 2, .ticks = 900000002 },
	{ .kind = TRACE_DROP, .session = 4, .entry = 2, .ticks = 900000002 },
	{ .kind = TRACE_HIT, .session = 4, .entry = 2, .ticks = 900000002 },
	{ .kind = TRACE_DROP, .session = 4, .entry = 2, .ticks = 900000002 },
	{ .kind = TRACE_DROP, .session = 5, .entry = 2, .ticks = 900000002 },
	{ .kind = TRACE_FREE, .entry = 2, .ticks = 900000002 },
	{ .kind = TRACE_EVICT, .entry = 2, .ticks = 900000002 },
	{ .kind = TRACE_ADOPT, .entry = 1, .ticks = 900000002 },
	{ .kind = TRACE_END, .session = 4, .ticks = 900000003 },
	{ .kind = TRACE_CLOSE, .store = 0, .ticks = 900000003 },
};

static void write_story(const char *path)
{
	struct trace_writer *writer = writer_new(path);

	add_open(writer);
	for (uint32_t i = 0; i < 3; i++)
		add_node(writer, 2 * i);
	for (size_t i = 0; i < ARRAY_LENGTH(story); i++)
		add(writer, story[i]);
	trace_writer_destroy(writer);
}

static void every_kind_of_event_comes_back(void **state)
{
	const char *path = test_path(*state, "a.trace");
	struct trace_reader *reader;

	write_story(path);
	reader = reader_new(path);
	assert_int_equal(trace_reader_header(reader)->cache_bytes, 64 * MIB);
	assert_string_equal(trace_reader_header(reader)->replacement, "lru");
	expect(reader, (struct trace_event){ .kind = TRACE_OPEN, .count = NODES });
	assert_string_equal(trace_reader_store(reader, 0)->path, "/a/plant.ooc");
	assert_int_equal(trace_reader_store(reader, 0)->uuid[15], 0xab);
	for (uint32_t i = 0; i < 3; i++)
		expect(reader, (struct trace_event){ .kind = TRACE_NODE, .entry = i });
	assert_int_equal(trace_reader_entry(reader, 2)->node, 4);
	assert_int_equal(trace_reader_entry(reader, 2)->pages, 5);
	assert_int_equal(trace_reader_entry(reader, 2)->bytes, 77);
	for (size_t i = 0; i < ARRAY_LENGTH(story); i++)
		expect(reader, story[i]);
	expect_end(reader, false);
	trace_reader_close(reader);
}

static void many_blocks_come_back_in_order_and_an_event_takes_few_bytes(void **state)
{
	const char *path = test_path(*state, "a.trace");
	struct trace_writer *writer = writer_new(path);
	struct trace_reader *reader;
	uint32_t event_count = 0;

	add_open(writer);
	for (uint32_t i = 0; i < NODES; i++)
		add_node(writer, i);
	/* As a viewer does that turns: some come into sight and some go, at each frame. */
	for (uint32_t i = 0; i < 100 * NODES; i++, event_count++)
		add(writer, (struct trace_event){ .kind = i < NODES ? TRACE_MISS : TRACE_FREE,
						  .entry = i * 7 % NODES,
						  .ticks = i / 100 * 333 });
	trace_writer_destroy(writer);

	reader = reader_new(path);
	expect(reader, (struct trace_event){ .kind = TRACE_OPEN, .count = NODES });
	for (uint32_t i = 0; i < NODES; i++)
		expect(reader, (struct trace_event){ .kind = TRACE_NODE, .entry = i });
	for (uint32_t i = 0; i < 100 * NODES; i++)
		expect(reader, (struct trace_event){ .kind = i < NODES ? TRACE_MISS : TRACE_FREE,
						     .entry = i * 7 % NODES,
						     .ticks = i / 100 * 333 });
	expect_end(reader, false);
	assert_true(trace_reader_event_bytes(reader) > 2 * TRACE_BLOCK_BYTES_MAX);
	assert_true(2 * trace_reader_event_bytes(reader) < 5u * event_count);
	trace_reader_close(reader);
}

static void a_flushed_trace_can_be_read_while_it_is_written(void **state)
{
	const char *path = test_path(*state, "a.trace");
	struct trace_writer *writer = writer_new(path);
	struct trace_reader *reader = reader_new(path);
	struct trace_event event;
	struct why why;
	int r;

	add_open(writer);
	trace_writer_flush(writer);
	/* The writer's thread gets there. */
	while ((r = trace_reader_next(reader, &event, &why)) == 0)
		(void)sched_yield();
	assert_int_equal(r, 1);
	assert_int_equal(event.kind, TRACE_OPEN);
	trace_reader_close(reader);
	trace_writer_destroy(writer);
}

static void a_cut_trace_is_read_up_to_its_last_whole_block(void **state)
{
	const char *path = test_path(*state, "a.trace");
	const char *cut_path = test_path(*state, "cut.trace");
	size_t bytes;
	uint8_t *data;

	write_story(path);
	data = test_file_read(path, &bytes);
	for (size_t cut = sizeof(struct trace_header); cut < bytes; cut++) {
		struct trace_reader *reader;

		test_file_write(cut_path, data, cut);
		reader = reader_new(cut_path);
		expect_end(reader, cut > sizeof(struct trace_header));
		trace_reader_close(reader);
	}
	free(data);
}

static void every_damaged_byte_is_noticed(void **state)
{
	const char *path = test_path(*state, "a.trace");
	size_t bytes;
	uint8_t *data;

	write_story(path);
	data = test_file_read(path, &bytes);
	for (size_t i = 0; i < bytes; i++) {
		struct trace_reader *reader = NULL;
		struct trace_event event;
		struct why why;
		int r;

		data[i] ^= 0x10;
		test_file_write(path, data, bytes);
		data[i] ^= 0x10;
		r = trace_reader_open_path(path, &reader, &why);
		if (r == 0)
			r = trace_reader_next(reader, &event, &why);
		/* A length that grew says that the rest is missing. */
		if (r == 0)
			assert_true(trace_reader_was_cut(reader));
		else
			assert_true(r < 0);
		trace_reader_close(reader);
	}
	free(data);
}

/* Writes bytes of events behind the story's first events. */
static int read_after(const char *path, const uint8_t *events, size_t byte_count)
{
	struct trace_writer *writer = writer_new(path);
	struct trace_block head = { .bytes = (uint32_t)byte_count };
	struct trace_reader *reader;
	struct trace_event event;
	uint8_t *data;
	uint8_t *all;
	struct why why;
	size_t bytes;
	int r;

	add_open(writer);
	add_node(writer, 1);
	add(writer, (struct trace_event){ .kind = TRACE_MISS });
	trace_writer_destroy(writer);
	data = test_file_read(path, &bytes);
	head.checksum = store_checksum(events, byte_count, 1);
	all = malloc(bytes + sizeof(head) + byte_count);
	memcpy(all, data, bytes);
	memcpy(all + bytes, &head, sizeof(head));
	memcpy(all + bytes + sizeof(head), events, byte_count);
	test_file_write(path, all, bytes + sizeof(head) + byte_count);
	reader = reader_new(path);
	while ((r = trace_reader_next(reader, &event, &why)) > 0)
		;
	trace_reader_close(reader);
	free(data);
	free(all);
	return r;
}

#define HEAD(kind, argument) (uint8_t)((argument) << TRACE_KIND_BITS | (unsigned)TRACE_##kind)

static void what_contradicts_what_came_before_is_refused(void **state)
{
	const char *path = test_path(*state, "a.trace");
	const uint8_t good[] = { HEAD(DROP, 0) };
	const uint8_t wants_twice[] = { HEAD(HIT, 0) };
	const uint8_t drops_twice[] = { HEAD(DROP, 0), HEAD(DROP, 0) };
	const uint8_t others_drop[] = { HEAD(SESSION, 3), HEAD(DROP, 0) };
	const uint8_t unknown_entry[] = { HEAD(EVICT, 2) };
	const uint8_t entry_below_zero[] = { HEAD(EVICT, 1) };
	const uint8_t unknown_store[] = { HEAD(NODE, 1), 0, 1, 1 };
	const uint8_t no_pages[] = { HEAD(NODE, 0), 0, 0, 1 };
	const uint8_t closes_twice[] = { HEAD(CLOSE, 0), HEAD(CLOSE, 0) };
	const uint8_t of_a_closed_store[] = { HEAD(CLOSE, 0), HEAD(NODE, 0), 0, 1, 1 };
	const uint8_t no_kind[] = { TRACE_KIND_COUNT_ };
	const uint8_t cut[] = { HEAD(NODE, 0), 0 };
	const uint8_t only_a_time[] = { HEAD(TIME, 1) };

	assert_int_equal(read_after(path, good, sizeof(good)), 0);
	assert_int_equal(read_after(path, wants_twice, sizeof(wants_twice)), -EUCLEAN);
	assert_int_equal(read_after(path, drops_twice, sizeof(drops_twice)), -EUCLEAN);
	assert_int_equal(read_after(path, others_drop, sizeof(others_drop)), -EUCLEAN);
	assert_int_equal(read_after(path, unknown_entry, sizeof(unknown_entry)), -EUCLEAN);
	assert_int_equal(read_after(path, entry_below_zero, sizeof(entry_below_zero)), -EUCLEAN);
	assert_int_equal(read_after(path, unknown_store, sizeof(unknown_store)), -EUCLEAN);
	assert_int_equal(read_after(path, no_pages, sizeof(no_pages)), -EUCLEAN);
	assert_int_equal(read_after(path, closes_twice, sizeof(closes_twice)), -EUCLEAN);
	assert_int_equal(read_after(path, of_a_closed_store, sizeof(of_a_closed_store)), -EUCLEAN);
	assert_int_equal(read_after(path, no_kind, sizeof(no_kind)), -EUCLEAN);
	assert_int_equal(read_after(path, cut, sizeof(cut)), -EUCLEAN);
	assert_int_equal(read_after(path, only_a_time, sizeof(only_a_time)), -EUCLEAN);
}

static void a_full_disk_ends_a_trace_that_stays_good(void **state)
{
	const char *path = test_path(*state, "a.trace");
	struct rlimit before;
	struct rlimit limit;
	struct trace_reader *reader;
	struct trace_writer *writer;
	struct trace_event event;
	struct why why;
	int r;

	assert_int_equal(getrlimit(RLIMIT_FSIZE, &before), 0);
	limit = (struct rlimit){ 3 * TRACE_BLOCK_BYTES_MAX, before.rlim_max };
	(void)signal(SIGXFSZ, SIG_IGN);
	assert_int_equal(setrlimit(RLIMIT_FSIZE, &limit), 0);
	writer = writer_new(path);
	add_open(writer);
	for (uint32_t i = 0; i < NODES; i++)
		add_node(writer, i);
	/* Long after the limit, it still takes events and says why it has ended. */
	for (uint32_t i = 0; i < 100 * NODES || trace_writer_error(writer) == 0; i++)
		add(writer, (struct trace_event){ .kind = TRACE_FREE, .entry = i * 7 % NODES });
	assert_int_equal(trace_writer_error(writer), -EFBIG);
	trace_writer_destroy(writer);
	assert_int_equal(setrlimit(RLIMIT_FSIZE, &before), 0);

	reader = reader_new(path);
	while ((r = trace_reader_next(reader, &event, &why)) > 0)
		;
	assert_int_equal(r, 0);
	assert_false(trace_reader_was_cut(reader));
	trace_reader_close(reader);
}

static void the_specification_lists_every_kind_with_its_number(void **state)
{
	char path[4096];
	size_t bytes;
	char *data;
	char *text;

	(void)state;
	assert_non_null(getenv("OOCD_SOURCE"));
	(void)snprintf(path, sizeof(path), "%s/formats/TRACE.md", getenv("OOCD_SOURCE"));
	data = test_file_read(path, &bytes);
	text = strndup(data, bytes);
	for (unsigned kind = 0; kind < TRACE_KIND_COUNT_; kind++) {
		char row[64];

		(void)snprintf(row, sizeof(row), "\n| %u | %s | %s", kind, trace_kind_name(kind),
			       trace_kind_has_entry(kind) ? "entry |" : "");
		if (!strstr(text, row))
			fail_msg("TRACE.md has no row%s", row);
	}
	(void)snprintf(path, sizeof(path), "\n| %u | ", TRACE_KIND_COUNT_);
	assert_null(strstr(text, path));
	free(text);
	free(data);
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, test_folder_setup, test_folder_teardown)
	const struct CMUnitTest tests[] = {
		TEST(every_kind_of_event_comes_back),
		TEST(many_blocks_come_back_in_order_and_an_event_takes_few_bytes),
		TEST(a_flushed_trace_can_be_read_while_it_is_written),
		TEST(a_cut_trace_is_read_up_to_its_last_whole_block),
		TEST(every_damaged_byte_is_noticed),
		TEST(what_contradicts_what_came_before_is_refused),
		TEST(a_full_disk_ends_a_trace_that_stays_good),
		TEST(the_specification_lists_every_kind_with_its_number),
	};

	return TEST_RUN(tests);
}
