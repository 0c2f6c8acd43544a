/* SPDX-License-Identifier: MIT */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "formats/store/payload.h"
#include "formats/store/store_file.h"
#include "tests/helper.h"
#include "tests/integration/triangles.h"

static int compare_triangles(const void *a, const void *b)
{
	return memcmp(a, b, sizeof(struct triangle));
}

/* Turns a triangle so that its corner of the least bytes is first; winding stays. */
static void add_triangle(struct triangles *triangles, double (*const corners[3])[3])
{
	struct triangle *triangle;
	unsigned least = 0;

	for (unsigned i = 1; i < 3; i++)
		if (memcmp(*corners[i], *corners[least], sizeof(*corners[i])) < 0)
			least = i;
	/* Room for the next power of two, whenever one is full. */
	if ((triangles->count & (triangles->count - 1)) == 0) {
		size_t room = triangles->count ? triangles->count * 2 : 1;

		triangles->list = realloc(triangles->list, room * sizeof(*triangles->list));
		assert_non_null(triangles->list);
	}
	triangle = &triangles->list[triangles->count++];
	for (unsigned i = 0; i < 3; i++)
		memcpy(triangle->corners[i], *corners[(least + i) % 3],
		       sizeof(triangle->corners[i]));
}

static void sort_triangles(struct triangles *triangles)
{
	if (triangles->count > 0)
		qsort(triangles->list, triangles->count, sizeof(*triangles->list),
		      compare_triangles);
}

/* ---- what a store holds, by the library ---- */

static void add_payload(struct triangles *triangles, const struct store_superblock *superblock,
			const void *payload, uint32_t part)
{
	struct payload_view view;

	payload_view(payload, &view);
	for (uint32_t i = 0; i < view.header->triangle_count; i++) {
		double positions[3][3];
		double(*const corners[3])[3] = { &positions[0], &positions[1], &positions[2] };

		for (uint32_t k = 0; k < 3; k++) {
			payload_position(&view, payload_index(&view, i, k), positions[k]);
			for (unsigned axis = 0; axis < 3; axis++)
				if (superblock->origin[axis] != 0)
					positions[k][axis] += superblock->origin[axis];
		}
		if (part == UINT32_MAX ||
		    view.runs[payload_vertex_run(&view, payload_index(&view, i, 0))].part == part)
			add_triangle(triangles, corners);
	}
}

struct triangles triangles_of_store(const char *path, uint32_t part)
{
	struct triangles triangles = { 0 };
	struct store_file *store;
	const struct store_superblock *superblock;
	struct store_node *nodes;
	void *payload;
	void *stored;

	assert_int_equal(store_open_path(path, &store, NULL), 0);
	superblock = store_superblock(store);
	nodes = malloc(superblock->node_count * sizeof(*nodes));
	payload =
		aligned_alloc(16, bytes_round_up((uint64_t)superblock->payload_bytes_max + 1, 16));
	stored = malloc((size_t)superblock->payload_bytes_max * 2 + 1);
	assert_int_equal(store_load_hs(store, nodes, NULL), 0);
	for (uint64_t i = 0; i < superblock->node_count; i++) {
		if (nodes[i].payload_id == 0)
			continue;
		assert_int_equal(store_read_payload(store, &nodes[i], payload, stored, NULL), 0);
		add_payload(&triangles, superblock, payload, part);
	}
	free(stored);
	free(payload);
	free(nodes);
	store_close(store);
	sort_triangles(&triangles);
	return triangles;
}

/* ---- what a PLY file of ours holds ---- */

struct ply {
	size_t vertex_count;
	size_t triangle_count;
	bool is_ascii;
	bool is_double;
	unsigned properties; /* of a vertex */
	size_t vertex_bytes;
	const char *data;
};

static struct ply parse_header(const char *text)
{
	struct ply ply = { 0 };
	const char *line = text;

	while (strncmp(line, "end_header\n", 11) != 0) {
		bool of_vertex = ply.triangle_count == 0 && !strstr(line, "element vertex");

		(void)sscanf(line, "element vertex %zu", &ply.vertex_count);
		(void)sscanf(line, "element face %zu", &ply.triangle_count);
		if (strncmp(line, "format ascii", 12) == 0)
			ply.is_ascii = true;
		if (strncmp(line, "property list", 13) != 0 && strncmp(line, "property", 8) == 0 &&
		    of_vertex) {
			ply.is_double |= strncmp(line, "property double", 15) == 0;
			ply.vertex_bytes += strncmp(line, "property double", 15) == 0  ? 8
					    : strncmp(line, "property float", 14) == 0 ? 4
										       : 1;
			ply.properties++;
		}
		line = strchr(line, '\n');
		assert_non_null(line);
		line++;
	}
	ply.data = line + 11;
	return ply;
}

static void read_binary_vertices(const struct ply *ply, double (*positions)[3])
{
	for (size_t i = 0; i < ply->vertex_count; i++) {
		const char *at = ply->data + i * ply->vertex_bytes;

		for (unsigned axis = 0; axis < 3; axis++) {
			float narrow;

			if (ply->is_double) {
				memcpy(&positions[i][axis], at + axis * 8, 8);
			} else {
				memcpy(&narrow, at + axis * 4, 4);
				positions[i][axis] = (double)narrow;
			}
		}
	}
}

struct triangles triangles_of_ply(const char *path)
{
	struct triangles triangles = { 0 };
	size_t size_bytes;
	char *text = test_file_read(path, &size_bytes);
	struct ply ply;
	double(*positions)[3];
	char *at;

	text[size_bytes] = '\0';
	ply = parse_header(text);
	positions = calloc(ply.vertex_count + 1, sizeof(*positions));
	at = text + (ply.data - text);
	if (ply.is_ascii) {
		for (size_t i = 0; i < ply.vertex_count; i++)
			for (unsigned k = 0; k < ply.properties; k++) {
				double value = strtod(at, &at);

				if (k < 3)
					positions[i][k] = value;
			}
	} else {
		read_binary_vertices(&ply, positions);
		at += ply.vertex_count * ply.vertex_bytes;
	}
	for (size_t i = 0; i < ply.triangle_count; i++) {
		uint32_t corners[3];
		double(*pointers[3])[3];

		if (ply.is_ascii) {
			assert_int_equal(strtol(at, &at, 10), 3);
			for (unsigned k = 0; k < 3; k++)
				corners[k] = (uint32_t)strtoul(at, &at, 10);
		} else {
			assert_int_equal(*at, 3);
			memcpy(corners, at + 1, sizeof(corners));
			at += 13;
		}
		for (unsigned k = 0; k < 3; k++) {
			assert_true(corners[k] < ply.vertex_count);
			pointers[k] = &positions[corners[k]];
		}
		add_triangle(&triangles, pointers);
	}
	if (!ply.is_ascii)
		assert_true(at == text + size_bytes);
	free(positions);
	free(text);
	sort_triangles(&triangles);
	return triangles;
}

void assert_same_triangles(struct triangles a, struct triangles b)
{
	assert_int_equal(a.count, b.count);
	if (a.count > 0)
		assert_memory_equal(a.list, b.list, a.count * sizeof(*a.list));
	free(a.list);
	free(b.list);
}
