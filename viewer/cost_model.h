/* SPDX-License-Identifier: MIT */
/**
 * cost_model.h - what drawing costs with one renderer, and the file that remembers it.
 *
 * Every figure was measured on this machine with this driver (cost_probe.h): none stands for "a
 * GPU".  The model is a first guess that pace.h corrects while frames are drawn.
 *
 * Threads: any; pure but for the file.
 */
#ifndef VIEWER_COST_MODEL_H
#define VIEWER_COST_MODEL_H

#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"

struct cost_model {
	double frame_ms;    /* a frame of nothing, until it is finished */
	double triangle_ns; /* small ones, four pixels each, without what their pixels cost */
	double pixel_ns;    /* covered and shaded */
	double query_ns;    /* an occlusion query of a box, in a batch */
};

/** Whose costs they are: what OpenGL says of itself. */
struct cost_identity {
	const char *renderer;
	const char *version; /* of OpenGL and the driver: another driver has other costs */
};

/** Time of a frame, ms. */
double cost_model_frame_ms(const struct cost_model *model, double triangles, double pixels);

/** "FOLDER/renderer-0123456789abcdef.cost".  Returns: buffer, of so many bytes. */
const char *cost_model_path(const char *folder, const struct cost_identity *identity, char *buffer,
			    size_t buffer_bytes);

/**
 * Reads what was measured.
 *
 * Returns: 0, -ENOENT (no such file), -ESTALE (of another driver, or of another version of the file:
 *	measure again), -EUCLEAN (it is none: measure again) or -errno.
 */
int cost_model_read(const char *path, const struct cost_identity *identity, struct cost_model *ret,
		    struct why *why);

/** Writes it; appears whole under its name.  Returns: 0 or -errno. */
int cost_model_write(const char *path, const struct cost_identity *identity,
		     const struct cost_model *model, struct why *why);

#endif /* VIEWER_COST_MODEL_H */
