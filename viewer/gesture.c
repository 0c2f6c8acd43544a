/* SPDX-License-Identifier: MIT */
#include "viewer/gesture.h"

#include <math.h>
#include <string.h>

#include "viewer/camera_control.h"

/* A press that moves less is a click. */
#define CLICK_PIXELS 4.0
/* A drag over the height of the window. */
#define DRAG_RADIANS 3.0
/* What a step of the wheel leaves of the distance. */
#define WHEEL_FACTOR       0.85
#define TURN_RADIANS_PER_S 1.2
#define FASTER_FACTOR      5.0

void gesture_press(struct gesture *gesture, enum gesture_drag drag, double x, double y,
		   const double pivot[3])
{
	gesture->drag = drag;
	gesture->press[0] = gesture->last[0] = x;
	gesture->press[1] = gesture->last[1] = y;
	gesture->has_moved = false;
	memcpy(gesture->pivot, pivot, sizeof(gesture->pivot));
}

/* How far along the view the pivot lies. */
static double pivot_distance(const struct gesture *gesture, const struct camera *camera)
{
	struct camera_axes axes;
	double distance = 0.0;

	camera_control_axes(camera, &axes);
	for (int k = 0; k < 3; k++)
		distance += axes.forward[k] * (gesture->pivot[k] - camera->eye[k]);
	return distance;
}

bool gesture_move(struct gesture *gesture, struct camera *camera, double x, double y, double height)
{
	double right = (x - gesture->last[0]) / height;
	double down = (y - gesture->last[1]) / height;
	double pixel_size;

	if (gesture->drag == GESTURE_NO_DRAG)
		return false;
	if (hypot(x - gesture->press[0], y - gesture->press[1]) >= CLICK_PIXELS)
		gesture->has_moved = true;
	if (!gesture->has_moved)
		return false;
	gesture->last[0] = x;
	gesture->last[1] = y;
	switch (gesture->drag) {
	case GESTURE_ORBIT:
		camera_control_orbit(camera, gesture->up, gesture->pivot, -right * DRAG_RADIANS,
				     -down * DRAG_RADIANS);
		break;
	case GESTURE_PAN:
		pixel_size = 2.0 * tan(camera->fov_y_degrees * (M_PI / 360.0)) *
			     pivot_distance(gesture, camera);
		camera_control_move(camera, -right * pixel_size, down * pixel_size, 0.0);
		break;
	case GESTURE_LOOK:
		camera_control_turn(camera, gesture->up, -right * DRAG_RADIANS,
				    -down * DRAG_RADIANS, 0.0);
		break;
	case GESTURE_NO_DRAG:
		break;
	}
	return true;
}

bool gesture_release(struct gesture *gesture)
{
	bool is_click = gesture->drag != GESTURE_NO_DRAG && !gesture->has_moved;

	gesture->drag = GESTURE_NO_DRAG;
	return is_click;
}

void gesture_wheel(struct camera *camera, const double point[3], double steps)
{
	camera_control_zoom(camera, point, pow(WHEEL_FACTOR, steps));
}

bool gesture_is_moving(const struct gesture *gesture)
{
	for (int i = 0; i < GESTURE_FASTER; i++) {
		if (gesture->held[i])
			return true;
	}
	return false;
}

/* -1, 0 or 1: of two keys that work against each other. */
static double balance(const struct gesture *gesture, enum gesture_motion plus,
		      enum gesture_motion minus)
{
	return (gesture->held[plus] ? 1.0 : 0.0) - (gesture->held[minus] ? 1.0 : 0.0);
}

bool gesture_step(struct gesture *gesture, struct camera *camera, double seconds, double distance)
{
	double length = seconds * camera_control_speed(distance, gesture->scene_size);
	double angle = seconds * TURN_RADIANS_PER_S;
	double factor = pow(FASTER_FACTOR, balance(gesture, GESTURE_FASTER, GESTURE_SLOWER));
	double right = balance(gesture, GESTURE_TO_RIGHT, GESTURE_TO_LEFT) * length * factor;
	double rise = balance(gesture, GESTURE_RISE, GESTURE_SINK) * length * factor;
	double forward = balance(gesture, GESTURE_FORWARD, GESTURE_BACKWARD) * length * factor;

	if (!gesture_is_moving(gesture))
		return false;
	camera_control_turn(camera, gesture->up,
			    balance(gesture, GESTURE_TURN_LEFT, GESTURE_TURN_RIGHT) * angle,
			    balance(gesture, GESTURE_TURN_UP, GESTURE_TURN_DOWN) * angle,
			    balance(gesture, GESTURE_ROLL_RIGHT, GESTURE_ROLL_LEFT) * angle);
	if (gesture->is_walking)
		camera_control_walk(camera, gesture->up, right, rise, forward);
	else
		camera_control_move(camera, right, rise, forward);
	return true;
}
