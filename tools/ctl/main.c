/* SPDX-License-Identifier: MIT */
#include <getopt.h>
#include <stdio.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/log.h"
#include "tools/ctl/ctl.h"

static const struct {
	const char *name;
	int (*run)(int argc, char **argv);
	const char *summary;
} verbs[] = {
	{ "info", ctl_info, "what a store holds, and what its bytes were spent on" },
	{ "parts", ctl_parts, "the parts of a store" },
	{ "verify", ctl_verify, "read every byte of a store and name what is damaged" },
	{ "export", ctl_export, "write a store's triangles as PLY" },
	{ "trace", ctl_trace, "what a trace of the daemon holds, summed up or event by event" },
	{ "status", ctl_status, "how the daemon is, with its stores and clients" },
	{ "stores", ctl_stores, "the stores that the daemon serves" },
	{ "clients", ctl_clients, "the daemon's clients, and who lives on whose reads" },
	{ "top", ctl_top, "what the daemon is doing, live" },
	{ "nodes", ctl_nodes, "which nodes of a store are in the cache, held by whom, going when" },
	{ "dump", ctl_dump, "the daemon's whole state as JSON, once or at each change" },
	{ "metrics", ctl_metrics, "the daemon's counters as OpenMetrics text" },
	{ "map", ctl_map, "a picture of a store from above, by what is in the cache" },
	{ "prefetch", ctl_prefetch, "bring nodes, or what a camera path shows, into the cache" },
	{ "pin", ctl_pin, "keep nodes in the cache" },
	{ "unpin", ctl_unpin, "let them go again" },
	{ "evict", ctl_evict, "take nodes that nobody holds out of the cache" },
	{ "reload", ctl_reload, "have the daemon read its configuration anew" },
};

static int print_help(void)
{
	puts("Usage: oocctl VERB [OPTION]... [STORE]\n"
	     "Inspects stores, and the daemon that serves them.\n");
	for (size_t i = 0; i < ARRAY_LENGTH(verbs); i++)
		printf("  %-8s %s\n", verbs[i].name, verbs[i].summary);
	puts("\n`oocctl VERB --help` says more.\n"
	     "\n"
	     "Examples:\n"
	     "  oocctl info plant.ooc\n"
	     "  oocctl verify plant.ooc && echo whole\n"
	     "  oocctl export plant.ooc --part 'pump*' -o pumps.ply\n"
	     "  oocctl status --json");
	return CTL_OK;
}

int ctl_usage(const char *verb, const char *what)
{
	log_error("%s: %s: `oocctl %s --help` shows how", verb, what, verb);
	return CTL_USAGE;
}

int ctl_parse_json(int argc, char **argv, const char *help, bool *ret_json)
{
	static const struct option options[] = {
		{ "json", no_argument, NULL, 'j' },
		{ "help", no_argument, NULL, 'h' },
		{ 0 },
	};
	bool json = false;
	int option;

	while ((option = getopt_long(argc, argv, "h", options, NULL)) != -1) {
		if (option == 'h') {
			puts(help);
			return -1;
		}
		if (option != 'j')
			return CTL_USAGE;
		json = true;
	}
	*ret_json = json;
	return CTL_OK;
}

int main(int argc, char **argv)
{
	static char name[32];

	log_init("oocctl", LOG_LEVEL_INFO);
	if (argc < 2) {
		log_error("no verb: `oocctl --help` lists them");
		return CTL_USAGE;
	}
	if (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0)
		return print_help();
	if (strcmp(argv[1], "--version") == 0) {
		puts("oocctl " OOCD_VERSION);
		return CTL_OK;
	}
	for (size_t i = 0; i < ARRAY_LENGTH(verbs); i++) {
		if (strcmp(argv[1], verbs[i].name) != 0)
			continue;
		/* getopt_long() puts it in front of what it says. */
		(void)snprintf(name, sizeof(name), "oocctl: %s", verbs[i].name);
		argv[1] = name;
		return verbs[i].run(argc - 1, argv + 1);
	}
	log_error("%s: no such verb: `oocctl --help` lists them", argv[1]);
	return CTL_USAGE;
}
