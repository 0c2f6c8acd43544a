/* SPDX-License-Identifier: MIT */
/*
 * VRML97: the surfaces of a scene.  A part is what has the same path of names and the same
 * material, however many shapes that are.  The format says that Y is up and a unit is a metre, but
 * the electronic parts that make up most of its use have Z up and tenths of an inch; so neither is
 * said to be known.
 */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/import/colour.h"
#include "formats/import/job.h"
#include "formats/import/placement.h"
#include "formats/import/polygon.h"
#include "formats/import/vrml_scene.h"

/* Nodes that may be visited more than once through USE: a few lines could ask for 2^100. */
#define REPEATS_MAX (UINT64_C(1) << 20)
#define PATH_BYTES  1024u

struct vrml {
	struct import_job *job;
	struct vrml_scene scene;
	struct batcher batcher;
	struct polygon polygon;
	struct names part_names; /* scene path and material: the number is the part's */
	uint64_t visits_left;
	char path[PATH_BYTES];
};

/* The shape at hand. */
struct shape {
	const struct vrml_node *faces;
	const struct vrml_floats *points;
	const struct vrml_floats *colours; /* NULL: none */
	const struct vrml_floats *normals;
	struct placement placement;
	double cofactors[9];
	bool flip; /* corners run the other way round */
	struct batch_kind kind;
};

/* ---- transforms ---- */

static struct placement translation(const double offset[3], double sign)
{
	struct placement placement = placement_identity;

	for (int k = 0; k < 3; k++)
		placement.m[4 * k + 3] = sign * offset[k];
	return placement;
}

/* About an axis of any length; one of no length turns nothing. */
static struct placement rotation(const double axis_angle[4], double sign)
{
	double length = sqrt(axis_angle[0] * axis_angle[0] + axis_angle[1] * axis_angle[1] +
			     axis_angle[2] * axis_angle[2]);
	double c = cos(axis_angle[3]), s = sign * sin(axis_angle[3]);
	struct placement placement = placement_identity;
	double a[3];

	if (!(length > 0.0) || axis_angle[3] == 0.0)
		return placement;
	for (int k = 0; k < 3; k++)
		a[k] = axis_angle[k] / length;
	for (int row = 0; row < 3; row++)
		for (int column = 0; column < 3; column++)
			placement.m[4 * row + column] =
				(1.0 - c) * a[row] * a[column] + (row == column ? c : 0.0);
	placement.m[1] -= s * a[2];
	placement.m[2] += s * a[1];
	placement.m[4] += s * a[2];
	placement.m[6] -= s * a[0];
	placement.m[8] -= s * a[1];
	placement.m[9] += s * a[0];
	return placement;
}

/* T C R SR S -SR -C, as the standard says in 6.52. */
static struct placement transform_placement(const struct vrml_node *node)
{
	struct placement steps[7] = {
		translation(node->transform.translation, 1.0),
		translation(node->transform.centre, 1.0),
		rotation(node->transform.rotation, 1.0),
		rotation(node->transform.scale_orientation, 1.0),
		placement_identity,
		rotation(node->transform.scale_orientation, -1.0),
		translation(node->transform.centre, -1.0),
	};
	struct placement product = placement_identity;

	for (int k = 0; k < 3; k++)
		steps[4].m[5 * k] = node->transform.scale[k];
	for (size_t i = 0; i < ARRAY_LENGTH(steps); i++)
		product = placement_multiply(&product, &steps[i]);
	return product;
}

/* ---- parts ---- */

static uint32_t material_colour(const struct vrml_node *material)
{
	const double *rgb = material->material.diffuse;

	return colour_with_opacity(colour_from_rgb(rgb[0], rgb[1], rgb[2]),
				   1.0 - material->material.transparency);
}

/* The part of a shape that hangs at vrml->path. */
static int find_part(struct vrml *vrml, const struct vrml_node *node, uint32_t *ret,
		     struct why *why)
{
	const struct vrml_node *appearance = vrml_node_find(node, VRML_APPEARANCE);
	const struct vrml_node *material =
		appearance ? vrml_node_find(appearance, VRML_MATERIAL) : NULL;
	const char *slash = strrchr(vrml->path, '/');
	struct import_part part = {
		.name = slash ? slash + 1 : vrml->path,
		.scene_path = vrml->path,
		.material = material ? material->name : "",
		.colour = material ? material_colour(material) : IMPORT_COLOUR_DEFAULT,
	};
	char key[PATH_BYTES + 300];
	int r;

	(void)snprintf(key, sizeof(key), "%s\n%s\n%08x", vrml->path, part.material, part.colour);
	*ret = names_find(&vrml->part_names, key);
	if (*ret != UINT32_MAX)
		return 0;
	r = names_add(&vrml->part_names, key, ret, why);
	return r < 0 ? r : batcher_part(&vrml->batcher, &part, ret, why);
}

/* ---- faces ---- */

static void put_position(struct vrml *vrml, const struct shape *shape, uint32_t point, size_t to)
{
	const float *p = shape->points->values + 3 * (size_t)point;

	if (!vrml->batcher.positions_double) {
		memcpy(vrml->batcher.positions32 + 3 * to, p, 3 * sizeof(float));
		return;
	}
	placement_move(&shape->placement,
		       (const double[3]){ (double)p[0], (double)p[1], (double)p[2] },
		       vrml->batcher.positions64 + 3 * to);
}

static void put_normal(struct vrml *vrml, const struct shape *shape, uint32_t normal, size_t to)
{
	const float *n = shape->normals->values + 3 * (size_t)normal;

	placement_turn(shape->cofactors,
		       (const double[3]){ (double)n[0], (double)n[1], (double)n[2] },
		       vrml->batcher.normals + 3 * to);
}

/*
 * Where an attribute of a corner stands in its array.  position: of the corner in coordIndex; face:
 * the face's number.
 */
static int attribute_index(const struct shape *shape, const struct vrml_indices *indices,
			   const struct vrml_floats *values, bool per_face, uint64_t position,
			   uint64_t face, uint32_t *ret)
{
	const struct vrml_indices *used =
		indices->count > 0 || per_face ? indices : &shape->faces->faces.coord_index;
	uint64_t at = per_face ? face : position;
	int64_t index = (int64_t)at;

	if (used->count > 0) {
		if (at >= used->count)
			return -EUCLEAN;
		index = used->values[at];
	}
	if (index < 0 || (uint64_t)index >= values->count / 3)
		return -EUCLEAN;
	*ret = (uint32_t)index;
	return 0;
}

static uint32_t colour_at(const struct vrml_floats *colours, uint32_t index)
{
	const float *rgb = colours->values + 3 * (size_t)index;

	return colour_from_rgb((double)rgb[0], (double)rgb[1], (double)rgb[2]);
}

/* One corner: `position` is its place in coordIndex. */
static int put_corner(struct vrml *vrml, const struct shape *shape, uint64_t position,
		      uint64_t face, size_t to)
{
	const struct vrml_node *faces = shape->faces;
	uint32_t index;
	int r;

	put_position(vrml, shape, (uint32_t)faces->faces.coord_index.values[position], to);
	if (shape->normals) {
		r = attribute_index(shape, &faces->faces.normal_index, shape->normals,
				    faces->faces.normal_per_face, position, face, &index);
		if (r < 0)
			return r;
		put_normal(vrml, shape, index, to);
	}
	if (shape->colours) {
		r = attribute_index(shape, &faces->faces.colour_index, shape->colours,
				    faces->faces.colour_per_face, position, face, &index);
		if (r < 0)
			return r;
		vrml->batcher.colours[to] = colour_at(shape->colours, index);
	}
	return 0;
}

/* The face whose corners stand at [first, first + corner_count) of coordIndex. */
static int put_face(struct vrml *vrml, const struct shape *shape, uint64_t first,
		    uint32_t corner_count, uint64_t face, struct why *why)
{
	static const uint32_t whole[3] = { 0, 1, 2 };
	const int32_t *indices = shape->faces->faces.coord_index.values + first;
	const uint32_t *cut = whole;

	for (uint32_t i = 0; i < corner_count; i++)
		if ((uint64_t)indices[i] >= shape->points->count / 3)
			return why_set(why, -EUCLEAN, "a face points at vertex %d of %llu",
				       indices[i], (unsigned long long)shape->points->count / 3);
	if (corner_count > 3) {
		if (corner_count > POLYGON_CORNERS_MAX)
			return why_set(why, -EUCLEAN, "a face of %u corners; at most %u are read",
				       corner_count, POLYGON_CORNERS_MAX);
		if (polygon_reserve(&vrml->polygon, corner_count) < 0)
			return why_set(why, -ENOMEM, "no memory for a face of %u corners",
				       corner_count);
		for (uint32_t i = 0; i < corner_count; i++)
			for (size_t k = 0; k < 3; k++)
				vrml->polygon.positions[3 * (size_t)i + k] =
					(double)shape->points->values[3 * (size_t)indices[i] + k];
		cut = polygon_cut(&vrml->polygon, corner_count);
	}
	for (uint32_t i = 0; i < corner_count - 2; i++, cut += 3) {
		uint32_t index;
		int r = batcher_next(&vrml->batcher, &shape->kind, &index, why);

		if (r < 0)
			return r;
		for (uint32_t k = 0; k < 3; k++) {
			uint32_t corner = cut[shape->flip ? 2 - k : k];

			if (put_corner(vrml, shape, first + corner, face, 3 * (size_t)index + k) <
			    0)
				return why_set(
					why, -EUCLEAN,
					"a face points at a colour or normal that is not there");
		}
	}
	return 0;
}

static int put_faces(struct vrml *vrml, const struct shape *shape, struct why *why)
{
	const struct vrml_indices *indices = &shape->faces->faces.coord_index;
	struct import_info *info = vrml->job->info;
	uint64_t first = 0, face = 0;

	/* The last face need not have its -1. */
	for (uint64_t i = 0; i <= indices->count; i++) {
		uint64_t corner_count = i - first;
		int r = 0;

		if (i < indices->count ? indices->values[i] != -1 : corner_count == 0)
			continue;
		info->face_count++;
		if (corner_count < 3)
			info->dropped_faces++;
		else
			r = put_face(vrml, shape, first, (uint32_t)corner_count, face, why);
		if (r < 0)
			return r;
		first = i + 1;
		face++;
	}
	return 0;
}

static int put_shape(struct vrml *vrml, const struct vrml_node *node,
		     const struct placement *placement, struct why *why)
{
	const struct vrml_node *faces = vrml_node_find(node, VRML_FACES);
	const struct vrml_node *points = faces ? vrml_node_find(faces, VRML_COORDINATE) : NULL;
	const struct vrml_node *colours = faces ? vrml_node_find(faces, VRML_COLOUR) : NULL;
	const struct vrml_node *normals = faces ? vrml_node_find(faces, VRML_NORMAL) : NULL;
	struct shape shape = { .faces = faces, .placement = *placement };
	int r;

	if (!points || points->floats.count == 0)
		return 0;
	shape.points = &points->floats;
	if (colours && colours->floats.count > 0 && batcher_wants_colours(&vrml->batcher))
		shape.colours = &colours->floats;
	if (normals && normals->floats.count > 0)
		shape.normals = &normals->floats;
	shape.flip =
		(placement_cofactors(placement, shape.cofactors) < 0.0) != faces->faces.clockwise;
	shape.kind.colours = shape.colours != NULL;
	shape.kind.normals = shape.normals != NULL;
	r = find_part(vrml, node, &shape.kind.part, why);
	return r < 0 ? r : put_faces(vrml, &shape, why);
}

/* ---- the tree ---- */

/* Adds a name to the path; where it does not fit, the path stays what it is. */
static size_t push_name(struct vrml *vrml, const char *name)
{
	size_t length = strlen(vrml->path), name_length = strlen(name);

	if (name_length > 0 && length + name_length + 2 <= PATH_BYTES)
		(void)snprintf(vrml->path + length, PATH_BYTES - length, "%s%s",
			       length > 0 ? "/" : "", name);
	return length;
}

static int put_node(struct vrml *vrml, const struct vrml_node *node,
		    const struct placement *placement, struct why *why);

static int put_children(struct vrml *vrml, const struct vrml_node *node, uint64_t first,
			uint64_t end, const struct placement *placement, struct why *why)
{
	int r = 0;

	for (uint64_t i = first; i < end && i < node->child_count && r == 0; i++)
		r = put_node(vrml, node->children[i], placement, why);
	return r;
}

/* As deep as the file is nested, since what is used stands whole before its use. */
static int put_node(struct vrml *vrml, const struct vrml_node *node,
		    const struct placement *placement, struct why *why)
{
	size_t path_length = push_name(vrml, node->name);
	struct placement moved;
	int r = 0;

	if (vrml->visits_left-- == 0)
		return why_set(why, -EUCLEAN, "its USE statements repeat more than %llu nodes",
			       (unsigned long long)REPEATS_MAX);
	switch (node->kind) {
	case VRML_GROUP:
		r = put_children(vrml, node, 0, UINT64_MAX, placement, why);
		break;
	case VRML_TRANSFORM:
		moved = transform_placement(node);
		moved = placement_multiply(placement, &moved);
		r = put_children(vrml, node, 0, UINT64_MAX, &moved, why);
		break;
	case VRML_SWITCH:
		if (node->which_choice >= 0)
			r = put_children(vrml, node, (uint64_t)node->which_choice,
					 (uint64_t)node->which_choice + 1, placement, why);
		break;
	case VRML_LOD:
		/* The first level is the finest. */
		r = put_children(vrml, node, 0, 1, placement, why);
		break;
	case VRML_SHAPE:
		r = put_shape(vrml, node, placement, why);
		break;
	case VRML_OTHER:
	case VRML_APPEARANCE:
	case VRML_MATERIAL:
	case VRML_FACES:
	case VRML_COORDINATE:
	case VRML_COLOUR:
	case VRML_NORMAL:
		break;
	}
	vrml->path[path_length] = '\0';
	return r;
}

int vrml_import(struct import_job *job, struct why *why)
{
	struct vrml vrml = { .job = job };
	const char *header;
	size_t length;
	int r = source_line(job->source, &header, &length, why);

	if (r < 0)
		return r;
	if (length < 10 || strncmp(header, "#VRML V2.0", 10) != 0)
		return why_set(why, -EUCLEAN,
			       "it is no VRML97 file: it does not begin with \"#VRML V2.0\"");
	names_init(&vrml.part_names, job->memory_bytes / 8);
	r = vrml_scene_read(job->source, job->memory_bytes, &vrml.scene, why);
	if (r == 0)
		r = batcher_init(&vrml.batcher, vrml.scene.transformed, job->options, job->sink,
				 job->info, why);
	vrml.visits_left = vrml.scene.node_count + REPEATS_MAX;
	if (r == 0)
		r = put_node(&vrml, vrml.scene.root, &placement_identity, why);
	if (r == 0)
		r = batcher_flush(&vrml.batcher, why);
	batcher_done(&vrml.batcher);
	polygon_done(&vrml.polygon);
	names_done(&vrml.part_names);
	vrml_scene_done(&vrml.scene);
	return r;
}
