/* SPDX-License-Identifier: MIT */
/* Goal: numbers of model files are right to the last bit, in every locale. */
#include <locale.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "formats/import/number.h"
#include "tests/helper.h"

static uint64_t random_state = 1;

static uint64_t random_u64(void)
{
	random_state ^= random_state << 13;
	random_state ^= random_state >> 7;
	random_state ^= random_state << 17;
	return random_state;
}

/* The C library is the judge: glibc's is exact. */
static void assert_like_the_library(const char *text)
{
	double expected = strtod(text, NULL), value = -1.0;
	float expected_single = strtof(text, NULL), single = -1.0f;
	const char *end = number_to_double(text, &value);

	if (!end || *end != '\0' || memcmp(&value, &expected, sizeof(value)) != 0)
		fail_msg("double \"%s\": %a, not %a", text, value, expected);
	end = number_to_float(text, &single);
	if (!end || *end != '\0' || memcmp(&single, &expected_single, sizeof(single)) != 0)
		fail_msg("float \"%s\": %a, not %a", text, (double)single, (double)expected_single);
}

static void written_numbers_are_read_to_the_last_bit(void **state)
{
	static const char *const texts[] = {
		"0",
		"-0",
		"+1",
		"1.",
		".5",
		"-.5e1",
		"1e5",
		"1E+5",
		"1e-5",
		"00012.500",
		"1e22",
		"1e23",
		"9007199254740993",
		"9007199254740992",
		"9007199254740991.5",
		"16777217",
		"16777219",
		"1.00000005960464477539062",
		"1.00000005960464477539063",
		"1e-27",
		"123456789012345678",
		"18446744073709551615",
		"18446744073709551616",
		"99999999999999999999999999",
		"1.7976931348623157e308",
		"1.7976931348623159e308",
		"1e309",
		"-1e400",
		"4.9e-324",
		"2e-324",
		"2.2250738585072011e-308",
		"3.4028235e38",
		"3.4028236e38",
		"1.4e-45",
		"7e-46",
		"1e-46",
		"1.1754943e-38",
		"0.000000000000000000000000000000000001",
		"1e-400",
		"8.5e-27",
		"0.1",
		"0.3",
		"2.675",
		"5e-324",
		"340282346638528859811704183484516925440",
		"0.00000000000000000000000000000000000000000000000000000000000000000000000000000001e80",
		"123456789.123456789123456789",
		"4503599627370496.5",
		"4503599627370497.5",
	};

	(void)state;
	for (size_t i = 0; i < ARRAY_LENGTH(texts); i++)
		assert_like_the_library(texts[i]);
}

static void random_decimals_are_read_to_the_last_bit(void **state)
{
	(void)state;
	for (int i = 0; i < 300000; i++) {
		uint64_t bits = random_u64();
		char text[64];
		double value;

		memcpy(&value, &bits, sizeof(value));
		switch (i % 4) {
		case 0:
			(void)snprintf(text, sizeof(text), "%.*f", (int)(bits % 18),
				       (double)(int64_t)bits / 1e13);
			break;
		case 1:
			(void)snprintf(text, sizeof(text), "%.*g", (int)(bits % 20) + 1,
				       (double)(bits % 1000000007) * 1e-5);
			break;
		case 2:
			(void)snprintf(text, sizeof(text), "%llu.%llue%d",
				       (unsigned long long)(bits % 100000),
				       (unsigned long long)(random_u64() % 10000000000),
				       (int)(random_u64() % 61) - 30);
			break;
		default:
			if (!isfinite(value))
				continue;
			(void)snprintf(text, sizeof(text), "%.*g", (int)(bits % 18) + 1, value);
		}
		assert_like_the_library(text);
	}
}

static void halves_between_floats_go_to_the_even_one(void **state)
{
	(void)state;
	for (int i = 0; i < 20000; i++) {
		uint32_t bits = (uint32_t)(random_u64() % 0x7f000000);
		char text[256];
		float low, high;

		memcpy(&low, &bits, sizeof(low));
		bits++;
		memcpy(&high, &bits, sizeof(high));
		/* The middle is exact as a double, and %.120g writes all of its digits. */
		(void)snprintf(text, sizeof(text), "%.120g", ((double)low + (double)high) / 2.0);
		assert_like_the_library(text);
	}
}

static void a_number_ends_where_it_ends(void **state)
{
	static const struct {
		const char *text;
		int length; /* -1: none */
	} cases[] = {
		{ "1e", 1 },       { "1e+", 1 },     { "1e+x", 1 }, { "0x10", 1 }, { "1.5.5", 3 },
		{ "1,5", 1 },      { "12/34", 2 },   { "", -1 },    { "-", -1 },   { ".", -1 },
		{ "-.e5", -1 },    { "e5", -1 },     { "abc", -1 }, { "nan", 3 },  { "-inf", 4 },
		{ "Infinity", 8 }, { "inferno", 3 }, { " 1", -1 },  { "+-1", -1 }, { "1 2", 1 },
	};

	(void)state;
	for (size_t i = 0; i < ARRAY_LENGTH(cases); i++) {
		double value;
		float single;
		const char *end = number_to_double(cases[i].text, &value);
		const char *single_end = number_to_float(cases[i].text, &single);

		print_message("\"%s\"\n", cases[i].text);
		assert_int_equal(end ? end - cases[i].text : -1, cases[i].length);
		assert_int_equal(single_end ? single_end - cases[i].text : -1, cases[i].length);
	}
}

static void integers_that_do_not_fit_are_none(void **state)
{
	int64_t value;

	(void)state;
	assert_non_null(number_to_i64("-123/4", &value));
	assert_int_equal(value, -123);
	assert_non_null(number_to_i64("900000000000000000", &value));
	assert_null(number_to_i64("9223372036854775808", &value));
	assert_null(number_to_i64("99999999999999999999999999", &value));
	assert_null(number_to_i64("", &value));
	assert_null(number_to_i64("+", &value));
}

static void a_locale_with_decimal_commas_changes_nothing(void **state)
{
	/* A long number, which takes the slow path through the C library. */
	const char *text = "0.1234567890123456789012345";
	double value;

	(void)state;
	if (!setlocale(LC_ALL, "de_DE.UTF-8") && !setlocale(LC_ALL, "de_DE") &&
	    !setlocale(LC_ALL, "fr_FR.UTF-8"))
		print_message("no such locale is installed: the C locale is tested\n");
	assert_non_null(number_to_double(text, &value));
	assert_true(value == 0.1234567890123456789012345);
	(void)setlocale(LC_ALL, "C");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(written_numbers_are_read_to_the_last_bit),
		cmocka_unit_test(random_decimals_are_read_to_the_last_bit),
		cmocka_unit_test(halves_between_floats_go_to_the_even_one),
		cmocka_unit_test(a_number_ends_where_it_ends),
		cmocka_unit_test(integers_that_do_not_fit_are_none),
		cmocka_unit_test(a_locale_with_decimal_commas_changes_nothing),
	};

	return TEST_RUN(tests);
}
