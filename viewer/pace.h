/* SPDX-License-Identifier: MIT */
/**
 * pace.h - the budget of triangles that keeps a frame rate.
 *
 * A frame is taken to last fixed x F + triangles x T.  F and T begin as the cost model has them and
 * are corrected by what frames really take; the budget is what then fits into nine tenths of the
 * frame's time.  It knows no clock and no OpenGL: frames are told to it.
 *
 * Against ringing:
 *   damping      a frame's error corrects the estimate by a fraction (normalised least mean squares,
 *                so that the estimate converges however large the errors are, and what did not
 *                contribute to a frame's time is not corrected by it);
 *   surprise     only when two frames in a row are off to the same side by more than noise is, they
 *                are believed whole: a step is followed in three frames, a hiccup is not;
 *   hysteresis   the budget stays while the wanted one is within a tenth of it.
 *
 * Source: Widrow & Hoff 1960 for the correction; Funkhouser & Sequin 1993 for predicting a frame's
 *	cost in place of reacting to the last one's.
 * Threads: one.
 */
#ifndef VIEWER_PACE_H
#define VIEWER_PACE_H

#include <stdbool.h>
#include <stdint.h>

#include "viewer/cost_model.h"

/** What a frame aims at, as a share of its time: the rest is for what no model foresees. */
#define PACE_SHARE 0.9

/** Bounds of the budget. */
#define PACE_BUDGET_MIN 1000u
#define PACE_BUDGET_MAX (UINT64_C(1) << 40)

struct pace {
	double fps;         /* 0: there is no pace to keep */
	double aim_ms;      /* of a frame */
	double fixed_ms;    /* a frame without triangles, as it is believed now */
	double triangle_ns; /* likewise */
	double pixels;
	double surprise; /* the last error, if it was beyond noise; else 0 */
	uint64_t budget_triangles;
};

/**
 * Begins from the model.
 *
 * fps:     > 0.
 * pixels:  of the picture; each is taken to be shaded once.
 */
void pace_init(struct pace *ret, const struct cost_model *model, double fps, double pixels);

/** Another size of the picture.  What was learnt stays. */
void pace_resize(struct pace *pace, const struct cost_model *model, double pixels);

/**
 * A frame is done.
 *
 * ms:         that it took, without waiting for data; a frame that was idle is not to be told.
 * triangles:  that it drew.
 */
void pace_add(struct pace *pace, double ms, double triangles);

/** What a frame of so many triangles is believed to take, ms. */
double pace_predict_ms(const struct pace *pace, double triangles);

#endif /* VIEWER_PACE_H */
