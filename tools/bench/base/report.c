/* SPDX-License-Identifier: MIT */
#include "tools/bench/base/report.h"

#include <math.h>

#include "formats/base/text.h"

void report_begin(struct report *report, bool is_json)
{
	*report = (struct report){ .out = stdout, .is_json = is_json, .is_first = true };
	if (is_json)
		fputs("{", report->out);
}

void report_end(struct report *report)
{
	if (report->is_json)
		fputs("\n}\n", report->out);
	(void)fflush(report->out);
}

static void json_key(struct report *report, const char *key)
{
	fprintf(report->out, "%s\n%*s", report->is_first ? "" : ",", (int)(2 * (report->depth + 1)),
		"");
	text_write_json(report->out, key);
	fputs(": ", report->out);
	report->is_first = false;
}

static void json_number(struct report *report, double value)
{
	/* JSON has no way to say that there is no number but this. */
	if (!isfinite(value))
		fputs("null", report->out);
	else if (value == rint(value) && fabs(value) < 1e15)
		fprintf(report->out, "%.0f", value);
	else
		fprintf(report->out, "%.9g", value);
}

static void table_title(struct report *report, const char *title)
{
	fprintf(report->out, "%*s%-*s", (int)(2 * report->depth), "", (int)(44 - 2 * report->depth),
		title);
}

/* Whole numbers as they are, others with four digits. */
static void table_number(struct report *report, double value)
{
	bool is_whole = value == rint(value) && fabs(value) < 1e15;

	fprintf(report->out, is_whole ? " %12.0f" : " %12.4g", value);
}

void report_number(struct report *report, const char *key, const char *title, double value,
		   const char *unit)
{
	if (report->is_json) {
		json_key(report, key);
		json_number(report, value);
		return;
	}
	table_title(report, title);
	table_number(report, value);
	fprintf(report->out, " %s\n", unit);
}

void report_text(struct report *report, const char *key, const char *title, const char *value)
{
	if (report->is_json) {
		json_key(report, key);
		text_write_json(report->out, value);
		return;
	}
	table_title(report, title);
	fprintf(report->out, " %s\n", value);
}

void report_spread(struct report *report, const char *key, const char *title, struct spread spread,
		   const char *unit)
{
	if (report->is_json) {
		json_key(report, key);
		fputs("{ \"low\": ", report->out);
		json_number(report, spread.low);
		fputs(", \"median\": ", report->out);
		json_number(report, spread.median);
		fputs(", \"high\": ", report->out);
		json_number(report, spread.high);
		fputs(" }", report->out);
		return;
	}
	table_title(report, title);
	table_number(report, spread.median);
	fprintf(report->out, " %s  (%.4g to %.4g)\n", unit, spread.low, spread.high);
}

void report_distribution(struct report *report, const char *key, const char *title,
			 struct distribution distribution, const char *unit)
{
	if (report->is_json) {
		report_group_begin(report, key, title);
		report_number(report, "mean", "", distribution.mean, unit);
		report_number(report, "median", "", distribution.median, unit);
		report_number(report, "p99", "", distribution.p99, unit);
		report_number(report, "max", "", distribution.highest, unit);
		report_group_end(report);
		return;
	}
	table_title(report, title);
	table_number(report, distribution.median);
	fprintf(report->out, " %s  (mean %.4g, p99 %.4g, at most %.4g)\n", unit, distribution.mean,
		distribution.p99, distribution.highest);
}

void report_group_begin(struct report *report, const char *key, const char *title)
{
	if (report->is_json) {
		json_key(report, key);
		fputs("{", report->out);
		report->is_first = true;
	} else {
		fprintf(report->out, "%*s%s\n", (int)(2 * report->depth), "", title);
	}
	report->depth++;
}

void report_group_end(struct report *report)
{
	report->depth--;
	if (report->is_json)
		fprintf(report->out, "\n%*s}", (int)(2 * (report->depth + 1)), "");
	report->is_first = false;
}
