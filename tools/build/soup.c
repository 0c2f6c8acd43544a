/* SPDX-License-Identifier: MIT */
#include "tools/build/soup.h"

#include <errno.h>
#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/store/payload.h"

/** One file being read: the block that is being filled, and what is told when the file ends. */
struct intake {
	struct soup *soup;
	struct soup_section *section;
	const struct import_input *input;
	struct progress *progress;
	bool drop_non_finite;

	uint32_t *part_of; /* by the file's part number */
	uint32_t part_count;
	uint32_t part_max;

	uint8_t *staging; /* its arrays while they grow */
	struct soup_block block;
	float normal_matrix[9];
	double box_min[3];
	double box_max[3];
	uint64_t non_finite_count;
	uint64_t read_bytes; /* as last told to the progress */
	bool any_normals;
	bool all_normals;
	bool any_colours;
};

/** Where the arrays of a growing block begin in intake.staging. */
#define STAGE_PARTS   ((size_t)SOUP_BLOCK_TRIANGLES * 72)
#define STAGE_NORMALS (STAGE_PARTS + (size_t)SOUP_BLOCK_TRIANGLES * 4)
#define STAGE_COLOURS (STAGE_NORMALS + (size_t)SOUP_BLOCK_TRIANGLES * 12)
#define STAGE_BYTES   (STAGE_COLOURS + (size_t)SOUP_BLOCK_TRIANGLES * 12)

static size_t position_bytes(const struct soup_block *block)
{
	return (size_t)block->triangle_count * 9 *
	       (block->doubles ? sizeof(double) : sizeof(float));
}

size_t soup_block_bytes(const struct soup_block *block)
{
	size_t each =
		(block->one_part ? 0 : 4) + (block->normals ? 12 : 0) + (block->colours ? 12 : 0);

	return position_bytes(block) + block->triangle_count * each;
}

/* ---- blocks ---- */

static int soup_add_block(struct soup *soup, const struct soup_block *block)
{
	int r = 0;

	(void)pthread_mutex_lock(&soup->lock);
	if (soup->block_count == soup->block_max) {
		size_t block_max = u64_max(soup->block_max * 3 / 2, 256);
		struct soup_block *blocks = reallocarray(soup->blocks, block_max, sizeof(*blocks));

		if (blocks) {
			budget_charge(soup->budget,
				      (block_max - soup->block_max) * sizeof(*blocks));
			soup->blocks = blocks;
			soup->block_max = block_max;
		} else {
			r = -ENOMEM;
		}
	}
	if (r == 0)
		soup->blocks[soup->block_count++] = *block;
	(void)pthread_mutex_unlock(&soup->lock);
	return r;
}

/* Sends the growing block to the spool. */
static int intake_flush(struct intake *intake, struct why *why)
{
	struct soup_block *block = &intake->block;
	size_t count = block->triangle_count;
	struct iovec parts[4] = {
		{ intake->staging, position_bytes(block) },
	};
	size_t part_count = 1;
	int r;

	if (count == 0)
		return 0;
	if (!block->one_part)
		parts[part_count++] = (struct iovec){ intake->staging + STAGE_PARTS, count * 4 };
	if (block->normals)
		parts[part_count++] = (struct iovec){ intake->staging + STAGE_NORMALS, count * 12 };
	if (block->colours)
		parts[part_count++] = (struct iovec){ intake->staging + STAGE_COLOURS, count * 12 };
	r = spool_gather(intake->soup->spool, parts, part_count, &block->address, why);
	if (r < 0)
		return r;
	r = soup_add_block(intake->soup, block);
	if (r < 0)
		return why_set(why, r, "no memory for the table of blocks");
	block->first_triangle += count;
	block->triangle_count = 0;
	return 0;
}

/* ---- what the importer tells ---- */

static int on_part(void *arg, const struct import_part *part, struct why *why)
{
	struct intake *intake = arg;
	int r;

	if (intake->part_count == intake->part_max) {
		uint32_t part_max = intake->part_max == 0 ? 64 : intake->part_max * 2;
		uint32_t *part_of = reallocarray(intake->part_of, part_max, sizeof(*part_of));

		if (!part_of)
			return why_set(why, -ENOMEM, "no memory for %u parts", part_max);
		intake->part_of = part_of;
		intake->part_max = part_max;
	}
	r = part_list_add(&intake->section->parts, part, &intake->part_of[intake->part_count]);
	if (r < 0)
		return why_set(why, r, "no memory for %u parts", intake->part_count);
	intake->part_count++;
	return 0;
}

static void place_point(const double placement[12], const double point[3], double ret[3])
{
	for (unsigned i = 0; i < 3; i++)
		ret[i] = placement[4 * i] * point[0] + placement[4 * i + 1] * point[1] +
			 placement[4 * i + 2] * point[2] + placement[4 * i + 3];
}

/* Normals turn with the cofactors of the placement, whatever it scales. */
static void normal_matrix_of(const double m[12], float ret[9])
{
	for (unsigned i = 0; i < 3; i++) {
		for (unsigned j = 0; j < 3; j++) {
			unsigned i1 = (i + 1) % 3;
			unsigned i2 = (i + 2) % 3;
			unsigned j1 = (j + 1) % 3;
			unsigned j2 = (j + 2) % 3;

			ret[3 * i + j] = (float)(m[4 * i1 + j1] * m[4 * i2 + j2] -
						 m[4 * i1 + j2] * m[4 * i2 + j1]);
		}
	}
}

static uint32_t encode_normal(const struct intake *intake, const float *normal)
{
	float turned[3];
	int16_t code[2];
	uint32_t packed;
	float length_squared;

	for (unsigned i = 0; i < 3; i++)
		turned[i] = intake->normal_matrix[3 * i] * normal[0] +
			    intake->normal_matrix[3 * i + 1] * normal[1] +
			    intake->normal_matrix[3 * i + 2] * normal[2];
	length_squared = turned[0] * turned[0] + turned[1] * turned[1] + turned[2] * turned[2];
	if (!(length_squared > 0) || !isfinite(length_squared))
		return SOUP_NORMAL_NONE;
	payload_encode_oct16(turned, code);
	memcpy(&packed, code, sizeof(packed));
	return packed;
}

/* Widens the box by points that may or may not be finite.  Returns: how many triangles are not. */
static uint64_t widen_slowly(struct intake *intake, const double *positions, uint32_t count,
			     uint32_t *ret_first)
{
	uint64_t non_finite_count = 0;

	for (uint32_t i = 0; i < count; i++) {
		bool finite = true;

		for (unsigned k = 0; k < 9; k++)
			finite = finite && isfinite(positions[9 * i + k]);
		if (!finite) {
			if (non_finite_count++ == 0)
				*ret_first = i;
			continue;
		}
		for (unsigned k = 0; k < 9; k++) {
			double value = positions[9 * i + k];

			intake->box_min[k % 3] = fmin(intake->box_min[k % 3], value);
			intake->box_max[k % 3] = fmax(intake->box_max[k % 3], value);
		}
	}
	return non_finite_count;
}

/* The same of floats that need no placing, if all are finite.  Returns: are they? */
static bool widen_floats(struct intake *intake, const float *positions, uint32_t count)
{
	float low[9];
	float high[9];
	uint32_t odd = 0;

	memcpy(low, positions, sizeof(low));
	memcpy(high, positions, sizeof(high));
	for (uint32_t i = 0; i < count; i++) {
		for (unsigned k = 0; k < 9; k++) {
			float value = positions[9 * i + k];
			uint32_t bits;

			memcpy(&bits, &value, sizeof(bits));
			/* All ones in the exponent: infinite, or no number. */
			odd |= (bits & UINT32_C(0x7f800000)) == UINT32_C(0x7f800000);
			low[k] = value < low[k] ? value : low[k];
			high[k] = value > high[k] ? value : high[k];
		}
	}
	if (odd)
		return false;
	for (unsigned k = 0; k < 9; k++) {
		intake->box_min[k % 3] = fmin(intake->box_min[k % 3], (double)low[k]);
		intake->box_max[k % 3] = fmax(intake->box_max[k % 3], (double)high[k]);
	}
	return true;
}

/* Takes some triangles of a batch into account: box, and what is not finite. */
static int intake_measure(struct intake *intake, const struct import_batch *batch, struct why *why)
{
	double placed[9 * 64];
	uint32_t first = 0;

	if (!batch->positions_double && !intake->input->placed &&
	    widen_floats(intake, batch->positions32, batch->triangle_count))
		return 0;
	for (uint32_t begin = 0; begin < batch->triangle_count; begin += 64) {
		uint32_t count =
			batch->triangle_count - begin < 64 ? batch->triangle_count - begin : 64;
		uint64_t odd_count;

		for (uint32_t i = 0; i < count * 3; i++) {
			size_t from = (size_t)begin * 9 + 3 * i;
			double point[3];

			for (unsigned k = 0; k < 3; k++)
				point[k] = batch->positions_double
						   ? batch->positions64[from + k]
						   : (double)batch->positions32[from + k];
			if (intake->input->placed)
				place_point(intake->input->placement, point, &placed[3 * i]);
			else
				memcpy(&placed[3 * i], point, sizeof(point));
		}
		odd_count = widen_slowly(intake, placed, count, &first);
		if (odd_count > 0 && !intake->drop_non_finite)
			return why_set(why, -EINVAL,
				       "triangle %llu has a coordinate that is not finite: "
				       "--non-finite drop leaves such triangles out",
				       (unsigned long long)(intake->section->triangle_count +
							    begin + first));
		intake->non_finite_count += odd_count;
	}
	return 0;
}

/* Appends some triangles of a batch to the growing block, which has room for them. */
static void intake_append(struct intake *intake, const struct import_batch *batch, uint32_t begin,
			  uint32_t count)
{
	struct soup_block *block = &intake->block;
	size_t at = block->triangle_count;
	uint32_t *parts = (uint32_t *)(void *)(intake->staging + STAGE_PARTS) + at;
	uint32_t *normals = (uint32_t *)(void *)(intake->staging + STAGE_NORMALS) + at * 3;
	uint32_t *colours = (uint32_t *)(void *)(intake->staging + STAGE_COLOURS) + at * 3;

	if (block->doubles)
		memcpy(intake->staging + at * 72, batch->positions64 + (size_t)begin * 9,
		       (size_t)count * 72);
	else
		memcpy(intake->staging + at * 36, batch->positions32 + (size_t)begin * 9,
		       (size_t)count * 36);
	if (at == 0) {
		block->part = intake->part_of[batch->part];
		block->one_part = true;
	}
	block->one_part = block->one_part && block->part == intake->part_of[batch->part];
	for (uint32_t i = 0; i < count; i++)
		parts[i] = intake->part_of[batch->part];
	if (block->normals)
		for (size_t i = 0; i < (size_t)count * 3; i++)
			normals[i] =
				encode_normal(intake, batch->normals + ((size_t)begin * 3 + i) * 3);
	if (block->colours)
		memcpy(colours, batch->colours + (size_t)begin * 3, (size_t)count * 12);
	block->triangle_count += count;
}

static int on_batch(void *arg, const struct import_batch *batch, struct why *why)
{
	struct intake *intake = arg;
	struct soup_block *block = &intake->block;
	uint32_t begin = 0;
	int r;

	CHECK(batch->part < intake->part_count);
	r = intake_measure(intake, batch, why);
	if (r == 0 && (block->doubles != batch->positions_double ||
		       block->normals != (batch->normals != NULL) ||
		       block->colours != (batch->colours != NULL)))
		r = intake_flush(intake, why);
	block->doubles = batch->positions_double;
	block->normals = batch->normals != NULL;
	block->colours = batch->colours != NULL;
	intake->section->doubles |= batch->positions_double || intake->input->placed;
	intake->any_normals |= block->normals;
	intake->all_normals &= block->normals;
	intake->any_colours |= block->colours;
	while (begin < batch->triangle_count && r == 0) {
		uint32_t room = SOUP_BLOCK_TRIANGLES - block->triangle_count;
		uint32_t count =
			batch->triangle_count - begin < room ? batch->triangle_count - begin : room;

		intake_append(intake, batch, begin, count);
		begin += count;
		if (block->triangle_count == SOUP_BLOCK_TRIANGLES)
			r = intake_flush(intake, why);
	}
	intake->section->triangle_count += batch->triangle_count;
	progress_add_triangles(intake->progress, batch->triangle_count);
	return r;
}

static void on_progress(void *arg, uint64_t read_bytes, uint64_t total_bytes)
{
	struct intake *intake = arg;

	(void)total_bytes;
	progress_add_done(intake->progress, read_bytes - intake->read_bytes);
	intake->read_bytes = read_bytes;
}

/* ---- files ---- */

/** What the workers of soup_import() share. */
struct import_phase {
	struct soup *soup;
	struct crew *crew;
	const struct soup_options *options;
	struct progress *progress;
	_Atomic uint64_t next_input;
};

static void soup_join_intake(struct soup *soup, const struct intake *intake,
			     const struct import_info *info)
{
	(void)pthread_mutex_lock(&soup->lock);
	for (unsigned i = 0; i < 3; i++) {
		soup->box_min[i] = fmin(soup->box_min[i], intake->box_min[i]);
		soup->box_max[i] = fmax(soup->box_max[i], intake->box_max[i]);
	}
	soup->triangle_count += intake->section->triangle_count;
	soup->non_finite_count += intake->non_finite_count;
	soup->dropped_face_count += info->dropped_faces;
	soup->missing_texture_count += info->missing_texture_count;
	soup->scratch_bytes = u64_max(soup->scratch_bytes, info->scratch_bytes_max);
	soup->doubles |= intake->section->doubles;
	soup->normals |= intake->any_normals;
	soup->all_normals &= intake->all_normals;
	soup->colours |= intake->any_colours;
	soup->missing_material_file |= info->missing_material_file;
	(void)pthread_mutex_unlock(&soup->lock);
}

static int import_one(struct import_phase *phase, struct intake *intake, uint64_t input_index,
		      struct why *why)
{
	const struct import_input *input = &phase->soup->inputs->inputs[input_index];
	struct soup_section *section = &phase->soup->sections[input_index];
	struct import_sink sink = {
		.part = on_part, .batch = on_batch, .progress = on_progress, .arg = intake
	};
	struct import_options options = {
		.memory_bytes = phase->options->memory_bytes,
		.scratch_directory = phase->options->scratch_directory,
		.colour = phase->options->colour,
		.cancelled = &phase->crew->stop,
	};
	static const double identity[12] = { 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0 };
	struct import_info info = { 0 };
	int r;

	intake->section = section;
	intake->input = input;
	intake->part_count = 0;
	intake->block = (struct soup_block){ .section = (uint32_t)input_index };
	intake->non_finite_count = 0;
	intake->read_bytes = 0;
	intake->any_normals = false;
	intake->all_normals = true;
	intake->any_colours = false;
	for (unsigned i = 0; i < 3; i++) {
		intake->box_min[i] = INFINITY;
		intake->box_max[i] = -INFINITY;
	}
	normal_matrix_of(input->placed ? input->placement : identity, intake->normal_matrix);
	r = import_file(input->path, &options, &sink, &info, why);
	if (r == 0)
		r = intake_flush(intake, why);
	part_list_seal(&section->parts);
	if (r < 0)
		return r;
	section->unit_metres = info.unit_metres;
	section->up_axis = info.up_axis;
	soup_join_intake(phase->soup, intake, &info);
	return 0;
}

static int import_work(void *arg, uint32_t worker, struct why *why)
{
	struct import_phase *phase = arg;
	struct intake intake = {
		.soup = phase->soup,
		.progress = phase->progress,
		.drop_non_finite = phase->options->drop_non_finite,
		.staging = malloc(STAGE_BYTES),
	};
	int r = 0;

	(void)worker;
	if (!intake.staging)
		r = why_set(why, -ENOMEM, "no memory to read files");
	while (r == 0 && !crew_stopped(phase->crew)) {
		uint64_t input_index = atomic_fetch_add(&phase->next_input, 1);

		if (input_index >= phase->soup->inputs->input_count)
			break;
		r = import_one(phase, &intake, input_index, why);
	}
	free(intake.part_of);
	free(intake.staging);
	return r;
}

static int compare_blocks(const void *a, const void *b)
{
	const struct soup_block *left = a;
	const struct soup_block *right = b;

	if (left->section != right->section)
		return left->section < right->section ? -1 : 1;
	return (left->first_triangle > right->first_triangle) -
	       (left->first_triangle < right->first_triangle);
}

int soup_import(struct soup *soup, struct crew *crew, const struct soup_options *options,
		struct progress *progress, struct why *why)
{
	struct import_phase phase = {
		.soup = soup, .crew = crew, .options = options, .progress = progress
	};
	uint64_t worker_count = u64_min(crew->worker_count, soup->inputs->input_count);
	uint64_t first_triangle = 0;
	int r;

	r = crew_run(crew, (uint32_t)u64_max(worker_count, 1), import_work, &phase, why);
	if (r < 0)
		return r;
	if (soup->block_count > 1)
		qsort(soup->blocks, soup->block_count, sizeof(*soup->blocks), compare_blocks);
	for (size_t i = 0; i < soup->inputs->input_count; i++) {
		soup->sections[i].first_triangle = first_triangle;
		first_triangle += soup->sections[i].triangle_count;
	}
	return 0;
}

/* ---- reading ---- */

int soup_view(const struct soup *soup, const struct soup_block *block, void *buffer,
	      struct soup_view *ret, struct why *why)
{
	const uint8_t *bytes = spool_peek(soup->spool, block->address);
	size_t at = position_bytes(block);

	if (!bytes) {
		int r = spool_read(soup->spool, block->address, buffer, soup_block_bytes(block),
				   why);

		if (r < 0)
			return r;
		bytes = buffer;
	}
	*ret = (struct soup_view){ 0 };
	if (block->doubles)
		ret->positions64 = (const void *)bytes;
	else
		ret->positions32 = (const void *)bytes;
	if (!block->one_part) {
		ret->parts = (const void *)(bytes + at);
		at += (size_t)block->triangle_count * 4;
	}
	if (block->normals) {
		ret->normals = (const void *)(bytes + at);
		at += (size_t)block->triangle_count * 12;
	}
	if (block->colours)
		ret->colours = (const void *)(bytes + at);
	return 0;
}

void soup_place(const struct soup *soup, const struct soup_block *block,
		const struct soup_view *view, uint32_t begin, uint32_t count, double *ret)
{
	const struct import_input *input = &soup->inputs->inputs[block->section];
	size_t from = (size_t)begin * 9;
	size_t number_count = (size_t)count * 9;

	if (view->positions64)
		memcpy(ret, view->positions64 + from, number_count * sizeof(double));
	else
		for (size_t i = 0; i < number_count; i++)
			ret[i] = (double)view->positions32[from + i];
	if (!input->placed)
		return;
	for (size_t i = 0; i < number_count; i += 3) {
		double point[3] = { ret[i], ret[i + 1], ret[i + 2] };

		place_point(input->placement, point, &ret[i]);
	}
}

int soup_init(struct soup *soup, struct spool *spool, struct budget *budget,
	      const struct import_inputs *inputs)
{
	*soup = (struct soup){
		.spool = spool, .budget = budget, .inputs = inputs, .all_normals = true
	};
	for (unsigned i = 0; i < 3; i++) {
		soup->box_min[i] = INFINITY;
		soup->box_max[i] = -INFINITY;
	}
	(void)pthread_mutex_init(&soup->lock, NULL);
	soup->sections = calloc(inputs->input_count + 1, sizeof(*soup->sections));
	if (!soup->sections) {
		soup_done(soup);
		return -ENOMEM;
	}
	budget_charge(budget, (inputs->input_count + 1) * sizeof(*soup->sections));
	return 0;
}

void soup_done(struct soup *soup)
{
	if (soup->sections)
		for (size_t i = 0; i < soup->inputs->input_count; i++)
			part_list_done(&soup->sections[i].parts);
	free(soup->sections);
	free(soup->blocks);
	(void)pthread_mutex_destroy(&soup->lock);
	soup->sections = NULL;
	soup->blocks = NULL;
}
