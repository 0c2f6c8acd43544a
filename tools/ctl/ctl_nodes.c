/* SPDX-License-Identifier: MIT */
/* Which nodes of a store are in the cache, who holds them, and which goes next. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/log.h"
#include "formats/base/text.h"
#include "tools/ctl/ctl_daemon.h"

#define STATE_COUNT 4

static const char *const state_names[STATE_COUNT] = {
	[OOC_STATE_ABSENT] = "absent",
	[OOC_STATE_BUSY] = "busy",
	[OOC_STATE_READY] = "ready",
	[OOC_STATE_DAMAGED] = "damaged",
};

/** Which nodes are shown, and how. */
struct filter {
	const char *state; /* a state's name, "held" or "free"; NULL: any */
	bool pinned;
	bool prefetched;
	uint32_t payer; /* 0: any */
	bool list;
};

/** What is known of all nodes of a store. */
struct nodes {
	const struct store_node *records;
	struct ooc_node_info *infos;
	uint32_t *places; /* in the order of replacement, from 1; 0: not in it */
	uint64_t count;
};

struct counts {
	uint64_t nodes[STATE_COUNT];
	uint64_t bytes[STATE_COUNT];
};

/* ---- asking ---- */

/* qsort() has no argument for it. */
static const struct ooc_node_info *compared;

static int by_replacement(const void *a, const void *b)
{
	uint64_t left = compared[*(const uint32_t *)a].replaced;
	uint64_t right = compared[*(const uint32_t *)b].replaced;

	return left < right ? -1 : left > right;
}

static int nodes_rank(struct nodes *nodes)
{
	uint32_t *in_order = calloc(nodes->count + 1, sizeof(*in_order));
	size_t count = 0;

	if (!in_order)
		return -1;
	for (uint32_t i = 0; i < nodes->count; i++)
		if (nodes->infos[i].replaced > 0)
			in_order[count++] = i;
	compared = nodes->infos;
	qsort(in_order, count, sizeof(*in_order), by_replacement);
	for (uint32_t i = 0; i < count; i++)
		nodes->places[in_order[i]] = i + 1;
	free(in_order);
	return 0;
}

static void nodes_done(struct nodes *nodes)
{
	free(nodes->infos);
	free(nodes->places);
}

/* Returns: CTL_OK, or CTL_FAILED, said.  Ends with nodes_done(). */
static int nodes_ask(const struct ctl_request *request, struct ooc_store *store, struct nodes *ret)
{
	uint64_t count = ooc_node_count(store);

	*ret = (struct nodes){
		.records = ooc_nodes(store),
		/* Room for a whole answer behind the last node. */
		.infos = calloc(count + OOC_INSPECT_COUNT_MAX, sizeof(*ret->infos)),
		.places = calloc(count + 1, sizeof(*ret->places)),
		.count = count,
	};
	if (!ret->infos || !ret->places)
		goto no_memory;
	for (uint64_t first = 0; first < count; first += OOC_INSPECT_COUNT_MAX) {
		if (ooc_inspect(store, (uint32_t)first, &ret->infos[first]) < 0) {
			log_error("the daemon does not tell of its nodes: %s",
				  ooc_error_text(request->client));
			return CTL_FAILED;
		}
	}
	if (nodes_rank(ret) == 0)
		return CTL_OK;
no_memory:
	log_error("no memory for %" PRIu64 " nodes", count);
	return CTL_FAILED;
}

/* ---- showing ---- */

static bool state_passes(const char *wanted, const struct ooc_node_info *info)
{
	if (strcmp(wanted, "held") == 0)
		return info->holds > 0;
	if (strcmp(wanted, "free") == 0)
		return info->state == OOC_STATE_READY && info->holds == 0;
	return strcmp(wanted, state_names[info->state]) == 0;
}

static bool passes(const struct filter *filter, const struct ooc_node_info *info)
{
	return (!filter->state || state_passes(filter->state, info)) &&
	       (!filter->pinned || info->pinned) &&
	       (!filter->prefetched || info->unused_prefetch) &&
	       (filter->payer == 0 || info->payer == filter->payer);
}

static void print_json_node(const struct nodes *nodes, uint64_t index, bool first)
{
	const struct store_node *node = &nodes->records[index];
	const struct ooc_node_info *info = &nodes->infos[index];

	printf("%s\n    {\"node\": %" PRIu64 ", \"state\": \"%s\", \"level\": %u, \"leaf\": %s, "
	       "\"triangles\": %u, \"bytes\": %u, \"holds\": %u, \"payer\": %u, \"place\": ",
	       first ? "" : ",", index, state_names[info->state], node->level,
	       node->child_count == 0 ? "true" : "false", node->triangle_count, node->payload_bytes,
	       info->holds, info->payer);
	if (nodes->places[index] > 0)
		printf("%u", nodes->places[index]);
	else
		fputs("null", stdout);
	if (info->age_s >= 0)
		printf(", \"age_s\": %.1f", info->age_s);
	else
		fputs(", \"age_s\": null", stdout);
	printf(", \"pinned\": %s, \"unused_prefetch\": %s}", info->pinned ? "true" : "false",
	       info->unused_prefetch ? "true" : "false");
}

/* A number, or "-" for what there is not. */
static void print_cell(bool is, double number, int width, int decimals)
{
	if (is)
		printf(" %*.*f", width, decimals, number);
	else
		printf(" %*s", width, "-");
}

static void print_row(const struct nodes *nodes, uint64_t index)
{
	const struct store_node *node = &nodes->records[index];
	const struct ooc_node_info *info = &nodes->infos[index];

	printf("%10" PRIu64 " %-8s %5u %12u %12u", index, state_names[info->state], node->level,
	       node->triangle_count, node->payload_bytes);
	print_cell(info->holds > 0, info->holds, 6, 0);
	print_cell(info->age_s >= 0, info->age_s, 9, 1);
	print_cell(nodes->places[index] > 0, nodes->places[index], 9, 0);
	print_cell(info->payer > 0, info->payer, 6, 0);
	printf("%s%s\n", info->pinned ? " pinned" : "", info->unused_prefetch ? " prefetched" : "");
}

static void print_counts(bool json, const struct counts *counts)
{
	for (unsigned i = 0; i < STATE_COUNT; i++) {
		char size[TEXT_SIZE_BYTES];

		if (json)
			printf("%s\"%s\": {\"nodes\": %" PRIu64 ", \"bytes\": %" PRIu64 "}",
			       i == 0 ? "" : ", ", state_names[i], counts->nodes[i],
			       counts->bytes[i]);
		else
			printf("%-8s %10" PRIu64 " nodes %12s\n", state_names[i], counts->nodes[i],
			       text_from_size(counts->bytes[i], size));
	}
}

/* Nodes that have something to draw; the others are never anywhere, and programs may want them. */
static void print_nodes(bool json, const struct filter *filter, const struct nodes *nodes)
{
	bool first = true;
	struct counts counts = { 0 };

	if (json)
		fputs("{\n  \"nodes\": [", stdout);
	else if (!filter->list)
		printf("%10s %-8s %5s %12s %12s %6s %9s %9s %6s\n", "node", "state", "level",
		       "triangles", "bytes", "holds", "age s", "place", "payer");
	for (uint64_t i = 0; i < nodes->count; i++) {
		const struct ooc_node_info *info = &nodes->infos[i];
		bool drawn = nodes->records[i].payload_id != 0;

		if (!passes(filter, info))
			continue;
		if (json)
			print_json_node(nodes, i, first);
		else if (filter->list && drawn)
			printf("%" PRIu64 "\n", i);
		else if (drawn)
			print_row(nodes, i);
		first = false;
		counts.nodes[info->state] += drawn;
		counts.bytes[info->state] += nodes->records[i].payload_bytes;
	}
	if (filter->list)
		return;
	fputs(json ? "],\n  \"counts\": {" : "\n", stdout);
	print_counts(json, &counts);
	if (json)
		puts("}\n}");
}

/* ---- the verb ---- */

static bool state_is_known(const char *state)
{
	for (unsigned i = 0; i < STATE_COUNT; i++)
		if (strcmp(state, state_names[i]) == 0)
			return true;
	return strcmp(state, "held") == 0 || strcmp(state, "free") == 0;
}

static int parse(int argc, char **argv, struct ctl_request *request, struct filter *ret)
{
	static const struct option options[] = {
		{ "state", required_argument, NULL, 't' },
		{ "pinned", no_argument, NULL, 'p' },
		{ "prefetched", no_argument, NULL, 'f' },
		{ "payer", required_argument, NULL, 'y' },
		{ "list", no_argument, NULL, 'l' },
		CTL_COMMON_OPTIONS,
		{ 0 },
	};
	uint64_t payer = 0;
	int option;

	while ((option = getopt_long(argc, argv, "h", options, NULL)) != -1) {
		int status = CTL_OK;

		if (option == 't' && state_is_known(optarg))
			ret->state = optarg;
		else if (option == 't')
			return ctl_usage(request->verb, "--state wants absent, busy, ready, held, "
							"free or damaged");
		else if (option == 'p')
			ret->pinned = true;
		else if (option == 'f')
			ret->prefetched = true;
		else if (option == 'l')
			ret->list = true;
		else if (option != 'y')
			status = ctl_common_option(request, option);
		else if (text_to_u64(optarg, &payer) < 0 || payer == 0 || payer > UINT32_MAX)
			return ctl_usage(request->verb, "--payer wants a session's number");
		if (status != CTL_OK)
			return status;
	}
	ret->payer = (uint32_t)payer;
	if (argc - optind != 1)
		return ctl_usage(request->verb, "wants one store");
	if (ret->list && request->json)
		return ctl_usage(request->verb, "--list and --json are two forms");
	return CTL_OK;
}

int ctl_nodes(int argc, char **argv)
{
	struct ctl_request request = {
		.verb = "nodes",
		.help = "Usage: oocctl nodes STORE [--state S] [--pinned] [--prefetched] [--payer N]\n"
			"                    [--list | --json] [--socket S]\n"
			"Says of each node of a store that has something to draw whether the daemon has it in\n"
			"its cache, how many hold it, since when it is there (or, absent, since when it is\n"
			"gone), its place in the order of replacement, and for which session it was read.\n"
			"\n"
			"      --state S       only absent, busy, ready, held, free or damaged ones; ready is\n"
			"                      held or free\n"
			"      --pinned        only pinned ones\n"
			"      --prefetched    only those that were prefetched and never used\n"
			"      --payer N       only those that session N had read\n"
			"      --list          node numbers alone, for `oocctl pin --nodes -`\n"
			"      --json          one object: nodes, and counts by state\n" CTL_COMMON_HELP
			"\n\n"
			"Examples:\n"
			"  oocctl nodes plant.ooc | tail -4\n"
			"  oocctl nodes plant.ooc --state free --json | jq '.nodes | min_by(.place)'",
	};
	struct filter filter = { 0 };
	struct nodes nodes = { 0 };
	struct ooc_store *store;
	int status = parse(argc, argv, &request, &filter);

	if (status != CTL_OK)
		return status < 0 ? CTL_OK : status;
	if (ctl_connect_store(&request, argv[optind], &store) != CTL_OK)
		return CTL_FAILED;
	status = nodes_ask(&request, store, &nodes);
	if (status == CTL_OK)
		print_nodes(request.json, &filter, &nodes);
	nodes_done(&nodes);
	ooc_disconnect(request.client);
	return status;
}
