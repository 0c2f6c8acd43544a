/* SPDX-License-Identifier: MIT */
#include "viewer/arena_buffers.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include <epoxy/gl.h>

#include "formats/base/bytes.h"
#include "formats/base/file.h"
#include "formats/store/payload.h"
#include "viewer/target.h"
#include "viewer/world.h"

/* One segment's buffer. */
struct arena_buffer {
	GLuint buffer; /* 0: none */
	uint64_t unique;
};

struct arena_store {
	const struct ooc_store *store;
	struct arena_buffer *segments; /* by the segment's number */
	uint32_t segment_count;
};

struct arena_buffers {
	struct arena_store stores[WORLD_STORE_COUNT_MAX];
};

/* Returns: 0 when the driver refuses. */
static GLuint pin(const void *base, uint64_t bytes)
{
	GLuint buffer = 0;

	while (glGetError() != GL_NO_ERROR)
		;
	glCreateBuffers(1, &buffer);
	glBindBuffer(GL_EXTERNAL_VIRTUAL_MEMORY_BUFFER_AMD, buffer);
	/* The driver takes the address and writes nothing there; its type does not say so. */
	glBufferData(GL_EXTERNAL_VIRTUAL_MEMORY_BUFFER_AMD, (GLsizeiptr)bytes, (void *)base,
		     GL_STREAM_DRAW);
	glBindBuffer(GL_EXTERNAL_VIRTUAL_MEMORY_BUFFER_AMD, 0);
	if (glGetError() != GL_NO_ERROR) {
		glDeleteBuffers(1, &buffer);
		return 0;
	}
	return buffer;
}

/* ---- the probe ---- */

#define PROBE_SIDE  4u
#define PROBE_BYTES 4096u

/* A triangle that covers the picture. */
static void write_probe(void *memory, uint32_t colour)
{
	static const uint16_t positions[3][4] = { { 0, 0, 0, 0 }, { 4, 0, 0, 0 }, { 0, 4, 0, 0 } };
	static const uint32_t indices[3] = { 0, 1, 2 };
	const struct payload_run run = { .colour = colour };
	const struct payload_content content = {
		.payload_id = 1,
		.kind = STORE_KIND_TRIANGLES,
		.vertex_count = 3,
		.triangle_count = 1,
		.run_count = 1,
		.position_format = PAYLOAD_U16X3_RUN,
		.origin = { -1.0, -1.0, 0.0 },
		.scale = 1.0,
		.runs = &run,
		.indices = indices,
		.positions = positions,
	};

	payload_write(&content, memory);
}

static bool probe_shows(struct renderer *renderer, const struct target *target,
			const struct gpu_payload *payload, uint32_t colour)
{
	/* x and y as they are, at depth 1/2. */
	static const struct camera_view view = {
		.forward = { 0.0, 0.0, -1.0 },
		.up = { 0.0, 1.0, 0.0 },
		.right = { 1.0, 0.0, 0.0 },
		.view_projection = { { 1.0f, 0.0f, 0.0f, 0.0f },
				     { 0.0f, 1.0f, 0.0f, 0.0f },
				     { 0.0f, 0.0f, 0.0f, 0.5f },
				     { 0.0f, 0.0f, 0.0f, 1.0f } },
	};
	const struct render_style style = { .channel = CHANNEL_COLOUR,
					    .unlit = true,
					    .tile = render_tile_whole };
	const uint8_t background[3] = { 0, 0, 0 };
	uint32_t pixels[PROBE_SIDE * PROBE_SIDE];

	target_begin(target, background);
	renderer_begin(renderer, &style);
	renderer_set_view(renderer, &view, 0, 0);
	renderer_draw(renderer, payload, 0);
	target_read(target, pixels);
	for (size_t i = 0; i < ARRAY_LENGTH(pixels); i++) {
		if (pixels[i] != colour)
			return false;
	}
	return true;
}

static bool probe_mappings(struct renderer *renderer, void *writable, const void *readable)
{
	const uint32_t first_colour = UINT32_C(0xff3060c0);
	const uint32_t second_colour = UINT32_C(0xffc0a020);
	struct gpu_payload payload = { .header = readable };
	struct target target;
	bool works;

	if (target_init(&target, PROBE_SIDE, PROBE_SIDE, CHANNEL_COLOUR, NULL) < 0)
		return false;
	write_probe(writable, first_colour);
	payload.buffer = pin(readable, PROBE_BYTES);
	works = payload.buffer && probe_shows(renderer, &target, &payload, first_colour);
	write_probe(writable, second_colour);
	works = works && probe_shows(renderer, &target, &payload, second_colour);
	glFinish();
	glDeleteBuffers(1, &payload.buffer);
	target_done(&target);
	return works;
}

bool arena_buffers_work(struct renderer *renderer)
{
	AUTO_FD fd = memfd_create("oocview-probe", MFD_CLOEXEC);
	void *writable;
	void *readable;
	bool works = false;

	if (!epoxy_has_gl_extension("GL_AMD_pinned_memory"))
		return false;
	if (fd < 0 || ftruncate(fd, PROBE_BYTES) < 0)
		return false;
	writable = mmap(NULL, PROBE_BYTES, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
	if (writable == MAP_FAILED)
		return false;
	readable = mmap(NULL, PROBE_BYTES, PROT_READ, MAP_SHARED, fd, 0);
	if (readable != MAP_FAILED) {
		works = probe_mappings(renderer, writable, readable);
		(void)munmap(readable, PROBE_BYTES);
	}
	(void)munmap(writable, PROBE_BYTES);
	return works;
}

/* ---- segments ---- */

int arena_buffers_create(struct arena_buffers **ret)
{
	struct arena_buffers *buffers = calloc(1, sizeof(*buffers));

	if (!buffers)
		return -ENOMEM;
	*ret = buffers;
	return 0;
}

struct arena_buffers *arena_buffers_destroy(struct arena_buffers *buffers)
{
	if (!buffers)
		return NULL;
	for (size_t i = 0; i < WORLD_STORE_COUNT_MAX; i++) {
		struct arena_store *store = &buffers->stores[i];

		for (uint32_t k = 0; k < store->segment_count; k++)
			glDeleteBuffers(1, &store->segments[k].buffer);
		free(store->segments);
	}
	free(buffers);
	return NULL;
}

static void drop(struct arena_buffer *segment)
{
	glDeleteBuffers(1, &segment->buffer);
	segment->buffer = 0;
}

void arena_buffers_sweep(struct arena_buffers *buffers)
{
	for (size_t i = 0; i < WORLD_STORE_COUNT_MAX; i++) {
		struct arena_store *store = &buffers->stores[i];

		for (uint32_t k = 0; k < store->segment_count; k++) {
			struct arena_buffer *segment = &store->segments[k];
			const void *base;
			uint64_t bytes;
			uint64_t unique;

			if (segment->buffer &&
			    (ooc_segment(store->store, k, &base, &bytes, &unique) < 0 ||
			     unique != segment->unique))
				drop(segment);
		}
	}
}

static struct arena_buffer *find_segment(struct arena_store *store, uint32_t segment)
{
	if (segment >= store->segment_count) {
		uint32_t count = segment + 1;
		struct arena_buffer *segments = realloc(store->segments, count * sizeof(*segments));

		if (!segments)
			return NULL;
		memset(segments + store->segment_count, 0,
		       (count - store->segment_count) * sizeof(*segments));
		store->segments = segments;
		store->segment_count = count;
	}
	return &store->segments[segment];
}

int arena_buffers_find(struct arena_buffers *buffers, uint32_t store_index,
		       const struct ooc_store *store, uint32_t node, struct gpu_payload *ret,
		       struct ooc_place *ret_place)
{
	struct arena_store *arena = &buffers->stores[store_index];
	struct arena_buffer *segment;
	struct ooc_place place;
	const void *base;
	uint64_t bytes;
	uint64_t unique;

	arena->store = store;
	if (ooc_locate(store, node, &place) < 0 ||
	    ooc_segment(store, place.segment, &base, &bytes, &unique) < 0)
		return -EAGAIN;
	segment = find_segment(arena, place.segment);
	if (!segment)
		return -ENOMEM;
	if (segment->buffer && segment->unique != unique)
		drop(segment);
	if (!segment->buffer) {
		segment->buffer = pin(base, bytes);
		segment->unique = unique;
		if (!segment->buffer)
			return -ENOMEM;
	}
	ret->buffer = segment->buffer;
	ret->offset_bytes = place.offset_bytes;
	ret->header = (const void *)((const uint8_t *)base + place.offset_bytes);
	*ret_place = place;
	return 0;
}
