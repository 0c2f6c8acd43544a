/* SPDX-License-Identifier: MIT */
#include "tools/bench/base/rgb_image.h"

#include <errno.h>
#include <png.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "formats/base/check.h"

/* Of either side, so that a size that a file claims is bounded. */
#define SIDE_MAX 16384u

static int image_make(uint32_t width, uint32_t height, struct rgb_image *ret)
{
	uint8_t *pixels = calloc((size_t)width * height + 1, 3);

	if (!pixels)
		return -ENOMEM;
	*ret = (struct rgb_image){ width, height, pixels };
	return 0;
}

void rgb_image_done(struct rgb_image *image)
{
	free(image->pixels);
	*image = (struct rgb_image){ .pixels = NULL };
}

int rgb_image_read(const char *path, struct rgb_image *ret, struct why *why)
{
	png_image png = { .version = PNG_IMAGE_VERSION };
	struct rgb_image image;
	int r;

	if (access(path, R_OK) < 0)
		return why_errno(why, -errno, "%s", path);
	if (!png_image_begin_read_from_file(&png, path))
		return why_set(why, -EUCLEAN, "%s: %s", path, png.message);
	if (png.width == 0 || png.height == 0 || png.width > SIDE_MAX || png.height > SIDE_MAX)
		r = why_set(why, -EUCLEAN, "%s: %u x %u pixels", path, png.width, png.height);
	else
		r = image_make(png.width, png.height, &image);
	if (r < 0) {
		png_image_free(&png);
		return r == -ENOMEM ? why_set(why, r, "%s: out of memory", path) : r;
	}
	png.format = PNG_FORMAT_RGB;
	if (!png_image_finish_read(&png, NULL, image.pixels, 0, NULL)) {
		rgb_image_done(&image);
		return why_set(why, -EUCLEAN, "%s: %s", path, png.message);
	}
	*ret = image;
	return 0;
}

int rgb_image_encode(const struct rgb_image *image, uint8_t **ret, size_t *ret_bytes)
{
	png_image png = { .version = PNG_IMAGE_VERSION,
			  .width = image->width,
			  .height = image->height,
			  .format = PNG_FORMAT_RGB };
	png_alloc_size_t bytes = PNG_IMAGE_PNG_SIZE_MAX(png);
	uint8_t *memory = malloc(bytes);

	if (!memory)
		return -ENOMEM;
	if (!png_image_write_to_memory(&png, memory, &bytes, 0, image->pixels, 0, NULL)) {
		free(memory);
		return -ENOMEM;
	}
	*ret = memory;
	*ret_bytes = bytes;
	return 0;
}

/* Pixel `at` of `count` lies over this stretch of the source. */
static void stretch(uint32_t at, uint32_t count, uint32_t source_count, uint32_t *ret_begin,
		    uint32_t *ret_end)
{
	*ret_begin = (uint32_t)((uint64_t)at * source_count / count);
	*ret_end = (uint32_t)((uint64_t)(at + 1) * source_count / count);
	if (*ret_end <= *ret_begin)
		*ret_end = *ret_begin + 1;
}

int rgb_image_scale(const struct rgb_image *image, uint32_t width, uint32_t height,
		    struct rgb_image *ret)
{
	struct rgb_image scaled;

	if (image_make(width, height, &scaled) < 0)
		return -ENOMEM;
	for (uint32_t y = 0; y < height; y++)
		for (uint32_t x = 0; x < width; x++) {
			uint32_t sum[3] = { 0 };
			uint32_t x0, x1, y0, y1;
			uint32_t count;

			stretch(x, width, image->width, &x0, &x1);
			stretch(y, height, image->height, &y0, &y1);
			count = (x1 - x0) * (y1 - y0);
			for (uint32_t v = y0; v < y1; v++)
				for (uint32_t u = x0; u < x1; u++)
					for (unsigned k = 0; k < 3; k++)
						sum[k] += image->pixels[3 * ((size_t)v *
										     image->width +
									     u) +
									k];
			for (unsigned k = 0; k < 3; k++)
				scaled.pixels[3 * ((size_t)y * width + x) + k] =
					(uint8_t)((sum[k] + count / 2) / count);
		}
	*ret = scaled;
	return 0;
}

uint64_t rgb_image_differing(const struct rgb_image *a, const struct rgb_image *b,
			     uint8_t threshold)
{
	size_t pixel_count = (size_t)a->width * a->height;
	uint64_t differing = 0;

	CHECK(a->width == b->width && a->height == b->height);
	for (size_t i = 0; i < pixel_count; i++) {
		int greatest = 0;

		for (unsigned k = 0; k < 3; k++) {
			int difference = abs(a->pixels[3 * i + k] - b->pixels[3 * i + k]);

			greatest = difference > greatest ? difference : greatest;
		}
		differing += greatest > threshold;
	}
	return differing;
}

int rgb_image_of_errors(const float *errors, uint32_t width, uint32_t height, struct rgb_image *ret)
{
	size_t pixel_count = (size_t)width * height;
	struct rgb_image image;

	if (image_make(width, height, &image) < 0)
		return -ENOMEM;
	for (size_t i = 0; i < pixel_count; i++)
		for (unsigned k = 0; k < 3; k++) {
			/* Red rises over the first third, green over the second, blue over the last. */
			float value = 3.0f * errors[i] - (float)k;

			value = value < 0.0f ? 0.0f : value > 1.0f ? 1.0f : value;
			image.pixels[3 * i + k] = (uint8_t)(255.0f * value + 0.5f);
		}
	*ret = image;
	return 0;
}
