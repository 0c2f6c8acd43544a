/* SPDX-License-Identifier: MIT */
/* Goal: both forms of STL, told apart, with the colours that some programs write; and hostile. */
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
#include "formats/base/clock.h"
#include "tests/helper.h"
#include "tests/unit/import_kit.h"

#define FACET(z)                                                                                   \
	"facet normal 0 0 0\nouter loop\nvertex 0 0 " z "\nvertex 1 0 " z "\nvertex 0 1 " z        \
	"\nendloop\nendfacet\n"

/* A binary file of count facets, whose attributes are counted up from first_attribute. */
static struct kit_bytes binary(const char *header, uint32_t count, uint32_t first_attribute)
{
	struct kit_bytes bytes = { 0 };
	char head[80] = "";

	memcpy(head, header, strlen(header));
	kit_append(&bytes, head, sizeof(head));
	kit_append(&bytes, &count, sizeof(count));
	for (uint32_t i = 0; i < count; i++) {
		const float facet[12] = { 9, 9, 9, 0, 0, (float)i, 1, 0, (float)i, 0, 1, (float)i };
		uint16_t attribute = (uint16_t)(first_attribute ? first_attribute + i : 0);

		kit_append(&bytes, facet, sizeof(facet));
		kit_append(&bytes, &attribute, sizeof(attribute));
	}
	return bytes;
}

static struct kit_model *import_binary(const char *folder, const char *header, uint32_t count,
				       uint32_t first_attribute)
{
	struct kit_bytes bytes = binary(header, count, first_attribute);
	struct kit_model *model = kit_import_bytes(folder, "a.stl", bytes.data, bytes.size_bytes);

	free(bytes.data);
	return model;
}

static void text_and_binary_read_the_same(void **state)
{
	struct kit_model *text = kit_import_text(
		*state, "b.stl",
		"solid \n" FACET("0") FACET(
			"1.0e0") "FACET NORMAL 1 0 0\r\n\tOuter Loop\r\nVertex 0 0 2\r\n"
				 "vertex 1 0 2 vertex 0 1 2\nEndLoop EndFacet\nendsolid name\n");
	struct kit_model *model = import_binary(*state, "made by a test", 3, 0);

	kit_assert_same(text, model);
	assert_false(model->positions_double);
	kit_model_free(text);
	kit_model_free(model);
}

static void binary_that_begins_with_solid_is_binary(void **state)
{
	struct kit_model *model = import_binary(*state, "solid block", 7, 0);

	kit_assert_ok(model);
	assert_int_equal(model->triangle_count, 7);
	kit_model_free(model);
}

static void gzip_reads_the_same(void **state)
{
	struct kit_bytes bytes = binary("solid block", 10000, 0);

	kit_assert_same_gzipped(*state, "a.stl", &bytes);
	free(bytes.data);
}

static void each_solid_of_a_text_is_a_part(void **state)
{
	struct kit_model *model =
		kit_import_text(*state, "a.stl",
				"solid  left side \r\n" FACET("0") "endsolid left\n"
								   "solid right\n" FACET("1")
									   FACET("2") "endsolid\n");

	kit_assert_ok(model);
	assert_int_equal(model->part_count, 2);
	assert_string_equal(model->parts[0].name, "left side");
	assert_string_equal(model->parts[1].name, "right");
	assert_int_equal(model->triangle_parts[0], 0);
	assert_int_equal(model->triangle_parts[2], 1);
	kit_model_free(model);
}

static void colours_of_facets_are_read_as_their_programs_write_them(void **state)
{
	/* VisCAM: bit 15 says that there is a colour, red is high. */
	struct kit_model *model = import_binary(*state, "", 1, 0x8000 | 31 << 10);

	kit_assert_ok(model);
	assert_int_equal(model->colours[0], 0xff0000ff);
	kit_model_free(model);
	/* Materialise: bit 15 says that the whole's colour counts, red is low. */
	model = import_binary(*state, "COLOR=\x10\x20\x30\xff", 1, 31);
	kit_assert_ok(model);
	assert_int_equal(model->parts[0].colour, 0xff302010);
	assert_int_equal(model->colours[0], 0xff0000ff);
	kit_model_free(model);
	model = import_binary(*state, "COLOR=\x10\x20\x30\xff", 1, 0x8000);
	kit_assert_ok(model);
	assert_int_equal(model->colours[0], 0xff302010);
	kit_model_free(model);
	/* Anything else behind a facet is no colour. */
	model = import_binary(*state, "", 3, 5);
	kit_assert_ok(model);
	assert_false(model->has_colours);
	kit_model_free(model);
}

static void a_facet_without_corners_is_dropped(void **state)
{
	struct kit_model *model =
		kit_import_text(*state, "a.stl",
				"solid\nfacet normal 0 0 1\nouter loop\nendloop\nendfacet\n" FACET(
					"0") "endsolid\n");

	kit_assert_ok(model);
	assert_int_equal(model->info.dropped_faces, 1);
	assert_int_equal(model->triangle_count, 1);
	kit_model_free(model);
}

/* ---- hostile ---- */

static void stl_refuses_what_is_no_stl(void **state)
{
	static const struct kit_refusal cases[] = {
		{ "", -ENODATA, "empty" },
		{ "Dear Sir, this is a letter.\n", -ENODATA, "too early" },
		{ "solid", -ENODATA, "endsolid" },
		{ "solid\n" FACET("0"), -ENODATA, "endsolid" },
		{ "solid\nfacet normal 0 0 0\nouter loop\nvertex 0 0", -ENODATA, "line 4" },
		{ "solid\nfacet normal 0 0 0\nouter loop\nvertex 0 0 x\n", -EUCLEAN, "line 4" },
		{ "solid\nfacet normal 0 0 0\nouter loop\nvertex 0 0 0\n" FACET("0") "endsolid\n",
		  -EUCLEAN, "without its end" },
		{ "solid\nfacet vertex 0 0 0 vertex 0 0 0 vertex 0 0 0 vertex 0 0 0\n", -EUCLEAN,
		  "three corners" },
		{ "solid\nfacet vertex 0 0 0 endsolid\n", -EUCLEAN, "without its end" },
		{ "solid\nwhatever\n", -EUCLEAN, "wanted" },
		{ "solid a\nendsolid\nwhatever\n", -EUCLEAN, "wanted" },
	};

	kit_assert_all_refused(*state, "a.stl", cases, ARRAY_LENGTH(cases));
}

static void a_count_that_the_file_cannot_hold_is_refused_at_once(void **state)
{
	struct kit_bytes bytes = binary("", 4, 0);
	uint64_t begin_ns = clock_spent_ns();
	struct kit_model *model;

	memset(bytes.data + 80, 0xff, 4);
	model = kit_import_bytes(*state, "a.stl", bytes.data, bytes.size_bytes);
	kit_assert_refused(model, -ENODATA, "claims 4294967295");
	assert_true(clock_spent_ns() - begin_ns < 100 * NS_PER_MS);
	kit_model_free(model);
	free(bytes.data);
}

static void a_binary_file_cut_anywhere_is_refused(void **state)
{
	struct kit_bytes bytes = binary("", 100, 0);

	for (size_t size_bytes = 1; size_bytes < bytes.size_bytes; size_bytes += 37) {
		struct kit_model *model = kit_import_bytes(*state, "a.stl", bytes.data, size_bytes);

		kit_assert_refused(model, -ENODATA, "");
		kit_model_free(model);
	}
	free(bytes.data);
}

static void a_word_that_never_ends_is_refused(void **state)
{
	kit_assert_endless_refused(*state, "a.stl", "solid a\n");
}

int main(void)
{
#define STL_TEST(name)                                                                             \
	cmocka_unit_test_setup_teardown(name, test_folder_setup, test_folder_teardown)
	const struct CMUnitTest tests[] = {
		STL_TEST(text_and_binary_read_the_same),
		STL_TEST(binary_that_begins_with_solid_is_binary),
		STL_TEST(gzip_reads_the_same),
		STL_TEST(each_solid_of_a_text_is_a_part),
		STL_TEST(colours_of_facets_are_read_as_their_programs_write_them),
		STL_TEST(a_facet_without_corners_is_dropped),
		STL_TEST(stl_refuses_what_is_no_stl),
		STL_TEST(a_count_that_the_file_cannot_hold_is_refused_at_once),
		STL_TEST(a_binary_file_cut_anywhere_is_refused),
		STL_TEST(a_word_that_never_ends_is_refused),
	};

	return TEST_RUN(tests);
}
