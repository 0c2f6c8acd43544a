/* SPDX-License-Identifier: MIT */
#include "tools/gen/rack_read.h"

#include <errno.h>
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>

#include "formats/base/bytes.h"
#include "tools/gen/interrupt.h"

/* What one importer may hold. */
#define READ_MEMORY_BYTES (64 * MIB)

struct rack_reader {
	const struct import_inputs *inputs;
	struct rack_model *models;
	const char *scratch_directory;
	/* The next model to be read; every thread takes one after the other. */
	atomic_size_t next;
};

static int on_part(void *arg, const struct import_part *part, struct why *why)
{
	(void)arg;
	(void)part;
	(void)why;
	return 0;
}

static int on_batch(void *arg, const struct import_batch *batch, struct why *why)
{
	struct rack_model *model = arg;

	for (size_t i = 0; i < 9 * (size_t)batch->triangle_count; i++) {
		double value = batch->positions_double ? batch->positions64[i]
						       : (double)batch->positions32[i];

		if (!isfinite(value))
			return why_set(why, -EUCLEAN, "a position is not finite");
		model->low[i % 3] = fmin(model->low[i % 3], value);
		model->high[i % 3] = fmax(model->high[i % 3], value);
	}
	model->triangle_count += batch->triangle_count;
	return 0;
}

static void read_one(const struct rack_reader *reader, size_t index)
{
	struct rack_model *model = &reader->models[index];
	const struct import_options options = { .memory_bytes = READ_MEMORY_BYTES,
						.scratch_directory = reader->scratch_directory,
						.colour = IMPORT_COLOUR_NONE,
						.cancelled = &interrupted };
	const struct import_sink sink = { .part = on_part, .batch = on_batch, .arg = model };
	struct import_info info;

	*model = (struct rack_model){ .low = { INFINITY, INFINITY, INFINITY },
				      .high = { -INFINITY, -INFINITY, -INFINITY } };
	model->error = import_file(reader->inputs->inputs[index].path, &options, &sink, &info,
				   &model->why);
	if (model->error == 0)
		model->up_axis = info.up_axis;
}

static void *reader_main(void *arg)
{
	struct rack_reader *reader = arg;
	size_t index;

	while ((index = atomic_fetch_add(&reader->next, 1)) < reader->inputs->input_count &&
	       !interrupted)
		read_one(reader, index);
	return NULL;
}

int rack_read(const struct import_inputs *inputs, struct rack_model *models,
	      const char *scratch_directory, unsigned jobs, struct why *why)
{
	struct rack_reader reader = { .inputs = inputs,
				      .models = models,
				      .scratch_directory = scratch_directory };
	pthread_t *threads = calloc(jobs, sizeof(*threads));
	unsigned started = 0;
	int r = 0;

	if (!threads)
		return why_set(why, -ENOMEM, "out of memory");
	while (started < jobs && r == 0) {
		r = -pthread_create(&threads[started], NULL, reader_main, &reader);
		started += r == 0;
	}
	for (unsigned i = 0; i < started; i++)
		(void)pthread_join(threads[i], NULL);
	free(threads);
	if (started == 0)
		return why_errno(why, r, "no thread could be started");
	if (interrupted)
		return why_set(why, -ECANCELED, "interrupted, nothing was kept");
	return 0;
}
