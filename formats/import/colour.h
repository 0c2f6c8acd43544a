/* SPDX-License-Identifier: MIT */
/** colour.h - colours as 0xAABBGGRR.  Threads: any. */
#ifndef FORMATS_IMPORT_COLOUR_H
#define FORMATS_IMPORT_COLOUR_H

#include <stdint.h>

/** 0..1 as a byte; what is outside or no number is clamped. */
static inline uint32_t colour_byte(double value)
{
	if (!(value > 0.0))
		return 0;
	return value >= 1.0 ? 255 : (uint32_t)(value * 255.0 + 0.5);
}

/** An opaque colour of 0..1. */
static inline uint32_t colour_from_rgb(double red, double green, double blue)
{
	return UINT32_C(0xff000000) | colour_byte(blue) << 16 | colour_byte(green) << 8 |
	       colour_byte(red);
}

static inline uint32_t colour_with_opacity(uint32_t colour, double opacity)
{
	return (colour & UINT32_C(0x00ffffff)) | colour_byte(opacity) << 24;
}

#endif /* FORMATS_IMPORT_COLOUR_H */
