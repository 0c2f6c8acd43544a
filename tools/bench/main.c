/* SPDX-License-Identifier: MIT */
/* oocbench: measures the other programs, and makes what measuring needs. */
#include <stdio.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/log.h"
#include "tools/bench/base/measure.h"
#include "tools/bench/bench.h"

static const struct verb {
	const char *name;
	int (*run)(int argc, char **argv);
	const char *summary;
} verbs[] = {
	{ "path", verb_path, "makes a camera path through or around a store" },
	{ "select", verb_select, "compares sets of nodes with what shows exactly" },
	{ "walk", verb_walk, "goes along a path and says what fetching and looking ahead give" },
	{ "chart", verb_chart, "charts accuracy against speed, and finds the knee" },
	{ "exact", verb_exact, "proves pictures of a store equal to those of its input" },
	{ "record", verb_record, "records the trace of viewers that go along camera paths" },
	{ "replay", verb_replay, "asks the cache again, with other policies and sizes" },
	{ "fetch", verb_fetch, "measures cold fetches against what the disk gives" },
	{ "cache", verb_cache, "measures the cache against mmap, pread, LMDB and memcached" },
	{ "build", verb_build, "measures builds against what the disk takes" },
	{ "stress", verb_stress, "kills clients of a crowd and looks at what the living notice" },
	{ "soak", verb_soak, "kills clients and daemons for hours, while reads fail" },
};

static void help(void)
{
	puts("Usage: oocbench VERB [OPTION]...\n"
	     "Measures oocbuild, oocd and oocview.\n"
	     "\n"
	     "Verbs (each has --help and --json):");
	for (size_t i = 0; i < ARRAY_LENGTH(verbs); i++)
		printf("  %-8s %s\n", verbs[i].name, verbs[i].summary);
	puts("\n"
	     "  -h, --help     this text\n"
	     "  -V, --version  version\n"
	     "\n"
	     "Examples:\n"
	     "  oocbench path plant.ooc --kind walk --frames 600 --seed 1 -o walk.csv\n"
	     "  oocbench exact plant.ooc plant.ply --views 25\n"
	     "  oocbench fetch plant.ooc\n"
	     "  oocbench cache plant.ooc\n"
	     "  oocbench build --triangles 13000000");
}

int main(int argc, char **argv)
{
	log_init("oocbench", LOG_LEVEL_INFO);
	if (argc < 2) {
		log_error("which verb? oocbench --help lists them");
		return 2;
	}
	if (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0) {
		help();
		return 0;
	}
	if (strcmp(argv[1], "--version") == 0 || strcmp(argv[1], "-V") == 0) {
		puts("oocbench " OOCD_VERSION);
		return 0;
	}
	measure_catch_signals();
	for (size_t i = 0; i < ARRAY_LENGTH(verbs); i++)
		if (strcmp(argv[1], verbs[i].name) == 0)
			return verbs[i].run(argc - 1, argv + 1);
	log_error("%s: no such verb; oocbench --help lists them", argv[1]);
	return 2;
}
