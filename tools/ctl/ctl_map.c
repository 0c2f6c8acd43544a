/* SPDX-License-Identifier: MIT */
/* A picture of a store's cells from above, coloured by what the cache has of them. */
#include <errno.h>
#include <png.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/log.h"
#include "libclient/select/birds_eye.h"
#include "tools/ctl/ctl_daemon.h"

#define SIDE_MAX     16384u
#define WIDTH_USUAL  1024u
#define HEIGHT_USUAL 768u

struct map_options {
	const char *output;
	const char *camera; /* a path file, whose first row counts; NULL: none */
	unsigned width;
	unsigned height;
	enum birds_eye_colouring colouring;
};

struct map {
	struct ooc_node_info *infos;
	struct birds_eye_node *nodes;
	uint32_t *scratch;
	uint8_t *rgb;
	struct camera *cameras;
	size_t counts[BIRDS_EYE_STATE_COUNT_];
};

static enum birds_eye_state state_of(const struct store_node *record,
				     const struct ooc_node_info *info)
{
	if (record->payload_id == 0)
		return BIRDS_EYE_NOTHING;
	switch (info->state) {
	case OOC_STATE_BUSY:
		return BIRDS_EYE_BUSY;
	case OOC_STATE_READY:
		return info->holds > 0 ? BIRDS_EYE_HELD : BIRDS_EYE_READY;
	case OOC_STATE_DAMAGED:
		return BIRDS_EYE_DAMAGED;
	case OOC_STATE_ABSENT:
		break;
	}
	return BIRDS_EYE_ABSENT;
}

/* Returns: CTL_OK, or CTL_FAILED, said. */
static int map_ask(const struct ctl_request *request, struct ooc_store *store, struct map *map)
{
	const struct store_node *records = ooc_nodes(store);
	uint64_t count = ooc_node_count(store);

	for (uint64_t first = 0; first < count; first += OOC_INSPECT_COUNT_MAX) {
		int told = ooc_inspect(store, (uint32_t)first, map->infos);

		if (told < 0) {
			log_error("the daemon does not tell of its nodes: %s",
				  ooc_error_text(request->client));
			return CTL_FAILED;
		}
		for (int i = 0; i < told; i++) {
			enum birds_eye_state state =
				state_of(&records[first + (uint64_t)i], &map->infos[i]);

			map->nodes[first + (uint64_t)i].state = (uint8_t)state;
			map->counts[state]++;
		}
	}
	return CTL_OK;
}

static int png_write(const struct map_options *options, const uint8_t *rgb)
{
	png_image png = { .version = PNG_IMAGE_VERSION,
			  .width = options->width,
			  .height = options->height,
			  .format = PNG_FORMAT_RGB };

	if (png_image_write_to_file(&png, options->output, 0, rgb, 0, NULL))
		return CTL_OK;
	log_error("%s: cannot be written: %s", options->output, png.message);
	return CTL_FAILED;
}

static void legend_print(const struct ctl_request *request, const struct map *map)
{
	for (unsigned state = BIRDS_EYE_ABSENT; state < BIRDS_EYE_STATE_COUNT_; state++) {
		uint8_t colour[3];

		birds_eye_state_colour((enum birds_eye_state)state, colour);
		if (request->json)
			printf("%s\"%s\": %zu", state == BIRDS_EYE_ABSENT ? "{" : ", ",
			       birds_eye_state_name((enum birds_eye_state)state),
			       map->counts[state]);
		else
			printf("#%02x%02x%02x  %-8s %8zu nodes\n", colour[0], colour[1], colour[2],
			       birds_eye_state_name((enum birds_eye_state)state),
			       map->counts[state]);
	}
	if (request->json)
		puts("}");
}

static int map_draw(const struct ctl_request *request, const struct map_options *options,
		    struct ooc_store *store, struct map *map)
{
	const struct birds_eye birds_eye = {
		.superblock = ooc_superblock(store),
		.records = ooc_nodes(store),
		.nodes = map->nodes,
		.camera = map->cameras,
		.aspect = (double)options->width / options->height,
		.colouring = options->colouring,
	};
	int status = map_ask(request, store, map);

	if (status != CTL_OK)
		return status;
	birds_eye_paint(&birds_eye, options->width, options->height, map->scratch, map->rgb);
	status = png_write(options, map->rgb);
	if (status == CTL_OK)
		legend_print(request, map);
	return status;
}

static int map_init(struct map *map, const struct map_options *options, struct ooc_store *store)
{
	size_t count = ooc_node_count(store);
	uint32_t camera_count = 0;
	struct why why;

	*map = (struct map){
		.infos = calloc(OOC_INSPECT_COUNT_MAX, sizeof(*map->infos)),
		.nodes = calloc(count + 1, sizeof(*map->nodes)),
		.scratch = calloc(count + 1, sizeof(*map->scratch)),
		.rgb = calloc((size_t)options->width * options->height, 3),
	};
	if (!map->infos || !map->nodes || !map->scratch || !map->rgb) {
		log_error("no memory for %zu nodes and %u x %u pixels", count, options->width,
			  options->height);
		return CTL_FAILED;
	}
	if (!options->camera)
		return CTL_OK;
	if (camera_path_read(options->camera, &map->cameras, &camera_count, &why) < 0) {
		log_error("%s", why.text);
		return CTL_FAILED;
	}
	if (camera_count > 0)
		return CTL_OK;
	log_error("%s: no camera in it", options->camera);
	return CTL_FAILED;
}

static void map_done(struct map *map)
{
	free(map->infos);
	free(map->nodes);
	free(map->scratch);
	free(map->rgb);
	free(map->cameras);
}

/* ---- the command line ---- */

static bool size_parse(const char *text, struct map_options *ret)
{
	char end;

	return sscanf(text, "%ux%u%c", &ret->width, &ret->height, &end) == 2 && ret->width > 0 &&
	       ret->height > 0 && ret->width <= SIDE_MAX && ret->height <= SIDE_MAX;
}

static bool colouring_parse(const char *text, enum birds_eye_colouring *ret)
{
	if (strcmp(text, birds_eye_colourings[BIRDS_EYE_BY_LEVEL]) == 0)
		*ret = BIRDS_EYE_BY_LEVEL;
	else if (strcmp(text, birds_eye_colourings[BIRDS_EYE_BY_STATE]) == 0)
		*ret = BIRDS_EYE_BY_STATE;
	else
		return false;
	return true;
}

static int parse(int argc, char **argv, struct ctl_request *request, struct map_options *ret)
{
	static const struct option options[] = {
		{ "output", required_argument, NULL, 'o' },
		{ "size", required_argument, NULL, 'z' },
		{ "colour", required_argument, NULL, 'c' },
		{ "camera", required_argument, NULL, 'a' },
		CTL_COMMON_OPTIONS,
		{ 0 },
	};
	int option;

	while ((option = getopt_long(argc, argv, "ho:", options, NULL)) != -1) {
		int status = CTL_OK;

		if (option == 'o')
			ret->output = optarg;
		else if (option == 'a')
			ret->camera = optarg;
		else if (option == 'z' && !size_parse(optarg, ret))
			return ctl_usage(request->verb, "--size wants 1x1 to 16384x16384");
		else if (option == 'c' && !colouring_parse(optarg, &ret->colouring))
			return ctl_usage(request->verb, "--colour wants state or level");
		else if (option != 'z' && option != 'c')
			status = ctl_common_option(request, option);
		if (status != CTL_OK)
			return status;
	}
	if (argc - optind != 1 || !ret->output)
		return ctl_usage(request->verb, "wants one store and -o FILE.png");
	return CTL_OK;
}

int ctl_map(int argc, char **argv)
{
	struct ctl_request request = {
		.verb = "map",
		.help = "Usage: oocctl map STORE -o FILE.png [--colour state|level] [--camera P.csv]\n"
			"                  [--size WxH] [--json] [--socket S]\n"
			"Draws a store's cells from above, coloured by what the daemon's cache has of them:\n"
			"held, ready, busy, absent or damaged.  The viewer shows the same live (key B).\n"
			"\n"
			"  -o, --output FILE   the picture, PNG\n"
			"      --colour WHAT   by state (the default) or by level of the octree\n"
			"      --camera P.csv  show the first camera of a path; inside of the model what lies\n"
			"                      above it is left out\n"
			"      --size WxH      of the picture (1024x768)\n"
			"      --json          the counts of states for programs\n" CTL_COMMON_HELP
			"\n\n"
			"Example:\n"
			"  oocctl map plant.ooc -o cache.png",
	};
	struct map_options options = { .width = WIDTH_USUAL, .height = HEIGHT_USUAL };
	struct ooc_store *store;
	struct map map;
	int status = parse(argc, argv, &request, &options);

	if (status != CTL_OK)
		return status < 0 ? CTL_OK : status;
	if (ctl_connect_store(&request, argv[optind], &store) != CTL_OK)
		return CTL_FAILED;
	status = map_init(&map, &options, store);
	if (status == CTL_OK)
		status = map_draw(&request, &options, store, &map);
	map_done(&map);
	ooc_disconnect(request.client);
	return status;
}
