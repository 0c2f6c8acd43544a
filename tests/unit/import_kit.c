/* SPDX-License-Identifier: MIT */
#include <errno.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "tests/helper.h"
#include "tests/unit/import_kit.h"

size_t kit_batch_fails_at;

static void *grow(void *array, size_t count, size_t item_bytes)
{
	/* To powers of two: only when the count has reached one. */
	if ((count & (count - 1)) != 0)
		return array;
	array = realloc(array, (count ? 2 * count : 1) * item_bytes);
	assert_non_null(array);
	return array;
}

static int record_part(void *arg, const struct import_part *part, struct why *why)
{
	struct kit_model *model = arg;
	struct kit_part *to;

	(void)why;
	model->parts = grow(model->parts, model->part_count, sizeof(*model->parts));
	to = &model->parts[model->part_count++];
	(void)snprintf(to->name, sizeof(to->name), "%s", part->name);
	(void)snprintf(to->scene_path, sizeof(to->scene_path), "%s", part->scene_path);
	(void)snprintf(to->material, sizeof(to->material), "%s", part->material);
	to->colour = part->colour;
	return 0;
}

static void record_triangle(struct kit_model *model, const struct import_batch *batch, size_t i)
{
	size_t at = model->triangle_count;

	model->positions = grow(model->positions, at, 9 * sizeof(double));
	model->normals = grow(model->normals, at, 9 * sizeof(float));
	model->colours = grow(model->colours, at, 3 * sizeof(uint32_t));
	model->triangle_parts = grow(model->triangle_parts, at, sizeof(uint32_t));
	for (size_t k = 0; k < 9; k++) {
		model->positions[9 * at + k] = batch->positions_double
						       ? batch->positions64[9 * i + k]
						       : (double)batch->positions32[9 * i + k];
		model->normals[9 * at + k] = batch->normals ? batch->normals[9 * i + k] : 0.0f;
	}
	for (size_t k = 0; k < 3; k++)
		model->colours[3 * at + k] = batch->colours ? batch->colours[3 * i + k] : 0;
	model->triangle_parts[at] = batch->part;
	model->triangle_count++;
}

static int record_batch(void *arg, const struct import_batch *batch, struct why *why)
{
	struct kit_model *model = arg;

	if (++model->batch_count == kit_batch_fails_at)
		return why_set(why, -ENOSPC, "the sink is full");
	assert_true(batch->triangle_count > 0);
	assert_true(batch->triangle_count <= IMPORT_BATCH_TRIANGLES);
	assert_true(batch->part < model->part_count);
	model->positions_double = batch->positions_double;
	model->has_normals |= batch->normals != NULL;
	model->has_colours |= batch->colours != NULL;
	for (size_t i = 0; i < batch->triangle_count; i++)
		record_triangle(model, batch, i);
	return 0;
}

static void record_progress(void *arg, uint64_t read_bytes, uint64_t total_bytes)
{
	struct kit_model *model = arg;

	assert_true(read_bytes >= model->progress_last);
	assert_true(read_bytes <= total_bytes);
	model->progress_last = read_bytes;
}

struct kit_model *kit_import(const char *path, const struct import_options *options)
{
	struct kit_model *model = calloc(1, sizeof(*model));
	struct import_options usual = { .memory_bytes = UINT64_C(64) << 20 };
	struct import_sink sink = {
		.part = record_part,
		.batch = record_batch,
		.progress = record_progress,
		.arg = model,
	};
	char *folder = strdup(path);

	assert_non_null(model);
	assert_non_null(folder);
	*strrchr(folder, '/') = '\0';
	usual.scratch_directory = folder;
	model->result =
		import_file(path, options ? options : &usual, &sink, &model->info, &model->why);
	if (model->result == 0)
		assert_int_equal(model->info.triangle_count, model->triangle_count);
	free(folder);
	return model;
}

struct kit_model *kit_import_bytes(const char *folder, const char *name, const void *data,
				   size_t size_bytes)
{
	const char *path = test_path(folder, name);

	test_file_write(path, data, size_bytes);
	return kit_import(path, NULL);
}

struct kit_model *kit_import_text(const char *folder, const char *name, const char *text)
{
	return kit_import_bytes(folder, name, text, strlen(text));
}

void kit_model_free(struct kit_model *model)
{
	free(model->parts);
	free(model->positions);
	free(model->normals);
	free(model->colours);
	free(model->triangle_parts);
	free(model);
}

void kit_assert_ok(const struct kit_model *model)
{
	if (model->result < 0)
		fail_msg("import failed: %d: %s", model->result, model->why.text);
}

void kit_assert_refused(const struct kit_model *model, int error, const char *words)
{
	if (model->result != error)
		fail_msg("import returned %d (%s), not %d", model->result,
			 model->result < 0 ? model->why.text : "", error);
	if (!strstr(model->why.text, words))
		fail_msg("the reason \"%s\" does not say \"%s\"", model->why.text, words);
}

void kit_assert_text_refused(const char *folder, const char *name, const char *text, int error,
			     const char *words)
{
	struct kit_model *model = kit_import_text(folder, name, text);

	kit_assert_refused(model, error, words);
	kit_model_free(model);
}

void kit_assert_same(const struct kit_model *a, const struct kit_model *b)
{
	kit_assert_ok(a);
	kit_assert_ok(b);
	assert_int_equal(a->part_count, b->part_count);
	for (size_t i = 0; i < a->part_count; i++) {
		assert_string_equal(a->parts[i].name, b->parts[i].name);
		assert_string_equal(a->parts[i].scene_path, b->parts[i].scene_path);
		assert_string_equal(a->parts[i].material, b->parts[i].material);
		assert_int_equal(a->parts[i].colour, b->parts[i].colour);
	}
	assert_int_equal(a->triangle_count, b->triangle_count);
	assert_int_equal(a->info.face_count, b->info.face_count);
	assert_int_equal(a->info.dropped_faces, b->info.dropped_faces);
	assert_int_equal(a->has_normals, b->has_normals);
	assert_int_equal(a->has_colours, b->has_colours);
	if (a->triangle_count == 0)
		return;
	assert_memory_equal(a->positions, b->positions, a->triangle_count * 9 * sizeof(double));
	assert_memory_equal(a->normals, b->normals, a->triangle_count * 9 * sizeof(float));
	assert_memory_equal(a->colours, b->colours, a->triangle_count * 3 * sizeof(uint32_t));
	assert_memory_equal(a->triangle_parts, b->triangle_parts,
			    a->triangle_count * sizeof(uint32_t));
}

static void triangle_area(const double *p, double ret[3])
{
	double a[3], b[3];

	for (int k = 0; k < 3; k++) {
		a[k] = p[3 + k] - p[k];
		b[k] = p[6 + k] - p[k];
	}
	for (int k = 0; k < 3; k++)
		ret[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

void kit_area(const struct kit_model *model, double ret[3])
{
	memset(ret, 0, 3 * sizeof(double));
	for (size_t i = 0; i < model->triangle_count; i++) {
		double area[3];

		triangle_area(model->positions + 9 * i, area);
		for (int k = 0; k < 3; k++)
			ret[k] += area[k];
	}
}

double kit_surface(const struct kit_model *model)
{
	double sum = 0.0;

	for (size_t i = 0; i < model->triangle_count; i++) {
		double area[3];

		triangle_area(model->positions + 9 * i, area);
		sum += sqrt(area[0] * area[0] + area[1] * area[1] + area[2] * area[2]) / 2.0;
	}
	return sum;
}

void kit_write_gzip(const char *path, const void *data, size_t size_bytes)
{
	gzFile file = gzopen(path, "wb1");

	assert_non_null(file);
	assert_int_equal(gzwrite(file, data, (unsigned)size_bytes), (int)size_bytes);
	assert_int_equal(gzclose(file), Z_OK);
}

void kit_append(struct kit_bytes *bytes, const void *data, size_t size_bytes)
{
	if (bytes->size_bytes + size_bytes > bytes->capacity) {
		bytes->capacity = 2 * (bytes->size_bytes + size_bytes);
		bytes->data = realloc(bytes->data, bytes->capacity);
		assert_non_null(bytes->data);
	}
	memcpy(bytes->data + bytes->size_bytes, data, size_bytes);
	bytes->size_bytes += size_bytes;
}

void kit_print(struct kit_bytes *bytes, const char *format, ...)
{
	char *text = NULL;
	va_list args;
	int length;

	va_start(args, format);
	length = vasprintf(&text, format, args);
	va_end(args);
	assert_true(length >= 0);
	kit_append(bytes, text, (size_t)length);
	free(text);
}

void kit_assert_all_refused(const char *folder, const char *name, const struct kit_refusal *cases,
			    size_t case_count)
{
	for (size_t i = 0; i < case_count; i++)
		kit_assert_text_refused(folder, name, cases[i].text, cases[i].error,
					cases[i].words);
}

void kit_assert_endless_refused(const char *folder, const char *name, const char *start)
{
	size_t size_bytes = 40 * MIB;
	char *text = malloc(size_bytes);
	struct kit_model *model;

	assert_non_null(text);
	memset(text, 'x', size_bytes);
	memcpy(text, start, strlen(start));
	model = kit_import_bytes(folder, name, text, size_bytes);
	kit_assert_refused(model, -EUCLEAN, "bytes");
	kit_model_free(model);
	free(text);
}

void kit_assert_same_gzipped(const char *folder, const char *name, const struct kit_bytes *bytes)
{
	struct kit_model *expected = kit_import_bytes(folder, name, bytes->data, bytes->size_bytes);
	struct kit_model *model;
	char zipped[KIT_NAME_BYTES];

	(void)snprintf(zipped, sizeof(zipped), "%s.gz", name);
	kit_write_gzip(test_path(folder, zipped), bytes->data, bytes->size_bytes);
	model = kit_import(test_path(folder, zipped), NULL);
	kit_assert_same(expected, model);
	kit_model_free(expected);
	kit_model_free(model);
}

void kit_assert_same_within(const char *folder, const char *name, const struct kit_bytes *bytes,
			    const uint64_t *memories, size_t memory_count)
{
	struct kit_model *expected = kit_import_bytes(folder, name, bytes->data, bytes->size_bytes);
	char *scratch = test_folder_make();

	for (size_t i = 0; i < memory_count; i++) {
		struct import_options options = { .memory_bytes = memories[i],
						  .scratch_directory = scratch };
		struct kit_model *model = kit_import(test_path(folder, name), &options);

		kit_assert_same(expected, model);
		assert_int_equal(model->info.scratch_bytes_max > 0, memories[i] < MIB);
		assert_string_equal(test_folder_list(scratch), "");
		kit_model_free(model);
	}
	test_folder_remove(scratch);
	kit_model_free(expected);
}
