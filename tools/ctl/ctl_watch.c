/* SPDX-License-Identifier: MIT */
/* Looking at the daemon again and again: top, for people; dump, for programs. */
#include <inttypes.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "formats/base/log.h"
#include "formats/base/text.h"
#include "tools/ctl/ctl_daemon.h"

/** How often to look. */
struct watch {
	struct ctl_request request;
	double interval_s;
	uint64_t count; /* looks; 0: without end */
	bool monitor;   /* dump */
};

static int parse(int argc, char **argv, struct watch *watch)
{
	static const struct option options[] = {
		{ "interval", required_argument, NULL, 'i' },
		{ "count", required_argument, NULL, 'c' },
		{ "once", no_argument, NULL, '1' },
		{ "monitor", no_argument, NULL, 'm' },
		CTL_COMMON_OPTIONS,
		{ 0 },
	};
	const char *verb = watch->request.verb;
	int option;

	while ((option = getopt_long(argc, argv, "h", options, NULL)) != -1) {
		int status = CTL_OK;

		if (option == '1')
			watch->count = 1;
		else if (option == 'm')
			watch->monitor = true;
		else if (option == 'i' && !ctl_seconds_parse(optarg, &watch->interval_s))
			return ctl_usage(verb, "--interval wants seconds, as 0.5");
		else if (option == 'c' &&
			 (text_to_u64(optarg, &watch->count) < 0 || watch->count == 0))
			return ctl_usage(verb, "--count wants a number from 1");
		else if (option != 'i' && option != 'c')
			status = ctl_common_option(&watch->request, option);
		if (status != CTL_OK)
			return status;
	}
	return argc == optind ? CTL_OK : ctl_usage(verb, "wants no argument");
}

static void pause_for(double seconds)
{
	(void)poll(NULL, 0, (int)(seconds * 1000.0 + 0.5));
}

/* ---- rates ---- */

/** Two looks. */
struct looks {
	const json_t *before;
	const json_t *now;
	double seconds;
};

static double rate(const struct looks *looks, const json_t *before, const json_t *now,
		   const char *key)
{
	/* What was not there before counts from nothing; and no daemon counts back but a new one. */
	double more = ctl_number(now, key) - ctl_number(before, key);

	return more > 0 && looks->seconds > 0 ? more / looks->seconds : 0;
}

/* The element of an array in the look before that has the same key. */
static const json_t *same_before(const struct looks *looks, const char *array, const json_t *now,
				 const char *key)
{
	const json_t *before = json_object_get(looks->before, array);

	for (size_t i = 0; i < json_array_size(before); i++) {
		const json_t *element = json_array_get(before, i);

		if (json_equal(json_object_get(element, key), json_object_get(now, key)))
			return element;
	}
	return NULL;
}

static void print_rate_size(double bytes_a_second, int width)
{
	char size[TEXT_SIZE_BYTES];
	char text[TEXT_SIZE_BYTES + 2];

	(void)snprintf(text, sizeof(text), "%s/s", text_from_size((uint64_t)bytes_a_second, size));
	printf(" %*s", width, text);
}

/* ---- top, for people ---- */

static void print_head(const struct looks *looks)
{
	const json_t *now = looks->now;
	const json_t *totals = json_object_get(now, "totals");
	const json_t *totals_before = json_object_get(looks->before, "totals");
	const json_t *degraded = json_object_get(now, "degraded");

	fputs("cache", stdout);
	ctl_print_size(now, "cache_used_bytes", 0);
	fputs(" of", stdout);
	ctl_print_size(now, "cache_bytes", 0);
	fputs(", pinned", stdout);
	ctl_print_size(now, "pinned_bytes", 0);
	printf("; reading %.0f pieces, queued %.0f fetches and %.0f prefetches\n",
	       ctl_number(now, "reads_in_flight"), ctl_number(now, "fetches_queued"),
	       ctl_number(now, "prefetches_queued"));
	fputs("now:", stdout);
	print_rate_size(rate(looks, totals_before, totals, "device_read_bytes"), 0);
	fputs(", there", stdout);
	ctl_print_share(rate(looks, totals_before, totals, "hits"),
			rate(looks, totals_before, totals, "misses"), 0);
	printf(", fetches %.1f/s, prefetches %.1f/s, evictions %.1f/s, regretted %.1f/s\n",
	       rate(looks, totals_before, totals, "fetches"),
	       rate(looks, totals_before, totals, "prefetches"),
	       rate(looks, totals_before, totals, "evictions"),
	       rate(looks, totals_before, totals, "regrets"));
	if (json_array_size(degraded) > 0)
		printf("degraded in %zu ways: see `oocctl status`\n", json_array_size(degraded));
}

static void print_top_clients(const struct looks *looks)
{
	const json_t *clients = json_object_get(looks->now, "clients");

	printf("\n%7s %8s %6s %8s %7s %9s %13s %11s %8s %8s %8s  %s\n", "session", "pid", "uid",
	       "sets/s", "there", "fetches/s", "read", "held", "waiting", "refused", "owes/s",
	       "client");
	for (size_t i = 0; i < json_array_size(clients); i++) {
		const json_t *client = json_array_get(clients, i);
		const json_t *before = same_before(looks, "clients", client, "session");

		ctl_print_number(client, "session", 6);
		ctl_print_number(client, "pid", 8);
		ctl_print_number(client, "uid", 6);
		printf(" %8.1f", rate(looks, before, client, "sets"));
		ctl_print_share(rate(looks, before, client, "hits"),
				rate(looks, before, client, "misses"), 7);
		printf(" %9.1f", rate(looks, before, client, "fetches"));
		print_rate_size(rate(looks, before, client, "fetched_bytes") +
					rate(looks, before, client, "prefetched_bytes"),
				13);
		ctl_print_size(client, "held_bytes", 11);
		ctl_print_number(client, "waiting_nodes", 8);
		ctl_print_number(client, "refused_nodes", 8);
		printf(" %8.1f  %s\n", rate(looks, before, client, "owed_nodes"),
		       ctl_text(client, "name"));
	}
}

static void print_top_stores(const struct looks *looks)
{
	const json_t *stores = json_object_get(looks->now, "stores");

	printf("\n%10s %11s %11s %11s %7s %7s %13s  %s\n", "ready", "arena", "used", "held",
	       "pieces", "there", "read", "store");
	for (size_t i = 0; i < json_array_size(stores); i++) {
		const json_t *store = json_array_get(stores, i);
		const json_t *before = same_before(looks, "stores", store, "path");

		ctl_print_number(store, "ready_nodes", 9);
		ctl_print_size(store, "arena_bytes", 11);
		ctl_print_size(store, "used_bytes", 11);
		ctl_print_size(store, "held_bytes", 11);
		printf(" %6.1f%%", 100 * ctl_number(store, "fragmentation"));
		ctl_print_share(rate(looks, before, store, "hits"),
				rate(looks, before, store, "misses"), 7);
		print_rate_size(rate(looks, before, store, "read_bytes"), 13);
		printf("  %s\n", ctl_text(store, "path"));
	}
}

static void print_top(const struct looks *looks)
{
	if (isatty(STDOUT_FILENO))
		fputs("\033[H\033[2J", stdout);
	print_head(looks);
	print_top_clients(looks);
	print_top_stores(looks);
	putchar('\n');
	ctl_print_debts(json_object_get(looks->now, "clients"));
	(void)fflush(stdout);
}

/* ---- top, for programs ---- */

/* Adds "KEY_per_s" for what grows. */
static void add_rates(const struct looks *looks, const json_t *before, json_t *now)
{
	static const char *const keys[] = {
		"sets",          "hits",    "misses",  "fetches",    "prefetches",
		"fetched_bytes", "joined",  "refused", "owed_nodes", "prefetched_bytes",
		"read_bytes",    "regrets", "errors",  "evictions",  "device_read_bytes",
	};

	for (size_t i = 0; i < ARRAY_LENGTH(keys); i++) {
		char name[64];

		if (!json_object_get(now, keys[i]))
			continue;
		(void)snprintf(name, sizeof(name), "%s_per_s", keys[i]);
		json_object_set_new(now, name, json_real(rate(looks, before, now, keys[i])));
	}
}

static void print_top_json(const struct looks *looks)
{
	json_t *copy = json_deep_copy(looks->now);
	json_t *clients = json_object_get(copy, "clients");
	json_t *stores = json_object_get(copy, "stores");

	json_object_set_new(copy, "interval_s", json_real(looks->seconds));
	add_rates(looks, json_object_get(looks->before, "totals"), json_object_get(copy, "totals"));
	for (size_t i = 0; i < json_array_size(clients); i++) {
		json_t *client = json_array_get(clients, i);

		add_rates(looks, same_before(looks, "clients", client, "session"), client);
	}
	for (size_t i = 0; i < json_array_size(stores); i++) {
		json_t *store = json_array_get(stores, i);

		add_rates(looks, same_before(looks, "stores", store, "path"), store);
	}
	(void)json_dumpf(copy, stdout, JSON_COMPACT);
	putchar('\n');
	(void)fflush(stdout);
	json_decref(copy);
}

static int watch_top(struct watch *watch)
{
	json_t *before = ctl_status_tree(&watch->request);
	int status = before ? CTL_OK : CTL_FAILED;

	for (uint64_t i = 0; status == CTL_OK && (watch->count == 0 || i < watch->count); i++) {
		struct looks looks = { .before = before };
		json_t *now;

		pause_for(watch->interval_s);
		now = ctl_status_tree(&watch->request);
		if (!now) {
			status = CTL_FAILED;
			break;
		}
		looks.now = now;
		looks.seconds = (ctl_number(now, "now_ns") - ctl_number(before, "now_ns")) /
				(double)NS_PER_S;
		if (watch->request.json)
			print_top_json(&looks);
		else
			print_top(&looks);
		json_decref(before);
		before = now;
	}
	json_decref(before);
	return status;
}

int ctl_top(int argc, char **argv)
{
	struct watch watch = {
		.request = {
			.verb = "top",
			.help = "Usage: oocctl top [--interval S] [--count N | --once] [--json] [--socket S]\n"
				"Shows what the daemon is doing: how fast it reads, how many of the wanted nodes were\n"
				"there, each client with its sets, reads and holds, each store with its memory and how\n"
				"much of its free space is in pieces, and who lives on whose reads.  Ctrl-C ends it.\n"
				"\n"
				"      --interval S    seconds between two looks; what is shown are rates since the last (1)\n"
				"      --count N       N looks, then end\n"
				"      --once          one\n"
				"      --json          one object a line: the status, with a rate for each counter\n"
				CTL_COMMON_HELP "\n\n"
				"Examples:\n"
				"  oocctl top\n"
				"  oocctl top --once --json | jq '.totals.device_read_bytes_per_s'",
		},
		.interval_s = 1.0,
	};
	int status = parse(argc, argv, &watch);

	if (status != CTL_OK)
		return status < 0 ? CTL_OK : status;
	if (watch.monitor)
		return ctl_usage("top", "--monitor is for `oocctl dump`");
	if (ctl_connect(&watch.request) != CTL_OK)
		return CTL_FAILED;
	status = watch_top(&watch);
	ooc_disconnect(watch.request.client);
	return status;
}

/* ---- dump ---- */

/* Nothing but clocks differs? */
static bool is_the_same(const json_t *before, const json_t *now)
{
	static const char *const clocks[] = { "uptime_s", "now_ns" };
	json_t *left = json_deep_copy(before);
	json_t *right = json_deep_copy(now);
	bool same;

	for (size_t i = 0; i < ARRAY_LENGTH(clocks); i++) {
		json_object_del(left, clocks[i]);
		json_object_del(right, clocks[i]);
	}
	/* Looking is answered, and that is counted. */
	json_object_del(left, "accounts");
	json_object_del(right, "accounts");
	for (size_t i = 0; i < json_array_size(json_object_get(left, "clients")); i++)
		json_object_del(json_array_get(json_object_get(left, "clients"), i), "connected_s");
	for (size_t i = 0; i < json_array_size(json_object_get(right, "clients")); i++)
		json_object_del(json_array_get(json_object_get(right, "clients"), i),
				"connected_s");
	same = json_equal(left, right);
	json_decref(left);
	json_decref(right);
	return same;
}

static int watch_changes(struct watch *watch)
{
	json_t *told = NULL;
	uint64_t told_count = 0;
	int status = CTL_OK;

	while (watch->count == 0 || told_count < watch->count) {
		json_t *now;

		if (told)
			pause_for(watch->interval_s);
		now = ctl_status_tree(&watch->request);
		if (!now) {
			status = CTL_FAILED;
			break;
		}
		if (told && is_the_same(told, now)) {
			json_decref(now);
			continue;
		}
		(void)json_dumpf(now, stdout, JSON_COMPACT);
		putchar('\n');
		(void)fflush(stdout);
		json_decref(told);
		told = now;
		told_count++;
	}
	json_decref(told);
	return status;
}

int ctl_dump(int argc, char **argv)
{
	struct watch watch = {
		.request = {
			.verb = "dump",
			.help = "Usage: oocctl dump [--monitor [--interval S] [--count N]] [--socket S]\n"
				"Prints the daemon's whole state as JSON: memory, queues, stores, clients, users, all\n"
				"counters, and what is degraded.  `oocctl nodes --json` has the nodes of a store.\n"
				"\n"
				"      --monitor       one object a line, now and whenever something has changed\n"
				"      --interval S    seconds between two looks (1)\n"
				"      --count N       N lines, then end\n"
				"      --json          allowed; it is JSON anyhow\n"
				CTL_COMMON_HELP "\n\n"
				"Examples:\n"
				"  oocctl dump > before.json\n"
				"  oocctl dump --monitor --interval 0.2 | jq -c '[.now_ns, .totals.misses]'",
		},
		.interval_s = 1.0,
	};
	json_t *state;
	int status = parse(argc, argv, &watch);

	if (status != CTL_OK)
		return status < 0 ? CTL_OK : status;
	if (ctl_connect(&watch.request) != CTL_OK)
		return CTL_FAILED;
	if (watch.monitor) {
		status = watch_changes(&watch);
	} else {
		state = ctl_status_tree(&watch.request);
		if (state)
			ctl_print_json(state);
		else
			status = CTL_FAILED;
		json_decref(state);
	}
	ooc_disconnect(watch.request.client);
	return status;
}
