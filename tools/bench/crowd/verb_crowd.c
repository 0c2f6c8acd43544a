/* SPDX-License-Identifier: MIT */
/*
 * oocbench stress: many clients that are killed all the while, and what the living notice of it.
 * oocbench soak: the same for hours, while the daemon is killed as well and reads fail.
 */
#include <inttypes.h>
#include <stddef.h>

#include "formats/base/bytes.h"
#include "formats/base/log.h"
#include "tools/bench/base/arguments.h"
#include "tools/bench/base/report.h"
#include "tools/bench/base/verb.h"
#include "tools/bench/bench.h"
#include "tools/bench/crowd/crowd.h"

static const char help[] =
	"Usage: oocbench stress|soak STORE [OPTION]...\n"
	"Many clients of one daemon say random sets and are killed, one after the other.  Every payload\n"
	"that they sum must be right, no request of the living may fail, and in the end nothing may be\n"
	"left.  One client is never killed and takes the time of sets that lie in the cache whole.\n"
	"With soak the daemon is killed as well, and reads fail: clients that live must come back by\n"
	"themselves and see nothing wrong.  What the daemon has early and late in its longest life,\n"
	"descriptors and memory, is said, not judged.\n"
	"\n"
	"  --clients N     at one time (256; soak: 32)\n"
	"  --set N         nodes of a set (100)\n"
	"  --rate N        sets of a client a second, at most (4; soak: 10)\n"
	"  --seconds N     how long (600; soak: 3600)\n"
	"  --kill-ms N     between two kills of a client; 0: none (100)\n"
	"  --restart-s N   between two kills of the daemon; 0: none (0; soak: 300)\n"
	"  --errors N      of 1000 reads that fail (0; soak: 10)\n"
	"  --cache SIZE    of the daemon (three quarters of what is wanted, so that it evicts)\n"
	"  --hostile       others flood, churn, hoard, forge and grab meanwhile; as root, as another user\n"
	"  --seed N        (1)\n"
	"  --json          results for programs\n"
	"\n"
	"Exit status 1: something was wrong, failed or left.\n"
	"\n"
	"Examples:\n"
	"  oocbench stress plant.ooc --clients 64 --seconds 60\n"
	"  oocbench soak plant.ooc --seconds 600 --restart-s 60\n";

static void crowd_report(const struct crowd_config *config, const struct crowd_result *result,
			 bool is_json)
{
	struct report report;

	report_begin(&report, is_json);
	report_text(&report, "store", "store", config->store);
	report_number(&report, "seed", "seed", (double)config->seed, "");
	report_number(&report, "clients", "clients", (double)config->client_count, "");
	report_number(&report, "seconds", "seconds", (double)config->seconds, "");
	report_number(&report, "kills", "clients killed", (double)result->kills, "");
	report_number(&report, "restarts", "times the daemon was killed", (double)result->restarts,
		      "");
	report_number(&report, "sets", "sets settled", (double)result->sets, "");
	report_number(&report, "reads", "payloads summed", (double)result->reads, "");
	report_number(&report, "wrong", "of them wrong", (double)result->wrong, "");
	report_number(&report, "stale", "read after a client was thrown out", (double)result->stale,
		      "");
	report_number(&report, "failed", "failed requests of the living", (double)result->failed,
		      "");
	if (result->first_failure[0] != '\0')
		report_text(&report, "first_failure", "the first of them", result->first_failure);
	report_number(&report, "refused_full", "nodes refused for room",
		      (double)result->refused_full, "");
	report_number(&report, "refused_unreadable", "nodes refused for failed reads",
		      (double)result->refused_unreadable, "");
	report_number(&report, "lost", "times a client found the daemon away", (double)result->lost,
		      "");
	report_number(&report, "probes", "resident sets timed", (double)result->probes, "");
	report_number(&report, "probe_ms_median", "  median", result->probe_ms.median, "ms");
	report_number(&report, "probe_ms_p99", "  99 of 100 within", result->probe_ms.p99, "ms");
	report_number(&report, "probe_ms_max", "  longest", result->probe_ms.highest, "ms");
	report_number(&report, "ping_ms_median", "a message that a process only sends back, median",
		      result->ping_ms.median, "ms");
	report_number(&report, "ping_ms_p99", "  99 of 100 within", result->ping_ms.p99, "ms");
	report_number(&report, "ping_ms_max", "  longest", result->ping_ms.highest, "ms");
	report_number(&report, "leaked_descriptors", "descriptors not given back",
		      (double)result->leaked_descriptors, "");
	report_number(&report, "leaked_holds_bytes", "bytes held for nobody",
		      (double)result->leaked_holds_bytes, "");
	report_number(&report, "leaked_sessions", "sessions of nobody",
		      (double)result->leaked_sessions, "");
	report_number(&report, "descriptors_early", "descriptors early in the longest life",
		      (double)result->descriptors_early, "");
	report_number(&report, "descriptors_late", "descriptors at its end",
		      (double)result->descriptors_late, "");
	report_number(&report, "memory_early_bytes", "own memory early in it",
		      (double)result->memory_early_bytes, "bytes");
	report_number(&report, "memory_late_bytes", "own memory at its end",
		      (double)result->memory_late_bytes, "bytes");
	report_end(&report);
}

static bool is_sound(const struct crowd_result *result)
{
	return result->wrong == 0 && result->failed == 0 && result->leaked_descriptors <= 0 &&
	       result->leaked_holds_bytes == 0 && result->leaked_sessions == 0;
}

/* Takes the command line, runs the crowd, and says what was found. */
static int run(const char *verb, struct crowd_config *config, int argc, char **argv)
{
	bool is_json = false;
	const struct argument table[] = {
		{ "clients", ARGUMENT_NUMBER, &config->client_count, 1, 500 },
		{ "set", ARGUMENT_NUMBER, &config->set_count, 1, 100000 },
		{ "rate", ARGUMENT_NUMBER, &config->sets_per_second, 1, 1000 },
		{ "seconds", ARGUMENT_NUMBER, &config->seconds, 1 },
		{ "kill-ms", ARGUMENT_NUMBER, &config->kill_ms },
		{ "restart-s", ARGUMENT_NUMBER, &config->restart_s },
		{ "errors", ARGUMENT_NUMBER, &config->error_permille, 0, 1000 },
		{ "cache", ARGUMENT_SIZE, &config->cache_bytes, .min = (double)MIB },
		{ "hostile", ARGUMENT_FLAG, &config->hostile },
		{ "seed", ARGUMENT_NUMBER, &config->seed },
		{ "json", ARGUMENT_FLAG, &is_json },
		{ NULL },
	};
	const struct arguments arguments = { verb, help, table, 1, 1, "name one store" };
	struct crowd_result result;
	char **operands;
	struct why why = { "" };
	int r = arguments_parse(&arguments, argc, argv, &operands);

	if (r != ARGUMENTS_OK)
		return r;
	config->store = operands[0];
	log_info("%s: seed %" PRIu64, verb, config->seed);
	r = crowd_run(config, &result, &why);
	if (r == 0)
		crowd_report(config, &result, is_json);
	return verb_status(verb, r, &why) || !is_sound(&result);
}

int verb_stress(int argc, char **argv)
{
	struct crowd_config config = {
		.client_count = 256,
		.set_count = 100,
		.sets_per_second = 4,
		.seconds = 600,
		.kill_ms = 100,
		.seed = 1,
	};

	return run("stress", &config, argc, argv);
}

int verb_soak(int argc, char **argv)
{
	struct crowd_config config = {
		.client_count = 32,
		.set_count = 100,
		.sets_per_second = 10,
		.seconds = 3600,
		.kill_ms = 100,
		.restart_s = 300,
		.error_permille = 10,
		.seed = 1,
	};

	return run("soak", &config, argc, argv);
}
