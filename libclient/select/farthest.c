/* SPDX-License-Identifier: MIT */
#include "libclient/select/farthest.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define SMALL_SIDE (1u << FARTHEST_SMALL_BITS)
#define LARGE_SIDE (1u << FARTHEST_LARGE_BITS)
/** Small squares along a large one. */
#define RATIO_BITS (FARTHEST_LARGE_BITS - FARTHEST_SMALL_BITS)

int farthest_create(uint32_t width, uint32_t height, const float *depths, struct farthest **ret)
{
	struct farthest *farthest = calloc(1, sizeof(*farthest));

	if (!farthest)
		return -ENOMEM;
	farthest->width = width;
	farthest->height = height;
	farthest->depths = depths;
	farthest->small_width = (width + SMALL_SIDE - 1) / SMALL_SIDE;
	farthest->large_width = (width + LARGE_SIDE - 1) / LARGE_SIDE;
	farthest->small_count = farthest->small_width * ((height + SMALL_SIDE - 1) / SMALL_SIDE);
	farthest->large_count = farthest->large_width * ((height + LARGE_SIDE - 1) / LARGE_SIDE);
	farthest->small = calloc(farthest->small_count, sizeof(*farthest->small));
	farthest->large = calloc(farthest->large_count, sizeof(*farthest->large));
	farthest->small_stale = malloc(farthest->small_count);
	farthest->large_stale = malloc(farthest->large_count);
	if (!farthest->small || !farthest->large || !farthest->small_stale ||
	    !farthest->large_stale) {
		farthest_destroy(farthest);
		return -ENOMEM;
	}
	/* Whatever the image holds. */
	memset(farthest->small_stale, 1, farthest->small_count);
	memset(farthest->large_stale, 1, farthest->large_count);
	*ret = farthest;
	return 0;
}

struct farthest *farthest_destroy(struct farthest *farthest)
{
	if (!farthest)
		return NULL;
	free(farthest->small);
	free(farthest->large);
	free(farthest->small_stale);
	free(farthest->large_stale);
	free(farthest);
	return NULL;
}

void farthest_clear(struct farthest *farthest)
{
	memset(farthest->small, 0, farthest->small_count * sizeof(*farthest->small));
	memset(farthest->large, 0, farthest->large_count * sizeof(*farthest->large));
	memset(farthest->small_stale, 0, farthest->small_count);
	memset(farthest->large_stale, 0, farthest->large_count);
}

static uint32_t least(uint32_t a, uint32_t b)
{
	return a < b ? a : b;
}

static float small_depth(struct farthest *farthest, uint32_t x, uint32_t y)
{
	uint32_t index = y * farthest->small_width + x;
	uint32_t x0 = x * SMALL_SIDE;
	uint32_t y0 = y * SMALL_SIDE;
	uint32_t x_end = least(x0 + SMALL_SIDE, farthest->width);
	uint32_t y_end = least(y0 + SMALL_SIDE, farthest->height);
	float depth = INFINITY;

	if (!farthest->small_stale[index])
		return farthest->small[index];
	for (uint32_t row = y0; row < y_end; row++) {
		const float *depths = &farthest->depths[(size_t)row * farthest->width];

		for (uint32_t column = x0; column < x_end; column++)
			depth = depths[column] < depth ? depths[column] : depth;
	}
	farthest->small[index] = depth;
	farthest->small_stale[index] = 0;
	return depth;
}

static float large_depth(struct farthest *farthest, uint32_t x, uint32_t y)
{
	uint32_t index = y * farthest->large_width + x;
	uint32_t x_end = least((x + 1) << RATIO_BITS, farthest->small_width);
	uint32_t y_end =
		least((y + 1) << RATIO_BITS, farthest->small_count / farthest->small_width);
	float depth = INFINITY;

	if (!farthest->large_stale[index])
		return farthest->large[index];
	for (uint32_t row = y << RATIO_BITS; row < y_end; row++)
		for (uint32_t column = x << RATIO_BITS; column < x_end; column++)
			depth = fminf(depth, small_depth(farthest, column, row));
	farthest->large[index] = depth;
	farthest->large_stale[index] = 0;
	return depth;
}

/* The part of a rectangle in square x, y of 2^bits pixels. */
static struct screen_rectangle part(const struct screen_rectangle *rectangle, uint32_t x,
				    uint32_t y, unsigned bits)
{
	struct screen_rectangle square = { x << bits, y << bits, (x << bits) + (1u << bits) - 1,
					   (y << bits) + (1u << bits) - 1 };

	if (square.x0 < rectangle->x0)
		square.x0 = rectangle->x0;
	if (square.y0 < rectangle->y0)
		square.y0 = rectangle->y0;
	square.x1 = least(square.x1, rectangle->x1);
	square.y1 = least(square.y1, rectangle->y1);
	return square;
}

static bool pixels_show(const struct farthest *farthest, const struct screen_rectangle *rectangle,
			const struct screen_box *box)
{
	for (uint32_t y = rectangle->y0; y <= rectangle->y1; y++)
		for (uint32_t x = rectangle->x0; x <= rectangle->x1; x++) {
			const struct screen_rectangle pixel = { x, y, x, y };

			if (farthest->depths[(size_t)y * farthest->width + x] <=
			    screen_box_depth(box, &pixel))
				return true;
		}
	return false;
}

static bool small_shows(struct farthest *farthest, const struct screen_rectangle *rectangle,
			const struct screen_box *box)
{
	const unsigned bits = FARTHEST_SMALL_BITS;

	for (uint32_t y = rectangle->y0 >> bits; y <= rectangle->y1 >> bits; y++)
		for (uint32_t x = rectangle->x0 >> bits; x <= rectangle->x1 >> bits; x++) {
			struct screen_rectangle pixels = part(rectangle, x, y, bits);

			if (small_depth(farthest, x, y) <= screen_box_depth(box, &pixels) &&
			    pixels_show(farthest, &pixels, box))
				return true;
		}
	return false;
}

bool farthest_shows(struct farthest *farthest, const struct screen_box *box)
{
	const struct screen_rectangle *all = &box->rectangle;
	const unsigned bits = FARTHEST_LARGE_BITS;

	for (uint32_t y = all->y0 >> bits; y <= all->y1 >> bits; y++)
		for (uint32_t x = all->x0 >> bits; x <= all->x1 >> bits; x++) {
			struct screen_rectangle pixels = part(all, x, y, bits);

			if (large_depth(farthest, x, y) <= screen_box_depth(box, &pixels) &&
			    small_shows(farthest, &pixels, box))
				return true;
		}
	return false;
}
