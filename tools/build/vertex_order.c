/* SPDX-License-Identifier: MIT */
#include "tools/build/vertex_order.h"

#include <stdbool.h>
#include <string.h>

#define NONE UINT32_MAX

/** The state of the walk; arrays are in the caller's scratch. */
struct order {
	const uint32_t *indices;
	uint32_t triangle_count;
	uint32_t vertex_count;
	uint32_t *first;     /* per vertex, and one more: its triangles in ... */
	uint32_t *triangles; /* ... this list */
	uint32_t *live;      /* per vertex: triangles that are still to come */
	uint32_t *stamp;     /* per vertex: when it entered the cache */
	uint32_t *emitted;   /* per triangle */
	uint32_t *dead_ends; /* stack of vertices seen of late */
	uint32_t *candidates;
	uint32_t dead_end_count;
	uint32_t time;
	uint32_t cursor; /* below it no vertex has triangles to come */
};

static void find_neighbours(struct order *order)
{
	uint32_t corner_count = order->triangle_count * 3;

	memset(order->live, 0, order->vertex_count * sizeof(uint32_t));
	for (uint32_t i = 0; i < corner_count; i++)
		order->live[order->indices[i]]++;
	order->first[0] = 0;
	for (uint32_t i = 0; i < order->vertex_count; i++)
		order->first[i + 1] = order->first[i] + order->live[i];
	for (uint32_t i = corner_count; i-- > 0;) {
		uint32_t vertex = order->indices[i];

		/* Filled from each end to its begin; then `live` is as before again. */
		order->triangles[order->first[vertex] + --order->live[vertex]] = i / 3;
	}
	for (uint32_t i = 0; i < order->vertex_count; i++)
		order->live[i] = order->first[i + 1] - order->first[i];
}

/* The next vertex where nothing is near: the last one seen that has work, else the first of all. */
static uint32_t skip_dead_end(struct order *order)
{
	while (order->dead_end_count > 0) {
		uint32_t vertex = order->dead_ends[--order->dead_end_count];

		if (order->live[vertex] > 0)
			return vertex;
	}
	while (order->cursor < order->vertex_count && order->live[order->cursor] == 0)
		order->cursor++;
	return order->cursor < order->vertex_count ? order->cursor : NONE;
}

/* Of the vertices around, the one longest in the cache that will still be there when it is done. */
static uint32_t next_vertex(struct order *order, uint32_t candidate_count)
{
	uint32_t best = NONE;
	uint32_t best_age = 0;

	for (uint32_t i = 0; i < candidate_count; i++) {
		uint32_t vertex = order->candidates[i];
		uint32_t age = order->time - order->stamp[vertex];

		if (order->live[vertex] == 0)
			continue;
		if (age + 2 * order->live[vertex] > VERTEX_ORDER_CACHE)
			age = 0;
		if (best == NONE || age > best_age) {
			best = vertex;
			best_age = age;
		}
	}
	return best != NONE ? best : skip_dead_end(order);
}

/* Emits the fan of a vertex.  Returns: the candidates for the next. */
static uint32_t emit_fan(struct order *order, uint32_t fan, uint32_t *ret, uint32_t *ret_count)
{
	uint32_t candidate_count = 0;

	for (uint32_t i = order->first[fan]; i < order->first[fan + 1]; i++) {
		uint32_t triangle = order->triangles[i];

		if (order->emitted[triangle])
			continue;
		for (unsigned k = 0; k < 3; k++) {
			uint32_t vertex = order->indices[3 * triangle + k];

			order->dead_ends[order->dead_end_count++] = vertex;
			order->candidates[candidate_count++] = vertex;
			order->live[vertex]--;
			if (order->time - order->stamp[vertex] > VERTEX_ORDER_CACHE)
				order->stamp[vertex] = order->time++;
		}
		order->emitted[triangle] = true;
		ret[(*ret_count)++] = triangle;
	}
	return candidate_count;
}

void vertex_order(const uint32_t *indices, uint32_t triangle_count, uint32_t vertex_count,
		  uint32_t *scratch, uint32_t *ret)
{
	struct order order = {
		.indices = indices,
		.triangle_count = triangle_count,
		.vertex_count = vertex_count,
		.first = scratch,
		.time = VERTEX_ORDER_CACHE + 1,
	};
	uint32_t ret_count = 0;
	uint32_t fan = 0;

	order.live = order.first + vertex_count + 1;
	order.stamp = order.live + vertex_count;
	order.triangles = order.stamp + vertex_count;
	order.dead_ends = order.triangles + (size_t)triangle_count * 3;
	order.candidates = order.dead_ends + (size_t)triangle_count * 3;
	order.emitted = order.candidates + (size_t)triangle_count * 3;
	memset(order.stamp, 0, vertex_count * sizeof(uint32_t));
	memset(order.emitted, 0, triangle_count * sizeof(uint32_t));
	find_neighbours(&order);
	while (fan != NONE) {
		uint32_t candidate_count = emit_fan(&order, fan, ret, &ret_count);

		fan = next_vertex(&order, candidate_count);
	}
}
