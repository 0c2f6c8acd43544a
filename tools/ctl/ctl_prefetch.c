/* SPDX-License-Identifier: MIT */
/*
 * Brings nodes into the cache before somebody needs them: nodes that are named, or those that a camera
 * path will show, in the order in which it comes to them.
 *
 * Nothing is held: what is prefetched may be evicted for what others want.  So more than the cache
 * holds is not asked for, since that would throw out what is needed first.
 */
#include <inttypes.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "formats/base/log.h"
#include "formats/base/text.h"
#include "libclient/select/select.h"
#include "libclient/wire.h"
#include "tools/ctl/ctl_daemon.h"

/* Between two looks at what has come, and after how long the rest is asked for again. */
#define LOOK_MS 2
#define ASK_NS  (100 * NS_PER_MS)
/* Without a deadline: how long nothing may come before it is given up. */
#define STALL_NS (10 * NS_PER_S)
/* Nodes that one PREFETCH may have. */
#define ASK_COUNT_MAX WIRE_SET_ENTRY_COUNT_MAX

struct prefetch {
	struct ctl_request request;
	const char *nodes_text;
	const char *path;
	double deadline_s; /* 0: none */
	double aspect;
	uint64_t budget_triangles; /* 0: all that is in view */

	struct ooc_store *store;
	struct ctl_nodes nodes; /* each once, in the order in which they are needed */
	double *times_s;        /* when the path comes to each; NULL: there is no path */
	size_t asked_count;     /* of the nodes: as many as the cache holds */
	double seconds;         /* that it took */
};

/* ---- the command line ---- */

static bool aspect_from(const char *text, double *ret)
{
	unsigned width;
	unsigned height;
	char more;

	if (sscanf(text, "%5ux%5u%c", &width, &height, &more) != 2 || width == 0 || height == 0)
		return false;
	*ret = (double)width / height;
	return true;
}

static int parse(int argc, char **argv, struct prefetch *prefetch)
{
	static const struct option options[] = {
		{ "nodes", required_argument, NULL, 'n' },
		{ "path", required_argument, NULL, 'p' },
		{ "deadline", required_argument, NULL, 'd' },
		{ "size", required_argument, NULL, 'z' },
		{ "budget", required_argument, NULL, 'b' },
		CTL_COMMON_OPTIONS,
		{ 0 },
	};
	const char *verb = prefetch->request.verb;
	int option;

	while ((option = getopt_long(argc, argv, "h", options, NULL)) != -1) {
		int status = CTL_OK;

		if (option == 'n')
			prefetch->nodes_text = optarg;
		else if (option == 'p')
			prefetch->path = optarg;
		else if (option == 'd' && !ctl_seconds_parse(optarg, &prefetch->deadline_s))
			return ctl_usage(verb, "--deadline wants seconds, as 2.5");
		else if (option == 'z' && !aspect_from(optarg, &prefetch->aspect))
			return ctl_usage(verb, "--size wants WIDTHxHEIGHT, as 1280x720");
		else if (option == 'b' && text_to_u64(optarg, &prefetch->budget_triangles) < 0)
			return ctl_usage(verb, "--budget wants a number of triangles");
		else if (!strchr("dzb", option))
			status = ctl_common_option(&prefetch->request, option);
		if (status != CTL_OK)
			return status;
	}
	if (argc - optind != 1)
		return ctl_usage(verb, "wants one store");
	if (!prefetch->nodes_text == !prefetch->path)
		return ctl_usage(verb, "wants either --nodes or --path");
	return CTL_OK;
}

/* ---- which nodes ---- */

static int no_memory(const struct prefetch *prefetch)
{
	log_error("%s: no memory", prefetch->request.verb);
	return CTL_FAILED;
}

static int check_nodes(const struct prefetch *prefetch)
{
	const struct store_node *records = ooc_nodes(prefetch->store);

	for (size_t i = 0; i < prefetch->nodes.count; i++) {
		uint32_t node = prefetch->nodes.nodes[i];

		if (node >= ooc_node_count(prefetch->store) || records[node].payload_id == 0) {
			log_error("node %u: not in the store, or with nothing to draw", node);
			return CTL_FAILED;
		}
	}
	return CTL_OK;
}

/* Adds what a camera of the path shows and none before it has. */
static void add_view(struct prefetch *prefetch, struct selector *selector,
		     const struct camera *camera, bool *seen)
{
	const struct store_superblock *superblock = ooc_superblock(prefetch->store);
	const struct store_node *records = ooc_nodes(prefetch->store);
	struct select_options options = { .budget_triangles = prefetch->budget_triangles };
	struct camera_view view;
	struct selection selection;

	if (camera_view_init(&view, camera, superblock, prefetch->aspect,
			     camera_near(camera, superblock)) < 0)
		return;
	if (prefetch->budget_triangles > 0)
		select_approximate(selector, &view, &options, &selection);
	else
		select_frustum(selector, &view, &selection);
	for (size_t i = 0; i < selection.entry_count; i++) {
		uint32_t node = selection.entries[i].node;

		if (seen[node] || records[node].payload_id == 0)
			continue;
		seen[node] = true;
		prefetch->times_s[prefetch->nodes.count] = camera->time_s;
		prefetch->nodes.nodes[prefetch->nodes.count++] = node;
	}
}

static int add_path(struct prefetch *prefetch, const struct camera *cameras, uint32_t camera_count)
{
	uint64_t node_count = ooc_node_count(prefetch->store);
	bool *seen = calloc(node_count, sizeof(*seen));
	struct selector *selector = NULL;

	prefetch->nodes.nodes = calloc(node_count, sizeof(*prefetch->nodes.nodes));
	prefetch->times_s = calloc(node_count, sizeof(*prefetch->times_s));
	if (!seen || !prefetch->nodes.nodes || !prefetch->times_s ||
	    selector_create(ooc_superblock(prefetch->store), ooc_nodes(prefetch->store),
			    &selector) < 0) {
		free(seen);
		return no_memory(prefetch);
	}
	for (uint32_t i = 0; i < camera_count; i++)
		add_view(prefetch, selector, &cameras[i], seen);
	selector_destroy(selector);
	free(seen);
	return CTL_OK;
}

static int choose_nodes(struct prefetch *prefetch)
{
	struct camera *cameras;
	uint32_t camera_count;
	struct why why;
	int status;

	if (prefetch->nodes_text) {
		status =
			ctl_nodes_parse(&prefetch->request, prefetch->nodes_text, &prefetch->nodes);
		return status == CTL_OK ? check_nodes(prefetch) : status;
	}
	if (camera_path_read(prefetch->path, &cameras, &camera_count, &why) < 0) {
		log_error("%s", why.text);
		return CTL_FAILED;
	}
	status = add_path(prefetch, cameras, camera_count);
	free(cameras);
	return status;
}

/* ---- prefetching ---- */

static uint64_t node_bytes(const struct prefetch *prefetch, size_t i)
{
	return bytes_round_up(ooc_nodes(prefetch->store)[prefetch->nodes.nodes[i]].payload_bytes,
			      WIRE_PAGE_BYTES);
}

/* Those that are needed first and fit together. */
static size_t count_that_fit(const struct prefetch *prefetch)
{
	struct ooc_counters counters;
	uint64_t bytes = 0;
	size_t count = 0;

	ooc_counters(prefetch->request.client, &counters);
	for (; count < prefetch->nodes.count; count++) {
		bytes += node_bytes(prefetch, count);
		if (bytes > counters.cache_bytes)
			break;
	}
	return count;
}

static bool is_there(const struct prefetch *prefetch, size_t i)
{
	return ooc_node_state(prefetch->store, prefetch->nodes.nodes[i]) == OOC_STATE_READY;
}

static size_t count_ready(const struct prefetch *prefetch)
{
	size_t ready = 0;

	for (size_t i = 0; i < prefetch->asked_count; i++)
		ready += is_there(prefetch, i);
	return ready;
}

/* Asks for the first that are not there; what is asked for replaces what was, so nothing is lost. */
static void ask(const struct prefetch *prefetch, struct ooc_want *wants)
{
	size_t count = 0;

	for (size_t i = 0; i < prefetch->asked_count && count < ASK_COUNT_MAX; i++) {
		if (is_there(prefetch, i))
			continue;
		wants[count] = (struct ooc_want){
			.store = prefetch->store,
			.node = prefetch->nodes.nodes[i],
			.importance = (float)(ASK_COUNT_MAX - count),
		};
		count++;
	}
	if (count > 0)
		(void)ooc_prefetch(prefetch->request.client, wants, count);
}

static void await(struct prefetch *prefetch, struct ooc_want *wants)
{
	uint64_t start_ns = clock_now_ns();
	uint64_t asked_ns = 0;
	uint64_t progress_ns = start_ns;
	size_t ready = 0;

	for (;;) {
		size_t now_ready = count_ready(prefetch);
		uint64_t now_ns = clock_now_ns();

		prefetch->seconds = (double)(now_ns - start_ns) / (double)NS_PER_S;
		if (now_ready != ready)
			progress_ns = now_ns;
		ready = now_ready;
		if (ready == prefetch->asked_count || ooc_dispatch(prefetch->request.client) < 0)
			return;
		if (prefetch->deadline_s > 0 ? prefetch->seconds >= prefetch->deadline_s
					     : now_ns - progress_ns > STALL_NS)
			return;
		if (asked_ns == 0 || now_ns - asked_ns > ASK_NS) {
			ask(prefetch, wants);
			asked_ns = now_ns;
		}
		(void)poll(NULL, 0, LOOK_MS);
	}
}

/* ---- the answer ---- */

struct outcome {
	uint64_t bytes;
	uint64_t missing_bytes;
	uint64_t missing_count;
	double whole_until_s; /* the path needs nothing before that is missing */
};

static struct outcome outcome_of(const struct prefetch *prefetch)
{
	struct outcome outcome = { 0 };

	for (size_t i = 0; i < prefetch->nodes.count; i++) {
		outcome.bytes += node_bytes(prefetch, i);
		if (is_there(prefetch, i))
			continue;
		if (outcome.missing_count == 0 && prefetch->times_s)
			outcome.whole_until_s = prefetch->times_s[i];
		outcome.missing_count++;
		outcome.missing_bytes += node_bytes(prefetch, i);
	}
	return outcome;
}

static void print_json(const struct prefetch *prefetch, const struct outcome *outcome)
{
	printf("{\"ready\": %s, \"seconds\": %.3f, \"nodes\": %zu, \"bytes\": %" PRIu64
	       ", \"missing_nodes\": %" PRIu64 ", \"missing_bytes\": %" PRIu64,
	       outcome->missing_count == 0 ? "true" : "false", prefetch->seconds,
	       prefetch->nodes.count, outcome->bytes, outcome->missing_count,
	       outcome->missing_bytes);
	if (outcome->missing_count > 0 && prefetch->times_s)
		printf(", \"whole_until_s\": %.3f", outcome->whole_until_s);
	puts("}");
}

static void print_line(const struct prefetch *prefetch, const struct outcome *outcome)
{
	char size[TEXT_SIZE_BYTES];

	if (outcome->missing_count == 0) {
		printf("ready by %.2f s: %zu nodes, %s\n", prefetch->seconds, prefetch->nodes.count,
		       text_from_size(outcome->bytes, size));
		return;
	}
	printf("short after %.2f s: %" PRIu64 " of %zu nodes, %s, are not there", prefetch->seconds,
	       outcome->missing_count, prefetch->nodes.count,
	       text_from_size(outcome->missing_bytes, size));
	if (prefetch->asked_count < prefetch->nodes.count)
		fputs("; they are more than the cache holds", stdout);
	if (prefetch->times_s)
		printf("; the path is whole until t = %.2f s", outcome->whole_until_s);
	putchar('\n');
}

static int run(struct prefetch *prefetch)
{
	struct ooc_want *wants = calloc(ASK_COUNT_MAX, sizeof(*wants));
	struct outcome outcome;
	int status = wants ? choose_nodes(prefetch) : no_memory(prefetch);

	if (status == CTL_OK) {
		prefetch->asked_count = count_that_fit(prefetch);
		await(prefetch, wants);
		outcome = outcome_of(prefetch);
		if (prefetch->request.json)
			print_json(prefetch, &outcome);
		else
			print_line(prefetch, &outcome);
		status = outcome.missing_count == 0 ? CTL_OK : CTL_FAILED;
	}
	free(wants);
	return status;
}

int ctl_prefetch(int argc, char **argv)
{
	struct prefetch prefetch = {
		.request = {
			.verb = "prefetch",
			.help = "Usage: oocctl prefetch STORE --nodes LIST | --path P.csv [--deadline S]\n"
				"                       [--size WxH] [--budget N] [--json] [--socket S]\n"
				"Brings nodes into the daemon's cache before somebody needs them, when nobody waits\n"
				"for the disk, and says when they are there, or what is short (exit status 1).\n"
				"Nothing is held: `oocctl pin` keeps nodes.\n"
				"\n"
				"      --nodes LIST    these, as 1,5-9; - reads them from standard input\n"
				"      --path P.csv    what a camera path shows, in the order in which it comes there\n"
				"      --deadline S    in S seconds; else until nothing comes any more\n"
				"      --size WxH      of the picture, for its proportions (1280x720)\n"
				"      --budget N      of each picture, as much as a budget of N triangles allows\n"
				"      --json          one object in place of a line\n"
				CTL_COMMON_HELP "\n\n"
				"Examples:\n"
				"  oocctl prefetch plant.ooc --path tour.csv --deadline 5 && echo go\n"
				"  oocctl prefetch plant.ooc --nodes 0-99",
		},
		.aspect = 1280.0 / 720.0,
	};
	int status = parse(argc, argv, &prefetch);

	if (status != CTL_OK)
		return status < 0 ? CTL_OK : status;
	if (ctl_connect_store(&prefetch.request, argv[optind], &prefetch.store) != CTL_OK)
		return CTL_FAILED;
	status = run(&prefetch);
	ooc_disconnect(prefetch.request.client);
	free(prefetch.nodes.nodes);
	free(prefetch.times_s);
	return status;
}
