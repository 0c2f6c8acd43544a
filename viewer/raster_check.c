/* SPDX-License-Identifier: MIT */
#include "viewer/raster_check.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include <epoxy/gl.h>

#include "formats/base/random.h"
#include "formats/store/payload.h"
#include "libclient/select/raster.h"
#include "viewer/target.h"

#define WIDTH          320u
#define HEIGHT         240u
#define TRIANGLE_COUNT 4000u
#define VERTEX_COUNT   (3u * TRIANGLE_COUNT)
/* The scene is a cube of so many steps, with the eye in its middle. */
#define SCENE_STEPS 65536u
#define STEP        0x1p-12

struct scene {
	uint16_t positions[VERTEX_COUNT][4];
	float floats[VERTEX_COUNT][3]; /* the same */
	uint32_t indices[VERTEX_COUNT];
	uint64_t items[WIDTH * HEIGHT];
	float depths[WIDTH * HEIGHT];
};

/* One in eight is as large as a quarter of the scene, so that some pass through the near plane. */
static void scene_make(struct scene *scene)
{
	struct random random = { 1 };

	for (uint32_t v = 0; v < VERTEX_COUNT; v++) {
		uint32_t triangle = v / 3;
		uint32_t size = triangle % 8 == 0 ? SCENE_STEPS / 4 : SCENE_STEPS / 64;

		for (int k = 0; k < 3; k++) {
			uint16_t first = scene->positions[3 * triangle][k];

			if (v % 3 == 0)
				scene->positions[v][k] =
					(uint16_t)random_below(&random, SCENE_STEPS - size);
			else
				scene->positions[v][k] =
					(uint16_t)(first + random_below(&random, size));
			scene->floats[v][k] = (float)scene->positions[v][k];
		}
		scene->indices[v] = v;
	}
}

static int draw_by_gl(struct renderer *renderer, const struct camera_view *view,
		      const struct payload_header *header, GLuint buffer, struct scene *scene,
		      struct why *why)
{
	const struct gpu_payload payload = { .buffer = buffer, .header = header };
	const struct render_style style = { .channel = CHANNEL_TRIANGLE,
					    .tile = render_tile_whole };
	const uint8_t background[3] = { 0, 0, 0 };
	struct target target;
	int r = target_init(&target, WIDTH, HEIGHT, CHANNEL_TRIANGLE, why);

	if (r < 0)
		return r;
	target_begin(&target, background);
	renderer_begin(renderer, &style);
	renderer_set_view(renderer, view, 0, 0);
	renderer_draw(renderer, &payload, 0);
	target_read(&target, scene->items);
	target.channel = CHANNEL_DEPTH;
	target_read(&target, scene->depths);
	target_done(&target);
	return 0;
}

static int compare(const struct camera_view *view, const double origin[3],
		   const struct scene *scene, uint32_t *ret_wrong)
{
	struct raster_draw draw = {
		.positions = scene->floats[0],
		.vertex_count = VERTEX_COUNT,
		.indices = scene->indices,
		.triangle_count = TRIANGLE_COUNT,
		.scale = (float)STEP,
	};
	struct raster *raster;
	uint32_t wrong = 0;
	int r = raster_create(WIDTH, HEIGHT, &raster);

	if (r < 0)
		return r;
	camera_node_offset(view, origin, draw.offset);
	r = raster_triangles(raster, view, &draw);
	for (size_t i = 0; i < (size_t)WIDTH * HEIGHT; i++)
		wrong += raster_items(raster)[i] != scene->items[i] ||
			 raster_depths(raster)[i] != scene->depths[i];
	raster_destroy(raster);
	*ret_wrong = wrong;
	return r;
}

/* Makes the payload of a scene, draws it both ways. */
static int check(struct renderer *renderer, struct scene *scene, uint32_t *ret_wrong,
		 struct why *why)
{
	const struct payload_run run = { .colour = UINT32_MAX };
	const struct payload_content content = {
		.payload_id = 1,
		.kind = STORE_KIND_TRIANGLES,
		.vertex_count = VERTEX_COUNT,
		.triangle_count = TRIANGLE_COUNT,
		.run_count = 1,
		.position_format = PAYLOAD_U16X3_RUN,
		.origin = { -8.0, -8.0, -8.0 },
		.scale = STEP,
		.runs = &run,
		.indices = scene->indices,
		.positions = scene->positions,
	};
	const struct store_superblock superblock = { .step_exponent = -12 };
	const struct camera camera = { .eye = { 0.3, -0.2, 0.1 },
				       .at = { 1.0, 2.0, 0.5 },
				       .up = { 0.0, 0.0, 1.0 },
				       .fov_y_degrees = 60.0 };
	struct camera_view view;
	void *payload;
	uint32_t bytes;
	GLuint buffer;
	int r = camera_view_init(&view, &camera, &superblock, (double)WIDTH / HEIGHT, 0.05);

	if (r == 0)
		r = payload_size(&content, &bytes);
	payload = r == 0 ? aligned_alloc(16, bytes) : NULL;
	if (!payload)
		return why_errno(why, -ENOMEM, "comparing rasterisers");
	payload_write(&content, payload);
	glCreateBuffers(1, &buffer);
	glNamedBufferStorage(buffer, bytes, payload, 0);
	r = draw_by_gl(renderer, &view, payload, buffer, scene, why);
	if (r == 0)
		r = compare(&view, content.origin, scene, ret_wrong);
	glDeleteBuffers(1, &buffer);
	free(payload);
	return r;
}

int raster_check(struct renderer *renderer, uint32_t *ret_wrong, struct why *why)
{
	struct scene *scene = calloc(1, sizeof(*scene));
	int r;

	if (!scene)
		return why_errno(why, -ENOMEM, "comparing rasterisers");
	scene_make(scene);
	r = check(renderer, scene, ret_wrong, why);
	free(scene);
	return r;
}
