/* SPDX-License-Identifier: MIT */
/**
 * report.h - results on standard output: a table for people, or JSON for programs.
 *
 * Threads: the main thread.
 */
#ifndef TOOLS_BENCH_BASE_REPORT_H
#define TOOLS_BENCH_BASE_REPORT_H

#include <stdbool.h>
#include <stdio.h>

#include "tools/bench/base/figures.h"

/** Results under construction. */
struct report {
	FILE *out;
	bool is_json;
	unsigned depth;
	bool is_first; /* in its object */
};

void report_begin(struct report *report, bool is_json);
void report_end(struct report *report);
/** A row: "title  value unit"; in JSON "key": value. */
void report_number(struct report *report, const char *key, const char *title, double value,
		   const char *unit);
void report_text(struct report *report, const char *key, const char *title, const char *value);
void report_spread(struct report *report, const char *key, const char *title, struct spread spread,
		   const char *unit);
void report_distribution(struct report *report, const char *key, const char *title,
			 struct distribution distribution, const char *unit);
/** An object within the object; for people, a heading. */
void report_group_begin(struct report *report, const char *key, const char *title);
void report_group_end(struct report *report);

#endif /* TOOLS_BENCH_BASE_REPORT_H */
