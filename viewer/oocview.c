/* SPDX-License-Identifier: MIT */
/* oocview - looks at stores: in a window, or as pictures. */
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "formats/base/log.h"
#include "formats/base/text.h"
#include "formats/store/store_file.h"
#include "libclient/charted.h"
#include "viewer/film.h"
#include "viewer/model_store.h"
#include "viewer/show.h"
#include "viewer/stop.h"
#include "viewer/surface.h"
#include "viewer/view_options.h"
#include "viewer/window.h"

enum exit_status {
	EXIT_OK = 0,
	EXIT_FAILED = 1,
	EXIT_USAGE = 2,
	EXIT_INTERRUPTED = 130,
};

/* The store of each input: itself, or the one built of it. */
static int find_stores(const struct options *options, char **ret_paths, struct why *why)
{
	for (uint32_t i = 0; i < options->input_count; i++) {
		const char *input = options->inputs[i];
		int r = model_store_is_store(input, why);

		if (r == 0) {
			r = model_store_get(input, &ret_paths[i], why);
		} else if (r > 0) {
			ret_paths[i] = strdup(input);
			r = ret_paths[i] ? 0 : why_errno(why, -ENOMEM, "%s", input);
		}
		if (r < 0)
			return r;
	}
	return 0;
}

static int open_outputs(struct show *show, struct why *why)
{
	const struct options *options = show->options;
	int r = statistics_init(&show->statistics, options->stats_path, why);

	if (r < 0)
		return r;
	if (options->frames_folder && mkdir(options->frames_folder, 0777) < 0 && errno != EEXIST)
		return why_errno(why, -errno, "%s", options->frames_folder);
	if (options->record_path) {
		show->record = fopen(options->record_path, "we");
		if (!show->record)
			return why_errno(why, -errno, "%s", options->record_path);
		(void)fprintf(show->record, "%s\n", camera_path_header);
	}
	return 0;
}

static int close_outputs(struct show *show, struct why *why)
{
	const struct options *options = show->options;
	FILE *record = show->record;
	int r = statistics_finish(&show->statistics, why);

	show->record = NULL;
	if (record && fclose(record) != 0 && r == 0)
		r = why_errno(why, -errno, "%s", options->record_path);
	return r;
}

static void write_summary(const struct show *show)
{
	struct statistics_run run = { .renderer = surface_renderer(show->surface),
				      .is_in_place = frame_is_in_place(show->frame),
				      .width = show->options->size.width,
				      .height = show->options->size.height };
	struct ooc_counters counters;

	ooc_counters(show->world.client, &counters);
	run.reconnects = counters.reconnects;
	statistics_write_json(&show->statistics, &run, stdout);
}

/* A preset is not what it says where another daemon runs already. */
static void look_at_cache(const struct show *show)
{
	const struct preset *preset = show->options->preset;
	struct ooc_counters counters;
	char size[TEXT_SIZE_BYTES];
	char other[TEXT_SIZE_BYTES];

	ooc_counters(show->world.client, &counters);
	if (!preset || counters.cache_bytes == preset->cache_bytes)
		return;
	log_warning(
		"the daemon that runs has a cache of %s, not the %s of --preset %s; stop it and "
		"one is started that has",
		text_from_size(counters.cache_bytes, size),
		text_from_size(preset->cache_bytes, other), preset->name);
}

/* Everything from the stores to the last picture. */
static int run(const struct options *options, char **store_paths, struct why *why)
{
	struct show show = { .options = options };
	int closed;
	int r;

	r = world_init(&show.world, options->socket_path,
		       options->preset ? options->preset->daemon_options : NULL, store_paths,
		       options->input_count, why);
	if (r < 0)
		return r;
	look_at_cache(&show);
	r = options->is_headless ? surface_open_headless(&show.surface, why)
				 : surface_open_window("oocview", options->size.width,
						       options->size.height, &show.surface, why);
	if (r < 0)
		goto out_scene;
	r = frame_create(&show.world, options->gpu_cache_bytes, &show.frame, why);
	if (r == 0)
		r = show_begin_pace(&show, why);
	if (r == 0)
		r = show_begin_foresight(&show, why);
	if (r == 0)
		r = open_outputs(&show, why);
	if (r == 0)
		r = options->is_headless ? film_run(&show, why) : window_run(&show, why);
	/* What was measured before a failure is worth keeping. */
	closed = close_outputs(&show, r == 0 ? why : NULL);
	if (r == 0)
		r = closed;
	if (options->wants_json && show.statistics.frame_count > 0)
		write_summary(&show);
	statistics_done(&show.statistics);
	picture_done(&show.picture);
	foresight_destroy(show.foresight);
	frame_destroy(show.frame);
	surface_close(show.surface);
out_scene:
	world_done(&show.world);
	return r;
}

/* Draws the first store as its chart says is right enough. */
static int take_charted(struct options *options, const char *path, struct why *why)
{
	struct charted charted;
	struct store_file *store;
	int r = store_open_path(path, &store, why);

	if (r < 0)
		return r;
	r = charted_find(store_superblock(store)->uuid, options->error_percent / 100.0, &charted,
			 why);
	store_close(store);
	if (r < 0) {
		why_prefix(why, "%s", path);
		return r;
	}
	if (options_take_drawing(options, charted.options) < 0)
		return why_set(why, -EUCLEAN,
			       "%s: its chart says \"%s\", which is no way to draw: "
			       "chart it again",
			       path, charted.options);
	log_info("%s: %.3g %% wrong of covered pixels where it was charted", charted.options,
		 100.0 * charted.error);
	return 0;
}

int main(int argc, char **argv)
{
	struct options options;
	struct why why = { "" };
	char **store_paths;
	int r;

	log_init("oocview", LOG_LEVEL_INFO);
	stop_init();
	switch (options_read(&options, argc, argv)) {
	case OPTIONS_RUN:
		break;
	case OPTIONS_DONE:
		return EXIT_OK;
	case OPTIONS_WRONG:
		return EXIT_USAGE;
	case OPTIONS_FAILED:
		return EXIT_FAILED;
	}
	store_paths = calloc(options.input_count, sizeof(char *));
	r = store_paths ? find_stores(&options, store_paths, &why)
			: why_errno(&why, -ENOMEM, "the list of stores");
	if (r == 0 && options.error_percent >= 0.0)
		r = take_charted(&options, store_paths[0], &why);
	if (r == 0)
		r = run(&options, store_paths, &why);
	for (uint32_t i = 0; store_paths && i < options.input_count; i++)
		free(store_paths[i]);
	free(store_paths);
	options_done(&options);
	if (r == -ECANCELED)
		return EXIT_INTERRUPTED;
	if (r < 0) {
		log_error("%s", why.text);
		return EXIT_FAILED;
	}
	return EXIT_OK;
}
