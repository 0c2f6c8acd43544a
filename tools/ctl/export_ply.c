/* SPDX-License-Identifier: MIT */
#include "tools/ctl/export_ply.h"

#include <inttypes.h>
#include <string.h>

/** The longest vertex: three doubles, three floats, four bytes. */
#define VERTEX_BYTES_MAX (3 * sizeof(double) + 3 * sizeof(float) + 4)

void export_ply_header(const struct export_ply *ply)
{
	static const char axes[] = "xyz";
	const char *type = ply->positions_double ? "double" : "float";

	fprintf(ply->out, "ply\nformat %s 1.0\ncomment oocctl " OOCD_VERSION "\n",
		ply->ascii ? "ascii" : "binary_little_endian");
	fprintf(ply->out, "element vertex %" PRIu64 "\n", ply->vertex_count);
	for (unsigned i = 0; i < 3; i++)
		fprintf(ply->out, "property %s %c\n", type, axes[i]);
	for (unsigned i = 0; i < 3 && ply->normals; i++)
		fprintf(ply->out, "property float n%c\n", axes[i]);
	if (ply->colours)
		fputs("property uchar red\nproperty uchar green\nproperty uchar blue\n"
		      "property uchar alpha\n",
		      ply->out);
	fprintf(ply->out,
		"element face %" PRIu64 "\nproperty list uchar uint vertex_indices\nend_header\n",
		ply->triangle_count);
}

static void write_ascii_vertex(const struct export_ply *ply, const struct export_vertex *vertex)
{
	const double *position = vertex->position;
	const float *normal = vertex->normal;
	const uint8_t *colour = vertex->colour;

	/* So many digits that reading gives the same bits. */
	fprintf(ply->out, ply->positions_double ? "%.17g %.17g %.17g" : "%.9g %.9g %.9g",
		position[0], position[1], position[2]);
	if (ply->normals)
		fprintf(ply->out, " %.9g %.9g %.9g", (double)normal[0], (double)normal[1],
			(double)normal[2]);
	if (ply->colours)
		fprintf(ply->out, " %u %u %u %u", colour[0], colour[1], colour[2], colour[3]);
	fputc('\n', ply->out);
}

static size_t put(uint8_t *bytes, size_t used, const void *data, size_t size_bytes)
{
	memcpy(bytes + used, data, size_bytes);
	return used + size_bytes;
}

void export_ply_vertex(const struct export_ply *ply, const struct export_vertex *vertex)
{
	uint8_t bytes[VERTEX_BYTES_MAX];
	size_t used = 0;

	if (ply->ascii) {
		write_ascii_vertex(ply, vertex);
		return;
	}
	for (unsigned i = 0; i < 3; i++) {
		float narrow = (float)vertex->position[i];

		used = ply->positions_double
			       ? put(bytes, used, &vertex->position[i], sizeof(vertex->position[i]))
			       : put(bytes, used, &narrow, sizeof(narrow));
	}
	if (ply->normals)
		used = put(bytes, used, vertex->normal, sizeof(vertex->normal));
	if (ply->colours)
		used = put(bytes, used, vertex->colour, sizeof(vertex->colour));
	(void)fwrite(bytes, 1, used, ply->out);
}

void export_ply_triangle(const struct export_ply *ply, const uint32_t corners[3])
{
	uint8_t bytes[1 + 3 * sizeof(uint32_t)] = { 3 };

	if (ply->ascii) {
		fprintf(ply->out, "3 %u %u %u\n", corners[0], corners[1], corners[2]);
		return;
	}
	memcpy(bytes + 1, corners, 3 * sizeof(uint32_t));
	(void)fwrite(bytes, 1, sizeof(bytes), ply->out);
}
