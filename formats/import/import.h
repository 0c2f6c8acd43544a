/* SPDX-License-Identifier: MIT */
/**
 * import.h - model files as streams of triangles.
 *
 * An importer reads one model file from front to back and hands on, in the file's order, the parts
 * that it finds and batches of triangles with the positions of their corners.  It keeps in memory
 * only what memory_bytes allows; what needs more (faces that point at vertices) goes through files
 * in scratch_directory.  It drops nothing and judges nothing but the file: degenerate or non-finite
 * triangles are the builder's.  It does not place, weld, simplify or compute normals.
 *
 * All bytes are hostile: counts are compared with what the rest of the file can hold before
 * anything is allocated, indices with their arrays, nesting with a depth limit.
 *
 * Threads: one importer a thread, any number at a time.
 */
#ifndef FORMATS_IMPORT_IMPORT_H
#define FORMATS_IMPORT_IMPORT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "formats/store/layout.h"

/** Most triangles in a batch. */
#define IMPORT_BATCH_TRIANGLES 4096u
/** Grey of parts that say nothing of colour, 0xAABBGGRR. */
#define IMPORT_COLOUR_DEFAULT UINT32_C(0xffb4b4b4)

/** What a part is; strings are the importer's, valid during the call. */
struct import_part {
	const char *name;       /* "" where the file has none */
	const char *scene_path; /* "a/b/c"; "" */
	const char *material;   /* its name; "" */
	uint32_t colour;        /* 0xAABBGGRR */
};

/** Up to IMPORT_BATCH_TRIANGLES triangles of one part.  Arrays are the importer's. */
struct import_batch {
	uint32_t triangle_count;
	uint32_t part;            /* number of an earlier import_part of this file, from 0 */
	bool positions_double;    /* which of the two is set */
	const float *positions32; /* triangle_count x 3 corners x 3, model units */
	const double *positions64;
	const float *normals; /* triangle_count x 3 x 3, of any length; NULL: the file has none */
	const uint32_t *colours; /* triangle_count x 3, 0xAABBGGRR; NULL: the part's */
};

/** Where it goes.  A negative return ends the import with that error; why is then the sink's. */
struct import_sink {
	int (*part)(void *arg, const struct import_part *part, struct why *why);
	int (*batch)(void *arg, const struct import_batch *batch, struct why *why);
	/* Bytes of the file consumed so far; may be NULL. */
	void (*progress)(void *arg, uint64_t read_bytes, uint64_t total_bytes);
	void *arg;
};

/** Which colour counts where a file has several.  Each falls back on the next. */
enum import_colour {
	IMPORT_COLOUR_TEXTURE, /* texture, vertex, material, part's grey: the default.  An image
				* is sampled at the corners, over the triangle's extent. */
	IMPORT_COLOUR_VERTEX,
	IMPORT_COLOUR_MATERIAL,
	IMPORT_COLOUR_NONE, /* grey */
};

struct import_options {
	uint64_t memory_bytes;         /* bound of what the importer holds; >= 16 MiB */
	const char *scratch_directory; /* for what does not fit; a folder on a disk */
	enum import_colour colour;
	const volatile bool
		*cancelled; /* looked at once a batch; ends with -ECANCELED; may be NULL */
};

/** What the file said of itself. */
struct import_info {
	double unit_metres;      /* 0: it does not say */
	enum store_axis up_axis; /* STORE_AXIS_UNKNOWN: it does not say */
	uint64_t triangle_count;
	uint64_t part_count;
	uint64_t face_count;    /* as they stood, polygons counted once */
	uint64_t dropped_faces; /* fewer than three corners */
	uint64_t scratch_bytes_max;
	bool missing_material_file;
	uint32_t missing_texture_count; /* images that are used and cannot be read */
};

/** Do we read files of this name?  Looks at the name alone, also behind .gz. */
bool import_is_model_name(const char *path);

/**
 * Reads one model file.  The format is told by the content where it has a signature, else by name.
 *
 * Returns: 0, or
 *	-EUCLEAN  the file is not what it claims; the reason has line or byte
 *	-ENODATA  it ends too early
 *	-ENOMEM   it does not fit in memory_bytes, and its format is not streamed
 *	-ENOTSUP  no importer for it
 *	-ECANCELED, what the sink returned, or what reading said
 */
int import_file(const char *path, const struct import_options *options,
		const struct import_sink *sink, struct import_info *ret, struct why *why);

/* ---- what to read ---- */

/** One model file and where it stands. */
struct import_input {
	char *path;
	char *name;           /* of the section: the path as given, or relative to the folder */
	bool placed;          /* false: the placement is the identity and changes no bit */
	double placement[12]; /* row-major 3x4, model to world */
};

struct import_inputs {
	struct import_input *inputs;
	size_t input_count;
};

/**
 * Expands what stands on a command line: model files, folders (recursive, in byte order of their
 * paths; files that no importer knows are left out), scene lists (CSV whose header is
 * "file,m00,m01,m02,m03,m10,...,m23"; paths relative to the list).
 *
 * Returns: 0, -ENOENT, -EUCLEAN (a list: with its line), -ENOMEM or -errno.
 * Ownership: ends with import_inputs_done().
 */
int import_inputs_expand(char *const *arguments, size_t argument_count, struct import_inputs *ret,
			 struct why *why);
void import_inputs_done(struct import_inputs *inputs);

#endif /* FORMATS_IMPORT_IMPORT_H */
