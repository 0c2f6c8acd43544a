/* SPDX-License-Identifier: MIT */
#include "formats/import/texture_image.h"

#include <errno.h>
#include <fcntl.h>
#include <setjmp.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <jpeglib.h>

#include <jerror.h>
#include <png.h>

#include "formats/base/bytes.h"

#define SIGNATURE_BYTES 8u
/* Chunks of a PNG file beside its pixels: profiles and texts that nobody reads. */
#define PNG_CHUNK_BYTES_MAX MIB
/* A few bytes can say one more scan over all of a progressive JPEG; real ones have about ten. */
#define JPEG_SCANS_MAX 100
/* Of a coefficient of a JPEG block, and of these in a block. */
#define JPEG_BLOCK_BYTES 128u

/* An image that is being read.  Both libraries leave by longjmp() when they fail. */
struct reading {
	const struct texture_image_sink *sink;
	struct why *why;
	FILE *file;
	int result;
	jmp_buf leave;
	uint8_t *pixels; /* a row, or all of them */

	png_structp png;
	png_infop png_info;

	struct jpeg_decompress_struct jpeg;
	struct jpeg_error_mgr jpeg_errors;
	struct jpeg_progress_mgr jpeg_progress;
};

static _Noreturn void leave(struct reading *reading, int result)
{
	reading->result = result;
	longjmp(reading->leave, 1);
}

/* Judges the size and tells the sink of it.  Only with both is anything made for the pixels. */
static void begin(struct reading *reading, uint64_t width, uint64_t height, uint64_t held_bytes)
{
	int r;

	if (width == 0 || height == 0)
		leave(reading, why_set(reading->why, -EUCLEAN, "an image without pixels"));
	if (width > TEXTURE_IMAGE_SIDE_MAX || height > TEXTURE_IMAGE_SIDE_MAX ||
	    width * height > TEXTURE_IMAGE_PIXELS_MAX)
		leave(reading, why_set(reading->why, -EFBIG, "an image of %llu x %llu pixels",
				       (unsigned long long)width, (unsigned long long)height));
	r = reading->sink->begin(reading->sink->arg, (uint32_t)width, (uint32_t)height, held_bytes,
				 reading->why);
	if (r < 0)
		leave(reading, r);
}

static void make_pixels(struct reading *reading, size_t size_bytes)
{
	reading->pixels = malloc(size_bytes);
	if (!reading->pixels)
		leave(reading, why_set(reading->why, -ENOMEM, "no memory for an image"));
}

/* ---- PNG ---- */

static _Noreturn void on_png_error(png_structp png, png_const_charp text)
{
	struct reading *reading = png_get_error_ptr(png);

	/* What was said already is the cause of this. */
	leave(reading, reading->result < 0 ? reading->result
					   : why_set(reading->why, -EUCLEAN, "PNG: %s", text));
}

static void on_png_warning(png_structp png, png_const_charp text)
{
	(void)png;
	(void)text;
}

static png_voidp png_make(png_structp png, png_alloc_size_t size_bytes)
{
	struct reading *reading = png_get_mem_ptr(png);
	void *room = malloc(size_bytes);

	if (!room)
		reading->result = why_set(reading->why, -ENOMEM, "no memory for an image");
	return room;
}

static void png_unmake(png_structp png, png_voidp room)
{
	(void)png;
	free(room);
}

/* Whatever the file has becomes rows of 8-bit red, green, blue. */
static void png_want_rgb(struct reading *reading)
{
	png_set_expand(reading->png);
	png_set_scale_16(reading->png);
	png_set_gray_to_rgb(reading->png);
	png_set_strip_alpha(reading->png);
	png_read_update_info(reading->png, reading->png_info);
}

static void png_rows(struct reading *reading)
{
	uint32_t width, height;
	bool interlaced;
	int passes;

	png_set_user_limits(reading->png, PNG_UINT_31_MAX, PNG_UINT_31_MAX);
	png_set_chunk_malloc_max(reading->png, PNG_CHUNK_BYTES_MAX);
	png_init_io(reading->png, reading->file);
	png_read_info(reading->png, reading->png_info);
	width = png_get_image_width(reading->png, reading->png_info);
	height = png_get_image_height(reading->png, reading->png_info);
	interlaced = png_get_interlace_type(reading->png, reading->png_info) != PNG_INTERLACE_NONE;
	begin(reading, width, height, interlaced ? UINT64_C(3) * width * height : 0);
	passes = png_set_interlace_handling(reading->png);
	png_want_rgb(reading);
	make_pixels(reading, (size_t)3 * width * (interlaced ? height : 1));
	for (int pass = 0; pass < passes; pass++)
		for (uint32_t y = 0; y < height; y++) {
			png_read_row(reading->png,
				     reading->pixels + (interlaced ? (size_t)3 * width * y : 0),
				     NULL);
			if (!interlaced)
				reading->sink->row(reading->sink->arg, reading->pixels);
		}
	for (uint32_t y = 0; y < height && interlaced; y++)
		reading->sink->row(reading->sink->arg, reading->pixels + (size_t)3 * width * y);
}

static void png_read(struct reading *reading)
{
	if (setjmp(reading->leave) == 0) {
		reading->png =
			png_create_read_struct_2(PNG_LIBPNG_VER_STRING, reading, on_png_error,
						 on_png_warning, reading, png_make, png_unmake);
		if (reading->png)
			reading->png_info = png_create_info_struct(reading->png);
		if (reading->png_info)
			png_rows(reading);
		else
			reading->result = why_set(reading->why, -ENOMEM, "no memory for an image");
	}
	png_destroy_read_struct(&reading->png, &reading->png_info, NULL);
}

/* ---- JPEG ---- */

static _Noreturn void on_jpeg_error(j_common_ptr jpeg)
{
	struct reading *reading = jpeg->client_data;
	char text[JMSG_LENGTH_MAX];

	jpeg->err->format_message(jpeg, text);
	leave(reading,
	      why_set(reading->why, jpeg->err->msg_code == JERR_OUT_OF_MEMORY ? -ENOMEM : -EUCLEAN,
		      "JPEG: %s", text));
}

/* Damage that the decoder survives is looked at no further, but a file that ends is cut off. */
static void on_jpeg_message(j_common_ptr jpeg, int level)
{
	if (level < 0 && jpeg->err->msg_code == JWRN_JPEG_EOF)
		leave(jpeg->client_data, why_set(((struct reading *)jpeg->client_data)->why,
						 -EUCLEAN, "JPEG: it ends too early"));
}

static void on_jpeg_progress(j_common_ptr jpeg)
{
	if (((j_decompress_ptr)jpeg)->input_scan_number > JPEG_SCANS_MAX)
		leave(jpeg->client_data, why_set(((struct reading *)jpeg->client_data)->why,
						 -EUCLEAN, "JPEG: too many scans"));
}

static uint64_t jpeg_held_bytes(j_decompress_ptr jpeg)
{
	uint64_t held_bytes = 0;

	if (!jpeg_has_multiple_scans(jpeg))
		return 0;
	for (int i = 0; i < jpeg->num_components; i++)
		held_bytes += (uint64_t)jpeg->comp_info[i].width_in_blocks *
			      jpeg->comp_info[i].height_in_blocks * JPEG_BLOCK_BYTES;
	return held_bytes;
}

static void jpeg_rows(struct reading *reading)
{
	j_decompress_ptr jpeg = &reading->jpeg;

	jpeg_stdio_src(jpeg, reading->file);
	(void)jpeg_read_header(jpeg, TRUE);
	begin(reading, jpeg->image_width, jpeg->image_height, jpeg_held_bytes(jpeg));
	jpeg->out_color_space = JCS_RGB;
	(void)jpeg_start_decompress(jpeg);
	make_pixels(reading, (size_t)3 * jpeg->output_width);
	while (jpeg->output_scanline < jpeg->output_height) {
		(void)jpeg_read_scanlines(jpeg, &reading->pixels, 1);
		reading->sink->row(reading->sink->arg, reading->pixels);
	}
	(void)jpeg_finish_decompress(jpeg);
}

static void jpeg_read(struct reading *reading)
{
	reading->jpeg.err = jpeg_std_error(&reading->jpeg_errors);
	reading->jpeg_errors.error_exit = on_jpeg_error;
	reading->jpeg_errors.emit_message = on_jpeg_message;
	reading->jpeg_progress.progress_monitor = on_jpeg_progress;
	reading->jpeg.client_data = reading;
	if (setjmp(reading->leave) == 0) {
		jpeg_create_decompress(&reading->jpeg);
		reading->jpeg.progress = &reading->jpeg_progress;
		jpeg_rows(reading);
	}
	jpeg_destroy_decompress(&reading->jpeg);
}

/* ---- both ---- */

/* A pipe or a device would keep us waiting. */
static int open_regular(const char *path, FILE **ret, struct why *why)
{
	int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
	struct stat status;

	if (fd < 0)
		return why_set(why, -errno, "%s", strerror(errno));
	if (fstat(fd, &status) < 0 || !S_ISREG(status.st_mode)) {
		(void)close(fd);
		return why_set(why, -EINVAL, "no regular file");
	}
	*ret = fdopen(fd, "rb");
	if (!*ret) {
		(void)close(fd);
		return why_set(why, -ENOMEM, "no memory to read it");
	}
	return 0;
}

int texture_image_read(const char *path, const struct texture_image_sink *sink, struct why *why)
{
	uint8_t signature[SIGNATURE_BYTES] = { 0 };
	struct reading *reading = calloc(1, sizeof(*reading));
	int r;

	if (!reading)
		return why_set(why, -ENOMEM, "no memory to read it");
	reading->sink = sink;
	reading->why = why;
	r = open_regular(path, &reading->file, why);
	if (r < 0) {
		free(reading);
		return r;
	}
	(void)fread(signature, 1, sizeof(signature), reading->file);
	rewind(reading->file);
	if (png_sig_cmp(signature, 0, sizeof(signature)) == 0)
		png_read(reading);
	else if (signature[0] == 0xff && signature[1] == 0xd8)
		jpeg_read(reading);
	else
		reading->result = why_set(why, -EUCLEAN, "neither PNG nor JPEG");
	r = reading->result;
	(void)fclose(reading->file);
	free(reading->pixels);
	free(reading);
	return r;
}
