/* SPDX-License-Identifier: MIT */
/* oocgen - makes scenes: procedural ones of any size, and lists that place the models of folders. */
#include <errno.h>
#include <getopt.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "formats/base/log.h"
#include "formats/base/text.h"
#include "tools/gen/interrupt.h"
#include "tools/gen/plant.h"
#include "tools/gen/rack.h"
#include "tools/gen/scene.h"

#define EXIT_USAGE    2
#define COPIES_MAX    UINT64_C(1000000)
#define JOBS_MAX      256u
#define TRIANGLES_MAX UINT64_C(10000000000)
#define SEED_DEFAULT  1

static void print_help(void)
{
	(void)puts(
		"Usage: oocgen plant --triangles N [OPTION]... -o F.ply\n"
		"       oocgen scene NAME --triangles N [OPTION]... -o F.ply\n"
		"       oocgen rack [OPTION]... -o LIST.csv FOLDER|MODEL...\n"
		"Makes scenes: a power plant of any size, small scenes for tests, and lists that store\n"
		"the models of folders on shelves.  The same seed makes the same bytes.\n"
		"\n"
		"  -o, --output=FILE   where it goes; `-' is standard output (not of rack)\n"
		"      --seed=S        another scene of the same kind (1)\n"
		"      --json          say what was made as JSON\n"
		"\n"
		"plant and scene\n"
		"      --triangles=N   how many; a plant needs 10000\n"
		"      --origin=X,Y,Z  move the scene there, and write double positions\n"
		"      --no-colours    positions alone\n"
		"\n"
		"rack\n"
		"      --copies=N      each model so many times (1)\n"
		"      --up=x|y|z      which way is up in the models (as they say, else z)\n"
		"      --jobs=N        threads that read models (one a processor)\n"
		"\n"
		"Scenes:");
	for (const struct scene_kind *kind = scene_kinds; kind->name; kind++)
		(void)printf("  %-10s%s\n", kind->name, kind->summary);
	(void)puts(
		"\n"
		"Examples:\n"
		"  oocgen plant --triangles 1000000 -o plant.ply\n"
		"  oocgen plant --triangles 100000000 -o - | oocbuild -o plant.ooc /dev/stdin\n"
		"  oocgen scene fence --triangles 50000 --origin 1e7,1e7,0 -o fence.ply\n"
		"  oocgen rack --copies 4 -o parts.csv ~/parts && oocbuild -o parts.ooc parts.csv");
}

static int usage(const char *what, const char *value)
{
	log_error("%s%s%s: `oocgen --help` shows how", what, value ? ": " : "", value ? value : "");
	return EXIT_USAGE;
}

enum verb {
	VERB_PLANT = 1,
	VERB_SCENE = 2,
	VERB_RACK = 4,
};

struct settings {
	enum verb verb;
	const char *output;
	uint64_t seed;
	bool json;
	/* plant, scene */
	uint64_t triangle_count;
	struct vec3 origin;
	bool doubles;
	bool colours;
	const struct scene_kind *scene_kind;
	/* rack */
	uint64_t copy_count;
	enum store_axis up_axis;
	uint64_t jobs;
	char **arguments;
	size_t argument_count;
};

enum long_option {
	OPTION_TRIANGLES = 256,
	OPTION_SEED,
	OPTION_ORIGIN,
	OPTION_NO_COLOURS,
	OPTION_COPIES,
	OPTION_UP,
	OPTION_JOBS,
	OPTION_JSON,
};

static const struct option long_options[] = {
	{ "output", required_argument, NULL, 'o' },
	{ "triangles", required_argument, NULL, OPTION_TRIANGLES },
	{ "seed", required_argument, NULL, OPTION_SEED },
	{ "origin", required_argument, NULL, OPTION_ORIGIN },
	{ "no-colours", no_argument, NULL, OPTION_NO_COLOURS },
	{ "copies", required_argument, NULL, OPTION_COPIES },
	{ "up", required_argument, NULL, OPTION_UP },
	{ "jobs", required_argument, NULL, OPTION_JOBS },
	{ "json", no_argument, NULL, OPTION_JSON },
	{ "help", no_argument, NULL, 'h' },
	{ "version", no_argument, NULL, 'V' },
	{ NULL, 0, NULL, 0 },
};

/* ---- the command line ---- */

static int parse_number(const char *option, uint64_t low, uint64_t high, uint64_t *ret)
{
	uint64_t value;

	if (text_to_u64(optarg, &value) == 0 && value >= low && value <= high) {
		*ret = value;
		return 0;
	}
	log_error("--%s %s: a whole number from %" PRIu64 " to %" PRIu64 " is wanted", option,
		  optarg, low, high);
	return -EINVAL;
}

static int parse_origin(struct settings *settings)
{
	double values[3];
	char text[256];
	char *next = text;

	if (strlen(optarg) < sizeof(text)) {
		strcpy(text, optarg);
		for (int i = 0; i < 3; i++) {
			char *value = strsep(&next, ",");

			if (!value || text_to_double(value, &values[i]) < 0)
				break;
			if (i == 2 && !next) {
				settings->origin = (struct vec3){ values[0], values[1], values[2] };
				settings->doubles = true;
				return 0;
			}
		}
	}
	log_error("--origin %s: three numbers with commas between are wanted", optarg);
	return -EINVAL;
}

static int parse_up(struct settings *settings)
{
	if (strlen(optarg) != 1 || optarg[0] < 'x' || optarg[0] > 'z') {
		log_error("--up %s: x, y or z is wanted", optarg);
		return -EINVAL;
	}
	settings->up_axis = STORE_AXIS_X + (unsigned)(optarg[0] - 'x');
	return 0;
}

/* Which verbs an option is for. */
static unsigned option_verbs(int option)
{
	switch (option) {
	case OPTION_TRIANGLES:
	case OPTION_ORIGIN:
	case OPTION_NO_COLOURS:
		return VERB_PLANT | VERB_SCENE;
	case OPTION_COPIES:
	case OPTION_UP:
	case OPTION_JOBS:
		return VERB_RACK;
	}
	return VERB_PLANT | VERB_SCENE | VERB_RACK;
}

static int parse_option(struct settings *settings, int option)
{
	switch (option) {
	case 'o':
		settings->output = optarg;
		return 0;
	case OPTION_TRIANGLES:
		return parse_number("triangles", 1, TRIANGLES_MAX, &settings->triangle_count);
	case OPTION_SEED:
		return parse_number("seed", 0, UINT64_MAX, &settings->seed);
	case OPTION_ORIGIN:
		return parse_origin(settings);
	case OPTION_NO_COLOURS:
		settings->colours = false;
		return 0;
	case OPTION_COPIES:
		return parse_number("copies", 1, COPIES_MAX, &settings->copy_count);
	case OPTION_UP:
		return parse_up(settings);
	case OPTION_JOBS:
		return parse_number("jobs", 1, JOBS_MAX, &settings->jobs);
	case OPTION_JSON:
		settings->json = true;
		return 0;
	}
	return -EINVAL;
}

static int find_verb(const char *name, enum verb *ret)
{
	static const struct {
		const char *name;
		enum verb verb;
	} verbs[] = { { "plant", VERB_PLANT }, { "scene", VERB_SCENE }, { "rack", VERB_RACK } };

	for (size_t i = 0; i < ARRAY_LENGTH(verbs); i++) {
		if (strcmp(verbs[i].name, name) == 0) {
			*ret = verbs[i].verb;
			return 0;
		}
	}
	return -ENOENT;
}

/* What the verb needs and does not have.  Returns: 0 or EXIT_USAGE. */
static int judge_settings(struct settings *settings)
{
	uint64_t least = settings->verb == VERB_PLANT ? PLANT_TRIANGLES_MIN : SCENE_TRIANGLES_MIN;

	if (settings->verb == VERB_SCENE && settings->argument_count > 0) {
		settings->scene_kind = scene_find(settings->arguments[0]);
		if (!settings->scene_kind)
			return usage("no such scene", settings->arguments[0]);
		settings->arguments++;
		settings->argument_count--;
	} else if (settings->verb == VERB_SCENE) {
		return usage("no scene is named", NULL);
	}
	if (!settings->output)
		return usage("no output: give -o FILE", NULL);
	if (settings->verb == VERB_RACK) {
		if (settings->argument_count == 0)
			return usage("no folder to take models from", NULL);
		if (strcmp(settings->output, "-") == 0)
			return usage("a list names files beside it: give -o LIST.csv", NULL);
		return 0;
	}
	if (settings->argument_count > 0)
		return usage("too much on the command line", settings->arguments[0]);
	if (settings->triangle_count < least) {
		log_error("--triangles: at least %" PRIu64 " are wanted", least);
		return EXIT_USAGE;
	}
	return 0;
}

/* ---- the verbs ---- */

static int run_mesh(const struct settings *settings, struct why *why)
{
	uint64_t begin_ns = clock_now_ns();
	bool is_plant = settings->verb == VERB_PLANT;
	struct mesh_file file = { .path = settings->output,
				  .metres = true,
				  .shift = settings->origin,
				  .doubles = settings->doubles,
				  .colours = settings->colours };
	struct scene scene = { settings->scene_kind, settings->triangle_count, settings->seed };
	static struct plant plant;
	struct mesh_count count;
	char description[128];
	int r;

	(void)snprintf(
		description, sizeof(description), "%s --triangles %" PRIu64 " --seed %" PRIu64,
		is_plant ? "plant" : scene.kind->name, settings->triangle_count, settings->seed);
	file.description = description;
	if (is_plant) {
		plant_init(&plant, settings->triangle_count, settings->seed);
		r = mesh_write_file(&file, plant_scene, &plant, &count, why);
	} else {
		r = mesh_write_file(&file, scene_make, &scene, &count, why);
	}
	/* Standard output may be the model itself. */
	if (r == 0 && settings->json)
		(void)fprintf(strcmp(settings->output, "-") == 0 ? stderr : stdout,
			      "{\"triangles\": %" PRIu64 ", \"vertices\": %" PRIu64
			      ", \"seconds\": %.3f}\n",
			      count.triangles, count.vertices,
			      (double)(clock_now_ns() - begin_ns) / (double)NS_PER_S);
	return r;
}

static int run_rack(const struct settings *settings, struct why *why)
{
	uint64_t begin_ns = clock_now_ns();
	const struct rack_wish wish = { .arguments = settings->arguments,
					.argument_count = settings->argument_count,
					.list_path = settings->output,
					.seed = settings->seed,
					.copy_count = settings->copy_count,
					.up_axis = settings->up_axis,
					.jobs = (unsigned)settings->jobs };
	struct rack_report report;
	double seconds;
	int r = rack_write(&wish, &report, why);

	if (r < 0)
		return r;
	seconds = (double)(clock_now_ns() - begin_ns) / (double)NS_PER_S;
	if (settings->json)
		(void)printf("{\"models\": %" PRIu64 ", \"empty\": %" PRIu64
			     ", \"unreadable\": %" PRIu64 ", \"placed\": %" PRIu64
			     ", \"triangles\": %" PRIu64 ", \"rooms\": %" PRIu64
			     ", \"seconds\": %.3f}\n",
			     report.models, report.empty, report.unreadable, report.placed,
			     report.triangles, report.rooms, seconds);
	else
		log_info("%s: %" PRIu64 " models of %" PRIu64 " triangles placed in %" PRIu64
			 " rooms, %" PRIu64 " left out without triangles, %" PRIu64
			 " unreadable (%.1f s)",
			 settings->output, report.placed, report.triangles, report.rooms,
			 report.empty, report.unreadable, seconds);
	return 0;
}

static int run(const struct settings *settings)
{
	struct why why = { "" };
	int r = settings->verb == VERB_RACK ? run_rack(settings, &why) : run_mesh(settings, &why);

	if (r < 0) {
		log_error("%s", why.text);
		return EXIT_FAILURE;
	}
	if (fflush(stdout) != 0) {
		log_error("standard output: %s", strerror(errno));
		return EXIT_FAILURE;
	}
	return EXIT_SUCCESS;
}

int main(int argc, char **argv)
{
	static char program[] = "oocgen";
	long processors = sysconf(_SC_NPROCESSORS_ONLN);
	struct settings settings = { .seed = SEED_DEFAULT,
				     .colours = true,
				     .copy_count = 1,
				     .jobs = processors > 0 && processors <= JOBS_MAX
						     ? (uint64_t)processors
						     : 1 };
	int option;
	int r;

	log_init(program, LOG_LEVEL_INFO);
	interrupt_catch();
	/* getopt_long() puts it in front of what it says. */
	argv[0] = program;
	if (argc > 1 && argv[1][0] != '-') {
		if (find_verb(argv[1], &settings.verb) < 0)
			return usage("no such verb", argv[1]);
		argv[1] = program;
		argv++;
		argc--;
	}
	while ((option = getopt_long(argc, argv, "o:hV", long_options, NULL)) != -1) {
		if (option == 'h') {
			print_help();
			return EXIT_SUCCESS;
		}
		if (option == 'V') {
			(void)puts("oocgen " OOCD_VERSION);
			return EXIT_SUCCESS;
		}
		if (option == '?')
			return EXIT_USAGE;
		if (settings.verb != 0 && !(option_verbs(option) & settings.verb))
			return usage("not an option of this verb", argv[optind - 1]);
		if (parse_option(&settings, option) < 0)
			return EXIT_USAGE;
	}
	if (settings.verb == 0)
		return usage("no verb", NULL);
	settings.arguments = argv + optind;
	settings.argument_count = (size_t)(argc - optind);
	r = judge_settings(&settings);
	return r != 0 ? r : run(&settings);
}
