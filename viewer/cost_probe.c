/* SPDX-License-Identifier: MIT */
#include "viewer/cost_probe.h"

#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <epoxy/gl.h>

#include "formats/base/bytes.h"
#include "formats/base/cache_folder.h"
#include "formats/base/clock.h"
#include "formats/base/log.h"
#include "formats/store/payload.h"
#include "viewer/target.h"

/* Four pixels a triangle, as where a model is looked at from inside. */
#define SIDE_PIXELS    512u
#define GRID_WIDTH     256u
#define GRID_HEIGHT    128u
#define GRID_TRIANGLES (2u * GRID_WIDTH * GRID_HEIGHT)

/* A measurement is repeated until it takes so long, then so many times for its median. */
#define LONG_ENOUGH_NS (8 * NS_PER_MS)
#define REPEAT_MAX     4096u
#define SAMPLE_COUNT   7u
/* More is not spent on one figure, however slow the renderer is. */
#define FIGURE_NS (NS_PER_S / 4)

struct mesh {
	GLuint buffer;
	void *payload;
};

struct probe {
	struct renderer *renderer;
	struct target target;
	struct mesh grid; /* over the whole picture */
	struct mesh quad; /* likewise, two triangles */
	struct mesh spot; /* 16 x 16 pixels, two triangles */
	GLuint query;
};

typedef void (*draw_fn)(struct probe *probe);

/* x and y as they are, at depth 1/2. */
static const struct camera_view flat_view = {
	.forward = { 0.0, 0.0, -1.0 },
	.up = { 0.0, 1.0, 0.0 },
	.right = { 1.0, 0.0, 0.0 },
	.view_projection = { { 1.0f, 0.0f, 0.0f, 0.0f },
			     { 0.0f, 1.0f, 0.0f, 0.0f },
			     { 0.0f, 0.0f, 0.0f, 0.5f },
			     { 0.0f, 0.0f, 0.0f, 1.0f } },
};

/* ---- what is drawn ---- */

/* A grid of squares from the lower left corner on, as a payload with normals. */
static int mesh_init(struct mesh *ret, uint32_t width, uint32_t height, double square)
{
	const struct payload_run run = { .colour = UINT32_C(0xff8090a0) };
	const uint32_t vertex_count = (width + 1) * (height + 1);
	struct payload_content content = {
		.payload_id = 1,
		.kind = STORE_KIND_TRIANGLES,
		.vertex_count = vertex_count,
		.triangle_count = 2 * width * height,
		.run_count = 1,
		.position_format = PAYLOAD_U16X3_RUN,
		.normal_format = PAYLOAD_OCT8,
		.origin = { -1.0, -1.0, 0.0 },
		.scale = square,
		.runs = &run,
	};
	uint16_t(*positions)[4] = calloc(vertex_count, sizeof(*positions));
	uint32_t(*indices)[6] = calloc((size_t)width * height, sizeof(*indices));
	uint8_t(*normals)[2] = calloc(vertex_count, sizeof(*normals));
	uint32_t bytes;
	int r = -ENOMEM;

	if (!positions || !indices || !normals)
		goto out;
	for (uint32_t v = 0; v < vertex_count; v++) {
		positions[v][0] = (uint16_t)(v % (width + 1));
		positions[v][1] = (uint16_t)(v / (width + 1) * (width / height));
	}
	for (uint32_t i = 0; i < width * height; i++) {
		uint32_t first = i / width * (width + 1) + i % width;
		const uint32_t corners[6] = { first,     first + 1,         first + width + 1,
					      first + 1, first + width + 2, first + width + 1 };

		memcpy(indices[i], corners, sizeof(corners));
	}
	content.positions = positions;
	content.indices = indices[0];
	content.normals = normals;
	r = payload_size(&content, &bytes);
	if (r < 0)
		goto out;
	ret->payload = aligned_alloc(16, bytes);
	if (!ret->payload) {
		r = -ENOMEM;
		goto out;
	}
	payload_write(&content, ret->payload);
	glCreateBuffers(1, &ret->buffer);
	glNamedBufferStorage(ret->buffer, bytes, ret->payload, 0);
out:
	free(positions);
	free(indices);
	free(normals);
	return r;
}

static void mesh_done(struct mesh *mesh)
{
	glDeleteBuffers(1, &mesh->buffer);
	free(mesh->payload);
}

static void mesh_draw(struct probe *probe, const struct mesh *mesh)
{
	const struct gpu_payload payload = { .buffer = mesh->buffer, .header = mesh->payload };

	renderer_draw(probe->renderer, &payload, 0);
}

static void draw_grid(struct probe *probe)
{
	mesh_draw(probe, &probe->grid);
}

static void draw_quad(struct probe *probe)
{
	mesh_draw(probe, &probe->quad);
}

static void draw_query(struct probe *probe)
{
	GLuint passed;

	/* Asked for at once, as the worst case that batches are better than. */
	glBeginQuery(GL_ANY_SAMPLES_PASSED, probe->query);
	mesh_draw(probe, &probe->spot);
	glEndQuery(GL_ANY_SAMPLES_PASSED);
	glGetQueryObjectuiv(probe->query, GL_QUERY_RESULT, &passed);
}

/* ---- how long it takes ---- */

static uint64_t time_once(struct probe *probe, draw_fn draw, uint32_t repeat_count)
{
	const uint8_t background[3] = { 0, 0, 0 };
	const struct render_style style = { .channel = CHANNEL_COLOUR,
					    .up = { 0.0, 0.0, 1.0 },
					    .tile = render_tile_whole };
	uint64_t begin_ns = clock_now_ns();

	target_begin(&probe->target, background);
	renderer_begin(probe->renderer, &style);
	renderer_set_view(probe->renderer, &flat_view, 0, 0);
	for (uint32_t i = 0; i < repeat_count; i++)
		draw(probe);
	glFinish();
	return clock_now_ns() - begin_ns;
}

static int compare_times(const void *left, const void *right)
{
	const uint64_t *a = left;
	const uint64_t *b = right;

	return *a < *b ? -1 : *a > *b;
}

static double median_ns(struct probe *probe, draw_fn draw, uint32_t repeat_count)
{
	uint64_t begin_ns = clock_now_ns();
	uint64_t times[SAMPLE_COUNT];
	uint32_t count = 0;

	do {
		times[count++] = time_once(probe, draw, repeat_count);
	} while (count < SAMPLE_COUNT && clock_now_ns() - begin_ns < FIGURE_NS);
	qsort(times, count, sizeof(*times), compare_times);
	return (double)times[count / 2];
}

/* Time of one draw, without the frame around it. */
static double draw_ns(struct probe *probe, draw_fn draw, double frame_ns)
{
	uint32_t repeat_count = 1;

	/* The first draw of all is not what it will be: shaders are made ready then. */
	(void)time_once(probe, draw, 1);
	while (repeat_count < REPEAT_MAX && time_once(probe, draw, repeat_count) < LONG_ENOUGH_NS)
		repeat_count *= 2;
	return fmax(median_ns(probe, draw, repeat_count) - frame_ns, 0.0) / repeat_count;
}

static void measure(struct probe *probe, struct cost_model *ret)
{
	const double pixels = (double)SIDE_PIXELS * SIDE_PIXELS;
	double frame_ns;

	/* What is drawn later counts too: nothing is in front of it. */
	glDepthFunc(GL_ALWAYS);
	(void)time_once(probe, draw_quad, 0);
	frame_ns = median_ns(probe, draw_quad, 0);
	ret->frame_ms = frame_ns / (double)NS_PER_MS;
	ret->pixel_ns = draw_ns(probe, draw_quad, frame_ns) / pixels;
	ret->triangle_ns = fmax(draw_ns(probe, draw_grid, frame_ns) - pixels * ret->pixel_ns, 0.0) /
			   GRID_TRIANGLES;
	ret->query_ns = draw_ns(probe, draw_query, frame_ns);
	glDepthFunc(GL_GREATER);
}

static int run_probe(struct renderer *renderer, struct cost_model *ret, struct why *why)
{
	struct probe probe = { .renderer = renderer };
	int r = target_init(&probe.target, SIDE_PIXELS, SIDE_PIXELS, CHANNEL_COLOUR, why);

	if (r < 0)
		return r;
	glGenQueries(1, &probe.query);
	r = mesh_init(&probe.grid, GRID_WIDTH, GRID_HEIGHT, 2.0 / GRID_WIDTH);
	if (r == 0)
		r = mesh_init(&probe.quad, 1, 1, 2.0);
	if (r == 0)
		r = mesh_init(&probe.spot, 1, 1, 32.0 / SIDE_PIXELS);
	if (r == 0)
		measure(&probe, ret);
	else
		(void)why_errno(why, r, "measuring the renderer");
	mesh_done(&probe.grid);
	mesh_done(&probe.quad);
	mesh_done(&probe.spot);
	glDeleteQueries(1, &probe.query);
	target_done(&probe.target);
	return r;
}

int cost_probe_get(struct renderer *renderer, struct cost_model *ret, struct why *why)
{
	const struct cost_identity identity = {
		.renderer = (const char *)glGetString(GL_RENDERER),
		.version = (const char *)glGetString(GL_VERSION),
	};
	struct why not_kept = { "" };
	char folder[PATH_MAX];
	char path[2 * PATH_MAX];
	bool has_path = cache_folder_make(folder, &not_kept) == 0;
	int r;

	if (has_path) {
		(void)cost_model_path(folder, &identity, path, sizeof(path));
		if (cost_model_read(path, &identity, ret, why) == 0)
			return 0;
	}
	log_info("measuring how fast %s draws", identity.renderer);
	r = run_probe(renderer, ret, why);
	if (r < 0)
		return r;
	if (!has_path || cost_model_write(path, &identity, ret, &not_kept) < 0)
		log_warning("the figures are not kept: %s", not_kept.text);
	return 0;
}
