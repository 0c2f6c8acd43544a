/* SPDX-License-Identifier: MIT */
#include "viewer/pace.h"

#include <math.h>

#include "formats/base/check.h"

#define MS_A_S  1000.0
#define NS_A_MS 1e6

/* Of an error that may be noise. */
#define GAIN_USUAL 0.15
/* Errors within this share of the prediction may be noise: frames of one view differ by +-20 %. */
#define NOISE_SHARE 0.25
/* A lone error counts no more than so. */
#define HICCUP_SHARE 0.5
/* The budget stays while the wanted one is within this share of it. */
#define BAND_SHARE 0.1

/*
 * No estimate is smaller: a renderer that seems to draw for nothing would get a budget without end,
 * and an estimate of zero could never be corrected in proportion.
 */
#define FIXED_MS_MIN    1e-3
#define TRIANGLE_NS_MIN 1e-2

double pace_predict_ms(const struct pace *pace, double triangles)
{
	return pace->fixed_ms + triangles * pace->triangle_ns / NS_A_MS;
}

static double wanted_budget(const struct pace *pace)
{
	double triangles = (pace->aim_ms - pace->fixed_ms) / pace->triangle_ns * NS_A_MS;

	return fmin(fmax(triangles, (double)PACE_BUDGET_MIN), (double)PACE_BUDGET_MAX);
}

void pace_init(struct pace *ret, const struct cost_model *model, double fps, double pixels)
{
	CHECK(fps > 0.0);
	*ret = (struct pace){
		.fps = fps,
		.aim_ms = PACE_SHARE * MS_A_S / fps,
		.fixed_ms = fmax(cost_model_frame_ms(model, 0.0, pixels), FIXED_MS_MIN),
		.triangle_ns = fmax(model->triangle_ns, TRIANGLE_NS_MIN),
		.pixels = pixels,
	};
	ret->budget_triangles = (uint64_t)wanted_budget(ret);
}

void pace_resize(struct pace *pace, const struct cost_model *model, double pixels)
{
	double before_ms = cost_model_frame_ms(model, 0.0, pace->pixels);
	double now_ms = cost_model_frame_ms(model, 0.0, pixels);

	pace->fixed_ms = fmax(pace->fixed_ms + now_ms - before_ms, FIXED_MS_MIN);
	pace->pixels = pixels;
	pace->budget_triangles = (uint64_t)wanted_budget(pace);
}

/* Corrects both parts of a prediction, each as much as it contributed to it. */
static void correct(struct pace *pace, double triangles, double error_ms)
{
	double fixed = pace->fixed_ms;
	double drawn = triangles * pace->triangle_ns / NS_A_MS;
	double power = fixed * fixed + drawn * drawn;

	pace->fixed_ms = fmax(fixed + error_ms * fixed / power * fixed, FIXED_MS_MIN);
	if (drawn > 0.0)
		pace->triangle_ns =
			fmax(pace->triangle_ns + error_ms * drawn / power * pace->triangle_ns,
			     TRIANGLE_NS_MIN);
}

void pace_add(struct pace *pace, double ms, double triangles)
{
	double predicted_ms = pace_predict_ms(pace, triangles);
	double error_ms = ms - predicted_ms;
	double surprise = fabs(error_ms) > NOISE_SHARE * predicted_ms ? error_ms : 0.0;
	double limit_ms = HICCUP_SHARE * predicted_ms;
	double wanted;

	if (surprise * pace->surprise > 0.0) {
		/* The lesser of the two, which both agree on. */
		if (fabs(pace->surprise) < fabs(error_ms))
			error_ms = pace->surprise;
		correct(pace, triangles, error_ms);
		surprise = 0.0;
	} else {
		correct(pace, triangles, GAIN_USUAL * fmin(fmax(error_ms, -limit_ms), limit_ms));
	}
	pace->surprise = surprise;
	wanted = wanted_budget(pace);
	if (fabs(wanted - (double)pace->budget_triangles) >
	    BAND_SHARE * (double)pace->budget_triangles)
		pace->budget_triangles = (uint64_t)wanted;
}
