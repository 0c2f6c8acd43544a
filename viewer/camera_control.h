/* SPDX-License-Identifier: MIT */
/**
 * camera_control.h - how gestures move a camera.  World coordinates are double throughout, so that
 * a scene far from the origin is as easy to walk through as one at it.
 *
 * `up` is the world's up, a unit vector.  A camera whose own up is the world's stays level; one that
 * was rolled keeps its roll.
 *
 * Threads: any; pure functions.
 */
#ifndef VIEWER_CAMERA_CONTROL_H
#define VIEWER_CAMERA_CONTROL_H

#include <stdbool.h>

#include "libclient/select/camera.h"

/** The camera's axes: orthonormal, right-handed. */
struct camera_axes {
	double right[3];
	double up[3];
	double forward[3];
};

/** camera: one that looks somewhere. */
void camera_control_axes(const struct camera *camera, struct camera_axes *ret);

/** Distance from eye to at. */
double camera_control_distance(const struct camera *camera);

/** Looks at a point of the line of sight at another distance: what gestures turn about. */
void camera_control_focus(struct camera *camera, double distance);

/**
 * The point seen at a place of the picture.
 *
 * x, y:      -1 .. 1, from the left and from the bottom.
 * distance:  along the view.
 */
void camera_control_point(const struct camera *camera, double aspect, double x, double y,
			  double distance, double ret[3]);

/** Turns eye and view about a point; radians.  A level camera does not pass over the poles. */
void camera_control_orbit(struct camera *camera, const double up[3], const double pivot[3],
			  double yaw, double pitch);

/** Turns the view about the eye; radians, positive to the left, upwards, and clockwise. */
void camera_control_turn(struct camera *camera, const double up[3], double yaw, double pitch,
			 double roll);

/** Brings the eye nearer to a point: its distance is multiplied.  The point stays where it shows. */
void camera_control_zoom(struct camera *camera, const double point[3], double factor);

/** Moves along the camera's axes; world units. */
void camera_control_move(struct camera *camera, double right, double up, double forward);

/** Moves like a walker: forward stays level whatever the view, up is the world's. */
void camera_control_walk(struct camera *camera, const double up[3], double right, double rise,
			 double forward);

/** Makes the camera level again. */
void camera_control_level(struct camera *camera, const double up[3]);

enum camera_control_side {
	CAMERA_CONTROL_FRONT,
	CAMERA_CONTROL_BACK,
	CAMERA_CONTROL_LEFT,
	CAMERA_CONTROL_RIGHT,
	CAMERA_CONTROL_TOP,
	CAMERA_CONTROL_BOTTOM,
	CAMERA_CONTROL_SIDE_COUNT_
};

/** "front". */
const char *camera_control_side_name(enum camera_control_side side);

/** Looks at a whole box from a side; keeps time and field of view. */
void camera_control_view_side(struct camera *camera, enum camera_control_side side,
			      const double up[3], const double box_min[3], const double box_max[3],
			      double aspect);

/**
 * World units a second that suit a surface at that distance.
 *
 * scene_size:  of the whole scene; no speed is slower than a hundred-thousandth of it.
 */
double camera_control_speed(double distance, double scene_size);

#endif /* VIEWER_CAMERA_CONTROL_H */
