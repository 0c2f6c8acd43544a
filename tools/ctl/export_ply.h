/* SPDX-License-Identifier: MIT */
/**
 * export_ply.h - PLY, written from front to back.
 *
 * The counts come first in the file, so the caller knows them before the first vertex.
 *
 * Threads: one at a time.
 */
#ifndef TOOLS_CTL_EXPORT_PLY_H
#define TOOLS_CTL_EXPORT_PLY_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

/** What the file has. */
struct export_ply {
	FILE *out;
	bool ascii;
	bool positions_double;
	bool normals;
	bool colours;
	uint64_t vertex_count;
	uint64_t triangle_count;
};

/** One vertex; normal and colour only where the file has them. */
struct export_vertex {
	double position[3];
	float normal[3];
	uint8_t colour[4];
};

void export_ply_header(const struct export_ply *ply);
void export_ply_vertex(const struct export_ply *ply, const struct export_vertex *vertex);
void export_ply_triangle(const struct export_ply *ply, const uint32_t corners[3]);

#endif /* TOOLS_CTL_EXPORT_PLY_H */
