/* SPDX-License-Identifier: MIT */
/**
 * vertex_order.h - triangles in an order in which a GPU's vertex cache finds most vertices again.
 *
 * Threads: any; one scratch a thread.
 * Source: Sander, Nehab & Barczak 2007, "Fast Triangle Reordering for Vertex Locality and Reduced
 *	Overdraw": Tipsify, without its second half.  It gives a permutation, so that whatever belongs
 *	to a triangle can follow it.
 */
#ifndef TOOLS_BUILD_VERTEX_ORDER_H
#define TOOLS_BUILD_VERTEX_ORDER_H

#include <stddef.h>
#include <stdint.h>

/** Vertices that a cache is taken to hold. */
#define VERTEX_ORDER_CACHE 16u

/** Words of scratch for so many triangles and vertices. */
static inline size_t vertex_order_scratch(uint32_t triangle_count, uint32_t vertex_count)
{
	return (size_t)triangle_count * 10 + (size_t)vertex_count * 3 + 1;
}

/**
 * Orders triangles.
 *
 * indices:  three a triangle, each below vertex_count
 * scratch:  vertex_order_scratch() words
 * ret:      triangle_count numbers of triangles, each once
 */
void vertex_order(const uint32_t *indices, uint32_t triangle_count, uint32_t vertex_count,
		  uint32_t *scratch, uint32_t *ret);

#endif /* TOOLS_BUILD_VERTEX_ORDER_H */
