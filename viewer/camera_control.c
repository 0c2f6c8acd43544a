/* SPDX-License-Identifier: MIT */
#include "viewer/camera_control.h"

#include <math.h>
#include <string.h>

#include "formats/base/check.h"
#include "libclient/select/vector.h"

/* A level camera keeps so far from looking straight up or down: about a tenth of a degree. */
#define POLE_RADIANS 0.002
/* A surface is reached in about this time. */
#define SPEED_SECONDS 1.5

/* ---- vectors ---- */

static bool normalise3(double v[3])
{
	double length = sqrt(vector_dot(v, v));

	if (!(length > 1e-12))
		return false;
	for (int k = 0; k < 3; k++)
		v[k] /= length;
	return true;
}

static void subtract3(const double a[3], const double b[3], double ret[3])
{
	for (int k = 0; k < 3; k++)
		ret[k] = a[k] - b[k];
}

/* ---- the camera ---- */

void camera_control_axes(const struct camera *camera, struct camera_axes *ret)
{
	int least = 0;

	subtract3(camera->at, camera->eye, ret->forward);
	CHECK(normalise3(ret->forward));
	vector_cross(ret->forward, camera->up, ret->right);
	if (!normalise3(ret->right)) {
		/* Up lies along the view: any axis that does not will do. */
		double axis[3] = { 0.0, 0.0, 0.0 };

		for (int k = 1; k < 3; k++) {
			if (fabs(ret->forward[k]) < fabs(ret->forward[least]))
				least = k;
		}
		axis[least] = 1.0;
		vector_cross(ret->forward, axis, ret->right);
		(void)normalise3(ret->right);
	}
	vector_cross(ret->right, ret->forward, ret->up);
}

double camera_control_distance(const struct camera *camera)
{
	double view[3];

	subtract3(camera->at, camera->eye, view);
	return sqrt(vector_dot(view, view));
}

static void look(struct camera *camera, const double forward[3], double distance)
{
	for (int k = 0; k < 3; k++)
		camera->at[k] = camera->eye[k] + forward[k] * distance;
}

void camera_control_focus(struct camera *camera, double distance)
{
	struct camera_axes axes;

	camera_control_axes(camera, &axes);
	if (distance > 0.0 && isfinite(distance))
		look(camera, axes.forward, distance);
}

void camera_control_point(const struct camera *camera, double aspect, double x, double y,
			  double distance, double ret[3])
{
	double tan_half_y = tan(camera->fov_y_degrees * (M_PI / 360.0));
	struct camera_axes axes;

	camera_control_axes(camera, &axes);
	for (int k = 0; k < 3; k++)
		ret[k] = camera->eye[k] +
			 distance * (axes.forward[k] + axes.right[k] * x * tan_half_y * aspect +
				     axes.up[k] * y * tan_half_y);
}

/* Is the horizon level, and not upside down?  So it is when looking straight up or down, too. */
static bool is_level(const struct camera_axes *axes, const double up[3])
{
	return fabs(vector_dot(axes->right, up)) < 1e-6 && vector_dot(axes->up, up) > -1e-6;
}

/* As much of a pitch as keeps a level view off the poles. */
static double bounded_pitch(const double forward[3], const double up[3], double pitch)
{
	double elevation = asin(fmin(fmax(vector_dot(forward, up), -1.0), 1.0));
	double limit = M_PI / 2.0 - POLE_RADIANS;

	return fmin(fmax(elevation + pitch, -limit), limit) - elevation;
}

void camera_control_orbit(struct camera *camera, const double up[3], const double pivot[3],
			  double yaw, double pitch)
{
	double distance = camera_control_distance(camera);
	struct camera_axes axes;
	double arm[3];
	bool level;

	camera_control_axes(camera, &axes);
	level = is_level(&axes, up);
	if (level)
		pitch = bounded_pitch(axes.forward, up, pitch);
	subtract3(camera->eye, pivot, arm);
	/* First about the camera's own axis, then about the world's: the order keeps it level. */
	vector_turn(arm, axes.right, pitch, arm);
	vector_turn(axes.forward, axes.right, pitch, axes.forward);
	vector_turn(arm, up, yaw, arm);
	vector_turn(axes.forward, up, yaw, axes.forward);
	vector_turn(axes.up, axes.right, pitch, axes.up);
	vector_turn(axes.up, up, yaw, axes.up);
	memcpy(camera->up, level ? up : axes.up, sizeof(camera->up));
	for (int k = 0; k < 3; k++)
		camera->eye[k] = pivot[k] + arm[k];
	look(camera, axes.forward, distance);
}

void camera_control_turn(struct camera *camera, const double up[3], double yaw, double pitch,
			 double roll)
{
	camera_control_orbit(camera, up, camera->eye, yaw, pitch);
	if (roll != 0.0) {
		struct camera_axes axes;

		camera_control_axes(camera, &axes);
		memcpy(camera->up, axes.up, sizeof(axes.up));
		vector_turn(camera->up, axes.forward, roll, camera->up);
	}
}

void camera_control_zoom(struct camera *camera, const double point[3], double factor)
{
	double distance = camera_control_distance(camera) * factor;
	struct camera_axes axes;

	camera_control_axes(camera, &axes);
	for (int k = 0; k < 3; k++)
		camera->eye[k] = point[k] + (camera->eye[k] - point[k]) * factor;
	look(camera, axes.forward, distance);
}

static void shift(struct camera *camera, const double axis[3], double amount)
{
	for (int k = 0; k < 3; k++) {
		camera->eye[k] += axis[k] * amount;
		camera->at[k] += axis[k] * amount;
	}
}

void camera_control_move(struct camera *camera, double right, double up, double forward)
{
	struct camera_axes axes;

	camera_control_axes(camera, &axes);
	shift(camera, axes.right, right);
	shift(camera, axes.up, up);
	shift(camera, axes.forward, forward);
}

void camera_control_walk(struct camera *camera, const double up[3], double right, double rise,
			 double forward)
{
	struct camera_axes axes;
	double ahead[3];

	camera_control_axes(camera, &axes);
	/* Also when looking straight down. */
	vector_cross(up, axes.right, ahead);
	if (!normalise3(ahead))
		memcpy(ahead, axes.forward, sizeof(ahead));
	shift(camera, axes.right, right);
	shift(camera, up, rise);
	shift(camera, ahead, forward);
}

void camera_control_level(struct camera *camera, const double up[3])
{
	double distance = camera_control_distance(camera);
	struct camera_axes axes;

	camera_control_axes(camera, &axes);
	memcpy(camera->up, up, sizeof(camera->up));
	/* Also off the poles, where level means nothing. */
	vector_turn(axes.forward, axes.right, bounded_pitch(axes.forward, up, 0.0), axes.forward);
	look(camera, axes.forward, distance);
}

/* ---- standard views ---- */

static const char *const side_names[CAMERA_CONTROL_SIDE_COUNT_] = { "front", "back", "left",
								    "right", "top",  "bottom" };

const char *camera_control_side_name(enum camera_control_side side)
{
	CHECK(side < CAMERA_CONTROL_SIDE_COUNT_);
	return side_names[side];
}

/* Where the model's right is, seen from its front, and which way one looks at its front. */
static void model_axes(const double up[3], double right[3], double ahead[3])
{
	static const double x_up[2][3] = { { 0.0, 1.0, 0.0 }, { 0.0, 0.0, 1.0 } };
	static const double y_up[2][3] = { { 1.0, 0.0, 0.0 }, { 0.0, 0.0, -1.0 } };
	static const double z_up[2][3] = { { 1.0, 0.0, 0.0 }, { 0.0, 1.0, 0.0 } };
	const double(*axes)[3] = up[0] > 0.5 ? x_up : up[1] > 0.5 ? y_up : z_up;

	memcpy(right, axes[0], sizeof(axes[0]));
	memcpy(ahead, axes[1], sizeof(axes[1]));
}

static void side_direction(enum camera_control_side side, const double up[3], double ret_forward[3],
			   double ret_up[3])
{
	double right[3];
	double ahead[3];

	model_axes(up, right, ahead);
	memcpy(ret_up, up, 3 * sizeof(double));
	for (int k = 0; k < 3; k++) {
		switch (side) {
		case CAMERA_CONTROL_FRONT:
			ret_forward[k] = ahead[k];
			break;
		case CAMERA_CONTROL_BACK:
			ret_forward[k] = -ahead[k];
			break;
		case CAMERA_CONTROL_LEFT:
			ret_forward[k] = right[k];
			break;
		case CAMERA_CONTROL_RIGHT:
			ret_forward[k] = -right[k];
			break;
		case CAMERA_CONTROL_TOP:
			ret_forward[k] = -up[k];
			ret_up[k] = ahead[k];
			break;
		case CAMERA_CONTROL_BOTTOM:
			ret_forward[k] = up[k];
			ret_up[k] = -ahead[k];
			break;
		case CAMERA_CONTROL_SIDE_COUNT_:
			break;
		}
	}
}

void camera_control_view_side(struct camera *camera, enum camera_control_side side,
			      const double up[3], const double box_min[3], const double box_max[3],
			      double aspect)
{
	double tan_half_y = tan(camera->fov_y_degrees * (M_PI / 360.0));
	double forward[3];
	double centre[3];
	double distance = 0.0;
	struct camera_axes axes;

	side_direction(side, up, forward, camera->up);
	for (int k = 0; k < 3; k++)
		centre[k] = 0.5 * (box_min[k] + box_max[k]);
	memcpy(camera->eye, centre, sizeof(centre));
	look(camera, forward, 1.0);
	camera_control_axes(camera, &axes);
	/* Far enough that each corner is in the picture. */
	for (unsigned corner = 0; corner < 8; corner++) {
		double at[3];
		double depth;

		for (unsigned k = 0; k < 3; k++)
			at[k] = (corner >> k & 1 ? box_max[k] : box_min[k]) - centre[k];
		depth = vector_dot(axes.forward, at);
		distance = fmax(distance,
				fabs(vector_dot(axes.right, at)) / (tan_half_y * aspect) - depth);
		distance = fmax(distance, fabs(vector_dot(axes.up, at)) / tan_half_y - depth);
	}
	if (!(distance > 0.0))
		distance = 1.0;
	distance *= 1.05;
	for (int k = 0; k < 3; k++)
		camera->eye[k] = centre[k] - forward[k] * distance;
	memcpy(camera->at, centre, sizeof(centre));
}

double camera_control_speed(double distance, double scene_size)
{
	double slowest = 1e-5 * scene_size;

	if (!(distance > slowest))
		distance = slowest;
	if (scene_size > 0.0 && distance > scene_size)
		distance = scene_size;
	return distance / SPEED_SECONDS;
}
