/* SPDX-License-Identifier: MIT */
/*
 * What the daemon says of itself, as JSON: what it serves, to whom, and what it lacks.
 *
 * Administrators are told all.  Everybody else is told of the clients of his own user and of the
 * stores that these have open, and sums of the rest: a store's path is a hint that a user who may not
 * read it must not get.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/server/server_private.h"
#include "formats/base/clock.h"
#include "formats/base/text.h"

const char *const status_reason_names[WIRE_REASON_COUNT_] = {
	[WIRE_REASON_FULL] = "full",
	[WIRE_REASON_DAMAGED] = "damaged",
	[WIRE_REASON_UNREADABLE] = "unreadable",
	[WIRE_REASON_NO_MEMORY] = "no_memory",
};

const char *const status_end_names[SESSION_END_COUNT_] = {
	[SESSION_END_HUNG_UP] = "hung_up", [SESSION_END_PROTOCOL] = "protocol",
	[SESSION_END_SILENT] = "silent",   [SESSION_END_UNREAD] = "unread",
	[SESSION_END_LEASE] = "lease",     [SESSION_END_OTHER] = "other",
};

/** Who looks, and where what he is shown goes. */
struct view {
	FILE *out;
	struct server *server;
	bool admin;
	uid_t uid;
	bool any_sentence;
};

static bool sees_client(const struct view *view, const struct session *session)
{
	return view->admin || connection_uid(session->connection) == view->uid;
}

static bool has_open(const struct session *session, const struct served *served)
{
	for (uint64_t slots = session->visible.attached; slots != 0; slots &= slots - 1)
		if (session->visible.attachments[__builtin_ctzll(slots)]->served == served)
			return true;
	return false;
}

static bool sees_store(const void *arg, const struct served *served)
{
	const struct view *view = arg;

	if (view->admin)
		return true;
	LIST_FOR_EACH (link, &view->server->sessions) {
		const struct session *session = LIST_ENTRY(link, struct session, link);

		if (sees_client(view, session) && has_open(session, served))
			return true;
	}
	return false;
}

/* ---- sums ---- */

void server_sum(const struct server *server, struct store_counters *ret)
{
	*ret = server->closed_counters;
	LIST_FOR_EACH (link, &server->cache.stores)
		store_counters_add(ret, &LIST_ENTRY(link, struct served, link)->counters);
}

void server_waiting(const struct server *server, uint64_t *ret_fetches, uint64_t *ret_prefetches)
{
	*ret_fetches = 0;
	*ret_prefetches = 0;
	LIST_FOR_EACH (link, &server->sessions) {
		const struct session *session = LIST_ENTRY(link, struct session, link);

		*ret_fetches += visible_queued_count(&session->visible);
		*ret_prefetches += session->prefetch_count - session->prefetch_next;
	}
}

/* ---- JSON ---- */

static void write_number(FILE *out, const char *key, uint64_t value)
{
	fprintf(out, ",\"%s\":%llu", key, (unsigned long long)value);
}

static void write_counters(FILE *out, const struct store_counters *counters)
{
#define WRITE_COUNTER(name, help) write_number(out, #name, counters->name);
	STORE_COUNTERS(WRITE_COUNTER)
#undef WRITE_COUNTER
	fputs(",\"refusals\":{", out);
	for (uint32_t i = WIRE_REASON_NONE + 1; i < WIRE_REASON_COUNT_; i++)
		fprintf(out, "%s\"%s\":%llu", i > WIRE_REASON_NONE + 1 ? "," : "",
			status_reason_names[i], (unsigned long long)counters->refusals[i]);
	fputc('}', out);
}

static void write_store(FILE *out, const struct served *served)
{
	fputs("{\"path\":", out);
	text_write_json(out, served->path);
	write_number(out, "generation", served->superblock->generation);
	write_number(out, "nodes", served->node_count);
	write_number(out, "clients", served->attach_count);
	write_number(out, "arena_bytes", arena_bytes(&served->arena));
	write_number(out, "memory_bytes", arena_memory_bytes(&served->arena));
	write_number(out, "used_bytes", served->arena.used_pages * WIRE_PAGE_BYTES);
	write_number(out, "held_bytes", served->held_pages * WIRE_PAGE_BYTES);
	write_number(out, "pinned_nodes", served->resident_count);
	write_number(out, "pinned_bytes", served->resident_pages * WIRE_PAGE_BYTES);
	write_number(out, "huge_page_bytes", arena_huge_bytes(&served->arena));
	write_number(out, "segments", served->arena.segment_count);
	write_number(out, "segment_bytes", served->arena.segment_bytes);
	fprintf(out, ",\"fragmentation\":%.4f", arena_fragmentation(&served->arena));
	write_number(out, "ready_nodes", served->ready_count);
	write_counters(out, &served->counters);
	fputc('}', out);
}

/* Whose reads it lives on.  Sessions that the viewer does not see are numbers to him. */
static void write_debts(FILE *out, const struct debts *debts)
{
	uint64_t nodes = debts->others;

	for (uint32_t i = 0; i < debts->count; i++)
		nodes += debts->debts[i].nodes;
	write_number(out, "owed_nodes", nodes);
	fputs(",\"owes\":[", out);
	for (uint32_t i = 0; i < debts->count; i++)
		fprintf(out, "%s{\"session\":%u,\"nodes\":%llu}", i > 0 ? "," : "",
			debts->debts[i].session, (unsigned long long)debts->debts[i].nodes);
	fputc(']', out);
}

static void write_client(FILE *out, const struct session *session)
{
	const struct visible *visible = &session->visible;
	const struct visible_counters *counters = &visible->counters;
	const struct wire_session_page *page = session->page;

	fprintf(out, "{\"session\":%u,\"pid\":%d,\"uid\":%u,\"name\":", session->number,
		(int)connection_pid(session->connection),
		(unsigned)connection_uid(session->connection));
	text_write_json(out, session->name);
	write_number(out, "connected_s", (clock_now_ns() - session->born_ns) / NS_PER_S);
	write_number(out, "stores", (uint64_t)__builtin_popcountll(visible->attached));
	write_number(out, "held_nodes", visible->held_count);
	write_number(out, "held_bytes", visible->held_pages * WIRE_PAGE_BYTES);
	write_number(out, "wanted_nodes", visible->count);
	write_number(out, "waiting_nodes", visible_missing_count(visible));
	write_number(out, "refused_nodes", visible->counts[WANT_REFUSED]);
	write_number(out, "prefetch_nodes", session->prefetch_count - session->prefetch_next);
	write_number(out, "sets", counters->sets);
	write_number(out, "hits", counters->hits);
	write_number(out, "misses", counters->misses);
	write_number(out, "fetches", counters->fetches);
	write_number(out, "refused", counters->refused);
	write_number(out, "revocations", counters->revocations);
	write_number(out, "fetched_bytes",
		     atomic_load_explicit(&page->fetched_bytes, memory_order_relaxed));
	write_number(out, "prefetched_bytes",
		     atomic_load_explicit(&page->prefetched_bytes, memory_order_relaxed));
	write_debts(out, &visible->debts);
	fputc('}', out);
}

static void write_sentence(void *arg, const char *sentence)
{
	struct view *view = arg;

	if (view->any_sentence)
		fputc(',', view->out);
	text_write_json(view->out, sentence);
	view->any_sentence = true;
}

static void write_stores(struct view *view)
{
	const char *separator = "";
	uint64_t other_count = 0;
	uint64_t other_bytes = 0;

	fputs(",\"stores\":[", view->out);
	LIST_FOR_EACH (link, &view->server->cache.stores) {
		const struct served *served = LIST_ENTRY(link, struct served, link);

		if (!sees_store(view, served)) {
			other_count++;
			other_bytes += served->arena.used_pages * WIRE_PAGE_BYTES;
			continue;
		}
		fputs(separator, view->out);
		write_store(view->out, served);
		separator = ",";
	}
	fputc(']', view->out);
	write_number(view->out, "other_stores", other_count);
	write_number(view->out, "other_stores_used_bytes", other_bytes);
}

static void write_clients(struct view *view)
{
	const char *separator = "";
	uint64_t other_count = 0;
	uint64_t other_bytes = 0;

	fputs(",\"clients\":[", view->out);
	LIST_FOR_EACH (link, &view->server->sessions) {
		const struct session *session = LIST_ENTRY(link, struct session, link);

		if (session->state != SESSION_READY)
			continue;
		if (!sees_client(view, session)) {
			other_count++;
			other_bytes += session->visible.held_pages * WIRE_PAGE_BYTES;
			continue;
		}
		fputs(separator, view->out);
		write_client(view->out, session);
		separator = ",";
	}
	fputc(']', view->out);
	write_number(view->out, "other_clients", other_count);
	write_number(view->out, "other_clients_held_bytes", other_bytes);
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

static void write_takeover(FILE *out, const struct server *server)
{
	struct takeover_counts counts;

	takeover_count(server->takeover, &counts);
	write_number(out, "takeover_left", counts.left);
	write_number(out, "takeover_verified", counts.verified);
	write_number(out, "takeover_bytes", counts.bytes);
	write_number(out, "takeover_reread", counts.reread);
	write_number(out, "takeover_graces", counts.graces);
}

static void write_accounts(struct view *view)
{
	const char *separator = "";

	fputs(",\"accounts\":[", view->out);
	LIST_FOR_EACH (link, &view->server->accounts.in_order) {
		const struct account *account = LIST_ENTRY(link, struct account, link);

		if (!view->admin && account->policy.uid != view->uid)
			continue;
		fputs(separator, view->out);
		write_account(view->out, account);
		separator = ",";
	}
	fputc(']', view->out);
}

static void write_ends(FILE *out, const struct server *server)
{
	write_number(out, "accepted", server->accepted_count);
	write_number(out, "turned_away", server->refused_count);
	fputs(",\"disconnects\":{", out);
	for (uint32_t i = 0; i < SESSION_END_COUNT_; i++)
		fprintf(out, "%s\"%s\":%llu", i > 0 ? "," : "", status_end_names[i],
			(unsigned long long)server->session_ends[i]);
	fputc('}', out);
}

/* Upper bounds of the buckets in which median and 99th percentile lie. */
static void write_time(FILE *out, const char *key, const struct histogram *histogram)
{
	fprintf(out, "\"%s\":{\"count\":%llu,\"p50_us\":%.0f,\"p99_us\":%.0f}", key,
		(unsigned long long)histogram->count,
		(double)histogram_quantile_ns(histogram, 0.5) / (double)NS_PER_US,
		(double)histogram_quantile_ns(histogram, 0.99) / (double)NS_PER_US);
}

static void write_times(FILE *out, const struct server *server)
{
	const struct fill_times *times = fills_times(server->fills);

	fputs(",\"fill_times\":{", out);
	write_time(out, "fetch", &times->fetch);
	fputc(',', out);
	write_time(out, "prefetch", &times->prefetch);
	fputc(',', out);
	write_time(out, "wait", &times->wait);
	fputc(',', out);
	write_time(out, "wait_behind_prefetch", &times->wait_behind_prefetch);
	fputc('}', out);
}

static void write_status(struct view *view)
{
	struct server *server = view->server;
	FILE *out = view->out;
	uint64_t fetches_queued;
	uint64_t prefetches_queued;
	struct store_counters sum;

	server_sum(server, &sum);
	server_waiting(server, &fetches_queued, &prefetches_queued);
	fprintf(out, "{\"version\":\"%s\",\"administrator\":%s", OOCD_VERSION,
		view->admin ? "true" : "false");
	write_number(out, "uptime_s", (clock_now_ns() - server->start_ns) / NS_PER_S);
	write_number(out, "now_ns", clock_now_ns());
	write_number(out, "cache_bytes", server->cache.budget_bytes);
	write_number(out, "cache_used_bytes", cache_used_bytes(&server->cache));
	write_number(out, "held_and_busy_bytes", server->cache.pinned_bytes);
	write_number(out, "pinned_bytes", residents_bytes(&server->residents));
	fprintf(out, ",\"io\":\"%s\"", fetch_name(server->fetch));
	write_number(out, "queue_depth", server->config.queue_depth);
	write_number(out, "reads_in_flight", fetch_in_flight(server->fetch));
	write_number(out, "fills_in_flight", fills_count(server->fills));
	write_number(out, "fetches_queued", fetches_queued);
	write_number(out, "prefetches_queued", prefetches_queued);
	write_stores(view);
	write_clients(view);
	write_accounts(view);
	write_ends(out, server);
	write_number(out, "store_count", server->cache.store_count);
	write_takeover(out, server);
	fprintf(out, ",\"totals\":{\"device_read_bytes\":%llu",
		(unsigned long long)fetch_read_bytes(server->fetch));
	write_counters(out, &sum);
	fputc('}', out);
	write_times(out, server);
	fputs(",\"degraded\":[", out);
	server_degraded(server, sees_store, write_sentence, view);
	fputs("]}\n", out);
}

char *server_status(struct server *server, const struct session *session)
{
	char *text = NULL;
	size_t text_bytes = 0;
	struct view view = {
		.out = open_memstream(&text, &text_bytes),
		.server = server,
		.admin = server_is_admin(server, session),
		.uid = connection_uid(session->connection),
	};
	bool failed;

	if (!view.out)
		return NULL;
	write_status(&view);
	failed = ferror(view.out) != 0;
	if (fclose(view.out) != 0 || failed) {
		free(text);
		return NULL;
	}
	return text;
}
