/* SPDX-License-Identifier: MIT */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "tests/helper.h"
#include "tools/bench/base/page.h"

static char *text_of(const char *path)
{
	size_t bytes;
	char *read = test_file_read(path, &bytes);
	char *text = strndup(read, bytes);

	free(read);
	return text;
}

static void page_holds_all_that_was_put_on_it(void **state)
{
	static const char svg[] =
		"<?xml version=\"1.0\"?>\n<!DOCTYPE svg>\n<svg id=\"it\">\n</svg>\n";
	static const char *const heads[] = { "a", "b<c", NULL };
	static const char *const cells[] = { "1 & 2", "3", NULL };
	static uint8_t red[3] = { 255, 0, 0 };
	const struct rgb_image image = { 1, 1, red };
	const char *path = test_path(*state, "p.html");
	struct page *page;
	struct why why;
	char *text;

	test_file_write(test_path(*state, "p.svg"), svg, sizeof(svg) - 1);
	assert_int_equal(page_create(path, "T<t>", &page, &why), 0);
	page_heading(page, "head & shoulders");
	page_paragraph(page, "%d < %d", 1, 2);
	page_table_begin(page, heads);
	page_row(page, cells, true);
	page_table_end(page);
	assert_int_equal(page_svg(page, test_path(*state, "p.svg"), &why), 0);
	assert_int_equal(page_svg(page, test_path(*state, "none.svg"), &why), -ENOENT);
	assert_int_equal(page_image(page, &image, "red"), 0);
	/* It has its name when it is whole. */
	assert_string_equal(test_folder_list(*state), "p.html.part p.svg ");
	assert_int_equal(page_finish(page, &why), 0);
	assert_string_equal(test_folder_list(*state), "p.html p.svg ");
	text = text_of(path);
	assert_non_null(strstr(text, "<title>T&lt;t&gt;</title>"));
	assert_non_null(strstr(text, "<h2>head &amp; shoulders</h2>"));
	assert_non_null(strstr(text, "<p>1 &lt; 2</p>"));
	assert_non_null(strstr(text, "<th>a</th><th>b&lt;c</th>"));
	assert_non_null(strstr(text, "<tr class=\"mark\"><td>1 &amp; 2</td><td>3</td></tr>"));
	assert_non_null(strstr(text, "<svg id=\"it\">"));
	assert_null(strstr(text, "<?xml"));
	assert_non_null(strstr(text, "data:image/png;base64,iVBORw0KGgo"));
	free(text);
}

static void page_that_is_abandoned_leaves_nothing(void **state)
{
	struct page *page;
	struct why why;

	assert_int_equal(page_create(test_path(*state, "p.html"), "t", &page, &why), 0);
	assert_null(page_abandon(page));
	assert_string_equal(test_folder_list(*state), "");
	assert_int_equal(page_create(test_path(*state, "no/p.html"), "t", &page, &why), -ENOENT);
}

#define IN_FOLDER(test)                                                                            \
	cmocka_unit_test_setup_teardown(test, test_folder_setup, test_folder_teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		IN_FOLDER(page_holds_all_that_was_put_on_it),
		IN_FOLDER(page_that_is_abandoned_leaves_nothing),
	};

	return TEST_RUN(tests);
}
