/* SPDX-License-Identifier: MIT */
/**
 * build.h - model files in, one store out.
 *
 * The phases, in order, and what each leaves behind:
 *
 *	import   files            -> soup (spool: memory, then scratch)
 *	count    soup             -> buckets
 *	deal     soup             -> triangles a bucket, border records a bucket (spool)
 *	borders  both             -> answers a bucket (spool)
 *	cut      all three        -> leaves: payloads in the store, records in memory
 *	finish   leaves, labels   -> HS, names, commit
 *
 * The bytes of the store depend on the inputs and on the options that say how it shall look, never
 * on memory, threads, or which of them was faster.
 *
 * Threads: build_run() starts its own, and ends them.
 */
#ifndef TOOLS_BUILD_BUILD_H
#define TOOLS_BUILD_BUILD_H

#include <stdbool.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "formats/import/import.h"
#include "formats/store/layout.h"
#include "tools/build/crew.h"
#include "tools/build/normals.h"
#include "tools/build/progress.h"

/** Least --memory: one worker and one importer, with nothing kept in memory. */
#define BUILD_MEMORY_MIN (UINT64_C(96) << 20)
/** Triangles that a worker cuts at a time; more only where a leaf may have more. */
#define BUILD_BUCKET_TRIANGLES   (UINT32_C(1) << 17)
#define BUILD_LEAF_TRIANGLES_MAX (UINT32_C(1) << 19)
#define BUILD_JOBS_MAX           256u
/** Defaults (README.md has the measurements). */
#define BUILD_LEAF_TRIANGLES 8192u
#define BUILD_CREASE_DEGREES 40.0

struct build_options {
	const char *output;
	char *const *inputs;
	size_t input_count;
	uint64_t memory_bytes;
	uint32_t jobs;
	double error; /* model units; 0: exact; negative: the default */
	uint32_t leaf_triangles;
	uint32_t leaf_vertices; /* UINT32_MAX: no limit */
	enum store_layout layout;
	enum normals_mode normals;
	double crease_degrees;
	enum store_codec codec;
	enum import_colour colour;
	double unit_metres;      /* 0: as the files say */
	enum store_axis up_axis; /* unknown: as the files say */
	bool drop_non_finite;
	bool keep_ids;
	const char *scratch_directory; /* NULL: the output's */
	bool progress;
};

/** What was done; all of it is in the summary. */
struct build_report {
	uint64_t triangles_in;
	uint64_t triangles_stored; /* replicas count each */
	uint64_t degenerate;
	uint64_t non_finite;
	uint64_t duplicates;
	uint64_t dropped_faces;
	uint64_t missing_textures;
	double replication_factor;
	uint64_t sections;
	uint64_t parts;
	uint64_t nodes;
	uint64_t leaves;
	uint64_t small_leaves; /* whose positions take 16 bits */
	uint64_t depth_limited_leaves;
	uint64_t vertices;
	uint64_t bytes;
	uint64_t hs_bytes;
	uint64_t names_bytes;
	uint64_t payload_bytes; /* decoded, in all */
	uint64_t largest_payload_bytes;
	uint64_t scratch_bytes;
	uint64_t peak_rss_bytes; /* of this process and its largest child */
	uint64_t generation;
	uint32_t buckets;
	uint32_t workers;
	double step; /* 0: exact */
	double error;
	double error_measured;
	double unit_metres;
	enum store_axis up_axis;
	bool units_differ; /* files disagree; the first that says counts */
	bool missing_material_file;
	double seconds;
	double phase_seconds[PHASE_COUNT_];
};

/**
 * Builds.
 *
 * crew:  initialised with as many workers as options.jobs; crew_stop() ends the build early.
 *
 * Returns: 0, or
 *	-EEXIST    the output is there and is no store
 *	-EINVAL    an option does not fit the model, or a coordinate is no number
 *	-ENOMEM    options.memory_bytes is too little
 *	-ENOSPC    of the store or of scratch
 *	-ECANCELED crew_stop() was called
 *	or what reading the inputs said; then no store was made and an old one stands unchanged.
 */
int build_run(const struct build_options *options, struct crew *crew, struct build_report *ret,
	      struct why *why);

#endif /* TOOLS_BUILD_BUILD_H */
