/* SPDX-License-Identifier: MIT */
/*
 * oocbench replay: what was asked of a daemon, asked again of its cache with each policy and at several
 * sizes, beside what a cache that knows the future must read.
 */
#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "formats/base/bytes.h"
#include "formats/base/log.h"
#include "formats/base/text.h"
#include "tools/bench/base/arguments.h"
#include "tools/bench/base/measure.h"
#include "tools/bench/base/plot.h"
#include "tools/bench/base/report.h"
#include "tools/bench/base/verb.h"
#include "tools/bench/bench.h"
#include "tools/bench/replay/bound.h"
#include "tools/bench/replay/replay_cache.h"

#define SIZES_MAX    32u
#define MIB_OF(n)    ((n) / (double)MIB)
#define PAGES_OF(n)  ((n) / TRACE_PAGE_BYTES)
#define CURVE_COUNT  (REPLACEMENT_COUNT_ + 3u)
#define CURVE_BELADY REPLACEMENT_COUNT_
#define CURVE_FOO    (REPLACEMENT_COUNT_ + 1u)
#define CURVE_PFOO   (REPLACEMENT_COUNT_ + 2u)

static const char help[] =
	"Usage: oocbench replay TRACE... [--cache SIZES] [--policy NAMES] [-o DIR] [--json]\n"
	"Does what traces ask of a cache again, with each policy and at each size, beside offline bounds.\n"
	"\n"
	"  --cache SIZES   as 32M,64M,128M; else from a quarter to four times what was recorded\n"
	"  --policy NAMES  as lru,reuse; else all\n"
	"  -o DIR          writes TRACE.csv and the miss curve, TRACE.svg, there\n"
	"  --json          one object instead of tables\n"
	"  -h, --help      this text\n"
	"\n"
	"A ratio is (bytes read - compulsory) / (the bound's - compulsory): 1 is as good as can be.\n"
	"\n"
	"Examples:\n"
	"  oocbench replay walk.trace\n"
	"  oocbench replay walk.trace loop.trace --cache 32M,64M,96M -o curves\n";

struct replay_options {
	const char *sizes;
	const char *policies;
	const char *folder;
	bool is_json;
	uint64_t cache_bytes[SIZES_MAX];
	uint32_t size_count; /* 0: by what was recorded */
	bool has_policy[REPLACEMENT_COUNT_];
};

/* One trace at all sizes. */
struct curves {
	const char *path;
	struct schedule schedule;
	struct gaps gaps;
	uint64_t cache_bytes[SIZES_MAX];
	uint32_t size_count;
	double read_bytes[CURVE_COUNT][SIZES_MAX];
	struct replay_result results[REPLACEMENT_COUNT_][SIZES_MAX];
	bool fits[SIZES_MAX]; /* all that is wanted, at each policy */
};

static const char *curve_name(uint32_t curve)
{
	if (curve == CURVE_BELADY)
		return "belady";
	if (curve == CURVE_FOO)
		return "foo";
	if (curve == CURVE_PFOO)
		return "pfoo";
	return replacement_name((enum replacement_policy)curve);
}

/* ---- the command line ---- */

/* Cuts the next of a list with commas off.  Returns: false at its end. */
static bool next_word(const char **list, char *word, size_t word_bytes)
{
	size_t length = strcspn(*list, ",");

	if (length == 0 || length >= word_bytes)
		return false;
	memcpy(word, *list, length);
	word[length] = '\0';
	*list += length + ((*list)[length] == ',');
	return true;
}

static bool parse_sizes(struct replay_options *options)
{
	const char *list = options->sizes;
	char word[32];

	while (options->size_count < SIZES_MAX && next_word(&list, word, sizeof(word))) {
		uint64_t *size = &options->cache_bytes[options->size_count];

		if (text_to_size(word, size) < 0 || *size < MIB)
			return false;
		options->size_count++;
	}
	return *list == '\0' && options->size_count > 0;
}

static bool parse_policies(struct replay_options *options)
{
	const char *list = options->policies;
	char word[32];
	bool any = false;

	while (next_word(&list, word, sizeof(word))) {
		enum replacement_policy policy;

		if (replacement_find(word, &policy) < 0)
			return false;
		options->has_policy[policy] = true;
		any = true;
	}
	return *list == '\0' && any;
}

/* ---- replaying ---- */

static void choose_sizes(const struct replay_options *options, struct curves *curves)
{
	static const double shares[] = { 0.25, 0.375, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0 };

	curves->size_count = options->size_count;
	memcpy(curves->cache_bytes, options->cache_bytes, sizeof(curves->cache_bytes));
	for (uint32_t i = 0; options->size_count == 0 && i < ARRAY_LENGTH(shares); i++) {
		double bytes = (double)curves->schedule.header.cache_bytes * shares[i];

		if (bytes >= (double)MIB)
			curves->cache_bytes[curves->size_count++] = (uint64_t)bytes;
	}
}

static int replay_size(const struct replay_options *options, struct curves *curves, uint32_t size,
		       struct why *why)
{
	uint64_t cache_bytes = curves->cache_bytes[size];
	uint64_t pages = PAGES_OF(cache_bytes);
	int r = 0;

	curves->fits[size] = curves->gaps.wanted_pages_max <= pages;
	for (uint32_t i = 0; r == 0 && i < REPLACEMENT_COUNT_; i++) {
		struct replay_result *result = &curves->results[i][size];

		if (!options->has_policy[i])
			continue;
		r = replay_cache(&curves->schedule, (enum replacement_policy)i, cache_bytes, result,
				 why);
		if (r < 0)
			why_prefix(why, "%s", curves->path);
		curves->read_bytes[i][size] = (double)result->read_bytes;
		curves->fits[size] = curves->fits[size] && result->refused_count == 0;
	}
	if (r < 0)
		return r;
	r = bound_belady(&curves->schedule, pages, &curves->read_bytes[CURVE_BELADY][size]);
	if (r == 0)
		r = bound_pfoo(&curves->gaps, pages, curves->fits[size],
			       &curves->read_bytes[CURVE_PFOO][size]);
	if (r == 0)
		r = bound_foo(&curves->gaps, pages, curves->fits[size],
			      &curves->read_bytes[CURVE_FOO][size]);
	return r < 0 ? why_errno(why, r, "%s", curves->path) : 0;
}

static int replay_trace(const struct replay_options *options, struct curves *curves,
			struct why *why)
{
	int r = schedule_read(curves->path, &curves->schedule, why);

	if (r < 0)
		return r;
	if (curves->schedule.was_cut)
		log_warning("replay: %s was cut: only what is whole is replayed", curves->path);
	r = gaps_make(&curves->schedule, &curves->gaps);
	if (r < 0)
		return why_errno(why, r, "%s", curves->path);
	choose_sizes(options, curves);
	for (uint32_t i = 0; r == 0 && i < curves->size_count; i++) {
		if (measure_was_cancelled())
			return why_set(why, -ECANCELED, "interrupted");
		r = replay_size(options, curves, i, why);
	}
	return r;
}

/* ---- results ---- */

static bool has_curve(const struct replay_options *options, uint32_t curve)
{
	return curve >= REPLACEMENT_COUNT_ || options->has_policy[curve];
}

/* Of what is not compulsory, to that of the bound; where nothing more has to be read: 1 or more. */
static double ratio_of(const struct curves *curves, uint32_t curve, uint32_t bound, uint32_t size)
{
	double compulsory = (double)curves->gaps.compulsory_bytes;
	double above = curves->read_bytes[curve][size] - compulsory;
	double least = curves->read_bytes[bound][size] - compulsory;

	/* Less than a page is rounding. */
	if (least < TRACE_PAGE_BYTES)
		return above < TRACE_PAGE_BYTES ? 1.0 : INFINITY;
	return above / least;
}

static void print_tables(const struct replay_options *options, const struct curves *curves)
{
	char text[TEXT_SIZE_BYTES];

	printf("%s: %.1f s, %" PRIu32 " viewers, %" PRIu64 " sets, %" PRIu64 " wants of %" PRIu32
	       " nodes\n",
	       curves->path, curves->schedule.seconds, curves->schedule.viewer_count,
	       curves->schedule.set_count, curves->schedule.want_count,
	       curves->schedule.entry_count);
	printf("  compulsory %s, wanted at one time at most %s\n",
	       text_from_size(curves->gaps.compulsory_bytes, text),
	       text_from_size(curves->gaps.wanted_pages_max * TRACE_PAGE_BYTES,
			      (char[TEXT_SIZE_BYTES]){ 0 }));
	printf("  %11s", "cache");
	for (uint32_t i = 0; i < CURVE_COUNT; i++)
		if (has_curve(options, i))
			printf(" %11s", curve_name(i));
	for (uint32_t i = 0; i < REPLACEMENT_COUNT_; i++)
		if (has_curve(options, i))
			printf(" %7s/foo %6s/pfoo", curve_name(i), curve_name(i));
	putchar('\n');
	for (uint32_t size = 0; size < curves->size_count; size++) {
		printf("  %11s", text_from_size(curves->cache_bytes[size], text));
		for (uint32_t i = 0; i < CURVE_COUNT; i++)
			if (has_curve(options, i))
				printf(" %7.1f MiB", MIB_OF(curves->read_bytes[i][size]));
		for (uint32_t i = 0; i < REPLACEMENT_COUNT_; i++)
			if (has_curve(options, i))
				printf(" %11.2f %11.2f", ratio_of(curves, i, CURVE_FOO, size),
				       ratio_of(curves, i, CURVE_PFOO, size));
		puts(curves->fits[size] ? "" : "  (not all that is wanted fits)");
	}
}

static void write_csv(const struct replay_options *options, const struct curves *curves, FILE *out)
{
	fputs("cache_bytes,compulsory_bytes,fits", out);
	for (uint32_t i = 0; i < CURVE_COUNT; i++)
		if (has_curve(options, i))
			fprintf(out, ",%s_bytes", curve_name(i));
	putc('\n', out);
	for (uint32_t size = 0; size < curves->size_count; size++) {
		fprintf(out, "%" PRIu64 ",%" PRIu64 ",%d", curves->cache_bytes[size],
			curves->gaps.compulsory_bytes, curves->fits[size]);
		for (uint32_t i = 0; i < CURVE_COUNT; i++)
			if (has_curve(options, i))
				fprintf(out, ",%.0f", curves->read_bytes[i][size]);
		putc('\n', out);
	}
}

static int draw(const struct replay_options *options, const struct curves *curves, const char *path,
		struct why *why)
{
	static double x[SIZES_MAX];
	static double y[CURVE_COUNT][SIZES_MAX];
	struct plot_series series[CURVE_COUNT];
	struct plot plot = {
		.title = "Bytes read by the size of the cache",
		.x_label = "cache, MiB",
		.y_label = "read, MiB",
		.series = series,
	};

	for (uint32_t size = 0; size < curves->size_count; size++)
		x[size] = MIB_OF((double)curves->cache_bytes[size]);
	for (uint32_t i = 0; i < CURVE_COUNT; i++) {
		if (!has_curve(options, i))
			continue;
		for (uint32_t size = 0; size < curves->size_count; size++)
			y[i][size] = MIB_OF(curves->read_bytes[i][size]);
		series[plot.series_count++] = (struct plot_series){
			curve_name(i), x, y[i], curves->size_count, PLOT_BOTH,
		};
	}
	return plot_write(path, &plot, why);
}

static int write_folder(const struct replay_options *options, const struct curves *curves,
			struct why *why)
{
	const char *slash = strrchr(curves->path, '/');
	const char *name = slash ? slash + 1 : curves->path;
	char path[PATH_MAX];
	FILE *out;
	int r;

	if (mkdir(options->folder, 0777) < 0 && errno != EEXIST)
		return why_errno(why, -errno, "%s", options->folder);
	(void)snprintf(path, sizeof(path), "%s/%s.csv", options->folder, name);
	out = fopen(path, "we");
	if (!out)
		return why_errno(why, -errno, "%s", path);
	write_csv(options, curves, out);
	if (fclose(out) != 0)
		return why_errno(why, -errno, "%s", path);
	(void)snprintf(path, sizeof(path), "%s/%s.svg", options->folder, name);
	r = draw(options, curves, path, why);
	if (r != -ENOENT)
		return r;
	log_warning("replay: %s: no picture: %s", path, why->text);
	return 0;
}

static void report_curves(const struct replay_options *options, const struct curves *curves,
			  struct report *report)
{
	report_group_begin(report, curves->path, curves->path);
	report_number(report, "sets", "sets", (double)curves->schedule.set_count, "");
	report_number(report, "wants", "wants", (double)curves->schedule.want_count, "");
	report_number(report, "compulsory_bytes", "compulsory",
		      (double)curves->gaps.compulsory_bytes, "");
	for (uint32_t size = 0; size < curves->size_count; size++) {
		char key[32];

		(void)snprintf(key, sizeof(key), "%" PRIu64, curves->cache_bytes[size]);
		report_group_begin(report, key, key);
		report_number(report, "fits", "fits", curves->fits[size], "");
		for (uint32_t i = 0; i < CURVE_COUNT; i++) {
			char name[64];

			if (!has_curve(options, i))
				continue;
			(void)snprintf(name, sizeof(name), "%s_bytes", curve_name(i));
			report_number(report, name, name, curves->read_bytes[i][size], "");
			(void)snprintf(name, sizeof(name), "%s_ratio", curve_name(i));
			report_number(report, name, name, ratio_of(curves, i, CURVE_FOO, size), "");
		}
		report_group_end(report);
	}
	report_group_end(report);
}

static int replay_all(const struct replay_options *options, char *const *paths, struct why *why)
{
	struct report report;
	int r = 0;

	if (options->is_json)
		report_begin(&report, true);
	for (; r == 0 && *paths; paths++) {
		struct curves curves = { .path = *paths };

		r = replay_trace(options, &curves, why);
		if (r == 0 && options->is_json)
			report_curves(options, &curves, &report);
		else if (r == 0)
			print_tables(options, &curves);
		if (r == 0 && options->folder)
			r = write_folder(options, &curves, why);
		gaps_done(&curves.gaps);
		schedule_done(&curves.schedule);
	}
	if (options->is_json && r == 0)
		report_end(&report);
	return r;
}

int verb_replay(int argc, char **argv)
{
	struct replay_options options = { 0 };
	const struct argument table[] = {
		{ "cache", ARGUMENT_TEXT, &options.sizes },
		{ "policy", ARGUMENT_TEXT, &options.policies },
		{ "output", ARGUMENT_TEXT, &options.folder, .letter = 'o' },
		{ "json", ARGUMENT_FLAG, &options.is_json },
		{ NULL },
	};
	const struct arguments arguments = { "replay", help, table, 1, -1, "name a trace" };
	char **operands;
	struct why why = { "" };
	int r = arguments_parse(&arguments, argc, argv, &operands);

	if (r != ARGUMENTS_OK)
		return r;
	if (options.sizes && !parse_sizes(&options))
		return verb_usage_error("replay",
					"--cache %s is not a list of up to %u sizes as 32M,64M",
					options.sizes, SIZES_MAX);
	if (options.policies && !parse_policies(&options))
		return verb_usage_error("replay", "--policy %s is not a list as lru,reuse",
					options.policies);
	for (uint32_t i = 0; !options.policies && i < REPLACEMENT_COUNT_; i++)
		options.has_policy[i] = true;
	r = replay_all(&options, operands, &why);
	return verb_status("replay", r, &why);
}
