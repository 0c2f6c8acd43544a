/* SPDX-License-Identifier: MIT */
/* Goal: formats/base does what its headers say, at the edges of each range. */
#include <errno.h>
#include <limits.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "formats/base/file.h"
#include "formats/base/histogram.h"
#include "formats/base/list.h"
#include "formats/base/text.h"
#include "formats/base/why.h"

static void text_to_size_reads_suffixes_and_refuses_the_rest(void **state)
{
	static const struct {
		const char *text;
		int result;
		uint64_t bytes;
	} cases[] = {
		{ "0", 0, 0 },
		{ "4096", 0, 4096 },
		{ "256M", 0, 256 * MIB },
		{ "256m", 0, 256 * MIB },
		{ "1G", 0, GIB },
		{ "16777215T", 0, UINT64_C(16777215) << 40 },
		{ "16777216T", -ERANGE, 0 },
		{ "18446744073709551615", 0, UINT64_MAX },
		{ "18446744073709551616", -ERANGE, 0 },
		{ "", -EINVAL, 0 },
		{ "-1", -EINVAL, 0 },
		{ "+1", -EINVAL, 0 },
		{ " 1", -EINVAL, 0 },
		{ "1MB", -EINVAL, 0 },
		{ "M", -EINVAL, 0 },
		{ "1.5G", -EINVAL, 0 },
	};

	(void)state;
	for (size_t i = 0; i < ARRAY_LENGTH(cases); i++) {
		uint64_t bytes = 77;

		assert_int_equal(text_to_size(cases[i].text, &bytes), cases[i].result);
		assert_int_equal(bytes, cases[i].result == 0 ? cases[i].bytes : 77);
	}
}

static void text_to_double_refuses_what_is_not_a_finite_number(void **state)
{
	static const char *const refused[] = { "", " 1", "1 ", "x", "1x", "nan", "inf", "1e999" };
	double value = 7;

	(void)state;
	assert_int_equal(text_to_double("0.001", &value), 0);
	assert_true(value == 0.001);
	assert_int_equal(text_to_double("-1e-3", &value), 0);
	assert_true(value == -1e-3);
	for (size_t i = 0; i < ARRAY_LENGTH(refused); i++)
		assert_true(text_to_double(refused[i], &value) < 0);
	assert_true(value == -1e-3);
}

static void text_to_u64_reads_its_whole_range(void **state)
{
	uint64_t value = 7;

	(void)state;
	assert_int_equal(text_to_u64("18446744073709551615", &value), 0);
	assert_true(value == UINT64_MAX);
	assert_int_equal(text_to_u64("18446744073709551616", &value), -ERANGE);
	assert_int_equal(text_to_u64("1 ", &value), -EINVAL);
	assert_int_equal(text_to_u64("", &value), -EINVAL);
}

static void text_from_size_rounds_to_one_digit(void **state)
{
	char buffer[TEXT_SIZE_BYTES];

	(void)state;
	assert_string_equal(text_from_size(0, buffer), "0 B");
	assert_string_equal(text_from_size(1023, buffer), "1023 B");
	assert_string_equal(text_from_size(1536, buffer), "1.5 KiB");
	assert_string_equal(text_from_size(UINT64_MAX, buffer), "16.0 EiB");
}

static void text_write_json_escapes_and_repairs(void **state)
{
	char *text = NULL;
	size_t length = 0;
	FILE *out = open_memstream(&text, &length);

	(void)state;
	assert_non_null(out);
	text_write_json(out, "a\"b\\c\n\xc3\xa9\xff\xc3");
	fclose(out);
	assert_string_equal(text, "\"a\\\"b\\\\c\\u000a\xc3\xa9\\ufffd\\ufffd\"");
	free(text);
}

static void why_keeps_the_reason_and_puts_places_in_front(void **state)
{
	struct why why;

	(void)state;
	assert_int_equal(why_set(&why, -EUCLEAN, "node %d is its own child", 7), -EUCLEAN);
	why_prefix(&why, "a.ooc");
	assert_string_equal(why.text, "a.ooc: node 7 is its own child");
	assert_int_equal(why_errno(&why, -ENOENT, "open"), -ENOENT);
	assert_string_equal(why.text, "open: No such file or directory");
	assert_int_equal(why_set(NULL, -EIO, "nobody asks"), -EIO);
	/* A long reason is cut, and still ends. */
	why_set(&why, -EIO, "%0600d", 1);
	why_prefix(&why, "%0600d", 2);
	assert_int_equal(strlen(why.text), WHY_TEXT_BYTES - 1);
}

static void file_read_at_tells_the_end_of_the_file(void **state)
{
	int fd = memfd_create("test", MFD_CLOEXEC);
	char bytes[8];

	(void)state;
	assert_true(fd >= 0);
	assert_int_equal(file_write_at(fd, "abcdef", 6, 2), 0);
	assert_int_equal(file_read_at(fd, bytes, 6, 2), 0);
	assert_memory_equal(bytes, "abcdef", 6);
	assert_int_equal(file_read_at(fd, bytes, 6, 3), -ENODATA);
	fd = fd_close(fd);
	assert_int_equal(fd, -1);
	assert_int_equal(file_read_at(fd, bytes, 1, 0), -EBADF);
}

struct item {
	int value;
	struct list link;
};

static void list_walks_in_order_while_entries_are_taken_off(void **state)
{
	struct item items[4];
	struct list head;
	int sum = 0;

	(void)state;
	list_init(&head);
	assert_true(list_is_empty(&head));
	for (int i = 0; i < 4; i++) {
		items[i].value = i + 1;
		list_push_back(&head, &items[i].link);
	}
	LIST_FOR_EACH (link, &head) {
		struct item *item = LIST_ENTRY(link, struct item, link);

		sum = sum * 10 + item->value;
		if (item->value % 2 == 0)
			list_remove(link);
	}
	assert_int_equal(sum, 1234);
	list_remove(&items[1].link); /* again: allowed */
	list_push_front(&head, &items[3].link);
	sum = 0;
	LIST_FOR_EACH (link, &head)
		sum = sum * 10 + LIST_ENTRY(link, struct item, link)->value;
	assert_int_equal(sum, 413);
}

static void bytes_are_zero_sees_any_other_byte(void **state)
{
	uint8_t bytes[9] = { 0 };

	(void)state;
	assert_true(bytes_are_zero(bytes, 0));
	assert_true(bytes_are_zero(bytes, sizeof(bytes)));
	for (size_t i = 0; i < sizeof(bytes); i++) {
		bytes[i] = 1;
		assert_false(bytes_are_zero(bytes, sizeof(bytes)));
		bytes[i] = 0;
	}
}

static void histogram_puts_each_time_below_its_bound(void **state)
{
	static const uint64_t times_ns[] = { 0, 1023, 1024, 2047, 2048, 1000000, UINT64_MAX };
	struct histogram histogram = { 0 };
	uint64_t count = 0;

	(void)state;
	for (size_t i = 0; i < ARRAY_LENGTH(times_ns); i++) {
		struct histogram one = { 0 };
		uint32_t bucket = 0;

		histogram_add(&one, times_ns[i]);
		histogram_add(&histogram, times_ns[i]);
		while (one.counts[bucket] == 0)
			bucket++;
		assert_true(times_ns[i] < histogram_bound_ns(bucket) ||
			    bucket == HISTOGRAM_BUCKET_COUNT - 1);
		if (bucket > 0)
			assert_true(times_ns[i] >= histogram_bound_ns(bucket - 1));
	}
	for (uint32_t i = 0; i < HISTOGRAM_BUCKET_COUNT; i++)
		count += histogram.counts[i];
	assert_int_equal(count, ARRAY_LENGTH(times_ns));
	assert_int_equal(histogram.count, count);
	assert_int_equal(histogram_quantile_ns(&histogram, 0.0), 1024);
	assert_int_equal(histogram_quantile_ns(&histogram, 0.5), 2048);
	assert_true(histogram_quantile_ns(&histogram, 1.0) == UINT64_MAX);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(text_to_size_reads_suffixes_and_refuses_the_rest),
		cmocka_unit_test(text_to_double_refuses_what_is_not_a_finite_number),
		cmocka_unit_test(text_to_u64_reads_its_whole_range),
		cmocka_unit_test(text_from_size_rounds_to_one_digit),
		cmocka_unit_test(text_write_json_escapes_and_repairs),
		cmocka_unit_test(why_keeps_the_reason_and_puts_places_in_front),
		cmocka_unit_test(file_read_at_tells_the_end_of_the_file),
		cmocka_unit_test(list_walks_in_order_while_entries_are_taken_off),
		cmocka_unit_test(bytes_are_zero_sees_any_other_byte),
		cmocka_unit_test(histogram_puts_each_time_below_its_bound),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
