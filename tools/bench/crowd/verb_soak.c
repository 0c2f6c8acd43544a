/* SPDX-License-Identifier: MIT */
/* oocbench soak: hours in which everything fails now and then. */
#include <stddef.h>

#include "formats/base/bytes.h"
#include "tools/bench/base/arguments.h"
#include "tools/bench/bench.h"
#include "tools/bench/crowd/crowd.h"

static const char help[] =
	"Usage: oocbench soak STORE [OPTION]...\n"
	"As oocbench stress, for long and with less care: clients are killed, the daemon is killed, and\n"
	"reads fail.  Clients that live must come back by themselves and see nothing wrong; the daemon's\n"
	"descriptors and memory must not grow.\n"
	"\n"
	"  --seconds N     how long (3600)\n"
	"  --clients N     at one time (32)\n"
	"  --set N         nodes of a set (100)\n"
	"  --rate N        sets of a client a second, at most (10)\n"
	"  --kill-ms N     between two kills of a client; 0: none (100)\n"
	"  --restart-s N   between two kills of the daemon; 0: none (300)\n"
	"  --errors N      of 1000 reads that fail (10)\n"
	"  --cache SIZE    of the daemon (three quarters of what is wanted, so that it evicts)\n"
	"  --seed N        (1)\n"
	"  --json          results for programs\n"
	"\n"
	"Exit status 1: something was wrong, failed or left.\n"
	"\n"
	"Example:\n"
	"  oocbench soak plant.ooc --seconds 600 --restart-s 60\n";

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
	bool is_json = false;
	const struct argument table[] = {
		{ "seconds", ARGUMENT_NUMBER, &config.seconds, 1 },
		{ "clients", ARGUMENT_NUMBER, &config.client_count, 1, 500 },
		{ "set", ARGUMENT_NUMBER, &config.set_count, 1, 100000 },
		{ "rate", ARGUMENT_NUMBER, &config.sets_per_second, 1, 1000 },
		{ "kill-ms", ARGUMENT_NUMBER, &config.kill_ms },
		{ "restart-s", ARGUMENT_NUMBER, &config.restart_s },
		{ "errors", ARGUMENT_NUMBER, &config.error_permille, 0, 1000 },
		{ "cache", ARGUMENT_SIZE, &config.cache_bytes, .min = (double)MIB },
		{ "seed", ARGUMENT_NUMBER, &config.seed },
		{ "json", ARGUMENT_FLAG, &is_json },
		{ NULL },
	};
	const struct arguments arguments = { "soak", help, table, 1, 1, "name one store" };
	char **operands;
	int r = arguments_parse(&arguments, argc, argv, &operands);

	if (r != ARGUMENTS_OK)
		return r;
	config.store = operands[0];
	return crowd_main("soak", &config, is_json);
}
