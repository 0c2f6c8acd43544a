/* SPDX-License-Identifier: MIT */
/*
 * oocbench exact: the pictures of a store against those of the model files that it was built from.
 *
 *	viewer     oocview, settled, every triangle's ordinal read back
 *	store      the software rasteriser over the payloads that the frustum selects
 *	snapped    the software rasteriser over the input, its vertices on the store's grid
 *	original   the software rasteriser over the input as it is
 *
 * viewer = snapped but for ties and edges; store = snapped to the last pixel; snapped = original but
 * for what the error bound allows.
 */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/file.h"
#include "formats/base/random.h"
#include "formats/base/text.h"
#include "formats/store/payload.h"
#include "formats/store/store_file.h"
#include "libclient/select/raster.h"
#include "libclient/select/select.h"
#include "tools/bench/accuracy/explain.h"
#include "tools/bench/accuracy/reference.h"
#include "tools/bench/accuracy/viewer_image.h"
#include "tools/bench/base/arguments.h"
#include "tools/bench/base/measure.h"
#include "tools/bench/base/report.h"
#include "tools/bench/base/verb.h"
#include "tools/bench/bench.h"

#define VIEWS_MAX          100000u
#define SIDE_MAX           8192u
#define DAEMON_CACHE_BYTES (UINT64_C(1) << 30)
/** A fixed point of a pixel is 1/256; both roundings of a vertex, on both axes, with a margin. */
#define SUBPIXELS_ALLOWED (1.5 / 256.0)
/** What the viewer may have wrong, of the covered pixels, even where each has a reason; but ties. */
#define VIEWER_WRONG_MAX 1e-4

static const char help[] =
	"Usage: oocbench exact STORE INPUT... [--views N] [--seed S] [--size WxH]\n"
	"Compares pictures of a store with pictures of the model files it was built from (with\n"
	"--keep-ids), triangle by triangle and pixel by pixel.  Fails where a difference has no reason.\n"
	"\n"
	"  --views N     cameras around and inside the model (25)\n"
	"  --seed S      other cameras for another S (1)\n"
	"  --size WxH    of the pictures (640x480)\n"
	"  --no-viewer   without oocview: the software rasteriser alone\n"
	"  --json        results for programs\n"
	"\n"
	"All triangles of the input are kept in memory: 72 bytes each.\n"
	"\n"
	"Example:\n"
	"  oocgen plant --triangles 1000000 -o plant.ply\n"
	"  oocbuild --keep-ids -o plant.ooc plant.ply\n"
	"  oocbench exact plant.ooc plant.ply --views 25\n";

struct exact_options {
	const char *store;
	char *const *inputs;
	size_t input_count;
	uint64_t view_count;
	uint64_t seed;
	unsigned size[2]; /* width and height, pixels */
	bool no_viewer;
	bool is_json;
};

/** One comparison, over all views. */
struct comparison {
	uint64_t different;
	uint64_t ties; /* of them: of coplanar faces, which GL does not decide */
	uint64_t unexplained;
};

struct exact {
	const struct exact_options *options;
	struct store_file *store;
	struct store_node *nodes;
	struct selector *selector;
	struct reference reference;
	struct measure_daemon daemon;
	char scratch[PATH_MAX];
	struct raster *of_store, *of_snapped, *of_original;
	uint64_t *of_viewer; /* items, top row first */
	struct random random;
	/* Results. */
	uint64_t covered;
	struct comparison viewer, payloads, original;
};

/* ---- cameras ---- */

static void random_vertex(struct exact *exact, double ret[3])
{
	const struct reference *reference = &exact->reference;
	uint64_t triangle =
		(uint64_t)(random_unit(&exact->random) * (double)reference->triangle_count);

	for (int k = 0; k < 3; k++)
		ret[k] = reference->corners[triangle][0][k] + reference->superblock.origin[k];
}

static void random_direction(struct exact *exact, double ret[3])
{
	double squared;

	do {
		squared = 0.0;
		for (int k = 0; k < 3; k++) {
			ret[k] = 2.0 * random_unit(&exact->random) - 1.0;
			squared += ret[k] * ret[k];
		}
	} while (squared > 1.0 || squared < 1e-3);
	for (int k = 0; k < 3; k++)
		ret[k] /= sqrt(squared);
}

/*
 * In turn: from outside; from anywhere inside the box; close to a surface; close to a surface and
 * along an axis, where walls are seen edge-on.
 */
static void camera_random(struct exact *exact, uint64_t number, struct camera *ret)
{
	const struct store_superblock *superblock = &exact->reference.superblock;
	const struct store_superblock *superblocks[] = { superblock };
	struct camera camera;
	double direction[3];
	double diagonal2 = 0.0;
	double distance2 = 0.0;
	double reach;

	camera_frame_all(&camera, superblocks, 1,
			 (double)exact->options->size[0] / exact->options->size[1], 45.0);
	for (int k = 0; k < 3; k++) {
		double extent = superblock->box_max[k] - superblock->box_min[k];

		diagonal2 += extent * extent;
		distance2 += (camera.eye[k] - camera.at[k]) * (camera.eye[k] - camera.at[k]);
	}
	random_direction(exact, direction);
	reach = sqrt(diagonal2) * pow(10.0, -3.0 + 2.5 * random_unit(&exact->random));
	if (number % 4 == 0)
		reach = sqrt(distance2) * (0.6 + 0.8 * random_unit(&exact->random));
	if (number % 4 == 1)
		for (int k = 0; k < 3; k++)
			camera.eye[k] = superblock->origin[k] + superblock->box_min[k] +
					random_unit(&exact->random) *
						(superblock->box_max[k] - superblock->box_min[k]);
	else if (number % 4 != 0)
		random_vertex(exact, camera.eye);
	if (number % 4 == 0)
		memcpy(camera.eye, camera.at, sizeof(camera.eye));
	else
		random_vertex(exact, camera.at);
	if (number % 4 != 1)
		for (int k = 0; k < 3; k++)
			camera.eye[k] += reach * direction[k];
	if (number % 4 == 3) {
		unsigned axis = (unsigned)(3.0 * random_unit(&exact->random));

		memcpy(camera.at, camera.eye, sizeof(camera.at));
		camera.at[axis] +=
			sqrt(diagonal2) * (random_unit(&exact->random) < 0.5 ? -1.0 : 1.0);
	}
	if (number % 4 != 0)
		camera.fov_y_degrees = 30.0 + 80.0 * random_unit(&exact->random);
	*ret = camera;
}

/* ---- pictures ---- */

/* Scratch of one payload. */
struct payload_room {
	void *payload;
	void *stored;
	float *positions;
	uint32_t *indices;
	uint64_t *items;
	uint32_t triangle_room, vertex_room;
};

static void payload_room_done(struct payload_room *room)
{
	free(room->payload);
	free(room->stored);
	free(room->positions);
	free(room->indices);
	free(room->items);
}

static int payload_room_make(const struct exact *exact, struct payload_room *ret)
{
	const struct store_superblock *superblock = store_superblock(exact->store);
	struct payload_room room = { .payload = malloc(superblock->payload_bytes_max + 1) };

	for (uint64_t i = 0; i < superblock->node_count; i++) {
		if (exact->nodes[i].triangle_count > room.triangle_room)
			room.triangle_room = exact->nodes[i].triangle_count;
		if (exact->nodes[i].vertex_count > room.vertex_room)
			room.vertex_room = exact->nodes[i].vertex_count;
	}
	room.stored = malloc(STORE_PAYLOAD_BYTES_MAX);
	room.positions = malloc(((size_t)room.vertex_room + 1) * 3 * sizeof(*room.positions));
	room.indices = malloc(((size_t)room.triangle_room + 1) * 3 * sizeof(*room.indices));
	room.items = malloc(((size_t)room.triangle_room + 1) * sizeof(*room.items));
	if (!room.payload || !room.stored || !room.positions || !room.indices || !room.items) {
		payload_room_done(&room);
		return -ENOMEM;
	}
	*ret = room;
	return 0;
}

/*
 * Which corner of a stored triangle is the input's first one.  Codecs turn triangles; that changes
 * nothing but the last bit of depths, which decides ties.
 */
static uint32_t first_corner(const struct exact *exact, const struct payload_view *payload,
			     uint32_t triangle, uint64_t item)
{
	double nearest2 = INFINITY;
	uint32_t first = 0;
	double input[3][3];

	if (item >= exact->reference.triangle_count)
		return 0;
	reference_corners(&exact->reference, item, REFERENCE_SNAPPED, input);
	for (uint32_t c = 0; c < 3; c++) {
		double distance2 = 0.0;
		double position[3];

		payload_position(payload, payload_index(payload, triangle, c), position);
		for (int k = 0; k < 3; k++)
			distance2 += (position[k] - input[0][k]) * (position[k] - input[0][k]);
		if (distance2 < nearest2) {
			nearest2 = distance2;
			first = c;
		}
	}
	return first;
}

/* The payload's arrays as the rasteriser takes them. */
static int payload_unpack(const struct exact *exact, const struct payload_view *payload,
			  struct payload_room *room, struct raster_draw *ret, struct why *why)
{
	const struct payload_header *header = payload->header;
	double scale = header->scale;

	if (!payload->triangle_ids)
		return why_set(why, -EINVAL,
			       "the store has no triangle ids: build it with --keep-ids");
	for (uint32_t i = 0; i < header->vertex_count; i++) {
		double position[3];

		payload_position(payload, i, position);
		for (uint32_t k = 0; k < 3; k++)
			room->positions[3 * (size_t)i + k] =
				(float)((position[k] - header->origin[k]) / scale);
	}
	for (uint32_t i = 0; i < header->triangle_count; i++) {
		uint32_t first;

		memcpy(&room->items[i], &payload->triangle_ids[i], sizeof(room->items[i]));
		first = first_corner(exact, payload, i, room->items[i]);
		for (uint32_t c = 0; c < 3; c++)
			room->indices[3 * (size_t)i + c] =
				payload_index(payload, i, (first + c) % 3);
	}
	*ret = (struct raster_draw){ .positions = room->positions,
				     .vertex_count = header->vertex_count,
				     .indices = room->indices,
				     .triangle_count = header->triangle_count,
				     .items = room->items,
				     .scale = (float)scale };
	return 0;
}

static int draw_store(struct exact *exact, const struct camera_view *view, struct why *why)
{
	struct selection selection;
	struct payload_room room;
	int r = payload_room_make(exact, &room);

	if (r < 0)
		return why_errno(why, r, "no room for payloads");
	select_frustum(exact->selector, view, &selection);
	for (size_t i = 0; r == 0 && i < selection.entry_count; i++) {
		const struct store_node *node = &exact->nodes[selection.entries[i].node];
		struct payload_view payload;
		struct raster_draw draw;

		r = store_read_payload(exact->store, node, room.payload, room.stored, why);
		if (r < 0)
			break;
		payload_view(room.payload, &payload);
		r = payload_unpack(exact, &payload, &room, &draw, why);
		if (r < 0)
			break;
		camera_node_offset(view, payload.header->origin, draw.offset);
		r = raster_triangles(exact->of_store, view, &draw);
		if (r < 0)
			why_errno(why, r, "no room to draw");
	}
	payload_room_done(&room);
	return r;
}

/* Lets oocview draw; *ret_near is the plane that it chose. */
static int draw_viewer(struct exact *exact, const struct camera *camera, double *ret_near,
		       struct why *why)
{
	char program[PATH_MAX];
	char size[32];
	char row[CAMERA_ROW_BYTES];
	char image[PATH_MAX + 16];
	const char *argv[] = { program,
			       "--headless",
			       "--settle",
			       "--socket",
			       exact->daemon.socket_path,
			       "--size",
			       size,
			       "--channel",
			       "triangle",
			       "--camera",
			       row,
			       "--screenshot",
			       image,
			       exact->options->store,
			       NULL };
	struct measure_result result;
	int r;

	measure_program("oocview", program);
	(void)snprintf(size, sizeof(size), "%ux%u", exact->options->size[0],
		       exact->options->size[1]);
	(void)camera_to_row(camera, row);
	(void)snprintf(image, sizeof(image), "%s/view.raw", exact->scratch);
	r = measure_run(argv, &result, why);
	if (r < 0)
		return r;
	measure_result_done(&result);
	return viewer_image_read(image, exact->options->size[0], exact->options->size[1],
				 exact->of_viewer, ret_near, why);
}

/* ---- comparisons ---- */

/* The triangle of an item in a form, or NULL. */
static const double (*item_corners(const struct exact *exact, uint64_t item,
				   enum reference_form form, double room[3][3]))[3]
{
	if (item >= exact->reference.triangle_count)
		return NULL;
	reference_corners(&exact->reference, item, form, room);
	return (const double(*)[3])room;
}

static void compare(const struct exact *exact, const struct explain *explain,
		    enum reference_form form, const uint64_t *items, const uint64_t *right,
		    struct comparison *sum)
{
	for (uint32_t y = 0; y < explain->height; y++)
		for (uint32_t x = 0; x < explain->width; x++) {
			size_t pixel = (size_t)y * explain->width + x;
			enum explain_reason reason;
			double room_a[3][3];
			double room_b[3][3];

			if (items[pixel] == right[pixel])
				continue;
			reason = explain_difference(
				explain, item_corners(exact, items[pixel], form, room_a),
				item_corners(exact, right[pixel], form, room_b), x, y);
			sum->different++;
			sum->ties += reason == EXPLAIN_TIE;
			sum->unexplained += reason == EXPLAIN_NONE;
		}
}

static int view_compare(struct exact *exact, const struct camera *camera, struct why *why)
{
	const struct exact_options *options = exact->options;
	const struct store_superblock *superblock = &exact->reference.superblock;
	double near = camera_near(camera, superblock);
	struct camera_view view;
	struct explain explain = { .view = &view,
				   .width = options->size[0],
				   .height = options->size[1],
				   .pixels = SUBPIXELS_ALLOWED };
	int r = 0;

	if (!options->no_viewer)
		r = draw_viewer(exact, camera, &near, why);
	if (r < 0)
		return r;
	r = camera_view_init(&view, camera, superblock, (double)options->size[0] / options->size[1],
			     near);
	if (r < 0)
		return why_errno(why, r, "a camera of ours");
	raster_clear(exact->of_store);
	raster_clear(exact->of_snapped);
	raster_clear(exact->of_original);
	r = draw_store(exact, &view, why);
	if (r < 0)
		return r;
	r = reference_draw(&exact->reference, REFERENCE_SNAPPED, &view, exact->of_snapped);
	if (r == 0)
		r = reference_draw(&exact->reference, REFERENCE_ORIGINAL, &view,
				   exact->of_original);
	if (r < 0)
		return why_errno(why, r, "drawing the input");

	for (size_t i = 0; i < (size_t)options->size[0] * options->size[1]; i++)
		exact->covered += raster_items(exact->of_snapped)[i] != RASTER_ITEM_NONE;
	if (!options->no_viewer)
		compare(exact, &explain, REFERENCE_SNAPPED, exact->of_viewer,
			raster_items(exact->of_snapped), &exact->viewer);
	compare(exact, &explain, REFERENCE_SNAPPED, raster_items(exact->of_store),
		raster_items(exact->of_snapped), &exact->payloads);
	explain.error = exact->reference.moved_max;
	compare(exact, &explain, REFERENCE_ORIGINAL, raster_items(exact->of_snapped),
		raster_items(exact->of_original), &exact->original);
	return 0;
}

/* ---- the verb ---- */

static void report_comparison(struct report *report, const struct exact *exact, const char *key,
			      const char *title, const struct comparison *comparison)
{
	double covered = exact->covered > 0 ? (double)exact->covered : 1.0;
	double all = (double)exact->options->view_count * exact->options->size[0] *
		     exact->options->size[1];

	report_group_begin(report, key, title);
	report_number(report, "different", "pixels that differ", (double)comparison->different, "");
	report_number(report, "of_covered", "of covered pixels",
		      (double)comparison->different / covered, "");
	report_number(report, "of_all", "of all pixels", (double)comparison->different / all, "");
	report_number(report, "ties", "ties: coplanar faces at the same depth",
		      (double)comparison->ties, "");
	report_number(report, "unexplained", "neither at an edge nor a tie",
		      (double)comparison->unexplained, "");
	report_group_end(report);
}

/* Prints the results.  Returns: is everything as it has to be? */
static bool exact_report(const struct exact *exact)
{
	const struct store_superblock *superblock = &exact->reference.superblock;
	/* A double that is rounded to a float moves by half of a float's last bit. */
	bool is_within = superblock->error == 0.0
				 ? exact->reference.moved_max <= superblock->error_measured
				 : exact->reference.moved_max <= superblock->error;
	bool holds = is_within && exact->payloads.different == 0 &&
		     exact->original.unexplained == 0 && exact->viewer.unexplained == 0 &&
		     (double)(exact->viewer.different - exact->viewer.ties) <=
			     VIEWER_WRONG_MAX * (double)exact->covered;
	struct report report;

	report_begin(&report, exact->options->is_json);
	report_number(&report, "views", "views", (double)exact->options->view_count, "");
	report_number(&report, "triangles", "triangles of the input",
		      (double)exact->reference.triangle_count, "");
	report_number(&report, "covered", "covered pixels", (double)exact->covered, "");
	report_number(&report, "error", "error allowed", superblock->error, "model units");
	report_number(&report, "moved_max", "farthest that a vertex was moved",
		      exact->reference.moved_max, "model units");
	if (!exact->options->no_viewer)
		report_comparison(&report, exact, "viewer", "viewer / input on the store's grid",
				  &exact->viewer);
	report_comparison(&report, exact, "store", "store / input on the store's grid",
			  &exact->payloads);
	report_comparison(&report, exact, "original", "input on the store's grid / as it is",
			  &exact->original);
	report_text(&report, "holds", "everything holds", holds ? "yes" : "no");
	report_end(&report);
	return holds;
}

static int exact_open(struct exact *exact, struct why *why)
{
	const struct exact_options *options = exact->options;
	const struct store_superblock *superblock = NULL;
	int r = store_open_path(options->store, &exact->store, why);

	if (r == 0) {
		superblock = store_superblock(exact->store);
		exact->nodes = calloc(superblock->node_count + 1, sizeof(*exact->nodes));
		r = exact->nodes ? store_load_hs(exact->store, exact->nodes, why)
				 : why_set(why, -ENOMEM, "out of memory");
	}
	if (r < 0) {
		why_prefix(why, "%s", options->store);
		return r;
	}
	r = reference_read(&exact->reference, superblock, options->inputs, options->input_count,
			   why);
	if (r < 0)
		return r;
	if (exact->reference.triangle_count != superblock->triangles_in ||
	    exact->reference.triangle_count == 0)
		return why_set(
			why, -EINVAL,
			"%s was made of %llu triangles, but the input has %llu: not its input",
			options->store, (unsigned long long)superblock->triangles_in,
			(unsigned long long)exact->reference.triangle_count);
	r = reference_adopt_origins(&exact->reference, exact->store, exact->nodes, why);
	if (r < 0)
		return r;
	exact->of_viewer =
		calloc((size_t)options->size[0] * options->size[1], sizeof(*exact->of_viewer));
	if (!exact->of_viewer || selector_create(superblock, exact->nodes, &exact->selector) < 0 ||
	    raster_create(options->size[0], options->size[1], &exact->of_store) < 0 ||
	    raster_create(options->size[0], options->size[1], &exact->of_snapped) < 0 ||
	    raster_create(options->size[0], options->size[1], &exact->of_original) < 0)
		return why_set(why, -ENOMEM, "out of memory");
	return 0;
}

static int exact_run(struct exact *exact, struct why *why)
{
	int r = exact_open(exact, why);

	if (r == 0 && !exact->options->no_viewer)
		r = measure_daemon_start(exact->scratch, DAEMON_CACHE_BYTES, 0, &exact->daemon,
					 why);
	for (uint64_t i = 0; r == 0 && i < exact->options->view_count; i++) {
		struct camera camera;

		camera_random(exact, i, &camera);
		r = view_compare(exact, &camera, why);
	}
	return r;
}

static void exact_done(struct exact *exact)
{
	if (exact->daemon.child.pid > 0)
		measure_daemon_stop(&exact->daemon);
	raster_destroy(exact->of_store);
	raster_destroy(exact->of_snapped);
	raster_destroy(exact->of_original);
	selector_destroy(exact->selector);
	reference_done(&exact->reference);
	free(exact->of_viewer);
	free(exact->nodes);
	store_close(exact->store);
}

int verb_exact(int argc, char **argv)
{
	struct exact_options options = { .view_count = 25, .seed = 1, .size = { 640, 480 } };
	struct exact exact = { .options = &options };
	const struct argument table[] = {
		{ "views", ARGUMENT_NUMBER, &options.view_count, 1, VIEWS_MAX },
		{ "seed", ARGUMENT_NUMBER, &options.seed },
		{ "size", ARGUMENT_PICTURE, options.size, 1, SIDE_MAX },
		{ "no-viewer", ARGUMENT_FLAG, &options.no_viewer },
		{ "json", ARGUMENT_FLAG, &options.is_json },
		{ NULL },
	};
	const struct arguments arguments = { "exact", help,
					     table,   2,
					     -1,      "name a store and what it was built from" };
	char **operands;
	struct why why = { "" };
	bool holds = false;
	int r;

	r = arguments_parse(&arguments, argc, argv, &operands);
	if (r != ARGUMENTS_OK)
		return r;
	options.store = operands[0];
	options.inputs = operands + 1;
	while (options.inputs[options.input_count])
		options.input_count++;
	exact.random.state = options.seed;

	r = measure_scratch_make(NULL, exact.scratch, &why);
	if (r == 0) {
		r = exact_run(&exact, &why);
		if (r == 0)
			holds = exact_report(&exact);
		exact_done(&exact);
		measure_scratch_remove(exact.scratch);
	}
	return verb_status("exact", r, &why) || !holds;
}
