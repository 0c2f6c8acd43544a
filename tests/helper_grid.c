/* SPDX-License-Identifier: MIT */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "formats/base/bytes.h"
#include "formats/codec/codec.h"
#include "formats/store/payload.h"
#include "formats/store/store_writer.h"
#include "tests/helper.h"

/** Positions are multiples of a 64th: a box's edge is 32 steps, its cube's 64. */
#define STEP_EXPONENT  (-6)
#define STEPS_PER_UNIT 64u
#define BOX_STEPS      32u
#define BOX_FACES      6u
#define LEAF_BOXES     2u /* along an edge */
#define FACE_QUADS_MAX 32u

/** A scene being written. */
struct maker {
	struct test_grid grid;
	struct store_superblock superblock;
	struct store_node *nodes;
	uint32_t node_count;
	uint32_t leaf_level;
	uint64_t triangle_next; /* ordinal of the next triangle */
	struct store_writer *writer;
	struct codec_scratch *scratch;
};

/** One leaf's arrays, as payload_write() takes them. */
struct arrays {
	struct payload_run runs[LEAF_BOXES * LEAF_BOXES * LEAF_BOXES];
	uint32_t *indices;
	uint16_t (*positions)[4];
	struct {
		float xyz[3];
		uint32_t run;
	} * positions32;
	int8_t (*normals)[2];
	uint32_t *colours;
	uint64_t *triangle_ids;
	uint32_t run_count;
	uint32_t vertex_count;
	uint32_t triangle_count;
};

static void *make(size_t count, size_t size_bytes)
{
	void *memory = calloc(count, size_bytes);

	if (!memory)
		fail_msg("no memory");
	return memory;
}

static uint64_t box_triangles(const struct test_grid *grid)
{
	return (uint64_t)BOX_FACES * grid->face_quads * grid->face_quads * 2;
}

static struct test_grid with_defaults(const struct test_grid *grid)
{
	struct test_grid full = *grid;

	if (full.face_quads == 0)
		full.face_quads = 1;
	if (full.part_count == 0)
		full.part_count = 4;
	if (full.count > 64 || full.face_quads > FACE_QUADS_MAX)
		fail_msg("no such grid");
	return full;
}

uint64_t test_grid_triangles(const struct test_grid *grid)
{
	struct test_grid full = with_defaults(grid);

	return (uint64_t)full.count * full.count * full.count * box_triangles(&full);
}

/* ---- the tree ---- */

static double cell_size(const struct maker *maker, uint32_t level)
{
	return ldexp(maker->superblock.root_size, -(int)level);
}

static void add_node(struct maker *maker, uint32_t parent, uint32_t level, const uint32_t cell[3])
{
	struct store_node *node = &maker->nodes[maker->node_count++];

	node->parent = parent;
	node->first_child = STORE_NODE_NONE;
	node->level = (uint8_t)level;
	node->parent_error = INFINITY;
	memcpy(node->cell, cell, sizeof(node->cell));
	if (level > maker->superblock.level_max)
		maker->superblock.level_max = level;
}

/* Breadth first: children go to the end of the list that is being walked. */
static void grow_tree(struct maker *maker)
{
	static const uint32_t root_cell[3];
	uint32_t leaf_edge = (maker->grid.count + LEAF_BOXES - 1) / LEAF_BOXES;

	while (1u << maker->leaf_level < leaf_edge)
		maker->leaf_level++;
	maker->superblock.root_size = ldexp(LEAF_BOXES, (int)maker->leaf_level);
	maker->nodes =
		make(leaf_edge ? (size_t)2 << (3 * maker->leaf_level) : 1, sizeof(*maker->nodes));
	add_node(maker, STORE_NODE_NONE, 0, root_cell);
	for (uint32_t i = 0; i < maker->node_count; i++) {
		uint32_t level = maker->nodes[i].level + 1;

		if (level > maker->leaf_level)
			continue;
		maker->nodes[i].first_child = maker->node_count;
		for (uint32_t octant = 0; octant < 8; octant++) {
			uint32_t cell[3];
			bool is_inside = true;

			for (unsigned axis = 0; axis < 3; axis++) {
				cell[axis] = maker->nodes[i].cell[axis] * 2 + (octant >> axis & 1);
				if (cell[axis] * cell_size(maker, level) >= maker->grid.count)
					is_inside = false;
			}
			if (!is_inside)
				continue;
			add_node(maker, i, level, cell);
			maker->nodes[i].child_count++;
		}
	}
}

static void add_child_to_parent(struct maker *maker, const struct store_node *child)
{
	struct store_node *parent = &maker->nodes[child->parent];
	bool is_first = parent->area == 0;

	for (unsigned axis = 0; axis < 3; axis++) {
		if (is_first || child->box_min[axis] < parent->box_min[axis])
			parent->box_min[axis] = child->box_min[axis];
		if (is_first || child->box_max[axis] > parent->box_max[axis])
			parent->box_max[axis] = child->box_max[axis];
	}
	parent->area += child->area;
	parent->longest_edge = fmaxf(parent->longest_edge, child->longest_edge);
	memcpy(parent->solidity, child->solidity, sizeof(parent->solidity));
}

static void set_sphere(struct store_node *node)
{
	float square = 0;

	for (unsigned axis = 0; axis < 3; axis++) {
		float half = (node->box_max[axis] - node->box_min[axis]) / 2;

		node->sphere[axis] = node->box_min[axis] + half;
		square += half * half;
	}
	node->sphere[3] = sqrtf(square) * 1.000001f;
}

/* A sphere about the box need not hold those about the boxes below: it is made to. */
static void widen_sphere(struct store_node *parent, const struct store_node *child)
{
	float square = 0;

	for (unsigned axis = 0; axis < 3; axis++)
		square += powf(parent->sphere[axis] - child->sphere[axis], 2);
	parent->sphere[3] =
		fmaxf(parent->sphere[3], (sqrtf(square) + child->sphere[3]) * 1.000001f);
}

static void finish_tree(struct maker *maker)
{
	for (uint32_t i = maker->node_count; i-- > 1;)
		add_child_to_parent(maker, &maker->nodes[i]);
	for (uint32_t i = maker->node_count; i-- > 0;) {
		struct store_node *node = &maker->nodes[i];

		set_sphere(node);
		for (uint32_t k = 0; k < node->child_count; k++)
			widen_sphere(node, &maker->nodes[node->first_child + k]);
	}
}

/* ---- a leaf's geometry ---- */

static void add_vertex(struct arrays *arrays, const uint32_t steps[3], unsigned axis, bool positive)
{
	uint32_t at = arrays->vertex_count++;
	float normal[3] = { 0 };

	normal[axis] = positive ? 1.0f : -1.0f;
	for (unsigned i = 0; i < 3; i++) {
		arrays->positions[at][i] = (uint16_t)steps[i];
		arrays->positions32[at].xyz[i] = (float)steps[i] / STEPS_PER_UNIT;
	}
	arrays->positions[at][3] = (uint16_t)arrays->run_count;
	arrays->positions32[at].run = arrays->run_count;
	payload_encode_oct8(normal, arrays->normals[at]);
	arrays->colours[at] = 0xff000000u | steps[0] << 16 | steps[1] << 8 | steps[2];
}

/* One face as quads x quads squares, wound so that it is seen from outside. */
static void add_face(struct maker *maker, struct arrays *arrays, const uint32_t corner[3],
		     unsigned face)
{
	uint32_t quads = maker->grid.face_quads;
	uint32_t first = arrays->vertex_count;
	unsigned axis = face >> 1;
	bool positive = face & 1;
	unsigned u_axis = (axis + (positive ? 1 : 2)) % 3;
	unsigned v_axis = (axis + (positive ? 2 : 1)) % 3;

	for (uint32_t v = 0; v <= quads; v++) {
		for (uint32_t u = 0; u <= quads; u++) {
			uint32_t steps[3] = { corner[0], corner[1], corner[2] };

			steps[axis] += positive ? BOX_STEPS : 0;
			steps[u_axis] += BOX_STEPS * u / quads;
			steps[v_axis] += BOX_STEPS * v / quads;
			add_vertex(arrays, steps, axis, positive);
		}
	}
	for (uint32_t quad = 0; quad < quads * quads; quad++) {
		uint32_t a = first + quad / quads * (quads + 1) + quad % quads;
		uint32_t c = a + quads + 1;
		const uint32_t corners[2][3] = { { a, a + 1, c }, { c, a + 1, c + 1 } };

		for (unsigned i = 0; i < 2; i++) {
			memcpy(arrays->indices + arrays->triangle_count * (size_t)3, corners[i],
			       sizeof(corners[i]));
			arrays->triangle_ids[arrays->triangle_count++] = maker->triangle_next++;
		}
	}
}

static void add_box(struct maker *maker, struct arrays *arrays, const uint32_t box[3],
		    const uint32_t in_leaf[3])
{
	uint32_t number = (box[2] * maker->grid.count + box[1]) * maker->grid.count + box[0];
	uint32_t part = number % maker->grid.part_count;
	uint32_t corner[3];

	arrays->runs[arrays->run_count] = (struct payload_run){
		.part = part,
		.section = part < (maker->grid.part_count + 1) / 2 ? 0 : 1,
		.first_triangle = arrays->triangle_count,
		.colour = 0xff808080u + part,
	};
	for (unsigned axis = 0; axis < 3; axis++)
		corner[axis] = in_leaf[axis] * STEPS_PER_UNIT + (STEPS_PER_UNIT - BOX_STEPS) / 2;
	for (unsigned face = 0; face < BOX_FACES; face++)
		add_face(maker, arrays, corner, face);
	arrays->run_count++;
}

static void write_payload(struct maker *maker, struct store_node *node, const struct arrays *arrays)
{
	const struct test_grid *grid = &maker->grid;
	struct payload_content content = {
		.payload_id = maker->superblock.payload_id_next++,
		.kind = STORE_KIND_TRIANGLES,
		.vertex_count = arrays->vertex_count,
		.triangle_count = arrays->triangle_count,
		.run_count = arrays->run_count,
		.position_format = grid->float_positions ? PAYLOAD_F32X3_RUN : PAYLOAD_U16X3_RUN,
		.normal_format = PAYLOAD_OCT8,
		.scale = grid->float_positions ? 1.0 : ldexp(1, STEP_EXPONENT),
		.runs = arrays->runs,
		.indices = arrays->indices,
		.positions = grid->float_positions ? (const void *)arrays->positions32
						   : (const void *)arrays->positions,
		.normals = grid->normals ? arrays->normals : NULL,
		.colours = grid->colours ? arrays->colours : NULL,
		.triangle_ids = grid->triangle_ids ? arrays->triangle_ids : NULL,
	};
	void *payload;
	void *stored;
	size_t stored_bytes_max;
	size_t stored_bytes;
	struct why why;

	for (unsigned axis = 0; axis < 3; axis++)
		content.origin[axis] = node->cell[axis] * cell_size(maker, node->level);
	if (payload_size(&content, &node->payload_bytes) < 0)
		fail_msg("the payload is too large");
	payload = make(1, node->payload_bytes);
	payload_write(&content, payload);
	stored_bytes_max = codec_bound(grid->codec, node->payload_bytes);
	stored = make(1, stored_bytes_max);
	if (codec_encode(maker->scratch, grid->codec, 3, payload, node->payload_bytes, stored,
			 stored_bytes_max, &stored_bytes) < 0)
		fail_msg("the payload cannot be encoded");
	node->kind = STORE_KIND_TRIANGLES;
	node->triangle_count = arrays->triangle_count;
	node->vertex_count = arrays->vertex_count;
	if (store_writer_payload(maker->writer, content.payload_id, grid->codec, stored,
				 (uint32_t)stored_bytes, node, &why) < 0)
		fail_msg("%s", why.text);
	free(stored);
	free(payload);
}

static void count_leaf(struct store_superblock *superblock, const struct store_node *leaf)
{
	superblock->leaf_count++;
	superblock->triangle_count += leaf->triangle_count;
	superblock->vertex_count += leaf->vertex_count;
	superblock->payload_stored_bytes += leaf->stored_bytes;
	superblock->payload_raw_bytes += leaf->payload_bytes;
	if (leaf->payload_bytes > superblock->payload_bytes_max)
		superblock->payload_bytes_max = leaf->payload_bytes;
}

static void make_leaf(struct maker *maker, struct store_node *node, struct arrays *arrays)
{
	uint32_t first[3];
	uint32_t end[3];

	arrays->run_count = 0;
	arrays->vertex_count = 0;
	arrays->triangle_count = 0;
	for (unsigned axis = 0; axis < 3; axis++) {
		first[axis] = node->cell[axis] * LEAF_BOXES;
		end[axis] = (uint32_t)u64_min(first[axis] + LEAF_BOXES, maker->grid.count);
		node->box_min[axis] = (float)first[axis] + 0.25f;
		node->box_max[axis] = (float)end[axis] - 0.25f;
	}
	for (uint32_t z = first[2]; z < end[2]; z++)
		for (uint32_t y = first[1]; y < end[1]; y++)
			for (uint32_t x = first[0]; x < end[0]; x++)
				add_box(maker, arrays, (const uint32_t[3]){ x, y, z },
					(const uint32_t[3]){ x - first[0], y - first[1],
							     z - first[2] });
	node->area = (float)arrays->run_count * BOX_FACES * 0.25f;
	node->longest_edge = sqrtf(0.5f) / (float)maker->grid.face_quads;
	memset(node->solidity, 100, sizeof(node->solidity));
	write_payload(maker, node, arrays);
}

static void make_leaves(struct maker *maker)
{
	uint32_t quads = maker->grid.face_quads;
	size_t faces = BOX_FACES * LEAF_BOXES * LEAF_BOXES * LEAF_BOXES;
	size_t vertices = faces * (quads + 1) * (quads + 1);
	size_t triangles = faces * quads * quads * 2;
	struct arrays *arrays = make(1, sizeof(*arrays));

	arrays->indices = make(triangles * 3, sizeof(*arrays->indices));
	arrays->positions = make(vertices, sizeof(*arrays->positions));
	arrays->positions32 = make(vertices, sizeof(*arrays->positions32));
	arrays->normals = make(vertices, sizeof(*arrays->normals));
	arrays->colours = make(vertices, sizeof(*arrays->colours));
	arrays->triangle_ids = make(triangles, sizeof(*arrays->triangle_ids));
	for (uint32_t i = 0; i < maker->node_count; i++) {
		struct store_node *node = &maker->nodes[i];

		if (node->child_count > 0)
			continue;
		if (maker->grid.count > 0)
			make_leaf(maker, node, arrays);
		count_leaf(&maker->superblock, node);
	}
	free(arrays->triangle_ids);
	free(arrays->colours);
	free(arrays->normals);
	free(arrays->positions32);
	free(arrays->positions);
	free(arrays->indices);
	free(arrays);
}

/* ---- names and the whole ---- */

static const char names_strings[] =
	"\0grid.ply\0first half\0second half\0part\0plant/floor/box\0steel";

static uint64_t name_of(const char *text)
{
	const char *at = names_strings + 1;

	while (strcmp(at, text) != 0)
		at += strlen(at) + 1;
	return (uint64_t)(at - names_strings);
}

static void commit(struct maker *maker)
{
	uint32_t part_count = maker->grid.part_count;
	uint32_t first_half = (part_count + 1) / 2;
	const struct store_source source = { .path = name_of("grid.ply") };
	struct store_section sections[2] = {
		{ .name = name_of("first half"), .first_part = 0, .part_count = first_half },
		{ .name = name_of("second half"),
		  .first_part = first_half,
		  .part_count = part_count - first_half },
	};
	struct store_part *parts = make(part_count, sizeof(*parts));
	struct store_names_content names = {
		.sections = sections,
		.sources = &source,
		.parts = parts,
		.strings = names_strings,
		.section_count = 2,
		.source_count = 1,
		.part_count = part_count,
		.string_bytes = sizeof(names_strings),
	};
	struct why why;

	for (unsigned i = 0; i < 2; i++)
		for (unsigned k = 0; k < 12; k += 5)
			sections[i].placement[k] = 1;
	for (uint64_t box = 0;
	     box < (uint64_t)maker->grid.count * maker->grid.count * maker->grid.count; box++)
		parts[box % part_count].triangle_count += box_triangles(&maker->grid);
	for (uint32_t i = 0; i < part_count; i++) {
		parts[i].name = name_of("part");
		parts[i].scene_path = name_of("plant/floor/box");
		parts[i].material = name_of("steel");
		parts[i].section = i < first_half ? 0 : 1;
		parts[i].colour = 0xff808080u + i;
	}
	if (store_writer_commit(maker->writer, &maker->superblock, maker->nodes, &names, &why) < 0)
		fail_msg("%s", why.text);
	free(parts);
}

static void describe(struct maker *maker)
{
	struct store_superblock *superblock = &maker->superblock;

	superblock->payload_id_next = 1;
	superblock->triangles_in = test_grid_triangles(&maker->grid);
	superblock->unit_metres = 1;
	superblock->crease_degrees = -1;
	superblock->step_exponent = maker->grid.float_positions ? STORE_STEP_NONE : STEP_EXPONENT;
	superblock->error = maker->grid.float_positions ? 0 : ldexp(1, STEP_EXPONENT);
	superblock->up_axis = STORE_AXIS_Z;
	superblock->layout = STORE_LAYOUT_UNIQUE;
	superblock->leaf_triangles_max = 1u << 20;
	superblock->leaf_vertices_max = 1u << 20;
	memcpy(superblock->producer, "tests", sizeof("tests"));
	for (unsigned axis = 0; axis < 3; axis++) {
		superblock->origin[axis] = 100.0 * (axis + 1);
		if (maker->grid.count == 0)
			continue;
		superblock->box_min[axis] = 0.25;
		superblock->box_max[axis] = maker->grid.count - 0.25;
	}
}

void test_store_grid_make(const char *path, const struct test_grid *grid)
{
	struct maker maker = { .grid = with_defaults(grid) };
	struct why why;

	describe(&maker);
	if (store_writer_create(path, &maker.writer, &why) < 0)
		fail_msg("%s", why.text);
	if (codec_scratch_create(&maker.scratch) < 0)
		fail_msg("no memory");
	grow_tree(&maker);
	maker.superblock.node_count = maker.node_count;
	make_leaves(&maker);
	finish_tree(&maker);
	commit(&maker);
	store_writer_destroy(maker.writer);
	codec_scratch_destroy(maker.scratch);
	free(maker.nodes);
}

void test_store_grid(const char *path, uint32_t count)
{
	test_store_grid_make(path, &(struct test_grid){ .count = count });
}
