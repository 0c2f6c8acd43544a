/* SPDX-License-Identifier: MIT */
/* oocbench path: camera paths through or around a store, as CSV. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "tools/bench/base/arguments.h"
#include "tools/bench/base/report.h"
#include "tools/bench/base/verb.h"
#include "tools/bench/bench.h"
#include "tools/bench/path/path.h"

#define FRAMES_MAX 1000000u

struct path_options {
	const char *store;
	const char *output; /* NULL: standard output */
	unsigned kind;      /* enum path_kind */
	uint64_t frame_count;
	uint64_t seed;
	bool is_json;
};

static const char help[] =
	"Usage: oocbench path STORE [--kind KIND] [--frames N] [--seed S] [-o P.csv]\n"
	"Makes a camera path, a row a frame at 30 frames a second.\n"
	"\n"
	"  --kind walk   on the floors of the model, at eye height, through doors and out of the\n"
	"                walls, from one far room to the next (the default)\n"
	"  --kind orbit  once around the whole model\n"
	"  --kind fly    over it in a curve, looking ahead and down\n"
	"  --kind teleport   a walk cut into pieces of a second, in any order\n"
	"  --kind reversal   a walk that turns on its heel: three seconds on, two back\n"
	"  --frames N    how many (600)\n"
	"  --seed S      another way for another S (1)\n"
	"  -o, --output FILE   where to (standard output)\n"
	"  --json        a summary on standard output, so -o is needed\n"
	"\n"
	"Example:\n"
	"  oocbench path plant.ooc --kind walk --frames 900 --seed 2 -o walk.csv\n"
	"  oocview plant.ooc --path walk.csv\n";

static void path_report(const struct path_options *options, const struct path *result)
{
	struct report report;
	double length = 0.0;

	for (size_t i = 1; i < result->camera_count; i++) {
		const double *a = result->cameras[i - 1].eye;
		const double *b = result->cameras[i].eye;

		length += sqrt((b[0] - a[0]) * (b[0] - a[0]) + (b[1] - a[1]) * (b[1] - a[1]) +
			       (b[2] - a[2]) * (b[2] - a[2]));
	}
	report_begin(&report, true);
	report_text(&report, "path", "", options->output);
	report_number(&report, "frames", "", (double)result->camera_count, "");
	report_number(&report, "length", "", length, "");
	report_number(&report, "storey", "", result->storey, "");
	report_end(&report);
}

int verb_path(int argc, char **argv)
{
	struct path_options options = { .frame_count = 600, .seed = 1 };
	struct path result = { .cameras = NULL };
	const struct argument table[] = {
		{ "kind", ARGUMENT_CHOICE, &options.kind, .choices = path_kinds },
		{ "frames", ARGUMENT_NUMBER, &options.frame_count, 1, FRAMES_MAX },
		{ "seed", ARGUMENT_NUMBER, &options.seed },
		{ "output", ARGUMENT_TEXT, &options.output, .letter = 'o' },
		{ "json", ARGUMENT_FLAG, &options.is_json },
		{ NULL },
	};
	const struct arguments arguments = { "path", help, table, 1, 1, "name one store" };
	char **operands;
	struct why why = { "" };
	int r;

	r = arguments_parse(&arguments, argc, argv, &operands);
	if (r != ARGUMENTS_OK)
		return r;
	options.store = operands[0];
	if (options.is_json && !options.output)
		return verb_usage_error("path", "--json needs -o, for both go to standard output");

	r = path_make(options.store, options.kind, options.frame_count, options.seed, &result,
		      &why);
	if (r == 0)
		r = path_write(options.output, result.cameras, result.camera_count, &why);
	if (r == 0 && options.is_json)
		path_report(&options, &result);
	path_done(&result);
	return verb_status("path", r, &why);
}
