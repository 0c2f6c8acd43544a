/* SPDX-License-Identifier: MIT */
#include "tools/build/options.h"

#include <errno.h>
#include <getopt.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/text.h"
#include "formats/codec/codec.h"

/** Of the published system: Correa, Klosowski & Silva 2002, "iWalk", sec. 5. */
#define IWALK_LEAF_VERTICES 15000u

enum option_id {
	OPTION_MEMORY = 256,
	OPTION_JOBS,
	OPTION_ERROR,
	OPTION_LEAF_TRIANGLES,
	OPTION_LEAF_VERTICES,
	OPTION_PRESET,
	OPTION_LAYOUT,
	OPTION_NORMALS,
	OPTION_CREASE,
	OPTION_CODEC,
	OPTION_COLOUR,
	OPTION_UNITS,
	OPTION_UP,
	OPTION_NON_FINITE,
	OPTION_KEEP_IDS,
	OPTION_SCRATCH,
	OPTION_JSON,
	OPTION_QUIET,
	OPTION_HELP,
	OPTION_VERSION,
};

static const struct option long_options[] = {
	{ "output", required_argument, NULL, 'o' },
	{ "memory", required_argument, NULL, OPTION_MEMORY },
	{ "jobs", required_argument, NULL, OPTION_JOBS },
	{ "error", required_argument, NULL, OPTION_ERROR },
	{ "leaf-triangles", required_argument, NULL, OPTION_LEAF_TRIANGLES },
	{ "leaf-vertices", required_argument, NULL, OPTION_LEAF_VERTICES },
	{ "preset", required_argument, NULL, OPTION_PRESET },
	{ "layout", required_argument, NULL, OPTION_LAYOUT },
	{ "normals", required_argument, NULL, OPTION_NORMALS },
	{ "crease", required_argument, NULL, OPTION_CREASE },
	{ "codec", required_argument, NULL, OPTION_CODEC },
	{ "colour", required_argument, NULL, OPTION_COLOUR },
	{ "units", required_argument, NULL, OPTION_UNITS },
	{ "up", required_argument, NULL, OPTION_UP },
	{ "non-finite", required_argument, NULL, OPTION_NON_FINITE },
	{ "keep-ids", no_argument, NULL, OPTION_KEEP_IDS },
	{ "scratch", required_argument, NULL, OPTION_SCRATCH },
	{ "json", no_argument, NULL, OPTION_JSON },
	{ "quiet", no_argument, NULL, OPTION_QUIET },
	{ "help", no_argument, NULL, OPTION_HELP },
	{ "version", no_argument, NULL, OPTION_VERSION },
	{ NULL, 0, NULL, 0 },
};

/** A word that an option takes, and what it means. */
struct choice {
	const char *word;
	int value;
};

static const struct choice layouts[] = { { "unique", STORE_LAYOUT_UNIQUE },
					 { "replicate", STORE_LAYOUT_REPLICATE },
					 { NULL, 0 } };
static const struct choice normals[] = { { "flat", NORMALS_FLAT },
					 { "stored", NORMALS_STORED },
					 { "oct8", NORMALS_OCT8 },
					 { "oct16", NORMALS_OCT16 },
					 { NULL, 0 } };
static const struct choice colours[] = { { "texture", IMPORT_COLOUR_TEXTURE },
					 { "vertex", IMPORT_COLOUR_VERTEX },
					 { "material", IMPORT_COLOUR_MATERIAL },
					 { "none", IMPORT_COLOUR_NONE },
					 { NULL, 0 } };
static const struct choice axes[] = {
	{ "x", STORE_AXIS_X }, { "y", STORE_AXIS_Y }, { "z", STORE_AXIS_Z }, { NULL, 0 }
};
static const struct choice non_finites[] = { { "refuse", false }, { "drop", true }, { NULL, 0 } };

static int choose(const struct choice *choices, const char *option, const char *word, int *ret,
		  struct why *why)
{
	char all[128] = "";

	for (const struct choice *at = choices; at->word; at++) {
		size_t length = strlen(all);

		if (strcmp(at->word, word) == 0) {
			*ret = at->value;
			return 0;
		}
		(void)snprintf(all + length, sizeof(all) - length, "%s%s", length > 0 ? ", " : "",
			       at->word);
	}
	return why_set(why, -EINVAL, "--%s %s: one of %s is wanted", option, word, all);
}

static int to_number(const char *option, const char *text, uint64_t low, uint64_t high,
		     uint32_t *ret, struct why *why)
{
	uint64_t value;

	if (text_to_u64(text, &value) < 0 || value < low || value > high)
		return why_set(why, -EINVAL, "--%s %s: a number from %llu to %llu is wanted",
			       option, text, (unsigned long long)low, (unsigned long long)high);
	*ret = (uint32_t)value;
	return 0;
}

static int to_units(const char *text, double *ret, struct why *why)
{
	static const struct {
		const char *word;
		double metres;
	} units[] = { { "mm", 0.001 },  { "cm", 0.01 },   { "m", 1.0 },
		      { "in", 0.0254 }, { "ft", 0.3048 }, { "2.54mm", 0.00254 } };

	for (size_t i = 0; i < ARRAY_LENGTH(units); i++) {
		if (strcmp(units[i].word, text) == 0) {
			*ret = units[i].metres;
			return 0;
		}
	}
	if (text_to_double(text, ret) < 0 || *ret <= 0)
		return why_set(why, -EINVAL,
			       "--units %s: mm, cm, m, in, ft, 2.54mm or metres a unit is wanted",
			       text);
	return 0;
}

static int to_memory(const char *text, uint64_t *ret, struct why *why)
{
	if (text_to_size(text, ret) < 0)
		return why_set(why, -EINVAL, "--memory %s: a size such as 512M is wanted", text);
	return 0;
}

static int to_error(const char *text, double *ret, struct why *why)
{
	if (text_to_double(text, ret) < 0 || *ret < 0)
		return why_set(why, -EINVAL,
			       "--error %s: a distance in model units is wanted, 0 for exact",
			       text);
	return 0;
}

static int to_crease(const char *text, double *ret, struct why *why)
{
	if (text_to_double(text, ret) < 0 || *ret < 0 || *ret > 90)
		return why_set(why, -EINVAL, "--crease %s: degrees from 0 to 90 are wanted", text);
	return 0;
}

static int to_preset(const char *text, struct build_options *build, struct why *why)
{
	if (strcmp(text, "iwalk") != 0)
		return why_set(why, -EINVAL, "--preset %s: only iwalk is known", text);
	build->layout = STORE_LAYOUT_REPLICATE;
	build->leaf_vertices = IWALK_LEAF_VERTICES;
	build->leaf_triangles = BUILD_BUCKET_TRIANGLES;
	return 0;
}

/* Options that say how the store shall look. */
static int take_look(int id, const char *text, struct build_options *build, struct why *why)
{
	int value = 0;
	int r;

	switch (id) {
	case OPTION_ERROR:
		return to_error(text, &build->error, why);
	case OPTION_LEAF_TRIANGLES:
		return to_number("leaf-triangles", text, 1, BUILD_LEAF_TRIANGLES_MAX,
				 &build->leaf_triangles, why);
	case OPTION_LEAF_VERTICES:
		return to_number("leaf-vertices", text, 3, UINT32_MAX - 1, &build->leaf_vertices,
				 why);
	case OPTION_PRESET:
		return to_preset(text, build, why);
	case OPTION_LAYOUT:
		r = choose(layouts, "layout", text, &value, why);
		build->layout = (enum store_layout)value;
		return r;
	case OPTION_NORMALS:
		r = choose(normals, "normals", text, &value, why);
		build->normals = (enum normals_mode)value;
		return r;
	case OPTION_CREASE:
		return to_crease(text, &build->crease_degrees, why);
	case OPTION_CODEC:
		r = codec_find(text);
		if (r < 0)
			return why_set(why, -EINVAL,
				       "--codec %s: none, zstd, meshopt or meshopt+zstd is wanted",
				       text);
		build->codec = (enum store_codec)r;
		return 0;
	case OPTION_COLOUR:
		r = choose(colours, "colour", text, &value, why);
		build->colour = (enum import_colour)value;
		return r;
	case OPTION_UNITS:
		return to_units(text, &build->unit_metres, why);
	case OPTION_UP:
		r = choose(axes, "up", text, &value, why);
		build->up_axis = (enum store_axis)value;
		return r;
	case OPTION_NON_FINITE:
		r = choose(non_finites, "non-finite", text, &value, why);
		build->drop_non_finite = value;
		return r;
	case OPTION_KEEP_IDS:
		build->keep_ids = true;
		return 0;
	default:
		return 1;
	}
}

static int take(int id, const char *text, struct options *options, struct why *why)
{
	int r = take_look(id, text, &options->build, why);

	if (r <= 0)
		return r;
	switch (id) {
	case 'o':
		options->build.output = text;
		return 0;
	case OPTION_MEMORY:
		return to_memory(text, &options->build.memory_bytes, why);
	case OPTION_JOBS:
		return to_number("jobs", text, 1, BUILD_JOBS_MAX, &options->build.jobs, why);
	case OPTION_SCRATCH:
		options->build.scratch_directory = text;
		return 0;
	case OPTION_JSON:
		options->json = true;
		return 0;
	case OPTION_QUIET:
		options->quiet = true;
		return 0;
	case OPTION_HELP:
		options->help = true;
		return 0;
	case OPTION_VERSION:
		options->version = true;
		return 0;
	default:
		return why_set(why, -EINVAL, "see --help");
	}
}

/* A number at the beginning of a file; UINT64_MAX: there is none. */
static uint64_t number_in(const char *path)
{
	FILE *file = fopen(path, "re");
	unsigned long long value = UINT64_MAX;

	if (!file)
		return UINT64_MAX;
	if (fscanf(file, "%llu", &value) != 1)
		value = UINT64_MAX;
	(void)fclose(file);
	return value;
}

/* Half of the memory that is available now, and of what a container may have. */
static uint64_t default_memory(void)
{
	uint64_t limit = u64_min(number_in("/sys/fs/cgroup/memory.max"),
				 number_in("/sys/fs/cgroup/memory/memory.limit_in_bytes"));
	FILE *file = fopen("/proc/meminfo", "re");
	unsigned long long available = 0;
	char line[128];

	while (file && fgets(line, sizeof(line), file))
		if (sscanf(line, "MemAvailable: %llu kB", &available) == 1)
			break;
	if (file)
		(void)fclose(file);
	return u64_min(available > 0 ? available * KIB : 2 * GIB, limit) / 2;
}

int options_parse(int argc, char **argv, struct options *ret, struct why *why)
{
	long processors = sysconf(_SC_NPROCESSORS_ONLN);
	int id;

	*ret = (struct options){
		.build = {
			.jobs = (uint32_t)(processors < 1 ? 1
					   : processors > (long)BUILD_JOBS_MAX ? BUILD_JOBS_MAX
									       : processors),
			.error = -1,
			.leaf_triangles = BUILD_LEAF_TRIANGLES,
			.leaf_vertices = UINT32_MAX,
			.normals = NORMALS_OCT8,
			.crease_degrees = BUILD_CREASE_DEGREES,
			.codec = STORE_CODEC_NONE,
			.colour = IMPORT_COLOUR_TEXTURE,
		},
	};
	opterr = 0;
	optind = 1;
	while ((id = getopt_long(argc, argv, "o:", long_options, NULL)) != -1) {
		int r;

		if (id == '?')
			return why_set(why, -EINVAL, "%s: no such option, or its value is missing",
				       argv[optind - 1]);
		r = take(id, optarg, ret, why);
		if (r < 0)
			return r;
	}
	if (ret->help || ret->version)
		return 0;
	if (!ret->build.output)
		return why_set(why, -EINVAL, "-o STORE.ooc is missing");
	if (optind == argc)
		return why_set(why, -EINVAL,
			       "no model to build from: name files, folders or lists");
	ret->build.inputs = argv + optind;
	ret->build.input_count = (size_t)(argc - optind);
	if (ret->build.memory_bytes == 0)
		ret->build.memory_bytes = default_memory();
	ret->build.progress = !ret->quiet;
	return 0;
}

void options_print_help(void)
{
	(void)fputs(
		"Usage: oocbuild -o STORE.ooc [OPTION]... INPUT...\n"
		"Builds a store from model files, folders of them, and scene lists (CSV).\n"
		"\n"
		"  -o, --output STORE.ooc   the store; an old one is replaced when all is done\n"
		"      --memory SIZE        most memory of the whole build (half of what is available)\n"
		"      --jobs N             threads (one for each processor)\n"
		"      --scratch DIR        folder for what does not fit in memory (the output's)\n"
		"\n"
		"How the store shall look:\n"
		"      --error E            how far a position may move, in model units; 0: not at all\n"
		"                           (the model's diagonal / 2^19)\n"
		"      --leaf-triangles N   most triangles in a leaf (8192)\n"
		"      --leaf-vertices N    most vertices in a leaf (no limit)\n"
		"      --layout unique|replicate\n"
		"                           a triangle in the leaf of its centre, or in all it touches\n"
		"      --preset iwalk       as published in 2002: replicate, 15000 vertices a leaf\n"
		"      --normals oct8|oct16|stored|flat\n"
		"                           2 or 4 bytes a vertex; only what files have; none (oct8)\n"
		"      --crease DEGREES     faces that differ by less are one smooth surface (40)\n"
		"      --codec none|zstd|meshopt|meshopt+zstd\n"
		"                           how payloads lie on disk (none)\n"
		"      --colour texture|vertex|material|none\n"
		"                           which colour counts first (texture)\n"
		"      --units mm|cm|m|in|ft|2.54mm|METRES, --up x|y|z\n"
		"                           of the model, if the files do not say or say wrong\n"
		"      --non-finite refuse|drop\n"
		"                           triangles with coordinates that are no numbers (refuse)\n"
		"      --keep-ids           keep the number that each triangle has in the input\n"
		"\n"
		"      --json               the summary as JSON on standard output\n"
		"      --quiet              no progress, no summary\n"
		"      --help, --version\n"
		"\n"
		"Examples:\n"
		"  oocbuild -o plant.ooc plant.ply\n"
		"  oocbuild -o rack.ooc --memory 512M --units 2.54mm rack.csv\n"
		"  oocbuild -o exact.ooc --error 0 --codec meshopt+zstd scans/\n",
		stdout);
}
