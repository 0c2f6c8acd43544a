/* SPDX-License-Identifier: MIT */
/*
 * oocbench select: how well selections find what shows, without GL, a daemon or a disk.
 *
 * Each view is drawn once in software, all nodes of the frustum, every pixel with its triangle.  A
 * pixel of a set of nodes is right if the node that wins it in that picture is in the set: ties go to
 * the lower item whatever is drawn, so no other picture is needed.
 */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/clock.h"
#include "formats/base/random.h"
#include "libclient/select/occlusion.h"
#include "libclient/select/raster.h"
#include "libclient/select/select.h"
#include "tools/bench/accuracy/resident.h"
#include "tools/bench/base/arguments.h"
#include "tools/bench/base/figures.h"
#include "tools/bench/base/measure.h"
#include "tools/bench/base/report.h"
#include "tools/bench/base/verb.h"
#include "tools/bench/bench.h"

#define VIEWS_MAX 1000000u
#define SIDE_MAX  8192u
/** Budgets that follow a frame: 1, 2 and 4 times what shows exactly. */
#define FACTORS 3u

static const char help[] =
	"Usage: oocbench select STORE [--path P.csv] [--views N] [--seed S] [--size WxH]\n"
	"                       [--budget N] [--no-orders] [--json]\n"
	"Compares sets of nodes with what shows exactly: each order of the approximate set at several\n"
	"budgets, and the conservative set.  Fails if the conservative set lacks a pixel.\n"
	"\n"
	"  --path P.csv  cameras of a path; else random ones around, inside and close to surfaces\n"
	"  --views N     how many of them, evenly spread over a path (100)\n"
	"  --seed S      other random cameras for another S (1)\n"
	"  --size WxH    of the pictures (640x480)\n"
	"  --budget N    triangles, beside 1, 2 and 4 times those that show (280000)\n"
	"  --no-orders   the conservative set alone, which is quicker\n"
	"  --json        results for programs\n"
	"\n"
	"The whole store is kept in memory.  Times are those of the software rasteriser.  Along a path the\n"
	"conservative set goes on from view to view; each random one begins anew.\n"
	"\n"
	"Example:\n"
	"  oocbench select plant.ooc --path walk.csv\n";

struct select_verb_options {
	const char *store;
	const char *path;
	uint64_t view_count;
	uint64_t seed;
	uint64_t budget_triangles;
	unsigned size[2];
	bool no_orders;
	bool is_json;
};

/* What a budget is counted in. */
enum budget_kind {
	BUDGET_OF_NODES,     /* x the triangles of the nodes that show */
	BUDGET_OF_TRIANGLES, /* x the triangles that show */
	BUDGET_FIXED,
	BUDGET_KIND_COUNT_
};

/* A figure for each view. */
struct figures {
	double *values;
	size_t count;
};

/* Of one order at one budget. */
struct accuracy {
	struct figures of_covered; /* wrong pixels, share of the covered ones */
	struct figures of_all;
};

struct order_figures {
	struct accuracy accuracy[BUDGET_KIND_COUNT_][FACTORS];
	struct figures ms; /* with the fixed budget */
	struct figures visited;
};

struct select_verb {
	const struct select_verb_options *options;
	struct resident resident;
	struct selector *selector;
	struct conservative *conservative;
	struct occlusion *occlusion;
	struct raster *full;
	struct camera *cameras;
	uint32_t camera_count;
	struct random random;
	uint32_t *pixels; /* a node: those that it wins in this view */
	uint64_t *items;  /* scratch of triangle_count_shown() */
	struct order_figures orders[SELECT_ORDER_COUNT_];
	/* The view in hand. */
	uint64_t covered;
	uint64_t triangles_shown;
	uint64_t node_triangles_shown;
	uint64_t nodes_shown;
	/* Conservative, a value a view. */
	struct figures drawn_ratio; /* nodes drawn by the test / that show */
	struct figures shown_ratio; /* nodes said to show / that show */
	struct figures share_shown; /* of the frustum's triangles */
	struct figures time_ratio;  /* test and drawing what shows / drawing the frustum */
	struct figures test_ms, full_ms;
	struct figures rounds, tested;
	struct figures visible_triangles, visible_node_triangles;
	uint64_t differing;
};

/* ---- cameras ---- */

/* A point in the tight box of a random leaf, in the world. */
static void random_point(struct select_verb *verb, double ret[3])
{
	const struct store_superblock *superblock = verb->resident.superblock;
	const struct store_node *node;

	do
		node = &verb->resident.nodes[(uint64_t)(random_unit(&verb->random) *
							(double)superblock->node_count)];
	while (node->payload_id == 0);
	for (int k = 0; k < 3; k++)
		ret[k] = superblock->origin[k] + node->box_min[k] +
			 random_unit(&verb->random) * ((double)node->box_max[k] - node->box_min[k]);
}

/*
 * In turn: from outside; from anywhere inside the box; in a leaf's box, where something is close; the
 * same along an axis, where walls are seen edge-on.
 */
static void camera_random(struct select_verb *verb, uint64_t number, struct camera *ret)
{
	const struct store_superblock *superblock = verb->resident.superblock;
	const struct store_superblock *superblocks[] = { superblock };
	double aspect = (double)verb->options->size[0] / verb->options->size[1];
	struct camera camera;
	double reach2 = 0.0;

	camera_frame_all(&camera, superblocks, 1, aspect, 45.0);
	for (int k = 0; k < 3; k++)
		reach2 += (camera.eye[k] - camera.at[k]) * (camera.eye[k] - camera.at[k]);
	random_point(verb, camera.at);
	if (number % 4 == 0) {
		double reach = sqrt(reach2) * (0.6 + 0.8 * random_unit(&verb->random));
		double angle = 2.0 * M_PI * random_unit(&verb->random);
		double height = 2.0 * random_unit(&verb->random) - 1.0;

		camera.eye[0] = camera.at[0] + reach * sqrt(1.0 - height * height) * cos(angle);
		camera.eye[1] = camera.at[1] + reach * sqrt(1.0 - height * height) * sin(angle);
		camera.eye[2] = camera.at[2] + reach * height;
	} else if (number % 4 == 1) {
		for (int k = 0; k < 3; k++)
			camera.eye[k] = superblock->origin[k] + superblock->box_min[k] +
					random_unit(&verb->random) *
						(superblock->box_max[k] - superblock->box_min[k]);
	} else {
		random_point(verb, camera.eye);
	}
	if (number % 4 == 3) {
		unsigned axis = (unsigned)(3.0 * random_unit(&verb->random));

		memcpy(camera.at, camera.eye, sizeof(camera.at));
		camera.at[axis] += sqrt(reach2) * (random_unit(&verb->random) < 0.5 ? -1.0 : 1.0);
	}
	if (number % 4 != 0)
		camera.fov_y_degrees = 30.0 + 80.0 * random_unit(&verb->random);
	*ret = camera;
}

/* ---- the exact picture ---- */

static int compare_items(const void *left, const void *right)
{
	uint64_t a = *(const uint64_t *)left;
	uint64_t b = *(const uint64_t *)right;

	return a < b ? -1 : a > b;
}

/* Counts what shows, of triangles, of nodes and of pixels. */
static void exact_count(struct select_verb *verb)
{
	size_t pixel_count = (size_t)verb->options->size[0] * verb->options->size[1];
	const uint64_t *items = raster_items(verb->full);
	size_t count = 0;

	memset(verb->pixels, 0, verb->resident.superblock->node_count * sizeof(*verb->pixels));
	verb->covered = 0;
	for (size_t i = 0; i < pixel_count; i++) {
		if (items[i] == RASTER_ITEM_NONE)
			continue;
		verb->covered++;
		verb->pixels[items[i] >> 32]++;
		if (count == 0 || verb->items[count - 1] != items[i])
			verb->items[count++] = items[i];
	}
	qsort(verb->items, count, sizeof(*verb->items), compare_items);
	verb->triangles_shown = 0;
	verb->node_triangles_shown = 0;
	verb->nodes_shown = 0;
	for (size_t i = 0; i < count; i++) {
		bool is_new_node = i == 0 || verb->items[i] >> 32 != verb->items[i - 1] >> 32;

		verb->triangles_shown += i == 0 || verb->items[i] != verb->items[i - 1];
		if (!is_new_node)
			continue;
		verb->nodes_shown++;
		verb->node_triangles_shown +=
			verb->resident.nodes[verb->items[i] >> 32].triangle_count;
	}
}

static int draw_nodes(struct select_verb *verb, const struct camera_view *view,
		      const struct selection *selection)
{
	int r = 0;

	raster_clear(verb->full);
	for (size_t i = 0; r == 0 && i < selection->entry_count; i++) {
		uint64_t node = selection->entries[i].node;

		r = raster_draw_payload(verb->full, view, verb->resident.payloads[node], node << 32,
					1);
	}
	return r;
}

static void figure_add(struct select_verb *verb, struct figures *figures, double value)
{
	if (!figures->values)
		figures->values = calloc(verb->camera_count, sizeof(*figures->values));
	if (figures->values)
		figures->values[figures->count++] = value;
}

/* ---- approximate sets ---- */

/* Pixels that the beginning of a selection lacks, up to a budget. */
static void accuracy_add(struct select_verb *verb, const struct selection *selection,
			 uint64_t budget_triangles, struct accuracy *ret)
{
	double all = (double)verb->options->size[0] * verb->options->size[1];
	uint64_t triangles = 0;
	uint64_t right = 0;
	double wrong;

	for (size_t i = 0; i < selection->entry_count && (i == 0 || triangles < budget_triangles);
	     i++) {
		uint32_t node = selection->entries[i].node;

		triangles += verb->resident.nodes[node].triangle_count;
		right += verb->pixels[node];
	}
	wrong = (double)(verb->covered - right);
	figure_add(verb, &ret->of_covered, verb->covered > 0 ? wrong / (double)verb->covered : 0.0);
	figure_add(verb, &ret->of_all, wrong / all);
}

static void order_measure(struct select_verb *verb, const struct camera_view *view,
			  enum select_order order)
{
	struct order_figures *figures = &verb->orders[order];
	struct select_options options = { order, verb->options->budget_triangles };
	struct selection selection;
	uint64_t begin_ns = clock_now_ns();

	select_approximate(verb->selector, view, &options, &selection);
	figure_add(verb, &figures->ms, (double)(clock_now_ns() - begin_ns) * 1e-6);
	figure_add(verb, &figures->visited, (double)selection.nodes_visited);
	for (unsigned kind = 0; kind < BUDGET_KIND_COUNT_; kind++)
		for (unsigned factor = 0; factor < FACTORS; factor++) {
			options.budget_triangles =
				kind == BUDGET_OF_NODES       ? verb->node_triangles_shown << factor
				: kind == BUDGET_OF_TRIANGLES ? verb->triangles_shown << factor
							      : verb->options->budget_triangles;
			if (kind == BUDGET_FIXED && factor > 0)
				continue;
			/* 0 would be no limit; nothing shows then. */
			if (options.budget_triangles == 0)
				options.budget_triangles = 1;
			select_approximate(verb->selector, view, &options, &selection);
			accuracy_add(verb, &selection, options.budget_triangles,
				     &figures->accuracy[kind][factor]);
		}
}

/* ---- the conservative set ---- */

static const void *payload_of(void *context, uint32_t node)
{
	const struct resident *resident = context;

	return resident->payloads[node];
}

/* Draws what is said to show, so that the time of that is known. */
static int draw_shown(struct select_verb *verb, const struct camera_view *view,
		      const struct conservative_result *result)
{
	int r = 0;

	raster_clear(verb->full);
	for (size_t i = 0; r == 0 && i < result->entry_count; i++) {
		uint64_t node = result->entries[i].node;

		if (result->entries[i].state == CONSERVATIVE_SHOWS)
			r = raster_draw_payload(verb->full, view, verb->resident.payloads[node],
						node << 32, 1);
	}
	return r;
}

static int conservative_measure(struct select_verb *verb, const struct camera_view *view,
				double full_ms)
{
	struct occlusion_store store = { .occlusion = verb->occlusion,
					 .view = view,
					 .payload_of = payload_of,
					 .context = &verb->resident };
	struct conservative_tester tester = occlusion_tester(&store);
	uint64_t begin_ns = clock_now_ns();
	struct conservative_result result;
	double nodes = verb->nodes_shown > 0 ? (double)verb->nodes_shown : 1.0;
	uint64_t right = 0;
	double test_ms;
	int r;

	/* What showed in a random view, and whether testing paid there, says nothing about the next. */
	if (!verb->options->path)
		conservative_forget(verb->conservative);
	occlusion_clear(verb->occlusion);
	r = conservative_begin(verb->conservative, view, NULL, &tester, &result);
	test_ms = (double)(clock_now_ns() - begin_ns) * 1e-6;
	if (r == 0)
		r = draw_shown(verb, view, &result);
	if (r < 0)
		return r;
	figure_add(verb, &verb->time_ratio, (double)(clock_now_ns() - begin_ns) * 1e-6 / full_ms);
	for (size_t i = 0; i < result.entry_count; i++)
		if (result.entries[i].state == CONSERVATIVE_SHOWS)
			right += verb->pixels[result.entries[i].node];
	verb->differing += verb->covered - right;
	figure_add(verb, &verb->drawn_ratio,
		   (double)(result.is_untested ? result.candidate_count : result.nodes_drawn) /
			   nodes);
	figure_add(verb, &verb->shown_ratio, (double)result.shown_count / nodes);
	figure_add(verb, &verb->share_shown,
		   (double)result.shown_triangles / fmax(1.0, (double)result.candidate_triangles));
	figure_add(verb, &verb->test_ms, test_ms);
	figure_add(verb, &verb->full_ms, full_ms);
	figure_add(verb, &verb->rounds, (double)result.rounds);
	figure_add(verb, &verb->tested, (double)result.boxes_tested);
	return 0;
}

/* ---- the verb ---- */

static int view_measure(struct select_verb *verb, const struct camera *camera)
{
	const struct store_superblock *superblock = verb->resident.superblock;
	double aspect = (double)verb->options->size[0] / verb->options->size[1];
	struct selection selection;
	struct camera_view view;
	uint64_t begin_ns;
	double full_ms;
	int r;

	r = camera_view_init(&view, camera, superblock, aspect, camera_near(camera, superblock));
	if (r < 0)
		return r;
	begin_ns = clock_now_ns();
	select_frustum(verb->selector, &view, &selection);
	r = draw_nodes(verb, &view, &selection);
	full_ms = (double)(clock_now_ns() - begin_ns) * 1e-6;
	if (r < 0)
		return r;
	exact_count(verb);
	figure_add(verb, &verb->visible_triangles, (double)verb->triangles_shown);
	figure_add(verb, &verb->visible_node_triangles, (double)verb->node_triangles_shown);
	for (unsigned order = 0; order < SELECT_ORDER_COUNT_ && !verb->options->no_orders; order++)
		order_measure(verb, &view, (enum select_order)order);
	return conservative_measure(verb, &view, full_ms);
}

static void report_figures(struct report *report, const char *key, const char *title,
			   const struct figures *figures, double scale, const char *unit)
{
	double *sorted = calloc(figures->count + 1, sizeof(*sorted));
	size_t count = figures->count;

	if (!sorted || count == 0) {
		free(sorted);
		return;
	}
	for (size_t i = 0; i < count; i++)
		sorted[i] = figures->values[i] * scale;
	report_distribution(report, key, title, distribution_of(sorted, count), unit);
	free(sorted);
}

static void report_order(struct report *report, const struct select_verb *verb,
			 enum select_order order)
{
	static const char *const kinds[BUDGET_KIND_COUNT_] = { "nodes", "triangles", "budget" };
	const struct order_figures *figures = &verb->orders[order];
	char title[64];
	char key[64];

	report_group_begin(report, select_order_name(order), select_order_name(order));
	for (unsigned kind = 0; kind < BUDGET_KIND_COUNT_; kind++)
		for (unsigned factor = 0; factor < FACTORS; factor++) {
			const struct accuracy *accuracy = &figures->accuracy[kind][factor];

			(void)snprintf(key, sizeof(key), "%s_%u_of_covered", kinds[kind],
				       1u << factor);
			(void)snprintf(title, sizeof(title), "wrong of covered, %s x %u",
				       kinds[kind], 1u << factor);
			report_figures(report, key, title, &accuracy->of_covered, 100.0, "%");
			if (kind != BUDGET_FIXED)
				continue;
			report_figures(report, "budget_1_of_all", "wrong of all, budget x 1",
				       &accuracy->of_all, 100.0, "%");
		}
	report_figures(report, "ms", "time to select", &figures->ms, 1.0, "ms");
	report_figures(report, "visited", "nodes visited", &figures->visited, 1.0, "");
	report_group_end(report);
}

static void select_report(const struct select_verb *verb)
{
	struct report report;

	report_begin(&report, verb->options->is_json);
	report_number(&report, "views", "views", verb->camera_count, "");
	report_figures(&report, "visible_triangles", "triangles that show",
		       &verb->visible_triangles, 1.0, "");
	report_figures(&report, "visible_node_triangles", "triangles of nodes that show",
		       &verb->visible_node_triangles, 1.0, "");
	for (unsigned order = 0; order < SELECT_ORDER_COUNT_ && !verb->options->no_orders; order++)
		report_order(&report, verb, (enum select_order)order);
	report_group_begin(&report, "conservative", "conservative");
	report_number(&report, "differing", "pixels that differ", (double)verb->differing, "");
	report_figures(&report, "drawn_ratio", "nodes drawn to test / that show",
		       &verb->drawn_ratio, 1.0, "");
	report_figures(&report, "shown_ratio", "nodes said to show / that show", &verb->shown_ratio,
		       1.0, "");
	report_figures(&report, "share_shown", "triangles said to show, of the frustum's",
		       &verb->share_shown, 100.0, "%");
	report_figures(&report, "time_ratio", "time to test and draw / to draw the frustum",
		       &verb->time_ratio, 1.0, "");
	report_figures(&report, "test_ms", "time to test", &verb->test_ms, 1.0, "ms");
	report_figures(&report, "full_ms", "time to draw the frustum", &verb->full_ms, 1.0, "ms");
	report_figures(&report, "rounds", "rounds", &verb->rounds, 1.0, "");
	report_figures(&report, "tested", "boxes tested", &verb->tested, 1.0, "");
	report_group_end(&report);
	report_end(&report);
}

/* The cameras: some of a path's, or random ones. */
static int cameras_make(struct select_verb *verb, struct why *why)
{
	const struct select_verb_options *options = verb->options;
	struct camera *path = NULL;
	uint32_t path_count = 0;
	int r = 0;

	if (options->path)
		r = camera_path_read(options->path, &path, &path_count, why);
	if (r < 0)
		return r;
	verb->camera_count = (uint32_t)options->view_count;
	if (options->path && verb->camera_count > path_count)
		verb->camera_count = path_count;
	verb->cameras = calloc(verb->camera_count, sizeof(*verb->cameras));
	for (uint32_t i = 0; verb->cameras && i < verb->camera_count; i++) {
		if (options->path)
			verb->cameras[i] = path[(uint64_t)i * path_count / verb->camera_count];
		else
			camera_random(verb, i, &verb->cameras[i]);
	}
	free(path);
	return verb->cameras ? 0 : why_set(why, -ENOMEM, "out of memory");
}

static int select_prepare(struct select_verb *verb, struct why *why)
{
	const struct select_verb_options *options = verb->options;
	size_t pixel_count = (size_t)options->size[0] * options->size[1];
	int r = resident_open(&verb->resident, options->store, why);

	if (r < 0)
		return r;
	if (verb->resident.superblock->triangle_count == 0)
		return why_set(why, -EINVAL, "%s: there is nothing to see", options->store);
	verb->pixels = calloc(verb->resident.superblock->node_count, sizeof(*verb->pixels));
	verb->items = calloc(pixel_count, sizeof(*verb->items));
	if (!verb->pixels || !verb->items ||
	    selector_create(verb->resident.superblock, verb->resident.nodes, &verb->selector) < 0 ||
	    conservative_create(verb->selector, &verb->conservative) < 0 ||
	    occlusion_create(options->size[0], options->size[1], &verb->occlusion) < 0 ||
	    raster_create(options->size[0], options->size[1], &verb->full) < 0)
		return why_set(why, -ENOMEM, "out of memory");
	return cameras_make(verb, why);
}

static void order_figures_done(struct order_figures *figures)
{
	for (unsigned kind = 0; kind < BUDGET_KIND_COUNT_; kind++)
		for (unsigned factor = 0; factor < FACTORS; factor++) {
			free(figures->accuracy[kind][factor].of_covered.values);
			free(figures->accuracy[kind][factor].of_all.values);
		}
	free(figures->ms.values);
	free(figures->visited.values);
}

static void select_done(struct select_verb *verb)
{
	struct figures *const figures[] = {
		&verb->drawn_ratio, &verb->shown_ratio,       &verb->share_shown,
		&verb->time_ratio,  &verb->test_ms,           &verb->full_ms,
		&verb->rounds,      &verb->visible_triangles, &verb->visible_node_triangles,
		&verb->tested,
	};

	for (size_t i = 0; i < ARRAY_LENGTH(figures); i++)
		free(figures[i]->values);
	for (unsigned order = 0; order < SELECT_ORDER_COUNT_; order++)
		order_figures_done(&verb->orders[order]);
	free(verb->cameras);
	free(verb->pixels);
	free(verb->items);
	raster_destroy(verb->full);
	occlusion_destroy(verb->occlusion);
	conservative_destroy(verb->conservative);
	selector_destroy(verb->selector);
	resident_close(&verb->resident);
}

static int select_run(struct select_verb *verb, struct why *why)
{
	int r = select_prepare(verb, why);

	for (uint32_t i = 0; r == 0 && i < verb->camera_count; i++) {
		r = view_measure(verb, &verb->cameras[i]);
		if (r < 0)
			return why_errno(why, r, "view %u", i);
		if (measure_was_cancelled())
			return why_set(why, -ECANCELED, "interrupted");
	}
	return r;
}

int verb_select(int argc, char **argv)
{
	struct select_verb_options options = {
		.view_count = 100, .seed = 1, .budget_triangles = 280000, .size = { 640, 480 }
	};
	struct select_verb verb = { .options = &options };
	const struct argument table[] = {
		{ "path", ARGUMENT_TEXT, &options.path },
		{ "views", ARGUMENT_NUMBER, &options.view_count, 1, VIEWS_MAX },
		{ "seed", ARGUMENT_NUMBER, &options.seed },
		{ "size", ARGUMENT_PICTURE, options.size, 1, SIDE_MAX },
		{ "budget", ARGUMENT_NUMBER, &options.budget_triangles, 1, 0 },
		{ "no-orders", ARGUMENT_FLAG, &options.no_orders },
		{ "json", ARGUMENT_FLAG, &options.is_json },
		{ NULL },
	};
	const struct arguments arguments = { "select", help, table, 1, 1, "name one store" };
	char **operands;
	struct why why = { "" };
	int r;

	r = arguments_parse(&arguments, argc, argv, &operands);
	if (r != ARGUMENTS_OK)
		return r;
	options.store = operands[0];
	verb.random.state = options.seed;
	r = select_run(&verb, &why);
	if (r == 0)
		select_report(&verb);
	select_done(&verb);
	return verb_status("select", r, &why) || verb.differing > 0;
}
