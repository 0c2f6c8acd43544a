/* SPDX-License-Identifier: MIT */
/**
 * window_text.h - the texts of the head-up display.
 *
 * Threads: any; pure functions of their arguments.
 */
#ifndef VIEWER_WINDOW_TEXT_H
#define VIEWER_WINDOW_TEXT_H

#include <stdbool.h>
#include <stdint.h>

#include "viewer/frame.h"
#include "viewer/world.h"

#define WINDOW_TEXT_BYTES         1024
#define WINDOW_TEXT_MESSAGE_BYTES 512

/** All keys. */
extern const char window_text_help[];

struct window_text_facts {
	const struct world *world;
	const struct frame_style *style;
	const struct frame_report *report;
	double bytes_per_s;
	bool is_walking;
	double fps; /* that the budget keeps; 0: none */
};

/** A few lines about the picture.  Returns: buffer, WINDOW_TEXT_BYTES long. */
const char *window_text_state(const struct window_text_facts *facts, char *buffer);

#define WINDOW_RATE_SLOTS 16

/** Bytes over about the last second. */
struct window_rate {
	uint64_t slot; /* the newest; a sixteenth of a second each */
	uint64_t bytes[WINDOW_RATE_SLOTS];
};

void window_rate_add(struct window_rate *rate, uint64_t now_ns, uint64_t bytes);
double window_rate_get(struct window_rate *rate, uint64_t now_ns);

#endif /* VIEWER_WINDOW_TEXT_H */
