/* SPDX-License-Identifier: MIT */
#include "libclient/select/birds_eye.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Around the model, in shares of the picture. */
#define MARGIN 0.04
/* Octree levels are told apart up to here. */
#define LEVEL_COUNT 16u

const char *const birds_eye_colourings[] = { "state", "priority", "level", NULL };

static const struct {
	const char *name;
	uint8_t colour[3];
} states[BIRDS_EYE_STATE_COUNT_] = {
	[BIRDS_EYE_NOTHING] = { "nothing", { 24, 26, 30 } },
	[BIRDS_EYE_ABSENT] = { "absent", { 58, 62, 70 } },
	[BIRDS_EYE_BUSY] = { "busy", { 236, 200, 60 } },
	[BIRDS_EYE_READY] = { "ready", { 70, 120, 190 } },
	[BIRDS_EYE_HELD] = { "held", { 80, 180, 100 } },
	[BIRDS_EYE_DAMAGED] = { "damaged", { 210, 60, 50 } },
};

static const uint8_t wanted_colour[3] = { 255, 255, 255 };
static const uint8_t expected_colour[3] = { 245, 150, 40 };
static const uint8_t camera_colour[3] = { 255, 90, 160 };

const char *birds_eye_state_name(enum birds_eye_state state)
{
	return states[state].name;
}

void birds_eye_state_colour(enum birds_eye_state state, uint8_t ret[3])
{
	memcpy(ret, states[state].colour, 3);
}

/* Where the picture's pixels lie over the model. */
struct canvas {
	uint8_t *rgb;
	uint32_t width;
	uint32_t height;
	unsigned across, along, up; /* axes: to the right, to the top, towards the eye */
	double centre[2];           /* model units from the store's origin */
	double scale;               /* pixels a unit */
};

static void canvas_init(struct canvas *canvas, const struct store_superblock *superblock,
			uint32_t width, uint32_t height, uint8_t *rgb)
{
	double extent[2];

	*canvas = (struct canvas){ .rgb = rgb, .width = width, .height = height };
	canvas->up = superblock->up_axis == STORE_AXIS_UNKNOWN ? 2 : superblock->up_axis - 1;
	canvas->across = (canvas->up + 1) % 3;
	canvas->along = (canvas->up + 2) % 3;
	for (unsigned k = 0; k < 2; k++) {
		unsigned axis = k == 0 ? canvas->across : canvas->along;

		canvas->centre[k] = 0.5 * (superblock->box_min[axis] + superblock->box_max[axis]);
		extent[k] = superblock->box_max[axis] - superblock->box_min[axis];
	}
	canvas->scale = fmin(width / fmax(extent[0], 1e-9), height / fmax(extent[1], 1e-9)) *
			(1.0 - 2.0 * MARGIN);
}

static double pixel_x(const struct canvas *canvas, double value)
{
	return 0.5 * canvas->width + (value - canvas->centre[0]) * canvas->scale;
}

static double pixel_y(const struct canvas *canvas, double value)
{
	return 0.5 * canvas->height - (value - canvas->centre[1]) * canvas->scale;
}

static void put(const struct canvas *canvas, int x, int y, const uint8_t colour[3])
{
	if (x >= 0 && y >= 0 && x < (int)canvas->width && y < (int)canvas->height)
		memcpy(&canvas->rgb[3 * ((size_t)y * canvas->width + (size_t)x)], colour, 3);
}

static int clamp(double value, uint32_t count)
{
	return (int)fmin(fmax(floor(value), 0.0), (double)count - 1.0);
}

/* A box and its border.  Never less than a pixel, and then without a border. */
static void put_box(const struct canvas *canvas, const struct store_node *record,
		    const uint8_t fill[3], const uint8_t border[3])
{
	int x0 = clamp(pixel_x(canvas, record->box_min[canvas->across]), canvas->width);
	int x1 = clamp(pixel_x(canvas, record->box_max[canvas->across]), canvas->width);
	int y0 = clamp(pixel_y(canvas, record->box_max[canvas->along]), canvas->height);
	int y1 = clamp(pixel_y(canvas, record->box_min[canvas->along]), canvas->height);

	for (int y = y0; y <= y1; y++)
		for (int x = x0; x <= x1; x++) {
			bool is_border = x == x0 || x == x1 || y == y0 || y == y1;

			put(canvas, x, y, is_border && x1 > x0 && y1 > y0 ? border : fill);
		}
}

static void put_line(const struct canvas *canvas, double x0, double y0, double x1, double y1,
		     const uint8_t colour[3])
{
	double steps = fmax(1.0, fmax(fabs(x1 - x0), fabs(y1 - y0)));

	for (double i = 0.0; i <= steps; i += 1.0)
		put(canvas, (int)floor(x0 + (x1 - x0) * i / steps),
		    (int)floor(y0 + (y1 - y0) * i / steps), colour);
}

/* The eye, and the sides of what it sees, to the picture's edge. */
static void put_camera(const struct canvas *canvas, const struct birds_eye *birds_eye)
{
	const struct store_superblock *superblock = birds_eye->superblock;
	double right[3];
	double up[3];
	double forward[3];
	double tan_half =
		tan(birds_eye->camera->fov_y_degrees * (M_PI / 360.0)) * birds_eye->aspect;
	double reach = (double)canvas->width + canvas->height;
	double eye[2];

	if (!camera_axes(birds_eye->camera, right, up, forward))
		return;
	eye[0] = pixel_x(canvas, birds_eye->camera->eye[canvas->across] -
					 superblock->origin[canvas->across]);
	eye[1] = pixel_y(canvas,
			 birds_eye->camera->eye[canvas->along] - superblock->origin[canvas->along]);
	for (int side = -1; side <= 1; side += 2) {
		double x = forward[canvas->across] + side * tan_half * right[canvas->across];
		double y = -(forward[canvas->along] + side * tan_half * right[canvas->along]);
		double length = hypot(x, y);

		if (length > 1e-9)
			put_line(canvas, eye[0], eye[1], eye[0] + x / length * reach,
				 eye[1] + y / length * reach, camera_colour);
	}
	for (int dy = -2; dy <= 2; dy++)
		for (int dx = -2; dx <= 2; dx++)
			put(canvas, (int)floor(eye[0]) + dx, (int)floor(eye[1]) + dy,
			    camera_colour);
}

/* From blue over green to red, 0 .. 1. */
static void ramp(double value, uint8_t ret[3])
{
	double t = fmin(fmax(value, 0.0), 1.0);

	ret[0] = (uint8_t)(60.0 + 180.0 * fmin(1.0, 2.0 * t));
	ret[1] = (uint8_t)(60.0 + 160.0 * (1.0 - fabs(2.0 * t - 1.0)));
	ret[2] = (uint8_t)(60.0 + 180.0 * fmin(1.0, 2.0 * (1.0 - t)));
}

static void fill_of(const struct birds_eye *birds_eye, uint32_t index, uint8_t ret[3])
{
	const struct birds_eye_node *node = &birds_eye->nodes[index];

	switch (birds_eye->colouring) {
	case BIRDS_EYE_BY_PRIORITY:
		if (node->is_wanted)
			ramp(1.0 - (double)node->set_place /
					     fmax(1.0, (double)birds_eye->want_count - 1.0),
			     ret);
		else
			birds_eye_state_colour(BIRDS_EYE_ABSENT, ret);
		return;
	case BIRDS_EYE_BY_LEVEL:
		ramp((double)birds_eye->records[index].level / LEVEL_COUNT, ret);
		return;
	case BIRDS_EYE_BY_STATE:
	case BIRDS_EYE_COLOURING_COUNT_:
		break;
	}
	birds_eye_state_colour((enum birds_eye_state)node->state, ret);
}

struct by_height {
	const struct store_node *records;
	unsigned up;
};

static int compare_heights(const void *left, const void *right, void *arg)
{
	const struct by_height *by = arg;
	uint32_t a = *(const uint32_t *)left;
	uint32_t b = *(const uint32_t *)right;
	float of_a = by->records[a].box_min[by->up];
	float of_b = by->records[b].box_min[by->up];

	if (of_a != of_b)
		return of_a < of_b ? -1 : 1;
	return a < b ? -1 : a > b;
}

/* How high it is painted: to the eye's height, if the eye is in the model's box. */
static double ceiling_of(const struct birds_eye *birds_eye, unsigned up)
{
	const struct store_superblock *superblock = birds_eye->superblock;
	double eye[3];

	if (!birds_eye->camera)
		return INFINITY;
	for (unsigned k = 0; k < 3; k++) {
		eye[k] = birds_eye->camera->eye[k] - superblock->origin[k];
		if (eye[k] < superblock->box_min[k] || eye[k] > superblock->box_max[k])
			return INFINITY;
	}
	return eye[up];
}

void birds_eye_paint(const struct birds_eye *birds_eye, uint32_t width, uint32_t height,
		     uint32_t *scratch, uint8_t *rgb)
{
	size_t node_count = birds_eye->superblock->node_count;
	size_t count = 0;
	struct canvas canvas;
	struct by_height by;
	double ceiling;

	for (size_t i = 0; i < (size_t)width * height; i++)
		memcpy(&rgb[3 * i], states[BIRDS_EYE_NOTHING].colour, 3);
	canvas_init(&canvas, birds_eye->superblock, width, height, rgb);
	ceiling = ceiling_of(birds_eye, canvas.up);
	by = (struct by_height){ birds_eye->records, canvas.up };
	for (uint32_t i = 0; i < node_count; i++)
		if (birds_eye->nodes[i].state != BIRDS_EYE_NOTHING &&
		    birds_eye->records[i].box_min[canvas.up] <= ceiling)
			scratch[count++] = i;
	qsort_r(scratch, count, sizeof(*scratch), compare_heights, &by);
	for (size_t i = 0; i < count; i++) {
		const struct birds_eye_node *node = &birds_eye->nodes[scratch[i]];
		uint8_t fill[3];
		uint8_t darker[3];

		fill_of(birds_eye, scratch[i], fill);
		for (unsigned k = 0; k < 3; k++)
			darker[k] = (uint8_t)(fill[k] * 3 / 4);
		put_box(&canvas, &birds_eye->records[scratch[i]], fill,
			node->is_wanted     ? wanted_colour
			: node->is_expected ? expected_colour
					    : darker);
	}
	if (birds_eye->camera)
		put_camera(&canvas, birds_eye);
}
