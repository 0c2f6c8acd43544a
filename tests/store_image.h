/* SPDX-License-Identifier: MIT */
/**
 * store_image.h - a store as bytes, to be broken on purpose and sealed again.
 *
 * A sealed image has right checksums, whatever its fields say: what a hostile writer would make.
 */
#ifndef TESTS_STORE_IMAGE_H
#define TESTS_STORE_IMAGE_H

#include <stddef.h>
#include <stdint.h>

#include "formats/store/layout.h"

struct store_image {
	uint8_t *bytes;
	size_t size_bytes;
};

void store_image_load(const char *path, struct store_image *ret);
void store_image_save(const struct store_image *image, const char *path);
void store_image_done(struct store_image *image);

struct store_superblock *store_image_superblock(const struct store_image *image, uint32_t slot);
struct store_node *store_image_nodes(const struct store_image *image);

/** The payload of a node without codec. */
void *store_image_payload(const struct store_image *image, uint32_t node);

/** Makes a superblock's checksum right. */
void store_image_seal_superblock(const struct store_image *image, uint32_t slot);

/** Makes the checksums of payloads, HS, names and superblock A right, where they lie in the image. */
void store_image_seal(const struct store_image *image);

/** Puts a names block of decoded bytes behind everything, and seals. */
void store_image_put_names(struct store_image *image, const void *names, size_t names_bytes);

#endif /* TESTS_STORE_IMAGE_H */
