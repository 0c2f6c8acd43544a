/* SPDX-License-Identifier: MIT */
#include "tools/bench/accuracy/reference.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/import/import.h"
#include "formats/store/payload.h"
#include "tools/bench/base/measure.h"

#define IMPORT_MEMORY_BYTES (UINT64_C(1) << 30)
/** Triangles that are drawn at a time. */
#define DRAW_TRIANGLES 16384u

/* ---- reading ---- */

static int part_ignore(void *arg, const struct import_part *part, struct why *why)
{
	(void)arg;
	(void)part;
	(void)why;
	return 0;
}

struct reader {
	struct reference *reference;
	const struct import_input *input;
};

static void corner_read(const struct reader *reader, const struct import_batch *batch,
			size_t corner, double ret[3])
{
	const double *m = reader->input->placement;
	double p[3];

	for (size_t k = 0; k < 3; k++)
		p[k] = batch->positions_double ? batch->positions64[3 * corner + k]
					       : (double)batch->positions32[3 * corner + k];
	for (size_t k = 0; k < 3; k++) {
		double world = p[k];

		if (reader->input->placed)
			world = m[4 * k] * p[0] + m[4 * k + 1] * p[1] + m[4 * k + 2] * p[2] +
				m[4 * k + 3];
		ret[k] = world - reader->reference->superblock.origin[k];
	}
}

/*
 * Positions on a grid go to its nearest point, ties to even; others become floats from an origin,
 * which changes nothing where they are floats and the origin is 0.
 */
static double snap(const struct reference *reference, double value, double origin)
{
	if (reference->step == 0.0)
		return origin + (double)(float)(value - origin);
	/* The step is a power of two, so that only nearbyint() rounds. */
	return nearbyint(value * reference->steps_a_unit) * reference->step;
}

static const double no_origin[3];

static void note_moves(struct reference *reference, const double corners[3][3],
		       const double origin[3])
{
	for (size_t c = 0; c < 3; c++) {
		double squared = 0.0;

		for (size_t k = 0; k < 3; k++) {
			double moved = snap(reference, corners[c][k], origin[k]) - corners[c][k];

			squared += moved * moved;
		}
		reference->moved_max = fmax(reference->moved_max, sqrt(squared));
	}
}

static int batch_read(void *arg, const struct import_batch *batch, struct why *why)
{
	struct reader *reader = arg;
	struct reference *reference = reader->reference;

	if (reference->triangle_count + batch->triangle_count > reference->room) {
		uint64_t room = 2 * reference->room + IMPORT_BATCH_TRIANGLES;
		double(*grown)[3][3] = reallocarray(reference->corners, room, sizeof(*grown));

		if (!grown)
			return why_set(why, -ENOMEM, "the input does not fit in memory");
		reference->corners = grown;
		reference->room = room;
	}
	for (size_t i = 0; i < batch->triangle_count; i++) {
		double(*corners)[3] = reference->corners[reference->triangle_count++];

		for (size_t c = 0; c < 3; c++)
			corner_read(reader, batch, 3 * i + c, corners[c]);
		note_moves(reference, (const double(*)[3])corners, no_origin);
	}
	return measure_was_cancelled() ? why_set(why, -ECANCELED, "interrupted") : 0;
}

int reference_read(struct reference *reference, const struct store_superblock *superblock,
		   char *const *inputs, size_t input_count, struct why *why)
{
	struct import_options options = { .memory_bytes = IMPORT_MEMORY_BYTES };
	struct import_inputs expanded;
	char scratch[PATH_MAX];
	int r;

	*reference = (struct reference){ .superblock = *superblock };
	if (superblock->step_exponent != STORE_STEP_NONE) {
		reference->step = ldexp(1.0, superblock->step_exponent);
		reference->steps_a_unit = 1.0 / reference->step;
	}
	r = import_inputs_expand(inputs, input_count, &expanded, why);
	if (r < 0)
		return r;
	r = measure_scratch_make(NULL, scratch, why);
	if (r < 0) {
		import_inputs_done(&expanded);
		return r;
	}
	options.scratch_directory = scratch;
	for (size_t i = 0; r == 0 && i < expanded.input_count; i++) {
		struct reader reader = { reference, &expanded.inputs[i] };
		struct import_sink sink = { .part = part_ignore,
					    .batch = batch_read,
					    .arg = &reader };
		struct import_info info;

		r = import_file(expanded.inputs[i].path, &options, &sink, &info, why);
		if (r < 0)
			why_prefix(why, "%s", expanded.inputs[i].path);
	}
	measure_scratch_remove(scratch);
	import_inputs_done(&expanded);
	if (r < 0)
		reference_done(reference);
	return r;
}

void reference_done(struct reference *reference)
{
	for (size_t i = 0; i < reference->group_count; i++)
		free(reference->groups[i].triangles);
	free(reference->groups);
	free(reference->corners);
	*reference = (struct reference){ .corners = NULL };
}

/* ---- origins ---- */

static int group_adopt(struct reference *reference, const void *payload, struct why *why)
{
	struct reference_group *group = &reference->groups[reference->group_count];
	struct payload_view view;

	payload_view(payload, &view);
	if (!view.triangle_ids)
		return why_set(why, -EINVAL,
			       "the store has no triangle ids: build it with --keep-ids");
	memcpy(group->origin, view.header->origin, sizeof(group->origin));
	group->triangle_count = view.header->triangle_count;
	group->triangles = malloc((group->triangle_count + 1) * sizeof(*group->triangles));
	if (!group->triangles)
		return why_set(why, -ENOMEM, "out of memory");
	reference->group_count++;
	memcpy(group->triangles, view.triangle_ids,
	       group->triangle_count * sizeof(*group->triangles));
	for (uint64_t i = 0; i < group->triangle_count; i++) {
		if (group->triangles[i] >= reference->triangle_count)
			return why_set(why, -EINVAL,
				       "the store has a triangle that the input has not");
		note_moves(reference, (const double(*)[3])reference->corners[group->triangles[i]],
			   group->origin);
	}
	return 0;
}

int reference_adopt_origins(struct reference *reference, const struct store_file *store,
			    const struct store_node *nodes, struct why *why)
{
	const struct store_superblock *superblock = &reference->superblock;
	void *payload;
	void *scratch;
	int r = 0;

	/* Floats that are counted from 0 did not move at all. */
	if (reference->step > 0.0 || reference->moved_max == 0.0)
		return 0;
	reference->moved_max = 0.0;
	reference->groups = calloc(superblock->node_count + 1, sizeof(*reference->groups));
	payload = malloc(superblock->payload_bytes_max + 1);
	scratch = malloc(STORE_PAYLOAD_BYTES_MAX);
	if (!reference->groups || !payload || !scratch)
		r = why_set(why, -ENOMEM, "out of memory");
	for (uint64_t i = 0; r == 0 && i < superblock->node_count; i++) {
		if (nodes[i].first_child != STORE_NODE_NONE || nodes[i].payload_id == 0)
			continue;
		r = measure_was_cancelled()
			    ? why_set(why, -ECANCELED, "interrupted")
			    : store_read_payload(store, &nodes[i], payload, scratch, why);
		if (r == 0)
			r = group_adopt(reference, payload, why);
	}
	free(payload);
	free(scratch);
	return r;
}

/* ---- drawing ---- */

static void corners_in_form(const struct reference *reference, uint64_t triangle,
			    enum reference_form form, const double origin[3], double ret[3][3])
{
	memcpy(ret, reference->corners[triangle], sizeof(reference->corners[triangle]));
	for (size_t c = 0; form == REFERENCE_SNAPPED && c < 3; c++)
		for (size_t k = 0; k < 3; k++)
			ret[c][k] = snap(reference, ret[c][k], origin[k]);
}

void reference_corners(const struct reference *reference, uint64_t triangle,
		       enum reference_form form, double ret[3][3])
{
	/* What floats from a near origin lose is nothing to who asks for doubles. */
	if (reference->groups)
		form = REFERENCE_ORIGINAL;
	corners_in_form(reference, triangle, form, no_origin, ret);
}

/*
 * A triangle without area is in no store: rounded to subpixels it could cover a pixel.  What double
 * precision cannot tell from zero, quadruple precision can.
 */
static bool has_area(const double corners[3][3])
{
	for (size_t k = 0; k < 3; k++) {
		size_t j = (k + 1) % 3;
		double ak = corners[1][k] - corners[0][k];
		double aj = corners[1][j] - corners[0][j];
		double bk = corners[2][k] - corners[0][k];
		double bj = corners[2][j] - corners[0][j];

		if (fabs(ak * bj - aj * bk) > 0x1p-40 * (fabs(ak * bj) + fabs(aj * bk)))
			return true;
	}
	for (size_t k = 0; k < 3; k++) {
		size_t j = (k + 1) % 3;
		__float128 ak = (__float128)corners[1][k] - corners[0][k];
		__float128 aj = (__float128)corners[1][j] - corners[0][j];
		__float128 bk = (__float128)corners[2][k] - corners[0][k];
		__float128 bj = (__float128)corners[2][j] - corners[0][j];

		if (ak * bj != aj * bk)
			return true;
	}
	return false;
}

struct batch {
	float positions[9 * DRAW_TRIANGLES];
	uint32_t indices[3 * DRAW_TRIANGLES];
	uint64_t items[DRAW_TRIANGLES];
	uint32_t triangle_count;
};

/* One pass over triangles that are counted from one origin. */
struct pass {
	const struct reference *reference;
	enum reference_form form;
	const struct camera_view *view;
	struct raster *raster;
	struct batch *batch;
	double scale;
	double origin[3];
	float offset[3];
};

/* Could a pixel show it?  Behind the eye or beyond one side plane it cannot. */
static bool is_in_view(const struct camera_view *view, const double corners[3][3])
{
	for (size_t i = 0; i < 4; i++) {
		const double *p = view->planes[i];
		double reach = 1e-5 * (fabs(corners[0][0] - view->eye[0]) +
				       fabs(corners[0][1] - view->eye[1]) +
				       fabs(corners[0][2] - view->eye[2]));
		bool beyond = true;

		for (size_t c = 0; c < 3 && beyond; c++)
			beyond = p[0] * corners[c][0] + p[1] * corners[c][1] +
					 p[2] * corners[c][2] + p[3] <
				 -reach;
		if (beyond)
			return false;
	}
	return true;
}

static void batch_add(const struct pass *pass, uint64_t triangle)
{
	struct batch *batch = pass->batch;
	double corners[3][3];

	corners_in_form(pass->reference, triangle, pass->form, pass->origin, corners);
	if (!is_in_view(pass->view, (const double(*)[3])corners) ||
	    !has_area((const double(*)[3])corners))
		return;
	for (size_t c = 0; c < 3; c++)
		for (size_t k = 0; k < 3; k++)
			batch->positions[9 * (size_t)batch->triangle_count + 3 * c + k] =
				(float)((corners[c][k] - pass->origin[k]) / pass->scale);
	batch->items[batch->triangle_count++] = triangle;
}

static int batch_draw(const struct pass *pass)
{
	struct raster_draw draw = {
		.positions = pass->batch->positions,
		.vertex_count = 3 * pass->batch->triangle_count,
		.indices = pass->batch->indices,
		.triangle_count = pass->batch->triangle_count,
		.items = pass->batch->items,
		.scale = (float)pass->scale,
		.offset = { pass->offset[0], pass->offset[1], pass->offset[2] },
	};

	pass->batch->triangle_count = 0;
	return measure_was_cancelled() ? -ECANCELED
				       : raster_triangles(pass->raster, pass->view, &draw);
}

/* triangles:  ordinals; NULL: 0, 1, and so on. */
static int pass_draw(const struct pass *pass, const uint64_t *triangles, uint64_t count)
{
	int r = 0;

	for (uint64_t i = 0; r == 0 && i < count; i++) {
		batch_add(pass, triangles ? triangles[i] : i);
		if (pass->batch->triangle_count == DRAW_TRIANGLES)
			r = batch_draw(pass);
	}
	return r < 0 ? r : batch_draw(pass);
}

int reference_draw(const struct reference *reference, enum reference_form form,
		   const struct camera_view *view, struct raster *raster)
{
	struct pass pass = { .reference = reference,
			     .form = form,
			     .view = view,
			     .raster = raster,
			     .batch = malloc(sizeof(*pass.batch)),
			     .scale = 1.0 };
	int r = 0;

	if (!pass.batch)
		return -ENOMEM;
	pass.batch->triangle_count = 0;
	for (uint32_t i = 0; i < 3 * DRAW_TRIANGLES; i++)
		pass.batch->indices[i] = i;
	if (form == REFERENCE_ORIGINAL) {
		/* Counted from the anchor floats are finest where it is looked at from. */
		memcpy(pass.origin, view->anchor, sizeof(pass.origin));
		r = pass_draw(&pass, NULL, reference->triangle_count);
	} else if (!reference->groups) {
		if (reference->step > 0.0)
			pass.scale = reference->step;
		camera_node_offset(view, no_origin, pass.offset);
		r = pass_draw(&pass, NULL, reference->triangle_count);
	}
	for (size_t i = 0; form == REFERENCE_SNAPPED && r == 0 && i < reference->group_count; i++) {
		const struct reference_group *group = &reference->groups[i];

		memcpy(pass.origin, group->origin, sizeof(pass.origin));
		camera_node_offset(view, group->origin, pass.offset);
		r = pass_draw(&pass, group->triangles, group->triangle_count);
	}
	free(pass.batch);
	return r;
}
