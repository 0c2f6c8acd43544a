/* SPDX-License-Identifier: MIT */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <math.h>

#include "tests/helper.h"
#include "tests/integration/models.h"

static char output[16384];

double model_random(void)
{
	static uint64_t random = 1;

	random = random * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
	return (double)(random >> 11) * 0x1p-53;
}

/* ---- files ---- */

static FILE *begin_ply(const char *path, const char *type, uint32_t vertex_count,
		       uint32_t face_count)
{
	FILE *file = fopen(path, "wbe");

	assert_non_null(file);
	assert_true(fprintf(file,
			    "ply\nformat binary_little_endian 1.0\nelement vertex %u\n"
			    "property %s x\nproperty %s y\nproperty %s z\nelement face %u\n"
			    "property list uchar int vertex_indices\nend_header\n",
			    vertex_count, type, type, type, face_count) > 0);
	return file;
}

static void write_face(FILE *file, uint32_t a, uint32_t b, uint32_t c)
{
	const uint32_t corners[3] = { a, b, c };

	assert_int_equal(fputc(3, file), 3);
	assert_int_equal(fwrite(corners, sizeof(corners), 1, file), 1);
}

static void write_soup(const char *path, const char *type, const void *corners, size_t number_bytes,
		       uint32_t triangle_count)
{
	FILE *file = begin_ply(path, type, triangle_count * 3, triangle_count);

	if (triangle_count > 0)
		assert_int_equal(fwrite(corners, number_bytes * 9, triangle_count, file),
				 triangle_count);
	for (uint32_t i = 0; i < triangle_count; i++)
		write_face(file, 3 * i, 3 * i + 1, 3 * i + 2);
	assert_int_equal(fclose(file), 0);
}

void model_write_floats(const char *path, const float *corners, uint32_t triangle_count)
{
	write_soup(path, "float", corners, sizeof(float), triangle_count);
}

void model_write_doubles(const char *path, const double *corners, uint32_t triangle_count)
{
	write_soup(path, "double", corners, sizeof(double), triangle_count);
}

void model_write_sphere(const char *path, uint32_t rings, double radius, const double centre[3])
{
	uint32_t segments = 2 * rings;
	FILE *file =
		begin_ply(path, "double", segments * (rings - 1) + 2, 2 * segments * (rings - 1));
	const double pi = acos(-1);

	for (uint32_t ring = 1; ring < rings; ring++) {
		for (uint32_t i = 0; i < segments; i++) {
			double down = pi * ring / rings;
			double round = 2 * pi * i / segments;
			const double at[3] = { centre[0] + radius * sin(down) * cos(round),
					       centre[1] + radius * sin(down) * sin(round),
					       centre[2] + radius * cos(down) };

			assert_int_equal(fwrite(at, sizeof(at), 1, file), 1);
		}
	}
	for (int side = 1; side >= -1; side -= 2) {
		const double pole[3] = { centre[0], centre[1], centre[2] + side * radius };

		assert_int_equal(fwrite(pole, sizeof(pole), 1, file), 1);
	}
	for (uint32_t ring = 0; ring + 2 < rings; ring++) {
		for (uint32_t i = 0; i < segments; i++) {
			uint32_t next = (i + 1) % segments;

			write_face(file, ring * segments + i, (ring + 1) * segments + i,
				   ring * segments + next);
			write_face(file, ring * segments + next, (ring + 1) * segments + i,
				   (ring + 1) * segments + next);
		}
	}
	for (uint32_t i = 0; i < segments; i++) {
		uint32_t next = (i + 1) % segments;
		uint32_t last = (rings - 2) * segments;

		write_face(file, (rings - 1) * segments, i, next);
		write_face(file, (rings - 1) * segments + 1, last + next, last + i);
	}
	assert_int_equal(fclose(file), 0);
}

/* ---- building ---- */

void model_build(const char *folder, const char *arguments)
{
	if (test_command(output, sizeof(output), "cd %s && \"$OOCD_BIN\"/oocbuild --json %s",
			 folder, arguments) != 0)
		fail_msg("oocbuild %s: %s", arguments, output);
}

void model_build_fails(const char *folder, const char *arguments, const char *text)
{
	int status = test_command(output, sizeof(output), "cd %s && \"$OOCD_BIN\"/oocbuild %s",
				  folder, arguments);
	const char *end = strchr(output, '\n');

	if (status != 1 || !strstr(output, text) || !end || end[1] != '\0' ||
	    strncmp(output, "oocbuild: ", strlen("oocbuild: ")) != 0)
		fail_msg("oocbuild %s: exit status %d, wanted 1 and \"%s\": %s", arguments, status,
			 text, output);
}

double model_told(const char *name)
{
	char quoted[64];
	const char *at;

	(void)snprintf(quoted, sizeof(quoted), "\"%s\": ", name);
	at = strstr(output, quoted);
	if (!at)
		fail_msg("no %s in %s", name, output);
	return at ? strtod(at + strlen(quoted), NULL) : 0;
}

/* ---- stores ---- */

void model_store_open(const char *path, struct model_store *ret)
{
	struct why why = { 0 };

	*ret = (struct model_store){ 0 };
	if (store_open_path(path, &ret->file, &why) < 0)
		fail_msg("%s: %s", path, why.text);
	ret->superblock = store_superblock(ret->file);
	ret->nodes = calloc(ret->superblock->node_count, sizeof(*ret->nodes));
	ret->payload = aligned_alloc(64, (ret->superblock->payload_bytes_max + 127) / 64 * 64);
	assert_true(ret->nodes && ret->payload);
	if (store_load_hs(ret->file, ret->nodes, &why) < 0)
		fail_msg("%s: %s", path, why.text);
}

void model_store_close(struct model_store *store)
{
	store->file = store_close(store->file);
	free(store->nodes);
	free(store->payload);
}

bool model_store_read(struct model_store *store, uint32_t node_index)
{
	const struct store_node *node = &store->nodes[node_index];
	struct why why = { 0 };
	void *scratch;

	if (node->kind == STORE_KIND_NONE)
		return false;
	scratch = malloc(node->stored_bytes);
	assert_non_null(scratch);
	if (store_read_payload(store->file, node, store->payload, scratch, &why) < 0)
		fail_msg("node %u: %s", node_index, why.text);
	free(scratch);
	payload_view(store->payload, &store->view);
	return true;
}
