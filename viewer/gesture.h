/* SPDX-License-Identifier: MIT */
/**
 * gesture.h - drags, wheel turns and held keys, made into motions of a camera.
 *
 * It knows no window system: whoever has one tells what happens, in pixels from the upper left
 * corner, and which point of the world lies under the cursor.
 *
 * Threads: one.
 */
#ifndef VIEWER_GESTURE_H
#define VIEWER_GESTURE_H

#include <stdbool.h>

#include "libclient/select/camera.h"

enum gesture_drag {
	GESTURE_NO_DRAG,
	GESTURE_ORBIT, /* about the point that was under the cursor */
	GESTURE_PAN,   /* that point stays under the cursor */
	GESTURE_LOOK,  /* about the eye */
};

/** What a held key moves. */
enum gesture_motion {
	GESTURE_FORWARD,
	GESTURE_BACKWARD,
	GESTURE_TO_LEFT,
	GESTURE_TO_RIGHT,
	GESTURE_RISE,
	GESTURE_SINK,
	GESTURE_TURN_LEFT,
	GESTURE_TURN_RIGHT,
	GESTURE_TURN_UP,
	GESTURE_TURN_DOWN,
	GESTURE_ROLL_LEFT,
	GESTURE_ROLL_RIGHT,
	GESTURE_FASTER,
	GESTURE_SLOWER,
	GESTURE_MOTION_COUNT_
};

struct gesture {
	double up[3];      /* of the world */
	double scene_size; /* world units */
	bool is_walking;   /* forward is level; else forward is where one looks */

	enum gesture_drag drag;
	double press[2]; /* where the drag began; pixels */
	double last[2];
	bool has_moved; /* far enough to be no click */
	double pivot[3];
	bool held[GESTURE_MOTION_COUNT_];
};

/** A button goes down; pivot: the point of the world under the cursor. */
void gesture_press(struct gesture *gesture, enum gesture_drag drag, double x, double y,
		   const double pivot[3]);

/** The cursor moves; height: of the window, pixels.  Returns: whether the camera moved. */
bool gesture_move(struct gesture *gesture, struct camera *camera, double x, double y,
		  double height);

/** The button goes up.  Returns: whether it was a click. */
bool gesture_release(struct gesture *gesture);

/** The wheel turns by so many steps, positive: nearer to the point under the cursor. */
void gesture_wheel(struct camera *camera, const double point[3], double steps);

/** Is a key held that moves something? */
bool gesture_is_moving(const struct gesture *gesture);

/**
 * Keys have been held for so long.
 *
 * distance:  to what is seen ahead: speed suits it.
 *
 * Returns: whether the camera moved.
 */
bool gesture_step(struct gesture *gesture, struct camera *camera, double seconds, double distance);

#endif /* VIEWER_GESTURE_H */
