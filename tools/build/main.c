/* SPDX-License-Identifier: MIT */
/* oocbuild: model files in, one store out. */
#include <errno.h>
#include <malloc.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>

#include "formats/base/bytes.h"
#include "formats/base/log.h"
#include "tools/build/options.h"
#include "tools/build/summary.h"

#define EXIT_USAGE 2

static struct crew crew;

static void on_signal(int number)
{
	(void)number;
	crew_stop(&crew);
}

static void catch_signals(void)
{
	struct sigaction action = { .sa_handler = on_signal };

	(void)sigemptyset(&action.sa_mask);
	(void)sigaction(SIGINT, &action, NULL);
	(void)sigaction(SIGTERM, &action, NULL);
	(void)sigaction(SIGHUP, &action, NULL);
	/* A full disk and a limit on a file's size are both an error of write(). */
	(void)signal(SIGXFSZ, SIG_IGN);
}

/* What was freed shall be free: the bound of memory is one of resident pages. */
static void tame_malloc(void)
{
	(void)mallopt(M_MMAP_THRESHOLD, (int)(256 * KIB));
	(void)mallopt(M_TRIM_THRESHOLD, (int)MIB);
	(void)mallopt(M_ARENA_MAX, 2);
}

int main(int argc, char **argv)
{
	struct options options;
	struct build_report report;
	struct why why = { 0 };
	int r;

	log_init("oocbuild", LOG_LEVEL_INFO);
	r = options_parse(argc, argv, &options, &why);
	if (r < 0) {
		log_error("%s; oocbuild --help says more", why.text);
		return EXIT_USAGE;
	}
	if (options.help) {
		options_print_help();
		return EXIT_SUCCESS;
	}
	if (options.version) {
		(void)printf("oocbuild %s\n", OOCD_VERSION);
		return EXIT_SUCCESS;
	}
	tame_malloc();
	crew_init(&crew, options.build.jobs);
	catch_signals();
	r = build_run(&options.build, &crew, &report, &why);
	crew_done(&crew);
	if (r < 0) {
		log_error("%s", r == -ECANCELED ? "interrupted: no store was made" : why.text);
		return EXIT_FAILURE;
	}
	if (report.triangles_stored == 0)
		log_warning("%s: the store is empty: the input has no triangle with an area",
			    options.build.output);
	if (options.json)
		summary_print_json(&options.build, &report, stdout);
	else if (!options.quiet)
		summary_print(&options.build, &report, stdout);
	if (fflush(stdout) != 0) {
		log_error("standard output: cannot write the summary");
		return EXIT_FAILURE;
	}
	return EXIT_SUCCESS;
}
