/* SPDX-License-Identifier: MIT */
#include "viewer/image.h"

#include <errno.h>
#include <math.h>
#include <setjmp.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <png.h>

#include "formats/base/check.h"

struct image_writer {
	struct image_form form;
	char *path;
	char *part_path; /* where it is until it is whole */
	FILE *file;
	png_structp png; /* NULL: raw */
	png_infop info;
	uint8_t *row; /* of the PNG */
	struct why why;
	bool has_failed;
};

static bool ends_with(const char *text, const char *end)
{
	size_t text_length = strlen(text);
	size_t end_length = strlen(end);

	return text_length > end_length && strcmp(text + text_length - end_length, end) == 0;
}

int image_check_name(const char *path, struct why *why)
{
	if (ends_with(path, ".png") || ends_with(path, ".raw"))
		return 0;
	return why_set(why, -EINVAL, "%s: a picture's name ends in .png or .raw", path);
}

/* ---- PNG ---- */

static _Noreturn void on_png_error(png_structp png, png_const_charp message)
{
	struct image_writer *writer = png_get_error_ptr(png);

	(void)why_set(&writer->why, -EIO, "%s: %s", writer->path,
		      errno ? strerror(errno) : message);
	png_longjmp(png, 1);
}

static void on_png_warning(png_structp png, png_const_charp message)
{
	(void)png;
	(void)message;
}

static bool is_depth(const struct image_writer *writer)
{
	return writer->form.channel == CHANNEL_DEPTH;
}

/* libpng leaves its calls by longjmp(): nothing that this function has lives across them. */
static int begin_png(struct image_writer *writer)
{
	writer->png = png_create_write_struct(PNG_LIBPNG_VER_STRING, writer, on_png_error,
					      on_png_warning);
	if (writer->png)
		writer->info = png_create_info_struct(writer->png);
	writer->row = malloc((size_t)writer->form.width * 3);
	if (!writer->info || !writer->row)
		return why_errno(&writer->why, -ENOMEM, "%s", writer->path);
	if (setjmp(png_jmpbuf(writer->png)))
		return -EIO;
	png_init_io(writer->png, writer->file);
	/* Films are many pictures: the cheapest compression takes a tenth of the time of the best. */
	png_set_compression_level(writer->png, 1);
	png_set_IHDR(writer->png, writer->info, writer->form.width, writer->form.height,
		     is_depth(writer) ? 16 : 8,
		     is_depth(writer) ? PNG_COLOR_TYPE_GRAY : PNG_COLOR_TYPE_RGB,
		     PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
	if (!is_depth(writer))
		png_set_sRGB_gAMA_and_cHRM(writer->png, writer->info, PNG_sRGB_INTENT_PERCEPTUAL);
	png_write_info(writer->png, writer->info);
	return 0;
}

static uint16_t grey_of_depth(const struct image_form *form, float depth)
{
	double nearest = form->depth_range[0];
	double farthest = form->depth_range[1];
	double grey;

	if (!(depth > 0.0f) || !(farthest > nearest))
		return 0;
	grey = 1.0 + 65534.0 * (farthest - form->near / (double)depth) / (farthest - nearest);
	return (uint16_t)fmin(fmax(round(grey), 1.0), 65535.0);
}

static void convert_pixel(const struct image_form *form, const uint8_t *pixel, size_t x,
			  uint8_t *row)
{
	uint64_t item;
	float real[3];
	uint16_t grey;

	switch (form->channel) {
	case CHANNEL_COLOUR:
		memcpy(row + 3 * x, pixel, 3);
		break;
	case CHANNEL_PART:
	case CHANNEL_NODE:
	case CHANNEL_TRIANGLE:
		memcpy(&item, pixel, sizeof(item));
		memset(row + 3 * x, 0, 3);
		if (item != CHANNEL_ITEM_NONE)
			channel_item_colour(item, row + 3 * x);
		break;
	case CHANNEL_DEPTH:
		memcpy(real, pixel, sizeof(float));
		grey = grey_of_depth(form, real[0]);
		row[2 * x] = (uint8_t)(grey >> 8);
		row[2 * x + 1] = (uint8_t)grey;
		break;
	case CHANNEL_NORMAL:
		memcpy(real, pixel, sizeof(real));
		for (int k = 0; k < 3; k++)
			row[3 * x + (size_t)k] = (uint8_t)lrintf(127.5f + 127.5f * real[k]);
		if (real[0] == 0.0f && real[1] == 0.0f && real[2] == 0.0f)
			memset(row + 3 * x, 0, 3);
		break;
	case CHANNEL_COUNT_:
		break;
	}
}

static int write_png_row(struct image_writer *writer, const uint8_t *pixels)
{
	size_t pixel_bytes = channel_pixel_bytes(writer->form.channel);

	for (size_t x = 0; x < writer->form.width; x++)
		convert_pixel(&writer->form, pixels + x * pixel_bytes, x, writer->row);
	if (setjmp(png_jmpbuf(writer->png)))
		return -EIO;
	png_write_row(writer->png, writer->row);
	return 0;
}

static int end_png(struct image_writer *writer)
{
	if (setjmp(png_jmpbuf(writer->png)))
		return -EIO;
	png_write_end(writer->png, writer->info);
	return 0;
}

/* ---- raw ---- */

static int write_raw(struct image_writer *writer, const void *bytes, size_t size_bytes)
{
	if (size_bytes > 0 && fwrite(bytes, size_bytes, 1, writer->file) != 1)
		return why_errno(&writer->why, -errno, "%s", writer->path);
	return 0;
}

static int begin_raw(struct image_writer *writer)
{
	struct image_raw_header header = {
		.version = IMAGE_RAW_VERSION,
		.channel = writer->form.channel,
		.width = writer->form.width,
		.height = writer->form.height,
		.pixel_bytes = (uint32_t)channel_pixel_bytes(writer->form.channel),
		.near = writer->form.near,
	};

	memcpy(header.magic, IMAGE_RAW_MAGIC, sizeof(header.magic));
	return write_raw(writer, &header, sizeof(header));
}

/* ---- both ---- */

int image_create(const char *path, const struct image_form *form, struct image_writer **ret,
		 struct why *why)
{
	struct image_writer *writer;
	int r = image_check_name(path, why);

	if (r < 0)
		return r;
	writer = calloc(1, sizeof(*writer));
	if (!writer)
		return why_errno(why, -ENOMEM, "%s", path);
	writer->form = *form;
	writer->path = strdup(path);
	if (!writer->path || asprintf(&writer->part_path, "%s.part%d", path, (int)getpid()) < 0) {
		writer->part_path = NULL;
		r = why_errno(&writer->why, -ENOMEM, "%s", path);
		goto err_abandon;
	}
	writer->file = fopen(writer->part_path, "wbxe");
	if (!writer->file) {
		r = why_errno(&writer->why, -errno, "%s", path);
		goto err_abandon;
	}
	errno = 0;
	r = ends_with(path, ".png") ? begin_png(writer) : begin_raw(writer);
	if (r < 0)
		goto err_abandon;
	*ret = writer;
	return 0;

err_abandon:
	if (why)
		*why = writer->why;
	image_abandon(writer);
	return r;
}

int image_write_rows(struct image_writer *writer, const void *pixels, uint32_t row_count,
		     struct why *why)
{
	size_t row_bytes = writer->form.width * channel_pixel_bytes(writer->form.channel);
	int r = 0;

	CHECK(!writer->has_failed);
	errno = 0;
	if (!writer->png)
		r = write_raw(writer, pixels, row_count * row_bytes);
	for (uint32_t y = 0; writer->png && y < row_count && r == 0; y++)
		r = write_png_row(writer, (const uint8_t *)pixels + y * row_bytes);
	writer->has_failed = r < 0;
	if (r < 0 && why)
		*why = writer->why;
	return r;
}

int image_commit(struct image_writer *writer, struct why *why)
{
	FILE *file = writer->file;
	int r = 0;

	CHECK(!writer->has_failed);
	errno = 0;
	if (writer->png)
		r = end_png(writer);
	/* Closed is closed, also where it says that it could not write. */
	writer->file = NULL;
	if (fclose(file) != 0 && r == 0)
		r = why_errno(&writer->why, -errno, "%s", writer->path);
	if (r == 0 && rename(writer->part_path, writer->path) < 0)
		r = why_errno(&writer->why, -errno, "%s", writer->path);
	if (r == 0) {
		/* Nothing is left to be removed. */
		free(writer->part_path);
		writer->part_path = NULL;
	} else if (why) {
		*why = writer->why;
	}
	image_abandon(writer);
	return r;
}

struct image_writer *image_abandon(struct image_writer *writer)
{
	if (!writer)
		return NULL;
	if (writer->png)
		png_destroy_write_struct(&writer->png, &writer->info);
	if (writer->file)
		(void)fclose(writer->file);
	if (writer->part_path) {
		(void)unlink(writer->part_path);
		free(writer->part_path);
	}
	free(writer->path);
	free(writer->row);
	free(writer);
	return NULL;
}
