/* SPDX-License-Identifier: MIT */
/**
 * hud.h - lines of text over a window's picture.
 *
 * Threads: the GL thread.
 */
#ifndef VIEWER_HUD_H
#define VIEWER_HUD_H

#include <stdint.h>

#include "formats/base/why.h"

struct hud;

/** Returns: 0, -EUCLEAN with what the driver says, or -ENOMEM. */
int hud_create(struct hud **ret, struct why *why);
struct hud *hud_destroy(struct hud *hud);

enum hud_corner {
	HUD_TOP_LEFT,
	HUD_BOTTOM_LEFT,
	HUD_CENTRE,
};

/** Puts a block of lines, apart by newlines, into a corner; drawn by hud_draw(). */
void hud_add(struct hud *hud, enum hud_corner corner, const char *text);

/** Draws what was added onto the window's framebuffer, and forgets it. */
void hud_draw(struct hud *hud, uint32_t width, uint32_t height);

#endif /* VIEWER_HUD_H */
