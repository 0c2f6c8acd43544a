/* SPDX-License-Identifier: MIT */
/* Goal: a source shows the bytes of a file, plain or gzipped, and says so when they end early. */
#include <errno.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "formats/import/source.h"
#include "tests/helper.h"
#include "tests/unit/import_kit.h"

/* Lines of which many lie across the borders of windows. */
static struct kit_bytes many_lines(void)
{
	struct kit_bytes bytes = { 0 };

	while (bytes.size_bytes < 5 * MIB + 123)
		kit_print(
			&bytes, "line at %zu %.*s\n", bytes.size_bytes,
			(int)(bytes.size_bytes % 97),
			"................................................................................"
			"....................");
	return bytes;
}

static struct source *open_source(const char *path)
{
	struct source *source;
	struct why why;

	if (source_open(path, 16 * MIB, NULL, NULL, &source, &why) < 0)
		fail_msg("%s", why.text);
	return source;
}

static void assert_lines(const char *path, const struct kit_bytes *expected)
{
	struct source *source = open_source(path);
	size_t offset = 0, length;
	const char *line;
	struct why why;
	int r;

	while ((r = source_line(source, &line, &length, &why)) > 0) {
		assert_true(offset + length < expected->size_bytes);
		assert_memory_equal(line, expected->data + offset, length);
		assert_int_equal(expected->data[offset + length], '\n');
		offset += length + 1;
		assert_int_equal(source_offset(source), offset);
	}
	assert_int_equal(r, 0);
	assert_int_equal(offset, expected->size_bytes);
	source_close(source);
}

static void lines_across_windows_are_whole(void **state)
{
	struct kit_bytes bytes = many_lines();
	const char *path = test_path(*state, "lines");

	test_file_write(path, bytes.data, bytes.size_bytes);
	assert_lines(path, &bytes);
	free(bytes.data);
}

static void gzip_reads_like_plain_text(void **state)
{
	struct kit_bytes bytes = many_lines();
	const char *path = test_path(*state, "lines.gz");

	kit_write_gzip(path, bytes.data, bytes.size_bytes);
	assert_lines(path, &bytes);
	free(bytes.data);
}

static void several_gzip_members_are_one_text(void **state)
{
	struct kit_bytes text = { 0 }, packed = { 0 };
	const char *path = test_path(*state, "members.gz");

	for (int i = 0; i < 40; i++) {
		char line[32];
		size_t size_bytes;
		void *member;

		kit_print(&text, "member %d\n", i);
		(void)snprintf(line, sizeof(line), "member %d\n", i);
		kit_write_gzip(path, line, strlen(line));
		member = test_file_read(path, &size_bytes);
		kit_append(&packed, member, size_bytes);
		free(member);
	}
	/* tar pads with zeros; gzip passes over them. */
	kit_append(&packed, "\0\0\0\0\0\0\0", 7);
	test_file_write(path, packed.data, packed.size_bytes);
	assert_lines(path, &text);
	free(text.data);
	free(packed.data);
}

static void gzip_that_is_cut_anywhere_ends_in_an_error(void **state)
{
	const char *path = test_path(*state, "cut.gz");
	struct kit_bytes bytes = { 0 };
	size_t size_bytes;
	uint8_t *packed;

	for (int i = 0; i < 3000; i++)
		kit_print(&bytes, "%d\n", i * i);
	kit_write_gzip(path, bytes.data, bytes.size_bytes);
	packed = test_file_read(path, &size_bytes);
	for (size_t cut = 11; cut < size_bytes; cut += 1 + size_bytes / 50) {
		struct source *source;
		struct why why;
		int r;

		test_file_write(path, packed, cut);
		r = source_open(path, MIB, NULL, NULL, &source, &why);
		if (r == 0) {
			while ((r = source_more(source, &why)) > 0)
				source->at = source->end;
			source_close(source);
		}
		assert_int_equal(r, -ENODATA);
	}
	free(packed);
	free(bytes.data);
}

static void damaged_gzip_is_told(void **state)
{
	const char *path = test_path(*state, "damaged.gz");
	struct kit_bytes bytes = many_lines();
	struct source *source;
	size_t size_bytes;
	uint8_t *packed;
	struct why why;
	int r;

	kit_write_gzip(path, bytes.data, bytes.size_bytes);
	packed = test_file_read(path, &size_bytes);
	packed[size_bytes / 2] ^= 0x55;
	test_file_write(path, packed, size_bytes);
	r = source_open(path, MIB, NULL, NULL, &source, &why);
	if (r == 0) {
		while ((r = source_more(source, &why)) > 0)
			source->at = source->end;
		source_close(source);
	}
	assert_int_equal(r, -EUCLEAN);
	free(packed);
	free(bytes.data);
}

static void a_line_without_end_is_refused_at_the_limit(void **state)
{
	const char *path = test_path(*state, "endless");
	size_t size_bytes = 9 * MIB, length;
	char *text = malloc(size_bytes);
	struct source *source;
	const char *line;
	struct why why;

	assert_non_null(text);
	memset(text, 'x', size_bytes);
	test_file_write(path, text, size_bytes);
	assert_int_equal(source_open(path, 4 * MIB, NULL, NULL, &source, &why), 0);
	assert_int_equal(source_line(source, &line, &length, &why), -EUCLEAN);
	source_close(source);
	assert_int_equal(source_open(path, 16 * MIB, NULL, NULL, &source, &why), 0);
	assert_int_equal(source_line(source, &line, &length, &why), 1);
	assert_int_equal(length, size_bytes);
	source_close(source);
	free(text);
}

static void numbers_across_windows_are_whole(void **state)
{
	const char *path = test_path(*state, "numbers");
	struct kit_bytes bytes = { 0 };
	struct source *source;
	struct why why;
	int count = 0;

	for (; bytes.size_bytes < 5 * MIB; count++)
		kit_print(&bytes, "%d.5e+0%s", count, count % 5 ? " " : "\r\n");
	test_file_write(path, bytes.data, bytes.size_bytes);
	source = open_source(path);
	for (int i = 0; i < count; i++) {
		double value;

		if (source_double(source, &value, &why) < 0)
			fail_msg("%s", why.text);
		assert_true(value == i + 0.5);
	}
	assert_int_equal(source_blanks(source, &why), 0);
	source_close(source);
	free(bytes.data);
}

static void a_word_in_the_place_of_a_number_is_told_with_its_line(void **state)
{
	const char *path = test_path(*state, "word");
	struct source *source;
	struct why why;
	double value;

	test_file_write(path, "1\n2\n  three\n", 12);
	source = open_source(path);
	assert_int_equal(source_double(source, &value, &why), 0);
	assert_int_equal(source_double(source, &value, &why), 0);
	assert_int_equal(source_double(source, &value, &why), -EUCLEAN);
	assert_non_null(strstr(why.text, "line 3"));
	assert_non_null(strstr(why.text, "three"));
	source_close(source);
}

static void what_is_no_regular_file_is_refused_and_does_not_block(void **state)
{
	const char *path = test_path(*state, "pipe");
	struct source *source;
	struct why why;

	assert_int_equal(mkfifo(path, 0600), 0);
	assert_int_equal(source_open(path, MIB, NULL, NULL, &source, &why), -EINVAL);
	assert_int_equal(source_open(*state, MIB, NULL, NULL, &source, &why), -EISDIR);
	assert_int_equal(source_open(test_path(*state, "none"), MIB, NULL, NULL, &source, &why),
			 -ENOENT);
}

static void the_rest_is_never_underestimated(void **state)
{
	static const char *const names[] = { "plain", "zeros.gz" };
	size_t size_bytes = 8 * MIB;
	uint8_t *zeros = calloc(1, size_bytes);

	assert_non_null(zeros);
	/* Zeros: what gzip packs best. */
	test_file_write(test_path(*state, names[0]), zeros, size_bytes);
	kit_write_gzip(test_path(*state, names[1]), zeros, size_bytes);
	for (size_t i = 0; i < ARRAY_LENGTH(names); i++) {
		struct source *source = open_source(test_path(*state, names[i]));
		struct why why;

		do {
			uint64_t rest_bytes = size_bytes - source_offset(source);

			assert_true(source_rest_max(source) >= rest_bytes);
			if (source_is_plain(source))
				assert_int_equal(source_rest_max(source), rest_bytes);
			source->at = source->end;
		} while (source_more(source, &why) > 0);
		source_close(source);
	}
	free(zeros);
}

int main(void)
{
#define SOURCE_TEST(name)                                                                          \
	cmocka_unit_test_setup_teardown(name, test_folder_setup, test_folder_teardown)
	const struct CMUnitTest tests[] = {
		SOURCE_TEST(lines_across_windows_are_whole),
		SOURCE_TEST(gzip_reads_like_plain_text),
		SOURCE_TEST(several_gzip_members_are_one_text),
		SOURCE_TEST(gzip_that_is_cut_anywhere_ends_in_an_error),
		SOURCE_TEST(damaged_gzip_is_told),
		SOURCE_TEST(a_line_without_end_is_refused_at_the_limit),
		SOURCE_TEST(numbers_across_windows_are_whole),
		SOURCE_TEST(a_word_in_the_place_of_a_number_is_told_with_its_line),
		SOURCE_TEST(what_is_no_regular_file_is_refused_and_does_not_block),
		SOURCE_TEST(the_rest_is_never_underestimated),
	};

	return TEST_RUN(tests);
}
