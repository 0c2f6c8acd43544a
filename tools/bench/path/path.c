/* SPDX-License-Identifier: MIT */
#include "tools/bench/path/path.h"

#include <errno.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/base/random.h"
#include "formats/store/store_file.h"
#include "tools/bench/path/occupancy.h"
#include "tools/bench/path/walk.h"

#define FRAMES_A_SECOND 30.0
#define WALK_FOV        65.0
#define ORBIT_FOV       45.0
#define ORBIT_ASPECT    (16.0 / 9.0)
/** A walker looks so far ahead along the way, in storeys, and turns no faster. */
#define LOOK_AHEAD_STOREYS 0.8
#define TURN_DEGREES_MAX   4.0
/** Of the way's slope: one looks less up and down than one goes. */
#define SLOPE_SHARE 0.4
/** Frames between two jumps; frames on, and back, of a reversal. */
#define TELEPORT_FRAMES 30u
#define REVERSAL_ON     90u
#define REVERSAL_BACK   60u
/** A flight's height above the middle and its reach, in halves of the model's box. */
#define FLY_HEIGHT 1.4
#define FLY_REACH  1.1

const char *const path_kinds[] = {
	[PATH_WALK] = "walk",         [PATH_ORBIT] = "orbit",       [PATH_FLY] = "fly",
	[PATH_TELEPORT] = "teleport", [PATH_REVERSAL] = "reversal", [PATH_KIND_COUNT_] = NULL,
};

/* ---- around it ---- */

static unsigned up_of(const struct store_superblock *superblock)
{
	return superblock->up_axis == STORE_AXIS_UNKNOWN ? 2 : superblock->up_axis - 1;
}

static void orbit_make(const struct store_superblock *superblock, struct camera *cameras,
		       uint64_t count)
{
	const struct store_superblock *superblocks[] = { superblock };
	unsigned up = up_of(superblock);
	struct camera first;
	double from[3];

	camera_frame_all(&first, superblocks, 1, ORBIT_ASPECT, ORBIT_FOV);
	for (unsigned k = 0; k < 3; k++)
		from[k] = first.eye[k] - first.at[k];
	for (uint64_t i = 0; i < count; i++) {
		double angle = 2.0 * M_PI * (double)i / (double)count;
		unsigned a = (up + 1) % 3;
		unsigned b = (up + 2) % 3;

		cameras[i] = first;
		cameras[i].time_s = (double)i / FRAMES_A_SECOND;
		cameras[i].eye[a] = first.at[a] + cos(angle) * from[a] - sin(angle) * from[b];
		cameras[i].eye[b] = first.at[b] + sin(angle) * from[a] + cos(angle) * from[b];
	}
}

/* A Lissajous figure over the model's box; a seed begins it elsewhere. */
static void fly_at(const struct store_superblock *superblock, double phase, uint64_t seed,
		   double ret[3])
{
	unsigned up = up_of(superblock);
	double angle = 2.0 * M_PI * phase + (double)(seed % 360) * (M_PI / 180.0);
	double half[3];

	for (unsigned k = 0; k < 3; k++) {
		half[k] = 0.5 * (superblock->box_max[k] - superblock->box_min[k]);
		ret[k] = superblock->origin[k] + superblock->box_min[k] + half[k];
	}
	ret[up] += FLY_HEIGHT * fmax(half[up], 0.3 * fmax(half[(up + 1) % 3], half[(up + 2) % 3]));
	ret[(up + 1) % 3] += FLY_REACH * half[(up + 1) % 3] * sin(2.0 * angle);
	ret[(up + 2) % 3] += FLY_REACH * half[(up + 2) % 3] * cos(angle);
}

static void fly_make(const struct store_superblock *superblock, uint64_t seed,
		     struct camera *cameras, uint64_t count)
{
	unsigned up = up_of(superblock);

	for (uint64_t i = 0; i < count; i++) {
		double phase = (double)i / (double)count;
		struct camera *camera = &cameras[i];
		double ahead[3];

		*camera = (struct camera){ .time_s = (double)i / FRAMES_A_SECOND,
					   .fov_y_degrees = WALK_FOV };
		camera->up[up] = 1.0;
		fly_at(superblock, phase, seed, camera->eye);
		fly_at(superblock, phase + 0.05, seed, ahead);
		memcpy(camera->at, ahead, sizeof(ahead));
		camera->at[up] = superblock->origin[up] +
				 0.5 * (superblock->box_min[up] + superblock->box_max[up]);
	}
}

/* ---- walks ---- */

static bool normalise(double v[3])
{
	double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);

	if (!(length > 1e-9))
		return false;
	for (unsigned k = 0; k < 3; k++)
		v[k] /= length;
	return true;
}

/* Turns a direction towards another, by at most an angle; the walker stays upright. */
static void turn_towards(double direction[3], const double wanted[3], double max_radians)
{
	double now = atan2(direction[1], direction[0]);
	double difference = remainder(atan2(wanted[1], wanted[0]) - now, 2.0 * M_PI);
	double turned = now + fmax(-max_radians, fmin(max_radians, difference));
	double rise =
		direction[2] + fmax(-max_radians, fmin(max_radians, wanted[2] - direction[2]));
	double flat = sqrt(fmax(0.0, 1.0 - rise * rise));

	direction[0] = flat * cos(turned);
	direction[1] = flat * sin(turned);
	direction[2] = rise;
}

/* Where a walker at a point looks: at the way's next stretch, averaged. */
static bool look_ahead(const struct walk *walk, size_t index, double ret[3])
{
	size_t reach = (size_t)(LOOK_AHEAD_STOREYS * walk->storey / walk->spacing) + 1;

	memset(ret, 0, 3 * sizeof(*ret));
	for (size_t i = index + 1; i <= index + reach && i < walk->point_count; i++)
		for (unsigned k = 0; k < 3; k++)
			ret[k] += walk->points[i].at[k] - walk->points[index].at[k];
	ret[2] *= SLOPE_SHARE;
	return normalise(ret);
}

static void walk_look(const struct walk *walk, const struct occupancy *occupancy,
		      const struct store_superblock *superblock, struct camera *cameras)
{
	double direction[3] = { 1.0, 0.0, 0.0 };
	double wanted[3];

	(void)look_ahead(walk, 0, direction);
	for (size_t i = 0; i < walk->point_count; i++) {
		struct camera *camera = &cameras[i];
		double at[3];

		if (look_ahead(walk, i, wanted))
			turn_towards(direction, wanted, TURN_DEGREES_MAX * (M_PI / 180.0));
		for (unsigned k = 0; k < 3; k++)
			at[k] = walk->points[i].at[k] + walk->storey * direction[k];
		*camera = (struct camera){ .time_s = (double)i / FRAMES_A_SECOND,
					   .fov_y_degrees = WALK_FOV };
		camera->up[occupancy->world[2]] = 1.0;
		occupancy_to_world(occupancy, superblock, walk->points[i].at, camera->eye);
		occupancy_to_world(occupancy, superblock, at, camera->at);
	}
}

static int walk_path(const struct store_file *store, size_t frame_count, uint64_t seed,
		     struct path *path, struct why *why)
{
	const struct store_superblock *superblock = store_superblock(store);
	struct store_node *nodes = calloc(superblock->node_count + 1, sizeof(*nodes));
	struct occupancy occupancy = { .full = NULL };
	struct walk walk = { .points = NULL };
	struct walk_site site;
	int r;

	if (!nodes)
		return why_set(why, -ENOMEM, "out of memory");
	r = store_load_hs(store, nodes, why);
	/* The whole coarsely, to find where the rooms are; then these, finely. */
	if (r == 0)
		r = occupancy_make(store, nodes, NULL, &occupancy, why);
	if (r == 0)
		r = walk_survey(&occupancy, superblock->unit_metres, seed, &site, why);
	occupancy_done(&occupancy);
	if (r == 0)
		r = occupancy_make(store, nodes, &site.region, &occupancy, why);
	if (r == 0)
		r = walk_make(&occupancy, site.storey, seed, frame_count, &walk, why);
	if (r == 0) {
		walk_look(&walk, &occupancy, superblock, path->cameras);
		path->camera_count = walk.point_count;
		path->storey = walk.storey * occupancy.voxel;
	}
	walk_done(&walk);
	occupancy_done(&occupancy);
	free(nodes);
	return r;
}

/* ---- walks cut up ---- */

static void teleport(struct path *path, const struct camera *walk, uint64_t seed)
{
	size_t piece_count = path->camera_count / TELEPORT_FRAMES;
	struct random random = { seed };

	memcpy(path->cameras, walk, path->camera_count * sizeof(*walk));
	for (size_t i = piece_count; i > 1; i--) {
		size_t j = random_next(&random) % i;

		for (size_t k = 0; k < TELEPORT_FRAMES; k++) {
			struct camera *a = &path->cameras[(i - 1) * TELEPORT_FRAMES + k];
			struct camera *b = &path->cameras[j * TELEPORT_FRAMES + k];
			struct camera swap = *a;

			*a = *b;
			*b = swap;
		}
	}
}

static void look_back(struct camera *camera, unsigned up)
{
	for (unsigned k = 0; k < 3; k++)
		if (k != up)
			camera->at[k] = 2.0 * camera->eye[k] - camera->at[k];
}

static void reverse(struct path *path, const struct camera *walk, unsigned up)
{
	size_t at = 0;

	for (size_t i = 0; i < path->camera_count; i++) {
		bool is_back = i % (REVERSAL_ON + REVERSAL_BACK) >= REVERSAL_ON;

		path->cameras[i] = walk[at];
		if (is_back)
			look_back(&path->cameras[i], up);
		at += is_back ? -(size_t)1 : 1;
	}
}

/* The walk's cameras in another order. */
static int cut_up(struct path *path, enum path_kind kind, uint64_t seed, unsigned up,
		  struct why *why)
{
	struct camera *walk = malloc(path->camera_count * sizeof(*walk));

	if (!walk)
		return why_set(why, -ENOMEM, "out of memory");
	memcpy(walk, path->cameras, path->camera_count * sizeof(*walk));
	if (kind == PATH_TELEPORT)
		teleport(path, walk, seed);
	else
		reverse(path, walk, up);
	for (size_t i = 0; i < path->camera_count; i++)
		path->cameras[i].time_s = (double)i / FRAMES_A_SECOND;
	free(walk);
	return 0;
}

/* ---- any path ---- */

static int make(const struct store_file *store, enum path_kind kind, size_t frame_count,
		uint64_t seed, struct path *path, struct why *why)
{
	const struct store_superblock *superblock = store_superblock(store);
	int r;

	path->camera_count = frame_count;
	switch (kind) {
	case PATH_ORBIT:
		orbit_make(superblock, path->cameras, frame_count);
		return 0;
	case PATH_FLY:
		fly_make(superblock, seed, path->cameras, frame_count);
		return 0;
	case PATH_WALK:
	case PATH_TELEPORT:
	case PATH_REVERSAL:
	case PATH_KIND_COUNT_:
		break;
	}
	r = walk_path(store, frame_count, seed, path, why);
	if (r == 0 && kind != PATH_WALK)
		r = cut_up(path, kind, seed, up_of(superblock), why);
	return r;
}

int path_make(const char *store_path, enum path_kind kind, size_t frame_count, uint64_t seed,
	      struct path *ret, struct why *why)
{
	struct path path = { .cameras = calloc(frame_count, sizeof(*path.cameras)) };
	struct store_file *store;
	int r;

	if (!path.cameras)
		return why_set(why, -ENOMEM, "out of memory");
	r = store_open_path(store_path, &store, why);
	if (r == 0) {
		r = make(store, kind, frame_count, seed, &path, why);
		if (r < 0)
			why_prefix(why, "%s", store_path);
		store_close(store);
	}
	if (r < 0) {
		free(path.cameras);
		return r;
	}
	*ret = path;
	return 0;
}

void path_done(struct path *path)
{
	free(path->cameras);
	*path = (struct path){ .cameras = NULL };
}

int path_write(const char *name, const struct camera *cameras, size_t count, struct why *why)
{
	FILE *file = name ? fopen(name, "we") : stdout;
	bool failed;

	if (!file)
		return why_errno(why, -errno, "%s", name);
	fprintf(file, "%s\n", camera_path_header);
	for (size_t i = 0; i < count; i++) {
		char row[CAMERA_ROW_BYTES];

		fprintf(file, "%s\n", camera_to_row(&cameras[i], row));
	}
	failed = fflush(file) != 0 || ferror(file);
	if (name && fclose(file) != 0)
		failed = true;
	return failed ? why_set(why, -EIO, "%s: cannot be written", name ? name : "standard output")
		      : 0;
}
