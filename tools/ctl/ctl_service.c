/* SPDX-License-Identifier: MIT */
/* What the daemon says of itself, of its stores and of its clients. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "formats/base/bytes.h"
#include "formats/base/log.h"
#include "tools/ctl/ctl_daemon.h"

static void print_uptime(const json_t *status)
{
	uint64_t seconds = (uint64_t)ctl_number(status, "uptime_s");

	printf("oocd %s, up for ", ctl_text(status, "version"));
	if (seconds >= 86400)
		printf("%" PRIu64 " d ", seconds / 86400);
	printf("%" PRIu64 ":%02" PRIu64 ":%02" PRIu64 " h\n", seconds / 3600 % 24,
	       seconds / 60 % 60, seconds % 60);
}

static void print_cache(const json_t *status)
{
	fputs("cache", stdout);
	ctl_print_size(status, "cache_used_bytes", 0);
	fputs(" of", stdout);
	ctl_print_size(status, "cache_bytes", 0);
	fputs(", pinned", stdout);
	ctl_print_size(status, "pinned_bytes", 0);
	putchar('\n');
}

/* How well prefetching and replacement do, as far as there is something to say. */
static void print_quality(const json_t *status)
{
	const json_t *totals = json_object_get(status, "totals");

	fputs("wanted nodes that were there", stdout);
	ctl_print_share(ctl_number(totals, "hits"), ctl_number(totals, "misses"), 0);
	fputs("; prefetched ones that were used", stdout);
	ctl_print_share(ctl_number(totals, "prefetch_used"), ctl_number(totals, "prefetch_wasted"),
			0);
	fputs("; evictions regretted", stdout);
	ctl_print_share(ctl_number(totals, "regrets"),
			ctl_number(totals, "evictions") - ctl_number(totals, "regrets"), 0);
	putchar('\n');
}

/* What is not shown to this user. */
static void print_others(const json_t *status)
{
	double clients = ctl_number(status, "other_clients");
	double stores = ctl_number(status, "other_stores");

	if (clients + stores > 0)
		printf("and %.0f clients of other users, %.0f stores that they have open: "
		       "administrators see them\n",
		       clients, stores);
}

static void print_status(const json_t *status)
{
	const json_t *degraded = json_object_get(status, "degraded");

	print_uptime(status);
	print_cache(status);
	print_quality(status);
	for (size_t i = 0; i < json_array_size(degraded); i++) {
		const char *loss = json_string_value(json_array_get(degraded, i));

		printf("degraded: %s\n", loss ? loss : "-");
	}
	putchar('\n');
	ctl_print_stores(json_object_get(status, "stores"));
	putchar('\n');
	ctl_print_clients(json_object_get(status, "clients"));
	print_others(status);
}

static void print_clients(const json_t *clients)
{
	ctl_print_clients(clients);
	ctl_print_debts(clients);
}

/* part:  the key to print of the status; NULL: all of it. */
static int show(struct ctl_request *request, const char *part, void (*print)(const json_t *value))
{
	const json_t *value;
	json_t *status;

	if (ctl_connect(request) != CTL_OK)
		return CTL_FAILED;
	status = ctl_status_tree(request);
	ooc_disconnect(request->client);
	if (!status)
		return CTL_FAILED;
	value = part ? json_object_get(status, part) : status;
	if (request->json && value)
		ctl_print_json(value);
	else if (!request->json)
		print(value);
	json_decref(status);
	return CTL_OK;
}

int ctl_status(int argc, char **argv)
{
	struct ctl_request request = {
		.verb = "status",
		.help = "Usage: oocctl status [--json] [--socket S]\n"
			"Says how the daemon is: its stores, its clients, and what it does without, with what\n"
			"to do about it.  Who is no administrator sees his own clients and their stores.\n"
			"\n"
			"      --json          the daemon's own words: one JSON object\n" CTL_COMMON_HELP
			"\n\n"
			"Example:\n"
			"  oocctl status --json | jq '.stores[] | .hits / (.hits + .misses)'",
	};
	int status = ctl_parse_common(argc, argv, &request, 0);

	if (status != CTL_OK)
		return status < 0 ? CTL_OK : status;
	return show(&request, NULL, print_status);
}

int ctl_stores(int argc, char **argv)
{
	struct ctl_request request = {
		.verb = "stores",
		.help = "Usage: oocctl stores [--json] [--socket S]\n"
			"Lists the stores that the daemon serves.\n"
			"\n"
			"      --json          an array of objects in place of a table\n" CTL_COMMON_HELP
			"\n\n"
			"Example:\n"
			"  oocctl stores --json | jq '.[].fragmentation'",
	};
	int status = ctl_parse_common(argc, argv, &request, 0);

	if (status != CTL_OK)
		return status < 0 ? CTL_OK : status;
	return show(&request, "stores", ctl_print_stores);
}

int ctl_clients(int argc, char **argv)
{
	struct ctl_request request = {
		.verb = "clients",
		.help = "Usage: oocctl clients [--json] [--socket S]\n"
			"Lists the clients, and who lives on whose reads: a client owes a node to the session\n"
			"whose read had brought it when it was wanted.\n"
			"\n"
			"      --json          an array of objects in place of a table\n" CTL_COMMON_HELP
			"\n\n"
			"Example:\n"
			"  oocctl clients --json | jq '.[] | select(.refused_nodes > 0) | .pid'",
	};
	int status = ctl_parse_common(argc, argv, &request, 0);

	if (status != CTL_OK)
		return status < 0 ? CTL_OK : status;
	return show(&request, "clients", print_clients);
}

int ctl_metrics(int argc, char **argv)
{
	struct ctl_request request = {
		.verb = "metrics",
		.help = "Usage: oocctl metrics [--socket S]\n"
			"Prints the daemon's counters as OpenMetrics text: sums without the name of a store or\n"
			"a user.  oocd.conf(5) says how it writes them to a file or a socket by itself.\n"
			"\n" CTL_COMMON_HELP "\n\n"
			"Example:\n"
			"  oocctl metrics | grep -v '^#'",
	};
	int status = ctl_parse_common(argc, argv, &request, 0);
	char *text;
	int r;

	if (status != CTL_OK)
		return status < 0 ? CTL_OK : status;
	if (ctl_connect(&request) != CTL_OK)
		return CTL_FAILED;
	r = ooc_metrics(request.client, &text);
	if (r < 0)
		log_error("the daemon does not tell its metrics: %s",
			  ooc_error_text(request.client));
	ooc_disconnect(request.client);
	if (r < 0)
		return CTL_FAILED;
	fputs(text, stdout);
	free(text);
	return CTL_OK;
}
