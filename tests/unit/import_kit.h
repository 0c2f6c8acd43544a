/* SPDX-License-Identifier: MIT */
/**
 * import_kit.h - models in and out, for the tests of the importers.
 *
 * What goes wrong besides the import itself fails the test.  Include it after <cmocka.h>.
 */
#ifndef TESTS_UNIT_IMPORT_KIT_H
#define TESTS_UNIT_IMPORT_KIT_H

#include <stddef.h>
#include <stdint.h>

#include "formats/import/import.h"

#define KIT_NAME_BYTES 128

struct kit_part {
	char name[KIT_NAME_BYTES];
	char scene_path[KIT_NAME_BYTES];
	char material[KIT_NAME_BYTES];
	uint32_t colour;
};

/** All that an import said. */
struct kit_model {
	int result;
	struct why why;
	struct import_info info;
	struct kit_part *parts;
	size_t part_count;
	/* By triangle; what a batch lacks is 0. */
	double *positions; /* 9 each */
	float *normals;    /* 9 each */
	uint32_t *colours; /* 3 each */
	uint32_t *triangle_parts;
	size_t triangle_count;
	bool positions_double;
	bool has_normals; /* any batch had them */
	bool has_colours;
	uint64_t progress_last;
	size_t batch_count;
};

/** The sink answers the batch of this number, counted from 1, with -ENOSPC; 0: none. */
extern size_t kit_batch_fails_at;

/** Imports a file, by options or (NULL) with 64 MiB and scratch files beside it. */
struct kit_model *kit_import(const char *path, const struct import_options *options);

/** Writes folder/name and imports it. */
struct kit_model *kit_import_bytes(const char *folder, const char *name, const void *data,
				   size_t size_bytes);
struct kit_model *kit_import_text(const char *folder, const char *name, const char *text);

void kit_model_free(struct kit_model *model);

/** Fails unless the import succeeded. */
void kit_assert_ok(const struct kit_model *model);

/** Fails unless the import failed so, with a reason that has these words. */
void kit_assert_refused(const struct kit_model *model, int error, const char *words);

/** Writes folder/name, imports it, and asserts the refusal. */
void kit_assert_text_refused(const char *folder, const char *name, const char *text, int error,
			     const char *words);

/** Fails unless both have the same parts and the same triangles in the same order. */
void kit_assert_same(const struct kit_model *a, const struct kit_model *b);

/** Fails unless every text is refused so; each is written to folder/name. */
struct kit_refusal {
	const char *text;
	int error;
	const char *words;
};
void kit_assert_all_refused(const char *folder, const char *name, const struct kit_refusal *cases,
			    size_t case_count);

/** Fails unless a file that goes on in one word for 40 MiB is refused for that. */
void kit_assert_endless_refused(const char *folder, const char *name, const char *start);

/** Twice the area vectors of all triangles, summed: it tells orientation and coverage. */
void kit_area(const struct kit_model *model, double ret[3]);

/** The sum of the triangles' areas. */
double kit_surface(const struct kit_model *model);

void kit_write_gzip(const char *path, const void *data, size_t size_bytes);

/** A growing run of bytes, for files of any kind. */
struct kit_bytes {
	uint8_t *data;
	size_t size_bytes;
	size_t capacity;
};

void kit_append(struct kit_bytes *bytes, const void *data, size_t size_bytes);
void kit_print(struct kit_bytes *bytes, const char *format, ...)
	__attribute__((format(printf, 2, 3)));

/** Fails unless folder/name.gz gives the same as folder/name. */
void kit_assert_same_gzipped(const char *folder, const char *name, const struct kit_bytes *bytes);

/**
 * Fails unless the same comes whatever the memory: where it is less than 1 MiB by scratch files, of
 * which none is left.
 */
void kit_assert_same_within(const char *folder, const char *name, const struct kit_bytes *bytes,
			    const uint64_t *memories, size_t memory_count);

#endif /* TESTS_UNIT_IMPORT_KIT_H */
