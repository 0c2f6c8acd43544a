/* SPDX-License-Identifier: MIT */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "formats/store/payload.h"
#include "tests/helper_scene.h"

/** The least cells: 64 steps. */
#define LEVELS 10u

/* ---- models ---- */

void scene_triangle(struct scene_model *model, const double a[3], const double b[3],
		    const double c[3])
{
	double(*triangle)[3];

	if (model->count == model->room) {
		model->room = model->room > 0 ? 2 * model->room : 64;
		model->triangles =
			realloc(model->triangles, model->room * sizeof(*model->triangles));
		assert_non_null(model->triangles);
	}
	triangle = model->triangles[model->count++];
	for (int k = 0; k < 3; k++) {
		triangle[0][k] = rint(a[k] / SCENE_STEP) * SCENE_STEP;
		triangle[1][k] = rint(b[k] / SCENE_STEP) * SCENE_STEP;
		triangle[2][k] = rint(c[k] / SCENE_STEP) * SCENE_STEP;
	}
}

void scene_plate(struct scene_model *model, const double corner[3], const double across_edge[3],
		 const double along_edge[3], uint32_t across, uint32_t along)
{
	for (uint32_t i = 0; i < across; i++)
		for (uint32_t j = 0; j < along; j++) {
			double at[4][3];

			for (uint32_t c = 0; c < 4; c++)
				for (int k = 0; k < 3; k++)
					at[c][k] = corner[k] +
						   across_edge[k] * (i + (c & 1)) / across +
						   along_edge[k] * (j + (c >> 1)) / along;
			scene_triangle(model, at[0], at[1], at[3]);
			scene_triangle(model, at[0], at[3], at[2]);
		}
}

void scene_box(struct scene_model *model, const double box_min[3], const double box_max[3],
	       uint32_t side)
{
	for (int axis = 0; axis < 3; axis++) {
		double edges[2][3] = { { 0 } };

		for (int e = 0; e < 2; e++) {
			int k = (axis + 1 + e) % 3;

			edges[e][k] = box_max[k] - box_min[k];
		}
		for (int end = 0; end < 2; end++) {
			double corner[3] = { box_min[0], box_min[1], box_min[2] };

			corner[axis] = end ? box_max[axis] : box_min[axis];
			scene_plate(model, corner, edges[0], edges[1], side, side);
		}
	}
}

/* ---- scenes ---- */

/* The triangles of a node that is not divided yet. */
struct members {
	uint32_t *triangles;
	uint32_t count;
};

struct making {
	struct scene *scene;
	const struct scene_model *model;
	struct members *members; /* a node */
	uint32_t leaf_triangles;
	uint32_t node_room;
};

static void cell_box(const struct scene *scene, const struct store_node *node, double low[3],
		     double *ret_edge)
{
	*ret_edge = ldexp(scene->superblock.root_size, -node->level);
	for (int k = 0; k < 3; k++)
		low[k] = scene->superblock.root_min[k] + node->cell[k] * *ret_edge;
}

static bool belongs(const struct scene *scene, double triangle[3][3], const double low[3],
		    double edge)
{
	for (int k = 0; k < 3; k++) {
		double least = fmin(triangle[0][k], fmin(triangle[1][k], triangle[2][k]));
		double most = fmax(triangle[0][k], fmax(triangle[1][k], triangle[2][k]));
		double middle = (triangle[0][k] + triangle[1][k] + triangle[2][k]) / 3.0;

		if (scene->superblock.layout == STORE_LAYOUT_REPLICATE) {
			if (most < low[k] || least > low[k] + edge)
				return false;
		} else if (middle < low[k] || middle >= low[k] + edge) {
			return false;
		}
	}
	return true;
}

static void members_of_octant(const struct making *making, const struct members *from,
			      const struct store_node *child, struct members *ret)
{
	double low[3];
	double edge;

	cell_box(making->scene, child, low, &edge);
	ret->count = 0;
	ret->triangles = malloc((from->count + 1) * sizeof(*ret->triangles));
	assert_non_null(ret->triangles);
	for (uint32_t i = 0; i < from->count; i++)
		if (belongs(making->scene, making->model->triangles[from->triangles[i]], low, edge))
			ret->triangles[ret->count++] = from->triangles[i];
}

static void node_divide(struct making *making, uint32_t index)
{
	struct scene *scene = making->scene;
	uint32_t first = (uint32_t)scene->superblock.node_count;

	if (first + 8 > making->node_room) {
		making->node_room *= 2;
		scene->nodes = realloc(scene->nodes, making->node_room * sizeof(*scene->nodes));
		making->members =
			realloc(making->members, making->node_room * sizeof(*making->members));
		assert_true(scene->nodes && making->members);
	}
	scene->nodes[index].first_child = first;
	for (unsigned octant = 0; octant < 8; octant++) {
		uint32_t number = first + scene->nodes[index].child_count;
		struct store_node child = { .parent = index,
					    .first_child = STORE_NODE_NONE,
					    .level = (uint8_t)(scene->nodes[index].level + 1) };

		for (unsigned k = 0; k < 3; k++)
			child.cell[k] = 2 * scene->nodes[index].cell[k] + (octant >> k & 1);
		members_of_octant(making, &making->members[index], &child,
				  &making->members[number]);
		if (making->members[number].count == 0) {
			free(making->members[number].triangles);
			continue;
		}
		scene->nodes[number] = child;
		scene->nodes[index].child_count++;
		scene->superblock.node_count++;
	}
}

/* Box, area and solidity of a leaf. */
static void leaf_describe(const struct making *making, uint32_t index)
{
	const double g = STORE_GOLDEN_RATIO;
	const double axes[STORE_SOLIDITY_DIRECTIONS][3] = {
		{ 0, 1, g }, { 0, -1, g }, { 1, g, 0 }, { -1, g, 0 }, { g, 0, 1 }, { g, 0, -1 }
	};
	struct store_node *node = &making->scene->nodes[index];
	double edge = ldexp(making->scene->superblock.root_size, -node->level);
	double projected[STORE_SOLIDITY_DIRECTIONS] = { 0 };

	for (int k = 0; k < 3; k++) {
		node->box_min[k] = INFINITY;
		node->box_max[k] = -INFINITY;
	}
	for (uint32_t i = 0; i < making->members[index].count; i++) {
		double(*t)[3] = making->model->triangles[making->members[index].triangles[i]];
		double normal[3];

		for (int k = 0; k < 3; k++) {
			int u = (k + 1) % 3;
			int v = (k + 2) % 3;

			normal[k] = 0.5 * ((t[1][u] - t[0][u]) * (t[2][v] - t[0][v]) -
					   (t[1][v] - t[0][v]) * (t[2][u] - t[0][u]));
			for (int c = 0; c < 3; c++) {
				node->box_min[k] = fminf(node->box_min[k], (float)t[c][k]);
				node->box_max[k] = fmaxf(node->box_max[k], (float)t[c][k]);
			}
		}
		for (unsigned d = 0; d < STORE_SOLIDITY_DIRECTIONS; d++)
			projected[d] += fabs(normal[0] * axes[d][0] + normal[1] * axes[d][1] +
					     normal[2] * axes[d][2]) /
					sqrt(1.0 + g * g);
		node->area += (float)sqrt(normal[0] * normal[0] + normal[1] * normal[1] +
					  normal[2] * normal[2]);
	}
	for (unsigned d = 0; d < STORE_SOLIDITY_DIRECTIONS; d++)
		node->solidity[d] = (uint8_t)rint(255 * (1 - exp(-projected[d] / (edge * edge))));
}

/* Three vertices a triangle, as floats that count steps from the middle of the cell. */
static void leaf_pack(const struct making *making, uint32_t index)
{
	struct store_node *node = &making->scene->nodes[index];
	uint32_t count = making->members[index].count;
	struct payload_run run = { 0 };
	struct payload_content content = { .payload_id = index + 1,
					   .kind = STORE_KIND_TRIANGLES,
					   .vertex_count = 3 * count,
					   .triangle_count = count,
					   .run_count = 1,
					   .position_format = PAYLOAD_F32X3_RUN,
					   .scale = SCENE_STEP,
					   .runs = &run };
	float(*positions)[4] = calloc(content.vertex_count, sizeof(*positions));
	uint32_t *indices = calloc(content.vertex_count, sizeof(*indices));
	double edge;

	assert_true(positions && indices);
	cell_box(making->scene, node, content.origin, &edge);
	for (uint32_t i = 0; i < content.vertex_count; i++) {
		uint32_t triangle = making->members[index].triangles[i / 3];

		indices[i] = i;
		for (int k = 0; k < 3; k++)
			positions[i][k] = (float)((making->model->triangles[triangle][i % 3][k] -
						   content.origin[k]) /
						  SCENE_STEP);
	}
	content.positions = positions;
	content.indices = indices;
	assert_int_equal(payload_size(&content, &node->payload_bytes), 0);
	making->scene->payloads[index] = calloc(1, node->payload_bytes);
	assert_non_null(making->scene->payloads[index]);
	payload_write(&content, making->scene->payloads[index]);
	node->payload_id = content.payload_id;
	node->kind = STORE_KIND_TRIANGLES;
	node->triangle_count = count;
	node->vertex_count = content.vertex_count;
	free(positions);
	free(indices);
}

/* A cube of a power of two around the model. */
static void scene_bound(struct scene *scene, const struct scene_model *model)
{
	struct store_superblock *superblock = &scene->superblock;
	double reach = SCENE_STEP;

	for (int k = 0; k < 3; k++) {
		superblock->box_min[k] = model->count > 0 ? INFINITY : 0.0;
		superblock->box_max[k] = model->count > 0 ? -INFINITY : 0.0;
	}
	for (uint32_t i = 0; i < 3 * model->count; i++)
		for (int k = 0; k < 3; k++) {
			double at = model->triangles[i / 3][i % 3][k];

			superblock->box_min[k] = fmin(superblock->box_min[k], at);
			superblock->box_max[k] = fmax(superblock->box_max[k], at);
			reach = fmax(reach, fabs(at));
		}
	superblock->root_size = 2.0;
	while (superblock->root_size <= 2.0 * reach)
		superblock->root_size *= 2.0;
	for (int k = 0; k < 3; k++)
		superblock->root_min[k] = -0.5 * superblock->root_size;
}

void scene_make(struct scene *scene, struct scene_model *model, const double origin[3],
		uint32_t leaf_triangles, enum store_layout layout)
{
	struct making making = {
		.scene = scene, .model = model, .leaf_triangles = leaf_triangles, .node_room = 64
	};

	*scene = (struct scene){ .superblock = { .node_count = 1,
						 .layout = layout,
						 .step_exponent = -10,
						 .up_axis = STORE_AXIS_Z } };
	memcpy(scene->superblock.origin, origin, sizeof(scene->superblock.origin));
	scene_bound(scene, model);
	scene->nodes = calloc(making.node_room, sizeof(*scene->nodes));
	making.members = calloc(making.node_room, sizeof(*making.members));
	assert_true(scene->nodes && making.members);
	scene->nodes[0].parent = STORE_NODE_NONE;
	scene->nodes[0].first_child = STORE_NODE_NONE;
	making.members[0].count = model->count;
	making.members[0].triangles = malloc((model->count + 1) * sizeof(uint32_t));
	assert_non_null(making.members[0].triangles);
	for (uint32_t i = 0; i < model->count; i++)
		making.members[0].triangles[i] = i;
	for (uint32_t i = 0; i < scene->superblock.node_count; i++)
		if (making.members[i].count > leaf_triangles && scene->nodes[i].level < LEVELS)
			node_divide(&making, i);

	scene->payloads = calloc(scene->superblock.node_count, sizeof(*scene->payloads));
	assert_non_null(scene->payloads);
	for (uint32_t i = 0; i < scene->superblock.node_count; i++) {
		if (scene->nodes[i].child_count == 0 && making.members[i].count > 0) {
			leaf_describe(&making, i);
			leaf_pack(&making, i);
			scene->superblock.leaf_count++;
			scene->superblock.triangle_count += making.members[i].count;
		}
		free(making.members[i].triangles);
	}
	free(making.members);
	free(model->triangles);
	*model = (struct scene_model){ 0 };
}

void scene_done(struct scene *scene)
{
	for (uint64_t i = 0; i < scene->superblock.node_count; i++)
		free(scene->payloads[i]);
	free(scene->payloads);
	free(scene->nodes);
}

void scene_draw(const struct scene *scene, const struct camera_view *view, const bool *marks,
		struct raster *raster)
{
	raster_clear(raster);
	for (uint32_t i = 0; i < scene->superblock.node_count; i++)
		if (scene->payloads[i] && (!marks || marks[i]))
			assert_int_equal(
				raster_draw_payload(raster, view, scene->payloads[i], i, 0), 0);
}
