/* SPDX-License-Identifier: MIT */
/* oocbench path: camera paths through or around a store, as CSV. */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "formats/base/log.h"
#include "formats/base/text.h"
#include "libclient/select/camera.h"
#include "tools/bench/arguments.h"
#include "tools/bench/bench.h"
#include "tools/bench/measure.h"
#include "tools/bench/occupancy.h"
#include "tools/bench/walk.h"

#define FRAMES_MAX      1000000u
#define FRAMES_A_SECOND 30.0
#define WALK_FOV        65.0
#define ORBIT_FOV       45.0
#define ORBIT_ASPECT    (16.0 / 9.0)
/** A walker looks so far ahead along the way, in storeys, and turns no faster. */
#define LOOK_AHEAD_STOREYS 0.8
#define TURN_DEGREES_MAX   4.0
/** Of the way's slope: one looks less up and down than one goes. */
#define SLOPE_SHARE 0.4

enum path_kind {
	PATH_WALK,
	PATH_ORBIT,
};

struct path_options {
	const char *store;
	const char *output; /* NULL: standard output */
	unsigned kind;      /* enum path_kind */
	uint64_t frame_count;
	uint64_t seed;
	bool is_json;
};

static const char help[] =
	"Usage: oocbench path STORE [--kind walk|orbit] [--frames N] [--seed S] [-o P.csv]\n"
	"Makes a camera path, a row a frame at 30 frames a second.\n"
	"\n"
	"  --kind walk   on the floors of the model, at eye height, through doors and out of the\n"
	"                walls, from one far room to the next (the default)\n"
	"  --kind orbit  once around the whole model\n"
	"  --frames N    how many (600)\n"
	"  --seed S      another way for another S (1)\n"
	"  -o, --output FILE   where to (standard output)\n"
	"  --json        a summary on standard output, so -o is needed\n"
	"\n"
	"Example:\n"
	"  oocbench path plant.ooc --kind walk --frames 900 --seed 2 -o walk.csv\n"
	"  oocview plant.ooc --path walk.csv\n";

/* ---- cameras ---- */

static void orbit_make(const struct store_superblock *superblock, struct camera *cameras,
		       uint64_t count)
{
	const struct store_superblock *superblocks[] = { superblock };
	unsigned up = superblock->up_axis == STORE_AXIS_UNKNOWN ? 2 : superblock->up_axis - 1;
	struct camera first;
	double from[3];

	camera_frame_all(&first, superblocks, 1, ORBIT_ASPECT, ORBIT_FOV);
	for (unsigned k = 0; k < 3; k++)
		from[k] = first.eye[k] - first.at[k];
	for (uint64_t i = 0; i < count; i++) {
		double angle = 2.0 * M_PI * (double)i / (double)count;
		unsigned a = (up + 1) % 3;
		unsigned b = (up + 2) % 3;

		cameras[i] = first;
		cameras[i].time_s = (double)i / FRAMES_A_SECOND;
		cameras[i].eye[a] = first.at[a] + cos(angle) * from[a] - sin(angle) * from[b];
		cameras[i].eye[b] = first.at[b] + sin(angle) * from[a] + cos(angle) * from[b];
	}
}

static bool normalise(double v[3])
{
	double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);

	if (!(length > 1e-9))
		return false;
	for (unsigned k = 0; k < 3; k++)
		v[k] /= length;
	return true;
}

/* Turns a direction towards another, by at most an angle; the walker stays upright. */
static void turn_towards(double direction[3], const double wanted[3], double max_radians)
{
	double now = atan2(direction[1], direction[0]);
	double difference = remainder(atan2(wanted[1], wanted[0]) - now, 2.0 * M_PI);
	double turned = now + fmax(-max_radians, fmin(max_radians, difference));
	double rise =
		direction[2] + fmax(-max_radians, fmin(max_radians, wanted[2] - direction[2]));
	double flat = sqrt(fmax(0.0, 1.0 - rise * rise));

	direction[0] = flat * cos(turned);
	direction[1] = flat * sin(turned);
	direction[2] = rise;
}

/* Where a walker at a point looks: at the way's next stretch, averaged. */
static bool look_ahead(const struct walk *walk, size_t index, double ret[3])
{
	size_t reach = (size_t)(LOOK_AHEAD_STOREYS * walk->storey / walk->spacing) + 1;

	memset(ret, 0, 3 * sizeof(*ret));
	for (size_t i = index + 1; i <= index + reach && i < walk->point_count; i++)
		for (unsigned k = 0; k < 3; k++)
			ret[k] += walk->points[i].at[k] - walk->points[index].at[k];
	ret[2] *= SLOPE_SHARE;
	return normalise(ret);
}

static void walk_look(const struct walk *walk, const struct occupancy *occupancy,
		      const struct store_superblock *superblock, struct camera *cameras)
{
	double direction[3] = { 1.0, 0.0, 0.0 };
	double wanted[3];

	(void)look_ahead(walk, 0, direction);
	for (size_t i = 0; i < walk->point_count; i++) {
		struct camera *camera = &cameras[i];
		double at[3];

		if (look_ahead(walk, i, wanted))
			turn_towards(direction, wanted, TURN_DEGREES_MAX * (M_PI / 180.0));
		for (unsigned k = 0; k < 3; k++)
			at[k] = walk->points[i].at[k] + walk->storey * direction[k];
		*camera = (struct camera){ .time_s = (double)i / FRAMES_A_SECOND,
					   .fov_y_degrees = WALK_FOV };
		camera->up[occupancy->world[2]] = 1.0;
		occupancy_to_world(occupancy, superblock, walk->points[i].at, camera->eye);
		occupancy_to_world(occupancy, superblock, at, camera->at);
	}
}

/* ---- the verb ---- */

struct path_result {
	struct camera *cameras;
	size_t camera_count;
	double storey; /* model units; 0: not a walk */
};

static int path_walk(const struct store_file *store, const struct path_options *options,
		     struct path_result *result, struct why *why)
{
	const struct store_superblock *superblock = store_superblock(store);
	struct store_node *nodes = calloc(superblock->node_count + 1, sizeof(*nodes));
	struct occupancy occupancy = { .full = NULL };
	struct walk walk = { .points = NULL };
	struct walk_site site;
	int r;

	if (!nodes)
		return why_set(why, -ENOMEM, "out of memory");
	r = store_load_hs(store, nodes, why);
	/* The whole coarsely, to find where the rooms are; then these, finely. */
	if (r == 0)
		r = occupancy_make(store, nodes, NULL, &occupancy, why);
	if (r == 0)
		r = walk_survey(&occupancy, superblock->unit_metres, options->seed, &site, why);
	occupancy_done(&occupancy);
	if (r == 0)
		r = occupancy_make(store, nodes, &site.region, &occupancy, why);
	if (r == 0)
		r = walk_make(&occupancy, site.storey, options->seed, options->frame_count, &walk,
			      why);
	if (r == 0) {
		walk_look(&walk, &occupancy, superblock, result->cameras);
		result->camera_count = walk.point_count;
		result->storey = walk.storey * occupancy.voxel;
	}
	walk_done(&walk);
	occupancy_done(&occupancy);
	free(nodes);
	return r;
}

static int path_make(const struct path_options *options, struct path_result *result,
		     struct why *why)
{
	struct store_file *store;
	int r = store_open_path(options->store, &store, why);

	if (r < 0)
		return r;
	result->cameras = calloc(options->frame_count, sizeof(*result->cameras));
	if (!result->cameras) {
		r = why_set(why, -ENOMEM, "out of memory");
	} else if (options->kind == PATH_ORBIT) {
		orbit_make(store_superblock(store), result->cameras, options->frame_count);
		result->camera_count = options->frame_count;
	} else {
		r = path_walk(store, options, result, why);
	}
	if (r < 0)
		why_prefix(why, "%s", options->store);
	store_close(store);
	return r;
}

static int path_write(const struct path_options *options, const struct path_result *result,
		      struct why *why)
{
	FILE *file = options->output ? fopen(options->output, "we") : stdout;
	bool failed;

	if (!file)
		return why_errno(why, -errno, "%s", options->output);
	fprintf(file, "%s\n", camera_path_header);
	for (size_t i = 0; i < result->camera_count; i++) {
		char row[CAMERA_ROW_BYTES];

		fprintf(file, "%s\n", camera_to_row(&result->cameras[i], row));
	}
	failed = fflush(file) != 0 || ferror(file);
	if (options->output && fclose(file) != 0)
		failed = true;
	return failed ? why_set(why, -EIO, "%s: cannot be written",
				options->output ? options->output : "standard output")
		      : 0;
}

static void path_report(const struct path_options *options, const struct path_result *result)
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
	static const char *const kinds[] = { [PATH_WALK] = "walk", [PATH_ORBIT] = "orbit", NULL };
	struct path_options options = { .frame_count = 600, .seed = 1 };
	struct path_result result = { .cameras = NULL };
	const struct argument table[] = {
		{ "kind", ARGUMENT_CHOICE, &options.kind, .choices = kinds },
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

	r = path_make(&options, &result, &why);
	if (r == 0)
		r = path_write(&options, &result, &why);
	if (r == 0 && options.is_json)
		path_report(&options, &result);
	free(result.cameras);
	if (r < 0)
		log_error("path: %s", why.text);
	return r < 0 ? 1 : 0;
}
