/* SPDX-License-Identifier: MIT */
/*
 * oocbench record: the trace of viewers that go along camera paths, by a daemon of its own and
 * without pictures.
 *
 * Each viewer selects what is in its view, says so and waits until all of it is there, as one that
 * draws every frame whole; they take their frames in turn, so that a trace differs from run to run
 * only by what the disk does.
 */
#include <errno.h>
#include <inttypes.h>
#include <poll.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "libclient/ooc/client.h"
#include "libclient/select/select.h"
#include "tools/bench/base/arguments.h"
#include "tools/bench/base/measure.h"
#include "tools/bench/base/report.h"
#include "tools/bench/base/verb.h"
#include "tools/bench/bench.h"

#define VIEWERS_MAX 64u
#define LAPS_MAX    1000u
#define FRAMES_MAX  1000000u
#define WAIT_MS     60000
#define POLL_MS     10
#define ASPECT      (16.0 / 9.0)
#define CACHE_USUAL (64 * MIB)

static const char help[] =
	"Usage: oocbench record STORE PATH.csv... -o FILE [OPTION]...\n"
	"Records the trace of viewers that go along camera paths, for oocbench replay.\n"
	"\n"
	"  -o FILE            the trace\n"
	"  --viewers N        so many at one time (1); they share the paths, and begin apart on each\n"
	"  --laps N           each goes its path so often (1)\n"
	"  --frames N         only the first N frames of each path\n"
	"  --budget N         at most N triangles a frame; else all that is in view\n"
	"  --cache SIZE       of the daemon (64M)\n"
	"  --replacement NAME of the daemon\n"
	"  --json             one object instead of a table\n"
	"  -h, --help         this text\n"
	"\n"
	"Examples:\n"
	"  oocbench record plant.ooc walk.csv --cache 64M -o walk.trace\n"
	"  oocbench record plant.ooc walk.csv --laps 4 --frames 300 -o loop.trace\n"
	"  oocbench record plant.ooc walk.csv orbit.csv --viewers 8 -o eight.trace\n";

struct record_options {
	const char *store;
	const char *out;
	const char *replacement; /* NULL: the daemon's choice */
	uint64_t viewer_count;
	uint64_t lap_count;
	uint64_t frame_count; /* 0: all */
	uint64_t budget_triangles;
	uint64_t cache_bytes;
	bool is_json;
};

struct camera_row {
	struct camera *cameras;
	uint32_t count;
};

struct viewer {
	struct ooc_client *client;
	struct ooc_store *store;
	struct selector *selector;
	const struct camera_row *row;
	uint32_t first; /* frame that it begins with */
	struct ooc_want *wants;
	size_t want_room;
};

struct record {
	const struct record_options *options;
	char scratch[PATH_MAX];
	struct measure_daemon daemon;
	struct camera_row *rows;
	size_t row_count;
	struct viewer viewers[VIEWERS_MAX];
	uint64_t set_count;
	uint64_t want_count;
	uint64_t incomplete_count; /* sets of which something was refused */
};

static int rows_read(struct record *record, char *const *paths, struct why *why)
{
	int r = 0;

	while (paths[record->row_count])
		record->row_count++;
	record->rows = calloc(record->row_count, sizeof(*record->rows));
	if (!record->rows)
		return why_errno(why, -ENOMEM, "camera paths");
	for (size_t i = 0; r == 0 && i < record->row_count; i++) {
		struct camera_row *row = &record->rows[i];

		r = camera_path_read(paths[i], &row->cameras, &row->count, why);
		if (r == 0 && row->count == 0)
			r = why_set(why, -EINVAL, "%s: a path without a camera", paths[i]);
		if (record->options->frame_count > 0)
			row->count = (uint32_t)u64_min(row->count, record->options->frame_count);
	}
	return r;
}

static int viewer_begin(struct record *record, uint32_t index, struct why *why)
{
	struct viewer *viewer = &record->viewers[index];
	int r = ooc_connect(record->daemon.socket_path, "oocbench", &viewer->client);

	if (r < 0)
		return why_set(why, r, "%s", ooc_error_text(NULL));
	r = ooc_open(viewer->client, record->options->store, &viewer->store);
	if (r < 0)
		return why_set(why, r, "%s: %s", record->options->store,
			       ooc_error_text(viewer->client));
	ooc_notify(viewer->client, true);
	viewer->row = &record->rows[index % record->row_count];
	viewer->first =
		(uint32_t)((uint64_t)index * viewer->row->count / record->options->viewer_count);
	r = selector_create(ooc_superblock(viewer->store), ooc_nodes(viewer->store),
			    &viewer->selector);
	return r < 0 ? why_errno(why, r, "selecting") : 0;
}

static int viewer_reserve(struct viewer *viewer, size_t count)
{
	struct ooc_want *wants;

	if (count <= viewer->want_room)
		return 0;
	wants = reallocarray(viewer->wants, 2 * count, sizeof(*wants));
	if (!wants)
		return -ENOMEM;
	viewer->wants = wants;
	viewer->want_room = 2 * count;
	return 0;
}

/* Says what is in view of one frame. */
static int viewer_look(struct record *record, struct viewer *viewer, uint64_t frame,
		       struct why *why)
{
	const struct store_superblock *superblock = ooc_superblock(viewer->store);
	const struct camera *camera =
		&viewer->row->cameras[(viewer->first + frame) % viewer->row->count];
	struct select_options options = { .budget_triangles = record->options->budget_triangles };
	struct selection selection;
	struct camera_view view;
	int64_t serial;

	if (camera_view_init(&view, camera, superblock, ASPECT, camera_near(camera, superblock)) <
	    0)
		return why_set(why, -EINVAL, "a camera of the path that cannot be");
	if (options.budget_triangles > 0)
		select_approximate(viewer->selector, &view, &options, &selection);
	else
		select_frustum(viewer->selector, &view, &selection);
	if (viewer_reserve(viewer, selection.entry_count) < 0)
		return why_errno(why, -ENOMEM, "a set");
	for (size_t i = 0; i < selection.entry_count; i++)
		viewer->wants[i] = (struct ooc_want){ viewer->store, selection.entries[i].node,
						      selection.entries[i].importance };
	serial = ooc_visible_set(viewer->client, viewer->wants, selection.entry_count);
	if (serial < 0)
		return why_set(why, (int)serial, "%s", ooc_error_text(viewer->client));
	record->set_count++;
	record->want_count += selection.entry_count;
	return 0;
}

/* Who is not heard of is taken for dead when others need room: all are served while any is waited for. */
static int viewers_wait(struct record *record, struct why *why)
{
	uint64_t deadline_ns = clock_now_ns() + WAIT_MS * NS_PER_MS;
	uint64_t viewer_count = record->options->viewer_count;
	struct pollfd fds[VIEWERS_MAX];

	for (;;) {
		uint64_t incomplete_count = 0;
		bool is_settled = true;

		for (uint64_t i = 0; i < viewer_count; i++) {
			struct ooc_client *client = record->viewers[i].client;
			struct ooc_progress progress;

			(void)ooc_dispatch(client);
			ooc_progress(client, &progress);
			is_settled = is_settled && progress.settled;
			incomplete_count += !progress.complete;
			fds[i] = (struct pollfd){ .fd = ooc_fd(client), .events = POLLIN };
		}
		if (is_settled) {
			record->incomplete_count += incomplete_count;
			return 0;
		}
		if (measure_was_cancelled())
			return why_set(why, -ECANCELED, "interrupted");
		if (clock_now_ns() > deadline_ns)
			return why_set(why, -ETIMEDOUT, "a set does not settle");
		(void)poll(fds, (nfds_t)viewer_count, POLL_MS);
	}
}

static int look_around(struct record *record, struct why *why)
{
	uint64_t frame_count = 0;
	int r = 0;

	for (size_t i = 0; i < record->row_count; i++)
		frame_count = u64_max(frame_count, record->rows[i].count);
	frame_count *= record->options->lap_count;
	for (uint64_t frame = 0; r == 0 && frame < frame_count; frame++) {
		if (measure_was_cancelled())
			return why_set(why, -ECANCELED, "interrupted");
		for (uint64_t i = 0; r == 0 && i < record->options->viewer_count; i++)
			r = viewer_look(record, &record->viewers[i], frame, why);
		if (r == 0)
			r = viewers_wait(record, why);
	}
	return r;
}

static int record_run(struct record *record, char *const *paths, struct why *why)
{
	char cache[32];
	const char *options[] = { "--cache-size",
				  cache,
				  "--trace",
				  record->options->out,
				  record->options->replacement ? "--replacement" : NULL,
				  record->options->replacement,
				  NULL };
	int r = rows_read(record, paths, why);

	(void)snprintf(cache, sizeof(cache), "%" PRIu64, record->options->cache_bytes);
	if (r == 0)
		r = measure_scratch_make(NULL, record->scratch, why);
	if (r < 0)
		return r;
	r = measure_daemon_start_with(record->scratch, options, &record->daemon, why);
	for (uint32_t i = 0; r == 0 && i < record->options->viewer_count; i++)
		r = viewer_begin(record, i, why);
	if (r == 0)
		r = look_around(record, why);
	for (uint32_t i = 0; i < record->options->viewer_count; i++) {
		struct viewer *viewer = &record->viewers[i];

		viewer->selector = selector_destroy(viewer->selector);
		viewer->client = ooc_disconnect(viewer->client);
		free(viewer->wants);
	}
	if (record->daemon.child.pid > 0)
		measure_daemon_stop(&record->daemon);
	measure_scratch_remove(record->scratch);
	return r;
}

static void record_report(const struct record *record)
{
	struct report report;

	report_begin(&report, record->options->is_json);
	report_text(&report, "trace", "trace", record->options->out);
	report_number(&report, "sets", "sets", (double)record->set_count, "");
	report_number(&report, "wants", "wants", (double)record->want_count, "");
	report_number(&report, "incomplete", "sets that did not fit",
		      (double)record->incomplete_count, "");
	report_end(&report);
}

int verb_record(int argc, char **argv)
{
	struct record_options options = {
		.viewer_count = 1,
		.lap_count = 1,
		.cache_bytes = CACHE_USUAL,
	};
	struct record record = { .options = &options };
	const struct argument table[] = {
		{ "output", ARGUMENT_TEXT, &options.out, .letter = 'o' },
		{ "viewers", ARGUMENT_NUMBER, &options.viewer_count, 1, VIEWERS_MAX },
		{ "laps", ARGUMENT_NUMBER, &options.lap_count, 1, LAPS_MAX },
		{ "frames", ARGUMENT_NUMBER, &options.frame_count, 1, FRAMES_MAX },
		{ "budget", ARGUMENT_NUMBER, &options.budget_triangles, .min = 1 },
		{ "cache", ARGUMENT_SIZE, &options.cache_bytes, .min = MIB },
		{ "replacement", ARGUMENT_TEXT, &options.replacement },
		{ "json", ARGUMENT_FLAG, &options.is_json },
		{ NULL },
	};
	const struct arguments arguments = {
		"record", help, table, 2, -1, "name a store and at least one camera path"
	};
	char **operands;
	struct why why = { "" };
	int r = arguments_parse(&arguments, argc, argv, &operands);

	if (r != ARGUMENTS_OK)
		return r;
	if (!options.out)
		return verb_usage_error("record", "-o FILE says where the trace goes");
	options.store = operands[0];
	r = record_run(&record, operands + 1, &why);
	for (size_t i = 0; record.rows && i < record.row_count; i++)
		free(record.rows[i].cameras);
	free(record.rows);
	if (r == 0)
		record_report(&record);
	return verb_status("record", r, &why);
}
