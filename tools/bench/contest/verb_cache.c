/* SPDX-License-Identifier: MIT */
/*
 * oocbench cache: what the cache costs a frame, and one recorded walk read through oocd and through
 * what people would use instead, in turn, in one run.
 */
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/file.h"
#include "libclient/ooc/client.h"
#include "tools/bench/base/arguments.h"
#include "tools/bench/base/figures.h"
#include "tools/bench/base/measure.h"
#include "tools/bench/base/plot.h"
#include "tools/bench/base/report.h"
#include "tools/bench/base/verb.h"
#include "tools/bench/bench.h"
#include "tools/bench/contest/contest.h"
#include "tools/bench/contest/frames.h"
#include "tools/bench/contest/restart.h"
#include "tools/bench/contest/viewers.h"

#define REPEATS_MAX 100u
/** Where the walk is larger than memory: what oocd and memcached need beside their cache. */
#define BESIDE_BYTES (24 * MIB)
/** Part of the crowd's sets that is new each frame. */
#define CROWD_SHARE 10u

static const char help[] =
	"Usage: oocbench cache STORE [--path P.csv] [--frames N] [--repeats N] [--quick]\n"
	"Measures what the cache costs a frame, alone and in a crowd; then reads what a camera path wants\n"
	"through oocd and through mmap, pread, LMDB and memcached: resident, cold, and with half the memory\n"
	"that the path needs.  A contestant that is not installed is named and left out.\n"
	"\n"
	"  --path P.csv   camera path, as oocbench path makes it (a walk, else an orbit)\n"
	"  --frames N     frames of it (60)\n"
	"  --budget N     triangles a frame (3000000)\n"
	"  --repeats N    rounds of each contestant (5)\n"
	"  --held N       nodes that a client holds where costs are measured (1000)\n"
	"  --clients N    in the crowd (16)\n"
	"  --viewers N    also the memory of N viewers, which takes --path\n"
	"  --restart      instead: kills the daemon while clients draw, and starts it with what was kept\n"
	"  --keep SIZE    of payloads, then; the store is copied as often as that takes (all of it, once)\n"
	"  --plot FILE    draws frame times; FILE ends in .svg or .png, -REGIME is put before that\n"
	"  --csv FILE     every frame's time\n"
	"  --quick        few frames and one round, to see that it works\n"
	"  --json         results for programs\n"
	"\n"
	"Examples:\n"
	"  oocbench cache plant.ooc --plot cache.png\n"
	"  oocbench cache plant.ooc --restart --keep 4G\n";

struct cache_options {
	const char *store;
	const char *path;
	const char *plot;
	const char *csv;
	uint64_t frame_count;
	uint64_t budget;
	uint64_t repeat_count;
	uint64_t held_count;
	uint64_t client_count;
	uint64_t viewer_count;
	uint64_t keep_bytes;
	bool is_restart;
	bool is_quick;
	bool is_json;
};

static const struct contestant *const contestants[] = {
	&contestant_oocd,      &contestant_mmap,  &contestant_pread, &contestant_lmdb,
	&contestant_memcached, &contestant_table, &contestant_asked,
};
#define CONTESTANT_COUNT ARRAY_LENGTH(contestants)

/** The ways in which the walk is read. */
static const struct regime {
	const char *key;
	const char *title;
	bool cold;
	bool every_byte;
	bool is_limited;
} regimes[] = {
	{ "resident_lines", "resident, first and last line of every payload", false, false, false },
	{ "resident_bytes", "resident, every byte", false, true, false },
	{ "cold_bytes", "cold, every byte", true, true, false },
	{ "larger_bytes", "larger than memory, every byte", false, true, true },
};
#define REGIME_COUNT ARRAY_LENGTH(regimes)

/** Viewers as they are, without threads of the driver's, and such that draw next to nothing. */
static const struct viewers_case {
	const char *key;
	const char *title;
	bool is_single;
	bool is_control;
} viewers_cases[] = {
	{ "viewers", "viewers", false, false },
	{ "viewers_single", "viewers with LP_NUM_THREADS=0", true, false },
	{ "viewers_control", "viewers that draw one node, LP_NUM_THREADS=0", true, true },
};
#define VIEWERS_CASE_COUNT ARRAY_LENGTH(viewers_cases)

/** What one contestant did in one regime. */
struct score {
	bool is_there;
	double *nodes_s;  /* one a round */
	double *frame_us; /* of all rounds */
	size_t round_count;
};

struct cache {
	const struct cache_options *options;
	char scratch[PATH_MAX];
	struct contest_walk walk;
	uint64_t limit_bytes;
	uint64_t sum[2]; /* of the walk's lines, of its bytes; as the first contestant read them */
	bool has_sum[2];
	struct score scores[REGIME_COUNT][CONTESTANT_COUNT];
	struct why missing[REGIME_COUNT][CONTESTANT_COUNT]; /* why a contestant is not there */
	struct frames_one one;
	struct frames_crowd crowd;
	struct viewers_memory viewers[VIEWERS_CASE_COUNT];
	double arena_bytes; /* what the daemon has of it while they look */
};

/* ---- frames ---- */

static int measure_frames(struct cache *cache, struct why *why)
{
	const struct cache_options *options = cache->options;
	struct measure_daemon daemon = { 0 };
	struct frames_config config = {
		.store = options->store,
		.held_count = options->held_count,
		.frame_count = options->is_quick ? 20 : 600,
		.rate = 500.0,
	};
	uint64_t bytes = 64 * MIB;
	int r;

	for (uint64_t i = 0; i < cache->walk.superblock.node_count; i++)
		bytes += bytes_round_up(cache->walk.nodes[i].payload_bytes, 4096);
	r = measure_daemon_start(cache->scratch, bytes_round_up(bytes, 64 * MIB), 0, &daemon, why);
	if (r < 0)
		return r;
	config.socket_path = daemon.socket_path;
	r = frames_measure_one(&config, &cache->one, why);
	/* As screens have it. */
	config.rate = 60.0;
	config.frame_count = options->is_quick ? 20 : 300;
	if (r == 0)
		r = frames_measure_crowd(&config, (unsigned)options->client_count, CROWD_SHARE,
					 &cache->crowd, why);
	measure_daemon_stop(&daemon);
	return r;
}

/* ---- viewers ---- */

/* What the daemon's memory holds: bytes of payloads, of all stores and clients. */
static int arena_used(const char *socket_path, double *ret, struct why *why)
{
	struct ooc_client *client;
	char *status = NULL;
	int r = ooc_connect(socket_path, "oocbench", &client);

	if (r == 0)
		r = ooc_status(client, &status);
	if (r == 0)
		r = measure_json_number(status, "cache_used_bytes", ret);
	free(status);
	ooc_disconnect(client);
	return r < 0 ? why_set(why, r, "the daemon's status cannot be had") : 0;
}

static int measure_viewers(struct cache *cache, struct why *why)
{
	const struct cache_options *options = cache->options;
	struct measure_daemon daemon = { 0 };
	struct viewers_config config = {
		.store = options->store,
		.path = options->path,
		.viewer_count = (unsigned)options->viewer_count,
		.seconds = options->is_quick ? 3 : 20,
	};
	int r = measure_daemon_start(
		cache->scratch,
		bytes_round_up(2 * cache->walk.distinct_bytes + 256 * MIB, 64 * MIB), 0, &daemon,
		why);

	if (r < 0)
		return r;
	config.socket_path = daemon.socket_path;
	for (unsigned i = 0; r == 0 && i < VIEWERS_CASE_COUNT; i++) {
		config.is_single = viewers_cases[i].is_single;
		config.is_control = viewers_cases[i].is_control;
		r = viewers_measure(&config, &cache->viewers[i], why);
		if (r == 0 && i == 0)
			r = arena_used(daemon.socket_path, &cache->arena_bytes, why);
	}
	measure_daemon_stop(&daemon);
	return r;
}

/* ---- the contest ---- */

static int score_make(struct cache *cache, size_t regime, size_t number, struct why *why)
{
	struct score *score = &cache->scores[regime][number];

	score->nodes_s = calloc(cache->options->repeat_count, sizeof(double));
	score->frame_us =
		calloc(cache->options->repeat_count * cache->walk.frame_count + 1, sizeof(double));
	if (!score->nodes_s || !score->frame_us)
		return why_set(why, -ENOMEM, "out of memory");
	score->is_there = true;
	return 0;
}

/* All have to read the same. */
static int score_take(struct cache *cache, size_t regime, size_t number,
		      const struct contest_round *round, struct why *why)
{
	struct score *score = &cache->scores[regime][number];
	double *frame_us = score->frame_us + score->round_count * cache->walk.frame_count;
	bool every_byte = regimes[regime].every_byte;

	if (cache->has_sum[every_byte] && cache->sum[every_byte] != round->sum)
		return why_set(why, -EBADMSG, "%s has read something else than %s",
			       contestants[number]->name, contestants[0]->name);
	cache->has_sum[every_byte] = true;
	cache->sum[every_byte] = round->sum;
	for (size_t i = 0; i < cache->walk.frame_count; i++)
		frame_us[i] = (double)round->frame_us[i];
	score->nodes_s[score->round_count++] = (double)cache->walk.read_count / round->seconds;
	return 0;
}

static int said_by(const struct contestant *contestant, int error, struct why *why)
{
	if (error < 0 && error != -ECANCELED)
		why_prefix(why, "%s", contestant->name);
	return error;
}

/* Those who are there, and as much memory as they take. */
static int run_regime(struct cache *cache, struct contest_seat **seats, size_t regime,
		      struct why *why)
{
	const struct regime *how = &regimes[regime];
	int r = 0;

	for (size_t i = 0; r == 0 && i < CONTESTANT_COUNT; i++)
		if (seats[i] && !(how->cold && !contestants[i]->forget))
			r = score_make(cache, regime, i, why);
	for (size_t round = 0; r == 0 && round < cache->options->repeat_count; round++) {
		/* Every one is first in turn, and after every other in turn. */
		for (size_t k = 0; r == 0 && k < CONTESTANT_COUNT; k++) {
			size_t i = (round % 2 ? CONTESTANT_COUNT - 1 - k : k) + round / 2;
			const struct contest_round *result;

			i %= CONTESTANT_COUNT;
			if (!cache->scores[regime][i].is_there)
				continue;
			r = contest_run(seats[i], how->cold, how->every_byte, &result, why);
			if (r == 0)
				r = score_take(cache, regime, i, result, why);
			r = said_by(contestants[i], r, why);
		}
	}
	return r;
}

static int run_unlimited(struct cache *cache, struct why *why)
{
	const struct contest_config config = { .walk = &cache->walk, .scratch = cache->scratch };
	struct contest_seat *seats[CONTESTANT_COUNT] = { NULL };
	int r = 0;

	for (size_t i = 0; r == 0 && i < CONTESTANT_COUNT; i++) {
		const struct contest_round *ignored;

		r = contest_enter(contestants[i], &config, &seats[i], why);
		if (r == -ENOENT) {
			for (size_t k = 0; k < REGIME_COUNT; k++)
				cache->missing[k][i] = *why;
			r = 0;
		} else if (r == 0) {
			/* Brings everything in. */
			r = contest_run(seats[i], false, true, &ignored, why);
		}
		r = said_by(contestants[i], r, why);
	}
	for (size_t k = 0; r == 0 && k < REGIME_COUNT; k++)
		if (!regimes[k].is_limited)
			r = run_regime(cache, seats, k, why);
	for (size_t i = 0; i < CONTESTANT_COUNT; i++)
		contest_leave(seats[i]);
	return r;
}

/*
 * The page cache is everyone's: what one contestant has read another would find.  So each has its turn
 * alone, from its beginning to its end, and reads the walk once before it is timed.
 */
static int run_limited_turn(struct cache *cache, size_t regime, size_t number, struct why *why)
{
	const struct contestant *contestant = contestants[number];
	const struct contest_config config = {
		.walk = &cache->walk,
		.scratch = cache->scratch,
		.memory_bytes = cache->limit_bytes - BESIDE_BYTES,
		.limit_bytes = cache->limit_bytes,
	};
	const struct contest_round *result;
	struct contest_seat *seat;
	AUTO_FD fd = open(cache->walk.store, O_RDONLY | O_CLOEXEC);
	int r;

	if (fd < 0)
		return why_errno(why, -errno, "%s", cache->walk.store);
	contest_drop_file(fd);
	r = contest_enter(contestant, &config, &seat, why);
	if (r == -ENOENT || r == -ENOTSUP) {
		cache->missing[regime][number] = *why;
		return 0;
	}
	if (r == 0)
		r = contest_run(seat, false, true, &result, why);
	if (r == 0)
		r = contest_run(seat, false, regimes[regime].every_byte, &result, why);
	if (r == 0 && !cache->scores[regime][number].is_there)
		r = score_make(cache, regime, number, why);
	if (r == 0)
		r = score_take(cache, regime, number, result, why);
	contest_leave(seat);
	return said_by(contestant, r, why);
}

static int run_limited(struct cache *cache, size_t regime, struct why *why)
{
	int r = 0;

	for (size_t round = 0; r == 0 && round < cache->options->repeat_count; round++)
		for (size_t k = 0; r == 0 && k < CONTESTANT_COUNT; k++) {
			size_t i = round % 2 ? CONTESTANT_COUNT - 1 - k : k;

			if (contestants[i]->forget && cache->missing[regime][i].text[0] == '\0')
				r = run_limited_turn(cache, regime, i, why);
		}
	return r;
}

static int measure_contest(struct cache *cache, struct why *why)
{
	int r = run_unlimited(cache, why);

	cache->limit_bytes = u64_max(cache->walk.distinct_bytes / 2,
				     3 * cache->walk.largest_bytes + 2 * BESIDE_BYTES);
	for (size_t k = 0; r == 0 && k < REGIME_COUNT; k++) {
		if (!regimes[k].is_limited)
			continue;
		if (cache->limit_bytes < cache->walk.distinct_bytes)
			r = run_limited(cache, k, why);
		else
			for (size_t i = 0; i < CONTESTANT_COUNT; i++)
				(void)why_set(&cache->missing[k][i], -ENODATA,
					      "the path sees too little for that: %" PRIu64 " MiB",
					      cache->walk.distinct_bytes / MIB);
	}
	return r;
}

/* ---- reports ---- */

static void report_cost(struct report *report, const char *key, const char *title,
			struct frames_cost *cost, const char *floor_title)
{
	report_group_begin(report, key, title);
	report_distribution(report, "set_us", "dispatch and set",
			    distribution_of(cost->set_us, cost->count), "us");
	report_distribution(report, "map_us", "map of every node",
			    distribution_of(cost->map_us, cost->count), "us");
	if (cost->floor_us)
		report_distribution(report, "floor_us", floor_title,
				    distribution_of(cost->floor_us, cost->count), "us");
	if (cost->system_calls >= 0.0)
		report_number(report, "system_calls", "system calls a frame", cost->system_calls,
			      "");
	report_group_end(report);
}

static void report_frames(struct cache *cache, struct report *report)
{
	static const char *const keys[FRAMES_SHARE_COUNT] = { "changed_0", "changed_10",
							      "changed_100" };
	static const char *const titles[FRAMES_SHARE_COUNT] = {
		"one client, nothing changed", "one client, 10 % of the set changed",
		"one client, the whole set changed"
	};
	static const char *const floors[FRAMES_SHARE_COUNT] = { "a compare of as many bytes",
								"a message of as many bytes",
								"a message of as many bytes" };

	report_number(report, "held_nodes", "nodes held", (double)cache->one.held_count, "");
	for (unsigned s = 0; s < FRAMES_SHARE_COUNT; s++)
		report_cost(report, keys[s], titles[s], &cache->one.costs[s], floors[s]);
	report_number(report, "crowd_clients", "clients of the crowd",
		      (double)cache->options->client_count, "");
	report_cost(report, "crowd", "in the crowd, 10 % of each set changed", &cache->crowd.cost,
		    NULL);
	report_number(report, "crowd_answered_low", "sets answered a second, least of a client",
		      cache->crowd.answered_low, "");
	report_number(report, "crowd_answered_high", "sets answered a second, most of a client",
		      cache->crowd.answered_high, "");
}

/* Round by round, then the median: what disturbs a round disturbs both. */
static void report_ratio(struct cache *cache, struct report *report, size_t regime, size_t number)
{
	const struct score *ours = &cache->scores[regime][0];
	const struct score *theirs = &cache->scores[regime][number];
	double ratios[REPEATS_MAX];
	char title[64];

	for (size_t i = 0; i < theirs->round_count; i++)
		ratios[i] = ours->nodes_s[i] / theirs->nodes_s[i];
	(void)snprintf(title, sizeof(title), "oocd / %s", contestants[number]->name);
	report_spread(report, "ratio", title, spread_of(ratios, theirs->round_count), "");
}

static void report_score(struct cache *cache, struct report *report, size_t regime, size_t number)
{
	struct score *score = &cache->scores[regime][number];
	size_t frame_count = score->round_count * cache->walk.frame_count;

	report_group_begin(report, contestants[number]->name, contestants[number]->name);
	if (score->is_there) {
		/* Before spreads, which sort. */
		if (number > 0 && cache->scores[regime][0].is_there)
			report_ratio(cache, report, regime, number);
		report_distribution(report, "frame_us", "a frame",
				    distribution_of(score->frame_us, frame_count), "us");
	} else {
		report_text(report, "missing", "not measured", cache->missing[regime][number].text);
	}
	report_group_end(report);
}

static void report_regime(struct cache *cache, struct report *report, size_t regime)
{
	report_group_begin(report, regimes[regime].key, regimes[regime].title);
	if (regimes[regime].is_limited)
		report_number(report, "limit_bytes", "memory of each", (double)cache->limit_bytes,
			      "bytes");
	for (size_t i = 0; i < CONTESTANT_COUNT; i++)
		if (cache->scores[regime][i].is_there || cache->missing[regime][i].text[0] != '\0')
			report_score(cache, report, regime, i);
	for (size_t i = 0; i < CONTESTANT_COUNT; i++) {
		struct score *score = &cache->scores[regime][i];
		char key[64];
		char title[64];

		if (!score->is_there)
			continue;
		(void)snprintf(key, sizeof(key), "%s_nodes_s", contestants[i]->name);
		(void)snprintf(title, sizeof(title), "%s, nodes a second", contestants[i]->name);
		report_spread(report, key, title, spread_of(score->nodes_s, score->round_count),
			      "");
	}
	report_group_end(report);
}

static void report_viewers(struct cache *cache, struct report *report)
{
	size_t count = cache->options->viewer_count;

	report_number(report, "viewer_count", "viewers", (double)count, "");
	report_number(report, "arena_bytes", "payloads in the daemon's memory", cache->arena_bytes,
		      "bytes");
	for (unsigned i = 0; i < VIEWERS_CASE_COUNT; i++) {
		struct viewers_memory *memory = &cache->viewers[i];

		report_group_begin(report, viewers_cases[i].key, viewers_cases[i].title);
		report_spread(report, "private_bytes", "memory of each alone",
			      spread_of(memory->private_bytes, count), "bytes");
		report_number(report, "all_bytes", "memory of all, what they share counted once",
			      memory->all_bytes, "bytes");
		report_number(
			report, "beside_arena_bytes", "of it beside 1.05 x the payloads, each",
			(memory->all_bytes - 1.05 * cache->arena_bytes) / (double)count, "bytes");
		report_group_end(report);
	}
}

static void cache_report(struct cache *cache)
{
	struct report report;

	report_begin(&report, cache->options->is_json);
	report_text(&report, "store", "store", cache->options->store);
	report_frames(cache, &report);
	report_number(&report, "frames", "frames of the walk", (double)cache->walk.frame_count, "");
	report_number(&report, "read_nodes", "nodes read in a round",
		      (double)cache->walk.read_count, "");
	report_number(&report, "read_bytes", "bytes of them", (double)cache->walk.read_bytes, "");
	report_number(&report, "distinct_bytes", "bytes of them, each node once",
		      (double)cache->walk.distinct_bytes, "");
	report_number(&report, "repeats", "rounds", (double)cache->options->repeat_count, "");
	for (size_t k = 0; k < REGIME_COUNT; k++)
		report_regime(cache, &report, k);
	if (cache->options->viewer_count > 0)
		report_viewers(cache, &report);
	report_end(&report);
}

static int cache_csv(const struct cache *cache, struct why *why)
{
	FILE *file = fopen(cache->options->csv, "we");
	size_t frame_count = cache->walk.frame_count;
	int failed;

	if (!file)
		return why_errno(why, -errno, "%s", cache->options->csv);
	fputs("regime,contestant,round,frame,nodes,us\n", file);
	for (size_t k = 0; k < REGIME_COUNT; k++)
		for (size_t i = 0; i < CONTESTANT_COUNT; i++) {
			const struct score *score = &cache->scores[k][i];

			for (size_t n = 0; n < score->round_count * frame_count; n++)
				fprintf(file, "%s,%s,%zu,%zu,%zu,%.1f\n", regimes[k].key,
					contestants[i]->name, n / frame_count, n % frame_count,
					cache->walk.frames[n % frame_count].node_count,
					score->frame_us[n]);
		}
	failed = ferror(file);
	return fclose(file) != 0 || failed
		       ? why_set(why, -EIO, "%s: cannot be written", cache->options->csv)
		       : 0;
}

/* A regime's frame times, the shortest first; after the report, which has sorted them. */
static int cache_plot(const struct cache *cache, size_t regime, struct why *why)
{
	const char *end = strrchr(cache->options->plot, '.');
	struct plot_series series[CONTESTANT_COUNT];
	char path[PATH_MAX];
	struct plot plot = {
		.title = regimes[regime].title,
		.x_label = "frames, the shortest first",
		.y_label = "microseconds a frame",
		.y_is_log = true,
		.series = series,
	};

	if (!end)
		end = cache->options->plot + strlen(cache->options->plot);
	(void)snprintf(path, sizeof(path), "%.*s-%s%s", (int)(end - cache->options->plot),
		       cache->options->plot, regimes[regime].key, end);
	for (size_t i = 0; i < CONTESTANT_COUNT; i++) {
		const struct score *score = &cache->scores[regime][i];

		if (score->is_there)
			series[plot.series_count++] = (struct plot_series){
				.title = contestants[i]->name,
				.y = score->frame_us,
				.count = score->round_count * cache->walk.frame_count,
			};
	}
	return plot.series_count > 0 ? plot_write(path, &plot, why) : 0;
}

static int cache_write(struct cache *cache, struct why *why)
{
	int r = cache->options->csv ? cache_csv(cache, why) : 0;

	if (r < 0)
		return r;
	cache_report(cache);
	for (size_t k = 0; r == 0 && cache->options->plot && k < REGIME_COUNT; k++)
		r = cache_plot(cache, k, why);
	return r;
}

/* ---- the verb ---- */

static int cache_make(struct cache *cache, struct why *why)
{
	int r = measure_scratch_make(NULL, cache->scratch, why);

	if (r < 0)
		return r;
	/* A walk takes longer to find than all that is quick. */
	r = contest_walk_make(cache->options->store, cache->options->path,
			      cache->options->is_quick ? PATH_ORBIT : PATH_WALK,
			      cache->options->frame_count, cache->options->budget, &cache->walk,
			      why);
	if (r == 0)
		r = measure_frames(cache, why);
	if (r == 0)
		r = measure_contest(cache, why);
	if (r == 0 && cache->options->viewer_count > 0)
		r = measure_viewers(cache, why);
	if (r == 0)
		r = cache_write(cache, why);
	for (size_t k = 0; k < REGIME_COUNT; k++)
		for (size_t i = 0; i < CONTESTANT_COUNT; i++) {
			free(cache->scores[k][i].nodes_s);
			free(cache->scores[k][i].frame_us);
		}
	frames_one_done(&cache->one);
	frames_crowd_done(&cache->crowd);
	contest_walk_done(&cache->walk);
	measure_scratch_remove(cache->scratch);
	return r;
}

static int cache_restart(const struct cache_options *options, struct why *why)
{
	char scratch[PATH_MAX];
	struct restart_config config = {
		.store = options->store,
		.scratch = scratch,
		.keep_bytes = options->keep_bytes,
		.held_count = options->held_count,
		.client_count = (unsigned)options->client_count,
		.repeat_count = options->repeat_count,
	};
	struct restart_result result;
	struct report report;
	int r = measure_scratch_make(NULL, scratch, why);

	if (r < 0)
		return r;
	r = restart_measure(&config, &result, why);
	measure_scratch_remove(scratch);
	if (r < 0)
		return r;
	report_begin(&report, options->is_json);
	report_text(&report, "store", "store", options->store);
	restart_report(&result, &report);
	report_end(&report);
	return 0;
}

int verb_cache(int argc, char **argv)
{
	static struct cache cache;
	struct cache_options options = {
		.frame_count = 60,
		.budget = 3000000,
		.repeat_count = 5,
		.held_count = 1000,
		.client_count = 16,
	};
	const struct argument table[] = {
		{ "path", ARGUMENT_TEXT, &options.path },
		{ "frames", ARGUMENT_NUMBER, &options.frame_count, 2, CONTEST_FRAME_COUNT_MAX },
		{ "budget", ARGUMENT_NUMBER, &options.budget, 1 },
		{ "repeats", ARGUMENT_NUMBER, &options.repeat_count, 1, REPEATS_MAX },
		{ "held", ARGUMENT_NUMBER, &options.held_count, 1, 100000 },
		{ "clients", ARGUMENT_NUMBER, &options.client_count, 1, FRAMES_CLIENT_COUNT_MAX },
		{ "viewers", ARGUMENT_NUMBER, &options.viewer_count, 1, VIEWERS_COUNT_MAX },
		{ "restart", ARGUMENT_FLAG, &options.is_restart },
		{ "keep", ARGUMENT_SIZE, &options.keep_bytes, .min = (double)MIB },
		{ "plot", ARGUMENT_TEXT, &options.plot },
		{ "csv", ARGUMENT_TEXT, &options.csv },
		{ "quick", ARGUMENT_FLAG, &options.is_quick },
		{ "json", ARGUMENT_FLAG, &options.is_json },
		{ NULL },
	};
	const struct arguments arguments = { "cache", help, table, 1, 1, "name one store" };
	struct why why = { "" };
	char **operands;
	int r;

	r = arguments_parse(&arguments, argc, argv, &operands);
	if (r != ARGUMENTS_OK)
		return r;
	options.store = operands[0];
	if (options.is_quick) {
		options.frame_count = u64_min(options.frame_count, 10);
		options.repeat_count = 1;
		options.client_count = u64_min(options.client_count, 4);
	}
	if (options.viewer_count > 0 && !options.path)
		return verb_usage_error("cache", "--viewers takes a --path for them to go along");
	cache.options = &options;
	r = options.is_restart ? cache_restart(&options, &why) : cache_make(&cache, &why);
	return verb_status("cache", r, &why);
}
