/* SPDX-License-Identifier: MIT */
/**
 * camera.h - a camera in double precision, and the one float transform that every rasteriser uses.
 *
 * The way of a vertex to the screen is the same for the GPU and for the software rasteriser, so that
 * their pictures can be compared bit for bit:
 *
 *	p    = node.scale * q + node.offset        float; q as stored, offset from the anchor
 *	clip = view_projection * (p, 1)            float, ((m0*x + m1*y) + m2*z) + m3 in each row
 *
 * The anchor is the eye rounded to the store's grid: offsets are then multiples of the step, p is
 * exact in float while |p| < 2^24 steps, and a vertex shared by two nodes lands on the same bits.
 * Reversed-Z, infinite far plane: depth 1 at the near plane, 0 at infinity.
 *
 * Threads: any; pure functions.
 */
#ifndef LIBCLIENT_SELECT_CAMERA_H
#define LIBCLIENT_SELECT_CAMERA_H

#include <stdbool.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "formats/store/layout.h"
#include "formats/store/payload_layout.h"

/** One row of a camera path.  World: model units, up to 10^7 from the origin and more. */
struct camera {
	double time_s;
	double eye[3];
	double at[3];
	double up[3];
	double fov_y_degrees; /* 1 .. 170 */
};

/** The transform of one camera for one store. */
struct camera_view {
	double anchor[3]; /* from the store's origin: the eye, on the store's grid */
	double eye[3];    /* from the store's origin */
	double right[3], up[3], forward[3]; /* orthonormal */
	double tan_half_x, tan_half_y;
	double near;
	float view_projection[4][4]; /* row-major; takes positions relative to the anchor */
	/* Inward planes (a,b,c,d) from the store's origin, normalised: left right bottom top near. */
	double planes[5][4];
};

/**
 * Makes the transform.
 *
 * near:    distance of the near plane, model units; > 0.
 * aspect:  width / height.
 *
 * Returns: 0, or -EINVAL when the camera has no direction, or numbers that are not finite.  An up
 * along the view is replaced by the axis that lies least along it.
 */
int camera_view_init(struct camera_view *ret, const struct camera *camera,
		     const struct store_superblock *superblock, double aspect, double near);

/**
 * The camera's axes, orthonormal; an up that says nothing (along the view) is replaced by an axis that
 * does.
 *
 * Returns: false when the camera has no direction.
 */
bool camera_axes(const struct camera *camera, double right[3], double up[3], double forward[3]);

/** The float offset of a node: payload_header.origin seen from the anchor. */
void camera_node_offset(const struct camera_view *view, const double payload_origin[3],
			float ret[3]);

/** A near plane that suits the distance of the eye to the model: nothing closer matters. */
double camera_near(const struct camera *camera, const struct store_superblock *superblock);

/** The whole model, well framed, from a little above; up axis as the store says. */
void camera_frame_all(struct camera *ret, const struct store_superblock *const *superblocks,
		      uint32_t superblock_count, double aspect, double fov_y_degrees);

/** The columns of a path: "t,eye_x,...,fov_y". */
extern const char camera_path_header[];

/**
 * Reads a row "t,eye_x,...,fov_y" of numbers; blanks around them are allowed.
 *
 * Returns: 0, or -EINVAL with the reason; what it accepts camera_view_init() accepts.
 */
int camera_from_row(struct camera *ret, const char *row, struct why *why);

#define CAMERA_ROW_BYTES 320
/** Writes a row without newline, every double exactly.  Returns: buffer, CAMERA_ROW_BYTES long. */
const char *camera_to_row(const struct camera *camera, char *buffer);

/**
 * Reads a whole path file.
 *
 * Returns: 0, -EUCLEAN with the line, -ENOMEM or -errno.  Ownership: free(*ret).
 */
int camera_path_read(const char *path, struct camera **ret, uint32_t *ret_count, struct why *why);

#endif /* LIBCLIENT_SELECT_CAMERA_H */
