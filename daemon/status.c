/* SPDX-License-Identifier: MIT */
/* What the daemon says of itself, as JSON: what it serves, to whom, and what it lacks. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/server_private.h"
#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "formats/base/text.h"

#define HUGE_PAGE_BYTES (2u * MIB)

static void write_number(FILE *out, const char *key, uint64_t value)
{
	fprintf(out, ",\"%s\":%llu", key, (unsigned long long)value);
}

static uint64_t huge_bytes_of(const struct served *served)
{
	uint64_t huge_bytes = 0;

	LIST_FOR_EACH (link, &served->arena.in_order)
		huge_bytes += ARENA_SEGMENT(link)->memfile.huge_bytes;
	return huge_bytes;
}

static void write_store(FILE *out, const struct served *served)
{
	const struct served_counters *counters = &served->counters;

	fputs("{\"path\":", out);
	text_write_json(out, served->path);
	write_number(out, "generation", served->superblock->generation);
	write_number(out, "nodes", served->node_count);
	write_number(out, "clients", served->attach_count);
	write_number(out, "arena_bytes", arena_bytes(&served->arena));
	write_number(out, "used_bytes", served->arena.used_pages * WIRE_PAGE_BYTES);
	write_number(out, "held_bytes", served->held_pages * WIRE_PAGE_BYTES);
	write_number(out, "huge_page_bytes", huge_bytes_of(served));
	write_number(out, "segments", served->arena.segment_count);
	write_number(out, "segment_bytes", served->arena.segment_bytes);
	fprintf(out, ",\"fragmentation\":%.4f", arena_fragmentation(&served->arena));
	write_number(out, "ready_nodes", served->ready_count);
	write_number(out, "hits", counters->hits);
	write_number(out, "misses", counters->misses);
	write_number(out, "fetches", counters->fetches);
	write_number(out, "prefetches", counters->prefetches);
	write_number(out, "evictions", counters->evictions);
	write_number(out, "read_bytes", counters->read_bytes);
	write_number(out, "errors", counters->errors);
	write_number(out, "fragmented", counters->fragmented);
	fputc('}', out);
}

static void write_client(FILE *out, const struct session *session)
{
	const struct visible *visible = &session->visible;

	fprintf(out, "{\"pid\":%d,\"uid\":%d,\"name\":", (int)connection_pid(session->connection),
		(int)connection_uid(session->connection));
	text_write_json(out, session->name);
	write_number(out, "held_nodes", visible->held_count);
	write_number(out, "held_bytes", visible->held_pages * WIRE_PAGE_BYTES);
	write_number(out, "wanted_nodes", visible->count);
	write_number(out, "waiting_nodes", visible_missing_count(visible));
	write_number(out, "refused_nodes", visible->counts[WANT_REFUSED]);
	write_number(out, "prefetch_nodes", session->prefetch_count - session->prefetch_next);
	fputc('}', out);
}

static void write_account(FILE *out, const struct account *account)
{
	const struct account_policy *policy = &account->policy;

	fprintf(out, "{\"uid\":%u", (unsigned)policy->uid);
	write_number(out, "weight", policy->weight);
	write_number(out, "share_permille", policy->share_permille);
	write_number(out, "sessions", account->session_count);
	write_number(out, "sessions_max", policy->session_count_max);
	write_number(out, "sessions_refused", account->refused_count);
	write_number(out, "held_bytes", account->held_pages * WIRE_PAGE_BYTES);
	write_number(out, "fetched_bytes", account->fetched_bytes);
	write_number(out, "prefetched_bytes", account->prefetched_bytes);
	write_number(out, "prefetch_nodes", account->prefetch_count);
	write_number(out, "sent_bytes", account->sent_bytes);
	write_number(out, "log_lines_left_out", account->unlogged_count);
	fputc('}', out);
}

/* ---- what is degraded, each with what to do ---- */

struct sentences {
	FILE *out;
	bool any;
};

static void write_sentence(struct sentences *sentences, const char *text)
{
	if (sentences->any)
		fputc(',', sentences->out);
	text_write_json(sentences->out, text);
	sentences->any = true;
}

static void write_degraded_stores(struct sentences *sentences, const struct server *server)
{
	uint64_t could_bytes = 0;
	uint64_t huge_bytes = 0;
	char text[SERVED_PATH_BYTES + 160];

	LIST_FOR_EACH (link, &server->cache.stores) {
		const struct served *served = LIST_ENTRY(link, struct served, link);

		if (served->arena.segment_bytes >= HUGE_PAGE_BYTES)
			could_bytes += arena_bytes(&served->arena);
		huge_bytes += huge_bytes_of(served);
		if (served->direct)
			continue;
		(void)snprintf(
			text, sizeof(text),
			"%s: no direct reads, its bytes lie in the page cache too: keep it on "
			"a file system with O_DIRECT",
			served->path);
		write_sentence(sentences, text);
	}
	if (huge_bytes < could_bytes) {
		(void)snprintf(
			text, sizeof(text),
			"huge pages: %llu of %llu MiB: memory is fragmented, or the kernel is "
			"older than 6.1 and /sys/kernel/mm/transparent_hugepage/shmem_enabled "
			"is not advise",
			(unsigned long long)(huge_bytes / MIB),
			(unsigned long long)(could_bytes / MIB));
		write_sentence(sentences, text);
	}
}

static void write_degraded(FILE *out, const struct server *server)
{
	struct sentences sentences = { .out = out };
	char text[256];

	fputs(",\"degraded\":[", out);
	if (fetch_degraded(server->fetch)[0] != '\0')
		write_sentence(&sentences, fetch_degraded(server->fetch));
	if (server->buffer_error < 0) {
		(void)snprintf(text, sizeof(text),
			       "memory cannot be registered for reading (%s): reads cost more "
			       "processor time: raise LimitMEMLOCK or `ulimit -l`",
			       strerror(-server->buffer_error));
		write_sentence(&sentences, text);
	}
	if (server->config.disk) {
		(void)snprintf(text, sizeof(text),
			       "reads are slowed down on purpose (--disk %s): leave it out",
			       server->config.disk->name);
		write_sentence(&sentences, text);
	}
	if (server->cache.short_since_ns > 0)
		write_sentence(&sentences,
			       "memory is short: the cache is smaller than asked for: lower "
			       "--cache-size or give oocd more memory");
	write_degraded_stores(&sentences, server);
	fputc(']', out);
}

static void write_status(FILE *out, struct server *server)
{
	const char *separator = "";
	uint64_t waiting_nodes = 0;
	uint64_t prefetch_nodes = 0;

	fprintf(out, "{\"version\":\"%s\"", OOCD_VERSION);
	write_number(out, "uptime_s", (clock_now_ns() - server->start_ns) / NS_PER_S);
	write_number(out, "cache_bytes", server->cache.budget_bytes);
	write_number(out, "cache_used_bytes", cache_used_bytes(&server->cache));
	fprintf(out, ",\"io\":\"%s\"", fetch_name(server->fetch));
	write_number(out, "queue_depth", server->config.queue_depth);
	write_number(out, "reads_in_flight", fetch_in_flight(server->fetch));
	write_number(out, "fills_in_flight", fills_count(server->fills));
	write_number(out, "store_count", server->cache.store_count);
	fputs(",\"stores\":[", out);
	LIST_FOR_EACH (link, &server->cache.stores) {
		fputs(separator, out);
		write_store(out, LIST_ENTRY(link, struct served, link));
		separator = ",";
	}
	fputs("],\"clients\":[", out);
	separator = "";
	LIST_FOR_EACH (link, &server->sessions) {
		const struct session *session = LIST_ENTRY(link, struct session, link);

		if (session->state != SESSION_READY)
			continue;
		fputs(separator, out);
		write_client(out, session);
		separator = ",";
		waiting_nodes += session->visible.counts[WANT_QUEUED];
		prefetch_nodes += session->prefetch_count - session->prefetch_next;
	}
	fputs("],\"accounts\":[", out);
	separator = "";
	LIST_FOR_EACH (link, &server->accounts.in_order) {
		fputs(separator, out);
		write_account(out, LIST_ENTRY(link, struct account, link));
		separator = ",";
	}
	fputc(']', out);
	write_number(out, "fetches_queued", waiting_nodes);
	write_number(out, "prefetches_queued", prefetch_nodes);
	write_degraded(out, server);
	fputs("}\n", out);
}

char *server_status(struct server *server)
{
	char *text = NULL;
	size_t text_bytes = 0;
	FILE *out = open_memstream(&text, &text_bytes);
	bool failed;

	if (!out)
		return NULL;
	write_status(out, server);
	failed = ferror(out) != 0;
	if (fclose(out) != 0 || failed) {
		free(text);
		return NULL;
	}
	return text;
}
