/* SPDX-License-Identifier: MIT */
#include "formats/store/store_judge.h"

#include <errno.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/store/payload_layout.h"

/** Exponents of steps beyond it are no sizes of things. */
#define STEP_EXPONENT_MAX 256
/** Three 16-bit indices; one position of 16 bits with its run. */
#define TRIANGLE_BYTES_MIN 6u
#define VERTEX_BYTES_MIN   8u
/** Spheres are sums of rounded floats: by so much of their size they may miss a sphere below. */
#define SPHERE_SLACK 1e-5

/* ---- superblock ---- */

static bool all_finite(const double *values, unsigned count)
{
	for (unsigned i = 0; i < count; i++)
		if (!isfinite(values[i]))
			return false;
	return true;
}

static bool is_power_of_two(double value)
{
	int exponent;

	return isfinite(value) && value > 0 && frexp(value, &exponent) == 0.5;
}

static int judge_extent(const struct store_superblock *superblock, const char *name,
			const struct store_extent *extent, struct why *why)
{
	uint64_t end;

	if (!bytes_is_aligned(extent->file_offset, STORE_BLOCK_BYTES) ||
	    extent->file_offset < STORE_FIRST_EXTENT_OFFSET || extent->stored_bytes == 0 ||
	    __builtin_add_overflow(extent->file_offset, extent->stored_bytes, &end) ||
	    end > superblock->file_bytes)
		return why_set(why, -EUCLEAN, "%s: %llu bytes at %llu cannot be in %llu bytes",
			       name, (unsigned long long)extent->stored_bytes,
			       (unsigned long long)extent->file_offset,
			       (unsigned long long)superblock->file_bytes);
	return 0;
}

static int judge_extents(const struct store_superblock *superblock, struct why *why)
{
	const struct store_extent *hs = &superblock->hs;
	const struct store_extent *names = &superblock->names;
	int r;

	r = judge_extent(superblock, "HS", hs, why);
	if (r == 0)
		r = judge_extent(superblock, "names", names, why);
	if (r < 0)
		return r;
	if (hs->raw_bytes != store_hs_bytes(superblock->node_count) ||
	    hs->stored_bytes != hs->raw_bytes)
		return why_set(why, -EUCLEAN, "HS: %llu bytes are not those of %llu nodes",
			       (unsigned long long)hs->stored_bytes,
			       (unsigned long long)superblock->node_count);
	if (names->raw_bytes < sizeof(struct store_names_header) ||
	    names->raw_bytes > STORE_NAMES_BYTES_MAX)
		return why_set(why, -EUCLEAN, "names: %llu bytes cannot be",
			       (unsigned long long)names->raw_bytes);
	/* Each count is bounded before the products can overflow. */
	if (superblock->part_count > names->raw_bytes / sizeof(struct store_part) ||
	    superblock->section_count > names->raw_bytes / sizeof(struct store_section))
		return why_set(why, -EUCLEAN, "names: too short for %llu parts and %llu sections",
			       (unsigned long long)superblock->part_count,
			       (unsigned long long)superblock->section_count);
	if (hs->file_offset < names->file_offset + names->stored_bytes &&
	    names->file_offset < hs->file_offset + hs->stored_bytes)
		return why_set(why, -EUCLEAN, "HS and names overlap");
	return 0;
}

static int judge_counts(const struct store_superblock *superblock, struct why *why)
{
	uint64_t nodes = superblock->node_count;

	if (nodes == 0 || nodes > STORE_NODE_COUNT_MAX)
		return why_set(why, -EUCLEAN, "superblock: %llu nodes", (unsigned long long)nodes);
	if (superblock->leaf_count == 0 || superblock->leaf_count > nodes ||
	    superblock->triangle_count > nodes * UINT32_MAX ||
	    superblock->vertex_count > nodes * UINT32_MAX ||
	    superblock->payload_stored_bytes > superblock->file_bytes ||
	    superblock->payload_bytes_max > STORE_PAYLOAD_BYTES_MAX ||
	    superblock->payload_raw_bytes > nodes * superblock->payload_bytes_max ||
	    superblock->level_max > STORE_LEVEL_MAX || superblock->payload_id_next == 0)
		return why_set(why, -EUCLEAN, "superblock: counts that cannot be");
	return 0;
}

static int judge_numbers(const struct store_superblock *superblock, struct why *why)
{
	if (!all_finite(superblock->origin, 3) || !all_finite(superblock->root_min, 3) ||
	    !all_finite(superblock->box_min, 3) || !all_finite(superblock->box_max, 3) ||
	    !isfinite(superblock->crease_degrees))
		return why_set(why, -EUCLEAN, "superblock: a number is not finite");
	if (!isfinite(superblock->unit_metres) || superblock->unit_metres < 0 ||
	    !isfinite(superblock->error) || superblock->error < 0 ||
	    !isfinite(superblock->error_measured) || superblock->error_measured < 0)
		return why_set(why, -EUCLEAN, "superblock: unit or error is no size");
	if (!is_power_of_two(superblock->root_size))
		return why_set(why, -EUCLEAN, "superblock: root's size is no power of two");
	for (unsigned axis = 0; axis < 3; axis++)
		if (superblock->box_min[axis] > superblock->box_max[axis])
			return why_set(why, -EUCLEAN, "superblock: box is inside out");
	if (superblock->step_exponent != STORE_STEP_NONE &&
	    (superblock->step_exponent < -STEP_EXPONENT_MAX ||
	     superblock->step_exponent > STEP_EXPONENT_MAX))
		return why_set(why, -EUCLEAN, "superblock: step is 2^%d",
			       superblock->step_exponent);
	if (superblock->up_axis >= STORE_AXIS_COUNT_ || superblock->layout >= STORE_LAYOUT_COUNT_)
		return why_set(why, -EUCLEAN, "superblock: up axis %u, layout %u",
			       superblock->up_axis, superblock->layout);
	return 0;
}

int store_judge_superblock(const struct store_superblock *superblock, struct why *why)
{
	int r;

	if (superblock->superblock_bytes != STORE_BLOCK_BYTES || superblock->generation == 0)
		return why_set(why, -EUCLEAN, "superblock: %u bytes, generation %llu",
			       superblock->superblock_bytes,
			       (unsigned long long)superblock->generation);
	if (superblock->file_bytes > INT64_MAX ||
	    !bytes_is_aligned(superblock->file_bytes, STORE_BLOCK_BYTES))
		return why_set(why, -EUCLEAN, "superblock: a file of %llu bytes cannot be",
			       (unsigned long long)superblock->file_bytes);
	if (superblock->reserved0 != 0 ||
	    !bytes_are_zero(superblock->reserved, sizeof(superblock->reserved)))
		return why_set(why, -EUCLEAN, "superblock: reserved bytes are not zero");
	if (superblock->producer[sizeof(superblock->producer) - 1] != '\0')
		return why_set(why, -EUCLEAN, "superblock: producer is not terminated");
	r = judge_counts(superblock, why);
	if (r == 0)
		r = judge_extents(superblock, why);
	if (r == 0)
		r = judge_numbers(superblock, why);
	return r;
}

/* ---- records by themselves ---- */

static int refuse(struct why *why, uint32_t node_index, const char *what)
{
	return why_set(why, -EUCLEAN, "node %u: %s", node_index, what);
}

static bool has_payload(const struct store_node *node)
{
	return node->kind != STORE_KIND_NONE;
}

static bool is_size(float value)
{
	return isfinite(value) && value >= 0;
}

static const char *fault_in_payload(const struct store_superblock *superblock,
				    const struct store_node *node)
{
	uint64_t end;

	if (!has_payload(node)) {
		if (node->payload_id != 0 || node->file_offset != 0 ||
		    node->payload_checksum != 0 || node->stored_bytes != 0 ||
		    node->payload_bytes != 0 || node->codec != 0 || node->triangle_count != 0 ||
		    node->vertex_count != 0)
			return "has an extent but nothing to draw";
		return NULL;
	}
	if (node->payload_id == 0 || node->payload_id >= superblock->payload_id_next)
		return "payload id that was never given";
	if (node->codec >= STORE_CODEC_COUNT_)
		return "unknown codec";
	if (node->triangle_count == 0 || node->vertex_count == 0)
		return "payload without triangles";
	/* Counts that the payload has no room for would make readers allocate what nothing fills. */
	if (node->payload_bytes < sizeof(struct payload_header) +
					  (uint64_t)node->triangle_count * TRIANGLE_BYTES_MIN +
					  (uint64_t)node->vertex_count * VERTEX_BYTES_MIN ||
	    node->payload_bytes > superblock->payload_bytes_max)
		return "payload's length cannot be";
	if (node->codec == STORE_CODEC_NONE && node->stored_bytes != node->payload_bytes)
		return "stored length is not the payload's";
	if (!bytes_is_aligned(node->file_offset, STORE_BLOCK_BYTES) ||
	    node->file_offset < STORE_FIRST_EXTENT_OFFSET || node->stored_bytes == 0 ||
	    __builtin_add_overflow(node->file_offset, (uint64_t)node->stored_bytes, &end) ||
	    end > superblock->file_bytes)
		return "extent is not inside the file";
	return NULL;
}

static const char *fault_in_numbers(const struct store_node *node)
{
	for (unsigned axis = 0; axis < 3; axis++) {
		if (!isfinite(node->box_min[axis]) || !isfinite(node->box_max[axis]) ||
		    !isfinite(node->sphere[axis]))
			return "box or sphere is not finite";
		if (node->box_min[axis] > node->box_max[axis])
			return "box is inside out";
	}
	if (!is_size(node->sphere[3]) || !is_size(node->error) || !is_size(node->longest_edge) ||
	    !is_size(node->area))
		return "radius, error, edge or area is no size";
	/* Infinite is allowed, and the root's always is. */
	if (!(node->parent_error >= node->error))
		return "parent's error is below its own";
	return NULL;
}

int store_judge_record(const struct store_superblock *superblock, const struct store_node *nodes,
		       uint32_t node_index, struct why *why)
{
	const struct store_node *node = &nodes[node_index];
	const char *fault;

	if (node->kind != STORE_KIND_NONE && node->kind != STORE_KIND_TRIANGLES)
		return refuse(why, node_index, "unknown kind");
	if (node->level > superblock->level_max)
		return refuse(why, node_index, "deeper than the superblock says");
	for (unsigned axis = 0; axis < 3; axis++)
		if (node->cell[axis] >> node->level != 0)
			return refuse(why, node_index, "cell is not inside the root's");
	if (node->child_count > 8 ||
	    (node->child_count == 0) != (node->first_child == STORE_NODE_NONE))
		return refuse(why, node_index, "children that cannot be");
	/* Cells without triangles have no record; only an empty model's root has nothing below it. */
	if (node->child_count == 0 && !has_payload(node) && superblock->node_count != 1)
		return refuse(why, node_index, "neither children nor a payload");
	fault = fault_in_payload(superblock, node);
	if (!fault)
		fault = fault_in_numbers(node);
	return fault ? refuse(why, node_index, fault) : 0;
}

/* ---- records together ---- */

/* Which of a cell's eight octants holds a deeper cell; -1: it is not below the cell. */
static int octant_of(const struct store_node *cell, const struct store_node *below)
{
	unsigned levels = (unsigned)below->level - cell->level;
	unsigned octant = 0;

	if (below->level <= cell->level)
		return -1;
	for (unsigned axis = 0; axis < 3; axis++) {
		if (below->cell[axis] >> levels != cell->cell[axis])
			return -1;
		octant |= (below->cell[axis] >> (levels - 1) & 1) << axis;
	}
	return (int)octant;
}

static const char *fault_in_child(const struct store_node *parent, const struct store_node *child)
{
	double distance_squared = 0;
	double slack = parent->sphere[3];

	for (unsigned axis = 0; axis < 3; axis++) {
		double difference = (double)parent->sphere[axis] - child->sphere[axis];

		if (child->box_min[axis] < parent->box_min[axis] ||
		    child->box_max[axis] > parent->box_max[axis])
			return "box is not inside its parent's";
		distance_squared += difference * difference;
		slack += fabs((double)parent->sphere[axis]);
	}
	if (sqrt(distance_squared) + child->sphere[3] > parent->sphere[3] + slack * SPHERE_SLACK)
		return "sphere is not inside its parent's";
	return NULL;
}

/*
 * Children follow each other in the order of their parents, without a gap: so the links can only be
 * a tree, and each record but the root is somebody's child.
 */
static int judge_links(const struct store_superblock *superblock, const struct store_node *nodes,
		       struct why *why)
{
	uint64_t next = 1;

	if (nodes[0].parent != STORE_NODE_NONE || nodes[0].level != 0)
		return refuse(why, 0, "is not a root");
	if (!isinf(nodes[0].parent_error))
		return refuse(why, 0, "something is drawn in the root's stead");
	for (uint32_t i = 0; i < superblock->node_count; i++) {
		const struct store_node *node = &nodes[i];
		int octant_before = -1;

		if (node->child_count == 0)
			continue;
		if (node->first_child != next || node->first_child <= i ||
		    node->child_count > superblock->node_count - next)
			return refuse(why, i, "children are not where they must be");
		next += node->child_count;
		for (uint32_t k = 0; k < node->child_count; k++) {
			uint32_t child_index = node->first_child + k;
			const struct store_node *child = &nodes[child_index];
			int octant = octant_of(node, child);
			const char *fault;

			if (child->parent != i)
				return refuse(why, child_index, "parent does not know it");
			if (octant <= octant_before)
				return refuse(why, child_index,
					      "cell is outside its parent's, or out of order");
			octant_before = octant;
			fault = fault_in_child(node, child);
			if (fault)
				return refuse(why, child_index, fault);
		}
	}
	if (next != superblock->node_count)
		return why_set(why, -EUCLEAN, "HS: %llu of %llu nodes hang on the root",
			       (unsigned long long)next,
			       (unsigned long long)superblock->node_count);
	return 0;
}

static int judge_sums(const struct store_superblock *superblock, const struct store_node *nodes,
		      struct why *why)
{
	struct store_superblock sums = { 0 };

	for (uint64_t i = 0; i < superblock->node_count; i++) {
		const struct store_node *node = &nodes[i];

		if (node->child_count == 0) {
			sums.leaf_count++;
			sums.triangle_count += node->triangle_count;
			sums.vertex_count += node->vertex_count;
		}
		sums.payload_stored_bytes += node->stored_bytes;
		sums.payload_raw_bytes += node->payload_bytes;
		if (node->payload_bytes > sums.payload_bytes_max)
			sums.payload_bytes_max = node->payload_bytes;
		if (node->level > sums.level_max)
			sums.level_max = node->level;
	}
	if (sums.leaf_count != superblock->leaf_count ||
	    sums.triangle_count != superblock->triangle_count ||
	    sums.vertex_count != superblock->vertex_count)
		return why_set(
			why, -EUCLEAN,
			"HS: %llu leaves, %llu triangles, %llu vertices; the superblock says %llu, %llu, %llu",
			(unsigned long long)sums.leaf_count,
			(unsigned long long)sums.triangle_count,
			(unsigned long long)sums.vertex_count,
			(unsigned long long)superblock->leaf_count,
			(unsigned long long)superblock->triangle_count,
			(unsigned long long)superblock->vertex_count);
	if (sums.payload_stored_bytes != superblock->payload_stored_bytes ||
	    sums.payload_raw_bytes != superblock->payload_raw_bytes ||
	    sums.payload_bytes_max != superblock->payload_bytes_max ||
	    sums.level_max != superblock->level_max)
		return why_set(why, -EUCLEAN,
			       "HS: payloads or levels do not add up to the superblock's");
	return 0;
}

/** What two payloads may not share. */
struct claim {
	uint64_t begin; /* an extent's offset, or an id */
	uint64_t end;
	uint32_t node_index;
};

static int compare_claims(const void *a, const void *b)
{
	const struct claim *left = a;
	const struct claim *right = b;

	return (left->begin > right->begin) - (left->begin < right->begin);
}

static struct claim claim_extent(const struct store_node *nodes, uint32_t node_index)
{
	const struct store_node *node = &nodes[node_index];

	return (struct claim){
		.begin = node->file_offset,
		.end = node->file_offset + node->stored_bytes,
		.node_index = node_index,
	};
}

static struct claim claim_id(const struct store_node *nodes, uint32_t node_index)
{
	return (struct claim){
		.begin = nodes[node_index].payload_id,
		.end = nodes[node_index].payload_id + 1,
		.node_index = node_index,
	};
}

/* Stores as they are built need no memory here: their claims ascend already. */
static bool claims_ascend(const struct store_superblock *superblock, const struct store_node *nodes,
			  struct claim (*claim_of)(const struct store_node *, uint32_t))
{
	uint64_t end = 0;

	for (uint32_t i = 0; i < superblock->node_count; i++) {
		struct claim claim;

		if (!has_payload(&nodes[i]))
			continue;
		claim = claim_of(nodes, i);
		if (claim.begin < end)
			return false;
		end = claim.end;
	}
	return true;
}

static int judge_claims(const struct store_superblock *superblock, const struct store_node *nodes,
			struct claim (*claim_of)(const struct store_node *, uint32_t),
			const char *what, struct why *why)
{
	struct claim *claims;
	size_t count = 0;
	int r = 0;

	if (claims_ascend(superblock, nodes, claim_of))
		return 0;
	/* The records are in memory already: this is a fifth of them. */
	claims = malloc(superblock->node_count * sizeof(*claims));
	if (!claims)
		return why_set(why, -ENOMEM, "no memory to judge the extents");
	for (uint32_t i = 0; i < superblock->node_count; i++)
		if (has_payload(&nodes[i]))
			claims[count++] = claim_of(nodes, i);
	qsort(claims, count, sizeof(*claims), compare_claims);
	for (size_t i = 1; i < count && r == 0; i++)
		if (claims[i].begin < claims[i - 1].end)
			r = why_set(why, -EUCLEAN, "nodes %u and %u share %s",
				    claims[i - 1].node_index, claims[i].node_index, what);
	free(claims);
	return r;
}

/* No payload lies over HS or names of its own generation. */
static int judge_apart(const struct store_superblock *superblock, const struct store_node *nodes,
		       struct why *why)
{
	const struct store_extent *const others[] = { &superblock->hs, &superblock->names };

	for (uint32_t i = 0; i < superblock->node_count; i++) {
		struct claim claim = claim_extent(nodes, i);

		for (size_t k = 0; k < ARRAY_LENGTH(others) && has_payload(&nodes[i]); k++)
			if (claim.begin < others[k]->file_offset + others[k]->stored_bytes &&
			    others[k]->file_offset < claim.end)
				return refuse(why, i, "extent lies over HS or names");
	}
	return 0;
}

int store_judge_hs(const struct store_superblock *superblock, const struct store_node *nodes,
		   struct why *why)
{
	int r = 0;

	for (uint32_t i = 0; i < superblock->node_count && r == 0; i++)
		r = store_judge_record(superblock, nodes, i, why);
	if (r == 0)
		r = judge_links(superblock, nodes, why);
	if (r == 0)
		r = judge_sums(superblock, nodes, why);
	if (r == 0)
		r = judge_claims(superblock, nodes, claim_extent, "bytes of the file", why);
	if (r == 0)
		r = judge_claims(superblock, nodes, claim_id, "a payload id", why);
	if (r == 0)
		r = judge_apart(superblock, nodes, why);
	return r;
}

/* ---- names ---- */

/** The tables of a names block, found behind its header. */
struct names_tables {
	const struct store_section *sections;
	const struct store_source *sources;
	const struct store_part *parts;
	const char *strings;
};

static int judge_names_header(const struct store_superblock *superblock,
			      const struct store_names_header *header, uint64_t names_bytes,
			      struct why *why)
{
	uint64_t room = names_bytes - sizeof(*header);

	if (header->section_count != superblock->section_count ||
	    header->part_count != superblock->part_count)
		return why_set(why, -EUCLEAN,
			       "names: %llu sections and %llu parts, not as the superblock says",
			       (unsigned long long)header->section_count,
			       (unsigned long long)header->part_count);
	if (header->section_count > room / sizeof(struct store_section) ||
	    header->source_count > room / sizeof(struct store_source) ||
	    header->part_count > room / sizeof(struct store_part) || header->string_bytes > room ||
	    header->section_count * sizeof(struct store_section) +
			    header->source_count * sizeof(struct store_source) +
			    header->part_count * sizeof(struct store_part) + header->string_bytes !=
		    room)
		return why_set(why, -EUCLEAN, "names: tables do not fill %llu bytes",
			       (unsigned long long)names_bytes);
	/* Counts go into 32-bit fields of runs and parts. */
	if (header->part_count > UINT32_MAX || header->section_count > UINT32_MAX)
		return why_set(why, -EUCLEAN, "names: too many parts or sections");
	return 0;
}

static int judge_section(const struct store_names_header *header, const struct names_tables *tables,
			 uint64_t section_index, struct why *why)
{
	const struct store_section *section = &tables->sections[section_index];

	if (section->name >= header->string_bytes || section->source >= header->source_count ||
	    section->first_part > header->part_count ||
	    section->part_count > header->part_count - section->first_part)
		return why_set(why, -EUCLEAN, "names: section %llu points outside",
			       (unsigned long long)section_index);
	if (!all_finite(section->placement, 12))
		return why_set(why, -EUCLEAN, "names: section %llu stands nowhere",
			       (unsigned long long)section_index);
	for (uint64_t i = 0; i < section->part_count; i++)
		if (tables->parts[section->first_part + i].section != section_index)
			return why_set(why, -EUCLEAN, "names: part %llu is of two sections",
				       (unsigned long long)(section->first_part + i));
	return 0;
}

int store_judge_names(const struct store_superblock *superblock, const void *names,
		      uint64_t names_bytes, struct why *why)
{
	const struct store_names_header *header = names;
	struct names_tables tables;
	int r;

	if (names_bytes < sizeof(*header))
		return why_set(why, -EUCLEAN, "names: %llu bytes are too few",
			       (unsigned long long)names_bytes);
	r = judge_names_header(superblock, header, names_bytes, why);
	if (r < 0)
		return r;
	tables.sections = (const void *)(header + 1);
	tables.sources = (const void *)(tables.sections + header->section_count);
	tables.parts = (const void *)(tables.sources + header->source_count);
	tables.strings = (const void *)(tables.parts + header->part_count);
	if (header->string_bytes == 0 || tables.strings[0] != '\0' ||
	    tables.strings[header->string_bytes - 1] != '\0')
		return why_set(why, -EUCLEAN, "names: strings are not terminated");
	for (uint64_t i = 0; i < header->source_count; i++)
		if (tables.sources[i].path >= header->string_bytes)
			return why_set(why, -EUCLEAN, "names: source %llu points outside",
				       (unsigned long long)i);
	for (uint64_t i = 0; i < header->part_count; i++) {
		const struct store_part *part = &tables.parts[i];

		if (part->name >= header->string_bytes ||
		    part->scene_path >= header->string_bytes ||
		    part->material >= header->string_bytes ||
		    part->section >= header->section_count)
			return why_set(why, -EUCLEAN, "names: part %llu points outside",
				       (unsigned long long)i);
	}
	for (uint64_t i = 0; i < header->section_count && r == 0; i++)
		r = judge_section(header, &tables, i, why);
	return r;
}
