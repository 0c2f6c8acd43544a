/* SPDX-License-Identifier: MIT */
/*
 * The daemon's metrics: sums over all stores and clients, without a name of either, so that whoever
 * collects them learns nothing that is not his.  They go to whoever asks, to a file that is written
 * anew every METRICS_SECONDS, and to whoever connects to a socket for them.
 */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <sys/stat.h>

#include "daemon/limits.h"
#include "daemon/server/openmetrics.h"
#include "daemon/server/server_private.h"
#include "formats/base/clock.h"
#include "formats/base/file.h"
#include "formats/base/log.h"
#include "formats/store/new_file.h"

/* ---- the text ---- */

static void write_gauge(FILE *out, const char *name, const char *help, double value)
{
	openmetrics_family(out, name, OPENMETRICS_GAUGE, help);
	openmetrics_gauge(out, name, value);
}

static void write_count(FILE *out, const char *name, const char *help, uint64_t value)
{
	openmetrics_family(out, name, OPENMETRICS_COUNTER, help);
	openmetrics_count(out, name, NULL, NULL, value);
}

/* Sums of what changes up and down in stores. */
struct gauges {
	uint64_t arena_bytes;
	uint64_t memory_bytes;
	uint64_t huge_bytes;
	uint64_t held_bytes;
	uint64_t ready_count;
	double fragmentation; /* of the worst */
};

static void sum_gauges(const struct server *server, struct gauges *ret)
{
	*ret = (struct gauges){ 0 };
	LIST_FOR_EACH (link, &server->cache.stores) {
		const struct served *served = LIST_ENTRY(link, struct served, link);
		double fragmentation = arena_fragmentation(&served->arena);

		ret->arena_bytes += arena_bytes(&served->arena);
		ret->memory_bytes += arena_memory_bytes(&served->arena);
		ret->huge_bytes += arena_huge_bytes(&served->arena);
		ret->held_bytes += served->held_pages * WIRE_PAGE_BYTES;
		ret->ready_count += served->ready_count;
		if (fragmentation > ret->fragmentation)
			ret->fragmentation = fragmentation;
	}
}

static bool sees_all(const void *arg, const struct served *served)
{
	(void)arg;
	(void)served;
	return true;
}

static void count_sentence(void *arg, const char *sentence)
{
	uint32_t *count = arg;

	(void)sentence;
	(*count)++;
}

static void write_memory(FILE *out, const struct server *server)
{
	struct gauges gauges;

	sum_gauges(server, &gauges);
	write_gauge(out, "oocd_cache_bytes", "What the cache of all stores may take",
		    (double)server->cache.budget_bytes);
	write_gauge(out, "oocd_cache_used_bytes", "Payloads in the cache or being read into it",
		    (double)cache_used_bytes(&server->cache));
	write_gauge(out, "oocd_held_bytes", "Payloads that somebody holds",
		    (double)gauges.held_bytes);
	write_gauge(out, "oocd_pinned_bytes", "Payloads that administrators pin",
		    (double)residents_bytes(&server->residents));
	write_gauge(out, "oocd_arena_bytes", "Segments of all stores", (double)gauges.arena_bytes);
	write_gauge(out, "oocd_arena_memory_bytes", "The same, as the kernel counts it",
		    (double)gauges.memory_bytes);
	write_gauge(out, "oocd_arena_huge_page_bytes", "Of it, what lies in huge pages",
		    (double)gauges.huge_bytes);
	write_gauge(out, "oocd_fragmentation_ratio",
		    "0: the free space of each store is in one piece, 1: one is in dust",
		    gauges.fragmentation);
	write_gauge(out, "oocd_ready_nodes", "Payloads in the cache", (double)gauges.ready_count);
}

static void write_now(FILE *out, const struct server *server)
{
	uint64_t fetches_queued;
	uint64_t prefetches_queued;
	uint32_t degraded_count = 0;

	server_waiting(server, &fetches_queued, &prefetches_queued);
	server_degraded(server, sees_all, count_sentence, &degraded_count);
	write_gauge(out, "oocd_uptime_seconds", "Since the daemon began",
		    (double)((clock_now_ns() - server->start_ns) / NS_PER_S));
	write_gauge(out, "oocd_stores", "Stores that are served", server->cache.store_count);
	write_gauge(out, "oocd_clients", "Clients that are connected", server->session_count);
	write_gauge(out, "oocd_fetches_queued", "Nodes that wait for their read to be begun",
		    (double)fetches_queued);
	write_gauge(out, "oocd_prefetches_queued", "Nodes that may be read when nobody waits",
		    (double)prefetches_queued);
	write_gauge(out, "oocd_reads_in_flight", "Pieces being read",
		    fetch_in_flight(server->fetch));
	write_gauge(out, "oocd_fills_in_flight", "Payloads being read, verified or decoded",
		    fills_count(server->fills));
	write_gauge(out, "oocd_degraded",
		    "Things that work worse than they could; see oocctl status", degraded_count);
}

static void write_counts(FILE *out, const struct server *server)
{
	struct store_counters sum;

	server_sum(server, &sum);
#define WRITE_COUNT(name, help) write_count(out, "oocd_" #name, help, sum.name);
	STORE_COUNTERS(WRITE_COUNT)
#undef WRITE_COUNT
	write_count(out, "oocd_device_read_bytes", "Bytes read from devices, in whole blocks",
		    fetch_read_bytes(server->fetch));
	openmetrics_family(out, "oocd_refusals", OPENMETRICS_COUNTER,
			   "Nodes that clients were told are not coming for now");
	for (uint32_t i = WIRE_REASON_NONE + 1; i < WIRE_REASON_COUNT_; i++)
		openmetrics_count(out, "oocd_refusals", "reason", status_reason_names[i],
				  sum.refusals[i]);
	write_count(out, "oocd_clients_accepted", "Clients that have connected",
		    server->accepted_count);
	write_count(out, "oocd_clients_turned_away", "Clients that were one too many",
		    server->refused_count);
	openmetrics_family(out, "oocd_disconnects", OPENMETRICS_COUNTER,
			   "Clients that have gone, by cause");
	for (uint32_t i = 0; i < SESSION_END_COUNT_; i++)
		openmetrics_count(out, "oocd_disconnects", "cause", status_end_names[i],
				  server->session_ends[i]);
}

static void write_times(FILE *out, const struct server *server)
{
	const struct fill_times *times = fills_times(server->fills);

	openmetrics_family(out, "oocd_fill_seconds", OPENMETRICS_HISTOGRAM,
			   "From the begin of a read to the verified payload");
	openmetrics_histogram(out, "oocd_fill_seconds", "kind", "fetch", &times->fetch);
	openmetrics_histogram(out, "oocd_fill_seconds", "kind", "prefetch", &times->prefetch);
	openmetrics_family(
		out, "oocd_fetch_wait_seconds", OPENMETRICS_HISTOGRAM,
		"From being wanted to the begin of the read, and what of it went by while "
		"prefetches were read");
	openmetrics_histogram(out, "oocd_fetch_wait_seconds", "behind", "all", &times->wait);
	openmetrics_histogram(out, "oocd_fetch_wait_seconds", "behind", "prefetches",
			      &times->wait_behind_prefetch);
}

static void write_metrics(FILE *out, const struct server *server)
{
	openmetrics_family(out, "oocd_build", OPENMETRICS_INFO, "Which daemon this is");
	fprintf(out, "oocd_build_info{version=\"%s\",io=\"%s\"} 1\n", OOCD_VERSION,
		fetch_name(server->fetch));
	write_memory(out, server);
	write_now(out, server);
	write_counts(out, server);
	write_times(out, server);
	openmetrics_end(out);
}

char *server_metrics(const struct server *server)
{
	char *text = NULL;
	size_t text_bytes = 0;
	FILE *out = open_memstream(&text, &text_bytes);
	bool failed;

	if (!out)
		return NULL;
	write_metrics(out, server);
	failed = ferror(out) != 0;
	if (fclose(out) != 0 || failed) {
		free(text);
		return NULL;
	}
	return text;
}

/* ---- the file ---- */

struct metrics_job {
	struct worker_job job;
	struct server *server;
	char *text;
	int error;
	struct why why;
};

/* On a worker: a folder's flush may take long. */
static void file_run(struct worker_job *job, struct codec_scratch *scratch)
{
	struct metrics_job *self = LIST_ENTRY(job, struct metrics_job, job);
	struct new_file *file = NULL;

	(void)scratch;
	self->error = new_file_create(self->server->config.metrics_path, &file, &self->why);
	if (self->error == 0) {
		self->error = file_write_at(new_file_fd(file), self->text, strlen(self->text), 0);
		/* For a collector, which is another user; there is nobody's name in it. */
		if (self->error == 0 && fchmod(new_file_fd(file), 0644) < 0)
			self->error = -errno;
		if (self->error < 0)
			(void)why_errno(&self->why, self->error, "%s", new_file_path(file));
	}
	if (self->error == 0)
		self->error = new_file_commit(file, &self->why);
	new_file_destroy(file);
}

static void file_done(struct worker_job *job)
{
	struct metrics_job *self = LIST_ENTRY(job, struct metrics_job, job);
	struct metrics *metrics = &self->server->metrics;

	metrics->writing = false;
	/* Once, not every METRICS_SECONDS; the status says it for as long as it lasts. */
	if (self->error < 0 && metrics->error == 0)
		log_error("metrics: %s", self->why.text);
	metrics->error = self->error;
	free(self->text);
	free(self);
}

void server_metrics_tick(struct server *server, uint64_t now_ns)
{
	struct metrics *metrics = &server->metrics;
	struct metrics_job *self;

	if (!server->config.metrics_path || metrics->writing || now_ns < metrics->next_ns)
		return;
	metrics->next_ns = now_ns + METRICS_SECONDS * NS_PER_S;
	self = calloc(1, sizeof(*self));
	if (!self)
		return;
	self->text = server_metrics(server);
	if (!self->text) {
		free(self);
		return;
	}
	self->job = (struct worker_job){ .run = file_run, .done = file_done };
	list_init(&self->job.link);
	self->server = server;
	metrics->writing = true;
	workers_add(server->workers, &self->job);
}

/* ---- the socket ---- */

/* The text is shorter than a socket's buffer, so one send takes all of it, or the peer is no collector. */
static int on_connect(sd_event_source *source, int listen_fd, uint32_t events, void *arg)
{
	AUTO_FD fd = accept4(listen_fd, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK);
	char *text;

	(void)source;
	(void)events;
	if (fd < 0)
		return 0;
	text = server_metrics(arg);
	if (text)
		(void)send(fd, text, strlen(text), MSG_NOSIGNAL);
	free(text);
	return 0;
}

int server_metrics_start(struct server *server, struct why *why)
{
	struct metrics *metrics = &server->metrics;
	const char *path = server->config.metrics_socket_path;
	int r;

	if (!path)
		return 0;
	r = listener_open(path, SOCK_STREAM, &metrics->listener, why);
	if (r < 0)
		return r;
	/* For a collector, which is another user; there is nobody's name in what it gets. */
	if (chmod(path, 0666) < 0)
		return why_errno(why, -errno, "%s", path);
	r = sd_event_add_io(server->event, &metrics->source, metrics->listener.fd, EPOLLIN,
			    on_connect, server);
	return r < 0 ? why_errno(why, r, "the event loop") : 0;
}

void server_metrics_stop(struct server *server)
{
	(void)sd_event_source_disable_unref(server->metrics.source);
	listener_close(&server->metrics.listener);
}
