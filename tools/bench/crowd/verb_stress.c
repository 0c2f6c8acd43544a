/* SPDX-License-Identifier: MIT */
/* oocbench stress: many clients that are killed all the while, and what the living notice of it. */
#include <stddef.h>

#include "formats/base/bytes.h"
#include "tools/bench/base/arguments.h"
#include "tools/bench/bench.h"
#include "tools/bench/crowd/crowd.h"

static const char help[] =
	"Usage: oocbench stress STORE [OPTION]...\n"
	"Many clients of one daemon say random sets and are killed, one after the other.  Every payload\n"
	"that they sum must be right, no request of the living may fail, and in the end nothing may be\n"
	"left.  One client is never killed and takes the time of sets that lie in the cache whole.\n"
	"\n"
	"  --clients N     at one time (256)\n"
	"  --set N         nodes of a set (100)\n"
	"  --rate N        sets of a client a second, at most (4)\n"
	"  --seconds N     how long (600)\n"
	"  --kill-ms N     between two kills; 0: none (100)\n"
	"  --cache SIZE    of the daemon (three quarters of what is wanted, so that it evicts)\n"
	"  --hostile       others flood, churn, hoard, forge and grab meanwhile; as root, as another user\n"
	"  --seed N        (1)\n"
	"  --json          results for programs\n"
	"\n"
	"Exit status 1: something was wrong, failed or left.\n"
	"\n"
	"Example:\n"
	"  oocbench stress plant.ooc --clients 64 --seconds 60\n";

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
	bool is_json = false;
	const struct argument table[] = {
		{ "clients", ARGUMENT_NUMBER, &config.client_count, 1, 500 },
		{ "set", ARGUMENT_NUMBER, &config.set_count, 1, 100000 },
		{ "rate", ARGUMENT_NUMBER, &config.sets_per_second, 1, 1000 },
		{ "seconds", ARGUMENT_NUMBER, &config.seconds, 1 },
		{ "kill-ms", ARGUMENT_NUMBER, &config.kill_ms },
		{ "cache", ARGUMENT_SIZE, &config.cache_bytes, .min = (double)MIB },
		{ "hostile", ARGUMENT_FLAG, &config.hostile },
		{ "seed", ARGUMENT_NUMBER, &config.seed },
		{ "json", ARGUMENT_FLAG, &is_json },
		{ NULL },
	};
	const struct arguments arguments = { "stress", help, table, 1, 1, "name one store" };
	char **operands;
	int r = arguments_parse(&arguments, argc, argv, &operands);

	if (r != ARGUMENTS_OK)
		return r;
	config.store = operands[0];
	return crowd_main("stress", &config, is_json);
}
