/* SPDX-License-Identifier: MIT */
#include "viewer/statistics.h"

#include <errno.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include "formats/base/clock.h"
#include "formats/base/text.h"

static const char csv_header[] =
	"frame,t,ms,nodes_wanted,nodes_drawn,nodes_missing,triangles,bytes_fetched,bytes_prefetched,"
	"way,budget,selection_ms,nodes_visited,waited_ms,order,nodes_shown,rounds,boxes_tested,"
	"queries,incomplete";

int statistics_init(struct statistics *ret, const char *csv_path, struct why *why)
{
	struct statistics statistics = { .begin_ns = clock_now_ns() };

	if (csv_path) {
		statistics.csv_path = strdup(csv_path);
		if (!statistics.csv_path)
			return why_errno(why, -ENOMEM, "%s", csv_path);
		statistics.csv = fopen(csv_path, "we");
		if (!statistics.csv) {
			int r = why_errno(why, -errno, "%s", csv_path);

			statistics_done(&statistics);
			return r;
		}
		(void)fprintf(statistics.csv, "%s\n", csv_header);
	}
	*ret = statistics;
	return 0;
}

void statistics_done(struct statistics *statistics)
{
	if (statistics->csv)
		(void)fclose(statistics->csv);
	free(statistics->csv_path);
	free(statistics->frame_ms);
	memset(statistics, 0, sizeof(*statistics));
}

static int remember_ms(struct statistics *statistics, double ms)
{
	if (statistics->frame_count == statistics->frame_room) {
		size_t room = statistics->frame_room == 0 ? 1024 : 2 * statistics->frame_room;
		double *frame_ms = reallocarray(statistics->frame_ms, room, sizeof(double));

		if (!frame_ms)
			return -ENOMEM;
		statistics->frame_ms = frame_ms;
		statistics->frame_room = room;
	}
	statistics->frame_ms[statistics->frame_count++] = ms;
	return 0;
}

int statistics_add(struct statistics *statistics, double time_s, const struct frame_report *report,
		   struct why *why)
{
	struct frame_report *sum = &statistics->sum;
	size_t frame = statistics->frame_count;
	int r = remember_ms(statistics, report->ms);

	if (r < 0)
		return why_errno(why, r, "statistics");
	sum->ms += report->ms;
	sum->selection_ms += report->selection_ms;
	sum->waited_ms += report->waited_ms;
	sum->nodes_visited += report->nodes_visited;
	sum->nodes_shown += report->nodes_shown;
	sum->rounds += report->rounds;
	sum->boxes_tested += report->boxes_tested;
	sum->queries += report->queries;
	statistics->way_frames[report->way]++;
	statistics->incomplete_frames += report->is_incomplete;
	sum->nodes_wanted += report->nodes_wanted;
	sum->nodes_drawn += report->nodes_drawn;
	sum->nodes_missing += report->nodes_missing;
	sum->triangles += report->triangles;
	sum->bytes_fetched += report->bytes_fetched;
	sum->bytes_prefetched += report->bytes_prefetched;
	sum->portions += report->portions;
	statistics->nodes_missing_last = report->nodes_missing;
	if (report->triangles > statistics->triangles_max)
		statistics->triangles_max = report->triangles;
	if (!statistics->csv)
		return 0;
	errno = 0;
	if (fprintf(statistics->csv,
		    "%zu,%.17g,%.3f,%" PRIu64 ",%" PRIu64 ",%" PRIu64 ",%" PRIu64 ",%" PRIu64
		    ",%" PRIu64 ",%s,%" PRIu64 ",%.3f,%" PRIu64 ",%.3f,%s,%" PRIu64 ",%" PRIu64
		    ",%" PRIu64 ",%" PRIu64 ",%d\n",
		    frame, time_s, report->ms, report->nodes_wanted, report->nodes_drawn,
		    report->nodes_missing, report->triangles, report->bytes_fetched,
		    report->bytes_prefetched, frame_way_name(report->way), report->budget_triangles,
		    report->selection_ms, report->nodes_visited, report->waited_ms,
		    report->way == FRAME_WAY_BUDGET ? select_order_name(report->order) : "",
		    report->nodes_shown, report->rounds, report->boxes_tested, report->queries,
		    report->is_incomplete) < 0)
		return why_errno(why, errno ? -errno : -EIO, "%s", statistics->csv_path);
	return 0;
}

int statistics_finish(struct statistics *statistics, struct why *why)
{
	FILE *csv = statistics->csv;

	statistics->csv = NULL;
	if (csv && fclose(csv) != 0)
		return why_errno(why, -errno, "%s", statistics->csv_path);
	return 0;
}

static int compare_doubles(const void *left, const void *right)
{
	const double *a = left;
	const double *b = right;

	return *a < *b ? -1 : *a > *b;
}

/* The value that so many of all lie at or below; 0 when there are none. */
static double percentile(const double *sorted, size_t count, double share)
{
	return count == 0 ? 0.0 : sorted[(size_t)((double)(count - 1) * share + 0.5)];
}

void statistics_write_json(const struct statistics *statistics, const struct statistics_run *run,
			   FILE *out)
{
	const struct frame_report *sum = &statistics->sum;
	size_t count = statistics->frame_count;
	double *sorted = statistics->frame_ms;
	struct rusage usage = { 0 };

	/* Their order has been written to the CSV; here only their sizes count. */
	if (count > 0)
		qsort(sorted, count, sizeof(double), compare_doubles);
	(void)getrusage(RUSAGE_SELF, &usage);
	(void)fprintf(out, "{\"renderer\":");
	text_write_json(out, run->renderer);
	(void)fprintf(out, ",\"in_place\":%s,\"width\":%u,\"height\":%u,\"frames\":%zu",
		      run->is_in_place ? "true" : "false", run->width, run->height, count);
	(void)fprintf(out, ",\"seconds\":%.3f",
		      (double)(clock_now_ns() - statistics->begin_ns) / (double)NS_PER_S);
	(void)fprintf(out, ",\"ms\":{\"median\":%.3f,\"p95\":%.3f,\"p99\":%.3f,\"max\":%.3f}",
		      percentile(sorted, count, 0.5), percentile(sorted, count, 0.95),
		      percentile(sorted, count, 0.99), percentile(sorted, count, 1.0));
	(void)fprintf(out, ",\"selection_ms\":%.3f,\"waited_ms\":%.3f,\"ways\":{",
		      sum->selection_ms, sum->waited_ms);
	for (enum frame_way way = 0; way < FRAME_WAY_COUNT_; way++)
		(void)fprintf(out, "%s\"%s\":%zu", way == 0 ? "" : ",", frame_way_name(way),
			      statistics->way_frames[way]);
	(void)fprintf(out,
		      "},\"incomplete_frames\":%zu,\"nodes_shown\":%" PRIu64 ",\"rounds\":%" PRIu64
		      ",\"boxes_tested\":%" PRIu64 ",\"queries\":%" PRIu64,
		      statistics->incomplete_frames, sum->nodes_shown, sum->rounds,
		      sum->boxes_tested, sum->queries);
	(void)fprintf(out, ",\"triangles\":%" PRIu64 ",\"triangles_max\":%" PRIu64, sum->triangles,
		      statistics->triangles_max);
	(void)fprintf(out,
		      ",\"nodes_wanted\":%" PRIu64 ",\"nodes_drawn\":%" PRIu64
		      ",\"nodes_missing\":%" PRIu64 ",\"nodes_missing_last\":%" PRIu64
		      ",\"portions\":%u",
		      sum->nodes_wanted, sum->nodes_drawn, sum->nodes_missing,
		      statistics->nodes_missing_last, sum->portions);
	(void)fprintf(out,
		      ",\"bytes_fetched\":%" PRIu64 ",\"bytes_prefetched\":%" PRIu64
		      ",\"reconnects\":%" PRIu64 ",\"peak_rss_bytes\":%" PRIu64 "}\n",
		      sum->bytes_fetched, sum->bytes_prefetched, run->reconnects,
		      (uint64_t)usage.ru_maxrss * 1024);
}
