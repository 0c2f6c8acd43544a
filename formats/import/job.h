/* SPDX-License-Identifier: MIT */
/**
 * job.h - what an importer is given: one open file and where its triangles go.
 *
 * An importer reads job->source to its end and returns 0, or an error with its reason; import.c
 * puts the file's name in front of it.
 */
#ifndef FORMATS_IMPORT_JOB_H
#define FORMATS_IMPORT_JOB_H

#include "formats/import/batcher.h"
#include "formats/import/import.h"
#include "formats/import/source.h"
#include "formats/import/spill.h"

struct import_job {
	const char *path;
	const struct import_options *options;
	const struct import_sink *sink;
	struct import_info *info;
	struct source *source;
	struct scratch scratch;
	uint64_t memory_bytes; /* for what the importer keeps: window and batch are paid for */
};

int ply_import(struct import_job *job, struct why *why);
int obj_import(struct import_job *job, struct why *why);
int stl_import(struct import_job *job, struct why *why);
int vrml_import(struct import_job *job, struct why *why);
/** Reads job->path itself, in another process, and leaves job->source alone. */
int assimp_import(struct import_job *job, struct why *why);

#endif /* FORMATS_IMPORT_JOB_H */
