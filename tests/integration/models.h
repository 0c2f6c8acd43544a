/* SPDX-License-Identifier: MIT */
/**
 * models.h - small models for tests of the builder, and what it said of them.
 *
 * What goes wrong fails the test that asked for it.  Include it after <cmocka.h>.
 */
#ifndef TESTS_INTEGRATION_MODELS_H
#define TESTS_INTEGRATION_MODELS_H

#include <stdbool.h>
#include <stdint.h>

#include "formats/store/payload.h"
#include "formats/store/store_file.h"

/** A number in 0 .. 1; the same row in each program. */
double model_random(void);

/** Writes triangles as binary PLY, three vertices each; nine numbers a triangle. */
void model_write_floats(const char *path, const float *corners, uint32_t triangle_count);
void model_write_doubles(const char *path, const double *corners, uint32_t triangle_count);

/** Writes a sphere of 2 rings x (rings - 1) x 2 triangles about a point. */
void model_write_sphere(const char *path, uint32_t rings, double radius, const double centre[3]);

/** Runs oocbuild with --json in a folder; fails unless it exits with 0. */
void model_build(const char *folder, const char *arguments);
/** Runs it and fails unless it exits with 1 and says one line with `text` in it. */
void model_build_fails(const char *folder, const char *arguments, const char *text);
/** A number of the last summary. */
double model_told(const char *name);

/** An open store with its HS. */
struct model_store {
	struct store_file *file;
	const struct store_superblock *superblock;
	struct store_node *nodes;
	uint8_t *payload; /* of the leaf that was read last */
	struct payload_view view;
};

void model_store_open(const char *path, struct model_store *ret);
void model_store_close(struct model_store *store);
/** Reads a node's payload; false: it has none. */
bool model_store_read(struct model_store *store, uint32_t node_index);

#endif /* TESTS_INTEGRATION_MODELS_H */
