/* SPDX-License-Identifier: MIT */
#include "tools/bench/accuracy/flip.h"

#include <errno.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"

/* Of the paper: exponents, where errors are bent, and the width of the eye's edge filter in degrees. */
#define COLOUR_EXPONENT  0.7
#define FEATURE_EXPONENT 0.5
#define BEND_AT          0.4
#define BEND_TO          0.95
#define EDGE_DEGREES     0.082
/* The widest of the contrast sensitivities below; it sets the radius of all. */
#define WIDEST_SCALE 0.04

/* Contrast sensitivity of a channel: a sum of Gaussians a sqrt(pi/b) exp(-pi^2 r^2 / b). */
struct gaussian {
	double a, b;
};

#define GAUSSIANS_MAX 2

static const struct gaussian sensitivities[3][GAUSSIANS_MAX] = {
	{ { 1.0, 0.0047 } },                         /* lightness */
	{ { 1.0, 0.0053 } },                         /* red to green */
	{ { 34.1, WIDEST_SCALE }, { 13.5, 0.025 } }, /* blue to yellow */
};

enum plane {
	PLANE_L, /* L*a*b* of the filtered picture, chroma scaled after Hunt */
	PLANE_A,
	PLANE_B,
	PLANE_EDGE_X, /* responses of the edge and point filters */
	PLANE_EDGE_Y,
	PLANE_POINT_X,
	PLANE_POINT_Y,
	PLANE_COUNT_
};

struct flip {
	uint32_t width;
	uint32_t height;
	float *planes[PLANE_COUNT_];
};

/* ---- colours: sRGB's primaries and D65, as whole numbers over one denominator ---- */

static const double xyz_of_rgb[3][3] = {
	{ 10135552.0 / 24577794.0, 8788810.0 / 24577794.0, 4435075.0 / 24577794.0 },
	{ 2613072.0 / 12288897.0, 8788810.0 / 12288897.0, 887015.0 / 12288897.0 },
	{ 1425312.0 / 73733382.0, 8788810.0 / 73733382.0, 70074185.0 / 73733382.0 },
};

static const double rgb_of_xyz[3][3] = {
	{ 3.241003275, -1.537398934, -0.498615861 },
	{ -0.969224334, 1.875930071, 0.041554224 },
	{ 0.055639423, -0.204011202, 1.057148933 },
};

static const double white[3] = { 0.950428545, 1.0, 1.088900371 };

static void multiply(const double m[3][3], const double v[3], double ret[3])
{
	for (unsigned i = 0; i < 3; i++)
		ret[i] = m[i][0] * v[0] + m[i][1] * v[1] + m[i][2] * v[2];
}

static double linear_of_srgb(uint8_t byte)
{
	double value = byte / 255.0;

	return value > 0.04045 ? pow((value + 0.055) / 1.055, 2.4) : value / 12.92;
}

/* A linearised L*a*b*: lightness and two opponent colours that may be filtered. */
static void opponent_of_linear(const double rgb[3], double ret[3])
{
	double xyz[3];

	multiply(xyz_of_rgb, rgb, xyz);
	for (unsigned k = 0; k < 3; k++)
		xyz[k] /= white[k];
	ret[0] = 116.0 * xyz[1] - 16.0;
	ret[1] = 500.0 * (xyz[0] - xyz[1]);
	ret[2] = 200.0 * (xyz[1] - xyz[2]);
}

static void linear_of_opponent(const double opponent[3], double ret[3])
{
	double y = (opponent[0] + 16.0) / 116.0;
	const double xyz[3] = {
		(y + opponent[1] / 500.0) * white[0],
		y * white[1],
		(y - opponent[2] / 200.0) * white[2],
	};

	multiply(rgb_of_xyz, xyz, ret);
	for (unsigned k = 0; k < 3; k++)
		ret[k] = fmin(fmax(ret[k], 0.0), 1.0);
}

/* L*a*b*, chroma scaled by lightness: colours look fuller where there is more light (Hunt). */
static void hunt_lab_of_linear(const double rgb[3], double ret[3])
{
	const double delta = 6.0 / 29.0;
	double f[3];

	multiply(xyz_of_rgb, rgb, f);
	for (unsigned k = 0; k < 3; k++) {
		f[k] /= white[k];
		f[k] = f[k] > delta * delta * delta ? cbrt(f[k])
						    : f[k] / (3.0 * delta * delta) + 4.0 / 29.0;
	}
	ret[0] = 116.0 * f[1] - 16.0;
	ret[1] = 0.01 * ret[0] * 500.0 * (f[0] - f[1]);
	ret[2] = 0.01 * ret[0] * 200.0 * (f[1] - f[2]);
}

/* HyAB: city-block between lightness and chroma. */
static double hyab(const double a[3], const double b[3])
{
	return fabs(a[0] - b[0]) + hypot(a[1] - b[1], a[2] - b[2]);
}

/* ---- filters: all are products of one along rows and one along columns ---- */

struct kernel {
	int radius;
	float *taps; /* 2 * radius + 1 */
};

struct filter {
	struct kernel row;
	struct kernel column;
};

static int kernel_init(struct kernel *kernel, int radius)
{
	kernel->radius = radius;
	kernel->taps = calloc(2 * (size_t)radius + 1, sizeof(float));
	return kernel->taps ? 0 : -ENOMEM;
}

static void filter_done(struct filter *filter)
{
	free(filter->row.taps);
	free(filter->column.taps);
}

/* The sum of source under a filter; beyond the border, the border's pixel goes on. */
static void filter_add(const struct filter *filter, const float *source, uint32_t width,
		       uint32_t height, float *rows, float *ret)
{
	const float *row_taps = filter->row.taps + filter->row.radius;
	const float *column_taps = filter->column.taps + filter->column.radius;

	memset(rows, 0, (size_t)width * height * sizeof(*rows));
	for (uint32_t y = 0; y < height; y++) {
		const float *from = source + (size_t)y * width;
		float *to = rows + (size_t)y * width;

		for (int i = -filter->row.radius; i <= filter->row.radius; i++) {
			int begin = i < 0 ? -i : 0;
			int end = i > 0 ? (int)width - i : (int)width;

			for (int x = 0; x < begin && x < (int)width; x++)
				to[x] += row_taps[i] * from[0];
			for (int x = begin; x < end; x++)
				to[x] += row_taps[i] * from[x + i];
			for (int x = end < 0 ? 0 : end; x < (int)width; x++)
				to[x] += row_taps[i] * from[width - 1];
		}
	}
	for (int y = 0; y < (int)height; y++) {
		float *to = ret + (size_t)y * width;

		for (int i = -filter->column.radius; i <= filter->column.radius; i++) {
			int at = y + i < 0 ? 0 : y + i >= (int)height ? (int)height - 1 : y + i;
			const float *from = rows + (size_t)at * width;

			for (uint32_t x = 0; x < width; x++)
				to[x] += column_taps[i] * from[x];
		}
	}
}

static double gaussian_tap(const struct gaussian *gaussian, int i, double pixels_a_degree)
{
	double degrees = i / pixels_a_degree;

	return exp(-M_PI * M_PI * degrees * degrees / gaussian->b);
}

static double gaussian_height(const struct gaussian *gaussian)
{
	return gaussian->a * sqrt(M_PI / gaussian->b);
}

/* The sum of all taps in the plane. */
static double gaussian_sum(const struct gaussian *gaussian, int radius, double pixels_a_degree)
{
	double sum = 0.0;

	for (int i = -radius; i <= radius; i++)
		sum += gaussian_tap(gaussian, i, pixels_a_degree);
	return gaussian_height(gaussian) * sum * sum;
}

/* One Gaussian of a sensitivity, divided by the sum of all taps of the whole. */
static int sensitivity_filter(const struct gaussian *gaussian, int radius, double pixels_a_degree,
			      double whole, struct filter *ret)
{
	if (kernel_init(&ret->row, radius) < 0 || kernel_init(&ret->column, radius) < 0)
		return -ENOMEM;
	for (int i = -radius; i <= radius; i++) {
		double tap = gaussian_tap(gaussian, i, pixels_a_degree);

		ret->row.taps[i + radius] = (float)tap;
		ret->column.taps[i + radius] = (float)(tap * gaussian_height(gaussian) / whole);
	}
	return 0;
}

static int filter_channel(unsigned channel, double pixels_a_degree, const float *source,
			  const struct flip *flip, float *scratch, float *ret)
{
	const struct gaussian *gaussians = sensitivities[channel];
	int radius = (int)ceil(3.0 * sqrt(WIDEST_SCALE / (2.0 * M_PI * M_PI)) * pixels_a_degree);
	double whole = 0.0;
	int r = 0;

	for (unsigned i = 0; i < GAUSSIANS_MAX && gaussians[i].a > 0.0; i++)
		whole += gaussian_sum(&gaussians[i], radius, pixels_a_degree);
	memset(ret, 0, (size_t)flip->width * flip->height * sizeof(*ret));
	for (unsigned i = 0; r == 0 && i < GAUSSIANS_MAX && gaussians[i].a > 0.0; i++) {
		struct filter filter = { .row = { 0 } };

		r = sensitivity_filter(&gaussians[i], radius, pixels_a_degree, whole, &filter);
		if (r == 0)
			filter_add(&filter, source, flip->width, flip->height, scratch, ret);
		filter_done(&filter);
	}
	return r;
}

/* Positive taps sum to 1, negative ones to -1. */
static void balance(double *taps, int count)
{
	double positive = 0.0;
	double negative = 0.0;

	for (int i = 0; i < count; i++) {
		positive += fmax(taps[i], 0.0);
		negative -= fmin(taps[i], 0.0);
	}
	for (int i = 0; i < count; i++)
		taps[i] /= taps[i] < 0.0 ? negative : positive;
}

/* First (edges) or second (points) derivative of a Gaussian along rows; `across` is the Gaussian. */
static int feature_kernels(double pixels_a_degree, bool points, struct kernel *ret_along,
			   struct kernel *ret_across)
{
	double deviation = 0.5 * EDGE_DEGREES * pixels_a_degree;
	int radius = (int)ceil(3.0 * deviation);
	int count = 2 * radius + 1;
	double *along = calloc((size_t)count, sizeof(*along));
	double sum = 0.0;

	if (!along || kernel_init(ret_along, radius) < 0 || kernel_init(ret_across, radius) < 0) {
		free(along);
		return -ENOMEM;
	}
	for (int i = -radius; i <= radius; i++) {
		double g = exp(-(double)(i * i) / (2.0 * deviation * deviation));

		along[i + radius] =
			(points ? i * i / (deviation * deviation) - 1.0 : -(double)i) * g;
		ret_across->taps[i + radius] = (float)g;
		sum += g;
	}
	balance(along, count);
	for (int i = 0; i < count; i++) {
		ret_along->taps[i] = (float)along[i];
		ret_across->taps[i] /= (float)sum;
	}
	free(along);
	return 0;
}

static int detect(struct flip *flip, bool points, double pixels_a_degree, const float *lightness,
		  float *scratch)
{
	struct kernel along = { 0 };
	struct kernel across = { 0 };
	enum plane plane = points ? PLANE_POINT_X : PLANE_EDGE_X;
	int r = feature_kernels(pixels_a_degree, points, &along, &across);

	if (r == 0) {
		const struct filter in_x = { along, across };
		const struct filter in_y = { across, along };

		filter_add(&in_x, lightness, flip->width, flip->height, scratch,
			   flip->planes[plane]);
		filter_add(&in_y, lightness, flip->width, flip->height, scratch,
			   flip->planes[plane + 1]);
	}
	free(along.taps);
	free(across.taps);
	return r;
}

/* ---- a picture ---- */

static void to_opponent(const uint8_t *rgb, size_t pixel_count, float *const ret[3])
{
	double linear[256];

	for (unsigned i = 0; i < ARRAY_LENGTH(linear); i++)
		linear[i] = linear_of_srgb((uint8_t)i);
	for (size_t i = 0; i < pixel_count; i++) {
		const double colour[3] = { linear[rgb[3 * i]], linear[rgb[3 * i + 1]],
					   linear[rgb[3 * i + 2]] };
		double opponent[3];

		opponent_of_linear(colour, opponent);
		for (unsigned k = 0; k < 3; k++)
			ret[k][i] = (float)opponent[k];
	}
}

static void to_lab(struct flip *flip, size_t pixel_count)
{
	for (size_t i = 0; i < pixel_count; i++) {
		double colour[3] = { flip->planes[PLANE_L][i], flip->planes[PLANE_A][i],
				     flip->planes[PLANE_B][i] };
		double linear[3];

		linear_of_opponent(colour, linear);
		hunt_lab_of_linear(linear, colour);
		for (unsigned k = 0; k < 3; k++)
			flip->planes[PLANE_L + k][i] = (float)colour[k];
	}
}

static int fill(struct flip *flip, const uint8_t *rgb, double pixels_a_degree, float *scratch)
{
	size_t pixel_count = (size_t)flip->width * flip->height;
	float *opponent[3] = { scratch, scratch + pixel_count, scratch + 2 * pixel_count };
	float *rows = scratch + 3 * pixel_count;
	int r = 0;

	to_opponent(rgb, pixel_count, opponent);
	for (unsigned k = 0; r == 0 && k < 3; k++)
		r = filter_channel(k, pixels_a_degree, opponent[k], flip, rows,
				   flip->planes[PLANE_L + k]);
	if (r < 0)
		return r;
	to_lab(flip, pixel_count);
	for (size_t i = 0; i < pixel_count; i++)
		opponent[0][i] = (opponent[0][i] + 16.0f) / 116.0f;
	r = detect(flip, false, pixels_a_degree, opponent[0], rows);
	return r < 0 ? r : detect(flip, true, pixels_a_degree, opponent[0], rows);
}

int flip_prepare(const uint8_t *rgb, uint32_t width, uint32_t height, double pixels_a_degree,
		 struct flip **ret)
{
	size_t pixel_count = (size_t)width * height;
	struct flip *flip = calloc(1, sizeof(*flip));
	float *scratch = calloc(pixel_count, 4 * sizeof(*scratch));
	int r = -ENOMEM;

	CHECK(width > 0 && height > 0 && pixels_a_degree > 0.0);
	if (flip && scratch) {
		flip->width = width;
		flip->height = height;
		flip->planes[0] = calloc(pixel_count, PLANE_COUNT_ * sizeof(float));
	}
	if (flip && flip->planes[0]) {
		for (unsigned i = 1; i < PLANE_COUNT_; i++)
			flip->planes[i] = flip->planes[0] + i * pixel_count;
		r = fill(flip, rgb, pixels_a_degree, scratch);
	}
	free(scratch);
	if (r < 0) {
		flip_done(flip);
		return r;
	}
	*ret = flip;
	return 0;
}

struct flip *flip_done(struct flip *flip)
{
	if (!flip)
		return NULL;
	free(flip->planes[0]);
	free(flip);
	return NULL;
}

/* ---- two pictures ---- */

/* The largest error of colour there is, between pure green and pure blue, raised. */
static double colour_error_max(void)
{
	const double green[3] = { 0.0, 1.0, 0.0 };
	const double blue[3] = { 0.0, 0.0, 1.0 };
	double a[3];
	double b[3];

	hunt_lab_of_linear(green, a);
	hunt_lab_of_linear(blue, b);
	return pow(hyab(a, b), COLOUR_EXPONENT);
}

static double colour_error(const struct flip *a, const struct flip *b, size_t i, double max)
{
	const double of_a[3] = { a->planes[PLANE_L][i], a->planes[PLANE_A][i],
				 a->planes[PLANE_B][i] };
	const double of_b[3] = { b->planes[PLANE_L][i], b->planes[PLANE_A][i],
				 b->planes[PLANE_B][i] };
	double error = pow(hyab(of_a, of_b), COLOUR_EXPONENT);
	double bend = BEND_AT * max;

	return error < bend ? BEND_TO / bend * error
			    : BEND_TO + (error - bend) / (max - bend) * (1.0 - BEND_TO);
}

static double response(const struct flip *flip, enum plane plane, size_t i)
{
	return hypot(flip->planes[plane][i], flip->planes[plane + 1][i]);
}

static double feature_error(const struct flip *a, const struct flip *b, size_t i)
{
	double edges = fabs(response(a, PLANE_EDGE_X, i) - response(b, PLANE_EDGE_X, i));
	double points = fabs(response(a, PLANE_POINT_X, i) - response(b, PLANE_POINT_X, i));

	return pow(fmax(edges, points) * M_SQRT1_2, FEATURE_EXPONENT);
}

double flip_compare(const struct flip *reference, const struct flip *test, float *ret_map)
{
	size_t pixel_count = (size_t)reference->width * reference->height;
	double max = colour_error_max();
	double sum = 0.0;

	CHECK(reference->width == test->width && reference->height == test->height);
	for (size_t i = 0; i < pixel_count; i++) {
		double error = pow(colour_error(reference, test, i, max),
				   1.0 - feature_error(reference, test, i));

		sum += error;
		if (ret_map)
			ret_map[i] = (float)error;
	}
	return sum / (double)pixel_count;
}
