/* SPDX-License-Identifier: MIT */
/**
 * faces.h - faces that point at vertices, made into triangles that have their corners with them.
 *
 * Vertices are records of one layout; normals may have a table of their own (OBJ) or be in the
 * vertex record (PLY).  Texture coordinates have their own table; a face that has them, of a part
 * with an image, gets its corners' colours from there.  While they fit in memory, a face is handed on when it is added.  When they
 * no longer fit, they are deferred: vertices and the faces' corners go to disk, and the faces
 * that were not handed on yet follow at the end, the same and in the same order, through join.h.
 *
 * Threads: one a struct faces.
 */
#ifndef FORMATS_IMPORT_FACES_H
#define FORMATS_IMPORT_FACES_H

#include <string.h>

#include "formats/import/job.h"
#include "formats/import/join.h"
#include "formats/import/polygon.h"
#include "formats/import/texture.h"

#define FACES_NONE UINT64_MAX

/** A record is a position, then the normal (3 floats), then the colour (0: it has none). */
struct faces_layout {
	bool positions_double;
	bool normals;      /* in the vertex record */
	bool colours;      /* in the vertex record */
	bool normal_table; /* normals apart */
	bool texture_table;
};

/** Records of one size that faces point at by number. */
struct faces_table {
	const char *what;  /* "vertex" */
	uint8_t *records;  /* NULL when deferred */
	struct join *join; /* NULL when not */
	uint64_t count;
	uint64_t capacity; /* of records */
	uint32_t record_bytes;
};

/** What a part's triangles look like. */
struct faces_part {
	uint32_t colour;
	struct texture_map map;
};

struct faces {
	struct import_job *job;
	struct textures *textures; /* the user's; NULL: no part has an image */
	struct batcher batcher;
	struct faces_layout layout;
	struct faces_table vertices;
	struct faces_table normals;
	struct faces_table coordinates; /* of textures: 2 floats */
	uint32_t normal_offset;         /* in a vertex record */
	uint32_t colour_offset;
	bool triangles_plain; /* records are 3 floats: nothing to do but to copy them */
	bool colours_present; /* a vertex has one; the user's to set */
	bool deferred;        /* the tables are on disk: faces are only noted down */
	struct spill *noted;  /* when deferred: runs of faces that are alike */
	uint64_t run_length;
	uint32_t run_part;
	uint32_t run_corner_count;
	bool run_normals;
	bool run_textured;
	struct faces_part *parts;
	uint32_t part_capacity;
	/* The face at hand.  Room for corner_max corners. */
	uint32_t corner_max;
	uint64_t *face_vertices; /* the user's, after faces_reserve() */
	uint64_t *face_normals;
	uint64_t *face_coordinates;
	struct polygon polygon;
	const uint8_t **corners; /* its vertices' records */
	const uint8_t **corner_normals;
	const uint8_t **corner_coordinates;
	uint8_t *joined; /* room for these records, where they come from disk */
};

/** One face; the numbers of its corners stand in faces->face_vertices and the other two. */
struct face {
	uint32_t part;
	uint32_t corner_count;
	bool normals;  /* it has them */
	bool textured; /* it has texture coordinates; they count where its part has an image */
};

/** How many there are so far. */
static inline uint64_t faces_vertex_count(const struct faces *faces)
{
	return faces->vertices.count;
}

static inline uint64_t faces_normal_count(const struct faces *faces)
{
	return faces->normals.count;
}

static inline uint64_t faces_coordinate_count(const struct faces *faces)
{
	return faces->coordinates.count;
}

/** Returns: 0 or -ENOMEM.  Ownership: ends with faces_destroy(). */
int faces_create(struct import_job *job, const struct faces_layout *layout, struct faces **ret,
		 struct why *why);
struct faces *faces_destroy(struct faces *faces);

/**
 * Says that so many vertices will come, so that room is made once, or all is deferred.
 *
 * Returns: 0, -ENOMEM or -errno of the scratch folder.
 */
int faces_expect_vertices(struct faces *faces, uint64_t count, struct why *why);

/** Defers everything: vertices may then come behind the faces that use them.  Returns: as above. */
int faces_defer(struct faces *faces, struct why *why);

/** As batcher_part().  map: may be NULL. */
int faces_part(struct faces *faces, const struct import_part *part, const struct texture_map *map,
	       uint32_t *ret_number, struct why *why);

/** Adds records behind those that are there.  Returns: as faces_expect_vertices(). */
int faces_add_vertices(struct faces *faces, const void *records, uint64_t count, struct why *why);
int faces_add_normal(struct faces *faces, const float normal[3], struct why *why);
int faces_add_coordinate(struct faces *faces, const float coordinate[2], struct why *why);

/**
 * Makes room for the numbers of a face's corners; what was written there before stays.
 *
 * Returns: 0, -EUCLEAN when a face may not have so many, or -ENOMEM.
 */
int faces_reserve(struct faces *faces, uint64_t corner_count, struct why *why);

/**
 * Adds a face; fewer than three corners are counted as dropped.
 *
 * Returns: 0, -EUCLEAN when it points outside of the tables, -ENOMEM, -EIO when an image has changed,
 * or what the sink returned.
 */
int faces_add_face(struct faces *faces, const struct face *face, struct why *why);

/** Hands on what is left.  Returns: as faces_add_face(). */
int faces_finish(struct faces *faces, struct why *why);

/** faces_add_face() for a triangle of vertices alone: the path that has to be fast. */
static inline int faces_add_triangle(struct faces *faces, uint32_t part, const uint64_t corners[3],
				     struct why *why)
{
	const struct faces_table *table = &faces->vertices;
	struct face face = { .part = part, .corner_count = 3 };
	int r;

	if (faces->triangles_plain && !faces->deferred && corners[0] < table->count &&
	    corners[1] < table->count && corners[2] < table->count) {
		struct batch_kind kind = { .part = part };
		uint32_t index;
		float *out;

		r = batcher_next(&faces->batcher, &kind, &index, why);
		if (r < 0)
			return r;
		out = faces->batcher.positions32 + 9 * (size_t)index;
		memcpy(out, table->records + 12 * corners[0], 12);
		memcpy(out + 3, table->records + 12 * corners[1], 12);
		memcpy(out + 6, table->records + 12 * corners[2], 12);
		faces->job->info->face_count++;
		return 0;
	}
	r = faces_reserve(faces, 3, why);
	if (r < 0)
		return r;
	memcpy(faces->face_vertices, corners, 3 * sizeof(*corners));
	return faces_add_face(faces, &face, why);
}

#endif /* FORMATS_IMPORT_FACES_H */
