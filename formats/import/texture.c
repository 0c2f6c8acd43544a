/* SPDX-License-Identifier: MIT */
#include "formats/import/texture.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "formats/import/texture_image.h"

/* So many may be read again before we say that memory is too little for it: about a minute. */
#define PIXELS_AGAIN_MAX (UINT64_C(1) << 32)
/* Repeats beyond this are of no meaning, and within it coordinates are exact enough. */
#define COORDINATE_MAX 1e6

void textures_init(struct textures *textures, uint64_t bytes_max)
{
	*textures = (struct textures){ .bytes_max = bytes_max - bytes_max / 8 };
	/* The paths' share is small: they are names of files that a library can list. */
	names_init(&textures->paths, bytes_max / 8);
	for (int i = 0; i < 256; i++) {
		double byte = i / 255.0;
		double light = byte <= 0.04045 ? byte / 12.92 : pow((byte + 0.055) / 1.055, 2.4);

		textures->linear[i] = (uint16_t)(light * 65535.0 + 0.5);
	}
}

void textures_done(struct textures *textures)
{
	for (uint32_t i = 0; i < textures->paths.count && i < textures->capacity; i++)
		free(textures->textures[i].texels);
	free(textures->textures);
	names_done(&textures->paths);
	*textures = (struct textures){ 0 };
}

int textures_add(struct textures *textures, const char *path, uint32_t *ret_number, struct why *why)
{
	uint32_t number = names_find(&textures->paths, path);
	int r;

	if (number != UINT32_MAX) {
		*ret_number = number;
		return 0;
	}
	if (textures->paths.count == textures->capacity) {
		uint32_t capacity = textures->capacity ? 2 * textures->capacity : 16;
		struct texture *grown = realloc(textures->textures, capacity * sizeof(*grown));

		if (!grown)
			return why_set(why, -ENOMEM, "no memory for its textures");
		textures->textures = grown;
		textures->capacity = capacity;
	}
	r = names_add(&textures->paths, path, &number, why);
	if (r < 0)
		return r;
	textures->textures[number] = (struct texture){ .path = names_text(&textures->paths, path) };
	*ret_number = number;
	return 0;
}

/* ---- pyramids ---- */

/* The byte whose light is nearest. */
static uint8_t to_byte(const struct textures *textures, uint32_t light)
{
	uint32_t low = 0, high = 255;

	while (low < high) {
		uint32_t middle = (low + high + 1) / 2;
		uint32_t border =
			(textures->linear[middle - 1] + textures->linear[middle] + 1u) / 2;

		if (light >= border)
			low = middle;
		else
			high = middle - 1;
	}
	return (uint8_t)low;
}

/* One level of a pyramid. */
struct level {
	uint32_t width;
	uint32_t height;
	uint64_t offset; /* of its texels */
	double texel;    /* pixels of the image along a texel's side */
};

static struct level level_of(const struct texture *texture, uint32_t number)
{
	struct level level = {
		.width = (texture->image_width + texture->factor - 1) / texture->factor,
		.height = (texture->image_height + texture->factor - 1) / texture->factor,
		.texel = texture->factor,
	};

	for (uint32_t i = 0; i < number; i++) {
		level.offset += UINT64_C(3) * level.width * level.height;
		level.width = (level.width + 1) / 2;
		level.height = (level.height + 1) / 2;
		level.texel *= 2;
	}
	return level;
}

/* What is in memory and was used longest ago, or NULL. */
static struct texture *find_oldest(struct textures *textures)
{
	struct texture *oldest = NULL;

	for (uint32_t i = 0; i < textures->paths.count; i++) {
		struct texture *texture = &textures->textures[i];

		if (texture->texels && (!oldest || texture->last_use < oldest->last_use))
			oldest = texture;
	}
	return oldest;
}

static void forget(struct textures *textures, struct texture *texture)
{
	if (texture->texels)
		textures->bytes -= texture->size_bytes;
	free(texture->texels);
	texture->texels = NULL;
}

/* An image whose rows become a pyramid. */
struct intake {
	struct textures *textures;
	struct texture *texture;
	uint32_t *sums; /* light of the row of texels at hand, 3 a texel */
	uint32_t row;   /* of the image */
};

static int on_begin(void *arg, uint32_t width, uint32_t height, uint64_t held_bytes,
		    struct why *why)
{
	struct intake *intake = arg;
	struct textures *textures = intake->textures;
	struct texture *texture = intake->texture;
	uint64_t wanted_bytes;
	struct level last;

	texture->image_width = width;
	texture->image_height = height;
	texture->factor = 1;
	while ((width - 1) / texture->factor >= TEXTURE_SIDE_MAX ||
	       (height - 1) / texture->factor >= TEXTURE_SIDE_MAX)
		texture->factor *= 2;
	texture->level_count = 0;
	do
		last = level_of(texture, texture->level_count++);
	while (last.width > 1 || last.height > 1);
	CHECK(texture->level_count <= TEXTURE_LEVELS_MAX);
	texture->size_bytes = last.offset + 3;
	wanted_bytes = texture->size_bytes + held_bytes;
	while (textures->bytes > 0 && textures->bytes + wanted_bytes > textures->bytes_max)
		forget(textures, find_oldest(textures));
	if (wanted_bytes > textures->bytes_max)
		return why_set(
			why, -ENOMEM,
			"%llu KiB are wanted and %llu KiB are for textures: give more memory",
			(unsigned long long)(wanted_bytes / KIB),
			(unsigned long long)(textures->bytes_max / KIB));
	if (texture->seen)
		textures->pixels_again += (uint64_t)width * height;
	if (textures->pixels_again > PIXELS_AGAIN_MAX)
		return why_set(why, -ENOMEM,
			       "faces change too often between more textures than "
			       "fit in memory");
	texture->texels = malloc(texture->size_bytes);
	intake->sums = calloc((size_t)level_of(texture, 0).width * 3, sizeof(*intake->sums));
	if (!texture->texels || !intake->sums)
		return why_set(why, -ENOMEM, "no memory for a texture");
	return 0;
}

/* Makes texels of the sums. */
static void end_texels(struct intake *intake, uint32_t row_count)
{
	const struct texture *texture = intake->texture;
	uint32_t width = level_of(texture, 0).width;
	size_t texel_row = (intake->row - 1) / texture->factor;
	uint8_t *to = texture->texels + texel_row * width * 3;

	for (uint32_t x = 0; x < width; x++) {
		uint32_t begin = x * texture->factor;
		uint32_t column_count = texture->image_width - begin < texture->factor
						? texture->image_width - begin
						: texture->factor;
		uint32_t count = column_count * row_count;

		for (uint32_t k = 0; k < 3; k++) {
			uint32_t *sum = &intake->sums[3 * (size_t)x + k];

			*to++ = to_byte(intake->textures, (*sum + count / 2) / count);
			*sum = 0;
		}
	}
}

static void on_row(void *arg, const uint8_t *rgb)
{
	struct intake *intake = arg;
	const struct texture *texture = intake->texture;
	uint32_t *sum = intake->sums;
	uint32_t row_count;

	/* Factors are at most 128: a sum of light cannot overflow. */
	for (uint32_t x = 0; x < texture->image_width; x++, rgb += 3) {
		if (x > 0 && x % texture->factor == 0)
			sum += 3;
		for (int k = 0; k < 3; k++)
			sum[k] += intake->textures->linear[rgb[k]];
	}
	intake->row++;
	row_count = (intake->row - 1) % texture->factor + 1;
	if (row_count == texture->factor || intake->row == texture->image_height)
		end_texels(intake, row_count);
}

/* Level `number` from the finer one before it; at odd sides there are fewer than four to a texel. */
static void make_level(const struct textures *textures, struct texture *texture, uint32_t number)
{
	struct level from = level_of(texture, number - 1), to = level_of(texture, number);
	const uint8_t *fine = texture->texels + from.offset;
	uint8_t *coarse = texture->texels + to.offset;

	for (uint32_t y = 0; y < to.height; y++) {
		for (uint32_t x = 0; x < to.width; x++) {
			uint32_t sums[3] = { 2, 2, 2 };

			for (uint32_t i = 0; i < 4; i++) {
				uint32_t fx = 2 * x + (i & 1), fy = 2 * y + (i >> 1);
				const uint8_t *texel;

				/* Twice the last one is the mean of those that are there. */
				fx = fx < from.width ? fx : from.width - 1;
				fy = fy < from.height ? fy : from.height - 1;
				texel = fine + 3 * ((size_t)fy * from.width + fx);
				for (int k = 0; k < 3; k++)
					sums[k] += textures->linear[texel[k]];
			}
			for (int k = 0; k < 3; k++)
				*coarse++ = to_byte(textures, sums[k] / 4);
		}
	}
}

static int load(struct textures *textures, struct texture *texture, struct why *why)
{
	struct intake intake = { .textures = textures, .texture = texture };
	const struct texture_image_sink sink = { .begin = on_begin, .row = on_row, .arg = &intake };
	int r = texture_image_read(texture->path, &sink, why);

	free(intake.sums);
	if (r < 0) {
		free(texture->texels);
		texture->texels = NULL;
		why_prefix(why, "%s", texture->path);
		return r;
	}
	for (uint32_t i = 1; i < texture->level_count; i++)
		make_level(textures, texture, i);
	textures->bytes += texture->size_bytes;
	texture->seen = true;
	return 0;
}

int textures_need(struct textures *textures, uint32_t number, struct why *why)
{
	struct texture *texture;
	int r;

	CHECK(number < textures->paths.count);
	texture = &textures->textures[number];
	texture->last_use = ++textures->use_count;
	if (texture->texels)
		return 1;
	if (texture->unreadable)
		return 0;
	r = load(textures, texture, why);
	if (r == 0)
		return 1;
	if (r == -ENOMEM)
		return r;
	if (texture->seen)
		return why_set(why, -EIO, "%s: it has changed while it was read", texture->path);
	texture->unreadable = true;
	textures->unreadable_count++;
	return 0;
}

/* ---- colours ---- */

/* Where a corner is in the image, in images: u to the right, v down. */
static void lay(const struct texture_map *map, const float corner[2], double ret[2])
{
	for (int k = 0; k < 2; k++) {
		double at = (double)corner[k] * (double)map->scale[k] + (double)map->offset[k];

		/* What is no number is 0. */
		ret[k] = fabs(at) <= COORDINATE_MAX ? at : 0.0;
	}
	ret[1] = 1.0 - ret[1];
}

/* The two texels of a row (or column) around a coordinate, and the second one's share of 256. */
static uint32_t find_texels(double at, bool clamped, uint32_t count, uint32_t ret[2])
{
	double below = floor(at);
	int64_t first = (int64_t)below;

	for (int i = 0; i < 2; i++) {
		int64_t number = first + i;

		if (clamped)
			number = number < 0 ? 0 : number >= count ? count - 1 : number;
		else
			number = (number % count + count) % count;
		ret[i] = (uint32_t)number;
	}
	return (uint32_t)((at - below) * 256.0);
}

static uint32_t sample(const struct textures *textures, const struct texture *texture,
		       const struct level *level, const struct texture_map *map, const double at[2])
{
	const uint8_t *texels = texture->texels + level->offset;
	uint32_t xs[2], ys[2], light[3] = { 1u << 15, 1u << 15, 1u << 15 };
	double u = map->clamped ? at[0] : at[0] - floor(at[0]);
	double v = map->clamped ? at[1] : at[1] - floor(at[1]);
	uint32_t right = find_texels(u * texture->image_width / level->texel - 0.5, map->clamped,
				     level->width, xs);
	uint32_t down = find_texels(v * texture->image_height / level->texel - 0.5, map->clamped,
				    level->height, ys);

	for (int i = 0; i < 4; i++) {
		uint32_t share = (i & 1 ? right : 256 - right) * (i & 2 ? down : 256 - down);
		const uint8_t *texel = texels + 3 * ((size_t)ys[i >> 1] * level->width + xs[i & 1]);

		for (int k = 0; k < 3; k++)
			light[k] += share * textures->linear[texel[k]];
	}
	return UINT32_C(0xff000000) | (uint32_t)to_byte(textures, light[2] >> 16) << 16 |
	       (uint32_t)to_byte(textures, light[1] >> 16) << 8 | to_byte(textures, light[0] >> 16);
}

void textures_triangle(const struct textures *textures, const struct texture_map *map,
		       const float corners[3][2], uint32_t ret_colours[3])
{
	const struct texture *texture = &textures->textures[map->texture];
	struct level level;
	uint32_t number = 0;
	double at[3][2], area;

	CHECK(texture->texels);
	for (int i = 0; i < 3; i++)
		lay(map, corners[i], at[i]);
	/* Of the parallelogram: the square of the side of a triangle that is half a square. */
	area = fabs((at[1][0] - at[0][0]) * (at[2][1] - at[0][1]) -
		    (at[2][0] - at[0][0]) * (at[1][1] - at[0][1]));
	area *= (double)texture->image_width * texture->image_height;
	area /= (double)texture->factor * texture->factor;
	while (area >= 4.0 && number + 1 < texture->level_count) {
		area /= 4.0;
		number++;
	}
	level = level_of(texture, number);
	for (int i = 0; i < 3; i++)
		ret_colours[i] = sample(textures, texture, &level, map, at[i]);
}
