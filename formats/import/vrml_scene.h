/* SPDX-License-Identifier: MIT */
/**
 * vrml_scene.h - a VRML97 file as a tree of the nodes that matter for its surfaces.
 *
 * All of a file is held, since USE may come back to any of it; it is refused when that needs more
 * memory than allowed.  A node that is not known here is read for the named nodes within it and
 * otherwise passed over; prototypes are passed over whole.
 *
 * Source: ISO/IEC 14772-1:1997, "The Virtual Reality Modeling Language".
 *
 * Threads: one a scene.
 */
#ifndef FORMATS_IMPORT_VRML_SCENE_H
#define FORMATS_IMPORT_VRML_SCENE_H

#include <stdbool.h>
#include <stdint.h>

#include "formats/import/names.h"
#include "formats/import/source.h"

/** Nodes within nodes. */
#define VRML_DEPTH_MAX 100u

enum vrml_kind {
	VRML_OTHER,
	VRML_GROUP, /* and what has children like one: Anchor, Billboard, Collision */
	VRML_TRANSFORM,
	VRML_SWITCH,
	VRML_LOD,
	VRML_SHAPE,
	VRML_APPEARANCE,
	VRML_MATERIAL,
	VRML_FACES, /* IndexedFaceSet */
	VRML_COORDINATE,
	VRML_COLOUR,
	VRML_NORMAL,
};

struct vrml_floats {
	float *values;
	uint64_t count;
	uint64_t capacity;
};

struct vrml_indices {
	int32_t *values;
	uint64_t count;
	uint64_t capacity;
};

struct vrml_node {
	enum vrml_kind kind;
	const char *name; /* of its DEF, "" without */
	struct vrml_node *next_made;

	/* Of groups: children in order.  Of others: what they are made of, once by kind. */
	struct vrml_node **children;
	uint64_t child_count;
	uint64_t child_capacity;

	union {
		struct {
			double translation[3];
			double rotation[4];
			double scale[3];
			double scale_orientation[4];
			double centre[3];
		} transform;
		int32_t which_choice; /* of a Switch */
		struct {
			double diffuse[3];
			double transparency;
		} material;
		struct {
			struct vrml_indices coord_index;
			struct vrml_indices colour_index;
			struct vrml_indices normal_index;
			bool clockwise;
			bool colour_per_face;
			bool normal_per_face;
		} faces;
		struct vrml_floats floats; /* of Coordinate, Color, Normal: three each */
	};
};

struct vrml_scene {
	struct source *source;
	struct vrml_node *made; /* every node, the latest first */
	struct vrml_node *root; /* a group of all that stands at the top */
	struct names names;
	struct vrml_node **defined; /* by the names' numbers */
	uint32_t defined_capacity;
	uint64_t node_count;
	uint64_t used_bytes;
	uint64_t bytes_max;
	bool transformed; /* a Transform is there that moves something */
};

/**
 * Reads a file from behind its header line.
 *
 * Returns: 0, -EUCLEAN with the line, -ENODATA, -ENOMEM, or as source_more().
 * Ownership: ends with vrml_scene_done(), also after a failure.
 */
int vrml_scene_read(struct source *source, uint64_t bytes_max, struct vrml_scene *ret,
		    struct why *why);
void vrml_scene_done(struct vrml_scene *scene);

/** The first child of that kind, or NULL. */
const struct vrml_node *vrml_node_find(const struct vrml_node *node, enum vrml_kind kind);

#endif /* FORMATS_IMPORT_VRML_SCENE_H */
