/* SPDX-License-Identifier: MIT */
#include "libclient/select/raster.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/check.h"
#include "formats/store/payload_layout.h"
#include "libclient/select/farthest.h"

/*
 * GL leaves much of this free.  Where it does, this is what Mesa's llvmpipe does with a framebuffer
 * object (Y upwards), so that pictures can be compared: positions are rounded to nearest (even) on
 * the subpixel grid, depth is a plane through the unrounded float vertices, clipping is by the six
 * planes in turn and the polygon is a fan about its first vertex; the polygon offset comes from a
 * gradient of its own, rounded otherwise than that of the plane, and is added last.  Where llvmpipe rounds a * b + c
 * once (FMA), a product in double, which is exact, is rounded after the sum.
 */

#define SUBPIXEL_BITS 8
#define SUBPIXEL_ONE  (1 << SUBPIXEL_BITS)
#define SIDE_MAX      16384u
/* A convex polygon has nine corners after six planes; rounding can make a few more crossings. */
#define POLYGON_MAX 24
/* Up to this width every pixel is tested; wider rows are solved for where they begin and end. */
#define NARROW_PIXELS 12

enum clip_flag {
	CLIP_RIGHT = 1, /* x > w; the order is the order of clipping */
	CLIP_LEFT = 2,
	CLIP_TOP = 4,
	CLIP_BOTTOM = 8,
	CLIP_FAR = 16,  /* z < 0 */
	CLIP_NEAR = 32, /* z > w */
	CLIP_NOT_FINITE = 64,
	CLIP_PLANES = 6,
};

/* A vertex on the screen: pixels from the lower left corner. */
struct vertex {
	float x, y, z;
	int32_t fixed_x, fixed_y; /* of the pixel centres' grid: centres are whole pixels */
	uint32_t flags;           /* enum clip_flag; if any, what is above is not set */
};

struct raster {
	uint32_t width;
	uint32_t height;
	uint64_t *items;
	float *depths;
	struct farthest *farthest; /* NULL: not kept */
	/* Of the draw in hand. */
	struct vertex *vertices;
	float (*clip)[4];
	size_t vertex_room;
};

int raster_create(uint32_t width, uint32_t height, struct raster **ret)
{
	struct raster *raster;
	size_t pixel_count = (size_t)width * height;

	if (width == 0 || height == 0 || width > SIDE_MAX || height > SIDE_MAX)
		return -EINVAL;
	raster = calloc(1, sizeof(*raster));
	if (!raster)
		return -ENOMEM;
	raster->width = width;
	raster->height = height;
	raster->items = malloc(pixel_count * sizeof(*raster->items));
	raster->depths = malloc(pixel_count * sizeof(*raster->depths));
	if (!raster->items || !raster->depths) {
		raster_destroy(raster);
		return -ENOMEM;
	}
	raster_clear(raster);
	*ret = raster;
	return 0;
}

struct raster *raster_destroy(struct raster *raster)
{
	if (!raster)
		return NULL;
	free(raster->items);
	free(raster->depths);
	free(raster->vertices);
	free(raster->clip);
	farthest_destroy(raster->farthest);
	free(raster);
	return NULL;
}

void raster_clear(struct raster *raster)
{
	size_t pixel_count = (size_t)raster->width * raster->height;

	/* RASTER_ITEM_NONE is all ones, depth 0 all zeros. */
	memset(raster->items, 0xff, pixel_count * sizeof(*raster->items));
	memset(raster->depths, 0, pixel_count * sizeof(*raster->depths));
	if (raster->farthest)
		farthest_clear(raster->farthest);
}

int raster_keep_farthest(struct raster *raster)
{
	int r = 0;

	if (!raster->farthest)
		r = farthest_create(raster->width, raster->height, raster->depths,
				    &raster->farthest);
	return r;
}

bool raster_shows(struct raster *raster, const struct screen_box *box)
{
	CHECK(raster->farthest && box->rectangle.x1 < raster->width &&
	      box->rectangle.y1 < raster->height);
	return farthest_shows(raster->farthest, box);
}

const uint64_t *raster_items(const struct raster *raster)
{
	return raster->items;
}

const float *raster_depths(const struct raster *raster)
{
	return raster->depths;
}

/* ---- vertices ---- */

/* a * b + c, rounded once: the product of two floats is exact in double. */
static float multiply_add(float a, float b, float c)
{
	return (float)((double)a * (double)b + (double)c);
}

static int32_t subpixel(float coordinate)
{
	return (int32_t)lrintf((coordinate - 0.5f) * (float)SUBPIXEL_ONE);
}

static uint32_t clip_flags(const float clip[4])
{
	uint32_t flags = 0;

	flags |= clip[0] > clip[3] ? CLIP_RIGHT : 0;
	flags |= clip[0] + clip[3] < 0.0f ? CLIP_LEFT : 0;
	flags |= clip[1] > clip[3] ? CLIP_TOP : 0;
	flags |= clip[1] + clip[3] < 0.0f ? CLIP_BOTTOM : 0;
	flags |= clip[2] < 0.0f ? CLIP_FAR : 0;
	flags |= clip[2] > clip[3] ? CLIP_NEAR : 0;
	/* Also where one is not a number. */
	flags |= fabsf(clip[0]) + fabsf(clip[1]) + fabsf(clip[3]) <= 3e38f ? 0 : CLIP_NOT_FINITE;
	return flags;
}

static void vertex_project(const struct raster *raster, const float clip[4], struct vertex *ret)
{
	float half_width = 0.5f * (float)raster->width;
	float half_height = 0.5f * (float)raster->height;
	float reciprocal = 1.0f / clip[3];

	ret->x = multiply_add(clip[0] * reciprocal, half_width, half_width);
	ret->y = multiply_add(clip[1] * reciprocal, half_height, half_height);
	ret->z = clip[2] * reciprocal;
	ret->fixed_x = subpixel(ret->x);
	ret->fixed_y = subpixel(ret->y);
}

/* Where a draw's positions and corners are, in whichever form. */
struct arrays {
	const uint8_t *positions;
	size_t stride_bytes;
	bool is_u16; /* positions: else floats */
	const void *indices;
	bool has_short_indices;
	float scale;
	float offset[3];
};

static void vertex_transform(const struct raster *raster, const struct camera_view *view,
			     const float p[3], float clip[4], struct vertex *ret)
{
	for (int k = 0; k < 4; k++) {
		const float *m = view->view_projection[k];

		clip[k] = ((m[0] * p[0] + m[1] * p[1]) + m[2] * p[2]) + m[3];
	}
	ret->flags = clip_flags(clip);
	if (ret->flags == 0)
		vertex_project(raster, clip, ret);
}

static void vertices_transform(struct raster *raster, const struct camera_view *view,
			       const struct arrays *arrays, uint32_t vertex_count)
{
	for (uint32_t i = 0; i < vertex_count; i++) {
		const uint8_t *at = &arrays->positions[i * arrays->stride_bytes];
		uint16_t shorts[3];
		float p[3];

		if (arrays->is_u16) {
			memcpy(shorts, at, sizeof(shorts));
			for (int k = 0; k < 3; k++)
				p[k] = (float)shorts[k];
		} else {
			memcpy(p, at, sizeof(p));
		}
		for (int k = 0; k < 3; k++)
			p[k] = arrays->scale * p[k] + arrays->offset[k];
		vertex_transform(raster, view, p, raster->clip[i], &raster->vertices[i]);
	}
}

/* ---- one triangle on the screen ---- */

/* Inside where c - x * dx + y * dy > 0 for whole pixels x, y. */
struct edge {
	int64_t c, dx, dy;
};

struct plane {
	float at_zero, per_x, per_y;
	float offset; /* RASTER_DEPTH_OFFSET of it */
};

/* From v0 to v1, the inside to its left; shared edges belong to the triangle right of or above them. */
static struct edge edge_between(const struct vertex *v0, const struct vertex *v1)
{
	int64_t dx = v0->fixed_y - v1->fixed_y;
	int64_t dy = v0->fixed_x - v1->fixed_x;
	bool owns_edge = dx < 0 || (dx == 0 && dy > 0);

	return (struct edge){ dx * v0->fixed_x - dy * v0->fixed_y + owns_edge, dx * SUBPIXEL_ONE,
			      dy * SUBPIXEL_ONE };
}

static struct plane depth_plane(const struct vertex *v0, const struct vertex *v1,
				const struct vertex *v2)
{
	float dx01 = v0->x - v1->x;
	float dy01 = v0->y - v1->y;
	float dx20 = v2->x - v0->x;
	float dy20 = v2->y - v0->y;
	float reciprocal = 1.0f / (dx01 * dy20 - dy01 * dx20);
	float dz01 = v0->z - v1->z;
	float dz20 = v2->z - v0->z;
	float steep_x = fabsf((dz20 * dy01 - dy20 * dz01) * reciprocal);
	float steep_y = fabsf((dx20 * dz01 - dz20 * dx01) * reciprocal);
	struct plane plane;

	plane.offset = RASTER_DEPTH_OFFSET * (steep_x > steep_y ? steep_x : steep_y);
	dx01 *= reciprocal;
	dy01 *= reciprocal;
	dx20 *= reciprocal;
	dy20 *= reciprocal;
	plane.per_x = dz01 * dy20 - dz20 * dy01;
	plane.per_y = dz20 * dx01 - dz01 * dx20;
	plane.at_zero = v0->z - (plane.per_x * (v0->x - 0.5f) + plane.per_y * (v0->y - 0.5f));
	return plane;
}

static inline void pixel_draw(struct raster *raster, size_t pixel, float z, uint64_t item)
{
	float depth = raster->depths[pixel];

	if (z > depth || (z == depth && item < raster->items[pixel])) {
		raster->depths[pixel] = z;
		raster->items[pixel] = item;
	}
}

struct box {
	int32_t x0, y0, x1, y1; /* inclusive */
};

/* Index of a row's first pixel; the top row comes first in memory. */
static size_t row_begin(const struct raster *raster, int32_t y)
{
	return (size_t)(raster->height - 1 - (uint32_t)y) * raster->width;
}

static inline float depth_at(const struct plane *plane, int32_t x, int32_t y)
{
	float row = multiply_add(plane->per_x, (float)x, plane->at_zero);

	return multiply_add(plane->per_y, (float)y, row) + plane->offset;
}

static void fill_narrow(struct raster *raster, const struct edge edges[3],
			const struct plane *plane, const struct box *box, uint64_t item)
{
	int64_t row[3];

	for (int i = 0; i < 3; i++)
		row[i] = edges[i].c - box->x0 * edges[i].dx + box->y0 * edges[i].dy - 1;
	for (int32_t y = box->y0; y <= box->y1; y++) {
		int64_t e0 = row[0];
		int64_t e1 = row[1];
		int64_t e2 = row[2];
		size_t begin = row_begin(raster, y);

		for (int32_t x = box->x0; x <= box->x1; x++) {
			/* After the -1 above "greater than zero" is "sign bit clear". */
			if ((e0 | e1 | e2) >= 0)
				pixel_draw(raster, begin + (size_t)x, depth_at(plane, x, y), item);
			e0 -= edges[0].dx;
			e1 -= edges[1].dx;
			e2 -= edges[2].dx;
		}
		for (int i = 0; i < 3; i++)
			row[i] += edges[i].dy;
	}
}

/* Largest integer not above a / b, for b > 0. */
static int64_t floor_divide(int64_t a, int64_t b)
{
	return a >= 0 ? a / b : -((-a + b - 1) / b);
}

static void fill_wide(struct raster *raster, const struct edge edges[3], const struct plane *plane,
		      const struct box *box, uint64_t item)
{
	for (int32_t y = box->y0; y <= box->y1; y++) {
		size_t begin = row_begin(raster, y);
		int64_t x0 = box->x0;
		int64_t x1 = box->x1;

		for (int i = 0; i < 3; i++) {
			/* Inside where x * dx <= value. */
			int64_t value = edges[i].c + y * edges[i].dy - 1;
			int64_t dx = edges[i].dx;
			int64_t bound;

			if (dx > 0) {
				bound = floor_divide(value, dx);
				x1 = bound < x1 ? bound : x1;
			} else if (dx < 0) {
				bound = -floor_divide(value, -dx);
				x0 = bound > x0 ? bound : x0;
			} else if (value < 0) {
				x1 = x0 - 1;
			}
		}
		for (int64_t x = x0; x <= x1; x++)
			pixel_draw(raster, begin + (size_t)x, depth_at(plane, (int32_t)x, y), item);
	}
}

static int32_t min3(int32_t a, int32_t b, int32_t c)
{
	int32_t ab = a < b ? a : b;

	return ab < c ? ab : c;
}

static int32_t max3(int32_t a, int32_t b, int32_t c)
{
	int32_t ab = a > b ? a : b;

	return ab > c ? ab : c;
}

/* All three vertices are projected. */
static void triangle_draw(struct raster *raster, const struct vertex *v0, const struct vertex *v1,
			  const struct vertex *v2, uint64_t item)
{
	struct box box = {
		/* The pixel centres that the box holds: rounded up, rounded down. */
		(min3(v0->fixed_x, v1->fixed_x, v2->fixed_x) + SUBPIXEL_ONE - 1) >> SUBPIXEL_BITS,
		(min3(v0->fixed_y, v1->fixed_y, v2->fixed_y) + SUBPIXEL_ONE - 1) >> SUBPIXEL_BITS,
		max3(v0->fixed_x, v1->fixed_x, v2->fixed_x) >> SUBPIXEL_BITS,
		max3(v0->fixed_y, v1->fixed_y, v2->fixed_y) >> SUBPIXEL_BITS,
	};
	struct edge edges[3];
	struct plane plane;
	int64_t area;

	box.x0 = box.x0 > 0 ? box.x0 : 0;
	box.y0 = box.y0 > 0 ? box.y0 : 0;
	box.x1 = box.x1 < (int32_t)raster->width ? box.x1 : (int32_t)raster->width - 1;
	box.y1 = box.y1 < (int32_t)raster->height ? box.y1 : (int32_t)raster->height - 1;
	if (box.x0 > box.x1 || box.y0 > box.y1)
		return;

	area = (int64_t)(v0->fixed_x - v1->fixed_x) * (v2->fixed_y - v0->fixed_y) -
	       (int64_t)(v2->fixed_x - v0->fixed_x) * (v0->fixed_y - v1->fixed_y);
	if (area == 0)
		return;
	if (raster->farthest)
		farthest_touch(raster->farthest, (uint32_t)box.x0,
			       raster->height - 1 - (uint32_t)box.y1, (uint32_t)box.x1,
			       raster->height - 1 - (uint32_t)box.y0);
	if (area < 0) {
		const struct vertex *swap = v0;

		v0 = v1;
		v1 = swap;
	}
	edges[0] = edge_between(v0, v1);
	edges[1] = edge_between(v1, v2);
	edges[2] = edge_between(v2, v0);
	plane = depth_plane(v0, v1, v2);
	if (box.x1 - box.x0 < NARROW_PIXELS)
		fill_narrow(raster, edges, &plane, &box, item);
	else
		fill_wide(raster, edges, &plane, &box, item);
}

/* ---- clipping ---- */

struct corner {
	float clip[4];
	struct vertex vertex;
};

static float clip_distance(const float clip[4], unsigned plane)
{
	switch (plane) {
	case 0:
		return clip[3] - clip[0];
	case 1:
		return clip[0] + clip[3];
	case 2:
		return clip[3] - clip[1];
	case 3:
		return clip[1] + clip[3];
	case 4:
		return clip[2];
	default:
		return clip[3] - clip[2];
	}
}

/* The point where an edge meets a plane, counted from its nearer end. */
static void corner_between(const struct raster *raster, const struct corner *from,
			   float from_distance, const struct corner *to, float to_distance,
			   struct corner *ret)
{
	float difference = to_distance - from_distance;
	float half_width = 0.5f * (float)raster->width;
	float half_height = 0.5f * (float)raster->height;
	float reciprocal;
	float t;

	if (fabsf(to_distance) < fabsf(from_distance)) {
		const struct corner *swap = from;

		t = to_distance / difference;
		from = to;
		to = swap;
	} else {
		t = -from_distance / difference;
	}
	for (int i = 0; i < 4; i++)
		ret->clip[i] = from->clip[i] + t * (to->clip[i] - from->clip[i]);

	/* Unlike other vertices these are projected with every step rounded. */
	reciprocal = 1.0f / ret->clip[3];
	ret->vertex.x = ret->clip[0] * reciprocal * half_width + half_width;
	ret->vertex.y = ret->clip[1] * reciprocal * half_height + half_height;
	ret->vertex.z = ret->clip[2] * reciprocal;
	ret->vertex.fixed_x = subpixel(ret->vertex.x);
	ret->vertex.fixed_y = subpixel(ret->vertex.y);
	ret->vertex.flags = 0;
}

/* Cuts a polygon by one plane.  Returns: the number of corners left; 0 also if it came apart. */
static unsigned polygon_clip(const struct raster *raster, const struct corner *corners,
			     unsigned corner_count, unsigned plane, struct corner *ret)
{
	unsigned ret_count = 0;

	for (unsigned i = 0; i < corner_count; i++) {
		const struct corner *corner = &corners[i];
		const struct corner *next = &corners[(i + 1) % corner_count];
		float distance = clip_distance(corner->clip, plane);
		float next_distance = clip_distance(next->clip, plane);

		if (ret_count + 2 > POLYGON_MAX)
			return 0;
		if (distance >= 0.0f)
			ret[ret_count++] = *corner;
		if ((distance >= 0.0f) != (next_distance >= 0.0f))
			corner_between(raster, corner, distance, next, next_distance,
				       &ret[ret_count++]);
	}
	return ret_count;
}

static void triangle_clip(struct raster *raster, const uint32_t indices[3], uint32_t flags,
			  uint64_t item)
{
	struct corner polygons[2][POLYGON_MAX];
	struct corner *corners = polygons[0];
	struct corner *spare = polygons[1];
	unsigned corner_count = 3;

	for (unsigned i = 0; i < 3; i++) {
		memcpy(corners[i].clip, raster->clip[indices[i]], sizeof(corners[i].clip));
		corners[i].vertex = raster->vertices[indices[i]];
	}
	for (unsigned plane = 0; plane < CLIP_PLANES && corner_count >= 3; plane++) {
		struct corner *swap = corners;

		if (!(flags >> plane & 1))
			continue;
		corner_count = polygon_clip(raster, corners, corner_count, plane, spare);
		corners = spare;
		spare = swap;
	}
	for (unsigned i = 2; i < corner_count; i++)
		triangle_draw(raster, &corners[i - 1].vertex, &corners[i].vertex,
			      &corners[0].vertex, item);
}

/* ---- draws ---- */

static int vertices_reserve(struct raster *raster, uint32_t vertex_count)
{
	if (vertex_count <= raster->vertex_room)
		return 0;
	free(raster->vertices);
	free(raster->clip);
	raster->vertices = malloc(vertex_count * sizeof(*raster->vertices));
	raster->clip = malloc(vertex_count * sizeof(*raster->clip));
	raster->vertex_room = raster->vertices && raster->clip ? vertex_count : 0;
	return raster->vertex_room >= vertex_count ? 0 : -ENOMEM;
}

static void corners_draw(struct raster *raster, const uint32_t corners[3], uint64_t item)
{
	const struct vertex *v0 = &raster->vertices[corners[0]];
	const struct vertex *v1 = &raster->vertices[corners[1]];
	const struct vertex *v2 = &raster->vertices[corners[2]];
	uint32_t any = v0->flags | v1->flags | v2->flags;

	if (any == 0)
		triangle_draw(raster, v0, v1, v2, item);
	else if (!(v0->flags & v1->flags & v2->flags) && !(any & CLIP_NOT_FINITE))
		triangle_clip(raster, corners, any, item);
}

int raster_triangles(struct raster *raster, const struct camera_view *view,
		     const struct raster_draw *draw)
{
	struct arrays arrays = { .positions = (const uint8_t *)draw->positions,
				 .stride_bytes = 3 * sizeof(float),
				 .scale = draw->scale };

	if (vertices_reserve(raster, draw->vertex_count) < 0)
		return -ENOMEM;
	memcpy(arrays.offset, draw->offset, sizeof(arrays.offset));
	vertices_transform(raster, view, &arrays, draw->vertex_count);
	for (uint32_t i = 0; i < draw->triangle_count; i++)
		corners_draw(raster, &draw->indices[3 * (size_t)i],
			     draw->items ? draw->items[i] : draw->item_first + i);
	return 0;
}

/* The streams of a payload that rasterising needs. */
static void arrays_find(struct arrays *ret, const struct payload_header *header)
{
	const uint8_t *bytes = (const uint8_t *)header;

	*ret = (struct arrays){ .scale = (float)header->scale };
	for (unsigned i = 0; i < header->stream_count; i++) {
		const struct payload_stream *stream = &header->streams[i];

		if (stream->semantic == PAYLOAD_INDEX) {
			ret->indices = bytes + stream->offset_bytes;
			ret->has_short_indices = stream->format == PAYLOAD_U16;
		} else if (stream->semantic == PAYLOAD_POSITION) {
			ret->positions = bytes + stream->offset_bytes;
			ret->stride_bytes = stream->element_bytes;
			ret->is_u16 = stream->format == PAYLOAD_U16X3_RUN;
		}
	}
}

int raster_draw_payload(struct raster *raster, const struct camera_view *view, const void *payload,
			uint64_t item_first, uint64_t item_step)
{
	const struct payload_header *header = payload;
	struct arrays arrays;

	if (vertices_reserve(raster, header->vertex_count) < 0)
		return -ENOMEM;
	arrays_find(&arrays, header);
	camera_node_offset(view, header->origin, arrays.offset);
	vertices_transform(raster, view, &arrays, header->vertex_count);
	for (size_t i = 0; i < header->triangle_count; i++) {
		uint32_t corners[3];

		if (arrays.has_short_indices) {
			const uint16_t *indices = (const uint16_t *)arrays.indices + 3 * i;

			for (unsigned k = 0; k < 3; k++)
				corners[k] = indices[k];
		} else {
			memcpy(corners, (const uint32_t *)arrays.indices + 3 * i, sizeof(corners));
		}
		corners_draw(raster, corners, item_first + i * item_step);
	}
	return 0;
}
