/* SPDX-License-Identifier: MIT */
#include "viewer/view_options.h"

#include <errno.h>
#include <getopt.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/log.h"
#include "formats/base/text.h"
#include "viewer/camera_path.h"
#include "viewer/image.h"

#define BUDGET_DEFAULT         1000000u
#define PREFETCH_BYTES_DEFAULT (UINT64_C(2) << 20)
#define DEADLINE_MS_DEFAULT    33.0
#define REPEAT_MAX             1000000u
#define FPS_MIN                0.1
#define FPS_MAX                1000.0
#define MS_MAX                 3.6e6
#define MS_A_S                 1000.0

static const char help[] =
	"Usage: oocview [OPTION]... STORE.ooc|MODEL...\n"
	"Draws models of any size out of the cache that the oocd daemon keeps in memory.\n"
	"A MODEL (PLY, OBJ, STL, VRML, ..., a folder or a scene list) is built into a store in your\n"
	"cache folder first, and that store is used again while the model is unchanged.\n"
	"\n"
	"What is drawn:\n"
	"      --mode full|approximate|conservative\n"
	"                            all that is in view, what most likely shows, or what shows (full)\n"
	"      --budget N            triangles a frame with --mode approximate (1000000)\n"
	"      --fps N               approximate, with the budget that N frames a second leave here\n"
	"      --error PERCENT       the cheapest way that shows at most so many of the covered pixels\n"
	"                            wrong, as `oocbench chart` has measured for this store\n"
	"      --order NAME          what goes first there: layer, solidity, extinction,\n"
	"                            transmittance, distance, coverage or auto (auto)\n"
	"      --visibility NAME     how --mode conservative tests: items, queries or software (items)\n"
	"      --deadline MS         how long a frame waits there, in all, for what shows and is not\n"
	"                            there; then it is drawn without (33, or one frame of --fps)\n"
	"      --query-latency MS    as if occlusion queries were answered so late (0)\n"
	"      --prefetch SIZE       what a frame may ask for ahead of the camera; 0 for nothing\n"
	"                            (2M in a window, else 0)\n"
	"      --preset NAME         iwalk-2002 or iwalk-2003: a published configuration, which\n"
	"                            other options change\n"
	"      --camera ROW|FILE     t,eye_x,eye_y,eye_z,at_x,at_y,at_z,up_x,up_y,up_z,fov_y,\n"
	"                            or a path file, whose first row counts (the whole model)\n"
	"      --path FILE           a frame for each row of a path file\n"
	"      --speed N             along the path: 16 leaves rows out, 1/4 adds some between (1)\n"
	"      --repeat N            the path so many times (1)\n"
	"\n"
	"How it is drawn:\n"
	"      --headless            no window; pictures are always settled unless there is a path\n"
	"      --size WxH            of the picture or window, up to 65536x65536 (1280x720)\n"
	"      --background RRGGBB   (e9ebee)\n"
	"      --unlit               colours as they are\n"
	"      --channel NAME        colour, part, node, triangle, depth or normal (colour)\n"
	"      --settle              wait for all nodes before a picture is taken\n"
	"      --gpu-cache SIZE      copy nodes to the GPU, at most SIZE; without it they are drawn\n"
	"                            where the daemon keeps them, if the driver can (else 256M)\n"
	"\n"
	"What is written:\n"
	"      --screenshot FILE     the last picture: .png, or .raw with the channel's own values\n"
	"      --frames FOLDER       a PNG for each row of the path: frame_000000.png, ...\n"
	"      --record FILE         the camera of each frame, as a path file\n"
	"      --stats FILE          CSV, a row a frame\n"
	"      --json                a summary on standard output\n"
	"\n"
	"      --socket PATH         of the daemon; one is started where none runs\n"
	"  -h, --help                this text\n"
	"  -V, --version             version\n"
	"\n"
	"In a window H lists the keys.\n"
	"\n"
	"Examples:\n"
	"  oocview plant.ooc\n"
	"  oocview engine.ply\n"
	"  oocview --headless --size 1920x1080 --screenshot plant.png plant.ooc\n"
	"  oocview --headless --settle --path walk.csv --frames film --stats walk-stats.csv plant.ooc\n";

enum option_key {
	OPTION_MODE = 256,
	OPTION_BUDGET,
	OPTION_FPS,
	OPTION_ERROR,
	OPTION_ORDER,
	OPTION_VISIBILITY,
	OPTION_DEADLINE,
	OPTION_QUERY_LATENCY,
	OPTION_PREFETCH,
	OPTION_PRESET,
	OPTION_SPEED,
	OPTION_CAMERA,
	OPTION_PATH,
	OPTION_REPEAT,
	OPTION_HEADLESS,
	OPTION_SIZE,
	OPTION_BACKGROUND,
	OPTION_UNLIT,
	OPTION_CHANNEL,
	OPTION_SETTLE,
	OPTION_GPU_CACHE,
	OPTION_SCREENSHOT,
	OPTION_FRAMES,
	OPTION_RECORD,
	OPTION_STATS,
	OPTION_JSON,
	OPTION_SOCKET,
};

static const struct option long_options[] = {
	{ "mode", required_argument, NULL, OPTION_MODE },
	{ "budget", required_argument, NULL, OPTION_BUDGET },
	{ "fps", required_argument, NULL, OPTION_FPS },
	{ "error", required_argument, NULL, OPTION_ERROR },
	{ "order", required_argument, NULL, OPTION_ORDER },
	{ "visibility", required_argument, NULL, OPTION_VISIBILITY },
	{ "deadline", required_argument, NULL, OPTION_DEADLINE },
	{ "query-latency", required_argument, NULL, OPTION_QUERY_LATENCY },
	{ "prefetch", required_argument, NULL, OPTION_PREFETCH },
	{ "preset", required_argument, NULL, OPTION_PRESET },
	{ "speed", required_argument, NULL, OPTION_SPEED },
	{ "camera", required_argument, NULL, OPTION_CAMERA },
	{ "path", required_argument, NULL, OPTION_PATH },
	{ "repeat", required_argument, NULL, OPTION_REPEAT },
	{ "headless", no_argument, NULL, OPTION_HEADLESS },
	{ "size", required_argument, NULL, OPTION_SIZE },
	{ "background", required_argument, NULL, OPTION_BACKGROUND },
	{ "unlit", no_argument, NULL, OPTION_UNLIT },
	{ "channel", required_argument, NULL, OPTION_CHANNEL },
	{ "settle", no_argument, NULL, OPTION_SETTLE },
	{ "gpu-cache", required_argument, NULL, OPTION_GPU_CACHE },
	{ "screenshot", required_argument, NULL, OPTION_SCREENSHOT },
	{ "frames", required_argument, NULL, OPTION_FRAMES },
	{ "record", required_argument, NULL, OPTION_RECORD },
	{ "stats", required_argument, NULL, OPTION_STATS },
	{ "json", no_argument, NULL, OPTION_JSON },
	{ "socket", required_argument, NULL, OPTION_SOCKET },
	{ "help", no_argument, NULL, 'h' },
	{ "version", no_argument, NULL, 'V' },
	{ NULL, 0, NULL, 0 },
};

/* What the options said that has to be judged together, or needs a file to be read. */
struct given {
	const char *camera;
	const char *path;
	double speed;
	bool has_mode;
	bool has_budget;
	bool has_deadline;
	bool has_prefetch;
};

static int to_size(const char *text, struct picture_size *ret)
{
	const char *times = strchr(text, 'x');
	uint64_t width;
	uint64_t height;
	char head[16];

	if (!times || (size_t)(times - text) >= sizeof(head))
		return -EINVAL;
	(void)snprintf(head, sizeof(head), "%.*s", (int)(times - text), text);
	if (text_to_u64(head, &width) < 0 || text_to_u64(times + 1, &height) < 0)
		return -EINVAL;
	if (width == 0 || height == 0 || width > PICTURE_SIDE_MAX || height > PICTURE_SIDE_MAX)
		return -ERANGE;
	*ret = (struct picture_size){ .width = (uint32_t)width, .height = (uint32_t)height };
	return 0;
}

static int to_colour(const char *text, uint8_t ret[3])
{
	unsigned long value;

	if (strlen(text) != 6 || strspn(text, "0123456789abcdefABCDEF") != 6)
		return -EINVAL;
	value = strtoul(text, NULL, 16);
	ret[0] = (uint8_t)(value >> 16);
	ret[1] = (uint8_t)(value >> 8);
	ret[2] = (uint8_t)value;
	return 0;
}

static int to_mode(const char *text, enum world_mode *ret)
{
	if (strcmp(text, "full") == 0)
		*ret = WORLD_MODE_FULL;
	else if (strcmp(text, "approximate") == 0)
		*ret = WORLD_MODE_APPROXIMATE;
	else if (strcmp(text, "conservative") == 0)
		*ret = WORLD_MODE_CONSERVATIVE;
	else
		return -EINVAL;
	return 0;
}

static int to_visibility(const char *text, enum frame_visibility *ret)
{
	for (enum frame_visibility i = 0; i < FRAME_VISIBILITY_COUNT_; i++) {
		if (strcmp(text, frame_visibility_name(i)) == 0) {
			*ret = i;
			return 0;
		}
	}
	return -EINVAL;
}

static int to_ms(const char *text, double *ret)
{
	int r = text_to_double(text, ret);

	if (r < 0)
		return r;
	return *ret >= 0.0 && *ret <= MS_MAX ? 0 : -ERANGE;
}

static int to_percent(const char *text, double *ret)
{
	int r = text_to_double(text, ret);

	if (r < 0)
		return r;
	return *ret >= 0.0 && *ret <= 100.0 ? 0 : -ERANGE;
}

static int to_fps(const char *text, double *ret)
{
	int r = text_to_double(text, ret);

	if (r < 0)
		return r;
	return *ret >= FPS_MIN && *ret <= FPS_MAX ? 0 : -ERANGE;
}

/* How many nodes, and which. */
static int take_choice(struct options *options, struct given *given, int key, const char *value)
{
	switch (key) {
	case OPTION_MODE:
		given->has_mode = true;
		return to_mode(value, &options->style.choice.mode);
	case OPTION_BUDGET:
		given->has_budget = true;
		return text_to_u64(value, &options->style.choice.budget_triangles);
	case OPTION_FPS:
		return to_fps(value, &options->fps);
	case OPTION_ERROR:
		return to_percent(value, &options->error_percent);
	case OPTION_ORDER:
		return select_order_find(value, &options->style.choice.order);
	case OPTION_VISIBILITY:
		return to_visibility(value, &options->style.visibility);
	case OPTION_DEADLINE:
		given->has_deadline = true;
		return to_ms(value, &options->style.deadline_ms);
	case OPTION_QUERY_LATENCY:
		return to_ms(value, &options->style.query_latency_ms);
	case OPTION_PREFETCH:
		given->has_prefetch = true;
		return text_to_size(value, &options->prefetch_bytes);
	case OPTION_PRESET:
		/* It has been taken before all others (take_preset()). */
		return options->preset ? 0 : -EINVAL;
	default:
		return -ENOENT;
	}
}

static int take_style(struct options *options, int key, const char *value)
{
	int r;

	switch (key) {
	case OPTION_BACKGROUND:
		return to_colour(value, options->style.background);
	case OPTION_UNLIT:
		options->style.unlit = true;
		return 0;
	case OPTION_CHANNEL:
		r = channel_from_name(value);
		if (r >= 0)
			options->style.channel = (enum channel)r;
		return r < 0 ? r : 0;
	default:
		return -ENOENT;
	}
}

static int take_output(struct options *options, int key, const char *value)
{
	switch (key) {
	case OPTION_SCREENSHOT:
		options->screenshot_path = value;
		return image_check_name(value, NULL);
	case OPTION_FRAMES:
		options->frames_folder = value;
		return 0;
	case OPTION_RECORD:
		options->record_path = value;
		return 0;
	case OPTION_STATS:
		options->stats_path = value;
		return 0;
	case OPTION_JSON:
		options->wants_json = true;
		return 0;
	default:
		return -ENOENT;
	}
}

/* Returns: 0, or negative when the value is none of the option's. */
static int take(struct options *options, struct given *given, int key, const char *value)
{
	uint64_t count;
	int r;

	switch (key) {
	case OPTION_CAMERA:
		given->camera = value;
		return 0;
	case OPTION_PATH:
		given->path = value;
		return 0;
	case OPTION_SPEED:
		return camera_path_speed(value, &given->speed);
	case OPTION_REPEAT:
		r = text_to_u64(value, &count);
		if (r < 0 || count == 0 || count > REPEAT_MAX)
			return -EINVAL;
		options->repeat_count = (uint32_t)count;
		return 0;
	case OPTION_HEADLESS:
		options->is_headless = true;
		return 0;
	case OPTION_SETTLE:
		options->is_settled = true;
		return 0;
	case OPTION_SIZE:
		options->has_size = true;
		return to_size(value, &options->size);
	case OPTION_GPU_CACHE:
		r = text_to_size(value, &options->gpu_cache_bytes);
		return r == 0 && options->gpu_cache_bytes == 0 ? -EINVAL : r;
	case OPTION_SOCKET:
		options->socket_path = value;
		return 0;
	default:
		r = take_choice(options, given, key, value);
		if (r == -ENOENT)
			r = take_style(options, key, value);
		return r == -ENOENT ? take_output(options, key, value) : r;
	}
}

static int wrong(const char *format, const char *value)
{
	log_error(format, value);
	return -EINVAL;
}

/* Do the options go together? */
static int judge(const struct options *options, const struct given *given)
{
	if (options->input_count == 0)
		return wrong("%s: name a store or a model; --help says more", "nothing to draw");
	if (given->camera && given->path)
		return wrong("%s do not go together", "--camera and --path");
	if (options->fps > 0.0 && given->has_budget)
		return wrong("%s do not go together: the frame rate sets the budget",
			     "--fps and --budget");
	if (options->error_percent >= 0.0 &&
	    (given->has_mode || given->has_budget || options->fps > 0.0))
		return wrong("%s do not go together: the chart says how it is drawn",
			     "--error and --mode, --budget or --fps");
	if (options->fps > 0.0 && options->style.choice.mode == WORLD_MODE_FULL)
		return wrong("%s needs --mode approximate or conservative", "--fps");
	if (given->speed != 1.0 && !given->path)
		return wrong("%s needs --path", "--speed");
	if (options->frames_folder && !given->path)
		return wrong("%s needs --path", "--frames");
	if (options->is_headless && !options->screenshot_path && !given->path)
		return wrong("%s needs --screenshot or --path: there is nothing to show it in",
			     "--headless");
	if (options->style.channel != CHANNEL_COLOUR && !options->is_headless)
		return wrong("%s other than colour needs --headless", "--channel");
	return 0;
}

static int change_speed(struct options *options, double speed, struct why *why)
{
	struct camera *path;
	int r = camera_path_at_speed(options->path, options->path_count, speed, &path,
				     &options->path_count);

	if (r < 0)
		return why_errno(why, r, "--speed: the frames of the path");
	free(options->path);
	options->path = path;
	return 0;
}

/* One row, or the rows of a file. */
static int read_cameras(struct options *options, const struct given *given)
{
	struct why why = { "" };
	int r;

	if (!given->camera && !given->path)
		return 0;
	options->has_path = given->path != NULL;
	if (given->camera && strchr(given->camera, ',')) {
		options->path = malloc(sizeof(*options->path));
		if (!options->path) {
			r = why_errno(&why, -ENOMEM, "--camera");
		} else {
			options->path_count = 1;
			r = camera_from_row(options->path, given->camera, &why);
			why_prefix(&why, "--camera");
		}
	} else {
		r = camera_path_read(given->path ? given->path : given->camera, &options->path,
				     &options->path_count, &why);
		if (r == 0 && options->path_count == 0)
			r = why_set(&why, -EUCLEAN, "%s: the path has no row",
				    given->path ? given->path : given->camera);
	}
	if (r == 0 && given->speed != 1.0)
		r = change_speed(options, given->speed, &why);
	if (r < 0)
		log_error("%s", why.text);
	return r;
}

static const char *name_of(int key)
{
	for (const struct option *option = long_options; option->name; option++) {
		if (option->val == key)
			return option->name;
	}
	return "?";
}

/* A preset comes before all other options, wherever it stands: they change it. */
static void take_preset(struct options *options, int argc, char **argv)
{
	int key;

	opterr = 0;
	while ((key = getopt_long(argc, argv, "hV", long_options, NULL)) != -1) {
		if (key == OPTION_PRESET)
			options->preset = preset_find(optarg);
	}
	optind = 0; /* GNU: begin anew */
	if (!options->preset)
		return;
	options->style.choice.mode = WORLD_MODE_APPROXIMATE;
	options->style.choice.budget_triangles = options->preset->budget_triangles;
	options->style.choice.order = SELECT_ORDER_LAYER;
	options->prefetch_bytes = options->preset->prefetch_bytes;
	options->style.deadline_ms = MS_A_S / options->preset->fps;
	options->size.width = options->preset->width;
	options->size.height = options->preset->height;
}

enum options_verdict options_read(struct options *ret, int argc, char **argv)
{
	struct options options = {
		.size = { 1280, 720 },
		.style = { .choice = { .order = SELECT_ORDER_AUTO,
				       .budget_triangles = BUDGET_DEFAULT },
			   .deadline_ms = DEADLINE_MS_DEFAULT,
			   .background = { 0xe9, 0xeb, 0xee } },
		.error_percent = -1.0,
		.repeat_count = 1,
	};
	struct given given = { .speed = 1.0 };
	int key;

	take_preset(&options, argc, argv);
	while ((key = getopt_long(argc, argv, "hV", long_options, NULL)) != -1) {
		switch (key) {
		case 'h':
			(void)fputs(help, stdout);
			return OPTIONS_DONE;
		case 'V':
			(void)puts("oocview " OOCD_VERSION);
			return OPTIONS_DONE;
		case '?':
			log_error("%s: no such option, or its value is missing; "
				  "oocview --help says more",
				  argv[optind - 1]);
			return OPTIONS_WRONG;
		default:
			if (take(&options, &given, key, optarg) < 0) {
				log_error("--%s: \"%s\" will not do; --help says what will",
					  name_of(key), optarg ? optarg : "");
				return OPTIONS_WRONG;
			}
		}
	}
	options.inputs = argv + optind;
	options.input_count = (uint32_t)(argc - optind);
	if (options.fps > 0.0 && !given.has_mode)
		options.style.choice.mode = WORLD_MODE_APPROXIMATE;
	if (!options.is_headless && !options.preset && !given.has_prefetch)
		options.prefetch_bytes = PREFETCH_BYTES_DEFAULT;
	if (options.fps > 0.0 && !given.has_deadline)
		options.style.deadline_ms = MS_A_S / options.fps;
	if (judge(&options, &given) < 0)
		return OPTIONS_WRONG;
	if (read_cameras(&options, &given) < 0) {
		options_done(&options);
		return OPTIONS_FAILED;
	}
	/* A single picture of nothing yet would be of no use. */
	if (options.is_headless && !options.has_path)
		options.is_settled = true;
	*ret = options;
	return OPTIONS_RUN;
}

int options_take_drawing(struct options *options, const char *text)
{
	struct given ignored = { .speed = 1.0 };
	char *copy = strdup(text);
	char *rest = copy;
	char *name;
	int r = copy ? 0 : -ENOMEM;

	while (r == 0 && (name = strsep(&rest, " "))) {
		const char *value = strsep(&rest, " ");
		int key = 0;

		for (const struct option *option = long_options; option->name; option++)
			if (strncmp(name, "--", 2) == 0 && strcmp(name + 2, option->name) == 0)
				key = option->val;
		r = value && key ? take_choice(options, &ignored, key, value) : -EINVAL;
	}
	free(copy);
	return r == -ENOENT ? -EINVAL : r;
}

void options_done(struct options *options)
{
	free(options->path);
	options->path = NULL;
}

bool options_is_bounded(const struct options *options)
{
	return options->is_headless || options->screenshot_path || options->frames_folder ||
	       (options->has_path && (options->stats_path || options->wants_json));
}
