/* SPDX-License-Identifier: MIT */
#include "tools/bench/reference.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/import/import.h"
#include "tools/bench/measure.h"

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

/* Raw floats stay as they are; positions on a grid go to its nearest point, ties to even. */
static double snap(const struct reference *reference, double value)
{
	if (reference->step == 0.0)
		return (double)(float)value;
	/* The step is a power of two, so that only nearbyint() rounds. */
	return nearbyint(value * reference->steps_a_unit) * reference->step;
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

		for (size_t c = 0; c < 3; c++) {
			double squared = 0.0;

			corner_read(reader, batch, 3 * i + c, corners[c]);
			for (size_t k = 0; k < 3; k++) {
				double moved = snap(reference, corners[c][k]) - corners[c][k];

				squared += moved * moved;
			}
			reference->moved_max = fmax(reference->moved_max, sqrt(squared));
		}
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
	free(reference->corners);
	reference->corners = NULL;
}

/* ---- drawing ---- */

void reference_corners(const struct reference *reference, uint64_t triangle,
		       enum reference_form form, double ret[3][3])
{
	for (size_t c = 0; c < 3; c++)
		for (size_t k = 0; k < 3; k++) {
			double value = reference->corners[triangle][c][k];

			ret[c][k] = form == REFERENCE_SNAPPED ? snap(reference, value) : value;
		}
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

static void batch_add(struct batch *batch, const struct reference *reference, uint64_t triangle,
		      enum reference_form form, const struct camera_view *view, double scale)
{
	double corners[3][3];

	reference_corners(reference, triangle, form, corners);
	if (!is_in_view(view, corners) || !has_area(corners))
		return;
	for (size_t c = 0; c < 3; c++)
		for (size_t k = 0; k < 3; k++) {
			/* Snapped ones in steps from the origin, exact; others from the anchor. */
			double value = form == REFERENCE_SNAPPED ? corners[c][k] / scale
								 : corners[c][k] - view->anchor[k];

			batch->positions[9 * (size_t)batch->triangle_count + 3 * c + k] =
				(float)value;
		}
	batch->items[batch->triangle_count++] = triangle;
}

int reference_draw(const struct reference *reference, enum reference_form form,
		   const struct camera_view *view, struct raster *raster)
{
	static const double origin[3];
	struct batch *batch = malloc(sizeof(*batch));
	struct raster_draw draw = { .scale = 1.0f };
	uint64_t next = 0;
	int r = 0;

	if (!batch)
		return -ENOMEM;
	if (form == REFERENCE_SNAPPED) {
		draw.scale = reference->step > 0.0 ? (float)reference->step : 1.0f;
		camera_node_offset(view, origin, draw.offset);
	}
	draw.positions = batch->positions;
	draw.indices = batch->indices;
	draw.items = batch->items;
	for (uint32_t i = 0; i < 3 * DRAW_TRIANGLES; i++)
		batch->indices[i] = i;
	while (r == 0 && next < reference->triangle_count) {
		batch->triangle_count = 0;
		for (; next < reference->triangle_count && batch->triangle_count < DRAW_TRIANGLES;
		     next++)
			batch_add(batch, reference, next, form, view, (double)draw.scale);
		draw.triangle_count = batch->triangle_count;
		draw.vertex_count = 3 * batch->triangle_count;
		r = measure_was_cancelled() ? -ECANCELED : raster_triangles(raster, view, &draw);
	}
	free(batch);
	return r;
}
