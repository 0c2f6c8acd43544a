/* SPDX-License-Identifier: MIT */
#include "libclient/select/motion.h"

#include <errno.h>
#include <math.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/check.h"
#include "libclient/select/vector.h"

/* After so long without a camera nothing is known of what happened. */
#define PAUSE_SECONDS 0.5
/* Nobody goes on turning for ever: predictions stop at a quarter turn. */
#define TURN_MAX M_PI_2

/*
 * The turn that takes one camera's axes to another's: axis times angle.  Of the matrix that does it
 * the antisymmetric part is the axis times the angle's sine, the trace says its cosine.
 */
static void turn_between(const struct camera *from, const struct camera *to, double ret[3])
{
	double a[3][3];
	double b[3][3];
	double matrix[3][3];
	double cosine;
	double sine;

	memset(ret, 0, 3 * sizeof(*ret));
	if (!camera_axes(from, a[0], a[1], a[2]) || !camera_axes(to, b[0], b[1], b[2]))
		return;
	for (unsigned i = 0; i < 3; i++)
		for (unsigned j = 0; j < 3; j++)
			matrix[i][j] = b[0][i] * a[0][j] + b[1][i] * a[1][j] + b[2][i] * a[2][j];
	ret[0] = 0.5 * (matrix[2][1] - matrix[1][2]);
	ret[1] = 0.5 * (matrix[0][2] - matrix[2][0]);
	ret[2] = 0.5 * (matrix[1][0] - matrix[0][1]);
	sine = sqrt(vector_dot(ret, ret));
	cosine = 0.5 * (matrix[0][0] + matrix[1][1] + matrix[2][2] - 1.0);
	/* Half a turn in one frame has no axis here, and is no turning anyway. */
	for (unsigned k = 0; k < 3 && sine > 0.0; k++)
		ret[k] *= atan2(sine, cosine) / sine;
}

static double median(double a, double b, double c)
{
	return fmax(fmin(a, b), fmin(fmax(a, b), c));
}

/* With fewer steps than three: the newest. */
static void typical(const struct motion *motion, const double steps[MOTION_STEP_COUNT][3],
		    double ret[3])
{
	uint32_t newest = (motion->next + MOTION_STEP_COUNT - 1) % MOTION_STEP_COUNT;

	for (unsigned k = 0; k < 3; k++)
		ret[k] = motion->camera_count > MOTION_STEP_COUNT
				 ? median(steps[0][k], steps[1][k], steps[2][k])
				 : steps[newest][k];
}

void motion_init(struct motion *motion)
{
	memset(motion, 0, sizeof(*motion));
}

void motion_note(struct motion *motion, const struct camera *camera)
{
	double seconds = camera->time_s - motion->newest.time_s;

	if (motion->camera_count > 0 && seconds > 0.0 && seconds <= PAUSE_SECONDS) {
		double *velocity = motion->velocities[motion->next];
		double *turn = motion->turns[motion->next];

		turn_between(&motion->newest, camera, turn);
		for (unsigned k = 0; k < 3; k++) {
			velocity[k] = (camera->eye[k] - motion->newest.eye[k]) / seconds;
			turn[k] /= seconds;
		}
		motion->next = (motion->next + 1) % MOTION_STEP_COUNT;
		if (motion->camera_count <= MOTION_STEP_COUNT)
			motion->camera_count++;
	} else if (motion->camera_count == 0 || seconds > PAUSE_SECONDS) {
		motion_init(motion);
		motion->camera_count = 1;
	}
	motion->newest = *camera;
}

/*
 * How far a camera comes that keeps its speed and turns: the integral of the turning velocity.  What
 * goes along the axis stays straight, the rest goes round.
 */
static void travel(const double velocity[3], const double axis[3], double rate, double angle,
		   double seconds, double ret[3])
{
	double along = vector_dot(axis, velocity);
	double turning_seconds = rate > 0.0 ? angle / rate : 0.0;
	double side[3];
	double end[3];

	vector_cross(axis, velocity, side);
	vector_turn(velocity, axis, angle, end);
	for (unsigned k = 0; k < 3; k++) {
		double straight = along * axis[k];
		double round = velocity[k] - straight;

		ret[k] = straight * turning_seconds + end[k] * (seconds - turning_seconds);
		/* Below a millionth the series' first term is exact in double. */
		if (angle > 1e-6)
			ret[k] += (round * sin(angle) + side[k] * (1.0 - cos(angle))) / rate;
		else
			ret[k] += round * turning_seconds;
	}
}

int motion_predict(const struct motion *motion, double seconds, struct camera *ret)
{
	const struct camera *newest = &motion->newest;
	double axis[3] = { 0.0, 0.0, 1.0 };
	double velocity[3];
	double turn[3];
	double moved[3];
	double view[3];
	double turned[3];
	double rate;
	double angle;

	CHECK(seconds >= 0.0);
	if (motion->camera_count == 0)
		return -ENODATA;
	*ret = *newest;
	ret->time_s += seconds;
	if (motion->camera_count < 2)
		return 0;
	typical(motion, motion->velocities, velocity);
	typical(motion, motion->turns, turn);
	rate = sqrt(vector_dot(turn, turn));
	for (unsigned k = 0; k < 3 && rate > 0.0; k++)
		axis[k] = turn[k] / rate;
	angle = fmin(rate * seconds, TURN_MAX);
	travel(velocity, axis, rate, angle, seconds, moved);
	for (unsigned k = 0; k < 3; k++)
		view[k] = newest->at[k] - newest->eye[k];
	vector_turn(view, axis, angle, turned);
	vector_turn(newest->up, axis, angle, ret->up);
	for (unsigned k = 0; k < 3; k++) {
		ret->eye[k] += moved[k];
		ret->at[k] = ret->eye[k] + turned[k];
	}
	return 0;
}
