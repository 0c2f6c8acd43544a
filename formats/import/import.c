/* SPDX-License-Identifier: MIT */
#include "formats/import/import.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "formats/base/bytes.h"
#include "formats/import/job.h"

/* The longest line or record: a face of as many corners as are read is shorter. */
#define WINDOW_BYTES_MAX (4 * MIB)
/* Windows, packed bytes, a batch, a face's corners: what every importer has besides its model. */
#define FIXED_BYTES (12 * MIB)

struct importer {
	const char *suffix; /* of the file's name, lower case */
	int (*import)(struct import_job *job, struct why *why);
};

static const struct importer importers[] = {
	{ ".ply", ply_import },   { ".obj", obj_import },
	{ ".stl", stl_import },   { ".wrl", vrml_import },
	{ ".vrml", vrml_import }, { ".wrz", vrml_import }, /* .wrl.gz by its usual name */
};

/*
 * What assimp reads and folders may be searched for.  A file of another name that is given by itself
 * is tried too.
 */
static const char *const assimp_suffixes[] = {
	".3ds", ".3mf", ".ac",  ".ac3d", ".acc",     ".amf",  ".ase", ".b3d", ".blend",
	".cob", ".dae", ".dxf", ".fbx",  ".glb",     ".gltf", ".hmp", ".ifc", ".lwo",
	".lws", ".lxo", ".md2", ".md3",  ".md5mesh", ".ms3d", ".nff", ".off", ".ogex",
	".q3o", ".q3s", ".smd", ".ter",  ".x",       ".x3d",  ".xgl", ".zgl",
};
static const struct importer assimp_importer = { "", assimp_import };

/* Does name[0, length) end with the suffix, in any case? */
static bool ends_with(const char *name, size_t length, const char *suffix)
{
	size_t suffix_length = strlen(suffix);

	return length > suffix_length &&
	       strncasecmp(name + length - suffix_length, suffix, suffix_length) == 0;
}

static const struct importer *importer_of_name(const char *path)
{
	size_t length = strlen(path);

	if (ends_with(path, length, ".gz"))
		length -= 3;
	for (size_t i = 0; i < ARRAY_LENGTH(importers); i++)
		if (ends_with(path, length, importers[i].suffix))
			return &importers[i];
	return NULL;
}

bool import_is_model_name(const char *path)
{
	if (importer_of_name(path))
		return true;
	for (size_t i = 0; i < ARRAY_LENGTH(assimp_suffixes); i++)
		if (ends_with(path, strlen(path), assimp_suffixes[i]))
			return true;
	return false;
}

/* A signature in the content counts more than the name. */
static const struct importer *importer_of_content(const struct source *source, const char *path)
{
	const char *begin = (const char *)source->at;
	size_t length = (size_t)(source->end - source->at);

	if (length >= 4 && strncmp(begin, "ply", 3) == 0 && source_is_blank((uint8_t)begin[3]))
		return importer_of_name("a.ply");
	if (length >= 10 && strncmp(begin, "#VRML V2.0", 10) == 0)
		return importer_of_name("a.wrl");
	return importer_of_name(path) ? importer_of_name(path) : &assimp_importer;
}

/* What the source tells while it reads. */
static int on_progress(void *arg, uint64_t read_bytes, uint64_t total_bytes)
{
	const struct import_job *job = arg;

	if (job->options->cancelled && *job->options->cancelled)
		return -ECANCELED;
	if (job->sink->progress)
		job->sink->progress(job->sink->arg, read_bytes, total_bytes);
	return 0;
}

static int import_job_run(struct import_job *job, struct why *why)
{
	const struct importer *importer;
	int r;

	r = source_open(job->path, WINDOW_BYTES_MAX, on_progress, job, &job->source, why);
	if (r < 0)
		return r;
	importer = importer_of_content(job->source, job->path);
	if (job->source->at == job->source->end)
		r = why_set(why, -ENODATA, "it is empty");
	else
		r = importer->import(job, why);
	job->source = source_close(job->source);
	return r;
}

int import_file(const char *path, const struct import_options *options,
		const struct import_sink *sink, struct import_info *ret, struct why *why)
{
	struct import_info info = { 0 };
	struct import_job job = {
		.path = path,
		.options = options,
		.sink = sink,
		.info = &info,
		.scratch = { .directory = options->scratch_directory,
			     .cancelled = options->cancelled },
		.memory_bytes = options->memory_bytes > 2 * FIXED_BYTES
					? options->memory_bytes - FIXED_BYTES
					: options->memory_bytes / 2,
	};
	int r = import_job_run(&job, why);

	if (r == -ECANCELED)
		(void)why_set(why, r, "cancelled");
	if (r < 0) {
		why_prefix(why, "%s", path);
		return r;
	}
	info.scratch_bytes_max = job.scratch.max_bytes;
	*ret = info;
	return 0;
}
