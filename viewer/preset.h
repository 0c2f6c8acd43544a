/* SPDX-License-Identifier: MIT */
/**
 * preset.h - published configurations by name.
 *
 * Threads: any.
 */
#ifndef VIEWER_PRESET_H
#define VIEWER_PRESET_H

#include <stdint.h>

/** What the configuration sets; each option of the command line that sets it too wins. */
struct preset {
	const char *name;
	uint64_t budget_triangles; /* in the order of layers */
	double fps;                /* that the budget was meant for: the deadline of a frame */
	uint32_t width;
	uint32_t height;
	uint64_t prefetch_bytes;       /* a frame */
	uint64_t cache_bytes;          /* of the daemon */
	const char *daemon_options[9]; /* for one that is started, ended by NULL */
};

/** NULL where there is none of that name. */
const struct preset *preset_find(const char *name);

#endif /* VIEWER_PRESET_H */
