/* SPDX-License-Identifier: MIT */
/* What a trace holds: summed up, or event by event. */
#include <errno.h>
#include <getopt.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/log.h"
#include "formats/base/text.h"
#include "formats/trace/trace_reader.h"
#include "tools/ctl/ctl.h"

/** An eviction is regretted when the node is read again within so many sets. */
#define REGRET_SETS 100u

static const char help[] = "Usage: oocctl trace [--json | --events] FILE\n"
			   "Sums up a trace that `oocd --trace FILE` has written.\n"
			   "\n"
			   "  --json    as one JSON object\n"
			   "  --events  every event as a line: seconds, kind, session, node\n"
			   "\n"
			   "Examples:\n"
			   "  oocctl trace walk.trace\n"
			   "  oocctl trace --events walk.trace | grep EVICT";

/* What is known of a node while the trace is read. */
struct node_past {
	uint64_t evicted_at; /* 1 + the set after which it was evicted last; 0: never */
	bool was_wanted;
	bool was_read;
	bool is_prefetched; /* it came ahead of need, and nobody has wanted it yet */
};

struct sums {
	uint64_t counts[TRACE_KIND_COUNT_];
	uint64_t event_count;
	uint64_t event_bytes;
	double seconds;
	uint64_t wanted_count; /* different nodes */
	uint64_t wanted_bytes;
	uint64_t read_bytes;
	uint64_t compulsory_bytes; /* of the first read of each node */
	uint64_t regret_count;
	uint64_t regret_bytes;
	uint64_t prefetch_used_count;
	uint64_t prefetch_wasted_count;
	struct node_past *nodes;
	uint32_t node_room;
};

/* ---- sums ---- */

static int reserve(struct sums *sums, uint32_t entry)
{
	struct node_past *grown;
	uint32_t room;

	if (entry < sums->node_room)
		return 0;
	room = entry + entry / 2 + 1024;
	grown = reallocarray(sums->nodes, room, sizeof(*grown));
	if (!grown)
		return -ENOMEM;
	memset(grown + sums->node_room, 0, (room - sums->node_room) * sizeof(*grown));
	sums->nodes = grown;
	sums->node_room = room;
	return 0;
}

static void sum_want(struct sums *sums, struct node_past *past, const struct trace_entry *entry)
{
	sums->prefetch_used_count += past->is_prefetched;
	past->is_prefetched = false;
	if (past->was_wanted)
		return;
	past->was_wanted = true;
	sums->wanted_count++;
	sums->wanted_bytes += entry->bytes;
}

static void sum_read(struct sums *sums, struct node_past *past, const struct trace_entry *entry)
{
	sums->read_bytes += entry->bytes;
	if (!past->was_read)
		sums->compulsory_bytes += entry->bytes;
	past->was_read = true;
	if (past->evicted_at == 0 || sums->counts[TRACE_SET] - (past->evicted_at - 1) > REGRET_SETS)
		return;
	sums->regret_count++;
	sums->regret_bytes += entry->bytes;
}

static void sum_evict(struct sums *sums, struct node_past *past)
{
	sums->prefetch_wasted_count += past->is_prefetched;
	past->is_prefetched = false;
	past->evicted_at = sums->counts[TRACE_SET] + 1;
}

static int sum(struct sums *sums, const struct trace_reader *reader,
	       const struct trace_event *event)
{
	const struct trace_entry *entry;
	struct node_past *past;

	sums->counts[event->kind]++;
	sums->event_count++;
	sums->seconds = (double)event->ticks / TRACE_TICKS_PER_S;
	if (event->kind == TRACE_NODE)
		return reserve(sums, event->entry);
	if (!trace_kind_has_entry(event->kind))
		return 0;
	entry = trace_reader_entry(reader, event->entry);
	past = &sums->nodes[event->entry];
	if (event->kind == TRACE_HIT || event->kind == TRACE_MISS)
		sum_want(sums, past, entry);
	else if (event->kind == TRACE_PREFETCH)
		past->is_prefetched = true;
	else if (event->kind == TRACE_READY)
		sum_read(sums, past, entry);
	else if (event->kind == TRACE_EVICT)
		sum_evict(sums, past);
	else if (event->kind == TRACE_ADOPT)
		past->was_read = true;
	return 0;
}

/* ---- what is shown ---- */

static void show_event(const struct trace_reader *reader, const struct trace_event *event)
{
	printf("%.4f %s", (double)event->ticks / TRACE_TICKS_PER_S, trace_kind_name(event->kind));
	if (trace_kind_has_session(event->kind))
		printf(" session %" PRIu32, event->session);
	if (event->kind == TRACE_SET)
		printf(" of %" PRIu32, event->count);
	if (trace_kind_has_entry(event->kind) || event->kind == TRACE_NODE) {
		const struct trace_entry *entry = trace_reader_entry(reader, event->entry);

		printf(" store %" PRIu32 " node %" PRIu32, entry->store, entry->node);
		if (event->kind == TRACE_NODE)
			printf(" %" PRIu32 " pages %" PRIu32 " bytes", entry->pages, entry->bytes);
	}
	if (event->kind == TRACE_OPEN || event->kind == TRACE_CLOSE)
		printf(" store %" PRIu32, event->store);
	if (event->kind == TRACE_OPEN)
		printf(" %s", trace_reader_store(reader, event->store)->path);
	putchar('\n');
}

static double percent(uint64_t part, uint64_t whole)
{
	return whole > 0 ? 100.0 * (double)part / (double)whole : 0.0;
}

static void show_sums(const struct sums *sums, const struct trace_reader *reader)
{
	const struct trace_header *header = trace_reader_header(reader);
	uint64_t requests = sums->counts[TRACE_HIT] + sums->counts[TRACE_MISS];
	char a[TEXT_SIZE_BYTES];
	char b[TEXT_SIZE_BYTES];

	printf("lasts       %.1f s, %" PRIu64 " events of %.2f bytes%s\n", sums->seconds,
	       sums->event_count,
	       sums->event_count > 0 ? (double)sums->event_bytes / (double)sums->event_count : 0.0,
	       trace_reader_was_cut(reader) ? "; it was cut" : "");
	printf("cache       %s, %s\n", text_from_size(header->cache_bytes, a), header->replacement);
	for (uint32_t i = 0; i < trace_reader_store_count(reader); i++)
		printf("store %-5" PRIu32 " %s\n", i, trace_reader_store(reader, i)->path);
	printf("clients     %" PRIu64 ", %" PRIu64 " sets\n", sums->counts[TRACE_BEGIN],
	       sums->counts[TRACE_SET]);
	printf("wanted      %" PRIu64 " nodes, %s\n", sums->wanted_count,
	       text_from_size(sums->wanted_bytes, a));
	printf("requests    %" PRIu64 ", %.1f%% hits, %" PRIu64 " refusals\n", requests,
	       percent(sums->counts[TRACE_HIT], requests), sums->counts[TRACE_REFUSE]);
	printf("read        %s, compulsory %s\n", text_from_size(sums->read_bytes, a),
	       text_from_size(sums->compulsory_bytes, b));
	if (sums->counts[TRACE_ADOPT] > 0)
		printf("adopted     %" PRIu64 " nodes of a daemon before\n",
		       sums->counts[TRACE_ADOPT]);
	printf("evictions   %" PRIu64 ", %" PRIu64 " regretted within %u sets (%s read again)\n",
	       sums->counts[TRACE_EVICT], sums->regret_count, REGRET_SETS,
	       text_from_size(sums->regret_bytes, a));
	printf("prefetches  %" PRIu64 ", %" PRIu64 " used, %" PRIu64 " wasted\n",
	       sums->counts[TRACE_PREFETCH], sums->prefetch_used_count,
	       sums->prefetch_wasted_count);
	if (sums->counts[TRACE_FAIL] > 0)
		printf("failures    %" PRIu64 "\n", sums->counts[TRACE_FAIL]);
}

static void show_json(const struct sums *sums, const struct trace_reader *reader)
{
	const struct trace_header *header = trace_reader_header(reader);
	const struct {
		const char *key;
		uint64_t value;
	} numbers[] = {
		{ "cache_bytes", header->cache_bytes },
		{ "events", sums->event_count },
		{ "event_bytes", sums->event_bytes },
		{ "clients", sums->counts[TRACE_BEGIN] },
		{ "sets", sums->counts[TRACE_SET] },
		{ "wanted_nodes", sums->wanted_count },
		{ "wanted_bytes", sums->wanted_bytes },
		{ "hits", sums->counts[TRACE_HIT] },
		{ "misses", sums->counts[TRACE_MISS] },
		{ "refusals", sums->counts[TRACE_REFUSE] },
		{ "fetches", sums->counts[TRACE_FETCH] },
		{ "read_bytes", sums->read_bytes },
		{ "compulsory_bytes", sums->compulsory_bytes },
		{ "adopted", sums->counts[TRACE_ADOPT] },
		{ "evictions", sums->counts[TRACE_EVICT] },
		{ "regretted", sums->regret_count },
		{ "regretted_bytes", sums->regret_bytes },
		{ "prefetches", sums->counts[TRACE_PREFETCH] },
		{ "prefetches_used", sums->prefetch_used_count },
		{ "prefetches_wasted", sums->prefetch_wasted_count },
		{ "failures", sums->counts[TRACE_FAIL] },
	};

	printf("{\n  \"replacement\": ");
	text_write_json(stdout, header->replacement);
	printf(",\n  \"seconds\": %.4f,\n  \"cut\": %s", sums->seconds,
	       trace_reader_was_cut(reader) ? "true" : "false");
	for (size_t i = 0; i < ARRAY_LENGTH(numbers); i++)
		printf(",\n  \"%s\": %" PRIu64, numbers[i].key, numbers[i].value);
	puts("\n}");
}

/* ---- the verb ---- */

static int show(const char *path, bool json, bool events)
{
	struct sums sums = { 0 };
	struct trace_reader *reader;
	struct trace_event event;
	struct why why;
	int r = trace_reader_open_path(path, &reader, &why);

	if (r < 0) {
		log_error("%s", why.text);
		return CTL_FAILED;
	}
	while ((r = trace_reader_next(reader, &event, &why)) > 0) {
		if (events)
			show_event(reader, &event);
		else if (sum(&sums, reader, &event) < 0) {
			r = why_errno(&why, -ENOMEM, "a trace");
			break;
		}
	}
	sums.event_bytes = trace_reader_event_bytes(reader);
	if (!events && json)
		show_json(&sums, reader);
	else if (!events)
		show_sums(&sums, reader);
	if (r < 0)
		log_error("%s: %s: what came before is good", path, why.text);
	trace_reader_close(reader);
	free(sums.nodes);
	return r < 0 ? CTL_FAILED : CTL_OK;
}

int ctl_trace(int argc, char **argv)
{
	static const struct option options[] = {
		{ "json", no_argument, NULL, 'j' },
		{ "events", no_argument, NULL, 'e' },
		{ "help", no_argument, NULL, 'h' },
		{ 0 },
	};
	bool events = false;
	bool json = false;
	int option;

	while ((option = getopt_long(argc, argv, "h", options, NULL)) != -1) {
		switch (option) {
		case 'j':
			json = true;
			break;
		case 'e':
			events = true;
			break;
		case 'h':
			puts(help);
			return CTL_OK;
		default:
			return CTL_USAGE;
		}
	}
	if (argc - optind != 1)
		return ctl_usage("trace", "wants one trace");
	if (json && events)
		return ctl_usage("trace", "--json or --events, not both");
	return show(argv[optind], json, events);
}
