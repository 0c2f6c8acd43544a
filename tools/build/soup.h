/* SPDX-License-Identifier: MIT */
/**
 * soup.h - all triangles of all input files, as they were read.
 *
 * Files are read side by side; each is one section.  Triangles are kept in blocks in a spool, in the
 * file's own numbers, unplaced: placing them anew each time they are read is cheaper than keeping
 * doubles.  Sections, blocks and triangles are numbered in the order of the inputs, whichever file
 * was finished first.  The soup drops nothing; triangles that are not finite only do not count for
 * the box.
 *
 * Threads: soup_import() runs its own; afterwards everything may be read from any.
 */
#ifndef TOOLS_BUILD_SOUP_H
#define TOOLS_BUILD_SOUP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "formats/import/import.h"
#include "tools/build/budget.h"
#include "tools/build/crew.h"
#include "tools/build/labels.h"
#include "tools/build/progress.h"
#include "tools/build/spool.h"

/** Most triangles in a block. */
#define SOUP_BLOCK_TRIANGLES 16384u
/** A corner's normal that the file does not have, or that is none.  No unit vector is coded so. */
#define SOUP_NORMAL_NONE UINT32_C(0x80008000)

/** Triangles that follow each other in a file and have the same attributes. */
struct soup_block {
	uint64_t address;        /* in the spool */
	uint64_t first_triangle; /* ordinal in its section */
	uint32_t section;
	uint32_t triangle_count;
	uint32_t part; /* of all of them, if it is one */
	bool one_part;
	bool doubles;
	bool normals;
	bool colours;
};

/** A block's arrays, in memory. */
struct soup_view {
	const float *positions32; /* one of the two is NULL */
	const double *positions64;
	const uint32_t *parts;   /* numbers of the file's part list; NULL: the block has one */
	const uint32_t *normals; /* three octahedral codes a triangle, placed; or NULL */
	const uint32_t *colours; /* three a triangle; or NULL */
};

struct soup_section {
	struct part_list parts;  /* until labels_join() took them */
	uint64_t first_triangle; /* ordinal in the model */
	uint64_t triangle_count;
	double unit_metres;
	enum store_axis up_axis;
	bool doubles;
};

struct soup {
	struct spool *spool;
	struct budget *budget;
	const struct import_inputs *inputs;
	struct soup_section *sections; /* one an input */
	struct soup_block *blocks;
	size_t block_count;
	size_t block_max;
	uint64_t triangle_count;
	uint64_t non_finite_count;
	uint64_t dropped_face_count;
	uint64_t missing_texture_count;
	uint64_t scratch_bytes; /* of importers, at most at one time */
	double box_min[3];
	double box_max[3];
	bool doubles; /* does any section need them? */
	bool normals; /* does any block have them? */
	bool all_normals;
	bool colours;
	bool missing_material_file;
	pthread_mutex_t lock;
};

struct soup_options {
	enum import_colour colour;
	bool drop_non_finite;  /* else they are refused */
	uint64_t memory_bytes; /* for each importer */
	const char *scratch_directory;
};

/** Makes an empty soup.  Returns: 0 or -ENOMEM.  Ownership: ends with soup_done(). */
int soup_init(struct soup *soup, struct spool *spool, struct budget *budget,
	      const struct import_inputs *inputs);
void soup_done(struct soup *soup);

/**
 * Reads all inputs.
 *
 * Returns: 0, -EINVAL for a coordinate that is no number, -ENOSPC, -ENOMEM, or what import_file()
 * said, with the file's name.
 */
int soup_import(struct soup *soup, struct crew *crew, const struct soup_options *options,
		struct progress *progress, struct why *why);

/** Bytes of a block in the spool. */
size_t soup_block_bytes(const struct soup_block *block);
/** Most that soup_block_bytes() says. */
#define SOUP_BLOCK_BYTES_MAX (SOUP_BLOCK_TRIANGLES * (9u * 8u + 4u + 12u + 12u))

/** Finds a block's arrays, reading it into `buffer` (SOUP_BLOCK_BYTES_MAX) if it is on disk. */
int soup_view(const struct soup *soup, const struct soup_block *block, void *buffer,
	      struct soup_view *ret, struct why *why);

/** Places triangles [begin, begin + count) of a block: nine doubles each, model units. */
void soup_place(const struct soup *soup, const struct soup_block *block,
		const struct soup_view *view, uint32_t begin, uint32_t count, double *ret);

#endif /* TOOLS_BUILD_SOUP_H */
