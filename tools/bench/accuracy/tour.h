/* SPDX-License-Identifier: MIT */
/**
 * tour.h - a small viewer that goes along a path and notes what every frame took and lacked.
 *
 * It is a client like any other: it chooses nodes, says its set, and draws what is there out of the
 * daemon's memory, by the software rasteriser, so that nothing but time depends on the machine.
 *
 * In a *waiting* tour, as the first published systems worked, a frame is drawn when its whole set is
 * there.  In one that does not wait it is drawn at once, without what is missing.  A frame begins a
 * frame's time after the one before, or later when that one took longer.
 *
 * Threads: the main thread, and that of the look-ahead.
 */
#ifndef TOOLS_BENCH_ACCURACY_TOUR_H
#define TOOLS_BENCH_ACCURACY_TOUR_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "libclient/select/camera.h"
#include "libclient/select/select.h"

enum tour_fetching {
	TOUR_SEQUENTIAL, /* one read at a time, all of them before the first triangle */
	TOUR_CONCURRENT, /* nodes are drawn as they come */
};

/** What is asked for ahead of time. */
enum tour_ahead {
	TOUR_AHEAD_NOTHING,
	TOUR_AHEAD_SELECTION, /* what the selection wants at cameras that are predicted */
	TOUR_AHEAD_PATH,      /* and at those that will come */
	TOUR_AHEAD_FRUSTUM, /* all that is in the frustum of cameras that are predicted, nearest first */
	TOUR_AHEAD_RADIUS, /* all that is near, whichever way one looks */
	TOUR_AHEAD_COUNT_
};

/** "nothing", "selection", ... */
const char *tour_ahead_name(enum tour_ahead ahead);

struct tour_options {
	const char *socket_path;
	const char *store;
	const struct camera *cameras;
	size_t camera_count;
	uint32_t width;
	uint32_t height;
	struct select_options selection; /* a budget of 0: all that is in the frustum */
	double frame_s; /* a frame takes at least so long; 0: as long as it takes */
	bool waits;
	enum tour_fetching fetching;
	enum tour_ahead ahead;
	double horizon_s;
	uint64_t ahead_bytes; /* a frame */
	uint32_t ahead_requests;
};

struct tour_frame {
	double ms;      /* from the choice of nodes until the last is drawn */
	double wait_ms; /* of it: for nodes */
	uint32_t wanted;
	uint32_t missing;       /* not drawn */
	uint64_t triangles;     /* drawn */
	uint64_t set_bytes;     /* of all that was wanted, decoded */
	uint64_t fetched_bytes; /* read meanwhile, for the set and ahead */
	uint64_t ahead_bytes;
	uint64_t picture;     /* hash of the picture's items */
	size_t missing_first; /* in tour.missing */
};

/**
 * What became of nodes that were wanted for the first time, after a first picture was complete: what
 * that one lacked nobody could have foreseen.
 */
struct tour_firsts {
	uint64_t count;
	uint64_t ready_count; /* there before they were wanted */
	uint64_t drawn_count;
	double *waits_frames; /* drawn_count: from the first frame that wanted it until drawn */
	double *waits_ms;
	double *leads_frames; /* lead_count: how long before they were wanted they had come */
	uint64_t lead_count;
};

/** What became of nodes that were asked for ahead of time. */
struct tour_prefetches {
	uint64_t asked_count;
	uint64_t came_count; /* and were there before any set wanted them */
	uint64_t used_count; /* of these: wanted within TOUR_USED_FRAMES */
	uint64_t came_bytes;
	uint64_t used_bytes;
};

#define TOUR_USED_FRAMES 60u

struct tour {
	struct tour_frame *frames;
	size_t frame_count;
	uint32_t *missing; /* nodes of all frames */
	size_t missing_count;
	size_t begun; /* the first frame that lacked nothing; frame_count: none */
	struct tour_firsts firsts;
	struct tour_prefetches prefetches;
	uint64_t fetched_bytes;
	uint64_t ahead_bytes;
	double seconds;
};

/**
 * Goes along the path.
 *
 * Returns: 0, -ECANCELED, or what went wrong.  Ownership: ends with tour_done().
 */
int tour_run(const struct tour_options *options, struct tour *ret, struct why *why);
void tour_done(struct tour *tour);

/** Makes every node that fits resident, in the order of the file.  Returns: 0 or what went wrong. */
int tour_warm(const struct tour_options *options, struct why *why);

#endif /* TOOLS_BENCH_ACCURACY_TOUR_H */
