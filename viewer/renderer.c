/* SPDX-License-Identifier: MIT */
#include "viewer/renderer.h"

#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <errno.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "libclient/select/raster.h"
#include "viewer/shader.h"

/*
 * Triangles that a driver may gather before it begins to draw them.  Mesa's llvmpipe sorts them into
 * tiles first: with threads of its own these begin sooner (4 % off a frame of 2.4 million triangles),
 * and without (LP_NUM_THREADS=0) it needs memory for so many and no more.  To a GPU so few flushes are
 * nothing.
 */
#define FLUSH_TRIANGLES 65536u

/* Locations in shaders/model.vert, surface.glsl, shade.frag and item.frag. */
enum location {
	LOCATION_CLIP_ROWS = 0,
	LOCATION_TILE = 4,
	LOCATION_NODE_TRANSFORM = 5,
	LOCATION_NODE_ITEM = 6,
	LOCATION_EYE = 7,
	LOCATION_LAMP = 8,
	LOCATION_UP = 9,
	LOCATION_UNLIT = 10,
	LOCATION_ITEM = 11,
};

enum attribute {
	ATTRIBUTE_POSITION = 0,
	ATTRIBUTE_RUN = 1,
	ATTRIBUTE_NORMAL = 2,
	ATTRIBUTE_COLOUR = 3,
};

/* Vertex buffers of a vertex array: position and run lie in one. */
enum vertex_buffer {
	VERTEX_BUFFER_POSITION = 0,
	VERTEX_BUFFER_NORMAL = 1,
	VERTEX_BUFFER_COLOUR = 2,
};

enum storage_block {
	STORAGE_RUNS = 0,
	STORAGE_TRIANGLE_IDS = 1,
};

/* node_item.x of the shaders. */
enum node_flag {
	NODE_HAS_NORMAL = 1,
	NODE_HAS_COLOUR = 2,
	NODE_HAS_TRIANGLE_ID = 4,
};

enum normal_kind {
	NORMAL_ABSENT,
	NORMAL_OCT8,
	NORMAL_OCT16,
	NORMAL_KIND_COUNT_
};

const struct render_tile render_tile_whole = { 1.0f, 1.0f, 0.0f, 0.0f };

struct renderer {
	GLuint shade_program;
	GLuint item_program;
	GLuint normal_program;
	/* One for each way in which vertices can lie: [float positions][normals][colours]. */
	GLuint vertex_arrays[2][NORMAL_KIND_COUNT_][2];

	/* Of the style and view that are set. */
	GLuint program;
	struct render_style style;
	const struct camera_view *view;
	uint32_t store_index;
	uint32_t first_seen;

	uint64_t unflushed_triangles;
};

static void create_vertex_array(GLuint *ret, bool is_float, enum normal_kind normal,
				bool has_colour)
{
	GLuint array;

	glCreateVertexArrays(1, &array);
	glEnableVertexArrayAttrib(array, ATTRIBUTE_POSITION);
	glVertexArrayAttribBinding(array, ATTRIBUTE_POSITION, VERTEX_BUFFER_POSITION);
	glVertexArrayAttribFormat(array, ATTRIBUTE_POSITION, 3,
				  is_float ? GL_FLOAT : GL_UNSIGNED_SHORT, GL_FALSE, 0);
	glEnableVertexArrayAttrib(array, ATTRIBUTE_RUN);
	glVertexArrayAttribBinding(array, ATTRIBUTE_RUN, VERTEX_BUFFER_POSITION);
	glVertexArrayAttribIFormat(array, ATTRIBUTE_RUN, 1,
				   is_float ? GL_UNSIGNED_INT : GL_UNSIGNED_SHORT,
				   is_float ? 12 : 6);
	if (normal != NORMAL_ABSENT) {
		glEnableVertexArrayAttrib(array, ATTRIBUTE_NORMAL);
		glVertexArrayAttribBinding(array, ATTRIBUTE_NORMAL, VERTEX_BUFFER_NORMAL);
		glVertexArrayAttribFormat(array, ATTRIBUTE_NORMAL, 2,
					  normal == NORMAL_OCT8 ? GL_BYTE : GL_SHORT, GL_TRUE, 0);
	}
	if (has_colour) {
		glEnableVertexArrayAttrib(array, ATTRIBUTE_COLOUR);
		glVertexArrayAttribBinding(array, ATTRIBUTE_COLOUR, VERTEX_BUFFER_COLOUR);
		glVertexArrayAttribFormat(array, ATTRIBUTE_COLOUR, 4, GL_UNSIGNED_BYTE, GL_TRUE, 0);
	}
	*ret = array;
}

static int create_programs(struct renderer *renderer, struct why *why)
{
	int r;

	r = shader_program_create(shader_text_model_vert, shader_text_surface_glsl,
				  shader_text_shade_frag, &renderer->shade_program, why);
	if (r < 0)
		return r;
	r = shader_program_create(shader_text_model_vert, shader_text_surface_glsl,
				  shader_text_item_frag, &renderer->item_program, why);
	if (r < 0)
		return r;
	return shader_program_create(shader_text_model_vert, shader_text_surface_glsl,
				     shader_text_normal_frag, &renderer->normal_program, why);
}

int renderer_create(struct renderer **ret, struct why *why)
{
	struct renderer *renderer = calloc(1, sizeof(*renderer));
	int r;

	if (!renderer)
		return why_errno(why, -ENOMEM, "the renderer");
	r = create_programs(renderer, why);
	if (r < 0) {
		renderer_destroy(renderer);
		return r;
	}
	for (int f = 0; f < 2; f++) {
		for (enum normal_kind n = 0; n < NORMAL_KIND_COUNT_; n++) {
			for (int c = 0; c < 2; c++)
				create_vertex_array(&renderer->vertex_arrays[f][n][c], f != 0, n,
						    c != 0);
		}
	}
	*ret = renderer;
	return 0;
}

struct renderer *renderer_destroy(struct renderer *renderer)
{
	if (!renderer)
		return NULL;
	glDeleteVertexArrays(sizeof(renderer->vertex_arrays) / sizeof(GLuint),
			     &renderer->vertex_arrays[0][0][0]);
	glDeleteProgram(renderer->shade_program);
	glDeleteProgram(renderer->item_program);
	glDeleteProgram(renderer->normal_program);
	free(renderer);
	return NULL;
}

void renderer_begin(struct renderer *renderer, const struct render_style *style)
{
	renderer->style = *style;
	renderer->view = NULL;
	switch (style->channel) {
	case CHANNEL_COLOUR:
	case CHANNEL_DEPTH:
		renderer->program = renderer->shade_program;
		break;
	case CHANNEL_PART:
	case CHANNEL_NODE:
	case CHANNEL_TRIANGLE:
		renderer->program = renderer->item_program;
		break;
	case CHANNEL_NORMAL:
		renderer->program = renderer->normal_program;
		break;
	case CHANNEL_COUNT_:
		CHECK(!"a channel");
	}
	/* Conservative frames rely on it: raster.h says why. */
	glPolygonOffset(RASTER_DEPTH_OFFSET, 0.0f);
	glEnable(GL_POLYGON_OFFSET_FILL);
	glUseProgram(renderer->program);
	glUniform4f(LOCATION_TILE, style->tile.scale_x, style->tile.scale_y, style->tile.shift_x,
		    style->tile.shift_y);
	if (renderer->program == renderer->shade_program) {
		/* Depth pictures need no light. */
		glUniform1ui(LOCATION_UNLIT, style->unlit || style->channel == CHANNEL_DEPTH);
		glUniform3f(LOCATION_UP, (float)style->up[0], (float)style->up[1],
			    (float)style->up[2]);
	}
	if (renderer->program == renderer->item_program)
		glUniform1ui(LOCATION_ITEM, style->channel);
}

/* The lamp is above the viewer's left shoulder: three sides of a box get three shades. */
static void set_lamp(const struct camera_view *view)
{
	double lamp[3];
	double length2 = 0.0;

	for (int k = 0; k < 3; k++) {
		lamp[k] = 0.8 * view->up[k] - 0.5 * view->right[k] - 0.7 * view->forward[k];
		length2 += lamp[k] * lamp[k];
	}
	for (int k = 0; k < 3; k++)
		lamp[k] /= sqrt(length2);
	glUniform3f(LOCATION_LAMP, (float)lamp[0], (float)lamp[1], (float)lamp[2]);
}

void renderer_set_view(struct renderer *renderer, const struct camera_view *view,
		       uint32_t store_index, uint32_t first_seen)
{
	renderer->view = view;
	renderer->store_index = store_index;
	renderer->first_seen = first_seen;
	glUniform4fv(LOCATION_CLIP_ROWS, 4, &view->view_projection[0][0]);
	/* The triangle channel of a payload without normals has no use for the eye, nor a place. */
	if (renderer->program == renderer->item_program)
		return;
	glUniform3f(LOCATION_EYE, (float)(view->eye[0] - view->anchor[0]),
		    (float)(view->eye[1] - view->anchor[1]),
		    (float)(view->eye[2] - view->anchor[2]));
	if (renderer->program == renderer->shade_program)
		set_lamp(view);
}

static const struct payload_stream *find_stream(const struct payload_header *header,
						enum payload_semantic semantic)
{
	for (uint32_t i = 0; i < header->stream_count; i++) {
		if (header->streams[i].semantic == semantic)
			return &header->streams[i];
	}
	return NULL;
}

static void bind_vertices(GLuint array, enum vertex_buffer binding,
			  const struct gpu_payload *payload, const struct payload_stream *stream)
{
	if (stream)
		glVertexArrayVertexBuffer(array, binding, payload->buffer,
					  (GLintptr)(payload->offset_bytes + stream->offset_bytes),
					  stream->element_bytes);
}

static void bind_storage(enum storage_block block, const struct gpu_payload *payload,
			 uint32_t offset_bytes, uint64_t bytes)
{
	glBindBufferRange(GL_SHADER_STORAGE_BUFFER, block, payload->buffer,
			  (GLintptr)(payload->offset_bytes + offset_bytes), (GLsizeiptr)bytes);
}

static enum normal_kind normal_kind(const struct payload_stream *normal)
{
	if (!normal)
		return NORMAL_ABSENT;
	return normal->format == PAYLOAD_OCT8 ? NORMAL_OCT8 : NORMAL_OCT16;
}

void renderer_draw(struct renderer *renderer, const struct gpu_payload *payload,
		   uint32_t node_index)
{
	const struct payload_header *header = payload->header;
	const struct payload_stream *index = find_stream(header, PAYLOAD_INDEX);
	const struct payload_stream *position = find_stream(header, PAYLOAD_POSITION);
	const struct payload_stream *normal = find_stream(header, PAYLOAD_NORMAL);
	const struct payload_stream *colour = find_stream(header, PAYLOAD_COLOUR);
	const struct payload_stream *triangle_id = find_stream(header, PAYLOAD_TRIANGLE_ID);
	uint32_t flags = 0;
	float offset[3];
	GLuint array;

	CHECK(renderer->view && index && position);
	if (header->triangle_count == 0)
		return;
	array = renderer->vertex_arrays[position->format == PAYLOAD_F32X3_RUN][normal_kind(normal)]
				       [colour != NULL];
	bind_vertices(array, VERTEX_BUFFER_POSITION, payload, position);
	bind_vertices(array, VERTEX_BUFFER_NORMAL, payload, normal);
	bind_vertices(array, VERTEX_BUFFER_COLOUR, payload, colour);
	glVertexArrayElementBuffer(array, payload->buffer);
	glBindVertexArray(array);
	bind_storage(STORAGE_RUNS, payload, header->runs_offset_bytes,
		     (uint64_t)header->run_count * sizeof(struct payload_run));
	if (triangle_id)
		bind_storage(STORAGE_TRIANGLE_IDS, payload, triangle_id->offset_bytes,
			     (uint64_t)header->triangle_count * triangle_id->element_bytes);

	flags |= normal ? NODE_HAS_NORMAL : 0;
	flags |= colour ? NODE_HAS_COLOUR : 0;
	flags |= triangle_id ? NODE_HAS_TRIANGLE_ID : 0;
	glUniform4ui(LOCATION_NODE_ITEM, flags, node_index, renderer->store_index,
		     renderer->first_seen + node_index);
	camera_node_offset(renderer->view, header->origin, offset);
	glUniform4f(LOCATION_NODE_TRANSFORM, offset[0], offset[1], offset[2], (float)header->scale);
	glDrawElements(GL_TRIANGLES, (GLsizei)(3 * header->triangle_count),
		       index->format == PAYLOAD_U16 ? GL_UNSIGNED_SHORT : GL_UNSIGNED_INT,
		       (const void *)(uintptr_t)(payload->offset_bytes + index->offset_bytes));
	renderer->unflushed_triangles += header->triangle_count;
	if (renderer->unflushed_triangles < FLUSH_TRIANGLES)
		return;
	renderer->unflushed_triangles = 0;
	glFlush();
}
