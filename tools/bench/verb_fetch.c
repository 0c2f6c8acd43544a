/* SPDX-License-Identifier: MIT */
/*
 * oocbench fetch: how fast oocd brings nodes from the disk, beside fio on the very same extents.
 *
 * The leaves are dealt into two halves, a stretch of the file to each in turn.  The cache holds one
 * half: asking for the other one evicts it, so that every measured fetch is cold while the daemon's
 * memory is as it is in use (faulted in once).  Both read with O_DIRECT: the page cache has no part.
 */
#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "formats/base/log.h"
#include "formats/base/text.h"
#include "libclient/ooc/client.h"
#include "tools/bench/base/arguments.h"
#include "tools/bench/base/figures.h"
#include "tools/bench/base/measure.h"
#include "tools/bench/base/report.h"
#include "tools/bench/base/verb.h"
#include "tools/bench/bench.h"

#define REPEATS_MAX 1000u
#define DEPTH_MAX   1024u
/** Nodes side by side in the file that go into the same half. */
#define STRETCH_NODES 32u
/** Most of a payload that the daemon reads at one time. */
#define PIECE_BYTES (256u << 10)
#define WAIT_MS     120000
/** A half is at most this share of the machine's memory. */
#define MEMORY_SHARE 4u

static const char help[] =
	"Usage: oocbench fetch STORE [--repeats N] [--depth N] [--limit SIZE]\n"
	"Measures cold fetches through a daemon of its own against fio (io_uring, O_DIRECT) on the same\n"
	"extents at the same depth, in turn, in one run.\n"
	"\n"
	"  --repeats N   measurements of each (5)\n"
	"  --depth N     reads at one time (16)\n"
	"  --limit SIZE  of decoded geometry a fetch (a quarter of the memory)\n"
	"  --json        results for programs\n"
	"\n"
	"Example:\n"
	"  oocbench fetch plant.ooc --repeats 7\n";

struct fetch_options {
	const char *store;
	uint64_t repeat_count;
	uint64_t depth;
	uint64_t limit_bytes;
	bool is_json;
};

/** One of the two sets of nodes. */
struct half {
	struct ooc_want *wants;
	size_t want_count;
	uint64_t stored_bytes; /* without the rest of last blocks, as the daemon counts them */
	uint64_t block_bytes;  /* as the disk reads them: whole blocks */
	uint64_t raw_bytes;    /* decoded */
	uint64_t arena_bytes;  /* decoded, in whole pages */
	uint64_t piece_count;  /* reads */
	char log_path[PATH_MAX];
};

struct fetch {
	const struct fetch_options *options;
	char scratch[PATH_MAX];
	struct measure_daemon daemon;
	struct ooc_client *client;
	struct ooc_store *store;
	struct half halves[2];
	bool has_fio;
	/* One figure a repeat. */
	double *daemon_rates; /* bytes of the disk a second */
	double *fio_rates;
	double *ratios;
	double *cpu_seconds;     /* a GB decoded */
	double *fio_cpu_seconds; /* a GB read, into nothing */
	double *cold_shares;     /* of the bytes asked for, those that the daemon read */
};

/* ---- what is fetched ---- */

static bool is_wanted(const struct store_node *node)
{
	return node->first_child == STORE_NODE_NONE && node->payload_id != 0;
}

static int halves_deal(struct fetch *fetch, struct why *why)
{
	const struct store_node *nodes = ooc_nodes(fetch->store);
	uint64_t node_count = ooc_node_count(fetch->store);
	uint64_t dealt = 0;

	for (int i = 0; i < 2; i++) {
		fetch->halves[i].wants = calloc(node_count + 1, sizeof(struct ooc_want));
		if (!fetch->halves[i].wants)
			return why_set(why, -ENOMEM, "out of memory");
	}
	for (uint32_t n = 0; n < node_count; n++) {
		struct half *half = &fetch->halves[dealt / STRETCH_NODES % 2];

		if (!is_wanted(&nodes[n]))
			continue;
		dealt++;
		if (half->arena_bytes + nodes[n].payload_bytes > fetch->options->limit_bytes)
			continue;
		half->wants[half->want_count] = (struct ooc_want){
			.store = fetch->store,
			.node = n,
			.importance = 1.0f / (float)(half->want_count + 1),
		};
		half->want_count++;
		half->stored_bytes += nodes[n].stored_bytes;
		half->block_bytes += bytes_round_up(nodes[n].stored_bytes, STORE_BLOCK_BYTES);
		half->raw_bytes += nodes[n].payload_bytes;
		half->arena_bytes += bytes_round_up(nodes[n].payload_bytes, 4096);
	}
	if (fetch->halves[1].want_count == 0)
		return why_set(why, -ENODATA,
			       "%s: %" PRIu64 " leaves are too few to be dealt into two halves",
			       fetch->options->store, dealt);
	return 0;
}

/* The half's extents as fio's log, in the daemon's pieces. */
static int half_log(const struct fetch *fetch, struct half *half, int number, struct why *why)
{
	const struct store_node *nodes = ooc_nodes(fetch->store);
	char store[PATH_MAX];
	FILE *file;
	int failed;

	if (!realpath(fetch->options->store, store))
		return why_errno(why, -errno, "%s", fetch->options->store);
	if (snprintf(half->log_path, sizeof(half->log_path), "%s/half%d.log", fetch->scratch,
		     number) >= (int)sizeof(half->log_path))
		return why_set(why, -ENAMETOOLONG, "%s: too long a path", fetch->scratch);
	file = fopen(half->log_path, "we");
	if (!file)
		return why_errno(why, -errno, "%s", half->log_path);
	fprintf(file, "fio version 2 iolog\n%s add\n%s open\n", store, store);
	for (size_t i = 0; i < half->want_count; i++) {
		const struct store_node *node = &nodes[half->wants[i].node];
		uint64_t left = bytes_round_up(node->stored_bytes, STORE_BLOCK_BYTES);

		for (uint64_t at = node->file_offset; left > 0;) {
			uint64_t piece = u64_min(left, PIECE_BYTES);

			fprintf(file, "%s read %" PRIu64 " %" PRIu64 "\n", store, at, piece);
			at += piece;
			left -= piece;
			half->piece_count++;
		}
	}
	fprintf(file, "%s close\n", store);
	failed = ferror(file);
	return fclose(file) != 0 || failed
		       ? why_set(why, -EIO, "%s: cannot be written", half->log_path)
		       : 0;
}

/* ---- one measurement ---- */

static int read_bytes(struct fetch *fetch, double *ret, struct why *why)
{
	char *status;
	int r = ooc_status(fetch->client, &status);

	if (r < 0)
		return why_set(why, r, "%s", ooc_error_text(fetch->client));
	r = measure_json_number(status, "read_bytes", ret);
	free(status);
	return r < 0 ? why_set(why, -EPROTO, "the daemon's status has no read_bytes") : 0;
}

struct fetched {
	double seconds;
	double cpu_seconds;
	double bytes; /* that the daemon read */
};

static int fetch_daemon(struct fetch *fetch, const struct half *half, struct fetched *ret,
			struct why *why)
{
	struct ooc_progress progress;
	double cpu_before;
	double cpu_after;
	double bytes_before;
	double bytes_after;
	uint64_t begin_ns;
	uint64_t end_ns;
	int64_t serial;
	int r = read_bytes(fetch, &bytes_before, why);

	if (r == 0 && measure_cpu_seconds(fetch->daemon.child.pid, &cpu_before) < 0)
		r = why_set(why, -ECHILD, "oocd has gone");
	if (r < 0)
		return r;
	begin_ns = clock_now_ns();
	serial = ooc_visible_set(fetch->client, half->wants, half->want_count);
	r = serial < 0 ? (int)serial : ooc_wait(fetch->client, WAIT_MS);
	end_ns = clock_now_ns();
	if (r < 0)
		return why_set(why, measure_was_cancelled() ? -ECANCELED : r, "the set of %zu: %s",
			       half->want_count, ooc_error_text(fetch->client));
	ooc_progress(fetch->client, &progress);
	if (!progress.complete)
		return why_set(why, -ENOBUFS, "%zu of %zu nodes were answered \"not now\"",
			       progress.refused_count, progress.want_count);
	r = read_bytes(fetch, &bytes_after, why);
	if (r == 0 && measure_cpu_seconds(fetch->daemon.child.pid, &cpu_after) < 0)
		r = why_set(why, -ECHILD, "oocd has gone");
	if (r < 0)
		return r;
	ret->seconds = (double)(end_ns - begin_ns) / (double)NS_PER_S;
	ret->cpu_seconds = cpu_after - cpu_before;
	ret->bytes = bytes_after - bytes_before;
	return 0;
}

/* Of the thread that reads: fio gives it in hundredths of the time that it took. */
static int fio_cpu_seconds(const char *output, double *ret)
{
	double user;
	double system;
	double milliseconds;

	if (measure_json_number(output, "usr_cpu", &user) < 0 ||
	    measure_json_number(output, "sys_cpu", &system) < 0 ||
	    measure_json_number(output, "job_runtime", &milliseconds) < 0)
		return -EPROTO;
	*ret = (user + system) / 100.0 * milliseconds / 1e3;
	return 0;
}

static int fetch_fio(const struct fetch *fetch, const struct half *half, double *ret_rate,
		     double *ret_cpu_seconds, struct why *why)
{
	char log[PATH_MAX + 32];
	char depth[32];
	const char *argv[] = { "fio", "--name=extents",      "--thread",
			       log,   "--ioengine=io_uring", "--direct=1",
			       depth, "--replay_no_stall=1", "--output-format=json",
			       NULL };
	struct measure_result result;
	const char *read_part;
	double read_count;
	double milliseconds;
	int r;

	(void)snprintf(log, sizeof(log), "--read_iolog=%s", half->log_path);
	(void)snprintf(depth, sizeof(depth), "--iodepth=%" PRIu64, fetch->options->depth);
	r = measure_run(argv, &result, why);
	if (r < 0)
		return r;
	read_part = strstr(result.output, "\"read\"");
	if (!read_part || measure_json_number(read_part, "total_ios", &read_count) < 0 ||
	    measure_json_number(read_part, "runtime", &milliseconds) < 0 || !(milliseconds > 0.0) ||
	    fio_cpu_seconds(result.output, ret_cpu_seconds) < 0)
		r = why_set(why, -EPROTO, "fio's answer has no reads or no time");
	else if (read_count != (double)half->piece_count)
		r = why_set(why, -EPROTO, "fio made %.0f reads instead of %" PRIu64, read_count,
			    half->piece_count);
	else
		/* Its own sum of bytes leaves out what was in flight when it reached the end. */
		*ret_rate = (double)half->block_bytes / milliseconds * 1e3;
	measure_result_done(&result);
	return r;
}

/* Both; who is first changes every two repeats, since every one is of the other half. */
static int fetch_repeat(struct fetch *fetch, uint64_t repeat, struct why *why)
{
	/* The half that the cache does not hold. */
	const struct half *half = &fetch->halves[(repeat + 1) % 2];
	struct fetched fetched = { 0 };
	int r = 0;

	for (unsigned turn = 0; r == 0 && turn < 2; turn++) {
		if (turn == repeat / 2 % 2)
			r = fetch_daemon(fetch, half, &fetched, why);
		else if (fetch->has_fio)
			r = fetch_fio(fetch, half, &fetch->fio_rates[repeat],
				      &fetch->fio_cpu_seconds[repeat], why);
	}
	if (r < 0)
		return r;
	fetch->cold_shares[repeat] = fetched.bytes / (double)half->stored_bytes;
	fetch->daemon_rates[repeat] =
		fetch->cold_shares[repeat] * (double)half->block_bytes / fetched.seconds;
	fetch->fio_cpu_seconds[repeat] *= 1e9 / (double)half->block_bytes;
	fetch->ratios[repeat] = fetch->daemon_rates[repeat] / fetch->fio_rates[repeat];
	fetch->cpu_seconds[repeat] =
		fetched.cpu_seconds * 1e9 / ((double)half->raw_bytes * fetch->cold_shares[repeat]);
	return 0;
}

/* ---- the verb ---- */

static void fetch_report(struct fetch *fetch)
{
	size_t count = fetch->options->repeat_count;
	struct report report;

	report_begin(&report, fetch->options->is_json);
	report_text(&report, "store", "store", fetch->options->store);
	report_number(&report, "nodes", "nodes a fetch", (double)fetch->halves[0].want_count, "");
	report_number(&report, "stored_bytes", "bytes on disk a fetch",
		      (double)fetch->halves[0].block_bytes, "");
	report_number(&report, "raw_bytes", "bytes decoded a fetch",
		      (double)fetch->halves[0].raw_bytes, "");
	report_number(&report, "depth", "reads at one time", (double)fetch->options->depth, "");
	report_number(&report, "repeats", "repeats", (double)count, "");
	for (size_t i = 0; i < count; i++) {
		fetch->daemon_rates[i] /= 1e6;
		fetch->fio_rates[i] /= 1e6;
	}
	report_spread(&report, "daemon_mb_s", "through oocd", spread_of(fetch->daemon_rates, count),
		      "MB/s");
	if (fetch->has_fio) {
		report_spread(&report, "fio_mb_s", "fio", spread_of(fetch->fio_rates, count),
			      "MB/s");
		report_spread(&report, "ratio", "oocd / fio", spread_of(fetch->ratios, count), "");
	} else {
		report_text(&report, "fio_mb_s", "fio", "is not installed: apt-get install fio");
	}
	report_spread(&report, "cpu_s_per_gb", "oocd's processor time, a GB decoded",
		      spread_of(fetch->cpu_seconds, count), "s");
	if (fetch->has_fio)
		report_spread(&report, "fio_cpu_s_per_gb", "fio's, a GB read and not looked at",
			      spread_of(fetch->fio_cpu_seconds, count), "s");
	report_spread(&report, "cold_share", "share that had to be read",
		      spread_of(fetch->cold_shares, count), "");
	report_end(&report);
}

static int fetch_connect(struct fetch *fetch, uint64_t cache_bytes, struct why *why)
{
	int r = measure_daemon_start(fetch->scratch, cache_bytes, (unsigned)fetch->options->depth,
				     &fetch->daemon, why);

	if (r < 0)
		return r;
	r = ooc_connect(fetch->daemon.socket_path, "oocbench", &fetch->client);
	if (r < 0)
		return why_set(why, r, "%s", ooc_error_text(NULL));
	r = ooc_open(fetch->client, fetch->options->store, &fetch->store);
	return r < 0 ? why_set(why, r, "%s: %s", fetch->options->store,
			       ooc_error_text(fetch->client))
		     : 0;
}

static void fetch_disconnect(struct fetch *fetch)
{
	fetch->client = ooc_disconnect(fetch->client);
	fetch->store = NULL;
	if (fetch->daemon.child.pid > 0)
		measure_daemon_stop(&fetch->daemon);
}

static int fetch_run(struct fetch *fetch, struct why *why)
{
	uint64_t cache_bytes;
	int r;

	/* Once only to see the HS: the cache's size depends on it. */
	r = fetch_connect(fetch, 64 * MIB, why);
	if (r == 0)
		r = halves_deal(fetch, why);
	for (int i = 0; r == 0 && i < 2; i++)
		r = half_log(fetch, &fetch->halves[i], i, why);
	fetch_disconnect(fetch);
	if (r < 0)
		return r;

	cache_bytes = u64_max(fetch->halves[0].arena_bytes, fetch->halves[1].arena_bytes);
	cache_bytes = bytes_round_up(cache_bytes + cache_bytes / 16, 64 * MIB);
	r = fetch_connect(fetch, cache_bytes, why);
	for (int i = 0; i < 2; i++)
		for (size_t k = 0; k < fetch->halves[i].want_count; k++)
			fetch->halves[i].wants[k].store = fetch->store;
	if (r == 0) {
		struct fetched ignored;

		/* Fills the cache with the half that the first repeat does not want. */
		r = fetch_daemon(fetch, &fetch->halves[0], &ignored, why);
	}
	for (uint64_t i = 0; r == 0 && i < fetch->options->repeat_count; i++)
		r = fetch_repeat(fetch, i, why);
	fetch_disconnect(fetch);
	return r;
}

static int fetch_make(struct fetch *fetch, struct why *why)
{
	size_t count = fetch->options->repeat_count;
	int r = measure_scratch_make(NULL, fetch->scratch, why);

	if (r < 0)
		return r;
	fetch->daemon_rates = calloc(count, sizeof(double));
	fetch->fio_rates = calloc(count, sizeof(double));
	fetch->ratios = calloc(count, sizeof(double));
	fetch->cpu_seconds = calloc(count, sizeof(double));
	fetch->fio_cpu_seconds = calloc(count, sizeof(double));
	fetch->cold_shares = calloc(count, sizeof(double));
	if (!fetch->daemon_rates || !fetch->fio_rates || !fetch->ratios || !fetch->cpu_seconds ||
	    !fetch->fio_cpu_seconds || !fetch->cold_shares)
		r = why_set(why, -ENOMEM, "out of memory");
	else
		r = fetch_run(fetch, why);
	if (r == 0)
		fetch_report(fetch);
	measure_scratch_remove(fetch->scratch);
	for (int i = 0; i < 2; i++)
		free(fetch->halves[i].wants);
	free(fetch->daemon_rates);
	free(fetch->fio_rates);
	free(fetch->ratios);
	free(fetch->cpu_seconds);
	free(fetch->fio_cpu_seconds);
	free(fetch->cold_shares);
	return r;
}

int verb_fetch(int argc, char **argv)
{
	struct fetch_options options = { .repeat_count = 5, .depth = 16 };
	struct fetch fetch = { .options = &options };
	const struct argument table[] = {
		{ "repeats", ARGUMENT_NUMBER, &options.repeat_count, 1, REPEATS_MAX },
		{ "depth", ARGUMENT_NUMBER, &options.depth, 1, DEPTH_MAX },
		{ "limit", ARGUMENT_SIZE, &options.limit_bytes, .min = STORE_PAYLOAD_BYTES_MAX },
		{ "json", ARGUMENT_FLAG, &options.is_json },
		{ NULL },
	};
	const struct arguments arguments = { "fetch", help, table, 1, 1, "name one store" };
	char **operands;
	struct why why = { "" };
	int r;

	options.limit_bytes =
		(uint64_t)sysconf(_SC_PHYS_PAGES) * (uint64_t)sysconf(_SC_PAGESIZE) / MEMORY_SHARE;
	r = arguments_parse(&arguments, argc, argv, &operands);
	if (r != ARGUMENTS_OK)
		return r;
	options.store = operands[0];
	fetch.has_fio = measure_has_program("fio");
	if (!fetch.has_fio)
		log_warning("fetch: fio is not installed, so there is nothing to compare with; "
			    "apt-get install fio");
	r = fetch_make(&fetch, &why);
	return verb_status("fetch", r, &why);
}
