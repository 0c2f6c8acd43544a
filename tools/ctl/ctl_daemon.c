/* SPDX-License-Identifier: MIT */
#include "tools/ctl/ctl_daemon.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/log.h"
#include "formats/base/text.h"
#include "libclient/wire.h"

#define SOCKET_PATH_BYTES 256
/* That a command line may name. */
#define NODES_MAX (1u << 26)

/* ---- the command line ---- */

int ctl_common_option(struct ctl_request *request, int option)
{
	switch (option) {
	case 'j':
		request->json = true;
		return CTL_OK;
	case 's':
		request->socket_path = optarg;
		return CTL_OK;
	case 'h':
		puts(request->help);
		return -1;
	default:
		return CTL_USAGE;
	}
}

int ctl_parse_common(int argc, char **argv, struct ctl_request *request, int argument_count)
{
	static const struct option options[] = { CTL_COMMON_OPTIONS, { 0 } };
	int option;

	while ((option = getopt_long(argc, argv, "h", options, NULL)) != -1) {
		int status = ctl_common_option(request, option);

		if (status != CTL_OK)
			return status;
	}
	if (argc - optind != argument_count)
		return ctl_usage(request->verb,
				 argument_count == 1 ? "wants one store" : "wants no argument");
	return CTL_OK;
}

static bool node_from(const char *text, size_t length, uint64_t *ret)
{
	char number[24];

	if (length == 0 || length >= sizeof(number))
		return false;
	memcpy(number, text, length);
	number[length] = '\0';
	return text_to_u64(number, ret) == 0 && *ret < UINT32_MAX;
}

/* "5" or "5-9". */
static bool range_from(const char *word, size_t length, uint64_t *ret_first, uint64_t *ret_last)
{
	const char *dash = memchr(word, '-', length);
	size_t first_length = dash ? (size_t)(dash - word) : length;

	if (!node_from(word, first_length, ret_first))
		return false;
	*ret_last = *ret_first;
	return !dash || (node_from(dash + 1, length - first_length - 1, ret_last) &&
			 *ret_last >= *ret_first);
}

static int nodes_add(struct ctl_nodes *nodes, uint64_t first, uint64_t last)
{
	size_t count = nodes->count + (size_t)(last - first + 1);
	uint32_t *longer;

	if (count > NODES_MAX) {
		log_error("more than %u nodes: leave --nodes out to mean all of a store",
			  NODES_MAX);
		return CTL_USAGE;
	}
	longer = realloc(nodes->nodes, count * sizeof(*longer));
	if (!longer) {
		log_error("no memory for %zu nodes", count);
		return CTL_FAILED;
	}
	nodes->nodes = longer;
	for (uint64_t node = first; node <= last; node++)
		nodes->nodes[nodes->count++] = (uint32_t)node;
	return CTL_OK;
}

static int words_parse(const struct ctl_request *request, const char *text, struct ctl_nodes *nodes)
{
	static const char between[] = ", \t\n";

	for (text += strspn(text, between); *text; text += strspn(text, between)) {
		size_t length = strcspn(text, between);
		uint64_t first;
		uint64_t last;
		int status;

		if (!range_from(text, length, &first, &last)) {
			log_error("%s: %.*s: not a node or a range of nodes, as 7 or 5-9",
				  request->verb, (int)length, text);
			return CTL_USAGE;
		}
		status = nodes_add(nodes, first, last);
		if (status != CTL_OK)
			return status;
		text += length;
	}
	return CTL_OK;
}

int ctl_nodes_parse(const struct ctl_request *request, const char *text, struct ctl_nodes *ret)
{
	struct ctl_nodes nodes = { 0 };
	int status = CTL_OK;
	char *line = NULL;
	size_t line_bytes = 0;

	if (strcmp(text, "-") != 0)
		status = words_parse(request, text, &nodes);
	else
		while (status == CTL_OK && getline(&line, &line_bytes, stdin) >= 0)
			status = words_parse(request, line, &nodes);
	free(line);
	if (status == CTL_OK && nodes.count == 0)
		status = ctl_usage(request->verb, "--nodes names none");
	if (status != CTL_OK) {
		free(nodes.nodes);
		return status;
	}
	*ret = nodes;
	return CTL_OK;
}

bool ctl_seconds_parse(const char *text, double *ret)
{
	return text_to_double(text, ret) == 0 && *ret > 0.0 && *ret <= 1e6;
}

/* ---- the daemon ---- */

/* Asking how the daemon is must not start one: the path is looked up here and given. */
int ctl_connect(struct ctl_request *request)
{
	char path[SOCKET_PATH_BYTES];

	if (wire_socket_path(request->socket_path, path, sizeof(path)) < 0) {
		log_error("the path of the daemon's socket is too long");
		return CTL_FAILED;
	}
	if (ooc_connect(path, "oocctl", &request->client) < 0) {
		log_error("%s: is `oocd` running? `oocctl %s --help` shows how to name its socket",
			  ooc_error_text(NULL), request->verb);
		return CTL_FAILED;
	}
	return CTL_OK;
}

int ctl_connect_store(struct ctl_request *request, const char *path, struct ooc_store **ret)
{
	if (ctl_connect(request) != CTL_OK)
		return CTL_FAILED;
	if (ooc_open(request->client, path, ret) < 0) {
		log_error("%s: %s", path, ooc_error_text(request->client));
		request->client = ooc_disconnect(request->client);
		return CTL_FAILED;
	}
	return CTL_OK;
}

json_t *ctl_status_tree(struct ctl_request *request)
{
	json_error_t error;
	json_t *status;
	char *text;

	if (ooc_status(request->client, &text) < 0) {
		log_error("the daemon does not say how it is: %s", ooc_error_text(request->client));
		return NULL;
	}
	status = json_loads(text, 0, &error);
	free(text);
	if (!json_is_object(status)) {
		log_error("the daemon's status is no JSON: line %d: %s", error.line, error.text);
		json_decref(status);
		return NULL;
	}
	return status;
}

void ctl_print_json(const json_t *value)
{
	(void)json_dumpf(value, stdout, JSON_INDENT(2) | JSON_ENCODE_ANY);
	putchar('\n');
}

/* ---- cells of tables ---- */

double ctl_number(const json_t *object, const char *key)
{
	return json_number_value(json_object_get(object, key));
}

const char *ctl_text(const json_t *object, const char *key)
{
	const char *text = json_string_value(json_object_get(object, key));

	return text ? text : "-";
}

void ctl_print_number(const json_t *object, const char *key, int width)
{
	const json_t *value = json_object_get(object, key);

	if (json_is_number(value))
		printf(" %*.0f", width, json_number_value(value));
	else
		printf(" %*s", width, "-");
}

void ctl_print_size(const json_t *object, const char *key, int width)
{
	const json_t *value = json_object_get(object, key);
	char size[TEXT_SIZE_BYTES];

	if (json_is_number(value))
		printf(" %*s", width, text_from_size((uint64_t)json_number_value(value), size));
	else
		printf(" %*s", width, "-");
}

void ctl_print_share(double part, double rest, int width)
{
	if (part + rest > 0)
		printf(" %*.1f%%", width - 1, 100 * part / (part + rest));
	else
		printf(" %*s", width, "-");
}

void ctl_print_stores(const json_t *stores)
{
	printf("%10s %10s %11s %11s %11s %7s %9s %9s %9s %11s %6s  %s\n", "nodes", "ready", "arena",
	       "used", "held", "hits", "fetched", "prefetch", "evicted", "read", "errors", "store");
	for (size_t i = 0; i < json_array_size(stores); i++) {
		const json_t *store = json_array_get(stores, i);

		ctl_print_number(store, "nodes", 9);
		ctl_print_number(store, "ready_nodes", 10);
		ctl_print_size(store, "arena_bytes", 11);
		ctl_print_size(store, "used_bytes", 11);
		ctl_print_size(store, "held_bytes", 11);
		ctl_print_share(ctl_number(store, "hits"), ctl_number(store, "misses"), 7);
		ctl_print_number(store, "fetches", 9);
		ctl_print_number(store, "prefetches", 9);
		ctl_print_number(store, "evictions", 9);
		ctl_print_size(store, "read_bytes", 11);
		ctl_print_number(store, "errors", 6);
		printf("  %s\n", ctl_text(store, "path"));
	}
}

void ctl_print_clients(const json_t *clients)
{
	printf("%7s %8s %6s %8s %8s %8s %11s %7s %11s %8s  %s\n", "session", "pid", "uid", "wanted",
	       "waiting", "refused", "held", "hits", "fetched", "owed", "client");
	for (size_t i = 0; i < json_array_size(clients); i++) {
		const json_t *client = json_array_get(clients, i);

		ctl_print_number(client, "session", 6);
		ctl_print_number(client, "pid", 8);
		ctl_print_number(client, "uid", 6);
		ctl_print_number(client, "wanted_nodes", 8);
		ctl_print_number(client, "waiting_nodes", 8);
		ctl_print_number(client, "refused_nodes", 8);
		ctl_print_size(client, "held_bytes", 11);
		ctl_print_share(ctl_number(client, "hits"), ctl_number(client, "misses"), 7);
		ctl_print_size(client, "fetched_bytes", 11);
		ctl_print_number(client, "owed_nodes", 8);
		printf("  %s\n", ctl_text(client, "name"));
	}
}

/* The name of a session that is still connected and shown, or "gone". */
static const char *session_name(const json_t *clients, double session)
{
	for (size_t i = 0; i < json_array_size(clients); i++) {
		const json_t *client = json_array_get(clients, i);

		if ((uint64_t)ctl_number(client, "session") == (uint64_t)session)
			return ctl_text(client, "name");
	}
	return "gone";
}

void ctl_print_debts(const json_t *clients)
{
	for (size_t i = 0; i < json_array_size(clients); i++) {
		const json_t *client = json_array_get(clients, i);
		const json_t *owes = json_object_get(client, "owes");

		if (json_array_size(owes) == 0)
			continue;
		printf("session %.0f (%s) owes", ctl_number(client, "session"),
		       ctl_text(client, "name"));
		for (size_t j = 0; j < json_array_size(owes); j++) {
			const json_t *debt = json_array_get(owes, j);
			double payer = ctl_number(debt, "session");

			printf("%s %.0f nodes to session %.0f (%s)", j > 0 ? "," : "",
			       ctl_number(debt, "nodes"), payer, session_name(clients, payer));
		}
		putchar('\n');
	}
}
