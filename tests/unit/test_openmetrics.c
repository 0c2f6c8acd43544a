/* SPDX-License-Identifier: MIT */
/* Goal: what is written is OpenMetrics text, and the judge of it refuses what is not. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/counters.h"
#include "daemon/server/openmetrics.h"
#include "formats/base/bytes.h"
#include "tests/helper.h"
#include "tests/openmetrics_judge.h"

static char *written(const struct histogram *histogram)
{
	char *text = NULL;
	size_t text_bytes = 0;
	FILE *out = open_memstream(&text, &text_bytes);

	assert_non_null(out);
	openmetrics_family(out, "a_bytes", OPENMETRICS_COUNTER, "What was read");
	openmetrics_count(out, "a_bytes", NULL, NULL, UINT64_MAX);
	openmetrics_family(out, "b", OPENMETRICS_COUNTER, "By reason");
	openmetrics_count(out, "b", "reason", "full", 1);
	openmetrics_count(out, "b", "reason", "other", 2);
	openmetrics_family(out, "c_ratio", OPENMETRICS_GAUGE, "A share");
	openmetrics_gauge(out, "c_ratio", 0.25);
	openmetrics_family(out, "d_seconds", OPENMETRICS_HISTOGRAM, "How long");
	openmetrics_histogram(out, "d_seconds", "kind", "x", histogram);
	openmetrics_histogram(out, "d_seconds", "kind", "y", histogram);
	openmetrics_family(out, "e_seconds", OPENMETRICS_HISTOGRAM, "How long");
	openmetrics_histogram(out, "e_seconds", NULL, NULL, histogram);
	openmetrics_end(out);
	assert_int_equal(fclose(out), 0);
	return text;
}

static void what_is_written_is_openmetrics_text(void **state)
{
	struct histogram histogram = { 0 };
	struct why why;
	char *text;

	(void)state;
	histogram_add(&histogram, 500);
	histogram_add(&histogram, 1500);
	histogram_add(&histogram, UINT64_C(3600) * 1000000000);
	text = written(&histogram);
	if (openmetrics_judge(text, &why) < 0)
		fail_msg("%s", why.text);
	assert_non_null(strstr(text, "# UNIT a_bytes bytes\n"));
	assert_null(strstr(text, "# UNIT b "));
	assert_non_null(strstr(text, "a_bytes_total 18446744073709551615\n"));
	assert_true(openmetrics_value(text, "b_total{reason=\"other\"}") == 2);
	assert_true(openmetrics_value(text, "c_ratio") == 0.25);
	assert_true(openmetrics_value(text, "d_seconds_bucket{kind=\"y\",le=\"1.024e-06\"}") == 1);
	assert_true(openmetrics_value(text, "e_seconds_bucket{le=\"2.048e-06\"}") == 2);
	assert_true(openmetrics_value(text, "e_seconds_bucket{le=\"+Inf\"}") == 3);
	assert_true(openmetrics_value(text, "e_seconds_count") == 3);
	assert_true(openmetrics_value(text, "e_seconds_sum") > 3600);
	free(text);
}

static void the_judge_refuses_what_is_none(void **state)
{
	static const char *const texts[] = {
		"",
		"# EOF",
		"# TYPE a counter\n# HELP a x\na_total 1\n",
		"# TYPE a counter\n# HELP a x\na 1\n# EOF\n",
		"# TYPE a counter\na_total 1\n# EOF\n",
		"# TYPE a gauge\n# HELP a x\na 1\n# EOF\n\n",
		"# TYPE a gauge\n# HELP a x\na one\n# EOF\n",
		"# TYPE a gauge\n# HELP a x\nb 1\n# EOF\n",
		"# TYPE a gauge\n# UNIT a bytes\n# HELP a x\na 1\n# EOF\n",
		"# TYPE a gauge\n# HELP a x\na 1\n# TYPE a gauge\n# EOF\n",
		"# TYPE a histogram\n# HELP a x\na_bucket{le=\"1\"} 2\na_bucket{le=\"2\"} 1\n# EOF\n",
	};
	struct why why;

	(void)state;
	for (size_t i = 0; i < ARRAY_LENGTH(texts); i++)
		if (openmetrics_judge(texts[i], &why) != -EINVAL)
			fail_msg("allowed: %s", texts[i]);
	assert_int_equal(openmetrics_judge("# EOF\n", &why), 0);
}

static void the_manual_says_what_each_counter_means(void **state)
{
	static const char *const names[] = {
#define COUNTER_NAME(name, help) #name,
		STORE_COUNTERS(COUNTER_NAME)
#undef COUNTER_NAME
	};
	char path[4096];
	size_t bytes;
	char *text;
	char *manual;

	(void)state;
	(void)snprintf(path, sizeof(path), "%s/daemon/oocd.8", getenv("OOCD_SOURCE"));
	text = test_file_read(path, &bytes);
	manual = strndup(text, bytes);
	for (size_t i = 0; i < ARRAY_LENGTH(names); i++) {
		char line[128];

		(void)snprintf(line, sizeof(line), "\n.B %s\n", names[i]);
		if (!strstr(manual, line))
			fail_msg("oocd.8 does not explain %s", names[i]);
	}
	free(manual);
	free(text);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(what_is_written_is_openmetrics_text),
		cmocka_unit_test(the_judge_refuses_what_is_none),
		cmocka_unit_test(the_manual_says_what_each_counter_means),
	};

	return TEST_RUN(tests);
}
