/* SPDX-License-Identifier: MIT */
/*
 * What the daemon says of itself.  Its words are JSON and belong to it: programs get them as they
 * are, people get tables of what is known here, and a key that is missing shows as "-".
 */
#include <getopt.h>
#include <inttypes.h>
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/log.h"
#include "formats/base/text.h"
#include "libclient/ooc/client.h"
#include "libclient/wire.h"
#include "tools/ctl/ctl.h"

#define SOCKET_PATH_BYTES 256
#define STATE_COUNT       4

/** The options that these verbs have in common. */
struct request {
	const char *verb;
	const char *help;
	const char *socket_path;
	const char *store_path; /* for nodes */
	bool wants_store;
	bool json;
};

/* Returns: CTL_OK to go on, -1 after --help, or CTL_USAGE. */
static int parse(int argc, char **argv, struct request *request)
{
	static const struct option options[] = {
		{ "json", no_argument, NULL, 'j' },
		{ "socket", required_argument, NULL, 's' },
		{ "help", no_argument, NULL, 'h' },
		{ 0 },
	};
	int option;

	while ((option = getopt_long(argc, argv, "h", options, NULL)) != -1) {
		switch (option) {
		case 'j':
			request->json = true;
			break;
		case 's':
			request->socket_path = optarg;
			break;
		case 'h':
			puts(request->help);
			return -1;
		default:
			return CTL_USAGE;
		}
	}
	if (argc - optind != (request->wants_store ? 1 : 0))
		return ctl_usage(request->verb,
				 request->wants_store ? "wants one store" : "wants no argument");
	if (request->wants_store)
		request->store_path = argv[optind];
	return CTL_OK;
}

/* Asking how the daemon is must not start one: the path is looked up here and given. */
static struct ooc_client *connect_client(const struct request *request)
{
	char path[SOCKET_PATH_BYTES];
	struct ooc_client *client;

	if (wire_socket_path(request->socket_path, path, sizeof(path)) < 0) {
		log_error("the path of the daemon's socket is too long");
		return NULL;
	}
	if (ooc_connect(path, "oocctl", &client) < 0) {
		log_error("%s: is `oocd` running? `oocctl %s --help` shows how to name its socket",
			  ooc_error_text(NULL), request->verb);
		return NULL;
	}
	return client;
}

static int fetch_status(const struct request *request, char **ret)
{
	struct ooc_client *client = connect_client(request);
	int r;

	if (!client)
		return CTL_FAILED;
	r = ooc_status(client, ret);
	if (r < 0)
		log_error("the daemon does not say how it is: %s", ooc_error_text(client));
	ooc_disconnect(client);
	return r < 0 ? CTL_FAILED : CTL_OK;
}

/* The status as a tree.  The caller's, ended with json_decref(); NULL: said why. */
static json_t *parse_status(const char *text)
{
	json_error_t error;
	json_t *status = json_loads(text, 0, &error);

	if (!json_is_object(status)) {
		log_error("the daemon's status is no JSON: line %d: %s", error.line, error.text);
		json_decref(status);
		return NULL;
	}
	return status;
}

/* ---- cells of tables ---- */

static void print_number(const json_t *object, const char *key, int width)
{
	const json_t *value = json_object_get(object, key);

	if (json_is_number(value))
		printf(" %*.0f", width, json_number_value(value));
	else
		printf(" %*s", width, "-");
}

static void print_size(const json_t *object, const char *key, int width)
{
	const json_t *value = json_object_get(object, key);
	char size[TEXT_SIZE_BYTES];

	if (json_is_number(value))
		printf(" %*s", width, text_from_size((uint64_t)json_number_value(value), size));
	else
		printf(" %*s", width, "-");
}

static const char *text_of(const json_t *object, const char *key)
{
	const char *text = json_string_value(json_object_get(object, key));

	return text ? text : "-";
}

/* requests = hits + misses; both are work that clients saw, prefetches are not. */
static void print_hit_ratio(const json_t *store, int width)
{
	double hits = json_number_value(json_object_get(store, "hits"));
	double misses = json_number_value(json_object_get(store, "misses"));

	if (hits + misses > 0)
		printf(" %*.1f%%", width - 1, 100 * hits / (hits + misses));
	else
		printf(" %*s", width, "-");
}

static void print_stores(const json_t *stores)
{
	printf("%10s %10s %11s %11s %11s %7s %9s %9s %9s %11s %6s  %s\n", "nodes", "ready", "arena",
	       "used", "held", "hits", "fetched", "prefetch", "evicted", "read", "errors", "store");
	for (size_t i = 0; i < json_array_size(stores); i++) {
		const json_t *store = json_array_get(stores, i);

		print_number(store, "nodes", 9);
		print_number(store, "ready_nodes", 10);
		print_size(store, "arena_bytes", 11);
		print_size(store, "used_bytes", 11);
		print_size(store, "held_bytes", 11);
		print_hit_ratio(store, 7);
		print_number(store, "fetches", 9);
		print_number(store, "prefetches", 9);
		print_number(store, "evictions", 9);
		print_size(store, "read_bytes", 11);
		print_number(store, "errors", 6);
		printf("  %s\n", text_of(store, "path"));
	}
}

static void print_clients(const json_t *clients)
{
	printf("%8s %6s %10s %11s  %s\n", "pid", "uid", "held nodes", "held", "client");
	for (size_t i = 0; i < json_array_size(clients); i++) {
		const json_t *client = json_array_get(clients, i);

		print_number(client, "pid", 7);
		print_number(client, "uid", 6);
		print_number(client, "held_nodes", 10);
		print_size(client, "held_bytes", 11);
		printf("  %s\n", text_of(client, "name"));
	}
}

static void print_uptime(const json_t *status)
{
	uint64_t seconds = (uint64_t)json_number_value(json_object_get(status, "uptime_s"));

	printf("oocd %s, up for ", text_of(status, "version"));
	if (seconds >= 86400)
		printf("%" PRIu64 " d ", seconds / 86400);
	printf("%" PRIu64 ":%02" PRIu64 ":%02" PRIu64 " h\n", seconds / 3600 % 24,
	       seconds / 60 % 60, seconds % 60);
}

static void print_cache(const json_t *status)
{
	fputs("cache", stdout);
	print_size(status, "cache_used_bytes", 0);
	fputs(" of", stdout);
	print_size(status, "cache_bytes", 0);
	putchar('\n');
}

static void print_status(const json_t *status)
{
	const json_t *degraded = json_object_get(status, "degraded");

	print_uptime(status);
	print_cache(status);
	for (size_t i = 0; i < json_array_size(degraded); i++) {
		const char *loss = json_string_value(json_array_get(degraded, i));

		printf("degraded: %s\n", loss ? loss : "-");
	}
	putchar('\n');
	print_stores(json_object_get(status, "stores"));
	putchar('\n');
	print_clients(json_object_get(status, "clients"));
}

/* ---- verbs ---- */

static void print_json(const json_t *value)
{
	(void)json_dumpf(value, stdout, JSON_INDENT(2));
	putchar('\n');
}

/* part:  the key to print of the status; NULL: all of it. */
static int show_status(const struct request *request, const char *part,
		       void (*print)(const json_t *value))
{
	const json_t *value;
	json_t *status;
	char *text;

	if (fetch_status(request, &text) != CTL_OK)
		return CTL_FAILED;
	status = parse_status(text);
	free(text);
	if (!status)
		return CTL_FAILED;
	value = part ? json_object_get(status, part) : status;
	if (request->json && value)
		print_json(value);
	else if (!request->json)
		print(value);
	json_decref(status);
	return CTL_OK;
}

int ctl_status(int argc, char **argv)
{
	struct request request = {
		.verb = "status",
		.help = "Usage: oocctl status [--json] [--socket S]\n"
			"Says how the daemon is: its stores, its clients, and what it does without.\n"
			"\n"
			"      --json       the daemon's own words: one JSON object\n"
			"      --socket S   the daemon's socket; else $OOCD_SOCKET, the system's, or the user's\n"
			"      --help       this text\n"
			"\n"
			"Example:\n"
			"  oocctl status --json | jq '.stores[] | .hits / (.hits + .misses)'",
	};
	int status = parse(argc, argv, &request);

	if (status != CTL_OK)
		return status < 0 ? CTL_OK : status;
	return show_status(&request, NULL, print_status);
}

int ctl_stores(int argc, char **argv)
{
	struct request request = {
		.verb = "stores",
		.help = "Usage: oocctl stores [--json] [--socket S]\n"
			"Lists the stores that the daemon serves.\n"
			"\n"
			"      --json       an array of objects in place of a table\n"
			"      --socket S   the daemon's socket; else $OOCD_SOCKET, the system's, or the user's\n"
			"      --help       this text",
	};
	int status = parse(argc, argv, &request);

	if (status != CTL_OK)
		return status < 0 ? CTL_OK : status;
	return show_status(&request, "stores", print_stores);
}

static const char *const state_names[STATE_COUNT] = {
	[OOC_STATE_ABSENT] = "absent",
	[OOC_STATE_BUSY] = "busy",
	[OOC_STATE_READY] = "ready",
	[OOC_STATE_DAMAGED] = "damaged",
};

static void print_json_node(const struct store_node *node, uint64_t index, enum ooc_state state)
{
	printf("%s\n    {\"node\": %" PRIu64 ", \"state\": \"%s\", \"level\": %u, \"leaf\": %s, "
	       "\"triangles\": %u, \"bytes\": %u}",
	       index == 0 ? "" : ",", index, state_names[state], node->level,
	       node->child_count == 0 ? "true" : "false", node->triangle_count,
	       node->payload_bytes);
}

static void print_counts(const struct request *request, const uint64_t counts[STATE_COUNT],
			 const uint64_t bytes[STATE_COUNT])
{
	for (unsigned i = 0; i < STATE_COUNT; i++) {
		char size[TEXT_SIZE_BYTES];

		if (request->json)
			printf("%s\"%s\": {\"nodes\": %" PRIu64 ", \"bytes\": %" PRIu64 "}",
			       i == 0 ? "" : ", ", state_names[i], counts[i], bytes[i]);
		else
			printf("%-8s %10" PRIu64 " nodes %12s\n", state_names[i], counts[i],
			       text_from_size(bytes[i], size));
	}
}

/* Nodes that have something to draw; the others are never anywhere. */
static void print_nodes(const struct request *request, const struct ooc_store *store)
{
	const struct store_node *nodes = ooc_nodes(store);
	uint64_t counts[STATE_COUNT] = { 0 };
	uint64_t bytes[STATE_COUNT] = { 0 };

	if (request->json)
		fputs("{\n  \"nodes\": [", stdout);
	else
		printf("%10s %-8s %5s %12s %12s\n", "node", "state", "level", "triangles", "bytes");
	for (uint64_t i = 0; i < ooc_node_count(store); i++) {
		enum ooc_state state = ooc_node_state(store, (uint32_t)i);

		if (request->json)
			print_json_node(&nodes[i], i, state);
		if (nodes[i].payload_id == 0)
			continue;
		if (!request->json)
			printf("%10" PRIu64 " %-8s %5u %12u %12u\n", i, state_names[state],
			       nodes[i].level, nodes[i].triangle_count, nodes[i].payload_bytes);
		counts[state]++;
		bytes[state] += nodes[i].payload_bytes;
	}
	fputs(request->json ? "],\n  \"counts\": {" : "\n", stdout);
	print_counts(request, counts, bytes);
	if (request->json)
		puts("}\n}");
}

int ctl_nodes(int argc, char **argv)
{
	struct request request = {
		.verb = "nodes",
		.help = "Usage: oocctl nodes STORE [--json] [--socket S]\n"
			"Says of each node of a store that has something to draw whether the daemon has it\n"
			"in its cache, and counts them.\n"
			"\n"
			"      --json       one object: nodes, and counts by state\n"
			"      --socket S   the daemon's socket; else $OOCD_SOCKET, the system's, or the user's\n"
			"      --help       this text\n"
			"\n"
			"Example:\n"
			"  oocctl nodes plant.ooc | tail -4",
		.wants_store = true,
	};
	int status = parse(argc, argv, &request);
	struct ooc_client *client;
	struct ooc_store *store;

	if (status != CTL_OK)
		return status < 0 ? CTL_OK : status;
	client = connect_client(&request);
	if (!client)
		return CTL_FAILED;
	status = CTL_OK;
	if (ooc_open(client, request.store_path, &store) < 0) {
		log_error("%s: %s", request.store_path, ooc_error_text(client));
		status = CTL_FAILED;
	} else {
		print_nodes(&request, store);
	}
	ooc_disconnect(client);
	return status;
}
