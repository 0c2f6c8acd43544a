/* SPDX-License-Identifier: MIT */
#include "tools/bench/accuracy/chart.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "tools/bench/accuracy/flip.h"
#include "tools/bench/base/figures.h"
#include "tools/bench/base/measure.h"
#include "tools/bench/path/path.h"

/* More than this in a channel is a difference that somebody could see. */
#define COLOUR_THRESHOLD 8u
/* Repeats after which a setting that was beaten in every one of them is timed no more. */
#define SURE_REPEATS 2u
/* Passes over the views that are timed: the first warms up, the second is measured. */
#define PASS_COUNT 2u
#define PASSES     "2"
/* What the control draws: the same view, the nearest nodes up to so many triangles. */
#define CONTROL_TRIANGLES "100000"
#define ARGUMENT_COUNT    32u

/* ---- the viewer ---- */

struct viewing {
	const char *path;    /* cameras */
	const char *channel; /* with pictures in `frames`; NULL: timed, no pictures */
	char frames[PATH_MAX];
	char stats[PATH_MAX];
};

/* Runs oocview over a path with a setting's options (NULL: the full mode). */
static int view(const struct chart_options *options, const struct chart_setting *setting,
		struct viewing *viewing, struct why *why)
{
	double scale = setting ? setting->scale : 1.0;
	char program[PATH_MAX];
	char size[32];
	const char *argv[ARGUMENT_COUNT] = {
		program,       "--headless", "--settle", "--socket", options->socket_path, "--path",
		viewing->path, "--size",     size,       "--stats",  viewing->stats
	};
	unsigned count = 11;
	struct measure_result result;
	int r;

	measure_program("oocview", program);
	(void)snprintf(size, sizeof(size), "%ux%u", (unsigned)(options->width * scale),
		       (unsigned)(options->height * scale));
	(void)snprintf(viewing->stats, sizeof(viewing->stats), "%s/stats.csv", options->scratch);
	(void)snprintf(viewing->frames, sizeof(viewing->frames), "%s/frames", options->scratch);
	if (viewing->channel) {
		argv[count++] = "--channel";
		argv[count++] = viewing->channel;
		argv[count++] = "--frames";
		argv[count++] = viewing->frames;
	} else {
		argv[count++] = "--repeat";
		argv[count++] = PASSES;
	}
	for (unsigned i = 0; setting && i < setting->text_count; i++)
		argv[count++] = setting->texts[i];
	argv[count++] = options->store;
	CHECK(count < ARGUMENT_COUNT);
	r = measure_run(argv, &result, why);
	if (r == 0)
		measure_result_done(&result);
	return r;
}

static int frame_read(const struct viewing *viewing, size_t index,
		      const struct chart_options *options, struct rgb_image *ret, struct why *why)
{
	char path[PATH_MAX];
	struct rgb_image image;
	int r;

	if (snprintf(path, sizeof(path), "%s/frame_%06zu.png", viewing->frames, index) >=
	    (int)sizeof(path))
		return why_set(why, -ENAMETOOLONG, "%s: too long a name", viewing->frames);
	r = rgb_image_read(path, &image, why);
	if (r < 0)
		return r;
	if (image.width == options->width && image.height == options->height) {
		*ret = image;
		return 0;
	}
	r = rgb_image_scale(&image, options->width, options->height, ret);
	rgb_image_done(&image);
	return r < 0 ? why_set(why, r, "out of memory") : 0;
}

/* Number of the field of a row that has this text; the field behind the last if none has. */
static unsigned field_find(char *row, const char *text)
{
	unsigned index = 0;

	row[strcspn(row, "\n")] = '\0';
	for (char *field; (field = strsep(&row, ",")) && strcmp(field, text) != 0;)
		index++;
	return index;
}

static double field_number(const char *row, unsigned index)
{
	while (row && index-- > 0) {
		row = strchr(row, ',');
		row = row ? row + 1 : NULL;
	}
	return row ? strtod(row, NULL) : NAN;
}

/* A column of the statistics by its name, of so many frames.  Returns: 0 or -errno. */
static int column_read(const struct viewing *viewing, const char *name, double *ret, size_t count,
		       struct why *why)
{
	FILE *file = fopen(viewing->stats, "re");
	char row[4096];
	unsigned column;
	size_t read = 0;

	if (!file)
		return why_errno(why, -errno, "%s", viewing->stats);
	if (fgets(row, sizeof(row), file)) {
		column = field_find(row, name);
		while (read < count && fgets(row, sizeof(row), file))
			ret[read++] = field_number(row, column);
	}
	(void)fclose(file);
	return read == count
		       ? 0
		       : why_set(why, -EIO, "oocview drew %zu frames instead of %zu", read, count);
}

/*
 * Pictures of all views in one channel.
 *
 * ret_triangles:  drawn for each view.
 */
static int pictures_take(const struct chart *chart, const struct chart_setting *setting,
			 const char *channel, struct rgb_image *ret, double *ret_triangles,
			 struct why *why)
{
	const struct chart_options *options = chart->options;
	char path[PATH_MAX];
	struct viewing viewing = { .path = path, .channel = channel };
	int r;

	(void)snprintf(path, sizeof(path), "%s/views.csv", options->scratch);
	r = path_write(path, chart->scene->cameras, chart->scene->camera_count, why);
	if (r == 0)
		r = view(options, setting, &viewing, why);
	if (r == 0)
		r = column_read(&viewing, "triangles", ret_triangles, chart->scene->camera_count,
				why);
	for (size_t i = 0; r == 0 && i < chart->scene->camera_count; i++) {
		rgb_image_done(&ret[i]);
		r = frame_read(&viewing, i, options, &ret[i], why);
	}
	return r;
}

/* ---- figures of pictures ---- */

static bool is_covered(const struct rgb_image *items, size_t pixel)
{
	const uint8_t *at = &items->pixels[3 * pixel];

	/* As oocview paints it: what shows nothing is black, and no item is. */
	return at[0] != 0 || at[1] != 0 || at[2] != 0;
}

static void compare_items(const struct rgb_image *exact, const struct rgb_image *items,
			  struct chart_view *ret)
{
	size_t pixel_count = (size_t)exact->width * exact->height;
	uint64_t wrong = rgb_image_differing(exact, items, 0);
	uint64_t covered = 0;

	for (size_t i = 0; i < pixel_count; i++)
		covered += is_covered(exact, i);
	ret->wrong_of_all = (double)wrong / (double)pixel_count;
	ret->wrong_of_covered = covered > 0 ? (double)wrong / (double)covered : 0.0;
}

static int compare_colours(const struct chart *chart, size_t view_index,
			   const struct rgb_image *colours, struct chart_view *ret)
{
	const struct rgb_image *exact = &chart->colours[view_index];
	const struct rgb_image *items = &chart->items[view_index];
	size_t pixel_count = (size_t)exact->width * exact->height;
	struct flip *a = NULL;
	struct flip *b = NULL;
	uint64_t covered = 0;
	int r;

	for (size_t i = 0; i < pixel_count; i++)
		covered += is_covered(items, i);
	if (covered > 0)
		ret->colour_of_covered =
			(double)rgb_image_differing(exact, colours, COLOUR_THRESHOLD) /
			(double)covered;
	r = flip_prepare(exact->pixels, exact->width, exact->height, FLIP_PIXELS_A_DEGREE, &a);
	if (r == 0)
		r = flip_prepare(colours->pixels, exact->width, exact->height, FLIP_PIXELS_A_DEGREE,
				 &b);
	if (r == 0)
		ret->flip = flip_compare(a, b, NULL);
	flip_done(a);
	flip_done(b);
	return r;
}

/* How much the error changes from each frame to the next, within bursts. */
static double pop_of(const struct chart *chart, const struct rgb_image *colours)
{
	const struct chart_scene *scene = chart->scene;
	size_t bytes = (size_t)chart->options->width * chart->options->height * 3;
	double sum = 0.0;
	double count = 0.0;

	for (size_t i = 1; i < scene->camera_count; i++) {
		if (i % scene->burst == 0)
			continue;
		for (size_t k = 0; k < bytes; k++) {
			int error = colours[i].pixels[k] - chart->colours[i].pixels[k];
			int before = colours[i - 1].pixels[k] - chart->colours[i - 1].pixels[k];

			sum += (double)(error - before) * (error - before);
		}
		count += (double)bytes;
	}
	return count > 0.0 ? sqrt(sum / count) : 0.0;
}

static int setting_judge(struct chart *chart, struct chart_setting *setting, struct why *why)
{
	size_t count = chart->scene->camera_count;
	struct rgb_image *pictures = calloc(count, sizeof(*pictures));
	double *triangles = calloc(count, sizeof(*triangles));
	int r;

	setting->views = calloc(count, sizeof(*setting->views));
	if (!pictures || !triangles || !setting->views) {
		free(pictures);
		free(triangles);
		return why_set(why, -ENOMEM, "out of memory");
	}
	r = pictures_take(chart, setting, "triangle", pictures, triangles, why);
	for (size_t i = 0; r == 0 && i < count; i++)
		compare_items(&chart->items[i], &pictures[i], &setting->views[i]);
	if (r == 0)
		r = pictures_take(chart, setting, "colour", pictures, triangles, why);
	for (size_t i = 0; r == 0 && i < count; i++) {
		setting->triangles += triangles[i] / (double)count;
		r = compare_colours(chart, i, &pictures[i], &setting->views[i]);
		if (r < 0)
			r = why_set(why, r, "out of memory");
	}
	if (r == 0)
		setting->pop = pop_of(chart, pictures);
	for (size_t i = 0; i < count; i++)
		rgb_image_done(&pictures[i]);
	free(pictures);
	free(triangles);
	return r;
}

/* ---- times ---- */

/* The 95th percentile of the second pass over as many views as are timed. */
static int times_take(const struct chart *chart, const struct chart_setting *setting,
		      const char *path, double *ret_p95_ms, struct why *why)
{
	size_t count = chart->scene->burst;
	double *ms = calloc(PASS_COUNT * count, sizeof(*ms));
	struct viewing viewing = { .path = path };
	int r = ms ? view(chart->options, setting, &viewing, why)
		   : why_set(why, -ENOMEM, "out of memory");

	if (r == 0)
		r = column_read(&viewing, "ms", ms, PASS_COUNT * count, why);
	if (r == 0)
		*ret_p95_ms = percentile_of(ms + (PASS_COUNT - 1) * count, count, 0.95);
	free(ms);
	return r;
}

static const struct chart_setting control = {
	.name = "control",
	.texts = { "--mode", "approximate", "--order", "distance", "--budget", CONTROL_TRIANGLES },
	.text_count = 6,
	.scale = 1.0,
};

static double lowest(const double *values, size_t count)
{
	double low = INFINITY;

	for (size_t i = 0; i < count; i++)
		low = fmin(low, values[i]);
	return low;
}

static double highest(const double *values, size_t count)
{
	double high = 0.0;

	for (size_t i = 0; i < count; i++)
		high = fmax(high, values[i]);
	return high;
}

/*
 * Is another setting no more wrong, and was quicker every time?  Then more repeats would change nothing
 * that is read off the chart.  The full mode, which others are compared with, stays.
 */
static bool is_beaten(const struct chart *chart, const struct chart_setting *setting)
{
	double low = lowest(setting->p95_ms, setting->repeat_count);

	for (size_t i = 0; i < chart->setting_count && setting != chart->settings; i++) {
		const struct chart_setting *other = &chart->settings[i];

		if (other->wrong_of_covered_mean <= setting->wrong_of_covered_mean &&
		    highest(other->p95_ms, other->repeat_count) < low)
			return true;
	}
	return false;
}

/* One repeat: the control, then every setting, in an order that turns from repeat to repeat. */
static int repeat_measure(struct chart *chart, unsigned repeat, const char *views_path,
			  const char *control_path, struct why *why)
{
	double control_ms;
	int r = times_take(chart, &control, control_path, &control_ms, why);

	for (size_t i = 0; r == 0 && i < chart->setting_count; i++) {
		size_t at = repeat % 2 ? chart->setting_count - 1 - i : i;
		struct chart_setting *setting = &chart->settings[at];
		double p95_ms;

		if (repeat >= SURE_REPEATS && is_beaten(chart, setting))
			continue;
		r = times_take(chart, setting, views_path, &p95_ms, why);
		if (r < 0)
			break;
		setting->p95_ms[setting->repeat_count] = p95_ms;
		setting->p95_of_control[setting->repeat_count] = p95_ms / control_ms;
		setting->repeat_count++;
	}
	return r;
}

/* Times are of one piece of the path: the one with most to draw, for which a frame rate has to hold. */
static int times_measure(struct chart *chart, struct why *why)
{
	const struct chart_scene *scene = chart->scene;
	const struct camera *timed = &scene->cameras[chart->timed_first];
	char control_path[PATH_MAX];
	char views_path[PATH_MAX];
	struct camera *same = calloc(scene->burst, sizeof(*same));
	int r;

	if (!same)
		return why_set(why, -ENOMEM, "out of memory");
	for (size_t i = 0; i < scene->burst; i++) {
		same[i] = timed[0];
		same[i].time_s = timed[i].time_s;
	}
	(void)snprintf(control_path, sizeof(control_path), "%s/control.csv",
		       chart->options->scratch);
	(void)snprintf(views_path, sizeof(views_path), "%s/views.csv", chart->options->scratch);
	r = path_write(control_path, same, scene->burst, why);
	free(same);
	if (r == 0)
		r = path_write(views_path, timed, scene->burst, why);
	for (unsigned repeat = 0; r == 0 && repeat < chart->options->repeat_count; repeat++)
		r = repeat_measure(chart, repeat, views_path, control_path, why);
	return r;
}

/* ---- all of it ---- */

static void full_triangles_note(struct chart *chart, const double *triangles)
{
	size_t count = chart->scene->camera_count;
	size_t burst = chart->scene->burst;
	double most = -1.0;

	for (size_t first = 0; first + burst <= count; first += burst) {
		double sum = 0.0;

		for (size_t i = first; i < first + burst; i++)
			sum += triangles[i];
		chart->full_triangles += sum / (double)count;
		if (sum > most)
			chart->timed_first = first;
		most = fmax(most, sum);
	}
}

int chart_init(struct chart *chart, const struct chart_options *options,
	       const struct chart_scene *scene, struct why *why)
{
	size_t count = scene->camera_count;
	double *triangles = calloc(count, sizeof(*triangles));
	int r;

	*chart = (struct chart){ .options = options, .scene = scene };
	chart->items = calloc(count, sizeof(*chart->items));
	chart->colours = calloc(count, sizeof(*chart->colours));
	if (!chart->items || !chart->colours || !triangles)
		r = why_set(why, -ENOMEM, "out of memory");
	else
		r = pictures_take(chart, NULL, "triangle", chart->items, triangles, why);
	if (r == 0)
		r = pictures_take(chart, NULL, "colour", chart->colours, triangles, why);
	if (r == 0)
		full_triangles_note(chart, triangles);
	free(triangles);
	if (r < 0)
		chart_done(chart);
	return r;
}

void chart_done(struct chart *chart)
{
	size_t count = chart->scene ? chart->scene->camera_count : 0;

	for (size_t i = 0; i < count; i++) {
		if (chart->items)
			rgb_image_done(&chart->items[i]);
		if (chart->colours)
			rgb_image_done(&chart->colours[i]);
	}
	free(chart->items);
	free(chart->colours);
	for (size_t i = 0; i < chart->setting_count; i++)
		free(chart->settings[i].views);
	*chart = (struct chart){ .scene = NULL };
}

void chart_add(struct chart *chart, const char *method, const char *name, double scale,
	       const char *const *options)
{
	struct chart_setting *setting = &chart->settings[chart->setting_count++];

	CHECK(chart->setting_count <= CHART_SETTING_COUNT_MAX);
	*setting = (struct chart_setting){ .method = method, .scale = scale };
	(void)snprintf(setting->name, sizeof(setting->name), "%s", name);
	for (; *options; options++) {
		CHECK(setting->text_count < CHART_OPTION_COUNT_MAX);
		(void)snprintf(setting->texts[setting->text_count++], sizeof(setting->texts[0]),
			       "%s", *options);
	}
}

const char *chart_options_text(const struct chart_setting *setting, char *buffer, size_t bytes)
{
	size_t used = 0;

	buffer[0] = '\0';
	for (unsigned i = 0; i < setting->text_count && used < bytes; i++)
		used += (size_t)snprintf(buffer + used, bytes - used, "%s%s", i > 0 ? " " : "",
					 setting->texts[i]);
	return buffer;
}

static void errors_summarise(const struct chart *chart, struct chart_setting *setting)
{
	double count = (double)chart->scene->camera_count;

	for (size_t i = 0; i < chart->scene->camera_count; i++) {
		const struct chart_view *view_at = &setting->views[i];

		setting->wrong_of_covered_mean += view_at->wrong_of_covered / count;
		setting->wrong_of_all_mean += view_at->wrong_of_all / count;
		setting->colour_mean += view_at->colour_of_covered / count;
		setting->flip_mean += view_at->flip / count;
		setting->wrong_of_covered_worst =
			fmax(setting->wrong_of_covered_worst, view_at->wrong_of_covered);
		setting->wrong_of_all_worst =
			fmax(setting->wrong_of_all_worst, view_at->wrong_of_all);
	}
}

static void times_summarise(struct chart_setting *setting)
{
	double sorted[CHART_REPEAT_COUNT_MAX];

	memcpy(sorted, setting->p95_ms, sizeof(sorted));
	setting->ms = spread_of(sorted, setting->repeat_count);
	memcpy(sorted, setting->p95_of_control, sizeof(sorted));
	setting->of_control = spread_of(sorted, setting->repeat_count);
}

int chart_measure(struct chart *chart, struct why *why)
{
	int r = 0;

	for (size_t i = 0; r == 0 && i < chart->setting_count; i++) {
		r = setting_judge(chart, &chart->settings[i], why);
		if (r == 0)
			errors_summarise(chart, &chart->settings[i]);
	}
	if (r == 0)
		r = times_measure(chart, why);
	for (size_t i = 0; r == 0 && i < chart->setting_count; i++)
		times_summarise(&chart->settings[i]);
	return r;
}

int chart_picture(const struct chart *chart, const struct chart_setting *setting, size_t view_index,
		  struct rgb_image *ret, struct rgb_image *ret_errors, struct why *why)
{
	const struct rgb_image *exact = &chart->colours[view_index];
	struct chart_scene one = *chart->scene;
	struct chart of_one = { .options = chart->options, .scene = &one };
	float *map = calloc((size_t)exact->width * exact->height, sizeof(*map));
	struct rgb_image picture = { .pixels = NULL };
	double triangles;
	struct flip *a = NULL;
	struct flip *b = NULL;
	int r = map ? 0 : why_set(why, -ENOMEM, "out of memory");

	one.cameras = &chart->scene->cameras[view_index];
	one.camera_count = 1;
	if (r == 0)
		r = pictures_take(&of_one, setting, "colour", &picture, &triangles, why);
	if (r == 0 && (flip_prepare(exact->pixels, exact->width, exact->height,
				    FLIP_PIXELS_A_DEGREE, &a) < 0 ||
		       flip_prepare(picture.pixels, exact->width, exact->height,
				    FLIP_PIXELS_A_DEGREE, &b) < 0))
		r = why_set(why, -ENOMEM, "out of memory");
	if (r == 0) {
		(void)flip_compare(a, b, map);
		if (rgb_image_of_errors(map, exact->width, exact->height, ret_errors) < 0)
			r = why_set(why, -ENOMEM, "out of memory");
	}
	if (r == 0)
		*ret = picture;
	else
		rgb_image_done(&picture);
	flip_done(a);
	flip_done(b);
	free(map);
	return r;
}
