/* SPDX-License-Identifier: MIT */
/* Orders to the daemon: evict, pin, unpin, reload. */
#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>

#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "formats/base/log.h"
#include "formats/base/text.h"
#include "tools/ctl/ctl_daemon.h"

/* Between two looks at whether pinned nodes have come. */
#define LOOK_MS 5

/** What an order is about. */
struct target {
	const char *store_path; /* NULL: all */
	const char *nodes_text; /* NULL: all of the store */
	struct ctl_nodes nodes;
	bool all;
	double wait_s; /* for pinned nodes; 0: not at all */
};

/** What was done, over all messages that the order took. */
struct done {
	uint64_t nodes;
	uint64_t bytes;
	uint64_t held;
	uint64_t ready;
};

static int parse_target(int argc, char **argv, struct ctl_request *request, struct target *ret)
{
	static const struct option options[] = {
		{ "nodes", required_argument, NULL, 'n' },
		{ "all", no_argument, NULL, 'a' },
		{ "wait", required_argument, NULL, 'w' },
		CTL_COMMON_OPTIONS,
		{ 0 },
	};
	int option;

	while ((option = getopt_long(argc, argv, "h", options, NULL)) != -1) {
		int status = CTL_OK;

		if (option == 'n')
			ret->nodes_text = optarg;
		else if (option == 'a')
			ret->all = true;
		else if (option != 'w')
			status = ctl_common_option(request, option);
		else if (!ctl_seconds_parse(optarg, &ret->wait_s))
			return ctl_usage(request->verb, "--wait wants seconds, as 2.5");
		if (status != CTL_OK)
			return status;
	}
	if (argc - optind > 1 || (argc - optind == 1) == ret->all)
		return ctl_usage(request->verb, "wants one store, or --all");
	if (ret->all && ret->nodes_text)
		return ctl_usage(request->verb, "--nodes wants a store");
	ret->store_path = argv[optind];
	return ret->nodes_text ? ctl_nodes_parse(request, ret->nodes_text, &ret->nodes) : CTL_OK;
}

static int steer_once(struct ctl_request *request, enum ooc_order order, struct ooc_store *store,
		      const uint32_t *nodes, size_t node_count, struct done *done)
{
	json_t *answer;
	char *text;

	if (ooc_steer(request->client, order, store, nodes, node_count, &text) < 0) {
		log_error("%s: %s", request->verb, ooc_error_text(request->client));
		return CTL_FAILED;
	}
	answer = json_loads(text, 0, NULL);
	free(text);
	done->nodes += (uint64_t)ctl_number(answer, "nodes");
	done->bytes += (uint64_t)ctl_number(answer, "bytes");
	done->held += (uint64_t)ctl_number(answer, "held_nodes");
	done->ready += (uint64_t)ctl_number(answer, "ready_nodes");
	json_decref(answer);
	return CTL_OK;
}

/* As many messages as the nodes need. */
static int steer(struct ctl_request *request, enum ooc_order order, struct ooc_store *store,
		 const struct ctl_nodes *nodes, struct done *done)
{
	size_t sent = 0;
	int status;

	do {
		size_t count = u64_min(nodes->count - sent, OOC_ORDER_NODE_COUNT_MAX);

		status = steer_once(request, order, store,
				    nodes->count > 0 ? &nodes->nodes[sent] : NULL, count, done);
		sent += count;
	} while (status == CTL_OK && sent < nodes->count);
	return status;
}

/* ---- evict and unpin ---- */

static void print_evicted(const struct ctl_request *request, const struct done *done)
{
	char size[TEXT_SIZE_BYTES];

	if (request->json)
		printf("{\"nodes\": %llu, \"bytes\": %llu, \"held_nodes\": %llu}\n",
		       (unsigned long long)done->nodes, (unsigned long long)done->bytes,
		       (unsigned long long)done->held);
	else
		printf("evicted %llu nodes, %s; %llu are held or being read and stay\n",
		       (unsigned long long)done->nodes, text_from_size(done->bytes, size),
		       (unsigned long long)done->held);
}

static void print_pins(const struct ctl_request *request, const struct done *done)
{
	char size[TEXT_SIZE_BYTES];

	if (request->json)
		printf("{\"nodes\": %llu, \"bytes\": %llu, \"ready_nodes\": %llu}\n",
		       (unsigned long long)done->nodes, (unsigned long long)done->bytes,
		       (unsigned long long)done->ready);
	else
		printf("%sned %llu nodes, %s; %llu of them are in the cache\n", request->verb,
		       (unsigned long long)done->nodes, text_from_size(done->bytes, size),
		       (unsigned long long)done->ready);
}

static int order(int argc, char **argv, struct ctl_request *request, enum ooc_order order,
		 void (*print)(const struct ctl_request *request, const struct done *done))
{
	struct target target = { 0 };
	struct ooc_store *store = NULL;
	struct done done = { 0 };
	int status = parse_target(argc, argv, request, &target);

	if (status != CTL_OK)
		return status < 0 ? CTL_OK : status;
	if (target.wait_s > 0)
		status = ctl_usage(request->verb, "there is nothing to --wait for");
	else
		status = target.store_path ? ctl_connect_store(request, target.store_path, &store)
					   : ctl_connect(request);
	if (status == CTL_OK)
		status = steer(request, order, store, &target.nodes, &done);
	if (status == CTL_OK)
		print(request, &done);
	ooc_disconnect(request->client);
	free(target.nodes.nodes);
	return status;
}

int ctl_evict(int argc, char **argv)
{
	struct ctl_request request = {
		.verb = "evict",
		.help = "Usage: oocctl evict STORE|--all [--nodes LIST] [--json] [--socket S]\n"
			"Takes nodes that nobody holds out of the daemon's cache.  For administrators.\n"
			"\n"
			"      --nodes LIST    these alone, as 1,5-9; - reads them from standard input\n"
			"      --all           of every store that is served\n"
			"      --json          one object in place of a line\n" CTL_COMMON_HELP
			"\n\n"
			"Examples:\n"
			"  oocctl evict --all\n"
			"  oocctl evict plant.ooc --nodes 100-199",
	};

	return order(argc, argv, &request, OOC_EVICT, print_evicted);
}

int ctl_unpin(int argc, char **argv)
{
	struct ctl_request request = {
		.verb = "unpin",
		.help = "Usage: oocctl unpin STORE|--all [--nodes LIST] [--json] [--socket S]\n"
			"Lets nodes go again that were pinned.  For administrators.\n"
			"\n"
			"      --nodes LIST    these alone, as 1,5-9; - reads them from standard input\n"
			"      --all           of every store that is served\n"
			"      --json          one object in place of a line\n" CTL_COMMON_HELP
			"\n\n"
			"Example:\n"
			"  oocctl unpin --all",
	};

	return order(argc, argv, &request, OOC_UNPIN, print_pins);
}

/* ---- pin ---- */

static uint64_t count_ready(const struct ooc_store *store, const struct ctl_nodes *nodes)
{
	uint64_t count = nodes->count > 0 ? nodes->count : ooc_node_count(store);
	uint64_t ready = 0;

	for (uint64_t i = 0; i < count; i++) {
		uint32_t node = nodes->count > 0 ? nodes->nodes[i] : (uint32_t)i;

		ready += ooc_node_state(store, node) == OOC_STATE_READY;
	}
	return ready;
}

static int wait_for_pins(struct ctl_request *request, const struct ooc_store *store,
			 const struct target *target, struct done *done)
{
	uint64_t deadline_ns = clock_now_ns() + (uint64_t)(target->wait_s * (double)NS_PER_S);

	while (done->ready < done->nodes) {
		done->ready = u64_min(count_ready(store, &target->nodes), done->nodes);
		if (done->ready == done->nodes || clock_now_ns() >= deadline_ns)
			break;
		if (ooc_dispatch(request->client) < 0) {
			log_error("the daemon is gone");
			return CTL_FAILED;
		}
		(void)poll(NULL, 0, LOOK_MS);
	}
	if (done->ready == done->nodes)
		return CTL_OK;
	log_error("%llu of the pinned nodes have not come in %g s; they come when nobody waits for "
		  "the disk, unless they are damaged: see `oocctl status`",
		  (unsigned long long)(done->nodes - done->ready), target->wait_s);
	return CTL_FAILED;
}

int ctl_pin(int argc, char **argv)
{
	struct ctl_request request = {
		.verb = "pin",
		.help = "Usage: oocctl pin STORE [--nodes LIST] [--wait S] [--json] [--socket S]\n"
			"Keeps nodes in the daemon's cache, whoever else wants them, until `oocctl unpin` or\n"
			"the daemon's end.  They are read when nobody waits for the disk, and take at most\n"
			"half of the cache.  For administrators.\n"
			"\n"
			"      --nodes LIST    these alone, as 1,5-9; - reads them from standard input\n"
			"      --wait S        until they are there, S seconds at most; else exit status 1\n"
			"      --json          one object in place of a line\n" CTL_COMMON_HELP
			"\n\n"
			"Examples:\n"
			"  oocctl pin lobby.ooc --wait 10\n"
			"  oocctl nodes plant.ooc --state held --list | oocctl pin plant.ooc --nodes -",
	};
	struct target target = { 0 };
	struct ooc_store *store;
	struct done done = { 0 };
	int status = parse_target(argc, argv, &request, &target);

	if (status != CTL_OK)
		return status < 0 ? CTL_OK : status;
	if (target.all)
		return ctl_usage(request.verb, "wants one store");
	status = ctl_connect_store(&request, target.store_path, &store);
	if (status == CTL_OK)
		status = steer(&request, OOC_PIN, store, &target.nodes, &done);
	if (status == CTL_OK && target.wait_s > 0)
		status = wait_for_pins(&request, store, &target, &done);
	if (status == CTL_OK)
		print_pins(&request, &done);
	ooc_disconnect(request.client);
	free(target.nodes.nodes);
	return status;
}

/* ---- reload ---- */

int ctl_reload(int argc, char **argv)
{
	struct ctl_request request = {
		.verb = "reload",
		.help = "Usage: oocctl reload [--socket S]\n"
			"Has the daemon read its configuration anew, and waits until it has.  What is wrong\n"
			"in it is said, and all stays as it was.  For administrators.\n"
			"\n" CTL_COMMON_HELP "\n\n"
			"Example:\n"
			"  oocctl reload && oocctl status",
	};
	struct done done = { 0 };
	int status = ctl_parse_common(argc, argv, &request, 0);

	if (status != CTL_OK)
		return status < 0 ? CTL_OK : status;
	if (ctl_connect(&request) != CTL_OK)
		return CTL_FAILED;
	status = steer_once(&request, OOC_RELOAD, NULL, NULL, 0, &done);
	if (status == CTL_OK)
		puts(request.json ? "{\"reloaded\": true}" : "reloaded");
	ooc_disconnect(request.client);
	return status;
}
