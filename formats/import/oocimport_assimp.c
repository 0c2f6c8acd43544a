/* SPDX-License-Identifier: MIT */
/*
 * oocimport-assimp MEMORY_BYTES FILE: reads a model by assimp and writes it as frames
 * (assimp_frame.h) to standard output.  It is started by the importer, not by people.
 *
 * Node transforms are applied; a part is a mesh at a node.  Polygons are cut here and not by
 * assimp, which would hold the model twice.
 */
#include <assimp/cimport.h>
#include <assimp/material.h>
#include <assimp/scene.h>
#include <errno.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include "formats/base/bytes.h"
#include "formats/base/text.h"
#include "formats/import/assimp_frame.h"
#include "formats/import/batcher.h"
#include "formats/import/colour.h"
#include "formats/import/placement.h"
#include "formats/import/polygon.h"

/* Nodes within nodes; assimp itself has no limit. */
#define DEPTH_MAX 500u

struct writer {
	const struct aiScene *scene;
	const char *path;
	uint32_t frame_count;
	struct import_options options;
	struct import_sink sink;
	struct import_info info;
	struct batcher batcher;
	struct polygon polygon;
	char scene_path[ASSIMP_TEXT_BYTES_MAX + 1];
};

/* ---- frames ---- */

static int write_whole(const void *data, size_t size_bytes)
{
	const uint8_t *at = data;

	while (size_bytes > 0) {
		ssize_t r = write(STDOUT_FILENO, at, size_bytes);

		if (r < 0 && errno != EINTR)
			return -errno;
		if (r > 0) {
			at += r;
			size_bytes -= (size_t)r;
		}
	}
	return 0;
}

struct piece {
	const void *data;
	size_t size_bytes;
};

static int write_frame(struct writer *writer, enum assimp_frame_kind kind,
		       const struct piece *pieces, size_t piece_count)
{
	struct assimp_frame_header header = {
		.magic = ASSIMP_FRAME_MAGIC,
		.kind = (uint32_t)kind,
		.number = writer->frame_count++,
	};
	int r;

	for (size_t i = 0; i < piece_count; i++)
		header.body_bytes += (uint32_t)pieces[i].size_bytes;
	r = write_whole(&header, sizeof(header));
	for (size_t i = 0; i < piece_count && r == 0; i++)
		r = write_whole(pieces[i].data, pieces[i].size_bytes);
	return r;
}

static uint32_t text_bytes(const char *text)
{
	return (uint32_t)u64_min(strlen(text), ASSIMP_TEXT_BYTES_MAX);
}

static int write_part(void *arg, const struct import_part *part, struct why *why)
{
	struct assimp_part told = {
		.colour = part->colour,
		.name_bytes = text_bytes(part->name),
		.scene_path_bytes = text_bytes(part->scene_path),
		.material_bytes = text_bytes(part->material),
	};
	const struct piece pieces[] = {
		{ &told, sizeof(told) },
		{ part->name, told.name_bytes },
		{ part->scene_path, told.scene_path_bytes },
		{ part->material, told.material_bytes },
	};

	(void)why;
	return write_frame(arg, ASSIMP_FRAME_PART, pieces, ARRAY_LENGTH(pieces));
}

static int write_batch(void *arg, const struct import_batch *batch, struct why *why)
{
	size_t corners = 3 * (size_t)batch->triangle_count;
	struct assimp_batch told = {
		.triangle_count = batch->triangle_count,
		.part = batch->part,
		.flags = (batch->normals ? ASSIMP_BATCH_NORMALS : 0) |
			 (batch->colours ? ASSIMP_BATCH_COLOURS : 0),
	};
	const struct piece pieces[] = {
		{ &told, sizeof(told) },
		{ batch->positions_double ? (const void *)batch->positions64 : batch->positions32,
		  corners * (batch->positions_double ? 24 : 12) },
		{ batch->normals, batch->normals ? corners * 12 : 0 },
		{ batch->colours, batch->colours ? corners * 4 : 0 },
	};

	(void)why;
	return write_frame(arg, ASSIMP_FRAME_BATCH, pieces, ARRAY_LENGTH(pieces));
}

static int write_error(struct writer *writer, int error, const char *text)
{
	struct assimp_error told = { .error = error, .text_bytes = text_bytes(text) };
	const struct piece pieces[] = { { &told, sizeof(told) }, { text, told.text_bytes } };

	return write_frame(writer, ASSIMP_FRAME_ERROR, pieces, ARRAY_LENGTH(pieces));
}

/* ---- the scene ---- */

static struct placement placement_of(const struct aiMatrix4x4 *m)
{
	return (struct placement){ {
		(double)m->a1, (double)m->a2, (double)m->a3, (double)m->a4, /* x */
		(double)m->b1, (double)m->b2, (double)m->b3, (double)m->b4, /* y */
		(double)m->c1, (double)m->c2, (double)m->c3, (double)m->c4, /* z */
	} };
}

static bool is_identity(const struct aiMatrix4x4 *matrix)
{
	static const ai_real identity[16] = { 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1 };

	return memcmp(matrix, identity, sizeof(identity)) == 0;
}

static bool is_moved(const struct aiNode *node, unsigned depth)
{
	if (depth > DEPTH_MAX)
		return true;
	if (!is_identity(&node->mTransformation))
		return true;
	for (unsigned i = 0; i < node->mNumChildren; i++)
		if (is_moved(node->mChildren[i], depth + 1))
			return true;
	return false;
}

static bool path_has_suffix(const char *path, const char *suffix)
{
	size_t length = strlen(path), suffix_length = strlen(suffix);

	return length > suffix_length && strcasecmp(path + length - suffix_length, suffix) == 0;
}

/* What a number among the scene's metadata says, or fallback. */
static double metadata_number(const struct aiScene *scene, const char *key, double fallback)
{
	const struct aiMetadata *metadata = scene->mMetaData;

	for (unsigned i = 0; metadata && i < metadata->mNumProperties; i++) {
		const struct aiMetadataEntry *entry = &metadata->mValues[i];

		if (strcmp(metadata->mKeys[i].data, key) != 0 || !entry->mData)
			continue;
		if (entry->mType == AI_INT32)
			return *(const int32_t *)entry->mData;
		if (entry->mType == AI_FLOAT)
			return (double)*(const float *)entry->mData;
		if (entry->mType == AI_DOUBLE)
			return *(const double *)entry->mData;
	}
	return fallback;
}

/* Units and up axis, as the format defines them or the file says. */
static void find_units(const struct writer *writer, struct assimp_info *info)
{
	double axis = metadata_number(writer->scene, "UpAxis", -1.0);
	double centimetres = metadata_number(writer->scene, "UnitScaleFactor", 0.0);

	/* glTF defines metres and Y; of Collada assimp makes metres and Y. */
	if (path_has_suffix(writer->path, ".gltf") || path_has_suffix(writer->path, ".glb") ||
	    path_has_suffix(writer->path, ".dae")) {
		info->unit_metres = 1.0;
		info->up_axis = STORE_AXIS_Y;
		return;
	}
	if (centimetres > 0.0 && centimetres < 1e12)
		info->unit_metres = centimetres / 100.0;
	if (metadata_number(writer->scene, "UpAxisSign", 1.0) > 0.0 && axis >= 0.0 && axis <= 2.0)
		info->up_axis = STORE_AXIS_X + (uint32_t)axis;
}

/* A part's colour and material. */
static void find_material(const struct aiScene *scene, const struct aiMesh *mesh,
			  struct import_part *part, struct aiString *name)
{
	const struct aiMaterial *material;
	struct aiColor4D diffuse;
	ai_real opacity = 1;

	part->colour = IMPORT_COLOUR_DEFAULT;
	if (mesh->mMaterialIndex >= scene->mNumMaterials)
		return;
	material = scene->mMaterials[mesh->mMaterialIndex];
	if (aiGetMaterialString(material, AI_MATKEY_NAME, name) == aiReturn_SUCCESS)
		part->material = name->data;
	if (aiGetMaterialColor(material, AI_MATKEY_COLOR_DIFFUSE, &diffuse) != aiReturn_SUCCESS &&
	    aiGetMaterialColor(material, AI_MATKEY_BASE_COLOR, &diffuse) != aiReturn_SUCCESS)
		return;
	part->colour = colour_from_rgb((double)diffuse.r, (double)diffuse.g, (double)diffuse.b);
	if (aiGetMaterialFloatArray(material, AI_MATKEY_OPACITY, &opacity, NULL) ==
	    aiReturn_SUCCESS)
		part->colour = colour_with_opacity(part->colour, (double)opacity);
}

/* A mesh at a node. */
struct placed_mesh {
	const struct aiMesh *mesh;
	struct placement placement;
	double cofactors[9];
	bool flip;
	struct batch_kind kind;
};

static void put_corner(struct writer *writer, const struct placed_mesh *placed, unsigned vertex,
		       size_t to)
{
	const struct aiVector3D *position = &placed->mesh->mVertices[vertex];
	const double p[3] = { (double)position->x, (double)position->y, (double)position->z };
	struct batcher *batcher = &writer->batcher;

	if (batcher->positions_double)
		placement_move(&placed->placement, p, batcher->positions64 + 3 * to);
	for (size_t k = 0; k < 3 && !batcher->positions_double; k++)
		batcher->positions32[3 * to + k] = (float)p[k];
	if (placed->kind.normals) {
		const struct aiVector3D *n = &placed->mesh->mNormals[vertex];

		placement_turn(placed->cofactors,
			       (const double[3]){ (double)n->x, (double)n->y, (double)n->z },
			       batcher->normals + 3 * to);
	}
	if (placed->kind.colours) {
		const struct aiColor4D *c = &placed->mesh->mColors[0][vertex];

		batcher->colours[to] = colour_with_opacity(
			colour_from_rgb((double)c->r, (double)c->g, (double)c->b), (double)c->a);
	}
}

static int put_face(struct writer *writer, const struct placed_mesh *placed,
		    const struct aiFace *face, struct why *why)
{
	static const uint32_t whole[3] = { 0, 1, 2 };
	const uint32_t *cut = whole;

	writer->info.face_count++;
	if (face->mNumIndices < 3) {
		writer->info.dropped_faces++;
		return 0;
	}
	if (face->mNumIndices > POLYGON_CORNERS_MAX)
		return why_set(why, -EUCLEAN, "a face of %u corners", face->mNumIndices);
	for (unsigned i = 0; i < face->mNumIndices; i++)
		if (face->mIndices[i] >= placed->mesh->mNumVertices)
			return why_set(why, -EUCLEAN, "a face points at vertex %u of %u",
				       face->mIndices[i], placed->mesh->mNumVertices);
	if (face->mNumIndices > 3) {
		if (polygon_reserve(&writer->polygon, face->mNumIndices) < 0)
			return why_set(why, -ENOMEM, "no memory");
		for (unsigned i = 0; i < face->mNumIndices; i++) {
			const struct aiVector3D *p = &placed->mesh->mVertices[face->mIndices[i]];
			double *to = writer->polygon.positions + 3 * (size_t)i;

			to[0] = (double)p->x;
			to[1] = (double)p->y;
			to[2] = (double)p->z;
		}
		cut = polygon_cut(&writer->polygon, face->mNumIndices);
	}
	for (unsigned i = 0; i < face->mNumIndices - 2; i++, cut += 3) {
		uint32_t index;
		int r = batcher_next(&writer->batcher, &placed->kind, &index, why);

		if (r < 0)
			return r;
		for (size_t k = 0; k < 3; k++)
			put_corner(writer, placed, face->mIndices[cut[placed->flip ? 2 - k : k]],
				   3 * (size_t)index + k);
	}
	return 0;
}

static int put_mesh(struct writer *writer, const struct aiNode *node, const struct aiMesh *mesh,
		    const struct placement *placement, struct why *why)
{
	struct placed_mesh placed = {
		.mesh = mesh,
		.placement = *placement,
		.kind = { .normals = mesh->mNormals != NULL, .colours = mesh->mColors[0] != NULL },
	};
	struct import_part part = { .name = node->mName.data, .scene_path = writer->scene_path };
	struct aiString material_name;
	int r;

	if (!mesh->mVertices || mesh->mNumFaces == 0)
		return 0;
	find_material(writer->scene, mesh, &part, &material_name);
	placed.flip = placement_cofactors(placement, placed.cofactors) < 0.0;
	r = batcher_part(&writer->batcher, &part, &placed.kind.part, why);
	for (unsigned i = 0; i < mesh->mNumFaces && r == 0; i++)
		r = put_face(writer, &placed, &mesh->mFaces[i], why);
	return r;
}

static int put_node(struct writer *writer, const struct aiNode *node,
		    const struct placement *parent, unsigned depth, struct why *why)
{
	struct placement own = placement_of(&node->mTransformation);
	struct placement placement = placement_multiply(parent, &own);
	size_t length = strlen(writer->scene_path);
	int r = 0;

	if (depth > DEPTH_MAX)
		return why_set(why, -EUCLEAN, "nodes are nested more than %u deep", DEPTH_MAX);
	if (node->mName.length > 0 && length + node->mName.length + 2 < sizeof(writer->scene_path))
		(void)snprintf(writer->scene_path + length, sizeof(writer->scene_path) - length,
			       "%s%s", length > 0 ? "/" : "", node->mName.data);
	for (unsigned i = 0; i < node->mNumMeshes && r == 0; i++) {
		if (node->mMeshes[i] >= writer->scene->mNumMeshes)
			return why_set(why, -EUCLEAN, "a node points at a mesh that is not there");
		r = put_mesh(writer, node, writer->scene->mMeshes[node->mMeshes[i]], &placement,
			     why);
	}
	for (unsigned i = 0; i < node->mNumChildren && r == 0; i++)
		r = put_node(writer, node->mChildren[i], &placement, depth + 1, why);
	writer->scene_path[length] = '\0';
	return r;
}

static int put_scene(struct writer *writer, struct why *why)
{
	const struct aiNode *root = writer->scene->mRootNode;
	struct assimp_info info = { .up_axis = STORE_AXIS_UNKNOWN };
	struct piece piece = { &info, sizeof(info) };
	int r;

	if (!root)
		return why_set(why, -EUCLEAN, "it has no scene");
	info.positions_double = is_moved(root, 0);
	find_units(writer, &info);
	r = write_frame(writer, ASSIMP_FRAME_INFO, &piece, 1);
	if (r == 0)
		r = batcher_init(&writer->batcher, info.positions_double != 0, &writer->options,
				 &writer->sink, &writer->info, why);
	if (r == 0)
		r = put_node(writer, root, &placement_identity, 0, why);
	return r < 0 ? r : batcher_flush(&writer->batcher, why);
}

static int finish(struct writer *writer)
{
	struct assimp_end end = {
		.triangle_count = writer->info.triangle_count,
		.part_count = writer->info.part_count,
		.face_count = writer->info.face_count,
		.dropped_faces = writer->info.dropped_faces,
	};
	struct piece piece = { &end, sizeof(end) };

	return write_frame(writer, ASSIMP_FRAME_END, &piece, 1);
}

/*
 * Bounds what the process may hold.  Sanitizers reserve address space far beyond any limit, so that
 * there is none under them.
 */
static int limit_memory(const char *text)
{
	uint64_t memory_bytes;
	struct rlimit limit;

	if (text_to_u64(text, &memory_bytes) < 0)
		return -EINVAL;
	limit = (struct rlimit){ memory_bytes, memory_bytes };
#ifndef OOCD_SANITIZED
	if (setrlimit(RLIMIT_DATA, &limit) < 0)
		return -errno;
#endif
	limit = (struct rlimit){ 0, 0 };
	(void)setrlimit(RLIMIT_CORE, &limit);
	return 0;
}

int main(int argc, char **argv)
{
	struct writer writer = { .sink = { .part = write_part, .batch = write_batch } };
	struct why why = { .text = "" };
	const char *suffix;
	int r;

	if (argc != 3 || limit_memory(argv[1]) < 0) {
		fprintf(stderr,
			"usage: oocimport-assimp MEMORY_BYTES FILE (run by the importer)\n");
		return 2;
	}
	/* Nobody is left to read what a lost helper writes. */
	(void)prctl(PR_SET_PDEATHSIG, SIGKILL);
	writer.path = argv[2];
	writer.sink.arg = &writer;
	suffix = strrchr(argv[2], '.');
	if (!suffix || !aiIsExtensionSupported(suffix))
		return write_error(&writer, -ENOTSUP, "no importer knows a file of this name") < 0;
	writer.scene = aiImportFile(argv[2], 0);
	if (!writer.scene) {
		const char *text = aiGetErrorString();
		bool memory = strcasestr(text, "bad_alloc") || strcasestr(text, "memory");

		return write_error(&writer, memory ? -ENOMEM : -EUCLEAN, text) < 0;
	}
	r = put_scene(&writer, &why);
	if (r == 0)
		r = finish(&writer);
	else if (why.text[0])
		r = write_error(&writer, r, why.text);
	batcher_done(&writer.batcher);
	polygon_done(&writer.polygon);
	aiReleaseImport(writer.scene);
	return r < 0;
}
