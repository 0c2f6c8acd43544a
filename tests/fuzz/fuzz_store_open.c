/* SPDX-License-Identifier: MIT */
/*
 * Bytes that claim to be a store go through everything that reads one: first as they are, then with
 * their checksums made right, so that the judges behind the checksums are reached.
 */
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "formats/base/file.h"
#include "formats/base/why.h"
#include "formats/store/payload.h"
#include "formats/store/store_file.h"
#include "tests/store_image.h"

#define INPUT_BYTES_MAX (1u << 20)

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size_bytes);

/* Touches all that a judged payload promises. */
static void walk_payload(const void *payload)
{
	struct payload_view view;
	volatile double sum = 0;

	payload_view(payload, &view);
	for (uint32_t i = 0; i < view.header->triangle_count; i++) {
		for (uint32_t k = 0; k < 3; k++) {
			double position[3];

			payload_position(&view, payload_index(&view, i, k), position);
			sum = sum + position[0];
		}
	}
}

static void walk_names(const struct store_names *names)
{
	volatile size_t sum = 0;

	for (uint64_t i = 0; i < names->header->part_count; i++) {
		const struct store_part *part = &names->parts[i];

		sum = sum + strlen(names->strings + part->name) +
		      strlen(names->strings + names->sections[part->section].name);
	}
}

static void read_payloads(const struct store_file *store, const struct store_node *nodes)
{
	for (uint64_t i = 0; i < store_superblock(store)->node_count; i++) {
		const struct store_node *node = &nodes[i];
		void *payload;
		void *stored;

		if (node->payload_id == 0)
			continue;
		payload = aligned_alloc(16, ((size_t)node->payload_bytes + 15) / 16 * 16);
		stored = malloc(node->stored_bytes);
		if (payload && stored &&
		    store_read_payload(store, node, payload, stored, NULL) == 0)
			walk_payload(payload);
		free(stored);
		free(payload);
	}
}

static void read_store(int fd)
{
	struct store_names names;
	struct store_file *store;
	struct store_node *nodes;

	if (store_open(fd, &store, NULL) < 0) {
		(void)fd_close(fd);
		return;
	}
	nodes = malloc(store_superblock(store)->node_count * sizeof(*nodes));
	if (!nodes)
		abort();
	if (store_load_hs(store, nodes, NULL) == 0)
		read_payloads(store, nodes);
	if (store_load_names(store, &names, NULL) == 0) {
		walk_names(&names);
		store_names_done(&names);
	}
	free(nodes);
	store_close(store);
}

static void read_bytes(const uint8_t *data, size_t size_bytes)
{
	int fd = memfd_create("fuzz", MFD_CLOEXEC);

	if (fd < 0 || file_write_at(fd, data, size_bytes, 0) < 0)
		abort();
	read_store(fd);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size_bytes)
{
	struct store_image image = { .size_bytes = size_bytes };

	if (size_bytes > INPUT_BYTES_MAX)
		return 0;
	read_bytes(data, size_bytes);
	if (size_bytes < STORE_FIRST_EXTENT_OFFSET)
		return 0;
	image.bytes = aligned_alloc(STORE_BLOCK_BYTES,
				    (size_bytes / STORE_BLOCK_BYTES + 1) * STORE_BLOCK_BYTES);
	if (!image.bytes)
		abort();
	memcpy(image.bytes, data, size_bytes);
	store_image_seal(&image);
	read_bytes(image.bytes, size_bytes);
	free(image.bytes);
	return 0;
}
