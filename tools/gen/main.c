/* SPDX-License-Identifier: MIT */
/* oocgen - makes scenes: procedural ones of any size, and lists that place the models of folders. */
#include <errno.h>
#include <getopt.h>
#include <inttypes.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/log.h"
#include "formats/base/text.h"
#include "tools/gen/plant.h"

#define EXIT_USAGE 2

static const char help_text[] = "Usage: oocgen plant --triangles N [--seed S] -o F.ply\n"
				"\n"
				"Makes scenes.\n";

enum long_option {
	OPTION_TRIANGLES = 256,
	OPTION_SEED,
	OPTION_NO_COLOURS,
	OPTION_HELP,
	OPTION_VERSION,
};

struct settings {
	const char *output;
	uint64_t triangle_count;
	uint64_t seed;
	bool colours;
};

static void on_signal(int signal_number)
{
	(void)signal_number;
	out_file_interrupt();
}

static int run_plant(const struct settings *settings)
{
	static struct plant plant;
	struct mesh_file file = { .path = settings->output, .colours = settings->colours };
	char description[128];
	struct why why;

	plant_init(&plant, settings->triangle_count, settings->seed);
	(void)snprintf(description, sizeof(description),
		       "plant --triangles %" PRIu64 " --seed %" PRIu64, settings->triangle_count,
		       settings->seed);
	file.description = description;
	if (mesh_write_file(&file, plant_scene, &plant, NULL, &why) < 0) {
		log_error("%s", why.text);
		return EXIT_FAILURE;
	}
	return EXIT_SUCCESS;
}

int main(int argc, char **argv)
{
	static const struct option options[] = {
		{ "triangles", required_argument, NULL, OPTION_TRIANGLES },
		{ "seed", required_argument, NULL, OPTION_SEED },
		{ "output", required_argument, NULL, 'o' },
		{ "no-colours", no_argument, NULL, OPTION_NO_COLOURS },
		{ "help", no_argument, NULL, OPTION_HELP },
		{ "version", no_argument, NULL, OPTION_VERSION },
		{ NULL, 0, NULL, 0 },
	};
	struct settings settings = { .colours = true, .seed = 1 };
	struct sigaction action = { .sa_handler = on_signal };
	int option;

	log_init("oocgen", LOG_LEVEL_INFO);
	(void)sigaction(SIGINT, &action, NULL);
	(void)sigaction(SIGTERM, &action, NULL);
	while ((option = getopt_long(argc, argv, "o:", options, NULL)) != -1) {
		switch (option) {
		case OPTION_TRIANGLES:
			if (text_to_u64(optarg, &settings.triangle_count) < 0)
				return EXIT_USAGE;
			break;
		case OPTION_SEED:
			if (text_to_u64(optarg, &settings.seed) < 0)
				return EXIT_USAGE;
			break;
		case 'o':
			settings.output = optarg;
			break;
		case OPTION_NO_COLOURS:
			settings.colours = false;
			break;
		case OPTION_HELP:
			(void)fputs(help_text, stdout);
			return EXIT_SUCCESS;
		case OPTION_VERSION:
			(void)puts("oocgen " OOCD_VERSION);
			return EXIT_SUCCESS;
		default:
			return EXIT_USAGE;
		}
	}
	return run_plant(&settings);
}
