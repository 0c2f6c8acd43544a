/* SPDX-License-Identifier: MIT */
/**
 * font.h - the glyphs of the head-up display: printable ASCII, drawn for this program.
 *
 * Threads: any.
 */
#ifndef VIEWER_FONT_H
#define VIEWER_FONT_H

#include <stdint.h>

#define FONT_WIDTH  6 /* with a column of space */
#define FONT_HEIGHT 9
#define FONT_FIRST  32
#define FONT_LAST   126

/**
 * The rows of a character from the top; bit 0 is the leftmost pixel.  Characters that are not in the
 * font look like '?'.
 */
void font_glyph(unsigned char character, uint8_t ret_rows[FONT_HEIGHT]);

#endif /* VIEWER_FONT_H */
