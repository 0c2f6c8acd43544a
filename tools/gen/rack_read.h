/* SPDX-License-Identifier: MIT */
/**
 * rack_read.h - how large models are.
 *
 * Threads: rack_read() starts some and ends them.
 */
#ifndef TOOLS_GEN_RACK_READ_H
#define TOOLS_GEN_RACK_READ_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "formats/import/import.h"

/** A model as it lies in its file. */
struct rack_model {
	double low[3]; /* of all corners of triangles; set where triangle_count > 0 */
	double high[3];
	uint64_t triangle_count;
	enum store_axis up_axis; /* as the file says */
	int error;               /* why it could not be read; 0 */
	struct why why;
};

/**
 * Reads every model once.
 *
 * models:            input_count of them; one that cannot be read has its error
 * scratch_directory: for models larger than memory
 * jobs:              threads, > 0
 *
 * Returns: 0, -ECANCELED after a signal, or -errno when no thread could be started.
 */
int rack_read(const struct import_inputs *inputs, struct rack_model *models,
	      const char *scratch_directory, unsigned jobs, struct why *why);

#endif /* TOOLS_GEN_RACK_READ_H */
