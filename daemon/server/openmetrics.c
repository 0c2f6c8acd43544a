/* SPDX-License-Identifier: MIT */
#include "daemon/server/openmetrics.h"

#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/clock.h"

/* "bytes" for "cache_bytes"; NULL: a number of things. */
static const char *unit_of(const char *name)
{
	static const char *const units[] = { "bytes", "seconds", "ratio" };
	const char *last = strrchr(name, '_');

	for (size_t i = 0; last && i < ARRAY_LENGTH(units); i++)
		if (strcmp(last + 1, units[i]) == 0)
			return units[i];
	return NULL;
}

void openmetrics_family(FILE *out, const char *name, enum openmetrics_type type, const char *help)
{
	static const char *const types[] = {
		[OPENMETRICS_COUNTER] = "counter",
		[OPENMETRICS_GAUGE] = "gauge",
		[OPENMETRICS_HISTOGRAM] = "histogram",
		[OPENMETRICS_INFO] = "info",
	};
	const char *unit = unit_of(name);

	fprintf(out, "# TYPE %s %s\n", name, types[type]);
	if (unit)
		fprintf(out, "# UNIT %s %s\n", name, unit);
	fprintf(out, "# HELP %s %s\n", name, help);
}

void openmetrics_count(FILE *out, const char *name, const char *label, const char *value,
		       uint64_t count)
{
	fprintf(out, "%s_total", name);
	if (label)
		fprintf(out, "{%s=\"%s\"}", label, value);
	fprintf(out, " %llu\n", (unsigned long long)count);
}

void openmetrics_gauge(FILE *out, const char *name, double gauge)
{
	fprintf(out, "%s %.17g\n", name, gauge);
}

static double seconds(uint64_t ns)
{
	return (double)ns / (double)NS_PER_S;
}

/* The label that all samples have, before one of their own. */
static void write_label(FILE *out, const char *label, const char *value, const char *end)
{
	if (label)
		fprintf(out, "%s=\"%s\"%s", label, value, end);
}

void openmetrics_histogram(FILE *out, const char *name, const char *label, const char *value,
			   const struct histogram *histogram)
{
	uint64_t count = 0;

	for (uint32_t i = 0; i < HISTOGRAM_BUCKET_COUNT; i++) {
		uint64_t bound_ns = histogram_bound_ns(i);

		count += histogram->counts[i];
		fprintf(out, "%s_bucket{", name);
		write_label(out, label, value, ",");
		if (bound_ns == UINT64_MAX)
			fputs("le=\"+Inf\"}", out);
		else
			fprintf(out, "le=\"%.9g\"}", seconds(bound_ns));
		fprintf(out, " %llu\n", (unsigned long long)count);
	}
	fprintf(out, "%s_count%s", name, label ? "{" : "");
	write_label(out, label, value, "}");
	fprintf(out, " %llu\n%s_sum%s", (unsigned long long)histogram->count, name,
		label ? "{" : "");
	write_label(out, label, value, "}");
	fprintf(out, " %.9f\n", seconds(histogram->sum_ns));
}

void openmetrics_end(FILE *out)
{
	fputs("# EOF\n", out);
}
